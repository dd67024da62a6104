//! Trenches: what one straight pass leaves.

use crate::error::check_option;
use crate::{BeamPath, Grid, MillingError, Process, RasterLayout, Simulator};

/// First line of a trench file.
pub const TRENCH_HEADER: &str = "speed_mm_s,y_um,depth_um";

/// Longest trench file that is read, bytes.
const MAX_TRENCH_BYTES: usize = 64 << 20;

/// Cells along the radius of the footprint.
const CELLS: usize = 16;

/// The profile across a straight pass at constant speed on flat ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Trench {
    /// Speed of the pass, mm/s, above 0.
    pub speed_mm_s: f64,
    /// Places across the trench, µm.
    pub y_um: Vec<f64>,
    /// Depth at each place, µm.
    pub depth_um: Vec<f64>,
}

impl Trench {
    /// The trench shifted so that its centroid lies at y = 0.
    pub(crate) fn centred(&self) -> Self {
        let area: f64 = self.depth_um.iter().sum();
        let moment: f64 = self.depth_um.iter().zip(&self.y_um).map(|(d, y)| d * y).sum();
        let centre_um = if area > 0.0 { moment / area } else { 0.0 };
        Self { y_um: self.y_um.iter().map(|y| y - centre_um).collect(), ..self.clone() }
    }
}

/// Reads trenches from CSV text with the header [`TRENCH_HEADER`]; lines of equal speed that follow
/// one another are one trench.
///
/// # Errors
/// [`MillingError::TrenchFile`] says what is wrong in which line.
pub fn read_trenches(text: &str) -> Result<Vec<Trench>, MillingError> {
    let fault =
        |line, reason: &str| Err(MillingError::TrenchFile { line, reason: reason.to_owned() });
    if text.len() > MAX_TRENCH_BYTES {
        return fault(1, "the file has more than 64 MB");
    }
    let body = text.strip_prefix('\u{feff}').unwrap_or(text).trim_end();
    let mut lines = body.lines().enumerate();
    let header = lines.next().map_or("", |(_, line)| line);
    if !header.split(',').map(str::trim).eq(TRENCH_HEADER.split(',')) {
        return fault(1, "the header must be speed_mm_s,y_um,depth_um");
    }
    let mut trenches: Vec<Trench> = Vec::new();
    for (index, content) in lines {
        let line = index + 1;
        let numbers: Vec<f64> =
            content.split(',').map_while(|field| field.trim().parse().ok()).collect();
        let &[speed, y, depth] = &numbers[..] else {
            return fault(line, "a line must hold three numbers");
        };
        if !(speed > 0.0 && speed <= 1e6) {
            return fault(line, "speeds must be above 0 and at most 1e6 mm/s");
        }
        if !(y.abs() <= 1e9 && depth.abs() <= 1e6) {
            return fault(line, "y must be within ±1e9 µm and depths within ±1e6 µm");
        }
        match trenches.last_mut() {
            Some(trench) if trench.speed_mm_s.total_cmp(&speed).is_eq() => {
                trench.y_um.push(y);
                trench.depth_um.push(depth);
            }
            _ => trenches.push(Trench { speed_mm_s: speed, y_um: vec![y], depth_um: vec![depth] }),
        }
    }
    if trenches.is_empty() {
        return fault(1, "there is no trench after the header");
    }
    Ok(trenches)
}

/// Depths of the trench that `process` cuts at the given speed, at places across it, µm; the pass
/// runs along y = 0.
///
/// # Errors
/// [`MillingError::InvalidOption`] for a speed that is not above 0 or a law out of range,
/// [`MillingError::Unstable`] for a speed so low that the model does not hold.
pub fn trench_depths_um(
    process: &Process,
    speed_mm_s: f64,
    y_um: &[f64],
) -> Result<Vec<f64>, MillingError> {
    let ok = speed_mm_s > 0.0 && speed_mm_s <= 1e6;
    check_option("speed_mm_s", speed_mm_s, ok, "above 0 and at most 1e6 mm/s")?;
    let cell_um = process.footprint.reach_um() / CELLS as f64;
    // The pass comes from beyond the reach of the middle column and its neighbours, and goes on.
    let points = 2 * CELLS + 9;
    let (rows, columns) = (2 * CELLS + 9, points + 2 * CELLS + 8);
    let grid = Grid::new(rows, columns, cell_um)?;
    let middle_um = rows as f64 * cell_um / 2.0;
    let layout = RasterLayout {
        first_x_um: (columns as f64 * cell_um - (points - 1) as f64 * cell_um) / 2.0,
        spacing_um: cell_um,
        points,
        first_y_um: middle_um,
        pitch_um: cell_um,
        passes: 1,
    };
    let dwell = 1.0 / speed_mm_s;
    let substeps = Simulator::stable_substeps(process, cell_um, cell_um, dwell);
    let mut depth_um = vec![0.0; grid.len()];
    let path = BeamPath::raster(&layout, dwell)?;
    Simulator::new(grid, process, substeps)?.mill(&path, &mut depth_um)?;
    let at = |row: i64| {
        let row = usize::try_from(row).ok().filter(|row| *row < rows);
        row.map_or(0.0, |row| depth_um[row * columns + columns / 2])
    };
    Ok(y_um
        .iter()
        .map(|y| {
            let place = ((middle_um + y) / cell_um - 0.5).clamp(-4.0, rows as f64 + 4.0);
            let row = place.floor();
            let (t, row) = (place - row, row as i64);
            let (a, b) = (at(row), at(row + 1));
            let (da, db) = ((b - at(row - 1)) / 2.0, (at(row + 2) - a) / 2.0);
            let (c, d) = (3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db);
            a + t * (da + t * (c + t * d))
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Profile;

    #[test]
    fn a_trench_has_the_area_of_what_the_beam_removes() {
        let profile = Profile::shipped("laser-graphite").unwrap();
        let y_um: Vec<f64> = (-500..=500).map(|k| f64::from(k) * 0.1).collect();
        let depths = trench_depths_um(&profile.process, 400.0, &y_um).unwrap();
        let area: f64 = depths.iter().sum::<f64>() * 0.1;
        let expected = profile.layer_depth_um(1.0 / 400.0) * profile.pitch_um;
        assert!((area / expected - 1.0).abs() < 1e-3, "{area} and {expected}");
    }

    #[test]
    fn trenches_are_read_by_speed() {
        let text = "speed_mm_s, y_um ,depth_um\r\n20,-1,0.5\n20,0,1\n40,0,0.4\n\n";
        let trenches = read_trenches(text).unwrap();
        assert_eq!(trenches.len(), 2);
        assert_eq!(trenches[0].y_um, [-1.0, 0.0]);
        assert_eq!(trenches[1].depth_um, [0.4]);
    }

    #[test]
    fn broken_files_are_refused_by_line() {
        let fault = |text: &str| match read_trenches(text) {
            Err(MillingError::TrenchFile { line, .. }) => line,
            other => panic!("{text:?}: {other:?}"),
        };
        assert_eq!(fault("speed,y,depth\n1,2,3"), 1);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n"), 1);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n1,2,3\n1,2"), 3);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n1,2,x"), 2);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n1,2,3,4"), 2);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n0,2,3"), 2);
        assert_eq!(fault("speed_mm_s,y_um,depth_um\n1,NaN,3"), 2);
    }
}
