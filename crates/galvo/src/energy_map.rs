//! How many pulses hit each place, as numbers and as a picture.

use lasergym_geom::{Picture, Point};

use crate::GalvoError;
use crate::error::check_option;

/// Most cells of a map.
pub const MAX_MAP_CELLS: usize = 16_000_000;

/// Energy on a grid of square cells: each pulse gives every place within its crater 1.
#[derive(Debug, Clone, PartialEq)]
pub struct EnergyMap {
    low_um: Point,
    cell_um: f64,
    columns: usize,
    rows: usize,
    spot_um: f64,
    energy: Vec<f32>,
}

impl EnergyMap {
    /// An empty map from `low_um` (lower left corner) to `high_um`, of cells of `cell_um`, for craters
    /// of `spot_um`.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] when a length is not usable or the map would have more than
    /// [`MAX_MAP_CELLS`] cells.
    pub fn new(
        low_um: Point,
        high_um: Point,
        cell_um: f64,
        spot_um: f64,
    ) -> Result<Self, GalvoError> {
        check_option("cell_um", cell_um, (1e-3..=1e6).contains(&cell_um), "in [1e-3, 1e6] µm")?;
        check_option("spot_um", spot_um, (0.0..=1e3).contains(&spot_um), "in [0, 1000] µm")?;
        let size = high_um - low_um;
        let (columns, rows) = ((size.x / cell_um).ceil(), (size.y / cell_um).ceil());
        let cells = columns * rows;
        let ok = columns >= 1.0 && rows >= 1.0 && cells <= MAX_MAP_CELLS as f64;
        check_option("cells", cells, ok, "from 1 to 16 000 000: use larger cells")?;
        let (columns, rows) = (columns as usize, rows as usize);
        Ok(Self { low_um, cell_um, columns, rows, spot_um, energy: vec![0.0; columns * rows] })
    }

    /// Adds a pulse at `position`, µm.
    pub fn add(&mut self, position: Point) {
        let reach = 0.5 * self.spot_um / self.cell_um;
        let place = (position - self.low_um) * self.cell_um.recip();
        let range = |at: f64, count: usize| {
            let first = (at - reach - 0.5).ceil().max(0.0);
            let last = (at + reach - 0.5).floor().min(count as f64 - 1.0);
            (first, last)
        };
        let ((left, right), (bottom, top)) =
            (range(place.x, self.columns), range(place.y, self.rows));
        let mut row = bottom;
        while row <= top {
            let mut column = left;
            while column <= right {
                let (dx, dy) = (column + 0.5 - place.x, row + 0.5 - place.y);
                if dx * dx + dy * dy <= reach * reach {
                    self.energy[row as usize * self.columns + column as usize] += 1.0;
                }
                column += 1.0;
            }
            row += 1.0;
        }
    }

    /// (rows, columns).
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        (self.rows, self.columns)
    }

    /// Pulses on each cell, row by row from the lowest y, shape (rows, columns).
    #[must_use]
    pub fn energy(&self) -> &[f32] {
        &self.energy
    }

    /// The map as a picture, y up: black where nothing hits, over red and yellow to white at the most.
    #[must_use]
    pub fn picture(&self) -> Picture {
        let most = self.energy.iter().copied().fold(1.0_f32, f32::max);
        let mut rgba = Vec::with_capacity(4 * self.energy.len());
        for row in self.energy.chunks_exact(self.columns.max(1)).rev() {
            for &energy in row {
                let level = (energy / most).sqrt();
                let channel = |from: f32| ((level - from) * 3.0).clamp(0.0, 1.0) * 255.0;
                rgba.extend([
                    channel(0.0).round() as u8,
                    channel(1.0 / 3.0).round() as u8,
                    channel(2.0 / 3.0).round() as u8,
                    255,
                ]);
            }
        }
        Picture { width_px: self.columns as u32, height_px: self.rows as u32, rgba }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_covers_its_crater() {
        let mut map = EnergyMap::new(Point::default(), Point::new(100.0, 60.0), 1.0, 40.0).unwrap();
        map.add(Point::new(50.0, 30.0));
        let area: f32 = map.energy().iter().sum();
        assert!((f64::from(area) / (std::f64::consts::PI * 400.0) - 1.0).abs() < 0.02, "{area}");
        map.add(Point::new(-1e9, 0.0));
        assert_eq!(map.picture().rgba.len(), 4 * 100 * 60);
    }

    #[test]
    fn a_map_too_large_is_refused() {
        let (low, high) = (Point::default(), Point::new(1e6, 1e6));
        assert!(EnergyMap::new(low, high, 1.0, 40.0).is_err());
        assert!(EnergyMap::new(low, low, 1.0, 40.0).is_err());
        assert!(EnergyMap::new(low, high, f64::NAN, 40.0).is_err());
    }
}
