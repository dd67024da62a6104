//! Whole jobs on a machine whose truth is known.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

#[path = "../examples/faults/campaign.rs"]
mod campaign;
#[path = "../examples/faults/disk.rs"]
mod disk;
#[path = "../examples/faults/world.rs"]
mod world;

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use lasergym_ablation::{Footprint, Pulse, Workpiece, star};
use lasergym_geom::{Bitmap, Point};
use lasergym_machine::{
    Deadlines, FaultKind, Frame, JobDescription, JobError, JobFolder, JobOptions, JobProgress,
    JobReport, JobStatus, JobStorage, JournalVerdict, MachineJob, Observation, Observer,
    ObserverError, ObserverMaker, Record, Verdict, read_job,
};
use lasergym_plan::{
    AnnealBudget, Decider, FixedPlan, Greedy, Job, PolishOptions, Replanning, ReplanningOptions,
    Thinking,
};

use disk::Disk;
use world::{DEADLINE, Injection, Planned, Process, SharedWorld, TruthfulObserver};

const PULSES: usize = 6;

fn job() -> Job {
    Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, PULSES).unwrap()
}

fn greedy() -> Box<dyn Decider> {
    let polish = PolishOptions { range_px: 0.25, steps_per_px: 8 };
    Box::new(Greedy { ring_weight: 0.35, polish })
}

fn replanning() -> Box<dyn Decider> {
    let options = ReplanningOptions {
        first: AnnealBudget::Iterations(2000),
        thinking: Thinking::Moves(500),
        seed: 3,
    };
    Box::new(Replanning::new(options).unwrap())
}

fn options(process: &Process) -> JobOptions {
    JobOptions { dry_run: false, stop: Arc::clone(&process.stop), ..JobOptions::default() }
}

fn truthful(world: &SharedWorld) -> ObserverMaker {
    let world = world.clone();
    Box::new(move |_| Ok(Box::new(TruthfulObserver { world }) as Box<dyn Observer>))
}

/// Who does a job, and how.
struct Worker<'a> {
    world: &'a SharedWorld,
    decider: fn() -> Box<dyn Decider>,
    change: fn(&mut JobOptions),
}

impl<'a> Worker<'a> {
    fn new(world: &'a SharedWorld) -> Self {
        Self { world, decider: greedy, change: |_| () }
    }

    fn begin(&self, storage: impl JobStorage + 'static) -> Result<JobReport, JobError> {
        self.run(storage, false, &mut |_| ControlFlow::Continue(()))
    }

    fn resume(&self, storage: impl JobStorage + 'static) -> Result<JobReport, JobError> {
        self.run(storage, true, &mut |_| ControlFlow::Continue(()))
    }

