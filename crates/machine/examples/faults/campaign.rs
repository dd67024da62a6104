//! Jobs on a machine that fails all the time, and what must hold all the same.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;

use lasergym_ablation::{Footprint, Pulse, PulseOutcome, Stream, Workpiece, random_shape};
use lasergym_geom::Point;
use lasergym_machine::{
    Deadlines, JobDescription, JobError, JobOptions, JobReport, JobStatus, JournalVerdict,
    MachineJob, Observer, ObserverMaker, Record, read_job,
};
use lasergym_plan::{Decider, Greedy, Job, JobState, PlanError, PolishOptions};

use crate::disk::Disk;
use crate::world::{DEADLINE, Injection, RADIUS_PX, SharedWorld, TruthfulObserver};

/// Chance that a usual call goes wrong.
const CHANCE: f64 = 0.02;

/// Chance that the journal decays while no process works on it.
const DECAY_CHANCE: f64 = 0.03;

/// Processes after which nothing goes wrong any more, so that every job ends.
const TROUBLED_PROCESSES: usize = 60;

/// What has happened in a campaign.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) jobs: usize,
    pub(crate) processes: usize,
    pub(crate) deaths: usize,
    pub(crate) decays: usize,
    pub(crate) marks: usize,
    pub(crate) injected: BTreeMap<(&'static str, Injection), u64>,
    /// What must never happen.
    pub(crate) violations: Vec<String>,
}

impl Tally {
    pub(crate) fn faults(&self) -> u64 {
        self.injected.values().sum::<u64>() + self.decays as u64
    }
}

/// Does jobs until `faults` have been injected.
pub(crate) fn run_campaign(faults: u64, seed: u64, mut progress: impl FnMut(&Tally)) -> Tally {
    let mut tally = Tally::default();
    while tally.faults() < faults {
        let job_seed = seed.wrapping_mul(1_000_003).wrapping_add(tally.jobs as u64);
        if let Err(reason) = run_job(job_seed, &mut tally) {
            tally.violations.push(format!("job {job_seed}: {reason}"));
        }
        tally.jobs += 1;
        progress(&tally);
    }
    tally
}

/// Greedy that sometimes wants what no machine may do.
struct WildDecider {
    greedy: Greedy,
    world: SharedWorld,
}

impl Decider for WildDecider {
    fn ring_weight(&self) -> f64 {
        self.greedy.ring_weight
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        let kinds = [Injection::Fails, Injection::Lies, Injection::LiesOtherwise];
        match self.world.lock().draw_from("decide", &kinds, &[]) {
            Some(Injection::Fails) => Err(PlanError::NothingRemains),
            Some(Injection::Lies) => Ok(Some(Point::new(f64::NAN, 3.0))),
            Some(_) => Ok(Some(Point::new(104.0, 50.0))),
            None => self.greedy.decide(state),
        }
    }
}

fn options(stop: Arc<std::sync::atomic::AtomicBool>) -> JobOptions {
    JobOptions {
        dry_run: false,
        settle_wait: Duration::from_micros(10),
        exposure_s: Some(0.01),
        unseen_limit: 4,
        deadlines: Deadlines {
            home: DEADLINE,
            move_to: DEADLINE,
            stage: DEADLINE,
            laser: DEADLINE,
            camera: DEADLINE,
        },
        stop,
        ..JobOptions::default()
    }
}

