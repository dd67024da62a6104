//! The interface that all planners share, and their names.

use std::ops::ControlFlow;
use std::str::FromStr;

use lasergym_geom::Point;

use crate::{Job, Plan, PlanError};

/// Decides where the pulses of a job go.
pub trait Planner: Sync {
    /// Which planner this is.
    fn kind(&self) -> PlannerKind;

    /// Plans `job`, calling `progress` now and then. When it answers [`ControlFlow::Break`] the
    /// planner stops and returns its best plan so far with [`Plan::partial`] set.
    ///
    /// # Errors
    /// Settings of the planner that do not fit the job.
    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError>;

    /// Plans `job` to the end.
    ///
    /// # Errors
    /// As [`Planner::plan`].
    fn plan_to_end(&self, job: &Job) -> Result<Plan, PlanError> {
        self.plan(job, &mut |_| ControlFlow::Continue(()))
    }
}

/// How far a planner has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanProgress<'a> {
    /// Which planner is at work.
    pub planner: PlannerKind,
    /// Part of the work that is done, in [0, 1], never falling.
    pub fraction: f64,
    /// Reward of the best plan so far.
    pub best_reward: f64,
    /// Pulses of the best plan so far, in no particular order.
    pub best_positions: &'a [Point],
}

/// The planners, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PlannerKind {
    /// `raster`: grid of pitch √2 r ([`crate::RasterPitch::Root2Radius`]).
    Raster,
    /// `raster-fine`: grid of pitch r ([`crate::RasterPitch::Radius`]).
    RasterFine,
    /// `greedy`: [`crate::Greedy`].
    Greedy,
    /// `anneal`: [`crate::Anneal`].
    Anneal,
    /// `cma-es`: [`crate::CmaEsPlanner`].
    CmaEs,
    /// `policy`: [`crate::AgentPlanner`].
    Policy,
    /// `agent-mpc`: [`crate::ForesightPlanner`].
    AgentMpc,
}

impl PlannerKind {
    /// All planners, the fastest first.
    pub const ALL: [Self; 7] = [
        Self::Raster,
        Self::RasterFine,
        Self::Greedy,
        Self::Policy,
        Self::AgentMpc,
        Self::Anneal,
        Self::CmaEs,
    ];

    /// The name in commands, reports and Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::RasterFine => "raster-fine",
            Self::Greedy => "greedy",
            Self::Anneal => "anneal",
            Self::CmaEs => "cma-es",
            Self::Policy => "policy",
            Self::AgentMpc => "agent-mpc",
        }
    }
}

impl std::fmt::Display for PlannerKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for PlannerKind {
    type Err = PlanError;

    fn from_str(name: &str) -> Result<Self, PlanError> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            PlanError::UnknownPlanner {
                name: name.to_owned(),
                accepted: Self::ALL.map(Self::name).join(", "),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for kind in PlannerKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
    }

    #[test]
    fn an_unknown_name_lists_the_accepted_ones() {
        let error = "Greedy".parse::<PlannerKind>().unwrap_err().to_string();
        assert!(error.contains("\"Greedy\"") && error.contains("raster-fine, greedy"), "{error}");
    }
}
