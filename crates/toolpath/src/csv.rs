//! Pulses as comma-separated values.

use std::fmt::Write;

use lasergym_geom::{PIXEL_UM, Point};

use crate::error::{check_pulse_count, check_text_length, shortened};
use crate::pulse_path::{check_pulse_radius, in_range};
use crate::{PulsePath, ToolpathError};

/// First line of a pulse file. `pulse` counts 1, 2, 3, … in firing order; positions are measured
/// from the top left corner of the workpiece, x right, y down.
pub const CSV_HEADER: &str = "pulse,x_um,y_um";

/// The pulses of `path` as text: [`CSV_HEADER`], then one line each.
///
/// Numbers are the shortest that read back as the same `f64`, so with pixels of 1 µm
/// [`read_csv`] returns the same bits.
#[must_use]
pub fn write_csv(path: &PulsePath) -> String {
    let mut text = format!("{CSV_HEADER}\n");
    for (k, position) in path.positions_px().iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{},{},{}", k + 1, position.x * PIXEL_UM, position.y * PIXEL_UM);
    }
    text
}

/// The pulses written in `text`, all of radius `pulse_radius_px`, which the file does not hold.
///
/// Lines end with LF or CR LF; spaces around fields, empty lines at the end and a byte-order mark
/// are ignored.
///
/// # Errors
/// The `Csv` variants and [`ToolpathError::PositionInLine`] say what is wrong in which line;
/// [`ToolpathError::TextTooLong`], [`ToolpathError::TooManyPulses`] and
/// [`ToolpathError::PulseRadius`] guard the limits.
pub fn read_csv(text: &str, pulse_radius_px: f64) -> Result<PulsePath, ToolpathError> {
    check_text_length(text)?;
    check_pulse_radius(pulse_radius_px)?;
    let body = text.strip_prefix('\u{feff}').unwrap_or(text).trim_end();
    let mut lines = body.lines();
    let header = lines.next().unwrap_or_default();
    if !header.split(',').map(str::trim).eq(CSV_HEADER.split(',')) {
        return Err(ToolpathError::CsvHeader { found: shortened(header) });
    }
    let mut positions_px = Vec::new();
    for (k, content) in lines.enumerate() {
        check_pulse_count(k + 1)?;
        positions_px.push(read_line(content, k + 2, k + 1)?);
    }
    PulsePath::new(positions_px, pulse_radius_px)
}

/// The position in the line number `line`, which must hold pulse number `pulse`.
fn read_line(content: &str, line: usize, pulse: usize) -> Result<Point, ToolpathError> {
    let mut fields = content.split(',').map(str::trim);
    let (Some(number), Some(x), Some(y), None) =
        (fields.next(), fields.next(), fields.next(), fields.next())
    else {
        return Err(ToolpathError::CsvFieldCount { line, found: content.split(',').count() });
    };
    if number.parse() != Ok(pulse) {
        return Err(ToolpathError::CsvPulseNumber {
            line,
            expected: pulse,
            found: shortened(number),
        });
    }
    let position = Point::new(
        read_number(x, line, "x_um")? / PIXEL_UM,
        read_number(y, line, "y_um")? / PIXEL_UM,
    );
    if !in_range(position) {
        return Err(ToolpathError::PositionInLine { line, x_px: position.x, y_px: position.y });
    }
    Ok(position)
}

fn read_number(field: &str, line: usize, column: &'static str) -> Result<f64, ToolpathError> {
    field.parse().map_err(|_| ToolpathError::CsvNumber { line, column, found: shortened(field) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fault(text: &str) -> ToolpathError {
        read_csv(text, 9.0).unwrap_err()
    }

    proptest! {
        #[test]
        fn reading_what_was_written_gives_the_same_bits(
            positions in proptest::collection::vec((-1e6..1e6_f64, -1e6..1e6_f64), 0..50)
        ) {
            let points = positions.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let path = PulsePath::new(points, 7.5).unwrap();
            let read = read_csv(&write_csv(&path), 7.5).unwrap();
            for (a, b) in path.positions_px().iter().zip(read.positions_px()) {
                prop_assert_eq!((a.x.to_bits(), a.y.to_bits()), (b.x.to_bits(), b.y.to_bits()));
            }
            prop_assert_eq!(path, read);
        }

        #[test]
        fn any_text_is_read_or_refused(text in "(pulse,x_um,y_um\n)?[-0-9e.,\r\n \\PC]{0,80}") {
            let _ = read_csv(&text, 9.0);
        }
    }

    #[test]
    fn spaces_line_ends_and_marks_do_not_matter() {
        let text = "\u{feff}pulse, x_um ,y_um\r\n1, 2.5 ,-3\r\n2,4e1,5\r\n\r\n";
        let path = read_csv(text, 9.0).unwrap();
        assert_eq!(path.positions_px(), [Point::new(2.5, -3.0), Point::new(40.0, 5.0)]);
    }

    #[test]
    fn a_wrong_header_is_refused() {
        for text in ["", "1,2,3\n", "pulse;x_um;y_um\n", "pulse,x_mm,y_mm\n1,2,3\n"] {
            assert!(matches!(fault(text), ToolpathError::CsvHeader { .. }), "{text:?}");
        }
    }

    #[test]
    fn a_line_of_other_than_three_fields_is_refused() {
        let expected = ToolpathError::CsvFieldCount { line: 3, found: 2 };
        assert_eq!(fault("pulse,x_um,y_um\n1,2,3\n2,4\n"), expected);
        let expected = ToolpathError::CsvFieldCount { line: 2, found: 4 };
        assert_eq!(fault("pulse,x_um,y_um\n1,2,3,4\n"), expected);
        // An empty line between pulses has one empty field.
        let expected = ToolpathError::CsvFieldCount { line: 2, found: 1 };
        assert_eq!(fault("pulse,x_um,y_um\n\n1,2,3\n"), expected);
    }

    #[test]
    fn a_field_that_is_no_number_is_refused() {
        let error = fault("pulse,x_um,y_um\n1,2,3\n2,4,five\n");
        let found = "five".to_owned();
        assert_eq!(error, ToolpathError::CsvNumber { line: 3, column: "y_um", found });
    }

    #[test]
    fn pulses_out_of_order_are_refused() {
        for number in ["2", "0", "-1", "1.0", "x"] {
            let error = fault(&format!("pulse,x_um,y_um\n{number},2,3\n"));
            assert!(
                matches!(error, ToolpathError::CsvPulseNumber { line: 2, expected: 1, .. }),
                "{error}"
            );
        }
    }

    #[test]
    fn a_position_out_of_range_is_refused() {
        for x in ["NaN", "inf", "1e7"] {
            let error = fault(&format!("pulse,x_um,y_um\n1,{x},3\n"));
            assert!(matches!(error, ToolpathError::PositionInLine { line: 2, .. }), "{error}");
        }
    }

    #[test]
    fn a_long_field_is_shortened_in_the_message() {
        let text = format!("pulse,x_um,y_um\n1,{},3\n", "é".repeat(10_000));
        assert!(fault(&text).to_string().len() < 120);
    }

    #[test]
    fn a_radius_out_of_range_is_refused() {
        let error = read_csv("pulse,x_um,y_um\n", 0.0).unwrap_err();
        assert_eq!(error, ToolpathError::PulseRadius { radius_px: 0.0 });
    }
}
