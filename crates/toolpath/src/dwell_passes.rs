//! Passes with a speed for every stretch, as CSV and G-code: milling by dwell.

use std::fmt::Write;

use crate::error::check_option;
use crate::{ToolpathError, YAxis};

/// First line of a pass file: passes and points count from 1 in machining order; speed and beam are
/// those of the way to the point.
pub const PASSES_CSV_HEADER: &str = "pass,point,x_um,y_um,speed_mm_s,beam_on";

/// A point of a pass and the way to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DwellPoint {
    /// x, µm, to the right.
    pub x_um: f64,
    /// y, µm, downwards.
    pub y_um: f64,
    /// Speed on the way to this point, mm/s, above 0.
    pub speed_mm_s: f64,
    /// Whether the beam is on on the way to this point; without meaning at the first.
    pub beam_on: bool,
}

/// Points that the beam visits without a break.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DwellPass {
    /// The points in machining order.
    pub points: Vec<DwellPoint>,
}

/// How passes become a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassGcodeOptions {
    /// Machine x of the workpiece's x = 0, mm, within ±1000. Default 0.
    pub origin_x_mm: f64,
    /// Machine y of the workpiece's edge of lowest machine y, mm, within ±1000. Default 0.
    pub origin_y_mm: f64,
    /// Sense of the machine's y axis. Default [`YAxis::Up`].
    pub y_axis: YAxis,
    /// Height of the workpiece, from its y = 0 down, mm, from 0 to 10 000: where its lowest edge is.
    pub height_mm: f64,
    /// Power as the spindle word S, above 0 and up to 10⁶. Default 1000.
    pub power_s: f64,
}

impl Default for PassGcodeOptions {
    fn default() -> Self {
        Self {
            origin_x_mm: 0.0,
            origin_y_mm: 0.0,
            y_axis: YAxis::Up,
            height_mm: 0.0,
            power_s: 1000.0,
        }
    }
}

impl PassGcodeOptions {
    /// Accepts finite options within the ranges of their fields.
    ///
    /// # Errors
    /// [`ToolpathError::OptionValue`] naming the first field out of range.
    pub fn validate(&self) -> Result<(), ToolpathError> {
        let (x, y) = (self.origin_x_mm, self.origin_y_mm);
        check_option("origin_x_mm", x, x.abs() <= 1e3, "-1000 to 1000 mm")?;
        check_option("origin_y_mm", y, y.abs() <= 1e3, "-1000 to 1000 mm")?;
        let height = (0.0..=1e4).contains(&self.height_mm);
        check_option("height_mm", self.height_mm, height, "0 to 10000 mm")?;
        let power = self.power_s > 0.0 && self.power_s <= 1e6;
        check_option("power_s", self.power_s, power, "above 0 and up to 1e6")
    }
}

/// The passes as text: [`PASSES_CSV_HEADER`], then a line for each point.
///
/// # Errors
/// [`ToolpathError::OptionValue`] for a point that is not finite or a speed that is not above 0.
pub fn write_passes_csv(passes: &[DwellPass]) -> Result<String, ToolpathError> {
    check_passes(passes)?;
    let mut text = format!("{PASSES_CSV_HEADER}\n");
    for (pass, points) in passes.iter().enumerate() {
        for (k, p) in points.points.iter().enumerate() {
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{},{},{:.4},{:.4},{:.6},{}",
                pass + 1,
                k + 1,
                p.x_um,
                p.y_um,
                p.speed_mm_s,
                u8::from(p.beam_on)
            );
        }
    }
    Ok(text)
}

/// The program that makes the passes, GRBL dialect, with a feed rate for every stretch.
///
/// The beam is off (`M5`) before anything moves, on the way to each pass, and at the end (`M5 S0`).
/// Within a pass it is on (`M3`) with the power of the option, or S0 where it is off. Lines repeat
/// neither F nor S that have not changed.
///
/// # Errors
/// [`ToolpathError::OptionValue`] for options or points out of range.
pub fn write_passes_gcode(
    passes: &[DwellPass],
    options: &PassGcodeOptions,
) -> Result<String, ToolpathError> {
    options.validate()?;
    check_passes(passes)?;
    let mut text = format!(
        "; lasergym milling passes, GRBL dialect\n; Passes: {}\n; Units: mm, mm/min\nM5\nG21 G90 G94\n",
        passes.len()
    );
    for pass in passes {
        let Some((first, rest)) = pass.points.split_first() else { continue };
        let (x_mm, y_mm) = machine_mm(first, options);
        let _ = writeln!(text, "M5\nG0 X{x_mm:.5} Y{y_mm:.5}\nM3 S0");
        let (mut feed, mut power) = (String::new(), 0.0);
        for point in rest {
            let (x_mm, y_mm) = machine_mm(point, options);
            let _ = write!(text, "G1 X{x_mm:.5} Y{y_mm:.5}");
            let next_feed = format!("{:.3}", point.speed_mm_s * 60.0);
            if next_feed != feed {
                let _ = write!(text, " F{next_feed}");
                feed = next_feed;
            }
            let next_power = if point.beam_on { options.power_s } else { 0.0 };
            if (next_power - power).abs() > 0.0 {
                let _ = write!(text, " S{next_power}");
                power = next_power;
            }
            text.push('\n');
        }
    }
    text.push_str("M5 S0\n");
    Ok(text)
}

