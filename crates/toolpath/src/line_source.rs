//! Lines of a file of any size, one at a time.

use std::io::BufRead;

use crate::ToolpathError;

/// Longest line that is read, bytes.
pub const MAX_LINE_BYTES: usize = 65_536;

/// Reads lines into one buffer; a byte-order mark is left out.
#[derive(Debug)]
pub struct LineSource<R> {
    reader: R,
    buffer: Vec<u8>,
    line: usize,
}

impl<R: BufRead> LineSource<R> {
    /// A source at the start of a file.
    pub fn new(reader: R) -> Self {
        Self { reader, buffer: Vec::new(), line: 0 }
    }

    /// Number of the line that was read last; 0 before the first.
    #[must_use]
    pub fn line(&self) -> usize {
        self.line
    }

    /// The next line without its end; none at the end of the file. Bytes that are no UTF-8 become �.
    ///
    /// # Errors
    /// [`ToolpathError::LineTooLong`] above [`MAX_LINE_BYTES`], [`ToolpathError::Unreadable`] when the
    /// reader fails.
    pub fn next_line(&mut self) -> Result<Option<std::borrow::Cow<'_, str>>, ToolpathError> {
        self.buffer.clear();
        self.line += 1;
        let line = self.line;
        let unreadable =
            |error: std::io::Error| ToolpathError::Unreadable { line, reason: error.to_string() };
        loop {
            let chunk = self.reader.fill_buf().map_err(unreadable)?;
            if chunk.is_empty() {
                if self.buffer.is_empty() {
                    return Ok(None);
                }
                break;
            }
            let end = chunk.iter().position(|&byte| byte == b'\n');
            let taken = end.unwrap_or(chunk.len());
            if self.buffer.len() + taken > MAX_LINE_BYTES {
                return Err(ToolpathError::LineTooLong { line });
            }
            self.buffer.extend_from_slice(&chunk[..taken]);
            self.reader.consume(end.map_or(taken, |end| end + 1));
            if end.is_some() {
                break;
            }
        }
        if self.buffer.last() == Some(&b'\r') {
            self.buffer.pop();
        }
        let mut content = &self.buffer[..];
        if self.line == 1 {
            content = content.strip_prefix("\u{feff}".as_bytes()).unwrap_or(content);
        }
        Ok(Some(String::from_utf8_lossy(content)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_without_their_ends() {
        let mut source = LineSource::new(&b"\xef\xbb\xbfa\r\nb\n\nc"[..]);
        let mut lines = Vec::new();
        while let Some(line) = source.next_line().unwrap() {
            lines.push(line.into_owned());
        }
        assert_eq!(lines, ["a", "b", "", "c"]);
    }

    #[test]
    fn a_line_without_end_is_refused_early() {
        let long = vec![b'x'; MAX_LINE_BYTES + 1];
        let error = LineSource::new(&long[..]).next_line().unwrap_err();
        assert_eq!(error, ToolpathError::LineTooLong { line: 1 });
    }
}
