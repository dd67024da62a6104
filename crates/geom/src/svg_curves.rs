//! Shapes of SVG documents as curves.

use resvg::{tiny_skia::PathSegment, usvg};

use crate::{CubicBezier, DrawingError, DrawingFormat, Point, svg_drawing::with_document};

/// mm per unit of the page: 96 px per inch.
const MM_PER_PX: f64 = 25.4 / 96.0;

/// Most that chords leave their curve, mm.
const CHORD_MM: f64 = 0.005;

/// Fewest chords of a curved segment: small rounds stay round.
const FEWEST_CHORDS: f64 = 16.0;

/// Most chords of a curved segment.
const MOST_CHORDS: f64 = 1000.0;

/// Largest number of points of all curves.
const MAX_POINTS: usize = 4_000_000;

/// The outlines and lines of all visible shapes, mm, y up.
pub(crate) fn svg_curves(bytes: &[u8]) -> Result<Vec<Vec<[f64; 2]>>, DrawingError> {
    with_document(bytes, |document| {
        let mut flattened = Flattened {
            height_mm: f64::from(document.tree.size().height()) * MM_PER_PX,
            curves: Vec::new(),
            points: 0,
        };
        flattened.group(document.tree.root())?;
        Ok(flattened.curves)
    })
}

struct Flattened {
    height_mm: f64,
    curves: Vec<Vec<[f64; 2]>>,
    points: usize,
}

impl Flattened {
    fn group(&mut self, group: &usvg::Group) -> Result<(), DrawingError> {
        for node in group.children() {
            match node {
                usvg::Node::Group(group) => self.group(group)?,
                usvg::Node::Path(path) if path.is_visible() => self.path(path)?,
                usvg::Node::Text(text) => self.group(text.flattened())?,
                usvg::Node::Path(_) | usvg::Node::Image(_) => {}
            }
        }
        Ok(())
    }

    fn path(&mut self, path: &usvg::Path) -> Result<(), DrawingError> {
        let Some(data) = path.data().clone().transform(path.abs_transform()) else { return Ok(()) };
        let place = |p: resvg::tiny_skia::Point| {
            Point::new(f64::from(p.x) * MM_PER_PX, self.height_mm - f64::from(p.y) * MM_PER_PX)
        };
        let mut curves: Vec<Vec<Point>> = Vec::new();
        let mut here = Point::default();
        for segment in data.segments() {
            if let PathSegment::MoveTo(to) = segment {
                here = place(to);
                curves.push(vec![here]);
            }
            let Some(curve) = curves.last_mut() else { continue };
            match segment {
                PathSegment::MoveTo(_) => {}
                PathSegment::LineTo(to) => {
                    here = place(to);
                    curve.push(here);
                }
                PathSegment::QuadTo(handle, to) => {
                    // As a cubic: its handles lie two thirds of the way to the quadratic's.
                    let (handle, to) = (place(handle), place(to));
                    let toward = |end: Point| end + (handle - end) * (2.0 / 3.0);
                    let control = [here, toward(here), toward(to), to];
                    curve.extend(chords(CubicBezier { control }));
                    here = to;
                }
                PathSegment::CubicTo(first, second, to) => {
                    let control = [here, place(first), place(second), place(to)];
                    curve.extend(chords(CubicBezier { control }));
                    here = control[3];
                }
                PathSegment::Close => {
                    here = curve[0];
                    curve.push(here);
                }
            }
        }
        for curve in curves.into_iter().filter(|curve| curve.len() > 1) {
            self.points += curve.len();
            if self.points > MAX_POINTS {
                return Err(DrawingError::TooLarge {
                    unit: "points of curves",
                    found: self.points as u64,
                    limit: MAX_POINTS as u64,
                });
            }
            if !curve.iter().all(|p| p.x.is_finite() && p.y.is_finite()) {
                return Err(DrawingError::Malformed {
                    format: DrawingFormat::Svg,
                    reason: "a shape has a point that is not finite".into(),
                });
            }
            self.curves.push(curve.iter().map(|p| [p.x, p.y]).collect());
        }
        Ok(())
    }
}

/// Points of a segment without its start.
fn chords(curve: CubicBezier) -> impl Iterator<Item = Point> {
    let [p0, p1, p2, p3] = curve.control;
    // The second derivative is at most six times the second differences; a chord over 1/n of the
    // segment leaves it by an eighth of that over n².
    let bend = (p0 - p1 * 2.0 + p2).length().max((p1 - p2 * 2.0 + p3).length());
    let count = (0.75 * bend / CHORD_MM).sqrt().ceil().clamp(FEWEST_CHORDS, MOST_CHORDS) as u32;
    (1..=count).map(move |k| curve.at(f64::from(k) / f64::from(count)))
}
