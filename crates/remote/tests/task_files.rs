//! Task files: what they say, and what is wrong with those that are refused.

use std::path::Path;

use lasergym_geom::Point;
use lasergym_remote::{PathPiece, ProcessKind, RemoteError, RemoteTask};

const TASK: &str = r#"
name = "plates"
[scanner]
field_radius_mm = 120.0
[robot]
max_speed_mm_s = 150.0
[[plane]]
name = "top"
[[plane]]
name = "side"
origin_mm = [0.0, 10.0, -50.0]
abc_deg = [0.0, 30.0, 0.0]
[[process]]
name = "cut"
kind = "cutting"
thickness_mm = 0.7
ablation_um = 70.0
[[process]]
name = "weld"
kind = "welding"
max_inclination_deg = 15.0
[[subtask]]
kind = "circle"
process = "cut"
center_mm = [155.0, 250.0]
radius_mm = 60.0
[[subtask]]
name = "long seam"
kind = "line"
process = "weld"
plane = "side"
from_mm = [0.0, 0.0]
to_mm = [50.0, 0.0]
speed_mm_s = 150.0
[[subtask]]
kind = "arc"
center_mm = [0.0, 0.0]
radius_mm = 10.0
start_deg = 90.0
sweep_deg = -180.0
exposures = 3
[[subtask]]
kind = "polyline"
points_mm = [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]]
"#;

fn assets() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/assets")
}

#[test]
fn a_task_says_what_it_says() {
    let task = RemoteTask::from_toml(TASK, None).unwrap();
    assert_eq!(task.name, "plates");
    assert!((task.scanner.field_radius_mm - 120.0).abs() < 1e-12);
    assert!((task.robot.max_speed_mm_s - 150.0).abs() < 1e-12);
    let [hole, seam, arc, corner] = &task.subtasks[..] else { panic!("{:?}", task.subtasks) };
    assert_eq!((hole.name.as_str(), hole.plane, hole.process.exposures), ("circle 1", 0, 10));
    assert!((hole.process.speed_mm_s - 6000.0).abs() < 1e-12);
    assert_eq!(
        (seam.name.as_str(), seam.plane, seam.process.kind),
        ("long seam", 1, ProcessKind::Welding)
    );
    assert!((seam.process.speed_mm_s - 150.0).abs() < 1e-12);
    assert!((seam.process.max_inclination_deg - 15.0).abs() < 1e-12);
    assert!(arc.path.end().distance(Point::new(0.0, -10.0)) < 1e-9);
    assert!((corner.path.length_mm() - 70.0).abs() < 1e-9);
}

#[test]
fn drawings_become_subtasks() {
    let text =
        "[[drawing]]\nfile = \"bracket.dxf\"\noffset_mm = [100.0, 0.0]\nspeed_mm_s = 500.0\n";
    let task = RemoteTask::from_toml(text, Some(&assets())).unwrap();
    // The outline, two holes and a slot.
    assert_eq!(task.subtasks.len(), 4);
    let circles = task
        .subtasks
        .iter()
        .filter(|subtask| matches!(subtask.path.pieces(), [PathPiece::Arc { .. }]));
    assert_eq!(circles.count(), 2);
    for subtask in &task.subtasks {
        assert!(subtask.path.is_closed() && subtask.path.start().x >= 99.0, "{}", subtask.name);
        assert!((subtask.process.speed_mm_s - 500.0).abs() < 1e-12);
    }
    let svg = "[[drawing]]\nfile = \"ellipse.svg\"\nscale = 2.0\n";
    let task = RemoteTask::from_toml(svg, Some(&assets())).unwrap();
    assert_eq!(task.subtasks.len(), 1);
    assert!(task.subtasks[0].path.pieces().len() > 20);
}

#[test]
fn bad_tasks_are_refused_with_a_reason() {
    for (from, to, words) in [
        ("name = \"plates\"", "nom = \"plates\"", "nom"),
        ("field_radius_mm", "field_radius", "field_radius"),
        ("max_speed_mm_s = 150.0", "max_speed_mm_s = \"fast\"", "line 6"),
        ("kind = \"cutting\"", "kind = \"sawing\"", "sawing"),
        ("ablation_um = 70.0\n", "", "ablation_um"),
        ("ablation_um = 70.0", "ablation_um = 70.0\nexposures = 3", "one of them"),
        ("ablation_um = 70.0", "ablation_um = 0.0", "above 0"),
        ("radius_mm = 60.0\n", "", "circle 1 is a circle and needs radius_mm"),
        ("radius_mm = 60.0", "radius_mm = -60.0", "path of circle 1"),
        ("radius_mm = 60.0", "radius_mm = 60.0\ncolour = 1", "colour"),
        ("to_mm", "two_mm", "two_mm"),
        ("to_mm = [50.0, 0.0]\n", "", "to_mm"),
        ("plane = \"side\"", "plane = \"back\"", "there are top, side"),
        ("process = \"weld\"", "process = \"glue\"", "there are cut, weld"),
        ("exposures = 3", "exposures = 0", "exposures of arc 3"),
        ("exposures = 3", "exposures = -3", "arc 3"),
        ("sweep_deg = -180.0", "sweep_deg = -720.0", "sweeps"),
        ("points_mm = [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]]", "points_mm = []", "no piece"),
        ("[30.0, 40.0]]", "[nan, 40.0]]", "finite"),
        (
            "origin_mm = [0.0, 10.0, -50.0]",
            "origin_mm = [0.0, inf, 0.0]",
            "origin_mm of plane side",
        ),
    ] {
        let changed = TASK.replacen(from, to, 1);
        assert_ne!(changed, TASK, "{from}");
        let message = RemoteTask::from_toml(&changed, None).unwrap_err().to_string();
        assert!(message.contains(words), "{to}: {message}");
    }
    assert!(matches!(RemoteTask::from_toml("", None), Err(RemoteError::NoSubtasks)));
    let drawing = "[[drawing]]\nfile = \"logo.svg\"\n";
    let message = RemoteTask::from_toml(drawing, None).unwrap_err().to_string();
    assert!(message.contains("folder"), "{message}");
    let missing = "[[drawing]]\nfile = \"nothing.svg\"\n";
    let error = RemoteTask::from_toml(missing, Some(&assets())).unwrap_err();
    assert!(matches!(error, RemoteError::Drawing { .. }), "{error}");
    let key = "[[drawing]]\nfile = \"logo.svg\"\ncolour = 1\n";
    let message = RemoteTask::from_toml(key, Some(&assets())).unwrap_err().to_string();
    assert!(message.contains("colour"), "{message}");
    let scale = "[[drawing]]\nfile = \"logo.svg\"\nscale = 0.0\n";
    let message = RemoteTask::from_toml(scale, Some(&assets())).unwrap_err().to_string();
    assert!(message.contains("scale"), "{message}");
}
