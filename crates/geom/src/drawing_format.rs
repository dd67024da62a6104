//! The file formats a drawing may have.

use std::{fmt, path::Path};

/// A format of drawings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawingFormat {
    /// Portable Network Graphics.
    Png,
    /// JPEG File Interchange Format.
    Jpeg,
    /// Scalable Vector Graphics, uncompressed.
    Svg,
    /// Drawing Exchange Format, ASCII.
    Dxf,
}

impl DrawingFormat {
    /// The format which the first bytes of a file show, if they show any.
    #[must_use]
    pub fn from_magic(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Some(Self::Png);
        }
        if bytes.starts_with(b"\xff\xd8\xff") {
            return Some(Self::Jpeg);
        }
        if bytes.starts_with(b"AutoCAD Binary DXF") {
            return Some(Self::Dxf);
        }
        let head = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let head = &head[..head.len().min(4096)];
        let text = head.trim_ascii_start();
        if text.starts_with(b"<") && contains(text, b"<svg") {
            return Some(Self::Svg);
        }
        // A DXF file begins with a group code: a comment (999) or the start of a section (0).
        let mut lines = text.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
        match (lines.next(), lines.next()) {
            (Some(b"0"), Some(b"SECTION")) | (Some(b"999"), Some(_)) => Some(Self::Dxf),
            _ => None,
        }
    }

    /// The format which the extension of `path` names, if it names any.
    #[must_use]
    pub fn from_extension(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "png" => Some(Self::Png),
            "jpg" | "jpeg" => Some(Self::Jpeg),
            "svg" => Some(Self::Svg),
            "dxf" => Some(Self::Dxf),
            _ => None,
        }
    }
}

impl fmt::Display for DrawingFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Svg => "SVG",
            Self::Dxf => "DXF",
        })
    }
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|window| window == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_shows_the_format() {
        let cases: [(&[u8], Option<DrawingFormat>); 8] = [
            (b"\x89PNG\r\n\x1a\n....", Some(DrawingFormat::Png)),
            (b"\xff\xd8\xff\xe0", Some(DrawingFormat::Jpeg)),
            (b"\xef\xbb\xbf<?xml version=\"1.0\"?>\n<svg/>", Some(DrawingFormat::Svg)),
            (b"  <!-- drawn by hand --><svg/>", Some(DrawingFormat::Svg)),
            (b"  0\r\nSECTION\r\n", Some(DrawingFormat::Dxf)),
            (b"999\nwritten by hand\n0\nSECTION\n", Some(DrawingFormat::Dxf)),
            (b"GIF89a", None),
            (b"", None),
        ];
        for (bytes, format) in cases {
            assert_eq!(DrawingFormat::from_magic(bytes), format, "{bytes:?}");
        }
    }

    #[test]
    fn an_extension_names_the_format_in_either_case() {
        assert_eq!(DrawingFormat::from_extension(Path::new("a.JPEG")), Some(DrawingFormat::Jpeg));
        assert_eq!(DrawingFormat::from_extension(Path::new("a.b.dxf")), Some(DrawingFormat::Dxf));
        assert_eq!(DrawingFormat::from_extension(Path::new("dxf")), None);
    }
}
