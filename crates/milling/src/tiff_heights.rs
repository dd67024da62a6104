//! TIFF images as height maps.

use std::io::Cursor;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::{ColorType, TiffError};

use crate::MillingError;
use crate::height_map::{HeightFormat, HeightMap, check_size};

const FORMAT: HeightFormat = HeightFormat::Tiff;

/// Most memory that decoding may take, bytes.
const MAX_DECODED: usize = 512 << 20;

/// Parts of red, green and blue in the brightness (ITU-R BT.709).
const BRIGHTNESS: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Reads the first image of a TIFF file: the numbers themselves where they are shades of grey (as in
/// elevation models, which hold floats), the brightness of colours. Opacity is ignored.
pub(crate) fn read_tiff(bytes: &[u8]) -> Result<HeightMap, MillingError> {
    decode(bytes).unwrap_or_else(|error| FORMAT.broken(error.to_string()))
}

fn decode(bytes: &[u8]) -> Result<Result<HeightMap, MillingError>, TiffError> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_DECODED;
    limits.intermediate_buffer_size = MAX_DECODED;
    let mut decoder = Decoder::new(Cursor::new(bytes))?.with_limits(limits);
    let (columns, rows) = decoder.dimensions()?;
    let (columns, rows) = (columns as usize, rows as usize);
    if let Err(error) = check_size(rows, columns) {
        return Ok(Err(error));
    }
    let colours = decoder.colortype()?;
    let (samples, is_grey) = match colours {
        ColorType::Gray(_) => (1, true),
        ColorType::GrayA(_) => (2, true),
        ColorType::RGB(_) => (3, false),
        ColorType::RGBA(_) => (4, false),
        other => return Ok(FORMAT.broken(format!("its colours are {other:?}, not grey or RGB"))),
    };
    let values = real_numbers(decoder.read_image()?);
    if values.len() != rows * columns * samples {
        return Ok(FORMAT.broken(format!("it does not hold {rows} × {columns} pixels")));
    }
    let height = |pixel: &[f64]| {
        if is_grey {
            pixel[0]
        } else {
            BRIGHTNESS.iter().zip(pixel).map(|(part, value)| part * value).sum()
        }
    };
    let heights = values.chunks_exact(samples).map(height).collect();
    Ok(Ok(HeightMap { rows, columns, heights }))
}

