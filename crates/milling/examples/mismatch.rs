//! What a wrong model costs, and what measuring after each layer restores.
//!
//! The plant's footprint is 5 % wider, its rate 5 % lower, and its speed varies by 2 % from point to
//! point. `cargo run --release -p lasergym-milling --example mismatch`

use std::error::Error;
use std::ops::ControlFlow;

use lasergym_milling::{
    BeamPath, DepthMap, JobOptions, MillingJob, Process, Profile, Simulator, SolveOptions,
};

/// Side of the targets, pixels.
const SIZE: usize = 100;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "process          layers  model %  plant, open loop %  plant, measured after each layer %"
    );
    for (name, pixel_um, layers, base_um, depth_um) in
        [("laser-graphite", 6.0, 4, 26.0, 30.0), ("waterjet-garnet", 60.0, 3, 130.0, 200.0)]
    {
        let depths = (0..SIZE * SIZE)
            .map(|k| {
                let part = |k: usize| (k as f64 + 0.5) / SIZE as f64;
                let (x, y) = (part(k % SIZE), part(k / SIZE));
                base_um
                    + depth_um
                        * (0.5 + 0.25 * (9.0 * x).sin() + 0.25 * (7.0 * y * x + 5.0 * y).cos())
            })
            .collect();
        let target = DepthMap::new(SIZE, SIZE, pixel_um, depths)?;
        report(name, &target, layers)?;
    }
    Ok(())
}

fn report(name: &str, target: &DepthMap, layers: usize) -> Result<(), Box<dyn Error>> {
    let profile = Profile::shipped(name)?;
    let job = MillingJob::new(target, profile, JobOptions { layers: Some(layers) })?;
    let mut plant = Plant::new(&job)?;
    let options = SolveOptions { free_iterations: 0, iterations: 30, ..SolveOptions::default() };
    let go_on = &mut |_: &_| ControlFlow::Continue(());

    let planned = job.solve(&options, go_on)?;
    let mut surface = vec![0.0; job.grid().len()];
    plant.mill(&planned.path, &mut surface)?;
    let open = job.objective().tracking_error(&surface)?;

    let mut surface = vec![0.0; job.grid().len()];
    for left in (1..=layers).rev() {
        let plan = job.solve_from(&surface, left, &options, go_on)?;
        let (layer, _) = plan.path.split_at_pass(job.layout().passes);
        plant.mill(&layer, &mut surface)?;
    }
    let closed = job.objective().tracking_error(&surface)?;
    println!(
        "{name:<16} {layers:>6} {:>8.2} {:>19.2} {:>35.2}",
        planned.error.percent, open.percent, closed.percent
    );
    Ok(())
}

/// A process that differs from its model.
struct Plant {
    simulator: Simulator,
    /// State of a linear congruential generator.
    noise: u64,
}

impl Plant {
    fn new(job: &MillingJob) -> Result<Self, Box<dyn Error>> {
        let model = &job.profile().process;
        let process = Process {
            footprint: model.footprint.scaled(1.05, 0.95 / 1.05_f64.powi(2))?,
            law: model.law,
        };
        let (_, longest) = job.profile().dwell_range_s_mm();
        let spacing_um = job.layout().spacing_um;
        let substeps =
            Simulator::stable_substeps(&process, job.grid().cell_um, spacing_um, 1.1 * longest);
        let simulator = Simulator::new(*job.grid(), &process, substeps)?;
        Ok(Self { simulator, noise: 1 })
    }

    fn mill(&mut self, path: &BeamPath, surface: &mut [f64]) -> Result<(), Box<dyn Error>> {
        let mut path = path.clone();
        for dwell in &mut path.dwell_s_mm {
            *dwell *= 1.0 + 0.02 * self.deviate();
        }
        Ok(self.simulator.mill(&path, surface)?)
    }

    /// About normal, with variance 1: the sum of twelve uniform values.
    fn deviate(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.noise = self
                .noise
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (self.noise >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    }
}
