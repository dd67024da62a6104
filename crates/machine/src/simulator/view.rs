//! The camera's part of a picture: where it looks, its lamp, its focus and its sensor.

use std::sync::OnceLock;

use lasergym_ablation::Stream;
use lasergym_geom::Point;

use super::SimulatorOptions;
use super::state::{Event, stream_of};
use super::surface::Surface;

/// Length of the table that noise is cut from; a power of 2.
const NOISE_LEN: usize = 1 << 16;

/// Normals that all frames cut their noise from, each row elsewhere.
static NOISE: OnceLock<Vec<f32>> = OnceLock::new();

/// Lamp and sensor, which stay where they are when the stage moves.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    width: usize,
    /// Grey levels of white ground at the nominal exposure, pixel by pixel.
    field: Vec<f32>,
}

/// What is special about one frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exposure {
    /// Where the frame's upper left corner lies in the picture seen from the imaging position,
    /// frame px.
    pub(super) shift: Point,
    /// Lamp and exposure time over the nominal ones.
    pub(super) gain: f64,
    /// How much brighter the right and the lower edge are than the middle.
    pub(super) tilt: Point,
    /// Further blur: standard deviation, frame px.
    pub(super) defocus: f64,
}

impl Sensor {
    pub(super) fn new(options: &SimulatorOptions, seed: u64) -> Self {
        let (width, height) = (options.frame_width_px, options.frame_height_px);
        let mut stream = stream_of(seed, Event::Sensor, 0);
        let (center_x, center_y) = (0.5 * width as f64, 0.5 * height as f64);
        let corner_squared = center_x * center_x + center_y * center_y;
        let mut field = Vec::with_capacity(width * height);
        for j in 0..height {
            for i in 0..width {
                let (dx, dy) = (i as f64 + 0.5 - center_x, j as f64 + 0.5 - center_y);
                let dark = options.vignetting_fraction * (dx * dx + dy * dy) / corner_squared;
                let sensitivity = 1.0 + options.fixed_pattern_fraction * stream.normal();
                field.push((options.brightness_levels * (1.0 - dark) * sensitivity) as f32);
            }
        }
        Self { width, field }
    }

    /// The grey levels of a frame, row by row.
    pub(super) fn expose(
        &self,
        surface: &Surface,
        exposure: Exposure,
        options: &SimulatorOptions,
        stream: &mut Stream,
    ) -> Vec<u8> {
        let noise = NOISE.get_or_init(|| {
            let mut stream = Stream::from_seed(0);
            (0..NOISE_LEN).map(|_| stream.normal() as f32).collect()
        });
        let (columns, rows) =
            (taps(exposure.shift.x, exposure.defocus), taps(exposure.shift.y, exposure.defocus));
        let height = self.field.len() / self.width;
        let margin = surface.margin().cast_signed();
        let first = |taps: &Taps| (margin + taps.first).clamp(0, 2 * margin) as usize;
        let (first_column, first_row) = (first(&columns), first(&rows));
        let read_variance = (options.read_noise_levels * options.read_noise_levels) as f32;
        let shot_variance = if options.electrons_per_level > 0.0 {
            options.electrons_per_level.recip() as f32
        } else {
            0.0
        };
        let mut gray = Vec::with_capacity(self.field.len());
        let mut between = vec![0.0_f32; surface.width()];
        let mut light = vec![0.0_f32; self.width];
        let last_row = surface.seen().len() / surface.width() - 1;
        for (j, field) in self.field.chunks_exact(self.width).enumerate() {
            between.fill(0.0);
            for (k, &weight) in rows.weights.iter().enumerate() {
                let row = (first_row + j + k).min(last_row) * surface.width();
                for (value, &seen) in between.iter_mut().zip(&surface.seen()[row..]) {
                    *value += weight * seen;
                }
            }
            light.fill(0.0);
            for (k, &weight) in columns.weights.iter().enumerate() {
                for (value, &seen) in light.iter_mut().zip(&between[first_column + k..]) {
                    *value += weight * seen;
                }
            }
            let across = 2.0 / self.width as f64;
            let down = (2 * j) as f64 / height as f64 - 1.0;
            let left = exposure.gain * (1.0 - exposure.tilt.x + exposure.tilt.y * down);
            let step = (exposure.gain * exposure.tilt.x * across) as f32;
            let from = (stream.uniform() * (NOISE_LEN - self.width) as f64) as usize;
            let noise = &noise[from..from + self.width];
            let mut lamp = left as f32;
            gray.extend(light.iter().zip(field).zip(noise).map(|((light, field), noise)| {
                let level = (light * field * lamp).max(0.0);
                lamp += step;
                let deviation = (level * shot_variance + read_variance).sqrt();
                // The conversion saturates at 0 and 255.
                (level + deviation * noise + 0.5) as u8
            }));
        }
        gray
    }
}

/// Weights by which a row is moved by part of a pixel and blurred.
struct Taps {
    /// Where the first weight belongs, px.
    first: isize,
    weights: Vec<f32>,
}

/// Weights for looking `shift` px further, blurred by `deviation` px.
fn taps(shift: f64, deviation: f64) -> Taps {
    let whole = shift.floor();
    let part = shift - whole;
    let reach = (3.0 * deviation).ceil().max(1.0) as isize;
    let weights: Vec<f64> = if deviation < 0.3 {
        // Cubic convolution (Keys 1981).
        [1.0 + part, part, 1.0 - part, 2.0 - part]
            .map(|distance| {
                let d = distance;
                if d <= 1.0 {
                    (1.5 * d - 2.5) * d * d + 1.0
                } else {
                    ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0
                }
            })
            .to_vec()
    } else {
        (-reach..=reach + 1)
            .map(|k| (-0.5 * ((k as f64 - part) / deviation).powi(2)).exp())
            .collect()
    };
    let sum: f64 = weights.iter().sum();
    Taps {
        first: whole as isize - if deviation < 0.3 { 1 } else { reach },
        weights: weights.iter().map(|weight| (weight / sum) as f32).collect(),
    }
}
