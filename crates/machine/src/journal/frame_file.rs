//! Frames as PNG files of 8 bits grey.

use std::io::Cursor;
use std::time::Instant;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{ColorType, ExtendedColorType, ImageDecoder as _, ImageEncoder, ImageResult};

use super::record::FrameRecord;
use crate::{Frame, JobError};

/// Quality of previews: rims of marks stay sharp, and they take a fifth of the PNG.
const PREVIEW_QUALITY: u8 = 80;

/// A frame for people to look at; its pixels are not exact.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePreview {
    /// The bytes of a JPEG file.
    pub jpeg: Vec<u8>,
    /// Columns, px.
    pub width_px: usize,
    /// Rows, px.
    pub height_px: usize,
}

/// The preview of a frame from the bytes of its PNG `file`.
///
/// # Errors
/// [`JobError::Frame`] for anything but a frame.
pub fn frame_preview(bytes: &[u8], file: &str) -> Result<FramePreview, JobError> {
    let frame = frame_from_png(bytes, file)?;
    let mut jpeg = Vec::new();
    encode(&frame, JpegEncoder::new_with_quality(&mut jpeg, PREVIEW_QUALITY))
        .map_err(|error| JobError::Frame { file: file.to_owned(), reason: error.to_string() })?;
    Ok(FramePreview { jpeg, width_px: frame.width_px(), height_px: frame.height_px() })
}

/// The file of the frame after command `pulse`.
pub(crate) fn frame_name(pulse: usize) -> String {
    format!("frames/{pulse:04}.png")
}

/// CRC-32 of the pixels of a frame, 8 hexadecimal digits.
pub(crate) fn pixels_crc(frame: &Frame) -> String {
    format!("{:08x}", crc32fast::hash(frame.gray()))
}

/// The bytes of a PNG file.
pub(crate) fn frame_to_png(frame: &Frame) -> Result<Vec<u8>, JobError> {
    let mut bytes = Vec::new();
    let encoder =
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    encode(frame, encoder).map_err(|error| JobError::Record { reason: error.to_string() })?;
    Ok(bytes)
}

/// Writes the pixels of a frame by `encoder`.
fn encode(frame: &Frame, encoder: impl ImageEncoder) -> ImageResult<()> {
    let side = |px: usize| u32::try_from(px).unwrap_or(u32::MAX);
    let (width_px, height_px) = (side(frame.width_px()), side(frame.height_px()));
    encoder.write_image(frame.gray(), width_px, height_px, ExtendedColorType::L8)
}

/// The frame in the bytes of `file`, taken now.
pub(crate) fn frame_from_png(bytes: &[u8], file: &str) -> Result<Frame, JobError> {
    let refused = |reason: String| JobError::Frame { file: file.to_owned(), reason };
    let decoder =
        PngDecoder::new(Cursor::new(bytes)).map_err(|error| refused(error.to_string()))?;
    if decoder.color_type() != ColorType::L8 {
        return Err(refused("it is not of 8 bits grey".to_owned()));
    }
    let (width_px, height_px) = decoder.dimensions();
    let (width_px, height_px) = (width_px as usize, height_px as usize);
    // Before the pixels take up memory.
    Frame::check_sides(width_px, height_px).map_err(|error| refused(error.to_string()))?;
    let mut gray = vec![0; width_px * height_px];
    decoder.read_image(&mut gray).map_err(|error| refused(error.to_string()))?;
    Frame::new(width_px, height_px, gray, Instant::now())
        .map_err(|error| refused(error.to_string()))
}

/// The frame of `record` from the bytes of its file, taken now.
pub(crate) fn recorded_frame(bytes: &[u8], record: &FrameRecord) -> Result<Frame, JobError> {
    let frame = frame_from_png(bytes, &record.file)?;
    let sides_px = (frame.width_px(), frame.height_px());
    if sides_px != (record.width_px, record.height_px) || pixels_crc(&frame) != record.crc {
        let reason = "its pixels are not those that were taken".to_owned();
        return Err(JobError::Frame { file: record.file.clone(), reason });
    }
    Ok(frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame_and_record() -> (Frame, FrameRecord) {
        let gray = (0..640 * 480_u64).map(|k| (k * k / 7 % 251) as u8).collect();
        let frame = Frame::new(640, 480, gray, Instant::now()).unwrap();
        let record = FrameRecord {
            pulse: 3,
            file: frame_name(3),
            width_px: 640,
            height_px: 480,
            crc: pixels_crc(&frame),
        };
        (frame, record)
    }

    #[test]
    fn a_frame_reads_back() {
        let (frame, record) = frame_and_record();
        let read = recorded_frame(&frame_to_png(&frame).unwrap(), &record).unwrap();
        assert_eq!((read.width_px(), read.gray()), (640, frame.gray()));
        assert_eq!(record.file, "frames/0003.png");
    }

    #[test]
    fn a_preview_looks_like_its_frame_and_is_small() {
        let gray = (0..640 * 480_u32).map(|k| (128 + k % 640 / 6 + k / 640 % 7) as u8).collect();
        let frame = Frame::new(640, 480, gray, Instant::now()).unwrap();
        let png = frame_to_png(&frame).unwrap();
        let preview = frame_preview(&png, "frames/0001.png").unwrap();
        assert_eq!((preview.width_px, preview.height_px), (640, 480));
        let shown = image::load_from_memory(&preview.jpeg).unwrap().into_luma8();
        let far = frame.gray().iter().zip(shown.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(far < Some(12), "{far:?}");
        assert!(frame_preview(&png[..100], "frames/0001.png").is_err());
    }

    #[test]
    fn a_frame_that_is_not_the_one_of_the_record_is_refused() {
        let (frame, record) = frame_and_record();
        let png = frame_to_png(&frame).unwrap();
        let other = FrameRecord { crc: "00000000".to_owned(), ..record.clone() };
        let wide = FrameRecord { width_px: usize::MAX, ..record.clone() };
        assert!(recorded_frame(&png, &other).is_err());
        assert!(recorded_frame(&png, &wide).is_err());
        assert!(recorded_frame(&png[..png.len() / 2], &record).is_err());
        assert!(recorded_frame(b"no picture", &record).is_err());
    }
}
