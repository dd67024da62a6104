//! How well marks are found: random jobs on a simulated rig, pulses placed by the greedy planner
//! plus the errors of the stage, seen through a camera that was calibrated with test pulses.
//!
//! A pulse that is uncertain is looked at up to twice more, as a job does. A mark that newly
//! machines at least 10 px (4 % of a mark) must be seen; it is missed when no mark is seen within
//! 3 px of it. A mark is false when it is seen and no new mark lies within 3 px. Errors are those
//! of all marks that are neither, however little they machine, in the coordinates of the reference
//! frame; the absolute ones include where the stage stood for that frame. 1 px is 1 µm.
//!
//! `cargo run --release -p lasergym-machine --example detection -- [PRESET] [PULSES] [SEED]`
//!
//! `… -- [PRESET] [PULSES] [SEED] --dump FOLDER N` also writes the first N pairs of frames as PNG
//! with `truth.csv`.

use std::error::Error;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use lasergym_ablation::{Footprint, Pulse, Stream, Workpiece, random_shape};
use lasergym_geom::{Bitmap, Point};
use lasergym_machine::simulator::{IMAGING_POSITION_UM, Preset, Rig, TrueMark};
use lasergym_machine::vision::{Vision, VisionOptions};
use lasergym_machine::{
    CalibrationOptions, CalibrationRun, Camera, CameraCalibration, Frame, Laser, Mark, Observation,
    Observer, Stage, Verdict,
};
use lasergym_plan::{Greedy, Job, Planner};

/// Seeds of the shapes that are kept for measurements.
const FIRST_SEED: u64 = 2_000_000_000;

/// A mark that newly machines this many pixels must be seen.
const MUST_SEE_PX: u32 = 10;

/// A mark found within this distance of a true one is that one, px.
const SAME_MARK_PX: f64 = 3.0;

/// Looks at a pulse that is uncertain.
const MAX_LOOKS: usize = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let dump = match arguments.iter().position(|argument| argument == "--dump") {
        Some(at) => {
            let rest = arguments.split_off(at);
            let [_, folder, pairs] = rest.as_slice() else {
                return Err("give a folder and a number of pairs after --dump".into());
            };
            Some(Dump::create(Path::new(folder), pairs.parse()?)?)
        }
        None => None,
    };
    let preset: Preset = arguments.first().map_or(Ok(Preset::Lab), |text| text.parse())?;
    let pulses: usize = arguments.get(1).map_or(Ok(10_000), |text| text.parse())?;
    let seed: u64 = arguments.get(2).map_or(Ok(FIRST_SEED), |text| text.parse())?;

    let calibration = calibration(preset, seed)?;
    println!(
        "{} preset, jobs from seed {seed}; calibration residual {:.3} µm from {} test pulses",
        preset.name(),
        calibration.residual_um(),
        calibration.pairs()
    );
    let mut figures = Figures { dump, ..Figures::default() };
    for job_seed in seed.. {
        if figures.pulses >= pulses {
            break;
        }
        run_job(preset, job_seed, &calibration, pulses, &mut figures)?;
    }
    figures.print();
    Ok(())
}

/// The camera's calibration by test pulses on another piece of ground.
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
    calibration: &CameraCalibration,
    pulses: usize,
    figures: &mut Figures,
) -> Result<(), Box<dyn Error>> {
    let target = random_shape(&mut Stream::from_seed(seed)).target;
    let plan = Greedy::default().plan_to_end(&Job::new(Workpiece::new(&target)?, 9.0, 45)?)?;
    let rig = Rig::new(preset.options(), seed)?;
    let (mut stage, mut laser, mut camera) = (rig.stage(), rig.laser(), rig.camera());
    laser.arm()?;
    let mut before = camera.frame()?;
    let origin = rig.frame_displacement_um();
    let mut vision = Vision::new(calibration.clone(), &before, VisionOptions::default())?;
    let mut machined = Bitmap::EMPTY;
    let mut marks_before = 0;
    for &position in &plan.positions {
        if figures.pulses >= pulses {
            break;
        }
        stage.move_to(position)?;
        laser.fire()?;
        stage.move_to(IMAGING_POSITION_UM)?;
        let mut after = camera.frame()?;
        let first_look = (after.clone(), rig.frame_displacement_um());
        let mut looks = 1;
        let observation = loop {
            let start = OnCore::now();
            let observation = vision.observe(&before, &after, position)?;
            figures.times_s.push(start.elapsed_s());
            if observation.verdict != Verdict::Uncertain || looks == MAX_LOOKS {
                break observation;
            }
            after = camera.frame()?;
            looks += 1;
        };
        let marks = rig.true_marks();
        let truths: Vec<Truth> = marks[marks_before..]
            .iter()
            .map(|&mark| Truth { mark, new_px: machine(&mut machined, mark), origin })
            .collect();
        marks_before = marks.len();
        if let Some(dump) = &mut figures.dump {
            dump.write(&before, &first_look.0, first_look.1, &rig.true_calibration(), &truths)?;
        }
        figures.judge(&truths, &observation, looks);
        before = after;
    }
    Ok(())
}

