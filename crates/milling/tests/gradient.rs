//! The adjoint against central differences and against the forward mode.
#![allow(clippy::unwrap_used, reason = "helpers of tests may unwrap")]

use lasergym_milling::{
    BeamPath, Direction, FeedSpeedLaw, Footprint, FootprintTable, Gradient, GradientMemory, Grid,
    Objective, Process, RasterLayout, RemovalLaw, Simulator, SlopeLaw, SlopeSign,
};
use proptest::prelude::*;

const CELL_UM: f64 = 40.0;
const PASSES: usize = 3;
const POINTS: usize = 5;

/// Processes with a footprint of 250 µm radius: both laws, both signs, every footprint.
fn processes() -> Vec<Process> {
    let compact = Footprint::compact(4e3, 250.0).unwrap();
    let gaussian = Footprint::gaussian(4e3, 125.0).unwrap();
    let rates: Vec<f64> = (0..50).map(|k| compact.rate_um_s(f64::from(k) * 5.0)).collect();
    let table = Footprint::Table(FootprintTable::new(5.0, &rates).unwrap());
    let plus = SlopeLaw { sign: SlopeSign::Plus, ..SlopeLaw::default() };
    let speed = FeedSpeedLaw { reference_mm_s: 30.0, ..FeedSpeedLaw::default() };
    [
        (compact.clone(), RemovalLaw::Slope(SlopeLaw::default())),
        (compact.clone(), RemovalLaw::Slope(plus)),
        (gaussian.clone(), RemovalLaw::Slope(SlopeLaw::default())),
        (table, RemovalLaw::Slope(SlopeLaw::default())),
        (gaussian, RemovalLaw::FeedSpeed(speed)),
        (compact.clone(), RemovalLaw::FeedSpeed(speed)),
        (compact, RemovalLaw::Linear),
    ]
    .into_iter()
    .map(|(footprint, law)| Process { footprint, law })
    .collect()
}

#[derive(Debug)]
struct Case {
    simulator: Simulator,
    path: BeamPath,
    start_um: Vec<f64>,
    objective: Objective,
}

/// Random passes over rough ground, with a gap in the beam.
fn any_case() -> impl Strategy<Value = Case> {
    let values = |range: std::ops::Range<f64>, count: usize| prop::collection::vec(range, count);
    let grid = Grid::new(24, 26, CELL_UM).unwrap();
    (
        0..processes().len(),
        values(0.02..0.12, PASSES * POINTS),
        values(-60.0..60.0, PASSES * POINTS),
        values(0.0..8.0, grid.len()),
        0..PASSES * (POINTS - 1),
        1..3_usize,
    )
        .prop_map(move |(process, dwell, offsets, start_um, gap, extra)| {
            let process = &processes()[process];
            let layout = RasterLayout {
                first_x_um: 380.0,
                spacing_um: 70.0,
                points: POINTS,
                first_y_um: 400.0,
                pitch_um: 75.0,
                passes: PASSES,
            };
            let mut path = BeamPath::raster(&layout, 1.0).unwrap();
            path.dwell_s_mm = dwell;
            path.y_um.iter_mut().zip(&offsets).for_each(|(y, offset)| *y += offset);
            path.beam_on[gap] = false;
            let substeps = Simulator::stable_substeps(process, CELL_UM, 140.0, 0.12) + extra;
            let simulator = Simulator::new(grid, process, substeps).unwrap();
            let target = (0..grid.len()).map(|k| 10.0 + (k % 7) as f64).collect();
            let objective = Objective::new(grid, target, 3..21, 4..22).unwrap();
            Case { simulator, path, start_um, objective }
        })
}

fn gradient(case: &Case) -> Gradient {
    let memory = &mut GradientMemory::default();
    case.simulator.gradient(&case.path, &case.start_um, &case.objective, memory).unwrap()
}

fn objective(case: &Case, path: &BeamPath) -> f64 {
    let mut depth_um = case.start_um.clone();
    case.simulator.mill(path, &mut depth_um).unwrap();
    case.objective.value(&depth_um).unwrap()
}

