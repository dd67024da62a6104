//! Draws a hand-made trajectory over the star target and writes `overlay.svg` and `overlay.png` to
//! the folder given as the argument, or to the current one.
//!
//! `cargo run -p lasergym-toolpath --example overlay -- /tmp`

use std::f64::consts::PI;
use std::path::PathBuf;

use lasergym_geom::{Bitmap, Point, fill_even_odd, svg_to_rgba};
use lasergym_toolpath::{OverlayOptions, Pulse, StageDynamics, Trajectory};
use lasergym_toolpath::{PulsePath, trajectory_svg, travel};

const RADIUS_PX: f64 = 9.0;

/// The star: five points, tip up, outer radius 55.28 px, inner 0.54 of it.
fn star() -> Bitmap {
    let corner = |k: i32| {
        let radius_px = if k % 2 == 0 { 55.28 } else { 0.54 * 55.28 };
        let (sin, cos) = (PI * f64::from(k) / 5.0 - PI / 2.0).sin_cos();
        Point::new(50.0, 55.28) + Point::new(cos, sin) * radius_px
    };
    fill_even_odd(&[(0..10).map(corner).collect::<Vec<_>>()])
}

/// Rows of pulses, there and back, wherever the target holds most of the disc.
fn rows_of_pulses(target: &Bitmap) -> Vec<Point> {
    let inside = |at: Point| {
        let near = |&(j, i): &(usize, usize)| {
            at.distance(Point::new(i as f64 + 0.5, j as f64 + 0.5)) <= RADIUS_PX
        };
        target.pixels().filter(near).count() > 185
    };
    let mut positions = Vec::new();
    for row in 0..9 {
        let y = 9.0 + 10.5 * f64::from(row);
        let shift = if row % 2 == 0 { 0.0 } else { 6.0 };
        let mut line: Vec<Point> = (0..9)
            .map(|column| Point::new(2.0 + 12.0 * f64::from(column) + shift, y))
            .filter(|&at| inside(at))
            .collect();
        if row % 2 == 1 {
            line.reverse();
        }
        positions.append(&mut line);
    }
    positions
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_owned()));
    let target = star();
    let path = PulsePath::new(rows_of_pulses(&target), RADIUS_PX)?;
    let travel = travel(&path, &StageDynamics::default())?;
    let caption = format!(
        "{} pulses, {:.0} µm of travel in {:.1} s",
        path.len(),
        travel.length_um,
        travel.time_s
    );
    // Every pulse lands a little off, and every third mark is smaller than asked for.
    let landed = path.positions_px().iter().enumerate().map(|(k, &position)| {
        let (sin, cos) = (2.4 * k as f64).sin_cos();
        let radius_px = if k % 3 == 0 { 0.93 * RADIUS_PX } else { RADIUS_PX };
        Pulse { position_px: position + Point::new(cos, sin) * 0.8, radius_px }
    });
    let trajectory = Trajectory::new(target, landed.collect())?;
    let options = OverlayOptions { caption: Some(caption), ..OverlayOptions::default() };
    let svg = trajectory_svg(&trajectory, &options);
    std::fs::write(folder.join("overlay.svg"), &svg)?;
    std::fs::write(folder.join("overlay.png"), svg_to_rgba(&svg, 1200)?.to_png()?)?;
    eprintln!("wrote overlay.svg ({} bytes) and overlay.png to {}", svg.len(), folder.display());
    Ok(())
}
