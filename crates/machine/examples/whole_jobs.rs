//! Whole jobs from camera images alone: what each decider machines on a simulated rig, judged by the
//! marks that were really made.
//!
//! Random shapes of held-out seeds, at most 45 pulses. The stage is sent beside the aim by as much as
//! pulses have landed beside theirs, but for the contestant without correction. The rig is calibrated with test pulses first.
//! Prints a line for each decider: mean and standard deviation of the machined part of the target,
//! of what was machined beside it, and of reward · 10⁴ / area; then where the time of a job goes,
//! that of the stage, camera and laser as the rig says, that of vision, decisions and journal as
//! measured here.
//!
//! `cargo run --release -p lasergym-machine --example whole_jobs -- [PRESET] [SHAPES]`

use std::error::Error;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::sync::Arc;

use lasergym_ablation::{Footprint, Pulse, PulseOutcome, Stream, Workpiece, random_shape};
use lasergym_machine::simulator::{Preset, Rig};
use lasergym_machine::vision::{Vision, VisionOptions};
use lasergym_machine::{
    CalibrationOptions, CalibrationRun, CameraCalibration, Drivers, JobDescription, JobFolder,
    JobOptions, JobReport, MachineJob, Observer, ObserverMaker,
};
use lasergym_plan::{
    Decider, Foresight, Greedy, Job, PlanError, PolicyAgent, PolicyDecider, PolishOptions,
    Pretrained, Replanning, ReplanningOptions, Thinking,
};

/// Seeds of the shapes that are kept for measurements.
const FIRST_SEED: u64 = 2_000_000_000;

/// Most pulses of a job, as in the environments.
const MAX_PULSES: usize = 45;

/// The pointing error that one decider expects, px: about that of the preset `lab`.
const EXPECTED_ERROR_PX: f64 = 0.5;

/// Moves of foresight before each pulse.
const MOVES: u64 = 5000;

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Contestant {
    Greedy,
    Policy,
    Foresight,
    ForesightUncorrected,
    ForesightExpectingErrors,
    AnnealAgain,
}

impl Contestant {
    const ALL: [Self; 6] = [
        Self::Greedy,
        Self::Policy,
        Self::Foresight,
        Self::ForesightUncorrected,
        Self::ForesightExpectingErrors,
        Self::AnnealAgain,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Greedy => "greedy",
            Self::Policy => "policy",
            Self::Foresight => "agent-mpc",
            Self::ForesightUncorrected => "agent-mpc, no correction",
            Self::ForesightExpectingErrors => "agent-mpc expecting 0.5 px",
            Self::AnnealAgain => "anneal again",
        }
    }

    fn decider(self, agent: &Arc<PolicyAgent>) -> Result<Box<dyn Decider>, PlanError> {
        let agent = Arc::clone(agent);
        let polish = PolishOptions { range_px: 0.25, steps_per_px: 8 };
        Ok(match self {
            Self::Greedy => Box::new(Greedy { ring_weight: 0.35, polish }),
            Self::Policy => Box::new(PolicyDecider::new(agent)),
            Self::Foresight | Self::ForesightUncorrected => {
                Box::new(Foresight::new(agent, Thinking::Moves(MOVES), 0))
            }
            Self::ForesightExpectingErrors => {
                let foresight = Foresight::new(agent, Thinking::Moves(MOVES), 0);
                Box::new(foresight.expecting(EXPECTED_ERROR_PX)?)
            }
            Self::AnnealAgain => Box::new(Replanning::new(ReplanningOptions::default())?),
        })
    }
}

