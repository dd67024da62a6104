//! Tables of numbers with a fixed header: recorded responses, trajectories and test lines.

use crate::GalvoError;

/// Longest text of a table, bytes.
pub(crate) const MAX_TABLE_BYTES: usize = 64 << 20;

/// The rows below `header`, each with as many finite numbers as the header has names.
///
/// Blank lines and lines that begin with `#` are skipped; a byte order mark is ignored.
pub(crate) fn read_table(text: &str, header: &str) -> Result<Vec<Vec<f64>>, GalvoError> {
    Ok(read_table_with(text, header, &[])?.into_iter().map(|(_, row)| row).collect())
}

/// As [`read_table`], with the line of each row, where columns named in `optional` may follow in any
/// order. Rows have them in the order of `optional`, NaN where they are missing; `x` and `y` in a
/// column `axis` are 0 and 1.
pub(crate) fn read_table_with(
    text: &str,
    header: &str,
    optional: &[&str],
) -> Result<Vec<(usize, Vec<f64>)>, GalvoError> {
    if text.len() > MAX_TABLE_BYTES {
        let reason = format!("the text has more than {MAX_TABLE_BYTES} bytes: split the file");
        return Err(GalvoError::Table { line: 1, column: 1, reason });
    }
    let required: Vec<&str> = header.split(',').collect();
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let first = lines.next().map_or("", |(_, line)| line);
    let names: Vec<&str> = first.split(',').map(str::trim).collect();
    let extra = names.get(required.len()..).unwrap_or_default();
    let known = extra
        .iter()
        .enumerate()
        .all(|(k, name)| optional.contains(name) && !extra[..k].contains(name));
    if !names.starts_with(&required) || !known {
        let shown: String = first.chars().take(80).collect();
        let more = if optional.is_empty() {
            String::new()
        } else {
            format!(", which {} may follow", optional.join(" and "))
        };
        let reason = format!("the header is {shown:?}, not {header:?}{more}");
        return Err(GalvoError::Table { line: 1, column: 1, reason });
    }
    let places: Vec<Option<usize>> =
        optional.iter().map(|name| names.iter().position(|other| other == name)).collect();
    lines
        .map(|(k, line)| {
            let row = read_row(line, k + 1, &names)?;
            let more = places.iter().map(|place| place.map_or(f64::NAN, |place| row[place]));
            Ok((k + 1, row[..required.len()].iter().copied().chain(more).collect()))
        })
        .collect()
}

fn read_row(content: &str, line: usize, names: &[&str]) -> Result<Vec<f64>, GalvoError> {
    let count = content.split(',').count();
    if count != names.len() {
        let reason = format!("{count} fields instead of {}", names.len());
        return Err(GalvoError::Table { line, column: 1, reason });
    }
    let mut column = 1;
    let mut row = Vec::with_capacity(count);
    for (raw, name) in content.split(',').zip(names) {
        let field = raw.trim();
        if *name == "axis" {
            let Some(axis) = ["x", "y"].iter().position(|axis| *axis == field) else {
                let shown: String = field.chars().take(24).collect();
                let reason = format!("axis is {shown:?}, neither x nor y");
                return Err(GalvoError::Table { line, column, reason });
            };
            row.push(axis as f64);
            column += raw.chars().count() + 1;
            continue;
        }
        match field.parse::<f64>() {
            Ok(value) if value.is_finite() => row.push(value),
            _ => {
                let shown: String = field.chars().take(24).collect();
                let reason = format!("{name} is {shown:?}, not a number");
                return Err(GalvoError::Table { line, column, reason });
            }
        }
        column += raw.chars().count() + 1;
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

    #[test]
    fn optional_columns_may_follow() {
        let text = "a,b,time,axis\n1,2,3,y\n";
        let rows = read_table_with(text, "a,b", &["axis", "time"]).unwrap();
        assert_eq!(rows, [(2, vec![1.0, 2.0, 1.0, 3.0])]);
        let rows = read_table_with("a,b\n1,2\n", "a,b", &["axis"]).unwrap();
        assert!(rows[0].1[2].is_nan());
        for text in ["a,b,c\n", "a,axis,b\n", "a,b,axis,axis\n"] {
            assert!(read_table_with(text, "a,b", &["axis"]).is_err());
        }
        let error = read_table_with("a,b,axis\n1,2,z\n", "a,b", &["axis"]).unwrap_err();
        assert!(error.to_string().starts_with("line 2, column 5: axis"), "{error}");
    }
}
