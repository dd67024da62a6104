//! Where the beam goes on the workpiece: straight and round pieces, end to end.

use std::f64::consts::{PI, TAU};

use lasergym_geom::Point;

/// Ends of pieces closer than this meet, mm.
pub(crate) const MEETING_MM: f64 = 1e-6;

/// Largest coordinate, mm: 100 m.
pub const MAX_COORDINATE_MM: f64 = 1e5;

/// Most pieces of a path.
pub const MAX_PIECES: usize = 200_000;

/// A straight or round piece of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathPiece {
    /// Straight from one point to another, mm.
    Line {
        /// Where it begins, mm.
        from: Point,
        /// Where it ends, mm.
        to: Point,
    },
    /// A part of a circle.
    Arc {
        /// Centre, mm.
        center: Point,
        /// Radius, mm, above 0.
        radius_mm: f64,
        /// Angle of its start, from x towards y, rad.
        start_rad: f64,
        /// Angle that it covers, from x towards y where positive, rad, within ±2π.
        sweep_rad: f64,
    },
}

impl PathPiece {
    /// Its length, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        match *self {
            Self::Line { from, to } => from.distance(to),
            Self::Arc { radius_mm, sweep_rad, .. } => radius_mm * sweep_rad.abs(),
        }
    }

    /// The point at a part of the piece, from 0 to 1.
    #[must_use]
    pub fn at(&self, part: f64) -> Point {
        match *self {
            Self::Line { from, to } => from + (to - from) * part,
            Self::Arc { center, radius_mm, start_rad, sweep_rad } => {
                center + unit(start_rad + part * sweep_rad) * radius_mm
            }
        }
    }

    /// The piece between two parts of it.
    #[must_use]
    pub fn between(&self, first: f64, last: f64) -> Self {
        match *self {
            Self::Line { .. } => Self::Line { from: self.at(first), to: self.at(last) },
            Self::Arc { center, radius_mm, start_rad, sweep_rad } => Self::Arc {
                center,
                radius_mm,
                start_rad: start_rad + first * sweep_rad,
                sweep_rad: (last - first) * sweep_rad,
            },
        }
    }

    /// Unit vector along the piece at its start or end; zero for a piece without length.
    pub(crate) fn heading(&self, at_end: bool) -> Point {
        match *self {
            Self::Line { from, to } => (to - from).normalized(),
            Self::Arc { start_rad, sweep_rad, .. } => {
                let angle = if at_end { start_rad + sweep_rad } else { start_rad };
                unit(angle + 0.5 * PI * sweep_rad.signum())
            }
        }
    }

    /// Largest distance from `place` to a point of the piece, mm.
    pub(crate) fn farthest_mm(&self, place: Point) -> f64 {
        let ends = place.distance(self.at(0.0)).max(place.distance(self.at(1.0)));
        match *self {
            Self::Line { .. } => ends,
            Self::Arc { center, radius_mm, start_rad, sweep_rad } => {
                let away = center - place;
                let angle = away.y.atan2(away.x);
                let from_start =
                    if sweep_rad >= 0.0 { angle - start_rad } else { start_rad - angle };
                let covered = from_start.rem_euclid(TAU) <= sweep_rad.abs();
                let far = away.length() + radius_mm;
                if covered || away.length() == 0.0 { far.max(ends) } else { ends }
            }
        }
    }

    fn is_finite(&self) -> bool {
        let near = |p: Point| p.x.abs() <= MAX_COORDINATE_MM && p.y.abs() <= MAX_COORDINATE_MM;
        match *self {
            Self::Line { from, to } => near(from) && near(to),
            Self::Arc { center, radius_mm, start_rad, sweep_rad } => {
                near(center)
                    && radius_mm > 0.0
                    && radius_mm <= MAX_COORDINATE_MM
                    && start_rad.abs() <= 1e6
                    && sweep_rad.abs() <= TAU + 1e-9
            }
        }
    }
}

/// The path of the beam for one exposure, end to end.
#[derive(Debug, Clone, PartialEq)]
pub struct BeamPath {
    pieces: Vec<PathPiece>,
    length_mm: f64,
}

impl BeamPath {
    /// A path of pieces that follow each other.
    ///
    /// # Errors
    /// What is wrong, as the end of a sentence: no piece, too many, a value that is not finite or
    /// beyond 100 m, or a gap.
    pub fn new(pieces: Vec<PathPiece>) -> Result<Self, String> {
        if pieces.is_empty() {
            return Err("has no piece: give at least one".to_owned());
        }
        if pieces.len() > MAX_PIECES {
            return Err(format!("has {} pieces: give at most {MAX_PIECES}", pieces.len()));
        }
        if let Some(at) = pieces.iter().position(|piece| !piece.is_finite()) {
            return Err(format!(
                "has a value out of range in piece {at}: coordinates must be finite and within 100 m, radii \
                 above 0 and sweeps within 360°"
            ));
        }
        let gap = pieces.windows(2).position(|pair| {
            pair[0].at(1.0).distance(pair[1].at(0.0)) > MEETING_MM.max(1e-9 * MAX_COORDINATE_MM)
        });
        if let Some(at) = gap {
            return Err(format!("has a gap after piece {at}: pieces must follow each other"));
        }
        let length_mm = pieces.iter().map(PathPiece::length_mm).sum();
        Ok(Self { pieces, length_mm })
    }