/// (J(u + h) − J(u − h))/2h, extrapolated from h and h/2 to h = 0.
fn central_difference(step: f64, mut value: impl FnMut(f64) -> f64) -> f64 {
    let mut at = |h: f64| (value(h) - value(-h)) / (2.0 * h);
    let (coarse, fine) = (at(step), at(step / 2.0));
    fine + (fine - coarse) / 3.0
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 0, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn every_component_is_the_central_difference(case in any_case()) {
        let adjoint = gradient(&case);
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let (most_dwell, most_y) = (largest(&adjoint.dwell), largest(&adjoint.y));
        for k in 0..PASSES * POINTS {
            let difference = central_difference(2e-4, |h| {
                let mut path = case.path.clone();
                path.dwell_s_mm[k] += h;
                objective(&case, &path)
            });
            prop_assert!(
                (adjoint.dwell[k] - difference).abs() <= 1e-6 * adjoint.dwell[k].abs().max(1e-2 * most_dwell),
                "dwell {}: {} and {}", k, adjoint.dwell[k], difference
            );
            let difference = central_difference(6e-3, |h| {
                let mut path = case.path.clone();
                path.y_um[k] += h;
                objective(&case, &path)
            });
            prop_assert!(
                (adjoint.y[k] - difference).abs() <= 1e-6 * adjoint.y[k].abs().max(1e-2 * most_y),
                "y {}: {} and {}", k, adjoint.y[k], difference
            );
        }
    }

    #[test]
    fn the_adjoint_is_the_transpose_of_the_forward_mode(
        case in any_case(),
        dwell_s_mm in prop::collection::vec(-0.1..0.1, PASSES * POINTS),
        y_um in prop::collection::vec(-50.0..50.0, PASSES * POINTS),
    ) {
        // ⟨∂J/∂d, T v⟩ = ⟨Tᵀ ∂J/∂d, v⟩, where the adjoint gives Tᵀ ∂J/∂d.
        let adjoint = gradient(&case);
        let direction = Direction { dwell_s_mm, y_um };
        let tangent = case.simulator.tangent(&case.path, &case.start_um, &direction).unwrap();
        let grid = case.simulator.grid();
        let (mut left, mut size) = (0.0, 0.0);
        for row in case.objective.rows() {
            for column in case.objective.columns() {
                let k = row * grid.columns + column;
                let rest = adjoint.depth_um[k] - case.objective.target_um()[k];
                left += grid.cell_area_um2() * rest * tangent[k];
                size += (grid.cell_area_um2() * rest * tangent[k]).abs();
            }
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let right =
            dot(&adjoint.dwell, &direction.dwell_s_mm) + dot(&adjoint.y, &direction.y_um);
        prop_assert!((left - right).abs() <= 1e-12 * size, "{left} and {right}, of {size}");
    }

    #[test]
    fn a_gradient_knows_the_surface_and_the_objective(case in any_case()) {
        let adjoint = gradient(&case);
        let mut depth_um = case.start_um.clone();
        case.simulator.mill(&case.path, &mut depth_um).unwrap();
        prop_assert_eq!(&adjoint.depth_um, &depth_um);
        let objective = case.objective.value(&depth_um).unwrap();
        prop_assert_eq!(adjoint.objective.to_bits(), objective.to_bits());
    }
}

#[test]
fn passes_beyond_the_tape_are_repeated_exactly() {
    // Points so close that the records of all steps are more than the tape holds.
    let process = &processes()[0];
    let grid = Grid::new(40, 1200, 25.0).unwrap();
    let layout = RasterLayout {
        first_x_um: 320.0,
        spacing_um: 1.1,
        points: 25_000,
        first_y_um: 470.0,
        pitch_um: 30.0,
        passes: 4,
    };
    let path = BeamPath::raster(&layout, 0.02).unwrap();
    let simulator = Simulator::new(grid, process, 1).unwrap();
    let cells: usize = 25_000 * 4 * 20 * 20;
    assert!(cells > lasergym_milling::MAX_TAPE_VALUES);
    let objective = Objective::new(grid, vec![5.0; grid.len()], 0..40, 0..1200).unwrap();
    let start_um = vec![0.0; grid.len()];
    let memory = &mut GradientMemory::default();
    let adjoint = simulator.gradient(&path, &start_um, &objective, memory).unwrap();
    for (k, h) in [(12_500, 2e-3), (37_500, 2e-3), (62_500, 2e-3), (87_500, 2e-3)] {
        let difference = central_difference(h, |h| {
            let mut path = path.clone();
            path.dwell_s_mm[k] += h;
            let mut depth_um = start_um.clone();
            simulator.mill(&path, &mut depth_um).unwrap();
            objective.value(&depth_um).unwrap()
        });
        assert!(
            (adjoint.dwell[k] / difference - 1.0).abs() < 1e-5,
            "{k}: {} and {difference}",
            adjoint.dwell[k]
        );
    }
}
