//! Pulses as G-code, GRBL dialect.

use std::fmt::Write;

use crate::error::check_option;
use crate::{PulsePath, ToolpathError, WorkpieceFrame, YAxis};

/// How the stage travels from pulse to pulse, always with the laser off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TravelMove {
    /// G0: as fast as the controller's settings allow.
    #[default]
    Rapid,
    /// G1 at a feed rate: for a stage that must be moved more gently than the controller's limits.
    Feed {
        /// Feed rate, mm/min, from 10⁻³ to 10⁶.
        feed_mm_min: f64,
    },
}

/// How pulses become a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GcodeOptions {
    /// Where the workpiece lies on the machine.
    pub frame: WorkpieceFrame,
    /// Laser power as the spindle word S, above 0 and up to 10⁶, on the scale of the controller's
    /// setting $30. Default 1000: full power at the controller's default of $30 = 1000.
    pub power_s: f64,
    /// Time the laser is on for one pulse, s, from 0.001 to 3600. More exposes longer. Default 0.05,
    /// the step to which GRBL 1.1 rounds dwells up, so that the machine does what the program says.
    pub dwell_s: f64,
    /// Wait with the laser off between arriving and firing, s, 0 (none) to 3600, for the stage to come
    /// to rest. Default 0.05, as in [`crate::StageDynamics`].
    pub settling_s: f64,
    /// How the stage travels. Default [`TravelMove::Rapid`].
    pub travel: TravelMove,
}

impl Default for GcodeOptions {
    fn default() -> Self {
        Self {
            frame: WorkpieceFrame::default(),
            power_s: 1000.0,
            dwell_s: 0.05,
            settling_s: 0.05,
            travel: TravelMove::default(),
        }
    }
}

impl GcodeOptions {
    /// Accepts finite options within the ranges of their fields.
    ///
    /// # Errors
    /// [`ToolpathError::OptionValue`] naming the first field out of range.
    pub fn validate(&self) -> Result<(), ToolpathError> {
        self.frame.validate()?;
        let power = self.power_s > 0.0 && self.power_s <= 1e6;
        check_option("power_s", self.power_s, power, "above 0 and up to 1e6")?;
        let dwell = (1e-3..=3600.0).contains(&self.dwell_s);
        check_option("dwell_s", self.dwell_s, dwell, "0.001 to 3600 s")?;
        let settling = (0.0..=3600.0).contains(&self.settling_s);
        check_option("settling_s", self.settling_s, settling, "0 to 3600 s")?;
        if let TravelMove::Feed { feed_mm_min } = self.travel {
            let feed = (1e-3..=1e6).contains(&feed_mm_min);
            check_option("feed_mm_min", feed_mm_min, feed, "0.001 to 1e6 mm/min")?;
        }
        Ok(())
    }
}

/// The program that fires the pulses of `path` in order.
///
/// The laser is off (`M5`) before anything moves, during every move, and at the end (`M5 S0`). Each
/// pulse travels, settles, and dwells with the laser on. The laser is switched on by `G1 M3`, a block
/// that moves nothing: with GRBL's laser mode ($32 = 1) a laser enabled under G0 stays dark.
///
/// Coordinates are absolute, mm, rounded to 10⁻¹² mm, so that [`crate::read_gcode`] with the same
/// frame returns every position to within 10⁻⁹ px for pixels of 1 µm within 1 m of the machine's
/// zero. No line is longer than 79 characters.
///
/// # Errors
/// [`ToolpathError::OptionValue`] when [`GcodeOptions::validate`] refuses `options`.
pub fn write_gcode(path: &PulsePath, options: &GcodeOptions) -> Result<String, ToolpathError> {
    options.validate()?;
    let mut text = header(path, options);
    let (travel_word, feed_mm_min) = match options.travel {
        // G1 must have a feed rate, though no move runs at it.
        TravelMove::Rapid => ("G0", 600.0),
        TravelMove::Feed { feed_mm_min } => ("G1", feed_mm_min),
    };
    // Writing to a String cannot fail.
    let _ = writeln!(text, "M5\nG21 G90 G94 F{feed_mm_min}");
    for &position in path.positions_px() {
        let (x_mm, y_mm) = options.frame.machine_mm(position);
        let _ = writeln!(text, "{travel_word} X{} Y{}", millimetres(x_mm), millimetres(y_mm));
        if options.settling_s > 0.0 {
            let _ = writeln!(text, "G4 P{}", options.settling_s);
        }
        let _ = writeln!(text, "G1 M3 S{}\nG4 P{}\nM5", options.power_s, options.dwell_s);
    }
    text.push_str("M5 S0\n");
    Ok(text)
}

