//! DXF drawings as targets.
//!
//! The curves of the model space are joined end to end to closed contours and filled by the
//! even-odd rule, so that contours inside a contour are holes. Curves drawn twice count once.

use std::collections::HashSet;

use crate::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, Fit, Point, WORKPIECE_SIZE_PX,
    dxf_entity::{Curve, curves},
    dxf_reader::{records, text},
    fill_even_odd,
    placement::{Bounds, Placement},
};

/// Ends of curves are joined up to this part of the drawing's longer side: 0.1 px at most on a
/// drawing fitted to the workpiece.
const JOIN_TOLERANCE: f64 = 1e-3;

/// Ends that meet up to rounding are joined first, up to this part of the longer side.
const MEETING_TOLERANCE: f64 = 1e-9;

/// Largest number of comparisons between ends of curves, against drawings with countless ends on
/// one line.
const MAX_COMPARISONS: u64 = 500_000_000;

/// Reads a DXF drawing as a target.
pub(crate) fn dxf_target(bytes: &[u8], options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    let text = text(bytes)?;
    let mut curves = curves(&records(&text)?)?;
    drop_repeated(&mut curves);
    let bounds = Bounds::of(curves.iter().flatten().copied())
        .ok_or(DrawingError::NoShapes { format: DrawingFormat::Dxf })?;
    let [width, height] = bounds.size();
    let mut contours = closed_contours(curves, width.max(height))?;
    let workpiece = WORKPIECE_SIZE_PX as f64;
    // In the drawing, y points up.
    let flipped = |bounds: Bounds| Bounds {
        min: [bounds.min[0], -bounds.max[1]],
        max: [bounds.max[0], -bounds.min[1]],
    };
    let (placement, frame) = match options.fit {
        Fit::Exact => (
            Placement { scale: 1.0, offset: [0.0, workpiece] },
            Bounds { min: [0.0; 2], max: [workpiece; 2] },
        ),
        Fit::Scale => {
            let placement = Placement::centred(&flipped(bounds), options.margin_px);
            (placement.ok_or(DrawingError::EmptyTarget)?, bounds)
        }
    };
    if options.invert {
        let Bounds { min, max } = frame;
        contours.push(vec![min, [max[0], min[1]], max, [min[0], max[1]]]);
    }
    let outlines: Vec<Vec<Point>> = contours
        .iter()
        .map(|contour| contour.iter().map(|&[x, y]| placement.apply([x, -y])).collect())
        .collect();
    Ok(fill_even_odd(&outlines))
}

/// Leaves of the curves that are the same, in either direction, the first one; and drops curves
/// without any length.
fn drop_repeated(curves: &mut Vec<Curve>) {
    let mut seen = HashSet::new();
    curves.retain(|curve| {
        let bits = |point: &[f64; 2]| point.map(|coordinate| (coordinate + 0.0).to_bits());
        let forward: Vec<_> = curve.iter().map(bits).collect();
        let backward: Vec<_> = forward.iter().rev().copied().collect();
        let has_length = forward.iter().any(|&point| point != forward[0]);
        has_length && seen.insert(forward.min(backward))
    });
}

/// Joins `curves` to closed contours; `side` is the longer side of the drawing.
fn closed_contours(curves: Vec<Curve>, side: f64) -> Result<Vec<Curve>, DrawingError> {
    let (mut contours, open): (Vec<Curve>, Vec<Curve>) =
        curves.into_iter().partition(|curve| curve.first() == curve.last());
    let partners = partners(&open, side)?;
    let mut used = vec![false; open.len()];
    for first in 0..open.len() {
        let mut contour = Curve::new();
        let mut start = 2 * first;
        // From end to end round the contour, back to the curve it began with.
        while !used[start / 2] {
            let curve = &open[start / 2];
            used[start / 2] = true;
            if start % 2 == 0 {
                contour.extend(curve);
            } else {
                contour.extend(curve.iter().rev());
            }
            start = partners[start ^ 1];
        }
        contours.push(contour);
    }
    Ok(contours)
}

/// For each end of the open curves, the end it is joined to. Curve `k` has the ends `2 k` (its
/// start) and `2 k + 1`.
fn partners(open: &[Curve], side: f64) -> Result<Vec<usize>, DrawingError> {
    let ends: Vec<[f64; 2]> =
        open.iter().flat_map(|curve| [curve[0], curve[curve.len() - 1]]).collect();
    let mut partners: Vec<Option<usize>> = vec![None; ends.len()];
    let mut comparisons = 0;
    for tolerance in [MEETING_TOLERANCE * side, JOIN_TOLERANCE * side] {
        let mut free: Vec<usize> = (0..ends.len()).filter(|&k| partners[k].is_none()).collect();
        free.sort_by(|&a, &b| ends[a][0].total_cmp(&ends[b][0]));
        for (place, &end) in free.iter().enumerate() {
            if partners[end].is_some() {
                continue;
            }
            let near = free[place + 1..]
                .iter()
                .take_while(|&&other| ends[other][0] - ends[end][0] <= tolerance)
                .inspect(|_| comparisons += 1)
                .filter(|&&other| partners[other].is_none())
                .map(|&other| (distance(ends[end], ends[other]), other))
                .filter(|&(gap, _)| gap <= tolerance)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, other)) = near {
                partners[end] = Some(other);
                partners[other] = Some(end);
            }
            if comparisons > MAX_COMPARISONS {
                return Err(DrawingError::TooLarge {
                    unit: "pairs of curve ends close to each other",
                    found: comparisons,
                    limit: MAX_COMPARISONS,
                });
            }
        }
    }
    let tolerance = JOIN_TOLERANCE * side;
    partners
        .iter()
        .enumerate()
        .map(|(end, partner)| partner.ok_or_else(|| open_contour(&ends, &partners, end, tolerance)))
        .collect()
}

/// The gap from the free end `end` to the nearest other free end.
fn open_contour(
    ends: &[[f64; 2]],
    partners: &[Option<usize>],
    end: usize,
    tolerance: f64,
) -> DrawingError {
    let from = ends[end];
    // Ends are paired, so that free ends are even in number: there is another one.
    let to = (0..ends.len())
        .filter(|&other| other != end && partners[other].is_none())
        .map(|other| ends[other])
        .min_by(|&a, &b| distance(from, a).total_cmp(&distance(from, b)))
        .unwrap_or(from);
    DrawingError::OpenContour { from, to, gap: distance(from, to), tolerance }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
