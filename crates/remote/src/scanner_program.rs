//! The program of the scanner: for each line a list of timed vectors in the scanner's own frame.
//!
//! On a line the robot is at `p(t) = start + v û t`; the beam is at `Rᵀ (p_work(t) − p(t))` in the
//! working field. Vectors end on cycles of the scanner and leave the exact path by no more than
//! [`CHORD_MM`].

use std::fmt::Write as _;

use lasergym_geom::Point;

use crate::beam_path::unit;
use crate::robot_program::MAX_PROGRAM_BYTES;
use crate::{PlannedLine, RemoteError, RemotePlan, RemoteTask, Scanner};

/// First line of a scanner program in CSV.
pub const SCANNER_CSV_HEADER: &str = "list,cycles,x_mm,y_mm,laser,subtask";

/// Most that a vector leaves the path of the beam, mm.
pub const CHORD_MM: f64 = 1e-3;

/// Half the range of a 20-bit position of an RTC board.
const RTC_HALF_RANGE: f64 = 524_287.0;

/// Straight, uniform movement of the beam in the working field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanVector {
    /// Cycles of the scanner that it takes; 0 for the first of a list, which is where the beam waits
    /// for the start.
    pub cycles: u64,
    /// Where it ends, mm from the centre of the field.
    pub to_mm: Point,
    /// Whether the laser is on.
    pub laser: bool,
    /// Index of the subtask in the task, where the laser is on.
    pub subtask: Option<usize>,
}

/// What the scanner does on one line of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct ScannerList {
    /// Its number, from 1.
    pub list: u32,
    /// Its vectors.
    pub vectors: Vec<ScanVector>,
}

/// The program of the scanner.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScannerProgram {
    /// The lists by number.
    pub lists: Vec<ScannerList>,
}

impl ScannerProgram {
    /// The program of a plan.
    #[must_use]
    pub fn of(task: &RemoteTask, plan: &RemotePlan) -> Self {
        let lists = plan.lines.iter().zip(1..);
        Self {
            lists: lists
                .map(|(line, list)| ScannerList { list, vectors: vectors(task, plan, line) })
                .collect(),
        }
    }

    /// The program as CSV with the columns of [`SCANNER_CSV_HEADER`].
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{SCANNER_CSV_HEADER}\n");
        for list in &self.lists {
            for vector in &list.vectors {
                let Point { x, y } = vector.to_mm;
                let subtask = vector.subtask.map_or(String::new(), |index| index.to_string());
                let near = |value: f64| (value * 1e6).round() / 1e6 + 0.0;
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{},{},{:.6},{:.6},{},{subtask}",
                    list.list,
                    vector.cycles,
                    near(x),
                    near(y),
                    u8::from(vector.laser),
                );
            }
        }
        text
    }

    /// Reads what [`Self::to_csv`] writes.
    ///
    /// # Errors
    /// [`RemoteError::Program`] names the line.
    pub fn from_csv(text: &str) -> Result<Self, RemoteError> {
        let fault =
            |line: usize, reason: String| RemoteError::Program { program: "scanner", line, reason };
        if text.len() > MAX_PROGRAM_BYTES {
            return Err(fault(1, format!("it has more than {MAX_PROGRAM_BYTES} bytes")));
        }
        let mut lines = text.lines().zip(1..);
        match lines.next() {
            Some((SCANNER_CSV_HEADER, _)) => {}
            found => {
                let found = found.map_or("", |(line, _)| line);
                return Err(fault(
                    1,
                    format!("the header is {found:?}, not {SCANNER_CSV_HEADER:?}"),
                ));
            }
        }
        let mut lists: Vec<ScannerList> = Vec::new();
        for (line, number) in lines.filter(|(line, _)| !line.is_empty()) {
            let (list, vector) = scan_vector(line).map_err(|reason| fault(number, reason))?;
            match lists.last_mut() {
                Some(last) if last.list == list => last.vectors.push(vector),
                _ => lists.push(ScannerList { list, vectors: vec![vector] }),
            }
        }
        Ok(Self { lists })
    }

    /// The program as commands of an RTC board, one a line: positions in 20-bit units, times in µs,
    /// delays in units of 10 µs.
    #[must_use]
    pub fn to_rtc(&self, scanner: &Scanner) -> String {
        let bits_per_mm = (RTC_HALF_RANGE / scanner.field_radius_mm).floor();
        let bits = |mm: f64| (mm * bits_per_mm).round() as i64;
        let mut text = format!("; {bits_per_mm:.0} units per mm\n");
        for list in &self.lists {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "set_start_list({})", list.list);
            let mut here = None;
            for vector in &list.vectors {
                let (x, y) = (bits(vector.to_mm.x), bits(vector.to_mm.y));
                let time_us = vector.cycles as f64 * scanner.cycle_us;
                let _ = if here.is_none() {
                    writeln!(text, "jump_abs({x}, {y})\nwait_for_start()")
                } else if vector.cycles == 0 {
                    writeln!(text, "jump_abs({x}, {y})")
                } else if vector.laser {
                    writeln!(text, "timed_mark_abs({x}, {y}, {time_us})")
                } else if here == Some((x, y)) {
                    writeln!(text, "long_delay({})", (time_us / 10.0).round())
                } else {
                    writeln!(text, "timed_jump_abs({x}, {y}, {time_us})")
                };
                here = Some((x, y));
            }
            text.push_str("set_end_of_list()\n");
        }
        text
    }
}