fn machine_mm(point: &DwellPoint, options: &PassGcodeOptions) -> (f64, f64) {
    let y_mm = match options.y_axis {
        YAxis::Up => options.height_mm - point.y_um / 1e3,
        YAxis::Down => point.y_um / 1e3,
    };
    (options.origin_x_mm + point.x_um / 1e3, options.origin_y_mm + y_mm)
}

fn check_passes(passes: &[DwellPass]) -> Result<(), ToolpathError> {
    for point in passes.iter().flat_map(|pass| &pass.points) {
        check_option("x_um", point.x_um, point.x_um.abs() <= 1e9, "within ±1e9 µm")?;
        check_option("y_um", point.y_um, point.y_um.abs() <= 1e9, "within ±1e9 µm")?;
        let speed = point.speed_mm_s;
        check_option("speed_mm_s", speed, speed > 1e-5 && speed <= 1e6, "0.00001 to 1e6 mm/s")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passes() -> Vec<DwellPass> {
        let point = |x_um: f64, speed_mm_s: f64, beam_on: bool| DwellPoint {
            x_um,
            y_um: 250.0,
            speed_mm_s,
            beam_on,
        };
        let points =
            vec![point(0.0, 10.0, false), point(5.0, 10.0, true), point(10.0, 20.0, false)];
        vec![DwellPass { points }, DwellPass::default()]
    }

    #[test]
    fn the_program_moves_each_stretch_at_its_feed() {
        let options = PassGcodeOptions { height_mm: 1.0, ..PassGcodeOptions::default() };
        let text = write_passes_gcode(&passes(), &options).unwrap();
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with(';')).collect();
        assert_eq!(
            lines,
            [
                "M5",
                "G21 G90 G94",
                "M5",
                "G0 X0.00000 Y0.75000",
                "M3 S0",
                "G1 X0.00500 Y0.75000 F600.000 S1000",
                "G1 X0.01000 Y0.75000 F1200.000 S0",
                "M5 S0",
            ]
        );
        let down = PassGcodeOptions { y_axis: YAxis::Down, ..options };
        assert!(write_passes_gcode(&passes(), &down).unwrap().contains("Y0.25000"));
    }

    #[test]
    fn the_table_has_a_line_for_each_point() {
        let text = write_passes_csv(&passes()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4);
        assert_eq!((lines[0], lines[2]), (PASSES_CSV_HEADER, "1,2,5.0000,250.0000,10.000000,1"));
    }

    #[test]
    fn bad_points_and_options_are_refused() {
        let name = |result: Result<String, ToolpathError>| match result {
            Err(ToolpathError::OptionValue { name, .. }) => name,
            other => panic!("{other:?}"),
        };
        let mut bad = passes();
        bad[0].points[1].speed_mm_s = 0.0;
        assert_eq!(name(write_passes_csv(&bad)), "speed_mm_s");
        bad[0].points[1].x_um = f64::NAN;
        let defaults = PassGcodeOptions::default();
        assert_eq!(name(write_passes_gcode(&bad, &defaults)), "x_um");
        for (options, expected) in [
            (PassGcodeOptions { origin_x_mm: 2e3, ..defaults }, "origin_x_mm"),
            (PassGcodeOptions { origin_y_mm: f64::NAN, ..defaults }, "origin_y_mm"),
            (PassGcodeOptions { height_mm: -1.0, ..defaults }, "height_mm"),
            (PassGcodeOptions { power_s: 0.0, ..defaults }, "power_s"),
        ] {
            assert_eq!(name(write_passes_gcode(&passes(), &options)), expected);
        }
    }
}
