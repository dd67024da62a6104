//! Robot and scanner programs played together, and judged by what the beam does on the workpiece.
//!
//! The simulation reads programs and the task; plans, scan circles and the functions of lines are
//! unknown to it. The robot runs from rest to rest in its own cycles and starts the lists of the
//! scanner where its program says so; from then on the scanner runs on its own clock. The beam on the
//! workpiece is the sum of both, in space.

use std::collections::HashSet;

use crate::plane::{PlaneFrame, distance_mm};
use crate::robot_simulation::{IdleRun, LineRun, run_robot};
use crate::seam_gauge::SeamGauge;
use crate::{Plane, RemoteError, RemoteTask, RobotProgram, ScannerProgram};
use lasergym_geom::Point;

/// Largest distance of the beam from its seam that is accepted, mm.
pub const MAX_SEAM_ERROR_MM: f64 = 0.05;

/// Largest part by which the speed on the workpiece may differ, unless the task's
/// `clock_tolerance` is larger.
pub const MAX_SPEED_ERROR: f64 = 0.01;

/// The state of robot and beam at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionSample {
    /// Time, s.
    pub time_s: f64,
    /// Centre of the working field in the frame of the robot, mm.
    pub robot_mm: [f64; 3],
    /// The beam on the workpiece, in the frame of the robot, mm.
    pub beam_mm: [f64; 3],
    /// The beam in the working field, mm.
    pub field_mm: Point,
    /// Whether the laser is on.
    pub laser: bool,
}

/// What programs do on the workpiece.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationReport {
    /// Time of everything, s.
    pub total_s: f64,
    /// Time with the laser on, s.
    pub laser_s: f64,
    /// Largest distance of the beam from its seam, mm.
    pub max_seam_error_mm: f64,
    /// Largest difference of the speed on the workpiece from what its process asks for, as a part of it.
    pub max_speed_error: f64,
    /// Largest distance of the beam from the centre of the field with the laser on, mm.
    pub max_field_mm: f64,
    /// Highest speed of the robot on a line, mm/s.
    pub max_robot_speed_mm_s: f64,
    /// What is not as it should be, in words; empty where the programs are good.
    pub problems: Vec<String>,
    /// States at regular times, where they were asked for.
    pub samples: Vec<MotionSample>,
}

impl SimulationReport {
    /// Whether the programs do what the task asks for.
    #[must_use]
    pub fn is_good(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Plays `robot` and `scanner` together and compares them with `task`. States are recorded every
/// `sample_s` seconds, where that is above 0.
///
/// # Errors
/// As [`RemoteTask::validate`].
pub fn simulate(
    task: &RemoteTask,
    robot: &RobotProgram,
    scanner: &ScannerProgram,
    sample_s: f64,
) -> Result<SimulationReport, RemoteError> {
    task.validate()?;
    let cycle_s = task.robot.cycle_s();
    let run = run_robot(robot, cycle_s);
    let mut judge = Judge::new(task, sample_s);
    judge.report.total_s = run.total_s;
    let mut idle = run.idle.iter().peekable();
    for line in &run.lines {
        while let Some(wait) = idle.next_if(|wait| wait.begin_s < line.begin_s) {
            judge.rest(wait);
        }
        judge.line(line, scanner);
    }
    for wait in idle {
        judge.rest(wait);
    }
    judge.finish();
    Ok(judge.report)
}

/// Kinds of problems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Fault {
    RobotSpeed,
    NotStarted,
    TooLong,
    NoSubtask,
    Beside,
    BeamSpeed,
    OutsideField,
    Exposures,
}

/// Follows the beam and writes the report.
struct Judge<'a> {
    task: &'a RemoteTask,
    gauges: Vec<SeamGauge>,
    planes: Vec<PlaneFrame>,
    /// Cosine and sine of the angle of the field.
    field_turn: (f64, f64),
    report: SimulationReport,
    sample_s: f64,
    next_sample_s: f64,
    field_mm: Point,
    noted: HashSet<(Fault, usize)>,
}