    fn run(
        &self,
        storage: impl JobStorage + 'static,
        resume: bool,
        progress: &mut dyn FnMut(&JobProgress<'_>) -> ControlFlow<()>,
    ) -> Result<JobReport, JobError> {
        let process = self.world.start_process();
        let mut options = options(&process);
        (self.change)(&mut options);
        let (drivers, observer) = (process.drivers(), truthful(self.world));
        let (storage, decider) = (Box::new(storage), (self.decider)());
        let machine = if resume {
            MachineJob::resume(storage, decider, drivers, observer, options)
        } else {
            let description = JobDescription::default();
            MachineJob::begin(storage, &job(), decider, drivers, observer, description, options)
        };
        let report = machine.and_then(|machine| machine.run(progress));
        self.world.end_process();
        report
    }
}

/// The discs of all marks that a job knows.
fn known_marks(storage: &dyn JobStorage) -> Vec<Pulse> {
    let records = read_job(storage).unwrap().records;
    let observed = records.iter().filter_map(|record| match record {
        Record::Observed(observed) => Some(&observed.marks),
        _ => None,
    });
    observed.flatten().map(|mark| mark.disc()).collect()
}

fn marks(world: &SharedWorld) -> Vec<Pulse> {
    world.lock().marks().to_vec()
}

fn assert_no_violations(world: &SharedWorld) {
    assert!(world.lock().violations().is_empty(), "{:?}", world.lock().violations());
}

#[test]
fn a_job_knows_every_mark_and_reports_what_was_seen() {
    let world = SharedWorld::new(1, 0.0);
    let folder = tempfile::tempdir().unwrap();
    let mut told = 0;
    let report = Worker::new(&world)
        .run(JobFolder::create(folder.path()).unwrap(), false, &mut |progress| {
            told += 1;
            assert_eq!((progress.pulse, progress.verdict), (told, JournalVerdict::Seen));
            assert_eq!(progress.state.pulses_left(), PULSES - told);
            ControlFlow::Continue(())
        })
        .unwrap();
    assert_eq!((report.status, report.pulses, told), (JobStatus::PulsesUsed, PULSES, PULSES));
    let storage = JobFolder::open(folder.path()).unwrap();
    assert_eq!(known_marks(&storage), marks(&world));
    let mut workpiece = Workpiece::new(&star(0.0)).unwrap();
    let gain_px: i32 =
        marks(&world).iter().map(|&mark| workpiece.pulse(&Footprint::of(mark)).gain_px()).sum();
    assert!((report.reward - f64::from(gain_px) / 1e4).abs() < 1e-12);
    let record = read_job(&storage).unwrap();
    assert_eq!((record.status, record.damage), (Some(JobStatus::PulsesUsed), None));
    assert_eq!(fs::read_dir(folder.path().join("frames")).unwrap().count(), PULSES + 1);
    assert_no_violations(&world);
}

#[test]
fn a_job_that_has_ended_is_only_reported() {
    let world = SharedWorld::new(1, 0.0);
    let folder = tempfile::tempdir().unwrap();
    let worker = Worker::new(&world);
    let report = worker.begin(JobFolder::create(folder.path()).unwrap()).unwrap();
    let journal = fs::read(folder.path().join("journal.jsonl")).unwrap();
    let again = worker.resume(JobFolder::open(folder.path()).unwrap()).unwrap();
    assert_eq!((again.status, again.reward.to_bits()), (report.status, report.reward.to_bits()));
    assert_eq!(fs::read(folder.path().join("journal.jsonl")).unwrap(), journal);
    assert_eq!(marks(&world).len(), PULSES);
}

/// A process that dies at any of its calls, before or after what the call does, and is followed by
/// another, leaves the same marks as one that lives.
fn assert_death_changes_nothing(
    decider: fn() -> Box<dyn Decider>,
    step: usize,
    landing_error_px: Point,
) {
    let run = |death: Option<(u64, Injection)>, power_loss: bool| {
        let world = SharedWorld::new(1, 0.0);
        world.lock().bend(landing_error_px);
        let disk = Disk::new(&world);
        let worker = Worker { decider, ..Worker::new(&world) };
        if let Some((call, injection)) = death {
            world.lock().plan(Planned::Number(call), injection);
        }
        let mut ended = worker.begin(disk.clone());
        if world.lock().is_dead() {
            if power_loss {
                disk.lose_power();
            }
            ended = worker.resume(disk.clone());
            if matches!(ended, Err(JobError::NoJob { .. })) {
                assert!(marks(&world).is_empty());
                disk.clear();
                ended = worker.begin(disk.clone());
            }
        }
        assert_eq!(ended.unwrap().status, JobStatus::PulsesUsed);
        assert_eq!(known_marks(&disk), marks(&world));
        assert_no_violations(&world);
        let calls = world.lock().calls();
        (marks(&world), calls)
    };
    let (whole, calls) = run(None, false);
    assert_eq!(whole.len(), PULSES);
    for call in (1..=calls).step_by(step) {
        for injection in [Injection::Dies, Injection::DiesAfterwards] {
            let (pulses, _) = run(Some((call, injection)), call % 2 == 0);
            assert_eq!(pulses, whole, "{injection:?} at call {call} of {calls}");
        }
    }
}

#[test]
fn a_death_anywhere_changes_nothing() {
    assert_death_changes_nothing(greedy, 1, Point::default());
}

#[test]
fn a_death_anywhere_changes_nothing_of_what_was_learnt_about_the_stage() {
    assert_death_changes_nothing(greedy, 3, Point::new(1.25, -0.75));
}

#[test]
fn a_death_anywhere_changes_nothing_for_a_decider_with_memory() {
    assert_death_changes_nothing(replanning, 3, Point::default());
}

#[test]
fn pulses_that_land_beside_their_aim_are_sent_to_the_other_side() {
    let landing_error_px = Point::new(1.25, -0.75);
    let errors_px = |change: fn(&mut JobOptions)| {
        let world = SharedWorld::new(1, 0.0);
        world.lock().bend(landing_error_px);
        let disk = Disk::new(&world);
        Worker { change, ..Worker::new(&world) }.begin(disk.clone()).unwrap();
        assert_no_violations(&world);
        let aims = read_job(&disk).unwrap().records.into_iter().filter_map(|record| match record {
            Record::Intent(intent) => Some(Point::new(intent.x_px, intent.y_px)),
            _ => None,
        });
        let distance = |(mark, aim): (&Pulse, Point)| mark.position.distance(aim);
        marks(&world).iter().zip(aims).map(distance).collect::<Vec<_>>()
    };
    let uncorrected = errors_px(|options| options.correct_pointing = false);
    let whole_px = landing_error_px.distance(Point::default());
    assert!(uncorrected.iter().all(|error| (error - whole_px).abs() < 1e-9));
    let corrected = errors_px(|_| ());
    assert!((corrected[0] - whole_px).abs() < 1e-9);
    assert!(corrected[PULSES - 1] < 0.4 * whole_px, "{corrected:?}");
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to.join("frames")).unwrap();
    for entry in fs::read_dir(from.join("frames")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), to.join("frames").join(entry.file_name())).unwrap();
    }
    fs::copy(from.join("journal.jsonl"), to.join("journal.jsonl")).unwrap();
}

