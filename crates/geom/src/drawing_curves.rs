//! Drawings as curves: what a beam follows, in mm.

use std::path::Path;

use crate::{
    DrawingError, DrawingFormat, drawing::read_drawing, dxf_drawing::dxf_chains,
    svg_curves::svg_curves,
};

/// The curves of a drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawingCurves {
    /// Each curve as its points (x, y), x right and y up; closed ones end where they begin. SVG:
    /// mm at 96 px per inch from the lower left corner of the page. DXF: drawing units.
    pub curves: Vec<Vec<[f64; 2]>>,
}

impl DrawingCurves {
    /// Reads the file at `path`, SVG or DXF. The format goes by the content, where that shows none by
    /// the extension.
    ///
    /// # Errors
    /// As [`crate::load_drawing`]; [`DrawingError::Malformed`] for a picture, which has no curves.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, DrawingError> {
        let (bytes, format) = read_drawing(path.as_ref())?;
        Self::from_bytes(&bytes, format)
    }

    /// Reads the bytes of a drawing.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_bytes(bytes: &[u8], format: DrawingFormat) -> Result<Self, DrawingError> {
        let curves = match format {
            DrawingFormat::Svg => svg_curves(bytes)?,
            DrawingFormat::Dxf => dxf_chains(bytes)?,
            DrawingFormat::Png | DrawingFormat::Jpeg => {
                return Err(DrawingError::Malformed {
                    format,
                    reason: "it is a picture, which has no curves to follow: give SVG or DXF"
                        .into(),
                });
            }
        };
        if curves.is_empty() {
            return Err(DrawingError::NoShapes { format });
        }
        Ok(Self { curves })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn svg_curves_are_millimetres_with_y_up() {
        let svg = br#"<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="50mm" viewBox="0 0 100 50">
            <path d="M10 10 L30 10" stroke="black"/><circle cx="50" cy="20" r="5"/></svg>"#;
        let curves = DrawingCurves::from_bytes(svg, DrawingFormat::Svg).unwrap().curves;
        assert_eq!(curves.len(), 2);
        for (found, expected) in curves[0].iter().zip([[10.0, 40.0], [30.0, 40.0]]) {
            assert!((found[0] - expected[0]).abs() + (found[1] - expected[1]).abs() < 1e-3);
        }
        let circle = &curves[1];
        assert_eq!(circle.first(), circle.last());
        for [x, y] in circle {
            assert!(((x - 50.0).hypot(y - 30.0) - 5.0).abs() < 5e-3);
        }
    }

    #[test]
    fn dxf_lines_are_joined_to_chains_that_may_be_open() {
        let line = |x: f64, y: f64, u: f64, v: f64| {
            format!("0\nLINE\n8\n0\n10\n{x}\n20\n{y}\n11\n{u}\n21\n{v}\n")
        };
        let entities =
            line(0.0, 0.0, 10.0, 0.0) + &line(10.0, 5.0, 10.0, 0.0) + &line(40.0, 0.0, 50.0, 0.0);
        let dxf = format!("0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n");
        let mut curves =
            DrawingCurves::from_bytes(dxf.as_bytes(), DrawingFormat::Dxf).unwrap().curves;
        curves.sort_by_key(Vec::len);
        assert_eq!(curves.len(), 2);
        assert_eq!(curves[0].len(), 2);
        let ends = [curves[1][0], curves[1][curves[1].len() - 1]];
        assert!(
            ends == [[0.0, 0.0], [10.0, 5.0]] || ends == [[10.0, 5.0], [0.0, 0.0]],
            "{curves:?}"
        );
    }

    #[test]
    fn pictures_and_empty_drawings_have_no_curves() {
        let error = DrawingCurves::from_bytes(b"", DrawingFormat::Png).unwrap_err();
        assert!(error.to_string().contains("SVG or DXF"), "{error}");
        let svg = br#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>"#;
        let error = DrawingCurves::from_bytes(svg, DrawingFormat::Svg).unwrap_err();
        assert!(matches!(error, DrawingError::NoShapes { .. }), "{error}");
    }
}
