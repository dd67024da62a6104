//! Pulses out of G-code, GRBL dialect.

use lasergym_geom::Point;

use crate::error::{check_pulse_count, check_text_length};
use crate::gcode_words::{Word, words};
use crate::pulse_path::{check_pulse_radius, in_range};
use crate::{PulsePath, ToolpathError, WorkpieceFrame};

/// The words the reader understands.
const ACCEPTED: &str =
    "G0 G1 G4 G17 G20 G21 G90 G91 G94, M2 M3 M4 M5 M30 and the letters X Y F S P N";

const MM_PER_INCH: f64 = 25.4;

/// The pulses that `text` fires: one for every dwell of more than 0 s with the laser on.
///
/// The laser is on after M3 or M4 with a power S above 0. The start is G0, G21 (mm), G90 (absolute),
/// laser off, S0 and no known position. The words of a line act in GRBL's order: S, M3/M4/M5, dwell,
/// units, distance mode, motion. Also read: F, G17 and G94 (no effect on pulses), line numbers N,
/// comments `;…` and `(…)`, `%` lines, lower case, and M2 or M30 as the end.
///
/// `frame` turns machine positions into workpiece pixels; `pulse_radius_px` is the radius of every
/// pulse, which a program does not hold.
///
/// # Errors
/// The `Gcode` variants say what is wrong in which line. Whatever has no meaning as a pulse is
/// refused: a move with the laser on, even one of length 0; a laser switched off without a dwell, or
/// left on at the end; a pulse at an unknown position. [`ToolpathError::PositionInLine`],
/// [`ToolpathError::TextTooLong`], [`ToolpathError::TooManyPulses`], [`ToolpathError::PulseRadius`]
/// and [`ToolpathError::OptionValue`] guard the limits.
pub fn read_gcode(
    text: &str,
    frame: &WorkpieceFrame,
    pulse_radius_px: f64,
) -> Result<PulsePath, ToolpathError> {
    check_text_length(text)?;
    check_pulse_radius(pulse_radius_px)?;
    frame.validate()?;
    let mut machine = Machine::new(frame);
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (k, content) in text.lines().enumerate() {
        if content.trim() != "%" {
            machine.execute(&Block::read(content, k + 1)?)?;
        }
    }
    machine.end()?;
    PulsePath::new(machine.positions_px, pulse_radius_px)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Distance {
    Absolute,
    Relative,
}

/// What one line says, each modal group at most once.
#[derive(Debug, Default, PartialEq)]
struct Block {
    line: usize,
    number: Option<u32>,
    motion: Option<u32>,
    plane: Option<u32>,
    feed_mode: Option<u32>,
    mm_per_unit: Option<f64>,
    distance: Option<Distance>,
    laser: Option<bool>,
    dwell: Option<()>,
    end: Option<u32>,
    x: Option<f64>,
    y: Option<f64>,
    feed: Option<f64>,
    power: Option<f64>,
    dwell_s: Option<f64>,
}

impl Block {
    fn read(content: &str, line: usize) -> Result<Self, ToolpathError> {
        let mut block = Self { line, ..Self::default() };
        for word in words(content, line)? {
            block.take(word)?;
        }
        if block.dwell.is_some() != block.dwell_s.is_some() {
            return Err(ToolpathError::GcodeDwell { line });
        }
        Ok(block)
    }

    fn is_empty(&self) -> bool {
        *self == Self { line: self.line, ..Self::default() }
    }

    fn take(&mut self, word: Word) -> Result<(), ToolpathError> {
        let fresh = match (word.letter, word.code()) {
            ('G', Some(code @ (0 | 1))) => put(&mut self.motion, code),
            ('G', Some(4)) => put(&mut self.dwell, ()),
            ('G', Some(17)) => put(&mut self.plane, 17),
            ('G', Some(20)) => put(&mut self.mm_per_unit, MM_PER_INCH),
            ('G', Some(21)) => put(&mut self.mm_per_unit, 1.0),
            ('G', Some(90)) => put(&mut self.distance, Distance::Absolute),
            ('G', Some(91)) => put(&mut self.distance, Distance::Relative),
            ('G', Some(94)) => put(&mut self.feed_mode, 94),
            ('M', Some(code @ (2 | 30))) => put(&mut self.end, code),
            ('M', Some(3 | 4)) => put(&mut self.laser, true),
            ('M', Some(5)) => put(&mut self.laser, false),
            ('N', Some(number)) => put(&mut self.number, number),
            ('N', None) => return Err(self.value(word, "line numbers are whole, 0 to 9999999")),
            ('X', _) => put(&mut self.x, word.number),
            ('Y', _) => put(&mut self.y, word.number),
            ('F' | 'S' | 'P', _) if word.number < 0.0 => {
                return Err(self.value(word, "feed, power and dwell are 0 or more"));
            }
            ('F', _) => put(&mut self.feed, word.number),
            ('S', _) => put(&mut self.power, word.number),
            ('P', _) => put(&mut self.dwell_s, word.number),
            _ => {
                return Err(ToolpathError::GcodeUnsupported {
                    line: self.line,
                    word: word.to_string(),
                    accepted: ACCEPTED,
                });
            }
        };
        if fresh {
            return Ok(());
        }
        Err(ToolpathError::GcodeConflict { line: self.line, word: word.to_string() })
    }

    fn value(&self, word: Word, accepted: &'static str) -> ToolpathError {
        ToolpathError::GcodeValue { line: self.line, word: word.to_string(), accepted }
    }
}

/// Fills `slot`; whether it was empty.
fn put<T>(slot: &mut Option<T>, value: T) -> bool {
    slot.replace(value).is_none()
}

/// Modal state, and the pulses fired so far.
struct Machine<'a> {
    frame: &'a WorkpieceFrame,
    mm_per_unit: f64,
    distance: Distance,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    enabled: bool,
    power: f64,
    /// Line that switched the laser on, while it is on.
    on_since: Option<usize>,
    dwelt: bool,
    ended: bool,
    positions_px: Vec<Point>,
}