/// A moment in the time that this thread has run: what other programs take does not count, where
/// the system tells (Linux). Elsewhere a moment of the clock.
struct OnCore {
    ran_ns: Option<u64>,
    at: Instant,
}

impl OnCore {
    fn now() -> Self {
        // The system counts up to the last time that it looked at this thread.
        std::thread::yield_now();
        let ran_ns = fs::read_to_string("/proc/thread-self/schedstat")
            .ok()
            .and_then(|text| text.split(' ').next()?.parse().ok());
        Self { ran_ns, at: Instant::now() }
    }

    fn elapsed_s(&self) -> f64 {
        match (self.ran_ns, Self::now().ran_ns) {
            (Some(start), Some(end)) => (end - start) as f64 * 1e-9,
            _ => self.at.elapsed().as_secs_f64(),
        }
    }
}

/// Machines a mark and tells how many pixels are new.
fn machine(machined: &mut Bitmap, mark: TrueMark) -> u32 {
    let pulse = Pulse { position: mark.center_px(), radius_px: mark.radius_px };
    let footprint = Footprint::of(pulse);
    let (first_row, spans) = footprint.rows();
    let mut new_px = 0;
    for (row, span) in machined.rows_mut()[first_row..].iter_mut().zip(spans) {
        new_px += (span.mask() & !*row).count_ones();
        *row |= span.mask();
    }
    new_px
}

/// A mark that was made, and how it should look.
struct Truth {
    mark: TrueMark,
    new_px: u32,
    /// Where the stage really was when the reference frame was taken, beside the imaging position.
    origin: Point,
}

impl Truth {
    /// Its centre in the coordinates of the reference frame.
    fn center_px(&self) -> Point {
        self.mark.center_px() - self.origin
    }
}

#[derive(Default)]
struct Figures {
    pulses: usize,
    /// Marks that must be seen, and those of them that were not.
    must_see: usize,
    missed: usize,
    /// Marks that were seen, and those of them that are none.
    seen: usize,
    falsely: usize,
    /// Pulses that were uncertain at first and at the end.
    uncertain_first: usize,
    uncertain_last: usize,
    /// Marks that need not be seen, and those of them that were.
    slight: usize,
    slight_seen: usize,
    center_squares: Vec<f64>,
    absolute_squares: f64,
    radius_squares: f64,
    times_s: Vec<f64>,
    dump: Option<Dump>,
}

impl Figures {
    fn judge(&mut self, truths: &[Truth], observation: &Observation, looks: usize) {
        self.pulses += 1;
        self.uncertain_first += usize::from(looks > 1);
        let mut free: Vec<&Truth> = truths.iter().collect();
        if observation.verdict == Verdict::Uncertain {
            self.uncertain_last += 1;
        }
        if observation.verdict == Verdict::Seen {
            for mark in &observation.marks {
                self.seen += 1;
                let distance = |truth: &Truth| truth.center_px().distance(mark.center_px);
                let nearest = (0..free.len())
                    .min_by(|&a, &b| distance(free[a]).total_cmp(&distance(free[b])))
                    .filter(|&k| distance(free[k]) <= SAME_MARK_PX);
                let Some(nearest) = nearest else {
                    self.falsely += 1;
                    continue;
                };
                let truth = free.swap_remove(nearest);
                self.center_squares.push(distance(truth).powi(2));
                self.absolute_squares += truth.mark.center_px().distance(mark.center_px).powi(2);
                self.radius_squares += (truth.mark.radius_px - mark.radius_px).powi(2);
                self.slight_seen += usize::from(truth.new_px < MUST_SEE_PX);
            }
        }
        self.must_see += truths.iter().filter(|truth| truth.new_px >= MUST_SEE_PX).count();
        self.slight += truths.iter().filter(|truth| truth.new_px < MUST_SEE_PX).count();
        let unseen = |truth: &&Truth| {
            let near = |mark: &Mark| truth.center_px().distance(mark.center_px) <= SAME_MARK_PX;
            truth.new_px >= MUST_SEE_PX
                && !(observation.verdict == Verdict::Seen && observation.marks.iter().any(near))
        };
        self.missed += truths.iter().filter(unseen).count();
    }

