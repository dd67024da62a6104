//! `NumPy` arrays as height maps.

use crate::MillingError;
use crate::height_map::{HeightFormat, HeightMap, check_size};

const FORMAT: HeightFormat = HeightFormat::Npy;

/// Longest header that is read, bytes.
const MAX_HEADER: usize = 64 << 10;

/// Reads a two-dimensional array of Booleans, integers or floats, in C or Fortran order.
pub(crate) fn read_npy(bytes: &[u8]) -> Result<HeightMap, MillingError> {
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
        return FORMAT.broken("it does not begin as a NumPy array");
    };
    let (length, start) = match rest {
        [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 4),
        [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 6),
        _ => return FORMAT.broken("its version is not 1, 2 or 3"),
    };
    if length > MAX_HEADER {
        return FORMAT.broken("its header is longer than 64 kB");
    }
    let Some(header) = rest.get(start..start + length) else {
        return FORMAT.broken("it ends within the header");
    };
    let Ok(header) = std::str::from_utf8(header) else {
        return FORMAT.broken("its header is no text");
    };
    let (Some(kind), Some(order), Some(shape)) =
        (field(header, "descr"), field(header, "fortran_order"), field(header, "shape"))
    else {
        return FORMAT.broken("its header lacks descr, fortran_order or shape");
    };
    let fortran = order.starts_with("True");
    let Some((rows, columns)) = two_numbers(shape) else {
        return FORMAT.broken("it must have two dimensions");
    };
    check_size(rows, columns)?;
    let kind = kind.trim_start_matches(['\'', '"']);
    let kind = kind.split(['\'', '"']).next().unwrap_or_default();
    let data = &rest[start + length..];
    let Some(values) = numbers(kind, data, rows * columns)? else {
        return FORMAT.broken(format!("it ends before its {rows} × {columns} values"));
    };
    let heights = if fortran {
        (0..rows * columns).map(|k| values[k % columns * rows + k / columns]).collect()
    } else {
        values
    };
    Ok(HeightMap { rows, columns, heights })
}

/// What follows `'name':` in the header.
fn field<'a>(header: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = header
        .split_once(&format!("'{name}':"))
        .or_else(|| header.split_once(&format!("\"{name}\":")))?;
    Some(rest.trim_start())
}

/// The two numbers of `(rows, columns)`.
fn two_numbers(shape: &str) -> Option<(usize, usize)> {
    let inside = shape.strip_prefix('(')?.split(')').next()?;
    let numbers: Vec<usize> = inside
        .split(',')
        .map(str::trim)
        .filter(|text| !text.is_empty())
        .map(|text| text.parse().ok())
        .collect::<Option<_>>()?;
    match numbers[..] {
        [rows, columns] => Some((rows, columns)),
        _ => None,
    }
}

/// `count` values of the given type, or none where the data ends before.
fn numbers(kind: &str, data: &[u8], count: usize) -> Result<Option<Vec<f64>>, MillingError> {
    fn read<const N: usize>(
        data: &[u8],
        count: usize,
        value: impl Fn([u8; N]) -> f64,
    ) -> Option<Vec<f64>> {
        let data = data.get(..count.checked_mul(N)?)?;
        Some(data.as_chunks::<N>().0.iter().map(|chunk| value(*chunk)).collect())
    }
    Ok(match kind {
        "<f8" => read(data, count, f64::from_le_bytes),
        ">f8" => read(data, count, f64::from_be_bytes),
        "<f4" => read(data, count, |b| f64::from(f32::from_le_bytes(b))),
        ">f4" => read(data, count, |b| f64::from(f32::from_be_bytes(b))),
        "|u1" | "<u1" | "|b1" => read(data, count, |[b]: [u8; 1]| f64::from(b)),
        "|i1" | "<i1" => read(data, count, |b| f64::from(i8::from_le_bytes(b))),
        "<u2" => read(data, count, |b| f64::from(u16::from_le_bytes(b))),
        ">u2" => read(data, count, |b| f64::from(u16::from_be_bytes(b))),
        "<i2" => read(data, count, |b| f64::from(i16::from_le_bytes(b))),
        ">i2" => read(data, count, |b| f64::from(i16::from_be_bytes(b))),
        "<u4" => read(data, count, |b| f64::from(u32::from_le_bytes(b))),
        "<i4" => read(data, count, |b| f64::from(i32::from_le_bytes(b))),
        "<u8" => read(data, count, |b| u64::from_le_bytes(b) as f64),
        "<i8" => read(data, count, |b| i64::from_le_bytes(b) as f64),
        _ => return FORMAT.broken(format!("its type {kind:?} is not a real number")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }\n";

    #[test]
    fn both_orders_are_read() {
        let values = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0];
        let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let map = read_npy(&npy(HEADER, &data)).unwrap();
        assert_eq!((map.rows, map.columns), (2, 3));
        assert_eq!(map.heights, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let fortran = read_npy(&npy(&HEADER.replace("False", "True"), &data)).unwrap();
        assert_eq!(fortran.heights, [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]);
    }

    #[test]
    fn broken_arrays_are_refused() {
        let fault = |bytes: &[u8]| read_npy(bytes).unwrap_err().to_string();
        assert!(fault(b"PNG").contains("does not begin"));
        assert!(fault(b"\x93NUMPY\x09\x00\x00\x00").contains("version"));
        assert!(fault(b"\x93NUMPY\x01\x00\xff\x00{").contains("within the header"));
        assert!(fault(&npy("{'descr': '<f4'}", &[])).contains("lacks"));
        assert!(fault(&npy(HEADER, &[0; 23])).contains("ends before"));
        assert!(fault(&npy(&HEADER.replace("(2, 3)", "(6,)"), &[0; 24])).contains("dimensions"));
        assert!(fault(&npy(&HEADER.replace("<f4", "<c8"), &[0; 99])).contains("<c8"));
        assert!(matches!(
            read_npy(&npy(&HEADER.replace("(2, 3)", "(99999999, 99999999)"), &[])),
            Err(MillingError::GridSize { .. })
        ));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(data in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = read_npy(&data);
            let _ = read_npy(&npy(HEADER, &data));
        }
    }
}