impl<'a> Machine<'a> {
    fn new(frame: &'a WorkpieceFrame) -> Self {
        Self {
            frame,
            mm_per_unit: 1.0,
            distance: Distance::Absolute,
            x_mm: None,
            y_mm: None,
            enabled: false,
            power: 0.0,
            on_since: None,
            dwelt: false,
            ended: false,
            positions_px: Vec::new(),
        }
    }

    fn execute(&mut self, block: &Block) -> Result<(), ToolpathError> {
        if block.is_empty() {
            return Ok(());
        }
        if self.ended {
            return Err(ToolpathError::GcodeAfterEnd { line: block.line });
        }
        self.switch_laser(block)?;
        if block.dwell_s.is_some_and(|dwell_s| dwell_s > 0.0) && self.on_since.is_some() {
            self.fire(block.line)?;
        }
        self.mm_per_unit = block.mm_per_unit.unwrap_or(self.mm_per_unit);
        self.distance = block.distance.unwrap_or(self.distance);
        self.travel(block)?;
        if block.end.is_some() {
            self.end()?;
            self.ended = true;
        }
        Ok(())
    }

    fn switch_laser(&mut self, block: &Block) -> Result<(), ToolpathError> {
        self.power = block.power.unwrap_or(self.power);
        self.enabled = block.laser.unwrap_or(self.enabled);
        let on = self.enabled && self.power > 0.0;
        if on && self.on_since.is_none() {
            self.on_since = Some(block.line);
            self.dwelt = false;
        } else if !on && self.on_since.take().is_some() && !self.dwelt {
            return Err(ToolpathError::GcodeLaserWithoutDwell { line: block.line });
        }
        Ok(())
    }

    fn fire(&mut self, line: usize) -> Result<(), ToolpathError> {
        let (Some(x_mm), Some(y_mm)) = (self.x_mm, self.y_mm) else {
            return Err(ToolpathError::GcodeUnknownPosition { line });
        };
        let position = self.frame.workpiece_px(x_mm, y_mm);
        if !in_range(position) {
            return Err(ToolpathError::PositionInLine { line, x_px: position.x, y_px: position.y });
        }
        check_pulse_count(self.positions_px.len() + 1)?;
        self.positions_px.push(position);
        self.dwelt = true;
        Ok(())
    }

