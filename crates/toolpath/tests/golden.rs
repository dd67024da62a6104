//! The example files in `tests/golden` are what the writers write and the readers read.
//!
//! `LASERGYM_UPDATE_GOLDEN=1 cargo test -p lasergym-toolpath --test golden` writes them anew.

use std::error::Error;
use std::path::PathBuf;

use lasergym_geom::Point;
use lasergym_toolpath::{GcodeOptions, PulsePath, ToolpathError};
use lasergym_toolpath::{read_csv, read_gcode, write_csv, write_gcode};

const RADIUS_PX: f64 = 9.0;

/// Round, fractional, single-precision, far-digit and off-workpiece positions.
fn pulses() -> Result<PulsePath, ToolpathError> {
    let positions = [
        (50.0, 50.0),
        (12.5, 87.25),
        (f64::from(50.0 * (1.0 + 0.123_456_79_f32)), f64::from(50.0 * (1.0 - 0.987_654_3_f32))),
        (100.0 / 3.0, 200.0 / 3.0),
        (-2.5, 101.0),
    ];
    PulsePath::new(positions.map(|(x, y)| Point::new(x, y)).to_vec(), RADIUS_PX)
}

/// The golden file `name`, after replacing it by `written` when asked to.
fn golden(name: &str, written: &str) -> std::io::Result<String> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden").join(name);
    if std::env::var_os("LASERGYM_UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::write(&path, written)?;
    }
    Ok(std::fs::read_to_string(&path)?.replace("\r\n", "\n"))
}

#[test]
fn gcode() -> Result<(), Box<dyn Error>> {
    let (pulses, options) = (pulses()?, GcodeOptions::default());
    let written = write_gcode(&pulses, &options)?;
    let golden = golden("pulses.nc", &written)?;
    assert_eq!(written, golden);
    let read = read_gcode(&golden, &options.frame, RADIUS_PX)?;
    assert_eq!(read.len(), pulses.len());
    for (a, b) in read.positions_px().iter().zip(pulses.positions_px()) {
        assert!(a.distance(*b) <= 1e-9);
    }
    Ok(())
}

#[test]
fn csv() -> Result<(), Box<dyn Error>> {
    let pulses = pulses()?;
    let written = write_csv(&pulses);
    let golden = golden("pulses.csv", &written)?;
    assert_eq!(written, golden);
    assert_eq!(read_csv(&golden, RADIUS_PX)?, pulses);
    Ok(())
}
