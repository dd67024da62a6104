//! The program of the robot: moves with the places where it starts the scanner.

use std::fmt::Write as _;

use crate::{RemoteError, RemotePlan, RemoteTask};

/// First line of a robot program in CSV.
pub const ROBOT_CSV_HEADER: &str =
    "move,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,speed_mm_s,acceleration_mm_s2,wait_s,trigger_mm,list";

/// Longest program text that is read, bytes.
pub(crate) const MAX_PROGRAM_BYTES: usize = 256 << 20;

/// Where the centre of the working field is, and how the field is turned.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Place, mm.
    pub place_mm: [f64; 3],
    /// Angles A, B, C, °, as of a [`crate::Plane`].
    pub abc_deg: [f64; 3],
}

/// A move of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RobotMove {
    /// From point to point, from rest to rest; the first one is where the program begins.
    Ptp {
        /// Where to.
        to: Pose,
        /// Speed, mm/s.
        speed_mm_s: f64,
        /// Acceleration, mm/s².
        acceleration_mm_s2: f64,
    },
    /// Standing still.
    Wait {
        /// For how long, s.
        time_s: f64,
    },
    /// Straight, from rest to rest, starting a list of the scanner on the way.
    Line {
        /// Where to.
        to: Pose,
        /// Speed, mm/s.
        speed_mm_s: f64,
        /// Acceleration, mm/s².
        acceleration_mm_s2: f64,
        /// Distance from the start of the move at which the list is started, mm.
        trigger_mm: f64,
        /// Number of the list, from 1.
        list: u32,
    },
}

/// The program of the robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotProgram {
    /// The moves in order.
    pub moves: Vec<RobotMove>,
}

impl RobotProgram {
    /// The program of a plan.
    #[must_use]
    pub fn of(task: &RemoteTask, plan: &RemotePlan) -> Self {
        let robot = &task.robot;
        let mut moves = Vec::with_capacity(3 * plan.lines.len());
        for (index, planned) in plan.lines.iter().enumerate() {
            let routed = &planned.routed;
            let speed_mm_s = routed.line.speed_mm_s;
            let abc_deg = task.planes[routed.plane].abc_deg;
            moves.push(RobotMove::Ptp {
                to: Pose { place_mm: routed.from_mm, abc_deg },
                speed_mm_s: robot.ptp_speed_mm_s,
                acceleration_mm_s2: robot.acceleration_mm_s2,
            });
            moves.push(RobotMove::Wait { time_s: robot.whole_cycles_s(robot.restart_s) });
            moves.push(RobotMove::Line {
                to: Pose { place_mm: routed.to_mm, abc_deg },
                speed_mm_s,
                acceleration_mm_s2: speed_mm_s / robot.lead_s(speed_mm_s),
                trigger_mm: robot.lead_mm(speed_mm_s),
                list: index as u32 + 1,
            });
        }
        Self { moves }
    }

    /// The program as CSV with the columns of [`ROBOT_CSV_HEADER`]; entries that a move does not have
    /// are empty.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{ROBOT_CSV_HEADER}\n");
        for one in &self.moves {
            // Writing to a string cannot fail.
            let _ = match *one {
                RobotMove::Ptp { to, speed_mm_s, acceleration_mm_s2 } => {
                    writeln!(
                        text,
                        "PTP,{},{speed_mm_s:.6},{acceleration_mm_s2:.6},,,",
                        pose_text(&to)
                    )
                }
                RobotMove::Wait { time_s } => writeln!(text, "WAIT,,,,,,,,,{time_s:.6},,"),
                RobotMove::Line { to, speed_mm_s, acceleration_mm_s2, trigger_mm, list } => {
                    writeln!(
                        text,
                        "LIN,{},{speed_mm_s:.6},{acceleration_mm_s2:.6},,{trigger_mm:.4},{list}",
                        pose_text(&to)
                    )
                }
            };
        }
        text
    }

    /// Reads what [`Self::to_csv`] writes.
    ///
    /// # Errors
    /// [`RemoteError::Program`] names the line.
    pub fn from_csv(text: &str) -> Result<Self, RemoteError> {
        let fault =
            |line: usize, reason: String| RemoteError::Program { program: "robot", line, reason };
        if text.len() > MAX_PROGRAM_BYTES {
            return Err(fault(1, format!("it has more than {MAX_PROGRAM_BYTES} bytes")));
        }
        let mut lines = text.lines().zip(1..);
        match lines.next() {
            Some((ROBOT_CSV_HEADER, _)) => {}
            found => {
                let found = found.map_or("", |(line, _)| line);
                return Err(fault(1, format!("the header is {found:?}, not {ROBOT_CSV_HEADER:?}")));
            }
        }
        let mut moves = Vec::new();
        for (line, number) in lines.filter(|(line, _)| !line.is_empty()) {
            moves.push(robot_move(line).map_err(|reason| fault(number, reason))?);
        }
        Ok(Self { moves })
    }
}

fn pose_text(pose: &Pose) -> String {
    let [x, y, z] = pose.place_mm;
    let [a, b, c] = pose.abc_deg;
    // Adding 0 turns −0 into 0.
    let near = |value: f64| (value * 1e4).round() / 1e4 + 0.0;
    format!(
        "{:.4},{:.4},{:.4},{:.4},{:.4},{:.4}",
        near(x),
        near(y),
        near(z),
        near(a),
        near(b),
        near(c)
    )
}

fn robot_move(line: &str) -> Result<RobotMove, String> {
    let fields: Vec<&str> = line.split(',').collect();
    let columns = ROBOT_CSV_HEADER.split(',').count();
    if fields.len() != columns {
        return Err(format!("it has {} columns, not {columns}", fields.len()));
    }
    let number = |column: usize| -> Result<f64, String> {
        let value: f64 =
            fields[column].parse().map_err(|_| format!("{:?} is no number", fields[column]))?;
        if value.abs() <= 1e9 { Ok(value) } else { Err(format!("{value} is out of range")) }
    };
    // Less than a program can say would be written as 0.
    let positive = |column: usize| match number(column)? {
        value if value >= 1e-6 => Ok(value),
        value => Err(format!("{value} must be 0.000001 or above")),
    };
    let pose = || -> Result<Pose, String> {
        Ok(Pose {
            place_mm: [number(1)?, number(2)?, number(3)?],
            abc_deg: [number(4)?, number(5)?, number(6)?],
        })
    };
    match fields[0] {
        "PTP" => Ok(RobotMove::Ptp {
            to: pose()?,
            speed_mm_s: positive(7)?,
            acceleration_mm_s2: positive(8)?,
        }),
        "WAIT" => Ok(RobotMove::Wait { time_s: number(9)? }),
        "LIN" => Ok(RobotMove::Line {
            to: pose()?,
            speed_mm_s: positive(7)?,
            acceleration_mm_s2: positive(8)?,
            trigger_mm: number(10)?,
            list: fields[11].parse().map_err(|_| format!("{:?} is no list", fields[11]))?,
        }),
        other => Err(format!("{other:?} is no move: there are PTP, WAIT and LIN")),
    }
}