/// The vectors of one line.
fn vectors(task: &RemoteTask, plan: &RemotePlan, planned: &PlannedLine) -> Vec<ScanVector> {
    let cycle_s = task.scanner.cycle_s();
    let line = &planned.routed.line;
    let field_rad = task.scanner.field_angle_deg.to_radians();
    let (axis_x, axis_y) = (unit(field_rad), unit(field_rad + std::f64::consts::FRAC_PI_2));
    let in_field = |work: Point, cycle: u64| {
        let robot = line.place(line.start_mm + line.speed_mm_s * cycle as f64 * cycle_s);
        let away = work - robot;
        Point::new(away.x * axis_x.x + away.y * axis_x.y, away.x * axis_y.x + away.y * axis_y.y)
    };
    let mut vectors: Vec<ScanVector> = Vec::new();
    let off = |cycles: u64, to_mm: Point| ScanVector { cycles, to_mm, laser: false, subtask: None };
    let mut now = 0;
    for (stop, &begin) in plan.stops[planned.stops()].iter().zip(&planned.begin_cycles) {
        let first = in_field(stop.motion.at(0), begin);
        match vectors.last().map(|last| last.to_mm) {
            None => {
                vectors.push(off(0, first));
                if begin > 0 {
                    vectors.push(off(begin, first));
                }
            }
            Some(here) => {
                // Wait as long as possible, so that the jump ends where the subtask is by then.
                let jump = task.scanner.jump_cycles().clamp(1, (begin - now).max(1));
                if begin - now > jump {
                    vectors.push(off(begin - now - jump, here));
                }
                if begin > now {
                    vectors.push(off(jump, first));
                } else {
                    vectors.push(off(0, first));
                }
            }
        }
        let chords = stop.motion.chord_cycles(CHORD_MM);
        for pair in chords.windows(2) {
            vectors.push(ScanVector {
                cycles: pair[1] - pair[0],
                to_mm: in_field(stop.motion.at(pair[1]), begin + pair[1]),
                laser: true,
                subtask: Some(stop.subtask),
            });
        }
        now = begin + stop.motion.cycles();
    }
    vectors
}

fn scan_vector(line: &str) -> Result<(u32, ScanVector), String> {
    let fields: Vec<&str> = line.split(',').collect();
    let [list, cycles, x, y, laser, subtask] = fields[..] else {
        return Err(format!("it has {} columns, not 6", fields.len()));
    };
    let number = |text: &str| -> Result<f64, String> {
        let value: f64 = text.parse().map_err(|_| format!("{text:?} is no number"))?;
        if value.abs() <= 1e9 { Ok(value) } else { Err(format!("{value} is out of range")) }
    };
    let count = |text: &str| text.parse::<u32>().map_err(|_| format!("{text:?} is no count"));
    let vector = ScanVector {
        cycles: u64::from(count(cycles)?),
        to_mm: Point::new(number(x)?, number(y)?),
        laser: match laser {
            "0" => false,
            "1" => true,
            other => return Err(format!("laser is {other:?}, but must be 0 or 1")),
        },
        subtask: if subtask.is_empty() { None } else { Some(count(subtask)? as usize) },
    };
    Ok((count(list)?, vector))
}
