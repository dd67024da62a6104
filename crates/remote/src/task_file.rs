//! Tasks as TOML files.

use std::path::{Path, PathBuf};

use lasergym_geom::{DrawingCurves, Point};
use serde::Deserialize;

use crate::drawing_import::beam_path_of;
use crate::{
    BeamPath, MAX_SUBTASKS, PathPiece, Plane, Process, ProcessKind, RemoteError, RemoteTask, Robot,
    Scanner, Subtask,
};

/// Longest task that is read, bytes.
const MAX_TASK_BYTES: usize = 16 << 20;

/// Speeds that processes have where the file says nothing, mm/s.
const CUTTING_MM_S: f64 = 6000.0;
const WELDING_MM_S: f64 = 200.0;

impl RemoteTask {
    /// Reads a task; unknown keys are errors. Drawings are looked for in `folder`; without one a task
    /// may not name any.
    ///
    /// # Errors
    /// [`RemoteError::TaskFile`] for text that is no task, [`RemoteError::UnknownName`],
    /// [`RemoteError::Path`], [`RemoteError::Drawing`], and as [`RemoteTask::validate`].
    pub fn from_toml(text: &str, folder: Option<&Path>) -> Result<Self, RemoteError> {
        if text.len() > MAX_TASK_BYTES {
            let reason = format!("it has {} bytes, more than {MAX_TASK_BYTES}", text.len());
            return Err(RemoteError::TaskFile { reason });
        }
        let file: TaskFile = toml::from_str(text).map_err(|error| RemoteError::TaskFile {
            reason: error.to_string().trim().to_owned(),
        })?;
        let task = file.build(folder)?;
        task.validate()?;
        Ok(task)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TaskFile {
    #[serde(default = "unnamed")]
    name: String,
    #[serde(default)]
    scanner: ScannerFile,
    #[serde(default)]
    robot: RobotFile,
    #[serde(default)]
    plane: Vec<PlaneFile>,
    #[serde(default)]
    process: Vec<NamedProcessFile>,
    #[serde(default)]
    subtask: Vec<SubtaskFile>,
    #[serde(default)]
    drawing: Vec<DrawingFile>,
}

fn unnamed() -> String {
    "task".to_owned()
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct ScannerFile {
    field_radius_mm: Option<f64>,
    distance_mm: Option<f64>,
    field_angle_deg: Option<f64>,
    cycle_us: Option<f64>,
    jump_s: Option<f64>,
    clock_tolerance: Option<f64>,
}

impl ScannerFile {
    fn build(&self) -> Scanner {
        let default = Scanner::default();
        Scanner {
            field_radius_mm: self.field_radius_mm.unwrap_or(default.field_radius_mm),
            distance_mm: self.distance_mm.unwrap_or(default.distance_mm),
            field_angle_deg: self.field_angle_deg.unwrap_or(default.field_angle_deg),
            cycle_us: self.cycle_us.unwrap_or(default.cycle_us),
            jump_s: self.jump_s.unwrap_or(default.jump_s),
            clock_tolerance: self.clock_tolerance.unwrap_or(default.clock_tolerance),
        }
    }
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    max_speed_mm_s: Option<f64>,
    min_speed_mm_s: Option<f64>,
    cycle_ms: Option<f64>,
    acceleration_mm_s2: Option<f64>,
    ptp_speed_mm_s: Option<f64>,
    restart_s: Option<f64>,
}

impl RobotFile {
    fn build(&self) -> Robot {
        let default = Robot::default();
        let max_speed_mm_s = self.max_speed_mm_s.unwrap_or(default.max_speed_mm_s);
        Robot {
            max_speed_mm_s,
            min_speed_mm_s: self
                .min_speed_mm_s
                .unwrap_or_else(|| default.min_speed_mm_s.min(max_speed_mm_s)),
            cycle_ms: self.cycle_ms.unwrap_or(default.cycle_ms),
            acceleration_mm_s2: self.acceleration_mm_s2.unwrap_or(default.acceleration_mm_s2),
            ptp_speed_mm_s: self.ptp_speed_mm_s.unwrap_or(default.ptp_speed_mm_s),
            restart_s: self.restart_s.unwrap_or(default.restart_s),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneFile {
    name: String,
    #[serde(default)]
    origin_mm: [f64; 3],
    #[serde(default)]
    abc_deg: [f64; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum KindFile {
    Cutting,
    Welding,
}

/// What a process says; what it does not say comes from the process that it names.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct ProcessValues {
    process: Option<String>,
    speed_mm_s: Option<f64>,
    exposures: Option<u32>,
    thickness_mm: Option<f64>,
    ablation_um: Option<f64>,
    max_robot_speed_mm_s: Option<f64>,
    max_inclination_deg: Option<f64>,
    split: Option<bool>,
}

#[derive(Deserialize)]
struct NamedProcessFile {
    name: String,
    kind: KindFile,
    #[serde(flatten)]
    values: toml::Table,
}

impl NamedProcessFile {
    fn build(self) -> Result<(String, Process), RemoteError> {
        let (kind, speed_mm_s) = match self.kind {
            KindFile::Cutting => (ProcessKind::Cutting, CUTTING_MM_S),
            KindFile::Welding => (ProcessKind::Welding, WELDING_MM_S),
        };
        let values = ProcessValues::read(self.values, &self.name)?;
        let process =
            values.over(Process { kind, speed_mm_s, ..Process::default() }, &self.name)?;
        Ok((self.name, process))
    }
}

impl ProcessValues {
    /// What a table holds besides the keys of its owner; other keys are errors.
    fn read(table: toml::Table, owner: &str) -> Result<Self, RemoteError> {
        table.try_into().map_err(|error: toml::de::Error| RemoteError::TaskFile {
            reason: format!("{owner}: {}", error.to_string().trim()),
        })
    }

    /// `base` with the values that are given.
    fn over(&self, base: Process, owner: &str) -> Result<Process, RemoteError> {
        let through = match (self.thickness_mm, self.ablation_um) {
            (Some(thickness_mm), Some(ablation_um)) => {
                let ok = thickness_mm > 0.0 && ablation_um > 0.0;
                let name = format!("thickness_mm and ablation_um of {owner}");
                crate::error::check_option(name, thickness_mm, ok, "above 0, both of them")?;
                Some(Process::exposures_through(thickness_mm, ablation_um))
            }
            (None, None) => None,
            _ => {
                let reason = format!(
                    "{owner} has one of thickness_mm and ablation_um: give both or exposures"
                );
                return Err(RemoteError::TaskFile { reason });
            }
        };
        if through.is_some() && self.exposures.is_some() {
            let reason = format!("{owner} has exposures and a thickness: give one of them");
            return Err(RemoteError::TaskFile { reason });
        }
        Ok(Process {
            kind: base.kind,
            speed_mm_s: self.speed_mm_s.unwrap_or(base.speed_mm_s),
            exposures: self.exposures.or(through).unwrap_or(base.exposures),
            max_robot_speed_mm_s: self.max_robot_speed_mm_s.unwrap_or(base.max_robot_speed_mm_s),
            max_inclination_deg: self.max_inclination_deg.unwrap_or(base.max_inclination_deg),
            split: self.split.unwrap_or(base.split),
        })
    }
}

#[derive(Deserialize)]
struct SubtaskFile {
    kind: ShapeKind,
    name: Option<String>,
    plane: Option<String>,
    center_mm: Option<[f64; 2]>,
    radius_mm: Option<f64>,
    start_deg: Option<f64>,
    sweep_deg: Option<f64>,
    from_mm: Option<[f64; 2]>,
    to_mm: Option<[f64; 2]>,
    points_mm: Option<Vec<[f64; 2]>>,
    #[serde(flatten)]
    values: toml::Table,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum ShapeKind {
    Circle,
    Line,
    Arc,
    Polyline,
}

impl ShapeKind {
    fn word(self) -> &'static str {
        match self {
            Self::Circle => "circle",
            Self::Line => "line",
            Self::Arc => "arc",
            Self::Polyline => "polyline",
        }
    }
}

#[derive(Deserialize)]
struct DrawingFile {
    file: PathBuf,
    plane: Option<String>,
    /// mm per unit of the drawing; SVG drawings are in mm already.
    #[serde(default = "one")]
    scale: f64,
    #[serde(default)]
    offset_mm: [f64; 2],
    #[serde(flatten)]
    values: toml::Table,
}

fn one() -> f64 {
    1.0
}

fn point([x, y]: [f64; 2]) -> Point {
    Point::new(x, y)
}

impl SubtaskFile {
    fn path(&self, name: &str) -> Result<BeamPath, RemoteError> {
        let missing = |key: &str| RemoteError::TaskFile {
            reason: format!("{name} is a {} and needs {key}", self.kind.word()),
        };
        let needs =
            |value: Option<[f64; 2]>, key: &str| value.map(point).ok_or_else(|| missing(key));
        let center = || needs(self.center_mm, "center_mm");
        let radius = || self.radius_mm.ok_or_else(|| missing("radius_mm"));
        let path = match self.kind {
            ShapeKind::Circle => BeamPath::circle(center()?, radius()?),
            ShapeKind::Line => {
                BeamPath::line(needs(self.from_mm, "from_mm")?, needs(self.to_mm, "to_mm")?)
            }
            ShapeKind::Arc => BeamPath::new(vec![PathPiece::Arc {
                center: center()?,
                radius_mm: radius()?,
                start_rad: self.start_deg.ok_or_else(|| missing("start_deg"))?.to_radians(),
                sweep_rad: self.sweep_deg.ok_or_else(|| missing("sweep_deg"))?.to_radians(),
            }]),
            ShapeKind::Polyline => {
                let points = self.points_mm.as_ref().ok_or_else(|| missing("points_mm"))?;
                BeamPath::polyline(&points.iter().copied().map(point).collect::<Vec<_>>())
            }
        };
        path.map_err(|problem| RemoteError::Path { subtask: name.to_owned(), problem })
    }
}

/// Names that subtasks refer to.
struct Names {
    planes: Vec<Plane>,
    processes: Vec<(String, Process)>,
}

impl Names {
    fn plane(&self, owner: &str, name: Option<&str>) -> Result<usize, RemoteError> {
        let Some(name) = name else { return Ok(0) };
        let known = || self.planes.iter().map(|plane| plane.name.as_str());
        known()
            .position(|known| known == name)
            .ok_or_else(|| unknown(owner, "plane", name, &known().collect::<Vec<_>>()))
    }

    fn process(&self, owner: &str, values: &ProcessValues) -> Result<Process, RemoteError> {
        let base = match &values.process {
            None => Process::default(),
            Some(name) => {
                let found = self.processes.iter().find(|(known, _)| known == name);
                let known: Vec<&str> = self.processes.iter().map(|(name, _)| &**name).collect();
                found.ok_or_else(|| unknown(owner, "process", name, &known))?.1
            }
        };
        values.over(base, owner)
    }
}

fn unknown(owner: &str, kind: &'static str, name: &str, known: &[&str]) -> RemoteError {
    RemoteError::UnknownName {
        owner: owner.to_owned(),
        kind,
        name: name.to_owned(),
        known: if known.is_empty() { "none".to_owned() } else { known.join(", ") },
    }
}

impl TaskFile {
    fn build(self, folder: Option<&Path>) -> Result<RemoteTask, RemoteError> {
        let planes: Vec<Plane> = if self.plane.is_empty() {
            vec![Plane { name: "workpiece".to_owned(), ..Plane::default() }]
        } else {
            let plane =
                |p: PlaneFile| Plane { name: p.name, origin_mm: p.origin_mm, abc_deg: p.abc_deg };
            self.plane.into_iter().map(plane).collect()
        };
        let processes =
            self.process.into_iter().map(NamedProcessFile::build).collect::<Result<_, _>>()?;
        let names = Names { planes, processes };
        let mut subtasks = Vec::with_capacity(self.subtask.len());
        for (index, file) in self.subtask.into_iter().enumerate() {
            let default = || format!("{} {}", file.kind.word(), index + 1);
            let name = file.name.clone().unwrap_or_else(default);
            // Unknown keys first: they are the likeliest reason for what is missing.
            let path = file.path(&name);
            let values = ProcessValues::read(file.values, &name)?;
            let path = path?;
            let plane = names.plane(&name, file.plane.as_deref())?;
            let process = names.process(&name, &values)?;
            subtasks.push(Subtask { name, plane, path, process });
        }
        for file in self.drawing {
            subtasks.extend(drawn_subtasks(file, folder, &names)?);
            if subtasks.len() > MAX_SUBTASKS {
                return Err(RemoteError::TooManySubtasks { limit: MAX_SUBTASKS });
            }
        }
        Ok(RemoteTask {
            name: self.name,
            scanner: self.scanner.build(),
            robot: self.robot.build(),
            planes: names.planes,
            subtasks,
        })
    }
}

/// Every curve of a drawing as a subtask.
fn drawn_subtasks(
    file: DrawingFile,
    folder: Option<&Path>,
    names: &Names,
) -> Result<Vec<Subtask>, RemoteError> {
    let owner = format!("drawing {}", file.file.display());
    let Some(folder) = folder else {
        let reason = format!("{owner}: a task without a folder cannot have drawings");
        return Err(RemoteError::TaskFile { reason });
    };
    let ok = file.scale > 0.0 && file.scale <= 1e6;
    crate::error::check_option(
        format!("scale of {owner}"),
        file.scale,
        ok,
        "above 0 and at most 1e6 mm per unit",
    )?;
    let plane = names.plane(&owner, file.plane.as_deref())?;
    let process = names.process(&owner, &ProcessValues::read(file.values, &owner)?)?;
    let path = folder.join(&file.file);
    let drawing = DrawingCurves::load(&path)
        .map_err(|source| RemoteError::Drawing { path: path.clone(), source })?;
    let offset = point(file.offset_mm);
    let stem =
        file.file.file_stem().map_or_else(|| owner.clone(), |s| s.to_string_lossy().into_owned());
    let mut subtasks = Vec::with_capacity(drawing.curves.len());
    for (curve, number) in drawing.curves.iter().zip(1..) {
        let name = format!("{stem} {number}");
        let points: Vec<Point> =
            curve.iter().map(|&place| offset + point(place) * file.scale).collect();
        let path = beam_path_of(&points)
            .map_err(|problem| RemoteError::Path { subtask: name.clone(), problem })?;
        subtasks.push(Subtask { name, plane, path, process });
    }
    Ok(subtasks)
}