/// The samples as numbers, whatever their type.
fn real_numbers(samples: DecodingResult) -> Vec<f64> {
    match samples {
        DecodingResult::U8(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::U16(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::U32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::U64(values) => values.into_iter().map(|value| value as f64).collect(),
        DecodingResult::I8(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I16(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I64(values) => values.into_iter().map(|value| value as f64).collect(),
        DecodingResult::F16(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F64(values) => values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tiff::encoder::colortype::{self, ColorType as Encoded};
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue};

    /// A file of 2 rows and 3 columns.
    fn file<C: Encoded>(values: &[C::Inner], compression: Compression) -> Vec<u8>
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        TiffEncoder::new(&mut bytes)
            .unwrap()
            .with_compression(compression)
            .write_image::<C>(3, 2, values)
            .unwrap();
        bytes.into_inner()
    }

    fn floats() -> Vec<u8> {
        let values = [1.5_f32, -2.0, 0.0, 4.25, 1e6, -7.5];
        file::<colortype::Gray32Float>(&values, Compression::Uncompressed)
    }

    /// The value field of an entry of the first directory, little endian.
    fn entry(bytes: &[u8], tag: u16) -> usize {
        let start = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
        let count = usize::from(u16::from_le_bytes(bytes[start..start + 2].try_into().unwrap()));
        (0..count)
            .map(|k| start + 2 + 12 * k)
            .find(|&at| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()) == tag)
            .unwrap()
            + 8
    }

    #[test]
    fn numbers_of_every_size_are_kept() {
        let plain = Compression::Uncompressed;
        let map = read_tiff(&floats()).unwrap();
        assert_eq!((map.rows, map.columns), (2, 3));
        assert_eq!(map.heights, [1.5, -2.0, 0.0, 4.25, 1e6, -7.5]);
        let heights = |bytes: Vec<u8>| read_tiff(&bytes).unwrap().heights;
        let expected = [0.0, 1.0, 2.0, 3.0, 4.0, 250.0];
        assert_eq!(heights(file::<colortype::Gray8>(&[0, 1, 2, 3, 4, 250], plain)), expected);
        let deflated = Compression::Deflate(DeflateLevel::default());
        assert_eq!(heights(file::<colortype::Gray16>(&[0, 1, 2, 3, 4, 250], deflated)), expected);
        let lzw = Compression::Lzw;
        let signed = heights(file::<colortype::GrayI16>(&[-300, 1, 2, 3, 4, 250], lzw));
        assert_eq!(signed, [-300.0, 1.0, 2.0, 3.0, 4.0, 250.0]);
        let doubles = [0.1, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(heights(file::<colortype::Gray64Float>(&doubles, plain)), doubles);
    }

    #[test]
    fn colours_count_by_their_brightness() {
        let pixels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9], [0, 0, 0], [255; 3]];
        let bytes = file::<colortype::RGB8>(&pixels.concat(), Compression::Uncompressed);
        let heights = read_tiff(&bytes).unwrap().heights;
        for (height, expected) in heights.iter().zip([54.213, 182.376, 18.411, 9.0, 0.0, 255.0]) {
            assert!((height - expected).abs() < 1e-9, "{height} and {expected}");
        }
    }

    #[test]
    fn another_kind_of_file_is_refused() {
        let error = read_tiff(b"\x89PNG\r\n\x1a\n").unwrap_err();
        assert!(matches!(error, MillingError::HeightFile { format: "TIFF", .. }));
        assert!(read_tiff(b"").is_err());
    }

    #[test]
    fn a_file_cut_short_is_refused() {
        let whole = floats();
        for length in 0..whole.len() {
            assert!(read_tiff(&whole[..length]).is_err(), "{length} of {} bytes", whole.len());
        }
    }

    #[test]
    fn a_directory_beyond_the_end_is_refused() {
        let mut bytes = floats();
        bytes[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read_tiff(&bytes), Err(MillingError::HeightFile { .. })));
    }

    #[test]
    fn a_directory_without_a_size_is_refused() {
        let mut bytes = floats();
        // The width becomes a private tag.
        let at = entry(&bytes, 256) - 8;
        bytes[at..at + 2].copy_from_slice(&65_000_u16.to_le_bytes());
        assert!(matches!(read_tiff(&bytes), Err(MillingError::HeightFile { .. })));
    }

    #[test]
    fn a_size_beyond_any_grid_is_refused() {
        let mut bytes = floats();
        for tag in [256, 257] {
            let at = entry(&bytes, tag);
            bytes[at..at + 4].copy_from_slice(&100_000_u32.to_le_bytes());
        }
        let error = read_tiff(&bytes).unwrap_err();
        assert!(matches!(error, MillingError::GridSize { .. } | MillingError::HeightFile { .. }));
    }

    #[test]
    fn a_size_beyond_the_data_is_refused() {
        let mut bytes = floats();
        for tag in [256, 257] {
            let at = entry(&bytes, tag);
            bytes[at..at + 4].copy_from_slice(&1000_u32.to_le_bytes());
        }
        assert!(matches!(read_tiff(&bytes), Err(MillingError::HeightFile { .. })));
    }

    #[test]
    fn other_colours_are_refused() {
        let pixels = [7_u8; 24];
        let bytes = file::<colortype::CMYK8>(&pixels, Compression::Uncompressed);
        assert!(read_tiff(&bytes).unwrap_err().to_string().contains("CMYK"));
    }

    #[test]
    fn an_unknown_compression_is_refused() {
        let mut bytes = floats();
        let at = entry(&bytes, 259);
        bytes[at..at + 2].copy_from_slice(&34_712_u16.to_le_bytes());
        assert!(matches!(read_tiff(&bytes), Err(MillingError::HeightFile { .. })));
    }

    #[test]
    fn a_height_that_is_no_number_is_named_by_its_place() {
        let values = [1.0, 2.0, 3.0, 4.0, f32::NAN, 6.0];
        let bytes = file::<colortype::Gray32Float>(&values, Compression::Uncompressed);
        let error = HeightMap::read(&bytes, HeightFormat::Tiff, 1.0).unwrap_err();
        assert!(matches!(error, MillingError::HeightValue { row: 1, column: 1, .. }));
    }

    proptest! {
        #[test]
        fn damaged_files_are_read_or_refused(at in 0..400_usize, value: u8) {
            for mut bytes in [floats(), file::<colortype::Gray8>(&[7; 6], Compression::Lzw)] {
                let at = at % bytes.len();
                bytes[at] = value;
                let _ = HeightMap::read(&bytes, HeightFormat::Tiff, 1.0);
            }
        }
    }
}
