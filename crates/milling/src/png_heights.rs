//! Pictures as height maps.

use std::io::Cursor;

use image::{ImageFormat, ImageReader, Limits};

use crate::MillingError;
use crate::height_map::{HeightFormat, HeightMap, check_size};

const FORMAT: HeightFormat = HeightFormat::Png;

/// Longest side that is read, pixels.
const MAX_SIDE: u32 = 16_384;

/// Reads the brightness of a PNG file, of 8 or 16 bits, as heights from 0 to 65535.
pub(crate) fn read_png(bytes: &[u8]) -> Result<HeightMap, MillingError> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(512 << 20);
    reader.limits(limits);
    let picture = match reader.decode() {
        Ok(picture) => picture.into_luma16(),
        Err(error) => return FORMAT.broken(error.to_string()),
    };
    let (columns, rows) = (picture.width() as usize, picture.height() as usize);
    check_size(rows, columns)?;
    Ok(HeightMap {
        rows,
        columns,
        heights: picture.iter().map(|value| f64::from(*value)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageBuffer, Luma};

    #[test]
    fn sixteen_bits_are_kept() {
        let picture =
            ImageBuffer::<Luma<u16>, _>::from_raw(3, 2, vec![0, 1, 258, 4, 5, 65535]).unwrap();
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Png).unwrap();
        let map = read_png(bytes.get_ref()).unwrap();
        assert_eq!((map.rows, map.columns), (2, 3));
        assert_eq!(map.heights, [0.0, 1.0, 258.0, 4.0, 5.0, 65535.0]);
        // A file cut short is refused.
        assert!(read_png(&bytes.get_ref()[..40]).is_err());
    }

    #[test]
    fn other_files_are_refused() {
        assert!(matches!(read_png(b"GIF89a"), Err(MillingError::HeightFile { format: "PNG", .. })));
    }
}
