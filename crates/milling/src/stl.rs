//! The top surface of solids.

use crate::MillingError;
use crate::error::check_option;
use crate::height_map::{HeightFormat, HeightMap, check_size};

const FORMAT: HeightFormat = HeightFormat::Stl;

/// Corners of a triangle, mm.
type Triangle = [[f64; 3]; 3];

/// Most cells that triangles may cover together, so that a hostile file ends.
const MAX_COVERED: usize = 1 << 31;

/// Reads a solid, mm, and returns the height of its top surface in pixels with the side `pixel_um`,
/// µm; rows run from the largest y down. Pixels beside the solid get its lowest height.
pub(crate) fn read_stl(bytes: &[u8], pixel_um: f64) -> Result<HeightMap, MillingError> {
    let ok = pixel_um > 0.0 && pixel_um <= 1e6;
    check_option("pixel_um", pixel_um, ok, "above 0 and at most 1e6 µm")?;
    let triangles = match binary(bytes) {
        Some(triangles) => triangles,
        None => text(bytes)?,
    };
    if triangles.is_empty() {
        return FORMAT.broken("it has no triangle");
    }
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for corner in triangles.iter().flatten() {
        for axis in 0..3 {
            if corner[axis].is_nan() || corner[axis].abs() > 1e6 {
                return FORMAT.broken("a corner is not within ±1e6 mm");
            }
            low[axis] = low[axis].min(corner[axis]);
            high[axis] = high[axis].max(corner[axis]);
        }
    }
    let pixel_mm = pixel_um * 1e-3;
    let count = |axis: usize| ((high[axis] - low[axis]) / pixel_mm).round().min(1e9) as usize;
    let (rows, columns) = (count(1), count(0));
    check_size(rows, columns)?;
    let mut tops = vec![low[2]; rows * columns];
    let mut covered: usize = 0;
    for triangle in &triangles {
        let place = triangle
            .map(|[x, y, z]| [(x - low[0]) / pixel_mm - 0.5, (high[1] - y) / pixel_mm - 0.5, z]);
        covered += raise(&mut tops, rows, columns, &place);
        if covered > MAX_COVERED {
            return FORMAT.broken("its triangles cover the grid too often");
        }
    }
    let heights = tops.iter().map(|top| (top - low[2]) * 1e3).collect();
    Ok(HeightMap { rows, columns, heights })
}

/// Raises the cells whose centres lie under a triangle, in units of cells; returns how many were
/// looked at.
fn raise(tops: &mut [f64], rows: usize, columns: usize, [a, b, c]: &Triangle) -> usize {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if area.abs() < 1e-12 {
        return 1;
    }
    let range = |axis: usize, count: usize| {
        let (least, most) = (
            a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0),
            a[axis].max(b[axis]).max(c[axis]).floor(),
        );
        let end = if most < 0.0 { 0 } else { (most as usize + 1).min(count) };
        (least as usize).min(end)..end
    };
    let (xs, ys) = (range(0, columns), range(1, rows));
    let looked_at = xs.len() * ys.len() + 1;
    for row in ys {
        for column in xs.clone() {
            let (x, y) = (column as f64, row as f64);
            // Barycentric coordinates; a little slack closes the seams between triangles.
            let u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
            let v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
            if u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 {
                let z = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]);
                let top = &mut tops[row * columns + column];
                *top = top.max(z);
            }
        }
    }
    looked_at
}

/// The triangles of a binary file; none where its length does not fit its count.
fn binary(bytes: &[u8]) -> Option<Vec<Triangle>> {
    let count = u32::from_le_bytes(bytes.get(80..84)?.try_into().ok()?) as usize;
    let data = &bytes[84..];
    if data.len() != count.checked_mul(50)? {
        return None;
    }
    let number = |chunk: &[u8], k: usize| {
        let at = 12 + 4 * k;
        f64::from(f32::from_le_bytes([chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]]))
    };
    Some(
        data.chunks_exact(50)
            .map(|chunk| {
                [0, 1, 2].map(|corner| [0, 1, 2].map(|axis| number(chunk, 3 * corner + axis)))
            })
            .collect(),
    )
}

/// The triangles of a text file.
fn text(bytes: &[u8]) -> Result<Vec<Triangle>, MillingError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return FORMAT.broken("it is neither text nor as long as its count of triangles says");
    };
    if !text.trim_start().starts_with("solid") {
        return FORMAT.broken("it does not begin with \"solid\"");
    }
    let mut corners = Vec::new();
    let mut words = text.split_ascii_whitespace();
    while let Some(word) = words.next() {
        if word == "vertex" {
            let mut corner = [0.0; 3];
            for value in &mut corner {
                let Some(Ok(number)) = words.next().map(str::parse) else {
                    return FORMAT
                        .broken(format!("corner {} has no three numbers", corners.len() + 1));
                };
                *value = number;
            }
            corners.push(corner);
        }
    }
    if corners.len() % 3 != 0 {
        return FORMAT.broken(format!("{} corners are no triangles", corners.len()));
    }
    Ok(corners.as_chunks::<3>().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A wedge: 0 mm high at x = 0, 1 mm high at x = 4 mm, 2 mm long.
    const WEDGE: &str = "solid wedge\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 4 0 1\n\
        vertex 4 2 1\nendloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 4 2 1\n\
        vertex 0 2 0\nendloop\nendfacet\nendsolid\n";

    fn wedge_bytes() -> Vec<u8> {
        let triangles = text(WEDGE.as_bytes()).unwrap();
        let mut bytes = vec![b's'; 80];
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in &triangles {
            bytes.extend([0; 12]);
            for value in triangle.iter().flatten() {
                bytes.extend((*value as f32).to_le_bytes());
            }
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn text_and_binary_give_the_top_surface() {
        for bytes in [WEDGE.as_bytes().to_vec(), wedge_bytes()] {
            let map = read_stl(&bytes, 500.0).unwrap();
            assert_eq!((map.rows, map.columns), (4, 8));
            for (k, height) in map.heights.iter().enumerate() {
                let expected = ((k % 8) as f64 + 0.5) * 125.0;
                assert!((height - expected).abs() < 1e-6, "{k}: {height}");
            }
        }
    }

    #[test]
    fn broken_solids_are_refused() {
        let fault = |bytes: &[u8]| read_stl(bytes, 500.0).unwrap_err().to_string();
        assert!(fault(b"facet").contains("begin with"));
        assert!(fault(b"solid x endsolid").contains("no triangle"));
        assert!(fault(b"solid vertex 1 2 x").contains("corner 1"));
        assert!(fault(b"solid vertex 1 2 3").contains("1 corners"));
        // A binary file that is cut short is as long as no count says.
        let cut = fault(&wedge_bytes()[..120]);
        assert!(cut.contains("begin with") || cut.contains("neither"), "{cut}");
        assert!(fault(WEDGE.replace("4 2 1", "4 2 NaN").as_bytes()).contains("1e6"));
        assert!(matches!(read_stl(WEDGE.as_bytes(), 1e-6), Err(MillingError::GridSize { .. })));
        assert!(matches!(read_stl(WEDGE.as_bytes(), 0.0), Err(MillingError::InvalidOption { .. })));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(
            bytes in prop::collection::vec(any::<u8>(), 0..200), text in "solid( vertex [-0-9e. ]{5,9}){0,6}"
        ) {
            let _ = read_stl(&bytes, 1e5);
            let _ = read_stl(text.as_bytes(), 1e5);
        }
    }
}
