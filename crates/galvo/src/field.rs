//! The field of a head, and what its correction leaves of the distortion.

use lasergym_geom::Point;

use crate::GalvoError;
use crate::error::check_option;

/// Side and distortion of a square field centred at (0, 0).
///
/// A position (x, y) that the mirrors are told lands at
/// x (1 + a y² + c r²), y (1 + b x² + c r²) with r² = x² + y²: the pillow of two mirrors one behind
/// the other (a, b) and the barrel of a lens (c).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Side of the field, mm, in [0.1, 10 000]. Default 35, that of Penchev et al.
    pub size_mm: f64,
    /// a, 1/mm². Default 0.
    pub pillow_x_per_mm2: f64,
    /// b, 1/mm². Default 0.
    pub pillow_y_per_mm2: f64,
    /// c, 1/mm². Default 0.
    pub barrel_per_mm2: f64,
}

impl Default for Field {
    fn default() -> Self {
        Self { size_mm: 35.0, pillow_x_per_mm2: 0.0, pillow_y_per_mm2: 0.0, barrel_per_mm2: 0.0 }
    }
}

impl Field {
    /// Accepts a side from 0.1 to 10 000 mm and coefficients that displace no corner by more than a
    /// tenth of the way to the centre.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let size = self.size_mm;
        check_option("size_mm", size, (0.1..=1e4).contains(&size), "in [0.1, 10000] mm")?;
        let limit = 0.1 / (0.5 * size).powi(2) / 2.0;
        for (name, value) in [
            ("pillow_x_per_mm2", self.pillow_x_per_mm2),
            ("pillow_y_per_mm2", self.pillow_y_per_mm2),
            ("barrel_per_mm2", self.barrel_per_mm2),
        ] {
            let expected = "small enough to move a corner by less than a tenth";
            check_option(name, value, value.abs() <= limit, expected)?;
        }
        Ok(())
    }

    /// Whether every position lands where it was told.
    #[must_use]
    pub fn is_straight(&self) -> bool {
        let coefficients = [self.pillow_x_per_mm2, self.pillow_y_per_mm2, self.barrel_per_mm2];
        coefficients.iter().all(|coefficient| coefficient.abs() <= 0.0)
    }

    /// Half the side, µm.
    #[must_use]
    pub fn half_um(&self) -> f64 {
        500.0 * self.size_mm
    }

    /// Whether the mirrors can be told `position`, µm.
    #[must_use]
    pub fn contains(&self, position: Point) -> bool {
        let half_um = self.half_um();
        position.x.abs() <= half_um && position.y.abs() <= half_um
    }

    /// Where a position lands, µm.
    #[must_use]
    pub fn landing(&self, told: Point) -> Point {
        if self.is_straight() {
            return told;
        }
        let (x2, y2) = (told.x * told.x * 1e-6, told.y * told.y * 1e-6);
        let barrel = self.barrel_per_mm2 * (x2 + y2);
        Point::new(
            told.x * (1.0 + self.pillow_x_per_mm2 * y2 + barrel),
            told.y * (1.0 + self.pillow_y_per_mm2 * x2 + barrel),
        )
    }

    /// What the mirrors must be told so that the beam lands at `position`, µm, to 10⁻⁶ µm.
    #[must_use]
    pub fn telling(&self, position: Point) -> Point {
        let mut told = position;
        if self.is_straight() {
            return told;
        }
        // The distortion is a small part of the way, so that repeating its removal converges.
        for _ in 0..60 {
            let error = self.landing(told) - position;
            told = told - error;
            if error.length() < 1e-9 {
                break;
            }
        }
        told
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_told_lands_where_it_should(
            x in -17_500.0..17_500.0_f64, y in -17_500.0..17_500.0_f64,
            a in -1.0..1.0_f64, b in -1.0..1.0_f64, c in -1.0..1.0_f64,
        ) {
            let limit = 0.05 / 17.5_f64.powi(2);
            let field = Field {
                pillow_x_per_mm2: a * limit,
                pillow_y_per_mm2: b * limit,
                barrel_per_mm2: c * limit,
                ..Field::default()
            };
            field.validate().unwrap();
            let position = Point::new(x, y);
            let landed = field.landing(field.telling(position));
            prop_assert!(landed.distance(position) < 1e-6);
        }
    }

    #[test]
    fn a_straight_field_changes_nothing() {
        let (field, position) = (Field::default(), Point::new(3.0, -4.0));
        assert_eq!(field.landing(position), position);
        assert_eq!(field.telling(position), position);
        assert!(field.contains(position) && !field.contains(Point::new(17_501.0, 0.0)));
    }

    #[test]
    fn values_out_of_range_are_named() {
        let good = Field::default();
        for (name, field) in [
            ("size_mm", Field { size_mm: 0.0, ..good }),
            ("barrel_per_mm2", Field { barrel_per_mm2: 1.0, ..good }),
            ("pillow_x_per_mm2", Field { pillow_x_per_mm2: f64::NAN, ..good }),
        ] {
            assert!(field.validate().unwrap_err().to_string().starts_with(name));
        }
    }
}
