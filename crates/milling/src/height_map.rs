//! Height maps from files, and the depth maps made of them.

use crate::asc_grid::read_asc;
use crate::npy::read_npy;
use crate::png_heights::read_png;
use crate::stl::read_stl;
use crate::tiff_heights::read_tiff;
use crate::{DepthMap, Grid, MillingError};

/// Largest file that is read, bytes.
pub const MAX_HEIGHT_FILE_BYTES: usize = 512 << 20;

/// Kinds of files that hold heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeightFormat {
    /// `.npy`: a two-dimensional `NumPy` array of numbers.
    Npy,
    /// `.asc` or `.dem`: an ESRI ASCII grid. Cells without data count as the lowest.
    Asc,
    /// `.png`: brighter is higher; 8 or 16 bits.
    Png,
    /// `.tif` or `.tiff`: the first image; numbers of 8 to 64 bits as they are, of colours the
    /// brightness.
    Tiff,
    /// `.stl`: the top surface of a solid, mm, z upwards, in text or binary.
    Stl,
}

/// Heights on a grid, row by row from the top; larger is higher.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Heights, in the file's own unit; µm for [`HeightFormat::Stl`].
    pub heights: Vec<f64>,
}

/// What heights become.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HeightScale {
    /// The values are depths already, µm.
    Depths,
    /// The highest place lies `base_um` deep, the lowest `depth_um` deeper.
    HighStays {
        /// Difference in depth, µm, above 0.
        depth_um: f64,
        /// Depth of the highest place, µm, at least 0.
        base_um: f64,
    },
    /// The lowest value lies `base_um` deep, the highest `depth_um` deeper.
    HighSinks {
        /// Difference in depth, µm, above 0.
        depth_um: f64,
        /// Depth of the lowest value, µm, at least 0.
        base_um: f64,
    },
}

impl HeightFormat {
    /// The format of a file by the ending of its name.
    ///
    /// # Errors
    /// [`MillingError::HeightFormat`] lists the endings that are known.
    pub fn of_name(name: &str) -> Result<Self, MillingError> {
        let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending).to_lowercase();
        match ending.as_str() {
            "npy" => Ok(Self::Npy),
            "asc" | "dem" => Ok(Self::Asc),
            "png" => Ok(Self::Png),
            "tif" | "tiff" => Ok(Self::Tiff),
            "stl" => Ok(Self::Stl),
            _ => Err(MillingError::HeightFormat { name: name.to_owned() }),
        }
    }

    /// The name in messages.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Npy => "NPY",
            Self::Asc => "ASC",
            Self::Png => "PNG",
            Self::Tiff => "TIFF",
            Self::Stl => "STL",
        }
    }

    /// An error about a file of this format.
    pub(crate) fn broken<T>(self, reason: impl Into<String>) -> Result<T, MillingError> {
        Err(MillingError::HeightFile { format: self.name(), reason: reason.into() })
    }
}

impl HeightMap {
    /// Reads the heights in `bytes`. `pixel_um` is the side of a pixel, needed where the file holds a
    /// shape and no grid ([`HeightFormat::Stl`]).
    ///
    /// # Errors
    /// [`MillingError::HeightFile`] says what is wrong with the file; [`MillingError::GridSize`] for
    /// one with no or too many cells; [`MillingError::HeightValue`] for a height that is not finite.
    pub fn read(bytes: &[u8], format: HeightFormat, pixel_um: f64) -> Result<Self, MillingError> {
        if bytes.len() > MAX_HEIGHT_FILE_BYTES {
            return format.broken(format!("{} bytes are more than 512 MB", bytes.len()));
        }
        let map = match format {
            HeightFormat::Npy => read_npy(bytes)?,
            HeightFormat::Asc => read_asc(bytes)?,
            HeightFormat::Png => read_png(bytes)?,
            HeightFormat::Tiff => read_tiff(bytes)?,
            HeightFormat::Stl => read_stl(bytes, pixel_um)?,
        };
        match map.heights.iter().position(|height| !height.is_finite()) {
            None => Ok(map),
            Some(k) => Err(MillingError::HeightValue {
                row: k / map.columns,
                column: k % map.columns,
                value: map.heights[k],
            }),
        }
    }

    /// The depth map with these heights, of pixels with the side `pixel_um`.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for a scale out of range, [`MillingError::EmptyTarget`] for
    /// heights without differences, and as [`DepthMap::new`].
    pub fn to_depths(&self, scale: HeightScale, pixel_um: f64) -> Result<DepthMap, MillingError> {
        let low = self.heights.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let scaled = |depth_um: f64, base_um: f64, from: f64| {
            let check = crate::error::check_option;
            let ok = depth_um > 0.0 && depth_um <= 1e6;
            check("depth_um", depth_um, ok, "above 0 and at most 1e6 µm")?;
            check("base_um", base_um, (0.0..=1e6).contains(&base_um), "in [0, 1e6] µm")?;
            let per_height = depth_um / (high - low);
            if !per_height.is_finite() {
                return Err(MillingError::EmptyTarget);
            }
            Ok(self
                .heights
                .iter()
                .map(|height| base_um + (height - from).abs() * per_height)
                .collect())
        };
        let depths = match scale {
            HeightScale::Depths => self.heights.clone(),
            HeightScale::HighStays { depth_um, base_um } => scaled(depth_um, base_um, high)?,
            HeightScale::HighSinks { depth_um, base_um } => scaled(depth_um, base_um, low)?,
        };
        DepthMap::new(self.rows, self.columns, pixel_um, depths)
    }
}

/// Refuses sizes of which no grid can be.
pub(crate) fn check_size(rows: usize, columns: usize) -> Result<(), MillingError> {
    Grid::new(rows, columns, 1.0).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_become_depths() {
        let map = HeightMap { rows: 1, columns: 3, heights: vec![-1.0, 1.0, 3.0] };
        let depths = |scale| map.to_depths(scale, 2.0).map(|map| map.depth_um().to_vec());
        let stays = HeightScale::HighStays { depth_um: 20.0, base_um: 5.0 };
        assert_eq!(depths(stays), Ok(vec![25.0, 15.0, 5.0]));
        let sinks = HeightScale::HighSinks { depth_um: 20.0, base_um: 0.0 };
        assert_eq!(depths(sinks), Ok(vec![0.0, 10.0, 20.0]));
        assert!(matches!(depths(HeightScale::Depths), Err(MillingError::TargetValue { .. })));
        let flat = HeightMap { rows: 1, columns: 1, heights: vec![1.0] };
        assert_eq!(flat.to_depths(stays, 2.0), Err(MillingError::EmptyTarget));
        let bad = HeightScale::HighSinks { depth_um: 0.0, base_um: 0.0 };
        assert!(matches!(depths(bad), Err(MillingError::InvalidOption { name: "depth_um", .. })));
    }

    #[test]
    fn formats_are_known_by_their_endings() {
        assert_eq!(HeightFormat::of_name("a/b.NPY"), Ok(HeightFormat::Npy));
        assert_eq!(HeightFormat::of_name("scan.TIF"), Ok(HeightFormat::Tiff));
        assert_eq!(HeightFormat::of_name("part.stl"), Ok(HeightFormat::Stl));
        let error = HeightFormat::of_name("relief.bmp").unwrap_err().to_string();
        assert!(error.contains("relief.bmp") && error.contains(".npy"), "{error}");
    }
}
