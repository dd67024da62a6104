//! Depth milling with a laser or a waterjet: given a surface, find the passes of the beam and its
//! dwell along them.
//!
//! Source: Bilbao-Guillerna, Axinte, Billingham and Cadot, "Waterjet and laser etching: the
//! nonlinear inverse problem", Royal Society Open Science 4 (2017); equation numbers are those of the
//! paper where it has them. Lengths are µm, speeds mm/s, dwells s/mm; x points right, y down and
//! depths into the workpiece.

mod abel;
mod adjoint_run;
mod arctan;
mod asc_grid;
mod batch;
mod beam_path;
mod beam_window;
mod bounded_lbfgs;
mod calibration;
mod depth_map;
mod environment;
mod environment_options;
mod error;
mod flat_step;
mod footprint;
mod footprint_table;
mod grid;
mod height_map;
mod law;
mod milling_job;
mod npy;
mod objective;
mod pass_kernel;
mod passes;
mod png_heights;
mod profile;
mod random_relief;
mod residual_image;
mod simulator;
mod sloped_step;
mod solver;
mod spot_plan;
mod spots;
mod stl;
mod switching;
mod tiff_heights;
mod trench;

pub use abel::abel_inversion;
pub use adjoint_run::{GradientMemory, MAX_TAPE_VALUES};
pub use batch::{Batch, BatchOptions, EpisodeStatistics, StepRecord};
pub use beam_path::{BeamPath, MAX_CONTROL_POINTS, RasterLayout};
pub use calibration::{Calibration, FittedParameter, calibrate};
pub use depth_map::DepthMap;
pub use environment::{Environment, Progress, Step};
pub use environment_options::{EnvironmentOptions, SIZE_PX};
pub use error::MillingError;
pub use footprint::{Compact, Footprint, GAUSSIAN_REACH, Gaussian};
pub use footprint_table::FootprintTable;
pub use grid::{Grid, MAX_GRID_CELLS};
pub use height_map::{HeightFormat, HeightMap, HeightScale, MAX_HEIGHT_FILE_BYTES};
pub use law::{FeedSpeedLaw, RemovalLaw, SlopeLaw, SlopeSign};
pub use milling_job::{JobOptions, MAX_LAYERS, MillingJob};
pub use objective::{Objective, TrackingError};
pub use profile::Profile;
pub use random_relief::random_relief;
pub use residual_image::ObservationMode;
pub use simulator::{Direction, Gradient, MAX_COURANT, Process, Simulator};
pub use solver::{Solution, SolveOptions, SolveProgress, SolveStage};
pub use spot_plan::{SpotPlan, SpotPlanner};
pub use spots::{Spot, SpotRoom, SpotsGradient};
pub use trench::{TRENCH_HEADER, Trench, read_trenches, trench_depths_um};
