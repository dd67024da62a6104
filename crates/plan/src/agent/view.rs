//! What the network of the spatial agent sees: the surroundings of the best place by ring score.

use lasergym_geom::WORKPIECE_SIZE_PX;

use crate::JobState;

/// Width and height of the square that the network sees, px. The candidate lies in its row and
/// column 28, counted from 0.
pub const VIEW_WIDTH_PX: usize = 56;

/// Width and height of a channel of the view: every channel holds every other row and column.
pub const VIEW_SIZE: usize = VIEW_WIDTH_PX / 2;

/// Channels of a view. Each of the layers remaining target (0 or 1), forbidden ground (0 or 1),
/// gain of a pulse (÷ 128 px) and target in its ring (÷ 128 px) fills four, for the pixels in even
/// and odd rows and columns, as `torch.nn.PixelUnshuffle` orders them. The last two are constant:
/// pulses left ÷ 45, and remaining target ÷ (250 px × pulses left).
pub const VIEW_CHANNELS: usize = 4 * LAYERS + 2;

/// Values of a view, shape ([`VIEW_CHANNELS`], [`VIEW_SIZE`], [`VIEW_SIZE`]).
pub const VIEW_LEN: usize = VIEW_CHANNELS * VIEW_SIZE * VIEW_SIZE;

const LAYERS: usize = 4;

/// Gains and rings are divided by this, px, to be of the order of one.
const GAIN_SCALE_PX: f32 = 128.0;

/// Pulses left are divided by this, the budget of the paper.
const PULSE_SCALE: f32 = 45.0;

/// Remaining target per pulse left is divided by this: about the area of a pulse, px.
const AREA_PER_PULSE_PX: f32 = 250.0;

/// Writes what the network sees about `pixel` (row, column), [`VIEW_LEN`] values; what lies beside
/// the workpiece is 0.
pub fn write_view(state: &JobState, pixel: (usize, usize), view: &mut [f32]) {
    const PLANE: usize = VIEW_SIZE * VIEW_SIZE;
    let constants = 4 * LAYERS * PLANE;
    view[..constants].fill(0.0);
    let half = VIEW_WIDTH_PX / 2;
    let (remaining, forbidden) = (state.workpiece().remaining(), state.workpiece().forbidden());
    let rows = pixel.0.saturating_sub(half)..(pixel.0 + half).min(WORKPIECE_SIZE_PX);
    let columns = pixel.1.saturating_sub(half)..(pixel.1 + half).min(WORKPIECE_SIZE_PX);
    for row in rows {
        let view_row = row + half - pixel.0;
        let (remaining, forbidden) = (remaining.rows()[row], forbidden.rows()[row]);
        let gains = state.scores().gains().row(row);
        for column in columns.clone() {
            let view_column = column + half - pixel.1;
            let phase = 2 * (view_row % 2) + view_column % 2;
            let place = phase * PLANE + view_row / 2 * VIEW_SIZE + view_column / 2;
            let layers = [
                ((remaining >> column) & 1) as f32,
                ((forbidden >> column) & 1) as f32,
                f32::from(gains[column]) / GAIN_SCALE_PX,
                state.scores().ring_px(row, column) as f32 / GAIN_SCALE_PX,
            ];
            for (layer, value) in layers.into_iter().enumerate() {
                view[layer * 4 * PLANE + place] = value;
            }
        }
    }
    let pulses_left = state.pulses_left().max(1) as f32;
    let area_px = state.workpiece().remaining().area_px() as f32;
    let constants = view[constants..].chunks_exact_mut(PLANE);
    for (plane, value) in
        constants.zip([pulses_left / PULSE_SCALE, area_px / (AREA_PER_PULSE_PX * pulses_left)])
    {
        plane.fill(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Job;
    use lasergym_ablation::{Workpiece, star};
    use lasergym_geom::Point;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_view_shows_the_layers_about_its_pixel(row in 0_usize..100, column in 0_usize..100) {
            let job = Job::new(Workpiece::new(&star(10.0)).unwrap(), 9.0, 45).unwrap();
            let mut state = JobState::new(&job, 0.35);
            state.pulse(Point::new(40.2, 55.9));
            let mut view = vec![f32::NAN; VIEW_LEN];
            write_view(&state, (row, column), &mut view);
            let value = |layer: usize, view_row: usize, view_column: usize| {
                let channel = 4 * layer + 2 * (view_row % 2) + view_column % 2;
                view[(channel * VIEW_SIZE + view_row / 2) * VIEW_SIZE + view_column / 2]
            };
            for view_row in 0..VIEW_WIDTH_PX {
                for view_column in 0..VIEW_WIDTH_PX {
                    let (j, i) = (row + view_row, column + view_column);
                    let seen = std::array::from_fn(|layer| value(layer, view_row, view_column));
                    let inside = (28..128).contains(&j) && (28..128).contains(&i);
                    let expected = if inside {
                        let (j, i) = (j - 28, i - 28);
                        [
                            f32::from(u8::from(state.workpiece().remaining().contains(j, i))),
                            f32::from(u8::from(state.workpiece().forbidden().contains(j, i))),
                            state.scores().gains().gain_px(j, i) as f32 / 128.0,
                            state.scores().ring_px(j, i) as f32 / 128.0,
                        ]
                    } else {
                        [0.0; 4]
                    };
                    prop_assert_eq!(seen.map(f32::to_bits), expected.map(f32::to_bits));
                }
            }
            let constants = &view[16 * VIEW_SIZE * VIEW_SIZE..];
            let area_px = state.workpiece().remaining().area_px() as f32;
            let (first, second) = constants.split_at(VIEW_SIZE * VIEW_SIZE);
            let all = |plane: &[f32], value: f32| plane.iter().all(|v| v.to_bits() == value.to_bits());
            prop_assert!(all(first, 44.0 / 45.0));
            prop_assert!(all(second, area_px / (250.0 * 44.0)));
        }
    }
}
