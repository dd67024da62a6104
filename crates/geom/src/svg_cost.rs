//! What an SVG document would cost to read, bounded before it is spent.
//!
//! A short document may ask for endless work: references to references (`use`, clip paths, masks)
//! grow exponentially, dashes of a hair's length cut a long line into millions, and thousands of
//! large translucent layers each cover the page.

use std::collections::{BTreeSet, HashMap, HashSet};

use resvg::{
    tiny_skia::Rect,
    usvg::{Fill, Group, Node, Paint, Path, Stroke, Tree, roxmltree},
};

use crate::{DrawingError, placement::Bounds, svg_drawing::refuse_kinds};

/// Largest size of a document with each reference replaced by what it refers to, bytes.
const MAX_EXPANDED_BYTES: u64 = 32 << 20;

/// An element without attributes counts as this many bytes.
const ELEMENT_BYTES: u64 = 64;

/// Largest work for one rendering, painted samples. A plain page takes about two million.
const MAX_PAINTED_SAMPLES: f64 = 2e9;

/// A path segment or a dash takes about as long as painting this many samples.
const SEGMENT_SAMPLES: f64 = 200.0;

/// Compositing a layer takes about as long as painting it this many times.
const LAYER_PAINTS: f64 = 8.0;

/// Refuses documents whose references expand to more than [`MAX_EXPANDED_BYTES`].
pub(crate) fn check_expansion(xml: &roxmltree::Document<'_>) -> Result<(), DrawingError> {
    let by_id = xml.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut expansion = Expansion { by_id, known: HashMap::new(), open: HashSet::new() };
    let found = expansion.bytes(xml.root());
    if found > MAX_EXPANDED_BYTES {
        return Err(DrawingError::TooLarge {
            unit: "bytes once its references are resolved",
            found,
            limit: MAX_EXPANDED_BYTES,
        });
    }
    Ok(())
}

/// Sizes of elements with their references resolved.
struct Expansion<'a, 'input> {
    by_id: HashMap<&'a str, roxmltree::Node<'a, 'input>>,
    known: HashMap<roxmltree::NodeId, u64>,
    /// The elements under way: a reference back to them is no content.
    open: HashSet<roxmltree::NodeId>,
}

impl<'a, 'input> Expansion<'a, 'input> {
    fn bytes(&mut self, node: roxmltree::Node<'a, 'input>) -> u64 {
        if let Some(&bytes) = self.known.get(&node.id()) {
            return bytes;
        }
        if !self.open.insert(node.id()) {
            return 0;
        }
        let mut bytes = ELEMENT_BYTES + node.text().map_or(0, |text| text.len() as u64);
        for attribute in node.attributes() {
            bytes = bytes.saturating_add(attribute.value().len() as u64);
            for id in references(attribute.name(), attribute.value()) {
                if let Some(&target) = self.by_id.get(id) {
                    bytes = bytes.saturating_add(self.bytes(target));
                }
            }
        }
        for child in node.children() {
            bytes = bytes.saturating_add(self.bytes(child));
        }
        self.open.remove(&node.id());
        self.known.insert(node.id(), bytes);
        bytes
    }
}

/// The ids an attribute refers to: `href="#id"` and each `url(#id)`.
fn references<'a>(name: &str, value: &'a str) -> impl Iterator<Item = &'a str> {
    let href = (name == "href").then(|| value.trim().strip_prefix('#')).flatten();
    let urls = value.split("url(").skip(1).filter_map(|rest| {
        let id = rest.split(')').next()?.trim().trim_matches(['"', '\'']).trim();
        id.strip_prefix('#')
    });
    href.into_iter().chain(urls)
}

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
        let segments = path.data().len() as f64;
        self.samples += SEGMENT_SAMPLES * segments * (1.0 + dashes(path));
    }

    /// Samples of the rendering inside `bounds`, page units.
    fn visible_samples(&self, bounds: Rect) -> f64 {
        let Bounds { min, max } = self.region;
        let width = f64::from(bounds.right()).min(max[0]) - f64::from(bounds.left()).max(min[0]);
        let height = f64::from(bounds.bottom()).min(max[1]) - f64::from(bounds.top()).max(min[1]);
        width.max(0.0) * height.max(0.0) * self.scale * self.scale
    }
}

/// Number of dashes of the stroke to each segment of its path, from above.
fn dashes(path: &Path) -> f64 {
    let Some(dash_lengths) = path.stroke().and_then(Stroke::dasharray) else {
        return 0.0;
    };
    let period: f32 = dash_lengths.iter().sum();
    let bounds = path.data().bounds();
    // A segment within the bounds of its control points is at most three diagonals long.
    let length = 3.0 * bounds.width().hypot(bounds.height());
    f64::from(length / period) * dash_lengths.len() as f64
}
