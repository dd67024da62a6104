//! A position on the workpiece.

use std::ops::{Add, Mul, Sub};

/// A position or displacement on the workpiece, px; x right, y down.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Point {
    /// Distance from the left edge, px.
    pub x: f64,
    /// Distance from the top edge, px.
    pub y: f64,
}

impl Point {
    /// The point at `(x, y)`, px.
    #[must_use]
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// Length of the vector from the origin, px.
    #[must_use]
    pub fn length(self) -> f64 {
        self.x.hypot(self.y)
    }

    /// Distance to `other`, px.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        (self - other).length()
    }

    /// The vector of length 1 in the same direction, or zero for the zero vector.
    #[must_use]
    pub fn normalized(self) -> Self {
        let length = self.length();
        if length > 0.0 { self * length.recip() } else { Self::default() }
    }

    /// The point turned about `center` by `angle_rad`; positive angles turn x towards y
    /// (clockwise on the screen, since y points down).
    #[must_use]
    pub fn rotated_about(self, center: Self, angle_rad: f64) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        let arm = self - center;
        center + Self::new(cos * arm.x - sin * arm.y, sin * arm.x + cos * arm.y)
    }
}

impl Add for Point {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y)
    }
}

impl Sub for Point {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y)
    }
}

impl Mul<f64> for Point {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor)
    }
}