    fn travel(&mut self, block: &Block) -> Result<(), ToolpathError> {
        let line = block.line;
        if block.x.is_none() && block.y.is_none() {
            return Ok(());
        }
        if self.on_since.is_some() {
            return Err(ToolpathError::GcodeLaserOnWhileMoving { line });
        }
        for (word, axis_mm) in [(block.x, &mut self.x_mm), (block.y, &mut self.y_mm)] {
            let Some(word) = word else { continue };
            let start_mm = match self.distance {
                Distance::Absolute => 0.0,
                Distance::Relative => {
                    axis_mm.ok_or(ToolpathError::GcodeUnknownPosition { line })?
                }
            };
            *axis_mm = Some(start_mm + word * self.mm_per_unit);
        }
        Ok(())
    }

    fn end(&self) -> Result<(), ToolpathError> {
        match self.on_since {
            Some(line) => Err(ToolpathError::GcodeLaserLeftOn { line }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::YAxis;
    use proptest::prelude::*;

    const FRAME: WorkpieceFrame = WorkpieceFrame {
        origin_x_mm: 0.0,
        origin_y_mm: 0.0,
        y_axis: YAxis::Down,
        pixel_um: 1000.0,
    };

    /// Pulses of `text` on a machine whose millimetres are pixels.
    fn pulses(text: &str) -> Vec<(f64, f64)> {
        let path = read_gcode(text, &FRAME, 9.0).unwrap();
        path.positions_px().iter().map(|position| (position.x, position.y)).collect()
    }

    fn fault(text: &str) -> ToolpathError {
        read_gcode(text, &FRAME, 9.0).unwrap_err()
    }

    #[test]
    fn every_dwell_with_the_laser_on_is_a_pulse() {
        let text = "G0X1Y2\nM3S9\nG4P.1\nG4P.1\nM5\nG4 P1\nG0 X5\nM4\nG4P.1\nM5";
        assert_eq!(pulses(text), [(1.0, 2.0), (1.0, 2.0), (5.0, 2.0)]);
    }

    #[test]
    fn relative_moves_and_inches_are_followed() {
        let text = "G20 G90 G0 X1 Y0\nG91 G21\nX1\nY-3\nX1 M3 S1";
        assert!(matches!(fault(text), ToolpathError::GcodeLaserOnWhileMoving { line: 5 }));
        let text = "G20 G90 G0 X1 Y0\nG91 G21\nX1\nY-3\nM3 S1 G4 P1\nM5";
        assert_eq!(pulses(text), [(26.4, -3.0)]);
    }

    #[test]
    fn the_words_of_a_line_act_in_the_order_of_the_machine() {
        // Off before moving, on before dwelling, dwelling before moving on.
        let text = "G0 X1 Y1\nG4 P1 M3 S1\nG0 X2 M5\nM3 G4 P1\nX3 G4 P1 M5";
        assert_eq!(pulses(text), [(1.0, 1.0), (2.0, 1.0)]);
    }

    #[test]
    fn decoration_is_ignored() {
        let text =
            "\u{feff}%\nN10 (start) g17 g94 f600 ; x\n\nN20g0x1y1\nm3s1\ng4p1\nm5\nM30\n\n%\n";
        assert_eq!(pulses(text), [(1.0, 1.0)]);
    }

    #[test]
    fn a_laser_without_power_or_a_dwell_without_time_fires_nothing() {
        assert_eq!(pulses("G0X1Y1\nM3\nG4P1\nM5\nS5\nG4P1\nM3S0\nG0X2\nM5"), []);
        assert_eq!(pulses("G0X1Y1\nM3S1\nG4P0\nG4P1\nM5").len(), 1);
        assert_eq!(pulses(""), []);
    }

    #[test]
    fn a_word_without_meaning_here_is_refused_and_the_others_listed() {
        for (word, shown) in
            [("G2", "G2"), ("g38.2", "G38.2"), ("M7", "M7"), ("Z1", "Z1"), ("G-1", "G-1")]
        {
            let error = fault(&format!("G90\n{word}\n"));
            let message = error.to_string();
            assert!(matches!(error, ToolpathError::GcodeUnsupported { line: 2, .. }), "{message}");
            assert!(message.contains(shown) && message.contains("G0 G1 G4"), "{message}");
        }
        // An exponent is the letter E.
        assert!(matches!(fault("X1e5"), ToolpathError::GcodeUnsupported { .. }));
    }

    #[test]
    fn what_is_no_word_is_refused() {
        for text in ["$H", "X", "!", "X--1", "/G0 X1"] {
            assert!(matches!(fault(text), ToolpathError::GcodeWord { line: 1, .. }), "{text}");
        }
        assert!(matches!(fault("\n(open"), ToolpathError::GcodeOpenComment { line: 2 }));
    }

    #[test]
    fn a_value_out_of_range_is_refused() {
        for text in ["F-1", "S-1", "G4 P-1", "N1.5", "N-1", "N99999999"] {
            assert!(matches!(fault(text), ToolpathError::GcodeValue { line: 1, .. }), "{text}");
        }
    }

    #[test]
    fn words_that_exclude_each_other_are_refused() {
        for text in ["G0 G1", "G90 G91", "G20 G21", "M3 M5", "X1 X2", "S1 S1", "N1 N1", "M2 M30"] {
            assert!(matches!(fault(text), ToolpathError::GcodeConflict { line: 1, .. }), "{text}");
        }
    }

    #[test]
    fn a_dwell_needs_its_time_and_a_time_its_dwell() {
        for text in ["G4", "P1", "G0 P1"] {
            assert_eq!(fault(text), ToolpathError::GcodeDwell { line: 1 });
        }
    }

    #[test]
    fn a_pulse_needs_a_known_position() {
        for text in ["M3S1\nG4P1", "G0X1\nM3S1G4P1"] {
            let line = 2;
            assert_eq!(fault(text), ToolpathError::GcodeUnknownPosition { line });
        }
        assert_eq!(fault("G91 X1 Y1"), ToolpathError::GcodeUnknownPosition { line: 1 });
    }

    #[test]
    fn moving_with_the_laser_on_is_refused() {
        for text in ["G0X1Y1\nM3S1\nG0X2", "G0X1Y1\nM3S1G4P1\nG1Y2F6", "M3\nX1\nX1 S5"] {
            let error = fault(text);
            assert_eq!(error, ToolpathError::GcodeLaserOnWhileMoving { line: 3 });
        }
    }

    #[test]
    fn switching_off_without_a_dwell_is_refused() {
        for text in ["G0X1Y1\nM3S1\nM5", "G0X1Y1\nM3S1\nS0", "G0X1Y1\nM3S1\nM5G4P1"] {
            assert_eq!(fault(text), ToolpathError::GcodeLaserWithoutDwell { line: 3 });
        }
    }

    #[test]
    fn a_laser_left_on_is_refused() {
        for text in ["G0X1Y1\nM3S1\nG4P1", "G0X1Y1\nM3S1\nG4P1\nM2", "G0X1Y1\nM3S1\nG4P1\nM30"] {
            assert_eq!(fault(text), ToolpathError::GcodeLaserLeftOn { line: 2 });
        }
    }

    #[test]
    fn nothing_follows_the_end() {
        assert_eq!(fault("M2\n; fine\nG0 X1"), ToolpathError::GcodeAfterEnd { line: 3 });
    }

    #[test]
    fn a_position_out_of_range_is_refused() {
        let huge = "9".repeat(308);
        for text in ["G0 X2000000 Y0\nM3S1G4P1", &format!("G0X{huge}Y0\nG91\nX{huge}\nM3S1G4P1")] {
            assert!(matches!(fault(text), ToolpathError::PositionInLine { .. }));
        }
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let error = read_gcode("", &FRAME, -1.0).unwrap_err();
        assert!(matches!(error, ToolpathError::PulseRadius { .. }));
        let error = read_gcode("", &WorkpieceFrame { pixel_um: 0.0, ..FRAME }, 9.0).unwrap_err();
        assert!(matches!(error, ToolpathError::OptionValue { name: "pixel_um", .. }));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[GMXYFSPNgmxy0-9 .+\\-;()%\n\\PC]{0,120}") {
            let _ = read_gcode(&text, &WorkpieceFrame::default(), 9.0);
        }

        #[test]
        fn any_words_are_read_or_refused(
            picks in proptest::collection::vec(0_usize..20, 0..60)
        ) {
            const PIECES: [&str; 20] = [
                "G0", "G1", "G4", "P1", "P0", "M3", "M4", "M5", "S9", "S0", "X1", "Y-2.5", "G20",
                "G21", "G90", "G91", "M2", "\n", "\n", "\n",
            ];
            let text: Vec<&str> = picks.iter().map(|&k| PIECES[k]).collect();
            let _ = read_gcode(&text.join(" "), &WorkpieceFrame::default(), 9.0);
        }
    }
}
