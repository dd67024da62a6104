//! SVG documents as targets.
//!
//! The page is rendered at no less than eight samples to a workpiece pixel and then read as a
//! picture. Only what lies on the page (the view box) counts, as in any viewer. Nothing outside the
//! document is loaded but fonts, and those only when it holds text. What a laser cannot draw, or
//! what would have to be loaded, is refused by name rather than lost.

use resvg::usvg::{Transform, roxmltree};

use crate::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, Fit,
    ink_raster::{InkRaster, InkRule},
    picture::render,
    placement::Bounds,
    svg_cost::RenderingCost,
    svg_document::{SvgDocument, isolated, parse_xml},
    svg_numbers::check_numbers,
    svg_references::{check_entities, check_expansion},
};

/// Longer side of a rendering, samples.
const RASTER_SIDE: f64 = 1000.0;

/// The ink spans at least this many samples: eight to each pixel of the workpiece.
const MIN_INK_SIDE: f64 = 800.0;

/// Largest number of renderings that zoom in on the ink. Each gains a factor of up to 1000.
const MAX_ZOOMS: usize = 6;

/// While zooming in, samples with this part of the threshold are kept: a thin line may gain ink.
const FAINT: f64 = 0.125;

/// Largest document, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Deepest nesting of elements. Graphic editors stay under 50.
const MAX_DEPTH: usize = 256;

/// Reads an SVG document as a target.
pub(crate) fn svg_target(bytes: &[u8], options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    with_document(bytes, |document| target(document, options))
}

/// Calls `read` with the document, once it is known to be harmless.
pub(crate) fn with_document<T: Send>(
    bytes: &[u8],
    read: impl FnOnce(&SvgDocument) -> Result<T, DrawingError> + Send,
) -> Result<T, DrawingError> {
    let found = bytes.len() as u64;
    if found > MAX_BYTES {
        return Err(DrawingError::TooLarge { unit: "bytes", found, limit: MAX_BYTES });
    }
    let svg = std::str::from_utf8(bytes).map_err(|error| DrawingError::Malformed {
        format: DrawingFormat::Svg,
        reason: format!("it is not UTF-8 text: {error}"),
    })?;
    check_entities(svg)?;
    isolated(|| {
        let xml = parse_xml(svg)?;
        check_depth(&xml)?;
        check_kinds(&xml)?;
        check_numbers(&xml)?;
        check_expansion(&xml)?;
        read(&SvgDocument::from_xml(&xml)?)
    })
}

/// Renders the page, then the part of it with ink, until the ink has samples enough.
fn target(document: &SvgDocument, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    let size = document.tree.size();
    let page = Bounds { min: [0.0; 2], max: [f64::from(size.width()), f64::from(size.height())] };
    if options.fit == Fit::Exact {
        check_exact_size(document, &page)?;
    }
    let mut region = page;
    let mut rule = None;
    let mut cost = RenderingCost::default();
    for _ in 0..MAX_ZOOMS {
        let [width, height] = region.size();
        let scale = RASTER_SIDE / width.max(height);
        let [width, height] = [width, height].map(|side| (side * scale).ceil().max(1.0) as u32);
        let transform = Transform::from_row(
            scale as f32,
            0.0,
            0.0,
            scale as f32,
            (-region.min[0] * scale) as f32,
            (-region.min[1] * scale) as f32,
        );
        if !cost.add(&document.tree, &region, scale)? {
            return Err(DrawingError::NoShapes { format: DrawingFormat::Svg });
        }
        let picture = render(&document.tree, transform, width, height)?;
        // Whether the drawing has transparency is a matter of the whole page.
        let rule = *rule.get_or_insert_with(|| InkRule::decide(options.ink, &picture.rgba));
        let raster = InkRaster::from_rgba(&picture.rgba, width as usize, rule, options.invert);
        let bounds =
            raster.ink_bounds(options.threshold * FAINT).ok_or(DrawingError::EmptyTarget)?;
        let [ink_width, ink_height] = bounds.size();
        if options.fit == Fit::Exact || ink_width.max(ink_height) >= MIN_INK_SIDE {
            return raster.target(options);
        }
        let in_page = |axis: usize, sample: f64| {
            (region.min[axis] + sample / scale).clamp(page.min[axis], page.max[axis])
        };
        region = Bounds {
            min: [0, 1].map(|axis| in_page(axis, bounds.min[axis] - 1.0)),
            max: [0, 1].map(|axis| in_page(axis, bounds.max[axis] + 1.0)),
        };
    }
    // Ink that stays this small is less than a billionth of the page.
    Err(DrawingError::EmptyTarget)
}

/// An exact fit needs a square page of 100 × 100 user units.
fn check_exact_size(document: &SvgDocument, page: &Bounds) -> Result<(), DrawingError> {
    let [width, height] = document.user_size;
    let [page_width, page_height] = page.size();
    let square = (page_width - page_height).abs() < 1e-3 * page_width;
    if square && (width - 100.0).abs() < 1e-6 && (height - 100.0).abs() < 1e-6 {
        Ok(())
    } else {
        Err(DrawingError::WrongSize { width, height })
    }
}

fn check_depth(xml: &roxmltree::Document<'_>) -> Result<(), DrawingError> {
    let mut depths = vec![(xml.root(), 0)];
    while let Some((node, depth)) = depths.pop() {
        if depth > MAX_DEPTH {
            return Err(DrawingError::TooLarge {
                unit: "levels of nested elements or more",
                found: depth as u64,
                limit: MAX_DEPTH as u64,
            });
        }
        depths.extend(node.children().map(|child| (child, depth + 1)));
    }
    Ok(())
}

/// Refuses the kinds of elements that would be lost or are costly out of proportion.
fn check_kinds(xml: &roxmltree::Document<'_>) -> Result<(), DrawingError> {
    let unread = |node: &roxmltree::Node<'_, '_>| match node.tag_name().name() {
        // Graphic editors put their private content into a switch, beside the drawing itself.
        "foreignObject" => node.parent().is_none_or(|parent| !parent.has_tag_name("switch")),
        "feImage" | "image" | "marker" | "pattern" => true,
        _ => false,
    };
    let kinds = xml.descendants().filter(unread).map(|node| node.tag_name().name().to_owned());
    refuse_kinds(kinds.collect())
}

/// The error for `kinds` of content that are not read; none when there are none.
pub(crate) fn refuse_kinds(kinds: std::collections::BTreeSet<String>) -> Result<(), DrawingError> {
    if kinds.is_empty() {
        return Ok(());
    }
    Err(DrawingError::UnknownEntities {
        format: DrawingFormat::Svg,
        kinds: kinds.into_iter().collect(),
        supported: "paths, basic shapes, text, use, strokes, plain and gradient paint, clip paths \
                    and masks",
    })
}
