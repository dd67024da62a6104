//! What rendering an SVG document would cost, bounded before it is spent.
//!
//! A short document may ask for endless work: dashes of a hair's length cut a long line into
//! millions, and thousands of large translucent layers each cover the page.

use std::collections::BTreeSet;

use resvg::{
    tiny_skia::{PathSegment, Point, Rect},
    usvg::{Fill, Group, Node, Paint, Path, Stroke, Tree},
};

use crate::{DrawingError, placement::Bounds, svg_drawing::refuse_kinds};

/// Largest work for one rendering, painted samples. A plain page takes about two million.
const MAX_PAINTED_SAMPLES: f64 = 2e9;

/// An edge or a dash takes about as long as painting this many samples, whatever its length …
const EDGE_SAMPLES: f64 = 200.0;

/// … and this many for each sample of its length.
const LENGTH_SAMPLES: f64 = 20.0;

/// A stroked edge has two sides, two ends and a join.
const STROKE_EDGES: f64 = 4.0;

/// Compositing a layer takes about as long as painting it this many times.
const LAYER_PAINTS: f64 = 8.0;

/// Refuses trees whose rendering of `region` of the page, at `scale` samples to a unit, would take
/// more than [`MAX_PAINTED_SAMPLES`], and paint that is not read. Tells whether there is any shape.
pub(crate) fn check_rendering(
    tree: &Tree,
    region: &Bounds,
    scale: f64,
) -> Result<bool, DrawingError> {
    let mut work =
        Rendering { region: *region, scale, samples: 0.0, shapes: false, unread: BTreeSet::new() };
    work.add_group(tree.root(), None);
    refuse_kinds(work.unread)?;
    if work.samples > MAX_PAINTED_SAMPLES {
        return Err(DrawingError::TooLarge {
            unit: "samples to paint",
            found: work.samples as u64,
            limit: MAX_PAINTED_SAMPLES as u64,
        });
    }
    Ok(work.shapes)
}

/// Work of a rendering.
struct Rendering {
    region: Bounds,
    scale: f64,
    samples: f64,
    shapes: bool,
    unread: BTreeSet<String>,
}

impl Rendering {
    /// Adds a group; `layer_samples` is the area of the clip path or mask it belongs to, where each
    /// shape may cover all of it.
    fn add_group(&mut self, group: &Group, layer_samples: Option<f64>) {
        if !group.filters().is_empty() {
            self.unread.insert("filter".into());
        }
        let bounds = group.abs_layer_bounding_box().to_rect();
        let area = layer_samples.unwrap_or_else(|| self.visible_samples(bounds));
        if group.should_isolate() {
            self.samples += LAYER_PAINTS * area;
        }
        let mut clip = group.clip_path();
        while let Some(path) = clip {
            self.samples += LAYER_PAINTS * area;
            self.add_group(path.root(), Some(area));
            clip = path.clip_path();
        }
        let mut mask = group.mask();
        while let Some(layer) = mask {
            self.samples += LAYER_PAINTS * area;
            self.add_group(layer.root(), Some(area));
            mask = layer.mask();
        }
        for node in group.children() {
            // Work once over the limit stays there: no need to go on.
            if self.samples > MAX_PAINTED_SAMPLES {
                return;
            }
            match node {
                Node::Group(group) => self.add_group(group, layer_samples),
                Node::Path(path) => self.add_path(path, layer_samples),
                Node::Text(text) => self.add_group(text.flattened(), layer_samples),
                Node::Image(_) => {
                    self.unread.insert("image".into());
                }
            }
        }
    }

    fn add_path(&mut self, path: &Path, layer_samples: Option<f64>) {
        self.shapes = true;
        let area =
            layer_samples.unwrap_or_else(|| self.visible_samples(path.abs_stroke_bounding_box()));
        let paints = [path.fill().map(Fill::paint), path.stroke().map(Stroke::paint)];
        for paint in paints.into_iter().flatten() {
            if matches!(paint, Paint::Pattern(_)) {
                self.unread.insert("pattern".into());
            }
            self.samples += area;
        }
        self.samples += self.edge_samples(path);
    }

    /// Work for the edges of a path, which grows with their number and their length.
    fn edge_samples(&self, path: &Path) -> f64 {
        let affine = path.abs_transform();
        let stretch = f64::from(affine.sx.hypot(affine.ky).max(affine.kx.hypot(affine.sy)));
        let scale = stretch * self.scale;
        // What lies outside the rendering is cut off.
        let [width, height] = self.region.size().map(|side| side * self.scale);
        let longest = 4.0 * (width + height);
        let (mut edges, mut length) = (0.0, 0.0);
        let mut start = Point::zero();
        for segment in path.data().segments() {
            let (length_here, end) = match segment {
                PathSegment::MoveTo(end) => (0.0, end),
                PathSegment::LineTo(end) => (start.distance(end), end),
                PathSegment::QuadTo(a, end) => (start.distance(a) + a.distance(end), end),
                PathSegment::CubicTo(a, b, end) => {
                    (start.distance(a) + a.distance(b) + b.distance(end), end)
                }
                PathSegment::Close => (0.0, start),
            };
            edges += 1.0;
            length += (f64::from(length_here) * scale).min(longest);
            start = end;
        }
        let mut work = EDGE_SAMPLES * edges + LENGTH_SAMPLES * length;
        if let Some(stroke) = path.stroke() {
            work *= STROKE_EDGES;
            if let Some(dashes) = stroke.dasharray() {
                let period = f64::from(dashes.iter().sum::<f32>()) * scale;
                work += STROKE_EDGES * EDGE_SAMPLES * dashes.len() as f64 * length / period;
            }
        }
        work
    }

    /// Samples of the rendering inside `bounds`, page units.
    fn visible_samples(&self, bounds: Rect) -> f64 {
        let Bounds { min, max } = self.region;
        let width = f64::from(bounds.right()).min(max[0]) - f64::from(bounds.left()).max(min[0]);
        let height = f64::from(bounds.bottom()).min(max[1]) - f64::from(bounds.top()).max(min[1]);
        width.max(0.0) * height.max(0.0) * self.scale * self.scale
    }
}
