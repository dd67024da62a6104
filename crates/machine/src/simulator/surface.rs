//! The workpiece as the optics show it: every frame is cut out of this picture.

use lasergym_geom::Point;

use super::SimulatorOptions;
use super::ground::texture;
use super::state::{Event, Speck, stream_of};

/// How far the picture goes beyond the frame on each side, µm.
const MARGIN_UM: f64 = 12.0;

/// Part of the strongest possible wear that a second pulse on machined ground brings.
const WEAR_PER_PULSE: f32 = 0.5;

/// A rectangle of pixels: rows and columns from the first to before the end.
#[derive(Debug, Clone, Copy)]
struct Area {
    rows: (usize, usize),
    columns: (usize, usize),
}

/// The workpiece seen from the imaging position, with a margin, in frame px.
///
/// A pixel's coordinates are those of the frame plus the margin. A mark is a disc with a rim of one
/// pixel; the blur of the optics comes on top.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    width: usize,
    height: usize,
    margin: usize,
    mark_contrast: f32,
    most_wear: f32,
    grain_contrast: f32,
    /// A texture of variance 1 that grain is cut from.
    texture: Vec<f32>,
    /// Brightness of pristine ground.
    pristine: Vec<f32>,
    /// Part of the pixel that is machined.
    machined: Vec<f32>,
    /// How much darker further pulses have made it.
    wear: Vec<f32>,
    /// Grain of machined ground.
    grain: Vec<f32>,
    /// Part of the light that specks let through.
    clear: Vec<f32>,
    /// All of it through the optics.
    seen: Vec<f32>,
    blur: Vec<f32>,
}

impl Surface {
    pub(super) fn new(options: &SimulatorOptions, seed: u64) -> Self {
        let margin = (MARGIN_UM * options.scale_frame_px_per_um).ceil() as usize;
        let width = options.frame_width_px + 2 * margin;
        let height = options.frame_height_px + 2 * margin;
        let mut stream = stream_of(seed, Event::Ground, 0);
        let texture = texture(&mut stream, width, height, options.scale_frame_px_per_um);
        let contrast = options.texture_contrast as f32;
        let pristine: Vec<f32> =
            texture.iter().map(|value| (1.0 + contrast * value).max(0.0)).collect();
        let mut surface = Self {
            width,
            height,
            margin,
            mark_contrast: options.mark_contrast as f32,
            most_wear: (options.mark_contrast * options.rehit_fraction) as f32 / WEAR_PER_PULSE,
            grain_contrast: options.grain_contrast as f32,
            machined: vec![0.0; pristine.len()],
            wear: vec![0.0; pristine.len()],
            grain: vec![0.0; pristine.len()],
            clear: vec![1.0; pristine.len()],
            seen: pristine.clone(),
            blur: gaussian(options.blur_frame_px as f32),
            texture,
            pristine,
        };
        surface.refresh(Area { rows: (0, height), columns: (0, width) });
        surface
    }

    /// Columns, px.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// How far the picture goes beyond the frame, px.
    pub(super) fn margin(&self) -> usize {
        self.margin
    }

    /// The picture through the optics, row by row.
    pub(super) fn seen(&self) -> &[f32] {
        &self.seen
    }

    /// Machines a disc about `center` (frame px). `grain_from` says where the grain is taken from.
    pub(super) fn machine(&mut self, center: Point, radius: f64, grain_from: [u32; 2]) {
        let Some(area) = self.around(center, radius + 1.0) else { return };
        let (center, radius) = (self.inside(center), radius as f32);
        let [row_offset, column_offset] = grain_from.map(|n| n as usize);
        for j in area.rows.0..area.rows.1 {
            let grain_row = (j + row_offset) % self.height * self.width;
            let dy = j as f32 + 0.5 - center[1];
            for i in area.columns.0..area.columns.1 {
                let dx = i as f32 + 0.5 - center[0];
                let hit = (radius + 0.5 - (dx * dx + dy * dy).sqrt()).clamp(0.0, 1.0);
                if hit > 0.0 {
                    let at = j * self.width + i;
                    let machined = self.machined[at];
                    self.wear[at] +=
                        WEAR_PER_PULSE * hit * machined * (self.most_wear - self.wear[at]);
                    self.machined[at] = machined.max(hit);
                    let grain = self.texture[grain_row + (i + column_offset) % self.width];
                    self.grain[at] += hit * (self.grain_contrast * grain - self.grain[at]);
                }
            }
        }
        self.refresh(area);
    }

    /// Shows `specks`, whose positions are frame px, where `changed` were or are.
    pub(super) fn strew(&mut self, specks: &[Speck], changed: &[Speck]) {
        for speck in changed {
            let center = Point::new(speck.x_px, speck.y_px);
            let Some(area) = self.around(center, speck.radius_px + 1.0) else { continue };
            for j in area.rows.0..area.rows.1 {
                let row = j * self.width;
                self.clear[row + area.columns.0..row + area.columns.1].fill(1.0);
            }
            for other in specks {
                self.cover(other, area);
            }
            self.refresh(area);
        }
    }