/// Comments that say what the program is, in which units, and where it goes.
fn header(path: &PulsePath, options: &GcodeOptions) -> String {
    let frame = &options.frame;
    let y_sense = match frame.y_axis {
        YAxis::Up => "up",
        YAxis::Down => "down",
    };
    let positions_mm = || path.positions_px().iter().map(|&p| frame.machine_mm(p));
    let low = positions_mm()
        .fold((f64::INFINITY, f64::INFINITY), |low, (x, y)| (low.0.min(x), low.1.min(y)));
    let high = positions_mm().fold((f64::NEG_INFINITY, f64::NEG_INFINITY), |high, (x, y)| {
        (high.0.max(x), high.1.max(y))
    });
    let bounds = if path.is_empty() {
        "; Bounding box: none\n".to_owned()
    } else {
        format!(
            "; Bounding box X {:.6} to {:.6}\n; Bounding box Y {:.6} to {:.6}\n",
            low.0, high.0, low.1, high.1
        )
    };
    format!(
        "; lasergym pulse program, GRBL dialect\n\
         ; Pulses: {}, radius {:.6} mm\n\
         ; Units: mm and s, absolute; x right, y {y_sense}\n\
         ; Workpiece corner X{} Y{}, pixel {} mm\n\
         {bounds}",
        path.len(),
        path.pulse_radius_px() * frame.pixel_um / 1e3,
        millimetres(frame.origin_x_mm),
        millimetres(frame.origin_y_mm),
        millimetres(frame.pixel_um / 1e3),
    )
}

/// A coordinate rounded to 10⁻¹² mm, without trailing zeros.
fn millimetres(value_mm: f64) -> String {
    let rounded = format!("{value_mm:.12}");
    let shortest = rounded.trim_end_matches('0').trim_end_matches('.');
    if shortest == "-0" { "0".to_owned() } else { shortest.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_gcode;
    use lasergym_geom::Point;
    use proptest::prelude::*;

    fn any_path() -> impl Strategy<Value = PulsePath> {
        let position = (-10.0..110.0, -10.0..110.0).prop_map(|(x, y)| Point::new(x, y));
        proptest::collection::vec(position, 0..40)
            .prop_map(|positions| PulsePath::new(positions, 9.0).unwrap())
    }

    fn any_options() -> impl Strategy<Value = GcodeOptions> {
        let frame = (-100.0..100.0, -100.0..100.0, any::<bool>(), 0.5..10.0).prop_map(
            |(origin_x_mm, origin_y_mm, up, pixel_um)| WorkpieceFrame {
                origin_x_mm,
                origin_y_mm,
                y_axis: if up { YAxis::Up } else { YAxis::Down },
                pixel_um,
            },
        );
        let travel = prop_oneof![
            Just(TravelMove::Rapid),
            (1e-3..1e6).prop_map(|feed_mm_min| TravelMove::Feed { feed_mm_min })
        ];
        (frame, 1e-3..1e6, 1e-3..3600.0, prop_oneof![Just(0.0), 1e-3..3600.0], travel).prop_map(
            |(frame, power_s, dwell_s, settling_s, travel)| GcodeOptions {
                frame,
                power_s,
                dwell_s,
                settling_s,
                travel,
            },
        )
    }

    proptest! {
        #[test]
        fn reading_what_was_written_gives_the_same_pulses(
            path in any_path(), options in any_options()
        ) {
            let text = write_gcode(&path, &options).unwrap();
            let read = read_gcode(&text, &options.frame, 9.0).unwrap();
            prop_assert_eq!(path.len(), read.len());
            for (a, b) in path.positions_px().iter().zip(read.positions_px()) {
                prop_assert!(a.distance(*b) <= 1e-8, "{} px", a.distance(*b));
            }
            prop_assert_eq!(write_gcode(&read, &options).unwrap(), text);
        }

        #[test]
        fn the_laser_is_off_first_last_and_whenever_an_axis_moves(
            path in any_path(), options in any_options()
        ) {
            let text = write_gcode(&path, &options).unwrap();
            let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with(';')).collect();
            prop_assert_eq!(lines[0], "M5");
            prop_assert_eq!(lines[lines.len() - 1], "M5 S0");
            let mut on = false;
            for line in lines {
                on = if line.contains("M5") { false } else { on || line.contains("M3") };
                prop_assert!(!(on && line.contains('X')), "{}", line);
            }
        }

        #[test]
        fn lines_fit_the_controller(path in any_path(), options in any_options()) {
            let text = write_gcode(&path, &options).unwrap();
            prop_assert!(text.is_ascii());
            prop_assert!(text.lines().all(|line| line.len() < 80));
        }
    }

    #[test]
    fn coordinates_are_plain_decimals() {
        for (value_mm, text) in
            [(0.05, "0.05"), (-0.0, "0"), (-1e-15, "0"), (120.0, "120"), (1e-9, "0.000000001")]
        {
            assert_eq!(millimetres(value_mm), text);
        }
    }

    #[test]
    fn options_out_of_range_are_named() {
        let good = GcodeOptions::default();
        let travel = TravelMove::Feed { feed_mm_min: 0.0 };
        let frame = WorkpieceFrame { pixel_um: f64::NAN, ..good.frame };
        let broken = [
            ("pixel_um", GcodeOptions { frame, ..good }),
            ("power_s", GcodeOptions { power_s: 0.0, ..good }),
            ("dwell_s", GcodeOptions { dwell_s: 0.0, ..good }),
            ("settling_s", GcodeOptions { settling_s: f64::INFINITY, ..good }),
            ("feed_mm_min", GcodeOptions { travel, ..good }),
        ];
        for (field, options) in broken {
            let path = PulsePath::new(Vec::new(), 9.0).unwrap();
            let error = write_gcode(&path, &options).unwrap_err();
            assert!(error.to_string().starts_with(field), "{error}");
        }
    }
}
