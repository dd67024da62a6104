//! Measures how far the beam is from a seam, and how much of the seam it has been over.

use lasergym_geom::Point;

use crate::{BeamPath, PathPiece};

/// Pieces to both sides of the last nearest one that are looked at first.
const NEIGHBOURS: usize = 3;

/// Beyond this distance all pieces are looked at, mm.
const LOST_MM: f64 = 0.02;

/// Most parts of a seam whose exposures are counted.
const MOST_BINS: f64 = 64.0;

/// A seam on which the beam is followed.
#[derive(Debug)]
pub(crate) struct SeamGauge {
    pieces: Vec<PathPiece>,
    begins_mm: Vec<f64>,
    last: usize,
    /// Length of beam that went over each of equal parts of the seam, mm.
    covered_mm: Vec<f64>,
    length_mm: f64,
}

impl SeamGauge {
    /// A gauge for beams that move about `step_mm` between looks.
    pub(crate) fn new(path: &BeamPath, step_mm: f64) -> Self {
        let mut begins_mm = Vec::with_capacity(path.pieces().len());
        let mut length_mm = 0.0;
        for piece in path.pieces() {
            begins_mm.push(length_mm);
            length_mm += piece.length_mm();
        }
        let bins = (length_mm / (50.0 * step_mm)).clamp(1.0, MOST_BINS) as usize;
        Self {
            pieces: path.pieces().to_vec(),
            begins_mm,
            last: 0,
            covered_mm: vec![0.0; bins],
            length_mm,
        }
    }

    /// Distance of `point` from the seam, mm; `way_mm` of beam are counted there.
    pub(crate) fn look(&mut self, point: Point, way_mm: f64) -> f64 {
        let count = self.pieces.len();
        let mut best = (f64::INFINITY, 0, 0.0);
        let near = (2 * NEIGHBOURS + 1).min(count);
        for step in 0..near {
            let index = (self.last + count + step - near / 2) % count;
            best = self.nearer(best, index, point);
        }
        if best.0 > LOST_MM {
            for index in 0..count {
                best = self.nearer(best, index, point);
            }
        }
        self.last = best.1;
        if self.length_mm > 0.0 {
            let bins = self.covered_mm.len();
            let bin = (best.2 / self.length_mm * bins as f64) as usize;
            self.covered_mm[bin.min(bins - 1)] += way_mm;
        }
        best.0
    }

    /// How often the least exposed part of the seam was exposed.
    pub(crate) fn least_exposures(&self) -> f64 {
        let part_mm = self.length_mm / self.covered_mm.len() as f64;
        self.covered_mm.iter().copied().fold(f64::INFINITY, f64::min) / part_mm
    }

    fn nearer(&self, best: (f64, usize, f64), index: usize, point: Point) -> (f64, usize, f64) {
        let (distance_mm, along_mm) = nearest(&self.pieces[index], point);
        if distance_mm < best.0 {
            (distance_mm, index, self.begins_mm[index] + along_mm)
        } else {
            best
        }
    }
}

/// Distance of `point` from a piece, and how far along the piece the nearest place is, mm.
fn nearest(piece: &PathPiece, point: Point) -> (f64, f64) {
    match *piece {
        PathPiece::Line { from, to } => {
            let (along, arm) = (to - from, point - from);
            let length = along.length();
            if length == 0.0 {
                return (arm.length(), 0.0);
            }
            let way = ((arm.x * along.x + arm.y * along.y) / length).clamp(0.0, length);
            (point.distance(from + along * (way / length)), way)
        }
        PathPiece::Arc { center, radius_mm, start_rad, sweep_rad } => {
            let arm = point - center;
            let turned = arm.y.atan2(arm.x) - start_rad;
            let turn = std::f64::consts::TAU;
            let way =
                if sweep_rad >= 0.0 { turned.rem_euclid(turn) } else { (-turned).rem_euclid(turn) };
            if way <= sweep_rad.abs() {
                ((arm.length() - radius_mm).abs(), way * radius_mm)
            } else {
                let ends = [point.distance(piece.at(0.0)), point.distance(piece.at(1.0))];
                if ends[0] <= ends[1] {
                    (ends[0], 0.0)
                } else {
                    (ends[1], sweep_rad.abs() * radius_mm)
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_place_is_the_nearest(
            x in -9.0..9.0, y in -9.0..9.0, start_rad in -7.0..7.0, sweep_rad in -6.2..6.2,
        ) {
            let point = Point::new(x, y);
            for piece in [
                PathPiece::Arc { center: Point::new(1.0, 0.0), radius_mm: 4.0, start_rad, sweep_rad },
                PathPiece::Line { from: Point::new(start_rad, 1.0), to: Point::new(2.0, sweep_rad) },
            ] {
                let sampled = (0..=4000)
                    .map(|k| point.distance(piece.at(f64::from(k) / 4000.0)))
                    .fold(f64::INFINITY, f64::min);
                let (distance, along) = nearest(&piece, point);
                prop_assert!(distance <= sampled + 1e-9 && distance > sampled - 1e-2);
                let part = along / piece.length_mm().max(f64::MIN_POSITIVE);
                prop_assert!((point.distance(piece.at(part)) - distance).abs() < 1e-6);
            }
        }
    }
}
