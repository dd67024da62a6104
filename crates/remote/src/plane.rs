//! Planes in space: a workpiece of 2.5 dimensions has several.

use lasergym_geom::Point;

use crate::RemoteError;
use crate::error::check_option;

/// A plane of the workpiece with its coordinates, in the frame of the robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plane {
    /// What it is called.
    pub name: String,
    /// Its origin x, y, z, mm.
    pub origin_mm: [f64; 3],
    /// Its turn: A about z, then B about the new y, then C about the new x, °, as KUKA counts.
    pub abc_deg: [f64; 3],
}

impl Plane {
    /// Checks that every value is finite and the origin within 100 m.
    ///
    /// # Errors
    /// [`RemoteError::InvalidOption`].
    pub fn validate(&self) -> Result<(), RemoteError> {
        for value in self.origin_mm {
            let name = format!("origin_mm of plane {}", self.name);
            check_option(name, value, value.abs() <= 1e5, "within 100000 mm")?;
        }
        for value in self.abc_deg {
            let name = format!("abc_deg of plane {}", self.name);
            check_option(name, value, value.abs() <= 360.0, "within ±360°")?;
        }
        Ok(())
    }

    /// Rows of its rotation matrix Rz(A) Ry(B) Rx(C).
    #[must_use]
    pub fn rotation(&self) -> [[f64; 3]; 3] {
        let [(sa, ca), (sb, cb), (sc, cc)] = self.abc_deg.map(|angle| angle.to_radians().sin_cos());
        [
            [ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc],
            [sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc],
            [-sb, cb * sc, cb * cc],
        ]
    }

    /// The place in space of a point of the plane, mm.
    #[must_use]
    pub fn to_space(&self, point: Point) -> [f64; 3] {
        self.frame().to_space(point)
    }

    /// Its origin and rotation, for many points.
    pub(crate) fn frame(&self) -> PlaneFrame {
        PlaneFrame { origin_mm: self.origin_mm, rotation: self.rotation() }
    }
}

/// A plane with its rotation worked out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlaneFrame {
    origin_mm: [f64; 3],
    rotation: [[f64; 3]; 3],
}

impl PlaneFrame {
    /// The place in space of a point of the plane, mm.
    pub(crate) fn to_space(self, point: Point) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let row = self.rotation[axis];
            self.origin_mm[axis] + row[0] * point.x + row[1] * point.y
        })
    }

    /// A place in space as a point of the plane and its height above it, mm.
    pub(crate) fn to_plane(self, place_mm: [f64; 3]) -> (Point, f64) {
        let away = [0, 1, 2].map(|axis| place_mm[axis] - self.origin_mm[axis]);
        let along = |column: usize| {
            let product = |axis: usize| self.rotation[axis][column] * away[axis];
            product(0) + product(1) + product(2)
        };
        (Point::new(along(0), along(1)), along(2))
    }
}

/// Distance between two places, mm.
pub(crate) fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn planes_keep_distances(
            abc_deg in proptest::array::uniform3(-360.0..360.0),
            ends in proptest::array::uniform4(-500.0..500.0),
        ) {
            let plane = Plane { abc_deg, origin_mm: [1.0, 2.0, 3.0], ..Plane::default() };
            let (a, b) = (Point::new(ends[0], ends[1]), Point::new(ends[2], ends[3]));
            let apart = distance_mm(plane.to_space(a), plane.to_space(b));
            prop_assert!((apart - a.distance(b)).abs() < 1e-9);
            let (back, height_mm) = plane.frame().to_plane(plane.to_space(a));
            prop_assert!(back.distance(a) < 1e-9 && height_mm.abs() < 1e-9);
        }
    }

    #[test]
    fn the_turn_about_z_comes_first() {
        let plane = Plane { abc_deg: [90.0, 0.0, 90.0], ..Plane::default() };
        let place = plane.to_space(Point::new(2.0, 5.0));
        for (found, expected) in place.iter().zip([0.0, 2.0, 5.0]) {
            assert!((found - expected).abs() < 1e-12, "{place:?}");
        }
    }
}
