//! A trained policy and what it decides.

use std::path::Path;

use lasergym_ablation::{ObservationMode, position_px};
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};
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
    thinned: Vec<u8>,
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
            Decision::Direct { thinning, .. } => {
                (mode_of(&network).len() / (thinning * thinning), 2)
            }
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
            thinned: Vec::with_capacity(observation_len),
        }
    }

    /// Where the next pulse goes, px; a position that an action reaches. `state` comes from
    /// [`Self::start`] and `memory` from [`Self::memory`]; nothing is allocated.
    ///
    /// # Errors
    /// [`PlanError::Policy`] when the network's output is not finite.
    pub fn decide(&self, state: &JobState, memory: &mut AgentMemory) -> Result<Point, PlanError> {
        let AgentMemory { scratch, view, observation, thinned } = memory;
        match self.decision {
            Decision::Direct { max_pulses, .. } => {
                let left = u32::try_from(state.pulses_left()).unwrap_or(u32::MAX);
                let mode = mode_of(&self.network);
                mode.write_state(state.workpiece(), left, max_pulses, observation);
                Ok(position_px(self.act(observation, thinned, scratch)?))
            }
            Decision::Spatial(spatial) => {
                let candidate = state.scores().best();
                write_view(state, candidate, view);
                let corrections_px = self.network.run(view, scratch)?;
                Self::corrected_position(state, candidate, corrections_px, spatial.polish_px)
            }
        }
    }

    /// The action of a [`Decision::Direct`] on a whole observation of its environment, uint8, shape
    /// (channels, 100, 100).
    ///
    /// # Errors
    /// [`PlanError::Policy`] when the observation has another length or the network's output is not
    /// finite; [`PlanError::PolicyDecision`] for another decision.
    pub fn act_on(
        &self,
        observation: &[u8],
        memory: &mut AgentMemory,
    ) -> Result<[f32; 2], PlanError> {
        self.act(observation, &mut memory.thinned, &mut memory.scratch)
    }

    fn act(
        &self,
        observation: &[u8],
        thinned: &mut Vec<u8>,
        scratch: &mut Scratch,
    ) -> Result<[f32; 2], PlanError> {
        let Decision::Direct { thinning, .. } = self.decision else {
            let reason = "a spatial policy does not act on observations alone".to_owned();
            return Err(PlanError::PolicyDecision { reason });
        };
        let seen = if thinning == 1 {
            observation
        } else {
            thinned.clear();
            // Rows of all channels follow one another, and the height divides by the thinning.
            for row in observation.chunks(WORKPIECE_SIZE_PX).skip(thinning / 2).step_by(thinning) {
                thinned.extend(row.iter().skip(thinning / 2).step_by(thinning));
            }
            thinned
        };
        let action = self.network.act_bytes(seen, scratch)?;
        Ok([action[0], action[1]])
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

#[cfg(test)]
mod tests {
    use super::super::zero_policy::{file, made, spatial};
    use super::*;
    use crate::{AgentPlanner, Greedy, Planner, PolishOptions};
    use lasergym_ablation::{Stream, Workpiece, random_shape, star};
    use std::sync::Arc;

    #[test]
    fn a_policy_without_corrections_plans_as_greedy_with_ring_score() {
        let agent = Arc::new(spatial());
        for seed in 0..10 {
            let target = random_shape(&mut Stream::from_seed(seed)).target;
            let job = Job::new(Workpiece::new(&target).unwrap(), 9.0, 25).unwrap();
            let plan = AgentPlanner { agent: Arc::clone(&agent) }.plan_to_end(&job).unwrap();
            let polish = PolishOptions { range_px: 0.5, steps_per_px: 8 };
            let greedy = Greedy { ring_weight: 0.35, polish }.plan_to_end(&job).unwrap();
            assert_eq!(plan.positions, greedy.positions);
        }
    }

    #[test]
    fn a_direct_policy_fires_where_its_action_says() {
        let bias = [0.25, -0.5];
        for channels in [1, 3] {
            let agent = made(channels, 100, &bias, r#"{"kind": "direct"}"#).unwrap();
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 2).unwrap();
            let position = agent.decide(&agent.start(&job), &mut agent.memory()).unwrap();
            assert_eq!(position, Point::new(62.5, 25.0));
        }
    }

    #[test]
    fn decisions_that_do_not_fit_the_network_are_refused() {
        let direct = r#"{"kind": "direct"}"#;
        for (channels, outputs, decision) in [
            (18, 289, direct),
            (3, 3, direct),
            (18, 288, r#"{"kind": "spatial", "ring_weight": 0.35, "polish_px": 0.5}"#),
            (18, 289, r#"{"kind": "oracle"}"#),
            (18, 289, r#"{"kind": "spatial", "ring_weight": 0.35}"#),
        ] {
            let size = if channels == 18 { 28 } else { 100 };
            let error = made(channels, size, &vec![0.0; outputs], decision).unwrap_err();
            assert!(matches!(error, PlanError::PolicyDecision { .. }), "{error}");
        }
        let bytes = file(18, 28, &[0.0; 289], direct);
        assert!(matches!(PolicyAgent::from_bytes(&bytes[..50]), Err(PlanError::Policy(_))));
        assert!(matches!(PolicyAgent::load("no such file"), Err(PlanError::Policy(_))));
    }
}
