//! The policies that are shipped, in this library itself.

use std::str::FromStr;

use crate::{PlanError, PolicyAgent};

/// A policy that is shipped; `crates/plan/models` has a card of each with training, results and
/// limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Pretrained {
    /// `star`: the upright star.
    Star,
    /// `rotated-star`: the star at any angle.
    RotatedStar,
    /// `random-shape`: any drawing.
    RandomShape,
}

impl Pretrained {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Star, Self::RotatedStar, Self::RandomShape];

    /// The name in commands and Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Star => "star",
            Self::RotatedStar => "rotated-star",
            Self::RandomShape => "random-shape",
        }
    }

    /// The policy file.
    #[must_use]
    pub fn file(self) -> &'static [u8] {
        match self {
            Self::Star => include_bytes!("../models/star.safetensors"),
            Self::RotatedStar => include_bytes!("../models/rotated-star.safetensors"),
            Self::RandomShape => include_bytes!("../models/random-shape.safetensors"),
        }
    }

    /// Loads the policy.
    ///
    /// # Errors
    /// As [`PolicyAgent::from_bytes`]; never for the files as they are shipped.
    pub fn load(self) -> Result<PolicyAgent, PlanError> {
        PolicyAgent::from_bytes(self.file())
    }
}

impl FromStr for Pretrained {
    type Err = PlanError;

    fn from_str(name: &str) -> Result<Self, PlanError> {
        Self::ALL.into_iter().find(|policy| policy.name() == name).ok_or_else(|| {
            PlanError::UnknownPolicy {
                name: name.to_owned(),
                accepted: Self::ALL.map(Self::name).join(", "),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AgentPlanner, Greedy, Job, Planner};
    use lasergym_ablation::{Stream, Workpiece, random_shape, star};
    use std::sync::Arc;

    #[test]
    fn shipped_policies_are_small_and_do_better_than_greedy_at_their_task() {
        for policy in Pretrained::ALL {
            assert!(policy.file().len() < 1_000_000, "{policy:?}");
            let agent = Arc::new(policy.load().unwrap());
            let (mut ours, mut greedy) = (0.0, 0.0);
            for k in 0..6_u32 {
                let (target, pulses) = match policy {
                    Pretrained::Star => (star(0.0), 40 + k as usize),
                    Pretrained::RotatedStar => (star(f64::from(k) * 11.0), 45),
                    Pretrained::RandomShape => {
                        let stream = &mut Stream::from_seed(1_995_000_000 + u64::from(k));
                        let target = random_shape(stream).target;
                        let pulses = target.area_px().div_ceil(125) as usize;
                        (target, pulses)
                    }
                };
                let job = Job::new(Workpiece::new(&target).unwrap(), 9.0, pulses).unwrap();
                let planner = AgentPlanner { agent: Arc::clone(&agent) };
                ours += planner.plan_to_end(&job).unwrap().score.reward;
                greedy += Greedy::default().plan_to_end(&job).unwrap().score.reward;
            }
            assert!(ours > greedy, "{policy:?}: {ours} {greedy}");
        }
    }

    #[test]
    fn names_read_back_and_others_list_them() {
        for policy in Pretrained::ALL {
            assert_eq!(policy.name().parse::<Pretrained>().unwrap(), policy);
        }
        let error = "hexagon".parse::<Pretrained>().unwrap_err().to_string();
        assert!(error.contains("\"hexagon\"") && error.contains("rotated-star"), "{error}");
    }
}
