//! PNG and JPEG images as targets, and targets as PNG images.

use std::{fs, io::Cursor, path::Path};

use image::{ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use crate::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, Fit, Picture, WORKPIECE_SIZE_PX,
    ink_raster::{InkRaster, InkRule},
};

/// Largest number of pixels of an image.
const MAX_PIXELS: u64 = 25_000_000;

/// Largest memory for decoding, bytes: 16-bit RGBA of the largest image, and as much again.
const MAX_DECODING_BYTES: u64 = 16 * MAX_PIXELS;

/// Reads a PNG or JPEG image as a target.
pub(crate) fn image_target(
    bytes: &[u8],
    format: DrawingFormat,
    options: &DrawingOptions,
) -> Result<Bitmap, DrawingError> {
    let image_format = match format {
        DrawingFormat::Jpeg => ImageFormat::Jpeg,
        _ => ImageFormat::Png,
    };
    if DrawingFormat::from_magic(bytes) != Some(format) {
        let begun = bytes.len() < 8 && b"\x89PNG\r\n\x1a\n".starts_with(bytes)
            || bytes.len() < 3 && b"\xff\xd8\xff".starts_with(bytes);
        let error = if begun {
            DrawingError::Truncated { format }
        } else {
            DrawingError::NotAnImage { format }
        };
        return Err(error);
    }
    if !is_complete(bytes, format) {
        return Err(DrawingError::Truncated { format });
    }
    let refuse = |error| refusal(&error, format);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), image_format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODING_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(refuse)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MAX_PIXELS {
        return Err(DrawingError::TooLarge { unit: "pixels", found: pixels, limit: MAX_PIXELS });
    }
    let size = WORKPIECE_SIZE_PX as u32;
    if options.fit == Fit::Exact && (width, height) != (size, size) {
        return Err(DrawingError::WrongSize { width: f64::from(width), height: f64::from(height) });
    }
    let rgba = image::DynamicImage::from_decoder(decoder).map_err(refuse)?.into_rgba8();
    let rule = InkRule::decide(options.ink, &rgba);
    InkRaster::from_rgba(&rgba, width as usize, rule, options.invert).target(options)
}

/// Whether the file reaches its end mark: decoders fill what is missing with grey.
fn is_complete(bytes: &[u8], format: DrawingFormat) -> bool {
    if format == DrawingFormat::Jpeg {
        // An embedded preview has marks of its own, before those of the image.
        let last = |mark: u8| bytes.windows(2).rposition(|pair| pair == [0xff, mark]);
        let (scan, end) = (last(0xda), last(0xd9));
        return scan.is_some() && scan < end;
    }
    let mut rest = &bytes[8..];
    // Chunks of a length, a name, the data and a checksum; the last one is IEND.
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        if after.len() < length.saturating_add(8) {
            return false;
        }
        if after.starts_with(b"IEND") {
            return true;
        }
        rest = &after[length + 8..];
    }
    false
}

/// The reason for which the decoder refuses an image.
fn refusal(error: &ImageError, format: DrawingFormat) -> DrawingError {
    match error {
        ImageError::IoError(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            DrawingError::Truncated { format }
        }
        ImageError::Limits(_) => DrawingError::TooLarge {
            unit: "bytes of memory or more for decoding",
            found: MAX_DECODING_BYTES + 1,
            limit: MAX_DECODING_BYTES,
        },
        error => DrawingError::Malformed { format, reason: error.to_string() },
    }
}

/// The target as the bytes of a PNG image of 100 × 100 pixels: target black, the rest white.
/// Read back with [`Fit::Exact`], it is the same target.
///
/// # Errors
/// [`DrawingError::NotEncoded`] when the encoder fails.
pub fn target_to_png(target: &Bitmap) -> Result<Vec<u8>, DrawingError> {
    let size = WORKPIECE_SIZE_PX;
    let rgba = (0..size * size).flat_map(|k| {
        let value = if target.contains(k / size, k % size) { 0 } else { 255 };
        [value, value, value, 255]
    });
    Picture { width_px: size as u32, height_px: size as u32, rgba: rgba.collect() }.to_png()
}

/// Writes [`target_to_png`] to `path`.
///
/// # Errors
/// [`DrawingError::Unwritable`] when the file cannot be written.
pub fn write_png(target: &Bitmap, path: impl AsRef<Path>) -> Result<(), DrawingError> {
    let path = path.as_ref();
    fs::write(path, target_to_png(target)?)
        .map_err(|source| DrawingError::Unwritable { path: path.into(), source })
}
