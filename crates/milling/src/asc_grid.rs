//! ESRI ASCII grids as height maps.

use crate::MillingError;
use crate::height_map::{HeightFormat, HeightMap, check_size};

const FORMAT: HeightFormat = HeightFormat::Asc;

/// Reads a grid: `ncols`, `nrows` and, where present, corner, `cellsize` and `NODATA_value`, then the
/// heights row by row from the north. Corner and cell size are not used: the size of a pixel on the
/// workpiece is another one. Cells without data get the lowest height.
pub(crate) fn read_asc(bytes: &[u8]) -> Result<HeightMap, MillingError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return FORMAT.broken("it is no text");
    };
    let mut words = text.split_ascii_whitespace().peekable();
    let (mut rows, mut columns, mut no_data) = (None, None, None);
    while let Some(word) = words.next_if(|word| word.starts_with(|c: char| c.is_ascii_alphabetic()))
    {
        let name = word.to_ascii_lowercase();
        let Some(value) = words.next() else {
            return FORMAT.broken(format!("{name} has no value"));
        };
        let Ok(number) = value.parse::<f64>() else {
            return FORMAT.broken(format!("{name} is {value:?}, which is no number"));
        };
        match name.as_str() {
            "ncols" => columns = value.parse::<usize>().ok(),
            "nrows" => rows = value.parse::<usize>().ok(),
            "nodata_value" => no_data = Some(number),
            "xllcorner" | "yllcorner" | "xllcenter" | "yllcenter" | "cellsize" | "dx" | "dy" => {}
            _ => return FORMAT.broken(format!("the header has {name:?}, which is not known")),
        }
    }
    let (Some(rows), Some(columns)) = (rows, columns) else {
        return FORMAT.broken("its header lacks ncols or nrows as whole numbers");
    };
    check_size(rows, columns)?;
    // No more room than the text can fill.
    let mut heights = Vec::with_capacity((rows * columns).min(bytes.len()));
    for word in words {
        let Ok(height) = word.parse::<f64>() else {
            return FORMAT.broken(format!("height {} is {word:?}", heights.len() + 1));
        };
        heights.push(height);
    }
    if heights.len() != rows * columns {
        let found = heights.len();
        return FORMAT.broken(format!("it has {found} heights instead of {rows} × {columns}"));
    }
    if let Some(no_data) = no_data {
        let missing = |height: f64| height.total_cmp(&no_data).is_eq();
        let known = heights.iter().copied().filter(|height| !missing(*height));
        let low = known.fold(f64::INFINITY, f64::min);
        heights.iter_mut().filter(|height| missing(**height)).for_each(|height| *height = low);
    }
    Ok(HeightMap { rows, columns, heights })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GRID: &str = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 30\nNODATA_value -9999\n1 2 -9999\n4 5 6\n";

    #[test]
    fn a_grid_is_read_and_gaps_are_lowest() {
        let map = read_asc(GRID.as_bytes()).unwrap();
        assert_eq!((map.rows, map.columns), (2, 3));
        assert_eq!(map.heights, [1.0, 2.0, 1.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn broken_grids_are_refused() {
        let fault = |from: &str, to: &str| {
            let text = GRID.replace(from, to);
            assert_ne!(text, GRID);
            read_asc(text.as_bytes()).unwrap_err().to_string()
        };
        assert!(fault("ncols 3", "").contains("lacks ncols"));
        assert!(fault("ncols 3", "ncols -3").contains("lacks ncols"));
        assert!(fault("4 5 6", "4 5").contains("5 heights"));
        assert!(fault("5", "five").contains("\"five\""));
        assert!(fault("cellsize", "cellsise").contains("cellsise"));
        assert!(fault("nrows 2", "nrows 999999999").contains("999999999"));
        assert!(read_asc(&[0xff, 0xfe]).unwrap_err().to_string().contains("no text"));
        assert!(read_asc(b"ncols").unwrap_err().to_string().contains("no value"));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(ncols 2\nnrows 1\n)?[-0-9e. \nA-z]{0,60}") {
            let _ = read_asc(text.as_bytes());
        }
    }
}
