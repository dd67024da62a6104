//! Jobs in a closed loop.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use lasergym_ablation::Workpiece;
use lasergym_geom::{Bitmap, Point};
use lasergym_machine::vision::{Vision, VisionOptions};
use lasergym_machine::{
    CalibrationRun, Camera, CameraCalibration, Drivers, JobDescription, JobFolder, JobOptions,
    JobProgress, JobReport, JournalVerdict, Laser, MachineJob, Observer, ObserverMaker, Stage,
};
use lasergym_plan::{
    AnnealBudget, Decider, FixedPlan, Foresight, Greedy, Job, PolicyDecider, Replanning,
    ReplanningOptions, Thinking,
};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::bitmaps::{bitmap_of, points_of};
use crate::errors::{
    ablation_error, calibration_error, exception, job_error, option_error, plan_error,
};
use crate::machine_drivers::{PyCamera, PyLaser, PyStage};
use crate::machine_rig::NativeRig;
use crate::policy::NativePolicy;

/// Time between two looks at Ctrl-C.
const SIGNAL_CHECK: Duration = Duration::from_millis(50);

/// How a job decides about its pulses.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct DeciderSettings<'py> {
    name: String,
    seed: u64,
    first_iterations: Option<u64>,
    first_s: f64,
    moves: Option<u64>,
    thinking_s: f64,
    policy: Option<Bound<'py, NativePolicy>>,
    xy_px: Option<PyReadonlyArray2<'py, f64>>,
    pointing_error_px: f64,
}

impl DeciderSettings<'_> {
    pub(crate) fn decider(&self) -> PyResult<Box<dyn Decider>> {
        Ok(match (self.name.as_str(), &self.policy, &self.xy_px) {
            ("greedy", None, None) => Box::new(Greedy::default()),
            ("anneal", None, None) => Box::new(
                Replanning::new(ReplanningOptions {
                    first: self.first()?,
                    thinking: self.thinking()?,
                    seed: self.seed,
                })
                .map_err(plan_error)?,
            ),
            ("policy", Some(policy), None) => Box::new(PolicyDecider::new(policy.get().agent())),
            ("agent-mpc", Some(policy), None) => Box::new(
                Foresight::new(policy.get().agent(), self.thinking()?, self.seed)
                    .expecting(self.pointing_error_px)
                    .map_err(plan_error)?,
            ),
            ("fixed", None, Some(xy_px)) => {
                Box::new(FixedPlan::new(points_of(xy_px)?).map_err(plan_error)?)
            }
            (name, ..) => {
                return Err(option_error(
                    "planner",
                    format!("{name:?}"),
                    "greedy, anneal, policy or agent-mpc with a policy, or fixed with positions",
                ));
            }
        })
    }

    fn first(&self) -> PyResult<AnnealBudget> {
        Ok(match self.first_iterations {
            Some(iterations) => AnnealBudget::Iterations(iterations),
            None => AnnealBudget::Time(duration("first_s", self.first_s)?),
        })
    }

    fn thinking(&self) -> PyResult<Thinking> {
        Ok(match self.moves {
            Some(moves) => Thinking::Moves(moves),
            None => Thinking::Time(duration("thinking_s", self.thinking_s)?),
        })
    }
}

/// Keyword arguments of a job.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct MachineSettings<'py> {
    folder: PathBuf,
    /// The pattern of a new job; none for one that is resumed.
    target: Option<PyReadonlyArray2<'py, bool>>,
    pulse_radius_px: f64,
    max_pulses: usize,
    seed: u64,
    /// As in the journal: names and settings of the planner and of the drivers.
    planner: String,
    drivers: String,
    calibration: String,
    dry_run: bool,
    home: bool,
    tolerance_um: f64,
    completion: f64,
    correct_pointing: bool,
    looks: u32,
    exposure_s: Option<f64>,
    imaging_um: (f64, f64),
    decider: DeciderSettings<'py>,
}

/// What Python is told after a command.
#[derive(IntoPyObject)]
pub(crate) struct ProgressParts {
    pulse: usize,
    pulses: usize,
    max_pulses: usize,
    aimed_px: (f64, f64),
    verdict: &'static str,
    marks: Vec<(f64, f64, f64, f64)>,
    reward: f64,
    machined_fraction: f64,
    off_target_fraction: f64,
}