    /// Darkens the part of `area` that `speck` covers.
    fn cover(&mut self, speck: &Speck, area: Area) {
        let center = Point::new(speck.x_px, speck.y_px);
        let Some(own) = self.around(center, speck.radius_px + 1.0) else { return };
        let center = self.inside(center);
        for j in own.rows.0.max(area.rows.0)..own.rows.1.min(area.rows.1) {
            let dy = j as f32 + 0.5 - center[1];
            for i in own.columns.0.max(area.columns.0)..own.columns.1.min(area.columns.1) {
                let dx = i as f32 + 0.5 - center[0];
                let part =
                    (speck.radius_px as f32 + 0.5 - (dx * dx + dy * dy).sqrt()).clamp(0.0, 1.0);
                self.clear[j * self.width + i] *= 1.0 - part * speck.opacity as f32;
            }
        }
    }

    /// Frame px as coordinates of this picture.
    fn inside(&self, point: Point) -> [f32; 2] {
        [point.x + self.margin as f64, point.y + self.margin as f64].map(|value| value as f32)
    }

    /// The pixels within `reach` of `center`, if there are any.
    fn around(&self, center: Point, reach: f64) -> Option<Area> {
        let range = |middle: f64, length: usize| {
            let middle = middle + self.margin as f64;
            let first = (middle - reach).floor().clamp(0.0, length as f64) as usize;
            let end = (middle + reach).ceil().clamp(0.0, length as f64) as usize;
            (first < end).then_some((first, end))
        };
        Some(Area { rows: range(center.y, self.height)?, columns: range(center.x, self.width)? })
    }

    /// Shows `area` and what its blur reaches anew.
    fn refresh(&mut self, area: Area) {
        let reach = self.blur.len() / 2;
        let wider = |range: (usize, usize), by: usize, length: usize| {
            (range.0.saturating_sub(by), (range.1 + by).min(length))
        };
        let rows = wider(area.rows, reach, self.height);
        let columns = wider(area.columns, reach, self.width);
        let (from_rows, from_columns) =
            (wider(rows, reach, self.height), wider(columns, reach, self.width));
        let from_width = from_columns.1 - from_columns.0;
        let width = columns.1 - columns.0;
        // Along the rows first, for all rows that the columns then need.
        let mut sharp = vec![0.0_f32; from_width + 2 * reach];
        let mut smooth = vec![0.0_f32; width * (from_rows.1 - from_rows.0)];
        for (j, smooth) in (from_rows.0..from_rows.1).zip(smooth.chunks_exact_mut(width)) {
            let at = j * self.width + from_columns.0;
            self.reflect(at, &mut sharp[reach..reach + from_width]);
            let (first, last) = (sharp[reach], sharp[reach + from_width - 1]);
            sharp[..reach].fill(first);
            sharp[reach + from_width..].fill(last);
            let start = columns.0 - from_columns.0;
            for (k, &weight) in self.blur.iter().enumerate() {
                for (value, &from) in smooth.iter_mut().zip(&sharp[start + k..]) {
                    *value += weight * from;
                }
            }
        }
        for j in rows.0..rows.1 {
            let at = j * self.width + columns.0;
            let seen = &mut self.seen[at..at + width];
            seen.fill(0.0);
            for (k, &weight) in self.blur.iter().enumerate() {
                let row = (j + k).saturating_sub(reach).clamp(from_rows.0, from_rows.1 - 1);
                let from = (row - from_rows.0) * width;
                for (value, &smooth) in seen.iter_mut().zip(&smooth[from..from + width]) {
                    *value += weight * smooth;
                }
            }
        }
    }

    /// Brightness without the optics of the pixels from `at` on.
    fn reflect(&self, at: usize, into: &mut [f32]) {
        let end = at + into.len();
        let ground = self.pristine[at..end].iter().zip(&self.machined[at..end]);
        let marks = self.wear[at..end].iter().zip(&self.grain[at..end]);
        let specks = &self.clear[at..end];
        for (((value, (pristine, machined)), (wear, grain)), clear) in
            into.iter_mut().zip(ground).zip(marks).zip(specks)
        {
            let bright = pristine * (1.0 - self.mark_contrast * machined - wear);
            *value = (bright + grain * machined).max(0.0) * clear;
        }
    }
}

/// The taps of a Gaussian of standard deviation `deviation` px.
fn gaussian(deviation: f32) -> Vec<f32> {
    if deviation < 0.05 {
        return vec![1.0];
    }
    let reach = (3.0 * deviation).ceil() as i32;
    let taps: Vec<f32> =
        (-reach..=reach).map(|k| (-0.5 * (k as f32 / deviation).powi(2)).exp()).collect();
    let sum: f32 = taps.iter().sum();
    taps.into_iter().map(|tap| tap / sum).collect()
}
