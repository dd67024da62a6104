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

/// Largest work for a drawing, samples of plain paint: one to two seconds.
const MAX_PAINTED_SAMPLES: f64 = 1.5e9;

/// An edge or a dash takes about as long as painting this many samples, whatever its length …
const EDGE_SAMPLES: f64 = 200.0;

/// … and this many for each sample of its length.
const LENGTH_SAMPLES: f64 = 20.0;

/// A stroked edge has two sides, two ends and a join.
const STROKE_EDGES: f64 = 4.0;

/// A gradient takes about as long as painting plainly this many times.
const GRADIENT_PAINTS: f64 = 20.0;

/// Compositing a translucent layer takes about as long as painting it this many times.
const LAYER_PAINTS: f64 = 20.0;

/// Clipping or masking a layer takes about as long as painting it this many times.
const CLIP_PAINTS: f64 = 50.0;

/// Layers reach beyond the rendering by up to this many of its widths and heights on each side.
const LAYER_REACH: f64 = 2.0;

/// Shapes reach at most this many times the longer side of a rendering to each side of its middle:
/// single precision still places them to a tenth of a sample.
const MAX_REACH: f64 = 1000.0;

/// The work of renderings, bounded before each.
#[derive(Debug, Default)]
pub(crate) struct RenderingCost {
    samples: f64,
}

impl RenderingCost {
    /// Adds the rendering of `region` of the page at `scale` samples to a unit. Tells whether there
    /// is any shape; refuses paint that is not read, and work beyond [`MAX_PAINTED_SAMPLES`].
    pub(crate) fn add(
        &mut self,
        tree: &Tree,
        region: &Bounds,
        scale: f64,
    ) -> Result<bool, DrawingError> {
        let samples = self.samples;
        let mut work = Rendering { region: *region, scale, samples, ..Rendering::default() };
        work.add_group(tree.root(), Canvas::Page);
        refuse_kinds(work.unread)?;
        if work.reach > MAX_REACH {
            return Err(DrawingError::TooLarge {
                unit: "times the size of its ink between its middle and a shape",
                found: work.reach as u64,
                limit: MAX_REACH as u64,
            });
        }
        if work.samples > MAX_PAINTED_SAMPLES {
            return Err(DrawingError::TooLarge {
                unit: "samples to paint",
                found: work.samples as u64,
                limit: MAX_PAINTED_SAMPLES as u64,
            });
        }
        self.samples = work.samples;
        Ok(work.shapes)
    }
}

/// What shapes are painted on.
#[derive(Debug, Clone, Copy)]
enum Canvas {
    /// The rendering.
    Page,
    /// A layer, which reaches beyond it.
    Layer,
    /// A clip path or mask of this many samples, any of whose shapes may cover all of it.
    Cover(f64),
}

/// Work of a rendering.
#[derive(Default)]
struct Rendering {
    region: Bounds,
    scale: f64,
    samples: f64,
    shapes: bool,
    /// How far shapes reach from the middle of the region, in longer sides of it.
    reach: f64,
    unread: BTreeSet<String>,
}

impl Rendering {
    fn add_group(&mut self, group: &Group, canvas: Canvas) {
        if !group.filters().is_empty() {
            self.unread.insert("filter".into());
        }
        let canvas = match canvas {
            Canvas::Page if group.should_isolate() => Canvas::Layer,
            canvas => canvas,
        };
        let area = self.painted_samples(group.abs_layer_bounding_box().to_rect(), canvas);
        if group.should_isolate() {
            self.samples += LAYER_PAINTS * area;
        }
        let mut clip = group.clip_path();
        while let Some(path) = clip {
            self.samples += CLIP_PAINTS * area;
            self.add_group(path.root(), Canvas::Cover(area));
            clip = path.clip_path();
        }
        let mut mask = group.mask();
        while let Some(layer) = mask {
            self.samples += CLIP_PAINTS * area;
            self.add_group(layer.root(), Canvas::Cover(area));
            mask = layer.mask();
        }
        for node in group.children() {
            // Work once over the limit stays there: no need to go on.
            if self.samples > MAX_PAINTED_SAMPLES {
                return;
            }
            match node {
                Node::Group(group) => self.add_group(group, canvas),
                Node::Path(path) => self.add_path(path, canvas),
                Node::Text(text) => self.add_group(text.flattened(), canvas),
                Node::Image(_) => {
                    self.unread.insert("image".into());
                }
            }
        }
    }

    fn add_path(&mut self, path: &Path, canvas: Canvas) {
        self.shapes = true;
        let bounds = path.abs_stroke_bounding_box();
        self.reach = self.reach.max(self.region_sides_to(bounds));
        let area = self.painted_samples(bounds, canvas);
        let paints = [path.fill().map(Fill::paint), path.stroke().map(Stroke::paint)];
        for paint in paints.into_iter().flatten() {
            match paint {
                Paint::Color(_) => self.samples += area,
                Paint::LinearGradient(_) | Paint::RadialGradient(_) => {
                    self.samples += GRADIENT_PAINTS * area;
                }
                Paint::Pattern(_) => {
                    self.unread.insert("pattern".into());
                }
            }
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

    /// Distance from the middle of the region to the far edge of `bounds`, in its longer sides.
    fn region_sides_to(&self, bounds: Rect) -> f64 {
        let Bounds { min, max } = self.region;
        let middle = [0, 1].map(|axis| f64::midpoint(min[axis], max[axis]));
        let [width, height] = self.region.size();
        let horizontal = [bounds.left(), bounds.right()].map(|x| (f64::from(x) - middle[0]).abs());
        let vertical = [bounds.top(), bounds.bottom()].map(|y| (f64::from(y) - middle[1]).abs());
        horizontal.into_iter().chain(vertical).fold(0.0, f64::max) / width.max(height)
    }

    /// Samples of `canvas` inside `bounds`, page units.
    fn painted_samples(&self, bounds: Rect, canvas: Canvas) -> f64 {
        let reach = match canvas {
            Canvas::Page => 0.0,
            Canvas::Layer => LAYER_REACH,
            Canvas::Cover(samples) => return samples,
        };
        let low = [bounds.left(), bounds.top()].map(f64::from);
        let high = [bounds.right(), bounds.bottom()].map(f64::from);
        let size = self.region.size();
        let sides = [0, 1].map(|axis| {
            let first = low[axis].max(self.region.min[axis] - reach * size[axis]);
            let last = high[axis].min(self.region.max[axis] + reach * size[axis]);
            (last - first).max(0.0) * self.scale
        });
        sides[0] * sides[1]
    }
}
