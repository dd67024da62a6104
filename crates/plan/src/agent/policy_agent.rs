//! A trained policy and what it decides.

use std::path::Path;

use lasergym_ablation::{ObservationMode, position_px};
use lasergym_geom::Point;
use lasergym_policy::{Network, Scratch};

use crate::{Job, JobState, PlanError};

use super::corrections::{Corrections, best_position};
use super::decision::Decision;
use super::view::{VIEW_LEN, write_view};

/// A trained policy: one forward pass of its network decides one pulse. It is immutable: threads
/// share it, each with an [`AgentMemory`] of its own.
#[derive(Debug)]
pub struct PolicyAgent {
    network: Network,
    decision: Decision,
}

/// Buffers of one [`PolicyAgent`] at work.
#[derive(Debug)]
pub struct AgentMemory {
    scratch: Scratch,
    view: Vec<f32>,
    observation: Vec<u8>,
}

impl PolicyAgent {
    /// Loads a policy file.
    ///
    /// # Errors
    /// As [`Self::new`], and [`PlanError::Policy`] for a file that is no policy.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, PlanError> {
        Self::new(Network::load(path)?)
    }

    /// Loads a policy from the bytes of a file.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PlanError> {
        Self::new(Network::from_bytes(bytes)?)
    }

    /// The policy of `network`, whose manifest says how it decides.
    ///
    /// # Errors
    /// [`PlanError::PolicyDecision`] when the manifest's `decision` is unknown or does not fit the
    /// shapes of the network; [`PlanError::InvalidOption`] for its settings.
    pub fn new(network: Network) -> Result<Self, PlanError> {
        let refused = |reason: String| PlanError::PolicyDecision { reason };
        let decision: Decision = serde_json::from_value(network.manifest().decision.clone())
            .map_err(|error| refused(error.to_string()))?;
        decision.validate()?;
        let (input, output) = match decision {
            Decision::Direct { .. } => (mode_of(&network).len(), 2),
            Decision::Spatial(_) => (VIEW_LEN, Corrections::LEN),
        };
        if (network.input().values(), network.output().values()) != (input, output) {
            return Err(refused(format!(
                "its network takes {} values and gives {}, but the decision needs {input} and \
                 {output}",
                network.input().values(),
                network.output().values()
            )));
        }
        Ok(Self { network, decision })
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// How its output becomes a pulse.
    #[must_use]
    pub fn decision(&self) -> &Decision {
        &self.decision
    }

    /// `job` before its first pulse, with the scores that this policy needs.
    #[must_use]
    pub fn start(&self, job: &Job) -> JobState {
        JobState::new(job, self.decision.ring_weight())
    }

    /// Memory for decisions.
    #[must_use]
    pub fn memory(&self) -> AgentMemory {
        let observation_len = match self.decision {
            Decision::Direct { .. } => mode_of(&self.network).len(),
            Decision::Spatial(_) => 0,
        };
        AgentMemory {
            scratch: self.network.scratch(),
            view: vec![0.0; if observation_len == 0 { VIEW_LEN } else { 0 }],
            observation: vec![0; observation_len],
        }
    }

    /// Where the next pulse goes, px; a position that an action reaches. `state` comes from
    /// [`Self::start`] and `memory` from [`Self::memory`]; nothing is allocated.
    ///
    /// # Errors
    /// [`PlanError::Policy`] when the network's output is not finite.
    pub fn decide(&self, state: &JobState, memory: &mut AgentMemory) -> Result<Point, PlanError> {
        let AgentMemory { scratch, view, observation } = memory;
        match self.decision {
            Decision::Direct { max_pulses } => {
                let left = u32::try_from(state.pulses_left()).unwrap_or(u32::MAX);
                let mode = mode_of(&self.network);
                mode.write_state(state.workpiece(), left, max_pulses, observation);
                let action = self.network.act_bytes(observation, scratch)?;
                Ok(position_px([action[0], action[1]]))
            }
            Decision::Spatial(spatial) => {
                let candidate = state.scores().best();
                write_view(state, candidate, view);
                let corrections_px = self.network.run(view, scratch)?;
                Self::corrected_position(state, candidate, corrections_px, spatial.polish_px)
            }
        }
    }

    /// Where the ring score, corrected by `corrections_px` about the pixel `candidate` (row, column),
    /// is best, then polished within `polish_px`.
    pub(crate) fn corrected_position(
        state: &JobState,
        candidate: (usize, usize),
        corrections_px: &[f32],
        polish_px: f64,
    ) -> Result<Point, PlanError> {
        let corrections = Corrections::new(corrections_px).ok_or_else(|| {
            let found = corrections_px.len();
            let reason = format!("{found} corrections instead of {}", Corrections::LEN);
            PlanError::PolicyDecision { reason }
        })?;
        Ok(best_position(state, candidate, corrections, polish_px))
    }
}

/// The observation that a network of as many channels reads.
fn mode_of(network: &Network) -> ObservationMode {
    if network.input().channels == ObservationMode::Layers.channels() {
        ObservationMode::Layers
    } else {
        ObservationMode::Remaining
    }
}
