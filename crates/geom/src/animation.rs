//! Pictures one after another as the bytes of a GIF file.

use std::time::Duration;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbaImage};

use crate::{DrawingError, Picture};

/// Speed of choosing the colours of a frame, from 1 (best) to 30.
const COLOR_SPEED: i32 = 10;

/// `pictures` as an animation that repeats for ever, each shown for `delay`.
///
/// # Errors
/// [`DrawingError::NotEncoded`] when a picture has not width × height × 4 bytes, or is wider or
/// higher than 65 535 px.
pub fn animation_gif(pictures: &[Picture], delay: Duration) -> Result<Vec<u8>, DrawingError> {
    let not_encoded = |reason: String| DrawingError::NotEncoded { reason };
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, COLOR_SPEED);
    encoder.set_repeat(Repeat::Infinite).map_err(|error| not_encoded(error.to_string()))?;
    for picture in pictures {
        let found = picture.rgba.len();
        let image = RgbaImage::from_raw(picture.width_px, picture.height_px, picture.rgba.clone())
            .ok_or_else(|| not_encoded(format!("it has {found} bytes")))?;
        let frame = Frame::from_parts(image, 0, 0, Delay::from_saturating_duration(delay));
        encoder.encode_frame(frame).map_err(|error| not_encoded(error.to_string()))?;
    }
    drop(encoder);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use image::AnimationDecoder as _;
    use image::codecs::gif::GifDecoder;

    use super::*;

    fn plain(color: [u8; 4]) -> Picture {
        Picture { width_px: 5, height_px: 3, rgba: color.repeat(15) }
    }

    #[test]
    fn every_picture_is_a_frame_with_its_delay() {
        let colors = [[255, 0, 0, 255], [0, 128, 0, 255], [0, 0, 255, 255]];
        let bytes = animation_gif(&colors.map(plain), Duration::from_millis(150)).unwrap();
        let frames =
            GifDecoder::new(std::io::Cursor::new(bytes)).unwrap().into_frames().collect_frames();
        let frames = frames.unwrap();
        assert_eq!(frames.len(), 3);
        for (frame, color) in frames.iter().zip(colors) {
            assert_eq!(frame.delay().numer_denom_ms(), (150, 1));
            assert!(frame.buffer().pixels().all(|pixel| pixel.0 == color));
        }
    }

    #[test]
    fn a_picture_that_lacks_bytes_is_refused() {
        let broken = Picture { width_px: 5, height_px: 3, rgba: vec![0; 59] };
        let error = animation_gif(&[broken], Duration::ZERO).unwrap_err();
        assert!(matches!(error, DrawingError::NotEncoded { .. }), "{error}");
    }
}
