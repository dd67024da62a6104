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
    let (curves, bounds) = distinct_curves(&text)?;
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

/// The curves of a DXF drawing joined end to end; what does not close stays open. Drawing units,
/// y up.
pub(crate) fn dxf_chains(bytes: &[u8]) -> Result<Vec<Curve>, DrawingError> {
    let (curves, bounds) = distinct_curves(&text(bytes)?)?;
    let [width, height] = bounds.size();
    let (mut chains, open): (Vec<Curve>, Vec<Curve>) =
        curves.into_iter().partition(|curve| curve.first() == curve.last());
    let partners = partners(&open, width.max(height))?;
    let mut used = vec![false; open.len()];
    // Chains with free ends first: from there they are followed in full.
    let (free, inner): (Vec<usize>, Vec<usize>) =
        (0..2 * open.len()).partition(|&end| partners[end].is_none());
    for start in free.into_iter().chain(inner) {
        if !used[start / 2] {
            chains.push(chain(&open, &partners, start, &mut used));
        }
    }
    Ok(chains)
}

/// The curves of a drawing, each once, and their bounds.
fn distinct_curves(text: &str) -> Result<(Vec<Curve>, Bounds), DrawingError> {
    let mut curves = curves(&records(text)?)?;
    drop_repeated(&mut curves);
    let bounds = Bounds::of(curves.iter().flatten().copied())
        .ok_or(DrawingError::NoShapes { format: DrawingFormat::Dxf })?;
    Ok((curves, bounds))
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
    if let Some(end) = partners.iter().position(Option::is_none) {
        return Err(open_contour(&ends_of(&open), &partners, end, JOIN_TOLERANCE * side));
    }
    let mut used = vec![false; open.len()];
    for first in 0..open.len() {
        if !used[first] {
            contours.push(chain(&open, &partners, 2 * first, &mut used));
        }
    }
    Ok(contours)
}

/// The points of the curves that follow each other from the end `start` on.
fn chain(open: &[Curve], partners: &[Option<usize>], start: usize, used: &mut [bool]) -> Curve {
    let mut points = Curve::new();
    let mut next = Some(start);
    // From end to end, round a contour back to the curve it began with.
    while let Some(start) = next.filter(|start| !used[start / 2]) {
        let curve = &open[start / 2];
        used[start / 2] = true;
        if start % 2 == 0 {
            points.extend(curve);
        } else {
            points.extend(curve.iter().rev());
        }
        next = partners[start ^ 1];
    }
    if let (Some(_), Some(&first)) = (next, points.first()) {
        points.push(first);
    }
    points
}

/// Both ends of every curve: curve `k` has the ends `2 k` (its start) and `2 k + 1`.
fn ends_of(open: &[Curve]) -> Vec<[f64; 2]> {
    open.iter().flat_map(|curve| [curve[0], curve[curve.len() - 1]]).collect()
}

/// For each of [`ends_of`] the open curves, the end it is joined to, if there is one near enough.
fn partners(open: &[Curve], side: f64) -> Result<Vec<Option<usize>>, DrawingError> {
    let ends = ends_of(open);
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
    Ok(partners)
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