fn run_job(seed: u64, tally: &mut Tally) -> Result<(), String> {
    let target = random_shape(&mut Stream::from_seed(seed)).target;
    let workpiece = Workpiece::new(&target).map_err(|error| error.to_string())?;
    let job = Job::new(workpiece, RADIUS_PX, 8).map_err(|error| error.to_string())?;
    let world = SharedWorld::new(seed, CHANCE);
    let disk = Disk::new(&world);
    let mut begun = false;
    let mut processes = 0;
    let mut last = String::new();
    let report = loop {
        processes += 1;
        if processes > TROUBLED_PROCESSES {
            world.lock().set_chance(0.0);
        }
        if processes > TROUBLED_PROCESSES + 10 {
            return Err(format!("it does not end, though nothing fails any more: {last}"));
        }
        let ended = run_process(&world, &disk, &job, begun);
        last = match &ended {
            Ok(report) => format!("{:?} {:?}", report.status, report.faults.last()),
            Err(error) => error.to_string(),
        };
        world.end_process();
        if world.lock().is_dead() {
            tally.deaths += 1;
            if world.lock().uniform() < 0.5 {
                disk.lose_power();
            }
        }
        match ended {
            Ok(report) if report.status.is_final() => break report,
            Ok(report) if report.status == JobStatus::CommandsUsed => break report,
            // The process went as far as the first record.
            Ok(_) | Err(JobError::Storage { .. }) => begun = true,
            Err(JobError::NoJob { .. }) if !begun || world.lock().marks().is_empty() => {
                disk.clear();
                begun = false;
            }
            Err(error) => return Err(error.to_string()),
        }
        if begun && processes < TROUBLED_PROCESSES && world.lock().uniform() < DECAY_CHANCE {
            disk.decay();
            tally.decays += 1;
        }
    };
    tally.processes += processes;
    tally.marks += world.lock().marks().len();
    for (&kind, &number) in world.lock().injected() {
        *tally.injected.entry(kind).or_default() += number;
    }
    judge(&world, &disk, &job, &report)
}

fn run_process(
    world: &SharedWorld,
    disk: &Disk,
    job: &Job,
    begun: bool,
) -> Result<JobReport, JobError> {
    let process = world.start_process();
    let greedy =
        Greedy { ring_weight: 0.35, polish: PolishOptions { range_px: 0.25, steps_per_px: 8 } };
    let decider = Box::new(WildDecider { greedy, world: world.clone() });
    let storage = Box::new(disk.clone());
    let eyes = world.clone();
    let observer: ObserverMaker =
        Box::new(move |_| Ok(Box::new(TruthfulObserver { world: eyes }) as Box<dyn Observer>));
    let options = options(Arc::clone(&process.stop));
    let drivers = process.drivers();
    let machine = if begun {
        MachineJob::resume(storage, decider, drivers, observer, options)?
    } else {
        let description = JobDescription::default();
        MachineJob::begin(storage, job, decider, drivers, observer, description, options)?
    };
    machine.run(&mut |_| ControlFlow::Continue(()))
}

/// What must hold in the end: the journal knows every mark of the world once, and the report counts
/// those that were seen.
fn judge(world: &SharedWorld, disk: &Disk, job: &Job, report: &JobReport) -> Result<(), String> {
    let world = world.lock();
    if let Some(violation) = world.violations().first() {
        return Err(violation.clone());
    }
    let record = read_job(disk).map_err(|error| error.to_string())?;
    if let Some(damage) = record.damage {
        return Err(format!("the journal ends with damage: {damage}"));
    }
    let mut known: Vec<Pulse> = Vec::new();
    let mut workpiece = job.workpiece().clone();
    let mut machined = PulseOutcome::default();
    let mut pending = None;
    for record in &record.records {
        match record {
            Record::Intent(intent) => pending = Some(intent.pulse),
            Record::Observed(observed) => {
                if pending.take() != Some(observed.pulse) {
                    return Err(format!("pulse {} was observed twice", observed.pulse));
                }
                for mark in &observed.marks {
                    known.push(mark.disc());
                    if observed.verdict == JournalVerdict::Seen {
                        machined = machined + workpiece.pulse(&Footprint::of(mark.disc()));
                    }
                }
            }
            _ => {}
        }
    }
    if let Some(pulse) = pending {
        return Err(format!("pulse {pulse} has no outcome"));
    }
    let key =
        |pulse: &Pulse| [pulse.position.x, pulse.position.y, pulse.radius_px].map(f64::to_bits);
    let mut known: Vec<_> = known.iter().map(key).collect();
    let mut marks: Vec<_> = world.marks().iter().map(key).collect();
    known.sort_unstable();
    marks.sort_unstable();
    if known != marks {
        return Err(format!("{} marks, but the journal knows {}", marks.len(), known.len()));
    }
    if report.reward.to_bits() != machined.reward().to_bits() {
        return Err(format!("reward {} instead of {}", report.reward, machined.reward()));
    }
    Ok(())
}
