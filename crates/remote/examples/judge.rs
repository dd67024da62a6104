//! Plans random tasks of 2 to 12 subtasks and plays the programs: how many the simulation accepts.
//!
//! `cargo run --release -p lasergym-remote --example judge [TASKS] [SEED]`

use std::error::Error;

use lasergym_remote::{
    PlanOptions, RandomLayout, RemotePlan, RobotProgram, ScannerProgram, simulate,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| arguments.next().map_or(Ok(default), |text| text.parse());
    let (tasks, seed) = (number(1000)?, number(0)?);
    let (mut good, mut seam_mm, mut speed, mut time_s) = (0_u64, 0.0_f64, 0.0_f64, 0.0_f64);
    for index in seed..seed + tasks {
        let subtasks = 2 + (index % 11) as usize;
        let task = RandomLayout { subtasks, ..RandomLayout::default() }.task(index)?;
        let plan = RemotePlan::new(&task, &PlanOptions::default())?;
        // As a machine would read them.
        let robot = RobotProgram::from_csv(&RobotProgram::of(&task, &plan).to_csv())?;
        let scanner = ScannerProgram::from_csv(&ScannerProgram::of(&task, &plan).to_csv())?;
        let report = simulate(&task, &robot, &scanner, 0.0)?;
        good += u64::from(report.is_good());
        for problem in &report.problems {
            println!("task {index}: {problem}");
        }
        seam_mm = seam_mm.max(report.max_seam_error_mm);
        speed = speed.max(report.max_speed_error);
        time_s = time_s.max((report.total_s - plan.cycle_time_s).abs());
    }
    println!("{good} of {tasks} plans accepted");
    println!("largest distance from a seam: {:.2} µm", 1e3 * seam_mm);
    println!("largest difference in speed on the workpiece: {:.3} %", 100.0 * speed);
    println!("largest difference in total time: {:.1} ms", 1e3 * time_s);
    Ok(())
}
