//! How the output of a network becomes a pulse: the `decision` of a policy file.

use lasergym_geom::WORKPIECE_SIZE_PX;
use serde::{Deserialize, Serialize};

use crate::PlanError;

/// What a policy's network reads and what its output means.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Decision {
    /// The network reads the observation of the environment, of one channel (remaining target) or
    /// three (layers), and gives the action.
    Direct {
        /// Pulses of a whole episode in training, at least 1; shown in the layers. Default 45.
        #[serde(default = "paper_pulses")]
        max_pulses: u32,
        /// Only every such row and column is read, from the middle of the first cell on: a divisor of
        /// 100. Default 1, all.
        #[serde(default = "every_pixel")]
        thinning: usize,
    },
    /// The network reads the view about the place of best ring score and corrects the scores there.
    Spatial(SpatialDecision),
}

/// The budget of the paper.
fn paper_pulses() -> u32 {
    45
}

/// Nothing is left out.
fn every_pixel() -> usize {
    1
}

/// Settings of a spatial policy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialDecision {
    /// Weight of the ring in the score that the network corrects, in [0, 1].
    pub ring_weight: f64,
    /// Range of the final polish by immediate gain and correction, px, in [0, 2].
    pub polish_px: f64,
}

impl Default for SpatialDecision {
    /// Ring weight 0.35, polish ± 0.5 px.
    fn default() -> Self {
        Self { ring_weight: 0.35, polish_px: 0.5 }
    }
}

impl Decision {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`].
    pub fn validate(&self) -> Result<(), PlanError> {
        let invalid =
            |name, value: String, expected| Err(PlanError::InvalidOption { name, value, expected });
        match self {
            Self::Direct { max_pulses: 0, .. } => {
                invalid("max_pulses of the policy", "0".to_owned(), "at least 1")
            }
            &Self::Direct { thinning, .. }
                if !(1..=WORKPIECE_SIZE_PX).contains(&thinning)
                    || !WORKPIECE_SIZE_PX.is_multiple_of(thinning) =>
            {
                invalid("thinning of the policy", thinning.to_string(), "a divisor of 100")
            }
            Self::Direct { .. } => Ok(()),
            Self::Spatial(SpatialDecision { ring_weight, polish_px }) => {
                if !(0.0..=1.0).contains(ring_weight) {
                    return invalid("ring_weight", ring_weight.to_string(), "in [0, 1]");
                }
                if !(0.0..=2.0).contains(polish_px) {
                    return invalid("polish_px", polish_px.to_string(), "in [0, 2]");
                }
                Ok(())
            }
        }
    }

    /// Weight of the ring in the scores that the policy needs.
    pub(super) fn ring_weight(&self) -> f64 {
        match self {
            Self::Direct { .. } => 0.0,
            Self::Spatial(spatial) => spatial.ring_weight,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direct(max_pulses: u32, thinning: usize) -> Decision {
        Decision::Direct { max_pulses, thinning }
    }

    #[test]
    fn decisions_read_back_from_json() {
        for decision in [direct(40, 5), Decision::Spatial(SpatialDecision::default())] {
            let text = serde_json::to_string(&decision).unwrap();
            assert_eq!(serde_json::from_str::<Decision>(&text).unwrap(), decision);
        }
        let decision: Decision = serde_json::from_str(r#"{"kind": "direct"}"#).unwrap();
        assert_eq!(decision, direct(45, 1));
        let text = r#"{"kind": "spatial", "ring_weight": 0.35, "polish_px": 0.5}"#;
        let decision: Decision = serde_json::from_str(text).unwrap();
        assert_eq!(decision, Decision::Spatial(SpatialDecision::default()));
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let ring = Decision::Spatial(SpatialDecision { ring_weight: 1.1, polish_px: 0.5 });
        let polish = Decision::Spatial(SpatialDecision { ring_weight: 0.5, polish_px: f64::NAN });
        for (decision, name) in [
            (direct(0, 1), "max_pulses"),
            (direct(45, 0), "thinning"),
            (direct(45, 3), "thinning"),
            (ring, "ring_weight"),
            (polish, "polish_px"),
        ] {
            let error = decision.validate().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        }
    }
}