impl<'a> Judge<'a> {
    fn new(task: &'a RemoteTask, sample_s: f64) -> Self {
        let cycle_s = task.scanner.cycle_s();
        let field_rad = task.scanner.field_angle_deg.to_radians();
        let gauge = |subtask: &crate::Subtask| {
            SeamGauge::new(&subtask.path, subtask.process.speed_mm_s * cycle_s)
        };
        Self {
            task,
            gauges: task.subtasks.iter().map(gauge).collect(),
            planes: task.planes.iter().map(Plane::frame).collect(),
            field_turn: (field_rad.cos(), field_rad.sin()),
            report: SimulationReport {
                total_s: 0.0,
                laser_s: 0.0,
                max_seam_error_mm: 0.0,
                max_speed_error: 0.0,
                max_field_mm: 0.0,
                max_robot_speed_mm_s: 0.0,
                problems: Vec::new(),
                samples: Vec::new(),
            },
            sample_s,
            next_sample_s: 0.0,
            field_mm: Point::default(),
            noted: HashSet::new(),
        }
    }

    /// Notes a problem; of many of a kind with the same subject the first is what matters.
    fn problem(&mut self, kind: Fault, subject: usize, words: String) {
        if self.noted.insert((kind, subject)) {
            self.report.problems.push(words);
        }
    }

    /// Records the state at `time_s`, if it is time to.
    fn sample(&mut self, time_s: f64, robot_mm: [f64; 3], turn: PlaneFrame, laser: bool) {
        if self.sample_s > 0.0 && time_s >= self.next_sample_s {
            let beam_mm = self.on_workpiece(robot_mm, turn, self.field_mm);
            let field_mm = self.field_mm;
            self.report.samples.push(MotionSample { time_s, robot_mm, beam_mm, field_mm, laser });
            self.next_sample_s = (time_s / self.sample_s).floor() * self.sample_s + self.sample_s;
        }
    }

    /// The robot moves, or stands still, with the laser off.
    fn rest(&mut self, wait: &IdleRun) {
        let steps =
            if self.sample_s > 0.0 { (wait.time_s / self.sample_s).ceil().min(1e5) } else { 0.0 };
        for step in 0..steps as u32 {
            let part = f64::from(step) / steps;
            // For the picture only: as if the way were straight and the speed smooth.
            let eased = part * part * (3.0 - 2.0 * part);
            let place = [0, 1, 2].map(|axis| {
                let (from, to) = (wait.from.place_mm[axis], wait.to.place_mm[axis]);
                from + eased * (to - from)
            });
            let turn = Plane { abc_deg: wait.to.abc_deg, ..Plane::default() }.frame();
            self.sample(wait.begin_s + part * wait.time_s, place, turn, false);
        }
    }

    /// A place of the field on the workpiece, in the frame of the robot.
    fn on_workpiece(&self, robot_mm: [f64; 3], turn: PlaneFrame, field_mm: Point) -> [f64; 3] {
        let (cos, sin) = self.field_turn;
        let flat =
            Point::new(cos * field_mm.x - sin * field_mm.y, sin * field_mm.x + cos * field_mm.y);
        let turned = turn.to_space(flat);
        [0, 1, 2].map(|axis| robot_mm[axis] + turned[axis])
    }

