//! A task: subtasks on planes, a scanner and a robot.

use crate::error::check_option;
use crate::{BeamPath, Plane, RemoteError, Robot, Scanner};

/// Most subtasks, pieces of split ones included, that are planned at once.
pub const MAX_SUBTASKS: usize = 100_000;

/// What the laser does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ProcessKind {
    /// Remote ablation cutting (RLC): layer by layer, in several exposures.
    #[default]
    Cutting,
    /// Remote welding (RLW).
    Welding,
}

/// How a subtask is processed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Process {
    /// What the laser does.
    pub kind: ProcessKind,
    /// Speed of the beam on the workpiece, mm/s, in (0, 10⁵].
    pub speed_mm_s: f64,
    /// How often the beam goes over the path, from 1 to 100 000.
    pub exposures: u32,
    /// Highest speed of the robot meanwhile, mm/s; that of the robot where it is lower.
    pub max_robot_speed_mm_s: f64,
    /// Largest angle between beam and the normal of the plane, °, in (0, 90]. It limits the working
    /// field to a radius of distance · tan(angle).
    pub max_inclination_deg: f64,
    /// Whether a subtask too large for the field may be divided.
    pub split: bool,
}

impl Default for Process {
    fn default() -> Self {
        Self {
            kind: ProcessKind::Cutting,
            speed_mm_s: 6000.0,
            exposures: 1,
            max_robot_speed_mm_s: f64::INFINITY,
            max_inclination_deg: 90.0,
            split: true,
        }
    }
}

impl Process {
    /// Exposures that cut through `thickness_mm` when each ablates `ablation_um`.
    #[must_use]
    pub fn exposures_through(thickness_mm: f64, ablation_um: f64) -> u32 {
        (thickness_mm * 1e3 / ablation_um - 1e-9).ceil().max(1.0) as u32
    }

    /// Radius of the working field that it may use, mm.
    #[must_use]
    pub fn field_radius_mm(&self, scanner: &Scanner) -> f64 {
        if self.max_inclination_deg >= 90.0 {
            return scanner.field_radius_mm;
        }
        let inclined_mm = scanner.distance_mm * self.max_inclination_deg.to_radians().tan();
        scanner.field_radius_mm.min(inclined_mm)
    }

    pub(crate) fn validate(&self, owner: &str) -> Result<(), RemoteError> {
        let check = |name: &str, value: f64, ok: bool, expected| {
            check_option(format!("{name} of {owner}"), value, ok, expected)
        };
        let speed = self.speed_mm_s;
        let ok = speed > 0.0 && speed <= 1e5;
        check("speed_mm_s", speed, ok, "above 0 and at most 100000 mm/s")?;
        let ok = (1..=100_000).contains(&self.exposures);
        check("exposures", f64::from(self.exposures), ok, "from 1 to 100000")?;
        let robot = self.max_robot_speed_mm_s;
        check("max_robot_speed_mm_s", robot, robot > 0.0, "above 0 mm/s")?;
        let angle = self.max_inclination_deg;
        let ok = angle > 0.0 && angle <= 90.0;
        check("max_inclination_deg", angle, ok, "above 0 and at most 90°")
    }
}

/// A kerf or a seam.
#[derive(Debug, Clone, PartialEq)]
pub struct Subtask {
    /// What it is called.
    pub name: String,
    /// Index of its plane.
    pub plane: usize,
    /// Where the beam goes, in coordinates of its plane.
    pub path: BeamPath,
    /// How.
    pub process: Process,
}

/// What is to be done, and with what.
#[derive(Debug, Clone, PartialEq)]
pub struct RemoteTask {
    /// What it is called; programs bear the name.
    pub name: String,
    /// The scanner.
    pub scanner: Scanner,
    /// The robot.
    pub robot: Robot,
    /// The planes of the workpiece; they are processed one after the other.
    pub planes: Vec<Plane>,
    /// The kerfs and seams.
    pub subtasks: Vec<Subtask>,
}

impl RemoteTask {
    /// A task on one plane with the default scanner and robot.
    #[must_use]
    pub fn new(subtasks: Vec<Subtask>) -> Self {
        Self {
            name: "task".to_owned(),
            scanner: Scanner::default(),
            robot: Robot::default(),
            planes: vec![Plane::default()],
            subtasks,
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// [`RemoteError::NoSubtasks`], [`RemoteError::TooManySubtasks`], and
    /// [`RemoteError::InvalidOption`] for the first value out of range.
    pub fn validate(&self) -> Result<(), RemoteError> {
        self.scanner.validate()?;
        self.robot.validate(&self.scanner)?;
        for plane in &self.planes {
            plane.validate()?;
        }
        if self.subtasks.is_empty() {
            return Err(RemoteError::NoSubtasks);
        }
        if self.subtasks.len() > MAX_SUBTASKS {
            return Err(RemoteError::TooManySubtasks { limit: MAX_SUBTASKS });
        }
        for subtask in &self.subtasks {
            subtask.process.validate(&subtask.name)?;
            let plane = subtask.plane;
            let ok = plane < self.planes.len();
            let name = format!("plane of {}", subtask.name);
            check_option(name, plane as f64, ok, "the index of a plane")?;
        }
        Ok(())
    }
}
