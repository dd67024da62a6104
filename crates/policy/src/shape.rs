//! Shapes of activations.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::PolicyError;
use crate::limits::{MAX_ACTIVATION_VALUES, MAX_DIMENSION};

/// Shape of an activation: channels × height × width. A vector of n values is n × 1 × 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Number of channels, or of values in a vector.
    pub channels: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
}

impl Shape {
    /// A shape of `channels` planes of `height` rows and `width` columns.
    #[must_use]
    pub fn new(channels: usize, height: usize, width: usize) -> Self {
        Self { channels, height, width }
    }

    /// The shape of a vector of `length` values.
    #[must_use]
    pub fn vector(length: usize) -> Self {
        Self::new(length, 1, 1)
    }

    /// Pixels of one channel.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// Values of all channels.
    #[must_use]
    pub fn values(&self) -> usize {
        self.channels * self.pixels()
    }

    /// Whether this is a vector.
    #[must_use]
    pub fn is_vector(&self) -> bool {
        self.height == 1 && self.width == 1
    }

    /// Checks that the shape is neither empty nor too large to be run for `owner`.
    pub(crate) fn check(&self, owner: &str) -> Result<(), PolicyError> {
        let sides = [self.channels, self.height, self.width];
        if sides.iter().any(|&side| side == 0 || side > MAX_DIMENSION) {
            return Err(PolicyError::InvalidSetting {
                owner: owner.to_owned(),
                name: "shape",
                value: self.to_string(),
                expected: format!("1 to {MAX_DIMENSION} along each side"),
            });
        }
        let values = sides.iter().fold(1_u64, |product, &side| product.saturating_mul(side as u64));
        if values > MAX_ACTIVATION_VALUES {
            return Err(PolicyError::TooLarge {
                layer: owner.to_owned(),
                what: "values of one activation",
                value: values,
                limit: MAX_ACTIVATION_VALUES,
            });
        }
        Ok(())
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} × {} × {}", self.channels, self.height, self.width)
    }
}
