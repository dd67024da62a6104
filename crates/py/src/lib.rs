//! The extension module `lasergym._native`: borrow, call, convert; nothing else.

// Python hands arguments over by value; Rust code never calls these functions.
#![allow(clippy::needless_pass_by_value)]

mod batch;
mod batch_arrays;
mod bitmaps;
mod cma_es;
mod disturbances;
mod drawings;
mod environment;
mod errors;
mod galvo;
mod machine;
mod machine_drivers;
mod machine_rig;
mod milling;
mod milling_environment;
mod pictures;
mod planners;
mod policy;
mod programs;
mod remote;
mod remote_environment;
mod settings;
mod targets;
mod teacher;

/// Native half of the Python package `lasergym`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::batch::NativeBatch;
    #[pymodule_export]
    use crate::cma_es::NativeCmaEs;
    #[pymodule_export]
    use crate::disturbances::disturbed_job;
    #[pymodule_export]
    use crate::drawings::{load_drawing, target_png};
    #[pymodule_export]
    use crate::environment::NativeEnvironment;
    #[pymodule_export]
    use crate::galvo::{
        NativeGalvoLines, galvo_calibrate, galvo_compensation, galvo_head, galvo_heads,
        galvo_identify, galvo_line_costs, galvo_measure_line, galvo_postprocess, galvo_simulate,
        galvo_test_pattern,
    };
    #[pymodule_export]
    use crate::machine::{calibrate, run_machine};
    #[pymodule_export]
    use crate::machine_rig::{NativeRig, calibrate_simulator, simulator_options};
    #[pymodule_export]
    use crate::milling::{
        NativeMillingJob, calibrate_trenches, depths_of_heights, read_heights, shipped_profiles,
    };
    #[pymodule_export]
    use crate::milling_environment::{NativeMillingBatch, NativeMillingEnvironment, random_relief};
    #[pymodule_export]
    use crate::pictures::{NativeTrajectoryPicture, frame_preview, gif};
    #[pymodule_export]
    use crate::planners::{plan, shortest_order};
    #[pymodule_export]
    use crate::policy::{NativePolicy, shipped_policy};
    #[pymodule_export]
    use crate::programs::{read_csv, read_gcode, travel, write_csv, write_gcode};
    #[pymodule_export]
    use crate::remote::{NativeRemoteJob, best_robot_line};
    #[pymodule_export]
    use crate::remote_environment::{NativeRemoteBatch, NativeRemoteEnvironment};
    #[pymodule_export]
    use crate::targets::{random_shape, random_shape_areas, score, star};
    #[pymodule_export]
    use crate::teacher::NativeTeacher;
}