    fn line(&mut self, line: &LineRun, scanner: &ScannerProgram) {
        let cycle_s = self.task.robot.cycle_s();
        self.report.max_robot_speed_mm_s = self.report.max_robot_speed_mm_s.max(line.speed_mm_s);
        let limit = self.task.robot.max_speed_mm_s;
        if line.speed_mm_s > limit * (1.0 + 1e-6) {
            let words =
                format!("the robot moves at {:.2} mm/s, {limit} are allowed", line.speed_mm_s);
            self.problem(Fault::RobotSpeed, 0, words);
        }
        let list = scanner.lists.iter().find(|list| list.list == line.list);
        let (Some(list), Some(trigger)) = (list, line.trigger_cycle) else {
            let words = format!("list {} of the scanner is never started", line.list);
            self.problem(Fault::NotStarted, line.list as usize, words);
            return;
        };
        let turn = Plane { abc_deg: line.to.abc_deg, ..Plane::default() }.frame();
        // Until the trigger the beam waits where the list begins.
        self.field_mm = list.vectors.first().map_or(self.field_mm, |first| first.to_mm);
        let started_s = trigger as f64 * cycle_s;
        for cycle in 0..trigger {
            let time_s = cycle as f64 * cycle_s;
            self.sample(line.begin_s + time_s, line.place_mm(time_s, cycle_s), turn, false);
        }
        let tick_s = self.task.scanner.cycle_s();
        let mut tick = 0_u64;
        for vector in &list.vectors {
            let from = self.field_mm;
            let step = (vector.to_mm - from) * (1.0 / vector.cycles.max(1) as f64);
            let mut before = None;
            for k in 0..=vector.cycles {
                let time_s = started_s + (tick + k) as f64 * tick_s;
                let robot_mm = line.place_mm(time_s, cycle_s);
                self.field_mm = from + step * k as f64;
                if vector.laser {
                    let beam_mm = self.on_workpiece(robot_mm, turn, self.field_mm);
                    self.follow(vector.subtask, beam_mm, before, tick_s);
                    before = Some(beam_mm);
                }
                if k > 0 {
                    self.sample(line.begin_s + time_s, robot_mm, turn, vector.laser);
                }
            }
            self.field_mm = vector.to_mm;
            tick += vector.cycles;
            if vector.laser {
                self.report.laser_s += vector.cycles as f64 * tick_s;
            }
        }
        let ended_s = started_s + tick as f64 * tick_s;
        let time_s = line.time_s(cycle_s);
        if ended_s > time_s + 1e-9 {
            let late_ms = 1e3 * (ended_s - time_s);
            let words = format!("list {} runs {late_ms:.3} ms longer than its line", line.list);
            self.problem(Fault::TooLong, line.list as usize, words);
        }
        let mut now_s = ended_s;
        while now_s < time_s && self.sample_s > 0.0 {
            self.sample(line.begin_s + now_s, line.place_mm(now_s, cycle_s), turn, false);
            now_s += cycle_s;
        }
    }

    /// Compares one place of the switched-on beam with its subtask.
    fn follow(
        &mut self,
        subtask: Option<usize>,
        beam_mm: [f64; 3],
        before: Option<[f64; 3]>,
        tick_s: f64,
    ) {
        let Some((index, subtask)) =
            subtask.and_then(|index| Some((index, self.task.subtasks.get(index)?)))
        else {
            self.problem(Fault::NoSubtask, 0, "the laser is on for no subtask".to_owned());
            return;
        };
        let (point, height_mm) = self.planes[subtask.plane].to_plane(beam_mm);
        let way_mm = before.map_or(0.0, |before| distance_mm(before, beam_mm));
        let aside_mm = self.gauges[index].look(point, way_mm).hypot(height_mm);
        self.report.max_seam_error_mm = self.report.max_seam_error_mm.max(aside_mm);
        if aside_mm > MAX_SEAM_ERROR_MM {
            let words = format!("the beam is {aside_mm:.3} mm beside {}", subtask.name);
            self.problem(Fault::Beside, index, words);
        }
        if before.is_some() {
            let error = (way_mm / tick_s / subtask.process.speed_mm_s - 1.0).abs();
            self.report.max_speed_error = self.report.max_speed_error.max(error);
            if error > MAX_SPEED_ERROR.max(self.task.scanner.clock_tolerance) + 1e-4 {
                let words = format!("the speed on {} is {:.2} % off", subtask.name, 100.0 * error);
                self.problem(Fault::BeamSpeed, index, words);
            }
        }
        let from_center_mm = self.field_mm.length();
        self.report.max_field_mm = self.report.max_field_mm.max(from_center_mm);
        let field_mm = subtask.process.field_radius_mm(&self.task.scanner);
        if from_center_mm > field_mm + 1e-6 {
            let words = format!(
                "the laser is on {from_center_mm:.3} mm from the centre of the field for {}, whose field has {field_mm:.3} mm",
                subtask.name
            );
            self.problem(Fault::OutsideField, index, words);
        }
    }

    /// Every subtask must have been exposed as often as asked for.
    fn finish(&mut self) {
        for (index, subtask) in self.task.subtasks.iter().enumerate() {
            if subtask.path.length_mm() <= 0.0 {
                continue;
            }
            let wanted = f64::from(subtask.process.exposures);
            let least = self.gauges[index].least_exposures();
            // Parts of a seam begin and end between two looks.
            if least < 0.95 * wanted {
                let words =
                    format!("a part of {} has {least:.2} exposures of {wanted}", subtask.name);
                self.problem(Fault::Exposures, index, words);
            }
        }
    }
}
