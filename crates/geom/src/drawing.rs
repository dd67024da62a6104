//! Drawings in: PNG, JPEG, SVG and DXF files become targets.

use std::{
    fs::File,
    io::{ErrorKind, Read as _},
    path::Path,
};

use crate::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, dxf_drawing::dxf_target,
    image_drawing::image_target, svg_drawing::svg_target,
};

/// Largest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// Reads the file at `path` as a target. The format goes by the content, where that shows none by
/// the extension.
///
/// # Errors
/// [`DrawingError::NotFound`], [`DrawingError::Unreadable`], [`DrawingError::UnknownFormat`],
/// [`DrawingError::TooLarge`] for a file over 64 MiB, and those of [`drawing_from_bytes`].
pub fn load_drawing(
    path: impl AsRef<Path>,
    options: &DrawingOptions,
) -> Result<Bitmap, DrawingError> {
    options.validate()?;
    let (bytes, format) = read_drawing(path.as_ref())?;
    drawing_from_bytes(&bytes, format, options)
}

/// The content of the file at `path` and its format.
pub(crate) fn read_drawing(path: &Path) -> Result<(Vec<u8>, DrawingFormat), DrawingError> {
    let refuse = |source: std::io::Error| match source.kind() {
        ErrorKind::NotFound => DrawingError::NotFound { path: path.into() },
        _ => DrawingError::Unreadable { path: path.into(), source },
    };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(refuse)?;
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(refuse)?;
    let format = DrawingFormat::from_magic(&bytes)
        .or_else(|| DrawingFormat::from_extension(path))
        .ok_or_else(|| DrawingError::UnknownFormat { path: path.into() })?;
    Ok((bytes, format))
}

/// Reads the bytes of a drawing as a target.
///
/// # Errors
/// - [`DrawingError::InvalidOption`] when an option is out of its range;
/// - [`DrawingError::TooLarge`] over 64 MiB, 25 megapixels, or the limits of SVG and DXF content;
/// - [`DrawingError::NotAnImage`], [`DrawingError::Truncated`], [`DrawingError::Malformed`] for bytes
///   that are not a whole drawing of `format`;
/// - [`DrawingError::WrongSize`] with [`Fit::Exact`](crate::Fit::Exact);
/// - [`DrawingError::NoShapes`], [`DrawingError::UnknownEntities`], [`DrawingError::NoFont`] for SVG
///   and DXF, [`DrawingError::OpenContour`] for DXF;
/// - [`DrawingError::EmptyTarget`] and [`DrawingError::FullTarget`] when no pixel or every pixel of
///   the workpiece is target.
pub fn drawing_from_bytes(
    bytes: &[u8],
    format: DrawingFormat,
    options: &DrawingOptions,
) -> Result<Bitmap, DrawingError> {
    options.validate()?;
    let found = bytes.len() as u64;
    if found > MAX_FILE_BYTES {
        return Err(DrawingError::TooLarge { unit: "bytes", found, limit: MAX_FILE_BYTES });
    }
    let target = match format {
        DrawingFormat::Png | DrawingFormat::Jpeg => image_target(bytes, format, options)?,
        DrawingFormat::Svg => svg_target(bytes, options)?,
        DrawingFormat::Dxf => dxf_target(bytes, options)?,
    };
    if target.is_empty() {
        return Err(DrawingError::EmptyTarget);
    }
    if target.complement().is_empty() {
        return Err(DrawingError::FullTarget);
    }
    Ok(target)
}