    /// A whole circle, counterclockwise from the angle 0.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn circle(center: Point, radius_mm: f64) -> Result<Self, String> {
        Self::new(vec![PathPiece::Arc { center, radius_mm, start_rad: 0.0, sweep_rad: TAU }])
    }

    /// A straight line; of length 0 it is a spot.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn line(from: Point, to: Point) -> Result<Self, String> {
        Self::new(vec![PathPiece::Line { from, to }])
    }

    /// Straight pieces through `points`; points that coincide with the one before are left out.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn polyline(points: &[Point]) -> Result<Self, String> {
        let mut pieces: Vec<PathPiece> = points
            .windows(2)
            .filter(|pair| pair[0] != pair[1])
            .map(|pair| PathPiece::Line { from: pair[0], to: pair[1] })
            .collect();
        if let (true, Some(&spot)) = (pieces.is_empty(), points.first()) {
            pieces.push(PathPiece::Line { from: spot, to: spot });
        }
        Self::new(pieces)
    }

    /// The pieces in order.
    #[must_use]
    pub fn pieces(&self) -> &[PathPiece] {
        &self.pieces
    }

    /// Length of one exposure, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Where it begins, mm.
    #[must_use]
    pub fn start(&self) -> Point {
        self.pieces[0].at(0.0)
    }

    /// Where it ends, mm.
    #[must_use]
    pub fn end(&self) -> Point {
        self.pieces[self.pieces.len() - 1].at(1.0)
    }

    /// Whether it ends where it begins.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.length_mm > 0.0 && self.start().distance(self.end()) <= 1e-4
    }

    /// The part of the path between two distances from its start, mm.
    #[must_use]
    pub fn between(&self, first_mm: f64, last_mm: f64) -> Self {
        let mut pieces = Vec::new();
        let mut begin_mm = 0.0;
        for piece in &self.pieces {
            let length_mm = piece.length_mm();
            let end_mm = begin_mm + length_mm;
            if length_mm > 0.0 && end_mm > first_mm && begin_mm < last_mm {
                let part = |mm: f64| ((mm - begin_mm) / length_mm).clamp(0.0, 1.0);
                pieces.push(piece.between(part(first_mm), part(last_mm)));
            }
            begin_mm = end_mm;
        }
        if pieces.is_empty() {
            let spot = self.start();
            pieces.push(PathPiece::Line { from: spot, to: spot });
        }
        let length_mm = pieces.iter().map(PathPiece::length_mm).sum();
        Self { pieces, length_mm }
    }
}

/// The unit vector of an angle, rad.
pub(crate) fn unit(angle_rad: f64) -> Point {
    let (sin, cos) = angle_rad.sin_cos();
    Point::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_point_of_a_piece_is_farther_than_its_farthest(
            x in -9.0..9.0, y in -9.0..9.0, radius_mm in 0.1..9.0,
            start_rad in -7.0..7.0, sweep_rad in -TAU..TAU,
        ) {
            let piece = PathPiece::Arc { center: Point::new(1.0, 2.0), radius_mm, start_rad, sweep_rad };
            let place = Point::new(x, y);
            let sampled = (0..=2000)
                .map(|k| place.distance(piece.at(f64::from(k) / 2000.0)))
                .fold(0.0, f64::max);
            let farthest = piece.farthest_mm(place);
            prop_assert!(farthest >= sampled - 1e-9 && farthest <= sampled + 1e-3, "{farthest} {sampled}");
        }

        #[test]
        fn parts_of_a_path_add_up(cut in 0.0..1.0) {
            let corner = Point::new(3.0, 0.0);
            let path = BeamPath::new(vec![
                PathPiece::Line { from: Point::new(0.0, 0.0), to: corner },
                PathPiece::Arc { center: Point::new(3.0, 2.0), radius_mm: 2.0, start_rad: -0.5 * PI, sweep_rad: PI },
            ]).unwrap();
            let cut_mm = cut * path.length_mm();
            let (first, last) = (path.between(0.0, cut_mm), path.between(cut_mm, path.length_mm()));
            prop_assert!((first.length_mm() + last.length_mm() - path.length_mm()).abs() < 1e-9);
            prop_assert!(first.end().distance(last.start()) < 1e-9);
            prop_assert!(last.end().distance(path.end()) < 1e-9);
        }
    }

    #[test]
    fn what_is_no_path_is_refused() {
        let point = |x: f64| Point::new(x, 0.0);
        assert!(BeamPath::new(Vec::new()).unwrap_err().contains("no piece"));
        assert!(BeamPath::polyline(&[]).unwrap_err().contains("no piece"));
        assert!(BeamPath::circle(point(0.0), 0.0).unwrap_err().contains("radii"));
        assert!(BeamPath::circle(point(f64::NAN), 1.0).unwrap_err().contains("finite"));
        let apart = vec![
            PathPiece::Line { from: point(0.0), to: point(1.0) },
            PathPiece::Line { from: point(2.0), to: point(3.0) },
        ];
        assert!(BeamPath::new(apart).unwrap_err().contains("gap after piece 0"));
    }

    #[test]
    fn a_spot_is_a_path_without_length() {
        let spot = BeamPath::polyline(&[Point::new(1.0, 1.0), Point::new(1.0, 1.0)]).unwrap();
        assert!(spot.length_mm() == 0.0 && !spot.is_closed());
    }
}