impl ProgressParts {
    fn of(now: &JobProgress<'_>) -> Self {
        let mark = |mark: &lasergym_machine::Mark| {
            (mark.center_px.x, mark.center_px.y, mark.radius_px, mark.confidence)
        };
        Self {
            pulse: now.pulse,
            pulses: now.pulses,
            max_pulses: now.max_pulses,
            aimed_px: (now.aimed_px.x, now.aimed_px.y),
            verdict: match now.verdict {
                JournalVerdict::Seen => "seen",
                JournalVerdict::Nothing => "nothing",
                JournalVerdict::Uncertain => "uncertain",
                JournalVerdict::Dry => "dry",
            },
            marks: now.marks.iter().map(mark).collect(),
            reward: now.reward,
            machined_fraction: now.machined_fraction,
            off_target_fraction: now.off_target_fraction,
        }
    }
}

/// Runs a job with the rig, or with drivers written in Python (stage, laser, camera), and returns its
/// report as JSON. `progress` is called with a dict after each command and stops the job by
/// returning True; so does a signal.
#[pyfunction]
pub(crate) fn run_machine(
    py: Python<'_>,
    settings: MachineSettings<'_>,
    rig: Option<PyRef<'_, NativeRig>>,
    drivers: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>, Bound<'_, PyAny>)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let prepared = Prepared::from(&settings)?;
    let report = match (rig, drivers) {
        (Some(rig), None) => {
            let (stage, laser, camera) = rig.saved();
            run(py, prepared, Drivers { stage, laser, camera }, progress)?
        }
        (None, Some((stage, laser, camera))) => {
            let drivers = Drivers {
                stage: PyStage::new(&stage)?,
                laser: PyLaser { object: laser.unbind() },
                camera: PyCamera { object: camera.unbind() },
            };
            run(py, prepared, drivers, progress)?
        }
        _ => return Err(option_error("rig", "missing", "given, or three drivers instead")),
    };
    serde_json::to_string(&report).map_err(|error| exception("JobFailedError", error.to_string()))
}

