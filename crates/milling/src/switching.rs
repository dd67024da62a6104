//! Switching the beam on and off where that helps.

use crate::{BeamPath, MillingError, MillingJob, RemovalLaw};

/// Switches the beam between points where that lowers the objective, and returns how often.
///
/// What switching one stretch does is a parabola in its dose w, exact where slopes do not matter:
/// ΔJ = ±g w + ½ h w². Of stretches that reach the same ground only the best is switched. A stretch
/// that is switched on gets the dwell of the highest speed, one that is switched off is taken away
/// from the dwell that it has. Without effect for the slope law, whose beams stay on.
pub(crate) fn switch_beam(
    job: &MillingJob,
    path: &mut BeamPath,
    depth_um: &[f64],
) -> Result<usize, MillingError> {
    if matches!(job.profile().process.law, RemovalLaw::Slope(_)) {
        return Ok(0);
    }
    let (least, _) = job.profile().dwell_range_s_mm();
    let (points, segments) = (path.points, path.points - 1);
    // With the beam on everywhere and off stretches at the highest speed, each stretch has a dose.
    let mut all_on = path.clone();
    all_on.beam_on.fill(true);
    for pass in 0..path.passes() {
        for point in 0..points {
            let on = |segment: usize| path.beam_on[pass * segments + segment];
            if !((point > 0 && on(point - 1)) || (point < segments && on(point))) {
                all_on.dwell_s_mm[pass * points + point] = least;
            }
        }
    }
    let effects = job.simulator().stretch_effects(&all_on, depth_um, job.objective())?;
    let gains: Vec<f64> = effects
        .iter()
        .zip(&path.beam_on)
        .map(|(effect, &on)| {
            let first = if on { -effect.first } else { effect.first };
            -(first + 0.5 * effect.second)
        })
        .collect();
    let reach = (job.profile().process.footprint.reach_um() / path.spacing_um).ceil() as usize;
    let rows =
        (job.profile().process.footprint.reach_um() / job.profile().pitch_um).ceil() as usize;
    let per_layer = job.layout().passes;
    let mut switched = Vec::new();
    for (k, &gain) in gains.iter().enumerate().filter(|(_, gain)| **gain > 0.0) {
        let (pass, segment) = (k / segments, k % segments);
        let columns = segment.saturating_sub(reach)..(segment + reach + 1).min(segments);
        let row = pass % per_layer;
        // The same ground is reached by the neighbouring rows of all layers.
        let best = (0..path.passes() / per_layer).all(|layer| {
            (row.saturating_sub(rows)..(row + rows + 1).min(per_layer)).all(|row| {
                let start = (layer * per_layer + row) * segments;
                columns.clone().all(|column| {
                    let other = start + column;
                    gains[other] < gain || (gains[other] <= gain && other >= k)
                })
            })
        });
        if best {
            switched.push(k);
        }
    }
    for &k in &switched {
        let first = k / segments * points + k % segments;
        if !path.beam_on[k] {
            for point in [first, first + 1] {
                path.dwell_s_mm[point] = all_on.dwell_s_mm[point];
            }
        }
        path.beam_on[k] = !path.beam_on[k];
    }
    Ok(switched.len())
}
