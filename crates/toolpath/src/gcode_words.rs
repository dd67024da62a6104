//! G-code lines taken apart into words: a letter and a decimal number each.

use crate::ToolpathError;
use crate::error::shortened;

/// One word, such as `X1.5`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Word {
    /// The letter in upper case.
    pub(crate) letter: char,
    /// The number, finite.
    pub(crate) number: f64,
}

impl Word {
    /// The number when it is whole and from 0 to 9 999 999, as those of G, M and N words are.
    pub(crate) fn code(self) -> Option<u32> {
        let whole = self.number.fract() == 0.0 && (0.0..=9_999_999.0).contains(&self.number);
        whole.then_some(self.number as u32)
    }
}

impl std::fmt::Display for Word {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.letter, shortened(&self.number.to_string()))
    }
}

/// The words of `content`, the line number `line`, without its comments.
///
/// # Errors
/// [`ToolpathError::GcodeOpenComment`] or [`ToolpathError::GcodeWord`] for the first thing that is
/// neither a comment nor a word.
pub(crate) fn words(content: &str, line: usize) -> Result<Vec<Word>, ToolpathError> {
    let mut words = Vec::new();
    let mut rest = content;
    while let Some((word, _, after)) = next_word(rest, line)? {
        words.push(word);
        rest = after;
    }
    Ok(words)
}

/// The next word of `rest` behind blanks and comments, the text from the word on, and what follows it.
///
/// # Errors
/// As [`words`].
pub(crate) fn next_word(
    rest: &str,
    line: usize,
) -> Result<Option<(Word, &str, &str)>, ToolpathError> {
    let mut rest = rest.trim_start();
    while rest.starts_with('(') {
        let (_, after) = rest.split_once(')').ok_or(ToolpathError::GcodeOpenComment { line })?;
        rest = after.trim_start();
    }
    if rest.is_empty() || rest.starts_with(';') {
        return Ok(None);
    }
    let (word, after) = first_word(rest)
        .ok_or_else(|| ToolpathError::GcodeWord { line, found: shortened(rest) })?;
    Ok(Some((word, rest, after)))
}

/// The word at the start of `text` and what follows it.
fn first_word(text: &str) -> Option<(Word, &str)> {
    let letter = text.chars().next().filter(char::is_ascii_alphabetic)?;
    let number = text[1..].trim_start();
    let is_numeric = |c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.');
    let (digits, rest) = number.split_at(number.find(|c| !is_numeric(c)).unwrap_or(number.len()));
    let number = digits.parse().ok().filter(|number: &f64| number.is_finite())?;
    Some((Word { letter: letter.to_ascii_uppercase(), number }, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_need_no_spaces_and_no_case() {
        let expected = [('G', 1.0), ('X', -0.5), ('Y', 2.0), ('F', 600.0)]
            .map(|(letter, number)| Word { letter, number });
        for line in ["G1X-.5Y+2.F600", "g01 x -0.5 (away) y2 f600 ; done", "\tG1 X-0.50Y2F 600\r"] {
            assert_eq!(words(line, 1).unwrap(), expected, "{line}");
        }
    }

    #[test]
    fn comments_hold_anything() {
        for line in ["", "  ", "; G99 ( é", "(G99 ; (é)", "(a)(b);c"] {
            assert_eq!(words(line, 1).unwrap(), [], "{line}");
        }
    }

    #[test]
    fn what_is_no_word_is_shown() {
        for (line, shown) in [
            ("G1 X", "X"),
            ("G1 X-", "X-"),
            ("X1.2.3", "X1.2.3"),
            ("X1 2", "2"),
            ("$H", "$H"),
            ("é1", "é1"),
            ("G1 %", "%"),
        ] {
            let found = shown.to_owned();
            assert_eq!(words(line, 7).unwrap_err(), ToolpathError::GcodeWord { line: 7, found });
        }
    }

    #[test]
    fn a_number_too_large_for_f64_is_no_word() {
        let line = format!("X{}", "9".repeat(400));
        assert!(matches!(words(&line, 1), Err(ToolpathError::GcodeWord { .. })));
    }

    #[test]
    fn a_comment_left_open_is_refused() {
        let expected = ToolpathError::GcodeOpenComment { line: 3 };
        assert_eq!(words("G1 (never", 3).unwrap_err(), expected);
    }
}