/// Fires test pulses with drivers written in Python (stage, laser, camera): the calibration, JSON.
#[pyfunction]
pub(crate) fn calibrate(
    py: Python<'_>,
    drivers: (Bound<'_, PyAny>, Bound<'_, PyAny>, Bound<'_, PyAny>),
    rough_scale_frame_px_per_um: f64,
    pulse_radius_px: f64,
    side_pulses: usize,
    margin_um: f64,
    max_residual_um: f64,
) -> PyResult<String> {
    let (stage, laser, camera) = drivers;
    let mut stage = PyStage::new(&stage)?;
    let mut laser = PyLaser { object: laser.unbind() };
    let mut camera = PyCamera { object: camera.unbind() };
    let mut run = CalibrationRun::new(rough_scale_frame_px_per_um);
    run.side_pulses = side_pulses;
    run.margin_um = margin_um;
    run.vision.radius_px = pulse_radius_px;
    run.fit.max_residual_um = max_residual_um;
    let calibration = py
        .detach(|| run.calibrate(&mut stage, &mut laser, &mut camera))
        .map_err(calibration_error)?;
    serde_json::to_string(&calibration)
        .map_err(|error| exception("CalibrationError", error.to_string()))
}

/// A job with everything but its machine.
struct Prepared {
    folder: PathBuf,
    begin: Option<(Bitmap, f64, usize, JobDescription)>,
    decider: Box<dyn Decider>,
    observer: ObserverMaker,
    options: JobOptions,
}

impl Prepared {
    fn from(settings: &MachineSettings<'_>) -> PyResult<Self> {
        let json = |text: &str| {
            serde_json::from_str(text)
                .map_err(|error| exception("JobError", format!("{text:?}: {error}")))
        };
        let calibration: CameraCalibration = serde_json::from_str(&settings.calibration)
            .map_err(|error| exception("CalibrationError", error.to_string()))?;
        let vision = VisionOptions { radius_px: settings.pulse_radius_px, ..Default::default() };
        let observer: ObserverMaker = Box::new(move |reference| {
            let vision = Vision::new(calibration, reference, vision)?;
            Ok(Box::new(vision) as Box<dyn Observer>)
        });
        let begin = match &settings.target {
            None => None,
            Some(target) => {
                let description = JobDescription {
                    planner: json(&settings.planner)?,
                    drivers: json(&settings.drivers)?,
                    calibration: json(&settings.calibration)?,
                    seed: settings.seed,
                };
                let radius_px = settings.pulse_radius_px;
                Some((bitmap_of(target)?, radius_px, settings.max_pulses, description))
            }
        };
        let (x, y) = settings.imaging_um;
        let options = JobOptions {
            imaging_um: Point::new(x, y),
            tolerance_um: settings.tolerance_um,
            looks: settings.looks,
            completion: settings.completion,
            correct_pointing: settings.correct_pointing,
            exposure_s: settings.exposure_s,
            home: settings.home,
            dry_run: settings.dry_run,
            ..JobOptions::default()
        };
        let decider = settings.decider.decider()?;
        Ok(Self { folder: settings.folder.clone(), begin, decider, observer, options })
    }

    fn job<S: Stage, L: Laser, C: Camera>(
        self,
        drivers: Drivers<S, L, C>,
    ) -> PyResult<MachineJob<S, L, C>> {
        let Self { folder, begin, decider, observer, options } = self;
        let Some((target, radius_px, max_pulses, description)) = begin else {
            let storage = Box::new(JobFolder::open(folder).map_err(job_error)?);
            return MachineJob::resume(storage, decider, drivers, observer, options)
                .map_err(job_error);
        };
        let workpiece = Workpiece::new(&target).map_err(ablation_error)?;
        let job = Job::new(workpiece, radius_px, max_pulses).map_err(plan_error)?;
        let storage = Box::new(JobFolder::create(folder).map_err(job_error)?);
        MachineJob::begin(storage, &job, decider, drivers, observer, description, options)
            .map_err(job_error)
    }
}

/// Runs a job on a thread of its own, while this one passes its progress on and minds signals. A
/// signal stops the job; the report then says so.
fn run<S: Stage, L: Laser, C: Camera>(
    py: Python<'_>,
    prepared: Prepared,
    drivers: Drivers<S, L, C>,
    progress: Option<Py<PyAny>>,
) -> PyResult<JobReport> {
    let job = prepared.job(drivers)?;
    let stop = job.stop_flag();
    let (sender, events) = channel();
    let thread = std::thread::Builder::new()
        .name("job".to_owned())
        .spawn(move || {
            job.run(&mut |now| {
                // Nobody listens any more when the receiver has gone.
                match sender.send(ProgressParts::of(now)) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(_) => ControlFlow::Break(()),
                }
            })
        })
        .map_err(|error| exception("ThreadsError", error.to_string()))?;
    let events = Mutex::new(events);
    let next = || events.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(SIGNAL_CHECK);
    let mut failure = None;
    loop {
        let event = py.detach(next);
        if py.check_signals().is_err() {
            stop.store(true, Ordering::SeqCst);
        }
        match event {
            Ok(parts) => {
                if let Some(error) = tell(py, progress.as_ref(), parts, &stop) {
                    failure.get_or_insert(error);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let report = py.detach(|| thread.join());
    match (failure, report) {
        (Some(error), _) => Err(error),
        (None, Ok(report)) => report.map_err(job_error),
        (None, Err(_)) => Err(exception("JobFailedError", "the job's thread died".to_owned())),
    }
}

/// Tells the caller; what it raises stops the job.
fn tell(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    parts: ProgressParts,
    stop: &Arc<AtomicBool>,
) -> Option<PyErr> {
    let wanted = progress?.bind(py).call1((parts,)).and_then(|answer| answer.is_truthy());
    if !matches!(wanted, Ok(false)) {
        stop.store(true, Ordering::SeqCst);
    }
    wanted.err()
}

fn duration(name: &str, seconds: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| option_error(name, seconds, "at least 0, in seconds"))
}
