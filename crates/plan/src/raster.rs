//! Raster scan: the conventional toolpath that the others are measured against (Xie et al. 2022,
//! Fig. 1 a and b).

use std::ops::ControlFlow;

use lasergym_ablation::reachable_position;
use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};

use crate::{Job, Plan, PlanError, PlanProgress, Planner, PlannerKind};

/// Most cells of a grid.
const MAX_CELLS: usize = 1_000_000;

/// Part of a cell that must be target for the cell to be machined.
const MACHINED_FROM: f64 = 0.5;

/// Side of the square cells over the pulse radius r.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RasterPitch {
    /// √2 r, Fig. 1 a: a pulse just covers its cell.
    #[default]
    Root2Radius,
    /// r, Fig. 1 b: more pulses, which follow the outline more closely.
    Radius,
}

impl RasterPitch {
    /// Side of a cell for pulses of `pulse_radius_px`, px.
    #[must_use]
    pub fn pitch_px(self, pulse_radius_px: f64) -> f64 {
        match self {
            Self::Root2Radius => std::f64::consts::SQRT_2 * pulse_radius_px,
            Self::Radius => pulse_radius_px,
        }
    }
}

/// One pulse at the centre of every square cell of which at least half is remaining target.
///
/// The grid begins at the top left corner of the workpiece; rows are scanned in alternating
/// direction. As in the paper the number of pulses follows from the target: `max_pulses` of the job
/// is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Raster {
    /// Side of the cells.
    pub pitch: RasterPitch,
}

impl Planner for Raster {
    fn kind(&self) -> PlannerKind {
        match self.pitch {
            RasterPitch::Root2Radius => PlannerKind::Raster,
            RasterPitch::Radius => PlannerKind::RasterFine,
        }
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let pitch_px = self.pitch.pitch_px(job.pulse_radius_px());
        let cells = (WORKPIECE_SIZE_PX as f64 / pitch_px).ceil();
        if cells * cells > MAX_CELLS as f64 {
            return Err(PlanError::RasterTooFine { pitch_px, limit: MAX_CELLS });
        }
        let plan = Plan::new(job, scan(job.target(), pitch_px, cells as usize), false)?;
        // The plan is complete: there is nothing left to stop.
        let _ = progress(&PlanProgress {
            planner: self.kind(),
            fraction: 1.0,
            best_reward: plan.score.reward,
            best_positions: &plan.positions,
        });
        Ok(plan)
    }
}

/// Centres of the cells to be machined in serpentine order.
fn scan(target: &Bitmap, pitch_px: f64, cells: usize) -> Vec<Point> {
    let mut positions = Vec::new();
    let mut rightwards = true;
    for cell_row in 0..cells {
        let mut row: Vec<Point> = (0..cells)
            .filter(|&cell_column| {
                covered_area(target, pitch_px, cell_row, cell_column)
                    >= MACHINED_FROM * pitch_px * pitch_px
            })
            .map(|cell_column| {
                reachable_position(Point::new(
                    (cell_column as f64 + 0.5) * pitch_px,
                    (cell_row as f64 + 0.5) * pitch_px,
                ))
            })
            .collect();
        if row.is_empty() {
            continue;
        }
        if !rightwards {
            row.reverse();
        }
        rightwards = !rightwards;
        positions.append(&mut row);
    }
    positions
}

/// Area of target within a cell, px²; pixels are unit squares.
fn covered_area(target: &Bitmap, pitch_px: f64, cell_row: usize, cell_column: usize) -> f64 {
    overlaps(cell_row, pitch_px)
        .map(|(row, height)| {
            let width: f64 = overlaps(cell_column, pitch_px)
                .filter(|&(column, _)| target.contains(row, column))
                .map(|(_, width)| width)
                .sum();
            width * height
        })
        .sum()
}

/// The pixels that cell number `cell` meets along one axis, and the length of each that lies within.
fn overlaps(cell: usize, pitch_px: f64) -> impl Iterator<Item = (usize, f64)> {
    let (start, end) = (cell as f64 * pitch_px, (cell + 1) as f64 * pitch_px);
    let last = (end.ceil() as usize).min(WORKPIECE_SIZE_PX);
    (start as usize..last).map(move |pixel| {
        let pixel_start = pixel as f64;
        (pixel, (end.min(pixel_start + 1.0) - start.max(pixel_start)).max(0.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::{Stream, Workpiece, random_shape, star};

    fn raster(pitch: RasterPitch, target: &Bitmap, radius_px: f64) -> Plan {
        let job = Job::new(Workpiece::new(target).unwrap(), radius_px, 1).unwrap();
        Raster { pitch }.plan_to_end(&job).unwrap()
    }

    #[test]
    fn a_rectangle_of_whole_cells_gets_one_pulse_a_cell_in_serpentine_order() {
        let target = Bitmap::from_fn(|j, i| (10..30).contains(&j) && (20..50).contains(&i));
        let plan = raster(RasterPitch::Radius, &target, 10.0);
        let expected =
            [(25.0, 15.0), (35.0, 15.0), (45.0, 15.0), (45.0, 25.0), (35.0, 25.0), (25.0, 25.0)];
        assert_eq!(plan.positions, expected.map(|(x, y)| reachable_position(Point::new(x, y))));
    }

    #[test]
    fn half_a_cell_is_enough() {
        let columns = |end: usize| Bitmap::from_fn(|j, i| j < 10 && i < end);
        assert_eq!(raster(RasterPitch::Radius, &columns(5), 10.0).positions.len(), 1);
        assert!(raster(RasterPitch::Radius, &columns(4), 10.0).positions.is_empty());
    }

    #[test]
    fn cells_of_the_coarse_pitch_are_covered_completely() {
        // Each pulse covers its cell, so a plan misses only target in cells that are mostly ground.
        let plan = raster(RasterPitch::Root2Radius, &Bitmap::from_fn(|_, i| i < 99), 9.0);
        assert!(plan.score.machined_fraction > 0.9, "{plan:?}");
    }

    #[test]
    fn the_finer_pitch_machines_more_with_more_pulses() {
        let mut stream = Stream::from_seed(1);
        for _ in 0..40 {
            let target = random_shape(&mut stream).target;
            let coarse = raster(RasterPitch::Root2Radius, &target, 9.0).score;
            let fine = raster(RasterPitch::Radius, &target, 9.0).score;
            assert!(fine.machined_fraction > coarse.machined_fraction);
            assert!(fine.pulses > coarse.pulses);
        }
    }

    #[test]
    fn areas_of_the_cells_add_up_to_the_target() {
        for pitch_px in [0.7, 1.0, 9.0, 12.73, 60.0, 130.0] {
            let cells = (100.0_f64 / pitch_px).ceil() as usize;
            let sum: f64 = (0..cells)
                .flat_map(|row| (0..cells).map(move |column| (row, column)))
                .map(|(row, column)| covered_area(&star(0.0), pitch_px, row, column))
                .sum();
            assert!((sum - 4842.0).abs() < 1e-6, "{sum} at pitch {pitch_px}");
        }
    }

    #[test]
    fn a_grid_of_too_many_cells_is_refused() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 0.01, 1).unwrap();
        let error = Raster::default().plan_to_end(&job).unwrap_err();
        assert!(matches!(error, PlanError::RasterTooFine { .. }), "{error}");
    }
}
