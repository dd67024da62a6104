//! Scan circles: where the robot may be while a subtask is processed.

use lasergym_geom::Point;

use crate::beam_motion::BeamMotion;
use crate::enclosing_circle::Circle;
use crate::{BeamPath, MAX_SUBTASKS, RemoteError, RemoteTask, Subtask};

/// Radius of a scan circle, as a part of the field's, below which a subtask is split.
const SMALLEST_PART: f64 = 0.2;

/// Where the robot may be while a subtask is processed, and for how long that takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanCircle {
    /// Its centre, mm.
    pub center: Point,
    /// Its radius, mm.
    pub radius_mm: f64,
    /// Time of the process, s: length · exposures / speed (eq. 1).
    pub time_s: f64,
    /// Highest speed of the robot meanwhile, mm/s.
    pub max_speed_mm_s: f64,
}

/// A subtask, or a piece of one that was split, ready to be planned.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Index of the subtask in the task.
    pub subtask: usize,
    /// Name of the subtask, with the number of the piece where it was split.
    pub name: String,
    /// Its path.
    pub path: BeamPath,
    /// The motion of the beam over it.
    pub motion: BeamMotion,
    /// The smallest circle round it.
    pub enclosing: Circle,
    /// Where the robot may be.
    pub scan_circle: ScanCircle,
}

/// The subtasks of `task` as stops, split where they are too large for the field.
///
/// # Errors
/// As [`RemoteTask::validate`], [`RemoteError::TooLarge`], [`RemoteError::TooSlow`],
/// [`RemoteError::OffClock`] and [`RemoteError::TooManySubtasks`].
pub fn stops_of(task: &RemoteTask) -> Result<Vec<Stop>, RemoteError> {
    task.validate()?;
    let mut stops = Vec::with_capacity(task.subtasks.len());
    for (index, subtask) in task.subtasks.iter().enumerate() {
        let field_mm = usable_field_mm(task, subtask);
        let enclosing = Circle::enclosing(&subtask.path);
        let limit_mm = (1.0 - SMALLEST_PART) * field_mm;
        let must_split = enclosing.radius_mm >= field_mm;
        if must_split && !subtask.process.split {
            return Err(RemoteError::TooLarge {
                subtask: subtask.name.clone(),
                enclosing_mm: enclosing.radius_mm,
                field_mm: subtask.process.field_radius_mm(&task.scanner),
            });
        }
        if must_split {
            let paths = split(&subtask.path, limit_mm);
            let count = paths.len();
            if stops.len() + count > MAX_SUBTASKS {
                return Err(RemoteError::TooManySubtasks { limit: MAX_SUBTASKS });
            }
            for (part, path) in paths.into_iter().enumerate() {
                let name = format!("{} piece {} of {count}", subtask.name, part + 1);
                let piece = Subtask { name, path, ..subtask.clone() };
                stops.push(stop(task, index, piece, field_mm)?);
            }
        } else {
            stops.push(stop(task, index, subtask.clone(), field_mm)?);
        }
    }
    Ok(stops)
}

/// Radius of the field that `subtask` may use, less what the robot moves in one cycle of the
/// scanner: starts are rounded to whole cycles.
fn usable_field_mm(task: &RemoteTask, subtask: &Subtask) -> f64 {
    let rounding_mm = task.robot.max_speed_mm_s * task.scanner.cycle_s();
    subtask.process.field_radius_mm(&task.scanner) - rounding_mm
}

fn stop(
    task: &RemoteTask,
    index: usize,
    piece: Subtask,
    field_mm: f64,
) -> Result<Stop, RemoteError> {
    let motion = BeamMotion::new(&piece, &task.scanner)?;
    let enclosing = Circle::enclosing(&piece.path);
    let scan_circle = ScanCircle {
        center: enclosing.center,
        radius_mm: field_mm - enclosing.radius_mm,
        time_s: motion.cycles() as f64 * task.scanner.cycle_s(),
        max_speed_mm_s: piece.process.max_robot_speed_mm_s.min(task.robot.max_speed_mm_s),
    };
    let slowest_mm_s = task.robot.min_speed_mm_s;
    let reach_s = 2.0 * scan_circle.radius_mm / slowest_mm_s;
    if scan_circle.time_s > reach_s || scan_circle.max_speed_mm_s < slowest_mm_s {
        let needed_mm_s =
            (2.0 * scan_circle.radius_mm / scan_circle.time_s).min(scan_circle.max_speed_mm_s);
        let share = reach_s / scan_circle.time_s;
        return Err(RemoteError::TooSlow {
            subtask: piece.name,
            time_s: scan_circle.time_s,
            slowest_mm_s,
            radius_mm: scan_circle.radius_mm,
            reach_s,
            needed_mm_s,
            exposures: (share * f64::from(piece.process.exposures)).floor() as u32,
        });
    }
    Ok(Stop { subtask: index, name: piece.name, path: piece.path, motion, enclosing, scan_circle })
}

