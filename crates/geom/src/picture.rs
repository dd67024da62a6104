//! Pictures: rasterised SVG and PNG bytes.

use std::io::Cursor;

use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
use resvg::{tiny_skia, usvg};

use crate::{
    DrawingError,
    svg_document::{SvgDocument, isolated},
};

/// Largest number of pixels of a [`Picture`].
const MAX_PICTURE_PIXELS: u64 = 64_000_000;

/// A picture, 8 bits a channel, not premultiplied, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width, px.
    pub width_px: u32,
    /// Height, px.
    pub height_px: u32,
    /// Red, green, blue, alpha of each pixel, row by row from the top left:
    /// shape (height, width, 4).
    pub rgba: Vec<u8>,
}

impl Picture {
    /// The picture as the bytes of a PNG file.
    ///
    /// # Errors
    /// [`DrawingError::NotEncoded`] when `rgba` has not width × height × 4 bytes.
    pub fn to_png(&self) -> Result<Vec<u8>, DrawingError> {
        let expected = u64::from(self.width_px) * u64::from(self.height_px) * 4;
        if self.rgba.len() as u64 != expected {
            let found = self.rgba.len();
            return Err(DrawingError::NotEncoded {
                reason: format!("it has {found} bytes instead of {expected}"),
            });
        }
        let mut bytes = Cursor::new(Vec::new());
        PngEncoder::new(&mut bytes)
            .write_image(&self.rgba, self.width_px, self.height_px, ExtendedColorType::Rgba8)
            .map_err(|error| DrawingError::NotEncoded { reason: error.to_string() })?;
        Ok(bytes.into_inner())
    }
}

/// Draws an SVG document `width_px` wide; the height follows from the document's aspect. What the
/// document leaves unpainted is transparent.
///
/// Meant for documents of our own: nothing is loaded from outside the document, system fonts are
/// searched when it holds text.
///
/// # Errors
/// [`DrawingError::Malformed`] when `svg` is no SVG document, [`DrawingError::NoFont`] when its text
/// cannot be set, [`DrawingError::InvalidOption`] when `width_px` is zero and
/// [`DrawingError::TooLarge`] when the picture would have more than 64 million pixels.
pub fn svg_to_rgba(svg: &str, width_px: u32) -> Result<Picture, DrawingError> {
    isolated(|| {
        let document = SvgDocument::parse(svg)?;
        let size = document.tree.size();
        let scale = width_px as f32 / size.width();
        let height_px = (size.height() * scale).round().max(1.0) as u32;
        let transform = usvg::Transform::from_scale(scale, scale);
        render(&document.tree, transform, width_px, height_px)
    })
}

/// Renders `tree`, moved by `transform` from document units to pixels, on a transparent ground.
pub(crate) fn render(
    tree: &usvg::Tree,
    transform: usvg::Transform,
    width_px: u32,
    height_px: u32,
) -> Result<Picture, DrawingError> {
    let pixels = u64::from(width_px) * u64::from(height_px);
    if pixels > MAX_PICTURE_PIXELS {
        return Err(DrawingError::TooLarge {
            unit: "pixels",
            found: pixels,
            limit: MAX_PICTURE_PIXELS,
        });
    }
    let mut pixmap =
        tiny_skia::Pixmap::new(width_px, height_px).ok_or(DrawingError::InvalidOption {
            name: "width_px",
            value: f64::from(width_px),
            expected: "at least 1",
        })?;
    resvg::render(tree, transform, &mut pixmap.as_mut());
    Ok(Picture { width_px, height_px, rgba: pixmap.take_demultiplied() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 20 10">
        <rect width="10" height="10" fill="#c00000"/></svg>"##;

    #[test]
    fn a_picture_has_the_aspect_and_the_colours_of_its_document() {
        let picture = svg_to_rgba(SQUARE, 40).unwrap();
        assert_eq!((picture.width_px, picture.height_px), (40, 20));
        assert_eq!(picture.rgba.len(), 40 * 20 * 4);
        assert_eq!(picture.rgba[..4], [0xc0, 0, 0, 255]);
        assert_eq!(picture.rgba[39 * 4..40 * 4], [0; 4]);
    }

    #[test]
    fn png_bytes_decode_to_the_same_picture() {
        let picture = svg_to_rgba(SQUARE, 40).unwrap();
        let decoded = image::load_from_memory(&picture.to_png().unwrap()).unwrap().into_rgba8();
        assert_eq!(decoded.into_raw(), picture.rgba);
    }

    #[test]
    fn text_is_drawn() {
        let svg = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20">
            <text x="2" y="15" font-family="sans-serif" font-size="14">gym</text></svg>"#;
        match svg_to_rgba(svg, 80) {
            Ok(picture) => assert!(picture.rgba.iter().any(|&byte| byte > 0)),
            Err(error) => assert!(matches!(error, DrawingError::NoFont { .. }), "{error}"),
        }
    }

    #[test]
    fn a_width_of_zero_is_refused() {
        let error = svg_to_rgba(SQUARE, 0).unwrap_err();
        assert!(matches!(error, DrawingError::InvalidOption { name: "width_px", .. }), "{error}");
    }

    #[test]
    fn a_picture_over_the_limit_is_refused() {
        let error = svg_to_rgba(SQUARE, 100_000).unwrap_err();
        assert!(matches!(error, DrawingError::TooLarge { unit: "pixels", .. }), "{error}");
    }

    #[test]
    fn what_is_not_svg_is_refused() {
        let error = svg_to_rgba("<html/>", 10).unwrap_err();
        assert!(matches!(error, DrawingError::Malformed { .. }), "{error}");
    }

    #[test]
    fn a_picture_without_its_pixels_is_not_encoded() {
        let broken = Picture { width_px: 2, height_px: 2, rgba: vec![0; 3] };
        assert!(matches!(broken.to_png(), Err(DrawingError::NotEncoded { .. })));
    }
}
