//! Tables of numbers with a fixed header: recorded responses, trajectories and test lines.

use crate::GalvoError;

/// Longest text of a table, bytes.
pub(crate) const MAX_TABLE_BYTES: usize = 64 << 20;

/// The rows below `header`, each with as many finite numbers as the header has names.
///
/// Blank lines and lines that begin with `#` are skipped; a byte order mark is ignored.
pub(crate) fn read_table(text: &str, header: &str) -> Result<Vec<Vec<f64>>, GalvoError> {
    if text.len() > MAX_TABLE_BYTES {
        let reason = format!("the text has more than {MAX_TABLE_BYTES} bytes: split the file");
        return Err(GalvoError::Table { line: 1, column: 1, reason });
    }
    let names: Vec<&str> = header.split(',').collect();
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let first = lines.next().map_or("", |(_, line)| line);
    if first.split(',').map(str::trim).ne(names.iter().copied()) {
        let shown: String = first.chars().take(40).collect();
        let reason = format!("the header is {shown:?}, not {header:?}");
        return Err(GalvoError::Table { line: 1, column: 1, reason });
    }
    lines.map(|(k, line)| read_row(line, k + 1, &names)).collect()
}

fn read_row(content: &str, line: usize, names: &[&str]) -> Result<Vec<f64>, GalvoError> {
    let count = content.split(',').count();
    if count != names.len() {
        let reason = format!("{count} fields instead of {}", names.len());
        return Err(GalvoError::Table { line, column: 1, reason });
    }
    let mut column = 1;
    let mut row = Vec::with_capacity(count);
    for (field, name) in content.split(',').zip(names) {
        match field.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => row.push(value),
            _ => {
                let shown: String = field.trim().chars().take(24).collect();
                let reason = format!("{name} is {shown:?}, not a number");
                return Err(GalvoError::Table { line, column, reason });
            }
        }
        column += field.chars().count() + 1;
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_numbers_below_a_header() {
        let rows = read_table("\u{feff}a,b\n# note\n1, 2\n\n-3,4e1\n", "a,b").unwrap();
        assert_eq!(rows, [[1.0, 2.0], [-3.0, 40.0]]);
    }

    #[test]
    fn faults_have_a_place() {
        for (text, line, column) in [
            ("b,a\n", 1, 1),
            ("", 1, 1),
            ("a,b\n1\n", 2, 1),
            ("a,b\n1,2\n3,x\n", 3, 3),
            ("a,b\n1,inf", 2, 3),
        ] {
            let error = read_table(text, "a,b").unwrap_err();
            let place = format!("line {line}, column {column}: ");
            assert!(error.to_string().starts_with(&place), "{error}");
        }
    }
}