/// As few pieces of equal length as fit into circles of `limit_mm` radius.
fn split(path: &BeamPath, limit_mm: f64) -> Vec<BeamPath> {
    let length_mm = path.length_mm();
    // A path of at most the diameter fits; longer ones need at least two pieces.
    let most = (length_mm / (2.0 * limit_mm)).ceil().clamp(2.0, MAX_SUBTASKS as f64 + 1.0) as usize;
    let pieces = |count: usize| -> Vec<BeamPath> {
        let step_mm = length_mm / count as f64;
        (0..count).map(|k| path.between(step_mm * k as f64, step_mm * (k + 1) as f64)).collect()
    };
    let fits = |paths: &[BeamPath]| {
        paths.iter().all(|piece| Circle::enclosing(piece).radius_mm <= limit_mm)
    };
    let mut count = 2;
    while count < most {
        let paths = pieces(count);
        if fits(&paths) {
            return paths;
        }
        count += (count / 8).max(1);
    }
    pieces(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Process, Scanner};

    fn task(path: BeamPath, process: Process) -> RemoteTask {
        RemoteTask::new(vec![Subtask { name: "kerf".into(), plane: 0, path, process }])
    }

    fn circle(radius_mm: f64) -> BeamPath {
        BeamPath::circle(Point::new(155.0, 250.0), radius_mm).unwrap()
    }

    #[test]
    fn the_scan_circle_of_a_hole_is_the_field_less_the_hole() {
        let process = Process { exposures: 7, ..Process::default() };
        let stops = stops_of(&task(circle(60.0), process)).unwrap();
        let scan = stops[0].scan_circle;
        assert_eq!(scan.center, Point::new(155.0, 250.0));
        // 2 µm are kept for the scanner's clock.
        assert!((scan.radius_mm - 89.998).abs() < 1e-9);
        assert!((scan.time_s - 0.4398).abs() < 5e-5);
    }

    #[test]
    fn what_is_too_large_is_split_or_refused() {
        let pieces = stops_of(&task(circle(400.0), Process::default())).unwrap();
        assert!(pieces.len() > 5, "{}", pieces.len());
        let total: f64 = pieces.iter().map(|stop| stop.path.length_mm()).sum();
        assert!((total - 800.0 * std::f64::consts::PI).abs() < 1e-6);
        for pair in pieces.windows(2) {
            assert!(pair[0].path.end().distance(pair[1].path.start()) < 1e-6);
            assert!(pair[0].scan_circle.radius_mm >= 0.19 * 150.0);
        }
        let whole = Process { split: false, ..Process::default() };
        for radius_mm in [150.0, 149.998, 400.0] {
            let error = stops_of(&task(circle(radius_mm), whole)).unwrap_err();
            assert!(matches!(error, RemoteError::TooLarge { .. }), "{error}");
            assert!(error.to_string().contains("kerf"), "{error}");
        }
    }

    #[test]
    fn a_scan_circle_of_almost_no_radius_is_too_slow() {
        let process = Process { exposures: 20, split: false, ..Process::default() };
        let mut task = task(circle(149.8), process);
        let error = stops_of(&task).unwrap_err();
        let RemoteError::TooSlow { needed_mm_s, exposures, .. } = error else { panic!("{error}") };
        assert!(needed_mm_s < 1.0 && exposures < 20, "{needed_mm_s} {exposures}");
        task.robot.min_speed_mm_s = needed_mm_s * 0.999;
        stops_of(&task).unwrap();
    }

    #[test]
    fn inclination_limits_the_field() {
        let process = Process { max_inclination_deg: 10.0, ..Process::default() };
        let field_mm = process.field_radius_mm(&Scanner::default());
        assert!((field_mm - 400.0 * 10.0_f64.to_radians().tan()).abs() < 1e-9);
        assert!((Process::default().field_radius_mm(&Scanner::default()) - 150.0).abs() < 1e-9);
        let strict = Process { split: false, ..process };
        let error = stops_of(&task(circle(71.0), strict)).unwrap_err();
        assert!(error.to_string().contains("inclination"), "{error}");
    }

    #[test]
    fn exposures_follow_from_thickness_and_ablation() {
        for (ablation_um, exposures) in [(100.0, 7), (70.0, 10), (50.0, 14)] {
            assert_eq!(Process::exposures_through(0.7, ablation_um), exposures);
        }
    }
}