    fn print(mut self) {
        let count = self.center_squares.len().max(1) as f64;
        let rms = |squares: f64| (squares / count).sqrt();
        let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        self.times_s.sort_by(f64::total_cmp);
        let time_ms = |part: f64| {
            let at = (part * (self.times_s.len() - 1) as f64) as usize;
            1e3 * self.times_s.get(at).copied().unwrap_or(f64::NAN)
        };
        println!("pulses            {}", self.pulses);
        println!("centre RMS        {:.3} px", rms(self.center_squares.iter().sum()));
        println!("  absolute        {:.3} px", rms(self.absolute_squares));
        println!("radius RMS        {:.3} px", rms(self.radius_squares));
        println!(
            "missed            {:.3} % ({} of {} marks with at least {MUST_SEE_PX} new px)",
            percent(self.missed, self.must_see),
            self.missed,
            self.must_see
        );
        println!(
            "false             {:.3} % ({} of {} seen)",
            percent(self.falsely, self.seen),
            self.falsely,
            self.seen
        );
        println!(
            "uncertain         {:.3} % at first, {:.3} % at last",
            percent(self.uncertain_first, self.pulses),
            percent(self.uncertain_last, self.pulses)
        );
        println!(
            "slight marks seen {:.1} % ({} of {} with fewer new px)",
            percent(self.slight_seen, self.slight),
            self.slight_seen,
            self.slight
        );
        println!(
            "time for a pair   {:.3} ms (median), {:.3} ms (99 %) on one core",
            time_ms(0.5),
            time_ms(0.99)
        );
    }
}

/// Pairs of frames for other programs.
struct Dump {
    folder: PathBuf,
    truth: File,
    left: usize,
    written: usize,
}

impl Dump {
    fn create(folder: &Path, pairs: usize) -> Result<Self, Box<dyn Error>> {
        fs::create_dir_all(folder)?;
        let mut truth = File::create(folder.join("truth.csv"))?;
        writeln!(truth, "pair,x_frame_px,y_frame_px,radius_frame_px,new_px,frame_px_per_px")?;
        Ok(Self { folder: folder.to_owned(), truth, left: pairs, written: 0 })
    }

    /// Writes a pair and the marks that were made between, where the frame after them shows them.
    /// `displacement_um` is how far the stage was from the imaging position for it.
    fn write(
        &mut self,
        before: &Frame,
        after: &Frame,
        displacement_um: Point,
        calibration: &CameraCalibration,
        truths: &[Truth],
    ) -> Result<(), Box<dyn Error>> {
        if self.left == 0 {
            return Ok(());
        }
        self.left -= 1;
        let pair = self.written;
        self.written += 1;
        for (name, frame) in [("before", before), ("after", after)] {
            let path = self.folder.join(format!("{pair:05}_{name}.png"));
            let (width, height) = (frame.width_px() as u32, frame.height_px() as u32);
            image::save_buffer(path, frame.gray(), width, height, image::ColorType::L8)?;
        }
        let scale = calibration.scale_frame_px_per_um();
        for truth in truths {
            let center = calibration.frame_px(truth.mark.center_px() - displacement_um);
            let radius = truth.mark.radius_px * scale;
            writeln!(
                self.truth,
                "{pair},{},{},{radius},{},{scale}",
                center.x, center.y, truth.new_px
            )?;
        }
        Ok(())
    }
}