#[test]
fn pulses_that_a_damaged_journal_has_lost_are_found_on_the_workpiece() {
    let world = SharedWorld::new(1, 0.0);
    let whole = tempfile::tempdir().unwrap();
    let mut worker = Worker::new(&world);
    worker.begin(JobFolder::create(whole.path()).unwrap()).unwrap();
    let journal = fs::read(whole.path().join("journal.jsonl")).unwrap();
    let first_line = journal.iter().position(|&byte| byte == b'\n').unwrap();
    let is_boundary = |&place: &usize| journal[place - 1] == b'\n';
    let anywhere = (first_line + 1..journal.len() - 1).step_by(211);
    let places = anywhere.chain((first_line + 2..journal.len()).filter(is_boundary));
    let damaged = tempfile::tempdir().unwrap();
    worker.change = |options| options.max_commands = Some(3 * PULSES);
    for (k, place) in places.enumerate() {
        let path = damaged.path().join(k.to_string());
        copy_folder(whole.path(), &path);
        let mut bytes = journal.clone();
        if k % 2 == 0 || is_boundary(&place) {
            bytes.truncate(place);
        } else {
            bytes[place] ^= 4;
        }
        fs::write(path.join("journal.jsonl"), bytes).unwrap();
        let report = worker.resume(JobFolder::open(&path).unwrap()).unwrap();
        assert_eq!((report.status, report.pulses), (JobStatus::PulsesUsed, PULSES));
        assert_eq!(known_marks(&JobFolder::open(&path).unwrap()), marks(&world));
        assert_eq!(marks(&world).len(), PULSES);
        assert!(path.join("journal.damaged-0").exists() || is_boundary(&place));
    }
    assert_no_violations(&world);
}

#[test]
fn a_dry_run_does_everything_but_fire() {
    let world = SharedWorld::new(1, 0.0);
    let disk = Disk::new(&world);
    let worker = Worker { change: |options| options.dry_run = true, ..Worker::new(&world) };
    let report = worker.begin(disk.clone()).unwrap();
    assert_eq!((report.status, report.dry_run), (JobStatus::PulsesUsed, true));
    assert!(marks(&world).is_empty());
    assert!(report.machined_fraction > 0.2);
    let live = Worker::new(&world).resume(disk);
    assert!(matches!(live, Err(JobError::DifferentJob { name: "dry_run", .. })));
}

