//! Test lines on a simulated head, and the pattern of them for a real one.

use std::fmt::Write as _;

use lasergym_geom::Point;

use crate::calibration::{Axis, TestLine};
use crate::controller::ProgramRun;
use crate::delays::Delays;
use crate::laser::{Laser, PulseTrain};
use crate::player::PulseLanding;
use crate::program::{ProgramSettings, ProgramStep};
use crate::watched_head::Observer;
use crate::{Controller, GalvoError, ScanHead};

/// When the acceleration length ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AccelerationEnd {
    /// Where the speed first reaches this part of the set speed, in (0, 1): 0.937 gives the 350 µm of
    /// Penchev et al. at 2 m/s on the default head.
    Reaches(f64),
    /// Where the speed stays within this part of the set speed, in (0, 1).
    StaysWithin(f64),
}

/// Distance of the pulses by which a line is measured, µm.
const MEASURING_PITCH_UM: f64 = 0.25;

struct Pulses(Vec<PulseLanding>);

impl Observer for Pulses {
    fn pulse(&mut self, pulse: &PulseLanding) {
        self.0.push(*pulse);
    }
}

/// Machines a line of `length_um` in direction `angle_rad` without compensation, with a dense train of
/// pulses, and measures it.
///
/// # Errors
/// [`GalvoError::OutsideField`] when the line is longer than the field, and
/// [`GalvoError::InvalidOption`].
pub fn measure_line(
    head: &ScanHead,
    speed_m_s: f64,
    length_um: f64,
    angle_rad: f64,
    end: AccelerationEnd,
) -> Result<TestLine, GalvoError> {
    let bare = ScanHead {
        laser: Laser { train: PulseTrain::Synchronised, ..head.laser },
        controller: Controller { sky_writing: None, ..head.controller },
        ..head.clone()
    };
    let direction = Point::new(angle_rad.cos(), angle_rad.sin());
    let (from, to) = (direction * (-0.5 * length_um), direction * (0.5 * length_um));
    let settings = ProgramSettings {
        pulse_rate_hz: 1e6 * speed_m_s / MEASURING_PITCH_UM,
        delays: Delays::default(),
        ..ProgramSettings::of_head(&bare)
    };
    let mut run = ProgramRun::new(&bare, Pulses(Vec::new()));
    for step in [
        ProgramStep::Settings(settings),
        ProgramStep::Jump { to_um: from },
        ProgramStep::Mark { to_um: to, speed_m_s, lit: true },
    ] {
        run.step(&step)?;
    }
    let Pulses(pulses) = run.finish()?.0;
    let along = |pulse: &PulseLanding| {
        let way = pulse.position_um - from;
        way.x * direction.x + way.y * direction.y
    };
    let (Some(first), Some(last)) = (pulses.first(), pulses.last()) else {
        let reason = "the line has no pulse".to_owned();
        return Err(GalvoError::Calibration { reason });
    };
    let ended = match end {
        AccelerationEnd::Reaches(part) => {
            pulses.iter().find(|pulse| pulse.speed_m_s >= part * speed_m_s)
        }
        AccelerationEnd::StaysWithin(part) => {
            pulses.iter().rfind(|pulse| (pulse.speed_m_s / speed_m_s - 1.0).abs() > part)
        }
    };
    let ended = ended.unwrap_or(last);
    Ok(TestLine {
        speed_m_s,
        nominal_um: length_um,
        measured_um: along(last) - along(first),
        acceleration_um: along(ended) - along(first),
        axis: match (angle_rad.cos().abs(), angle_rad.sin().abs()) {
            (_, y) if y < 1e-9 => Some(Axis::X),
            (x, _) if x < 1e-9 => Some(Axis::Y),
            _ => None,
        },
        acceleration_time_us: Some(ended.time_us - first.time_us),
    })
}

/// A cutter-location file of test lines: for each speed `repeats` lines along x and as many along y,
/// `spacing_um` apart.
///
/// # Errors
/// [`GalvoError::InvalidOption`] for a speed, length or number out of range.
pub fn test_pattern(
    speeds_m_s: &[f64],
    length_um: f64,
    repeats: u32,
    spacing_um: f64,
) -> Result<String, GalvoError> {
    use crate::error::check_option;
    let ok = (1.0..=1e6).contains(&length_um);
    check_option("length_um", length_um, ok, "in [1, 1e6] µm")?;
    let ok = (1.0..=1e6).contains(&spacing_um);
    check_option("spacing_um", spacing_um, ok, "in [1, 1e6] µm")?;
    check_option("repeats", f64::from(repeats), (1..=1000).contains(&repeats), "in [1, 1000]")?;
    let mut text = String::from(
        "PARTNO lasergym test lines: measure length and acceleration length of each\nUNITS/MM\n",
    );
    let lines = speeds_m_s.len() as f64 * f64::from(repeats);
    for turned in [false, true] {
        let mut across = -0.5 * spacing_um * (lines - 1.0);
        for &speed in speeds_m_s {
            crate::program::check_speed("speed_m_s", speed)?;
            // Writing to a String cannot fail.
            let _ = writeln!(text, "$$ {speed} m/s\nFEDRAT/{},MMPM", speed * 60e3);
            for _ in 0..repeats {
                let shift = if turned { 0.5 } else { -0.5 } * (length_um + spacing_um);
                for (word, along) in [("RAPID\n", -0.5 * length_um), ("", 0.5 * length_um)] {
                    let (mut x, mut y) = (along + shift, across);
                    if turned {
                        (x, y) = (across + 0.5 * spacing_um * (lines + 1.0), along);
                    }
                    let _ = writeln!(text, "{word}GOTO/{:.6},{:.6},0", x * 1e-3, y * 1e-3);
                }
                across += spacing_um;
            }
        }
    }
    text.push_str("FINI\n");
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figures of Penchev et al. that are known.
    #[test]
    fn the_default_head_is_as_short_as_the_paper_measured() {
        let head = ScanHead::default();
        for (speed, short_um) in [(0.5, 107.3), (2.0, 431.9)] {
            for angle in [0.0_f64, 0.7, 2.0, 4.0] {
                let line =
                    measure_line(&head, speed, 2000.0, angle, AccelerationEnd::Reaches(0.937));
                let line = line.unwrap();
                let found = line.nominal_um - line.measured_um;
                assert!((found / short_um - 1.0).abs() < 0.02, "{speed} m/s: {found} µm");
                if speed > 1.0 {
                    let found = line.acceleration_um;
                    assert!((found / 350.0 - 1.0).abs() < 0.03, "{found} µm");
                }
            }
        }
    }

    #[test]
    fn a_pattern_has_its_lines() {
        let text = test_pattern(&[0.5, 1.0], 2000.0, 3, 100.0).unwrap();
        let mut reader = lasergym_toolpath::AptReader::new(text.as_bytes());
        let (mut marks, mut jumps) = (0, 0);
        while let Some(step) = reader.next_step().unwrap() {
            match step {
                lasergym_toolpath::VectorStep::Mark { .. } => marks += 1,
                _ => jumps += 1,
            }
        }
        assert_eq!((marks, jumps), (12, 12));
        assert!(test_pattern(&[0.0], 2000.0, 3, 100.0).is_err());
    }
}
