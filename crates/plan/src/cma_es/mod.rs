//! Covariance matrix adaptation evolution strategy (CMA-ES): minimises a black-box function of
//! many real variables by adapting a normal distribution to it.
//!
//! [`CmaEs`] is one run as ask and tell; [`minimise`] drives runs to the end, with restarts.
//!
//! Sources, with the equation numbers used beside the code:
//! - N. Hansen, *The CMA Evolution Strategy: A Tutorial*, arXiv:1604.00772v2 (equations, Table 1,
//!   Appendix B.3).
//! - A. Auger, N. Hansen, *A Restart CMA Evolution Strategy With Increasing Population Size*,
//!   CEC 2005 ([`Restarts::Ipop`]).
//! - N. Hansen, *Benchmarking a BI-Population CMA-ES on the BBOB-2009 Function Testbed*,
//!   GECCO 2009 ([`Restarts::Bipop`]).

mod boundary;
mod covariance;
mod eigen;
mod error;
mod optimiser;
mod options;
mod parameters;
mod restarts;
mod termination;

pub use boundary::Bounds;
pub use error::CmaEsError;
pub use optimiser::{Best, CmaEs};
pub use options::{CmaEsOptions, CovarianceUpdate, MAX_POPULATION_VALUES, Tolerances};
pub use parameters::StrategyParameters;
pub use restarts::{MAX_GROWTHS, Minimum, Progress, Restarts, minimise, minimise_population};
pub use termination::Termination;
