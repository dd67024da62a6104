//! Paths as passes of a machine program.

use lasergym_toolpath::{DwellPass, DwellPoint};

use crate::BeamPath;

impl BeamPath {
    /// The passes in the order and direction in which the beam makes them, without those in which it
    /// is off throughout and without the ends over which it is off.
    #[must_use]
    pub fn machine_passes(&self) -> Vec<DwellPass> {
        (0..self.passes()).filter_map(|pass| self.machine_pass(pass)).collect()
    }

    fn machine_pass(&self, pass: usize) -> Option<DwellPass> {
        let stretches = self.points - 1;
        let on = &self.beam_on[pass * stretches..(pass + 1) * stretches];
        let first = on.iter().position(|on| *on)?;
        let last = on.iter().rposition(|on| *on)? + 1;
        let point = |point: usize| {
            let index = pass * self.points + point;
            (self.x_um(point), self.y_um[index], self.dwell_s_mm[index])
        };
        // Each point carries the speed and the beam of the way to it.
        let along = |from: usize, to: usize, on: bool| {
            let (_, _, before) = point(from);
            let (x_um, y_um, after) = point(to);
            DwellPoint { x_um, y_um, speed_mm_s: 2.0 / (before + after), beam_on: on }
        };
        let (x_um, y_um, dwell) = point(if self.is_reversed(pass) { last } else { first });
        let start = DwellPoint { x_um, y_um, speed_mm_s: 1.0 / dwell, beam_on: false };
        let mut points = vec![start];
        if self.is_reversed(pass) {
            points.extend((first..last).rev().map(|k| along(k + 1, k, on[k])));
        } else {
            points.extend((first..last).map(|k| along(k, k + 1, on[k])));
        }
        Some(DwellPass { points })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RasterLayout;

    #[test]
    fn passes_alternate_and_leave_out_where_the_beam_is_off() {
        let layout = RasterLayout {
            first_x_um: 0.0,
            spacing_um: 10.0,
            points: 4,
            first_y_um: 5.0,
            pitch_um: 7.0,
            passes: 3,
        };
        let mut path = BeamPath::raster(&layout, 0.01).unwrap();
        path.beam_on = [true, true, false, false, true, true, false, false, false].to_vec();
        let passes = path.machine_passes();
        assert_eq!(passes.len(), 2);
        let xs = |k: usize| passes[k].points.iter().map(|p| p.x_um).collect::<Vec<_>>();
        assert_eq!(xs(0), [0.0, 10.0, 20.0]);
        assert_eq!(xs(1), [30.0, 20.0, 10.0]);
        assert!(passes.iter().all(|pass| !pass.points[0].beam_on && pass.points[1].beam_on));
        assert!(passes[0].points.iter().all(|p| (p.speed_mm_s - 100.0).abs() < 1e-9));
    }
}