#[test]
fn a_dry_run_goes_on_where_it_was_stopped() {
    let plan = |stop_after: usize| {
        let world = SharedWorld::new(1, 0.0);
        let disk = Disk::new(&world);
        let worker = Worker { change: |options| options.dry_run = true, ..Worker::new(&world) };
        let mut progress = |progress: &JobProgress<'_>| {
            if progress.pulse == stop_after {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let report = worker.run(disk.clone(), false, &mut progress).unwrap();
        if report.status == JobStatus::Interrupted {
            worker.resume(disk.clone()).unwrap();
        }
        known_marks(&disk)
    };
    assert_eq!(plan(3), plan(100));
}

#[test]
fn a_user_who_stops_a_job_can_go_on_later() {
    let world = SharedWorld::new(1, 0.0);
    let disk = Disk::new(&world);
    let worker = Worker::new(&world);
    world.lock().plan(Planned::Name("fire"), Injection::Interrupts);
    let report = worker.begin(disk.clone()).unwrap();
    assert_eq!(report.status, JobStatus::Interrupted);
    let report = worker.resume(disk.clone()).unwrap();
    assert_eq!((report.status, report.resumed), (JobStatus::PulsesUsed, 1));
    assert_eq!(known_marks(&disk), marks(&world));
    assert_eq!(marks(&world).len(), PULSES);
}

#[test]
fn faults_have_names_and_leave_nothing_lost_or_doubled() {
    use Injection::{
        Fails, FailsAfterwards, Hangs, HangsFirst, Lies, LiesDifferently, LiesOtherwise, Panics,
    };
    for (call, injection, kind) in [
        ("home", Fails, FaultKind::Other),
        ("move_to", Hangs, FaultKind::Timeout),
        ("move_to", Fails, FaultKind::Other),
        ("position_um", Lies, FaultKind::NotFinite),
        ("arm", FailsAfterwards, FaultKind::Other),
        ("fire", FailsAfterwards, FaultKind::Other),
        ("fire", HangsFirst, FaultKind::Timeout),
        ("fire", Panics, FaultKind::Other),
        ("frame", Lies, FaultKind::StaleFrame),
        ("frame", LiesOtherwise, FaultKind::Protocol),
        ("frame", LiesDifferently, FaultKind::Protocol),
        ("observe", Fails, FaultKind::Protocol),
        ("observe", LiesOtherwise, FaultKind::Protocol),
        ("observe", LiesDifferently, FaultKind::Protocol),
    ] {
        let world = SharedWorld::new(1, 0.0);
        let disk = Disk::new(&world);
        world.lock().plan(Planned::Name(call), injection);
        let mut worker = Worker::new(&world);
        if matches!(injection, Hangs | HangsFirst) {
            worker.change = |options| {
                options.deadlines =
                    Deadlines { move_to: DEADLINE, laser: DEADLINE, ..Deadlines::default() };
            };
        }
        let report = worker.begin(disk.clone()).unwrap();
        assert_eq!(report.status, JobStatus::Fault, "{call} {injection:?}");
        assert_eq!(report.faults.last().unwrap().fault, kind, "{call} {injection:?}");
        worker.change = |_| ();
        let report = worker.resume(disk.clone()).unwrap();
        assert_eq!(report.status, JobStatus::PulsesUsed, "{call} {injection:?}");
        assert_eq!(known_marks(&disk), marks(&world));
        assert_no_violations(&world);
    }
}

#[test]
fn a_camera_that_changes_its_frames_is_noticed() {
    let world = SharedWorld::new(1, 0.0);
    let disk = Disk::new(&world);
    let worker = Worker::new(&world);
    let report = worker
        .run(disk.clone(), false, &mut |_| {
            world.lock().plan(Planned::Name("frame"), Injection::LiesOtherwise);
            ControlFlow::Continue(())
        })
        .unwrap();
    assert_eq!(report.faults.last().unwrap().fault, FaultKind::Protocol);
}

#[test]
fn a_stage_that_comes_to_rest_elsewhere_is_sent_again_and_no_pulse_is_fired_there() {
    let world = SharedWorld::new(1, 0.0);
    world.lock().plan(Planned::Name("move_to"), Injection::Lies);
    let report = Worker::new(&world).begin(Disk::new(&world)).unwrap();
    assert_eq!(report.status, JobStatus::PulsesUsed);
    assert_no_violations(&world);
}

#[test]
fn a_misfire_is_made_up_for_and_a_double_fire_counts_twice_on_the_workpiece() {
    for (injection, commands, marks_left) in
        [(Injection::Lies, PULSES + 1, PULSES), (Injection::LiesOtherwise, PULSES, PULSES + 1)]
    {
        let world = SharedWorld::new(1, 0.0);
        let disk = Disk::new(&world);
        world.lock().plan(Planned::Name("fire"), injection);
        let report = Worker::new(&world).begin(disk.clone()).unwrap();
        assert_eq!((report.status, report.commands), (JobStatus::PulsesUsed, commands));
        assert_eq!((report.pulses, marks(&world).len()), (PULSES, marks_left));
        assert_eq!(known_marks(&disk), marks(&world));
    }
}

/// Says a verdict once and then the other one, whatever it sees.
struct Stubborn {
    first: Verdict,
    then: Verdict,
}

impl Observer for Stubborn {
    fn observe(
        &mut self,
        _: &Frame,
        _: &Frame,
        aimed_px: Point,
    ) -> Result<Observation, ObserverError> {
        let mark = lasergym_machine::Mark { center_px: aimed_px, radius_px: 9.0, confidence: 0.4 };
        let verdict = std::mem::replace(&mut self.first, self.then);
        let marks = if verdict == Verdict::Nothing { Vec::new() } else { vec![mark] };
        Ok(Observation { verdict, marks, shift_px: Point::default() })
    }
}

fn run_stubborn(verdict: Verdict, change: fn(&mut JobOptions)) -> JobReport {
    run_seen_by(Stubborn { first: verdict, then: verdict }, greedy(), change)
}

fn run_seen_by(
    observer: Stubborn,
    decider: Box<dyn Decider>,
    change: fn(&mut JobOptions),
) -> JobReport {
    let world = SharedWorld::new(1, 0.0);
    let process = world.start_process();
    let observer: ObserverMaker = Box::new(move |_| Ok(Box::new(observer) as Box<dyn Observer>));
    let mut options = options(&process);
    change(&mut options);
    let storage = Box::new(Disk::new(&world));
    let (drivers, description) = (process.drivers(), JobDescription::default());
    let machine =
        MachineJob::begin(storage, &job(), decider, drivers, observer, description, options);
    machine.unwrap().run(&mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn pulse_after_pulse_that_leaves_nothing_means_a_dead_laser() {
    let report = run_stubborn(Verdict::Nothing, |options| options.unseen_limit = 4);
    assert_eq!((report.commands, report.unseen, report.pulses), (4, 4, 0));
    assert_eq!(report.faults.last().unwrap().fault, FaultKind::LaserDead);
    assert!(report.given_up_px > 200, "after three in vain the fourth went elsewhere");
    assert_eq!(report.machined_fraction.to_bits(), 0.0_f64.to_bits());
}

#[test]
fn pulses_on_machined_ground_say_nothing_about_the_laser() {
    let again = FixedPlan::new(vec![Point::new(50.0, 50.0); 7]).unwrap();
    let observer = Stubborn { first: Verdict::Seen, then: Verdict::Nothing };
    let report = run_seen_by(observer, Box::new(again), |options| options.unseen_limit = 4);
    assert_eq!((report.commands, report.unseen), (7, 6));
    assert!(report.faults.is_empty(), "{:?}", report.faults);
}

#[test]
fn what_stays_uncertain_after_all_looks_is_never_counted_as_machined() {
    let report = run_stubborn(Verdict::Uncertain, |_| ());
    assert_eq!((report.status, report.uncertain), (JobStatus::PulsesUsed, PULSES));
    assert_eq!(report.looks, 3 * PULSES);
    assert_eq!(report.machined_fraction.to_bits(), 0.0_f64.to_bits());
    assert!(report.given_up_px > 0);
}

#[test]
fn commands_are_limited_even_where_the_laser_never_counts_as_dead() {
    let report = run_stubborn(Verdict::Nothing, |options| options.unseen_limit = 1000);
    assert_eq!((report.status, report.commands), (JobStatus::CommandsUsed, 2 * PULSES + 10));
}

#[test]
fn an_open_loop_fires_its_plan_and_no_more() {
    let world = SharedWorld::new(1, 0.0);
    let worker = Worker {
        decider: || {
            Box::new(FixedPlan::new(vec![Point::new(50.0, 50.0), Point::new(60.0, 50.0)]).unwrap())
        },
        ..Worker::new(&world)
    };
    let report = worker.begin(Disk::new(&world)).unwrap();
    assert_eq!((report.status, report.commands), (JobStatus::NothingToGain, 2));
}

#[test]
fn a_job_is_complete_when_as_much_is_machined_as_was_asked_for() {
    let world = SharedWorld::new(1, 0.0);
    let worker = Worker { change: |options| options.completion = 0.1, ..Worker::new(&world) };
    let report = worker.begin(Disk::new(&world)).unwrap();
    assert_eq!(report.status, JobStatus::Complete);
    assert!(report.machined_fraction >= 0.1 && report.pulses < PULSES);
}

#[test]
fn a_stop_flag_that_is_set_before_keeps_everything_still() {
    let world = SharedWorld::new(1, 0.0);
    let worker = Worker {
        change: |options| options.stop.store(true, Ordering::SeqCst),
        ..Worker::new(&world)
    };
    let report = worker.begin(Disk::new(&world)).unwrap();
    assert_eq!((report.status, report.commands), (JobStatus::Interrupted, 0));
    assert!(marks(&world).is_empty());
}

#[test]
fn a_workpiece_that_is_machined_already_is_refused() {
    let world = SharedWorld::new(1, 0.0);
    let process = world.start_process();
    let mut workpiece = Workpiece::new(&star(0.0)).unwrap();
    workpiece.pulse(&job().footprint(Point::new(50.0, 50.0)));
    let job = Job::new(workpiece, 9.0, 3).unwrap();
    let begun = MachineJob::begin(
        Box::new(Disk::new(&world)),
        &job,
        greedy(),
        process.drivers(),
        truthful(&world),
        JobDescription::default(),
        options(&process),
    );
    assert!(matches!(begun.err(), Some(JobError::NotPristine)));
}

#[test]
fn a_missing_frame_is_named() {
    let world = SharedWorld::new(1, 0.0);
    let folder = tempfile::tempdir().unwrap();
    let worker = Worker::new(&world);
    let stop = &mut |_: &JobProgress<'_>| ControlFlow::Break(());
    worker.run(JobFolder::create(folder.path()).unwrap(), false, stop).unwrap();
    fs::remove_file(folder.path().join("frames/0001.png")).unwrap();
    let error = worker.resume(JobFolder::open(folder.path()).unwrap()).unwrap_err();
    assert!(matches!(error, JobError::Frame { ref file, .. } if file == "frames/0001.png"));
}

#[test]
fn the_state_of_a_journal_is_that_of_its_marks() {
    let world = SharedWorld::new(1, 0.0);
    let disk = Disk::new(&world);
    Worker::new(&world).begin(disk.clone()).unwrap();
    let mut state = greedy().start(&job());
    for record in read_job(&disk).unwrap().records {
        if let Record::Observed(observed) = record {
            for mark in observed.marks {
                state.machine(&Footprint::of(mark.disc()));
            }
            assert_eq!(observed.state_hash, format!("{:016x}", state.hash()));
        }
    }
    assert_ne!(state.workpiece().remaining(), &Bitmap::EMPTY);
}

#[test]
fn a_short_campaign_of_faults_breaks_no_promise() {
    let tally = campaign::run_campaign(300, 7, |_| ());
    assert!(tally.violations.is_empty(), "{:?}", tally.violations);
    assert!(tally.deaths > 10 && tally.marks > 50 && tally.processes > tally.jobs);
    assert!(tally.faults() >= 300 && !tally.injected.is_empty());
}

#[test]
fn settings_out_of_range_are_refused_before_anything_is_written() {
    let world = SharedWorld::new(1, 0.0);
    let disk = Disk::new(&world);
    let worker =
        Worker { change: |options| options.settle_wait = Duration::ZERO, ..Worker::new(&world) };
    assert!(worker.begin(disk.clone()).is_ok());
    let other = Disk::new(&world);
    let worker = Worker { change: |options| options.looks = 0, ..Worker::new(&world) };
    let refused = worker.begin(other.clone());
    assert!(matches!(refused, Err(JobError::InvalidOption { name: "looks", .. })));
    assert!(other.read_journal().unwrap().is_empty());
}
