//! Trained policies that decide pulse by pulse.

mod corrections;
mod decision;
mod foresight;
mod planner;
mod policy_agent;
mod view;
#[cfg(test)]
pub(crate) mod zero_policy;

pub use corrections::CORRECTION_REACH_PX;
pub use decision::{Decision, SpatialDecision};
pub use foresight::{Foresight, ForesightPlanner};
pub use planner::{AgentPlanner, PolicyDecider};
pub use policy_agent::{AgentMemory, PolicyAgent};
pub use view::{VIEW_CHANNELS, VIEW_LEN, VIEW_SIZE, VIEW_WIDTH_PX, write_view};
