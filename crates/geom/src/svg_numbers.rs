//! Numbers of an SVG document, bounded before they are computed with.
//!
//! A curve with a radius of 10³⁰ is cut into countless pieces, and renderers break on coordinates
//! whose differences are lost to rounding.

use resvg::usvg::roxmltree;

use crate::DrawingError;

/// Largest number in geometry, user units.
const MAX_NUMBER: f64 = 1e9;

/// Refuses documents whose attributes or style sheets have numbers beyond [`MAX_NUMBER`].
pub(crate) fn check_numbers(xml: &roxmltree::Document<'_>) -> Result<(), DrawingError> {
    for node in xml.descendants() {
        for attribute in node.attributes() {
            let is_geometry =
                attribute.namespace().is_none() && !["class", "id"].contains(&attribute.name());
            if is_geometry {
                check(attribute.value(), attribute.name() == "d")?;
            }
        }
        if node.tag_name().name() == "style" {
            check(node.text().unwrap_or_default(), false)?;
        }
    }
    Ok(())
}

/// Checks each number of `text`. Digits of names and colours are no numbers; in path data
/// (`has_commands`) letters stand right before numbers.
fn check(text: &str, has_commands: bool) -> Result<(), DrawingError> {
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_alphanumeric() || "#_.".contains(c)) {
        rest = &rest[start..];
        let is_number = rest.starts_with(|c: char| c.is_ascii_digit() || c == '.');
        let length = if is_number {
            number_length(rest.as_bytes())
        } else if has_commands {
            1
        } else {
            let in_name = |c: char| c.is_alphanumeric() || "#_-.".contains(c);
            rest.find(|c| !in_name(c)).unwrap_or(rest.len())
        };
        if is_number && rest[..length].parse::<f64>().is_ok_and(|number| number > MAX_NUMBER) {
            return Err(DrawingError::TooLarge {
                unit: "user units or more somewhere",
                found: rest[..length].parse::<f64>().unwrap_or(f64::MAX) as u64,
                limit: MAX_NUMBER as u64,
            });
        }
        rest = &rest[length..];
    }
    Ok(())
}

/// Number of bytes of the number that `text` begins with: digits, fraction, exponent.
fn number_length(text: &[u8]) -> usize {
    let digits = |from: usize| {
        text[from..].iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(text.len() - from)
    };
    let mut length = digits(0);
    if text.get(length) == Some(&b'.') {
        length += 1 + digits(length + 1);
    }
    if let Some(b'e' | b'E') = text.get(length) {
        let sign = usize::from(matches!(text.get(length + 1), Some(b'+' | b'-')));
        let exponent = length + 1 + sign;
        if text.get(exponent).is_some_and(u8::is_ascii_digit) {
            length = exponent + digits(exponent);
        }
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_where_they_stand() {
        for text in ["2e9", "-1E+30px", "scale(1e30)", "0 0 100 99999999999", "stroke-width:1e10"] {
            assert!(check(text, false).is_err(), "{text}");
        }
        for text in ["M1e30-5", "m.5.5.5e12", "a54 1e30 1 1 108 0"] {
            assert!(check(text, true).is_err(), "{text}");
        }
    }

    #[test]
    fn names_colours_and_small_numbers_pass() {
        for text in ["#1e9999", "url(#p1e99)", "12em", "1e", ".", "1e-30", "999999999", ".c1e99{}"]
        {
            assert!(check(text, false).is_ok(), "{text}");
        }
        assert!(check("M0 0h9v9.5.5e1-3z", true).is_ok());
    }
}