/// What the jobs of a contestant came to, a value for each job.
#[derive(Default)]
struct Figures {
    machined_percent: Vec<f64>,
    off_target_percent: Vec<f64>,
    reward_over_area: Vec<f64>,
    pulses: Vec<f64>,
    faults: Vec<String>,
    /// Time of all jobs by phase, s.
    phases_s: [(&'static str, f64); 7],
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let preset: Preset = arguments.next().map_or(Ok(Preset::Lab), |text| text.parse())?;
    let shapes: u64 = arguments.next().map_or(Ok(200), |text| text.parse())?;
    let agent = Arc::new(Pretrained::RandomShape.load()?);
    println!("{} preset, {shapes} random shapes from seed {FIRST_SEED}", preset.name());
    println!(
        "decider                       machined %   off target %  reward / area   pulses  faults"
    );
    for contestant in Contestant::ALL {
        let mut figures = Figures::default();
        for seed in FIRST_SEED..FIRST_SEED + shapes {
            let correct_pointing = contestant != Contestant::ForesightUncorrected;
            let options = JobOptions { dry_run: false, correct_pointing, ..JobOptions::default() };
            run_job(preset, seed, contestant.decider(&agent)?, options, &mut figures)?;
        }
        println!("{:27} {}", contestant.name(), figures.line());
        println!("{}", figures.shares());
        for fault in &figures.faults {
            println!("    {fault}");
        }
    }
    Ok(())
}

fn calibration(preset: Preset, seed: u64) -> Result<CameraCalibration, Box<dyn Error>> {
    let options = preset.options();
    let mut run = CalibrationRun::new(options.scale_frame_px_per_um.round());
    // The harsh stage does not repeat to 0.3 µm.
    run.fit = CalibrationOptions { max_residual_um: 1.5, ..CalibrationOptions::default() };
    let rig = Rig::new(options, seed ^ 0xca11)?;
    Ok(run.calibrate(&mut rig.stage(), &mut rig.laser(), &mut rig.camera())?)
}

fn run_job(
    preset: Preset,
    seed: u64,
    decider: Box<dyn Decider>,
    options: JobOptions,
    figures: &mut Figures,
) -> Result<(), Box<dyn Error>> {
    let target = random_shape(&mut Stream::from_seed(seed)).target;
    let area_px = f64::from(target.area_px());
    let job = Job::new(Workpiece::new(&target)?, 9.0, MAX_PULSES)?;
    let rig = Rig::new(preset.options(), seed)?;
    let calibration = calibration(preset, seed)?;
    let observer: ObserverMaker = Box::new(move |reference| {
        let vision = Vision::new(calibration, reference, VisionOptions::default())?;
        Ok(Box::new(vision) as Box<dyn Observer>)
    });
    let folder = tempfile::tempdir()?;
    let storage = Box::new(JobFolder::create(folder.path().join("job"))?);
    let drivers = Drivers { stage: rig.stage(), laser: rig.laser(), camera: rig.camera() };
    let description = JobDescription { seed, ..JobDescription::default() };
    let machine =
        MachineJob::begin(storage, &job, decider, drivers, observer, description, options)?;
    let report = machine.run(&mut |_| ControlFlow::Continue(()))?;

    let mut workpiece = job.workpiece().clone();
    let machined = rig.true_marks().iter().fold(PulseOutcome::default(), |machined, mark| {
        let disc = Pulse { position: mark.center_px(), radius_px: mark.radius_px };
        machined + workpiece.pulse(&Footprint::of(disc))
    });
    figures.machined_percent.push(100.0 * f64::from(machined.hit_px) / area_px);
    figures.off_target_percent.push(100.0 * f64::from(machined.miss_px) / area_px);
    figures.reward_over_area.push(f64::from(machined.gain_px()) / area_px);
    figures.pulses.push(report.pulses as f64);
    let faults = report.faults.iter().map(|fault| format!("seed {seed}: {}", fault.message));
    figures.faults.extend(faults);
    figures.spend(&rig, &report);
    Ok(())
}

impl Figures {
    fn spend(&mut self, rig: &Rig, report: &JobReport) {
        let (machine, here) = (rig.elapsed_s(), report.phases);
        let spent_s = [
            ("stage moves", machine.move_s),
            ("stage settles", machine.settle_s),
            ("camera", machine.expose_s),
            ("laser", machine.pulse_s),
            ("vision", here.vision_s),
            ("decisions", here.decide_s),
            ("journal", here.journal_s),
        ];
        for ((name, sum_s), (phase, time_s)) in self.phases_s.iter_mut().zip(spent_s) {
            *name = phase;
            *sum_s += time_s;
        }
    }

    fn line(&self) -> String {
        let cell = |values: &[f64], digits: usize| {
            let (mean, deviation) = mean_and_deviation(values);
            format!("{mean:.digits$} ± {deviation:.digits$}")
        };
        format!(
            "{:>13}  {:>13}  {:>15}  {:>6.1}  {}",
            cell(&self.machined_percent, 2),
            cell(&self.off_target_percent, 2),
            cell(&self.reward_over_area, 4),
            mean_and_deviation(&self.pulses).0,
            self.faults.len(),
        )
    }

    fn shares(&self) -> String {
        let total_s: f64 = self.phases_s.iter().map(|&(_, time_s)| time_s).sum();
        let jobs = self.pulses.len() as f64;
        let mut text = format!("    {:.1} s a job:", total_s / jobs);
        for (name, time_s) in self.phases_s {
            // Writing to a string cannot fail.
            let _ = write!(text, " {name} {:.2} %,", 100.0 * time_s / total_s);
        }
        text.pop();
        text
    }
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}
