//! A target, a process and the raster that covers it.

use crate::error::check_option;
use crate::{BeamPath, DepthMap, Grid, MillingError, Objective, Profile, RasterLayout, Simulator};

/// Most layers of a job.
pub const MAX_LAYERS: usize = 100;

/// How far passes go beyond the target, as a part of the footprint's reach.
const LEAD: f64 = 0.75;

/// Distance between points along a pass, as a part of the footprint's reach.
const SPACING: f64 = 0.125;

/// How much longer than its line a stretch of a free pass may be at the lowest speed; the solver
/// takes only paths whose steps stay stable.
const LENGTHENING: f64 = 2.0;

/// Depth that layers chosen automatically could reach, over the depth of the target: room for the
/// deeper dwell that walls and slopes need.
const RESERVE: f64 = 1.25;

/// How a job is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JobOptions {
    /// Number of layers, each a raster over the whole target, from 1 to 100; by default as few as
    /// reach the deepest place with a reserve of a quarter.
    pub layers: Option<usize>,
}

/// Everything that is fixed before the passes are optimised.
#[derive(Debug, Clone)]
pub struct MillingJob {
    profile: Profile,
    target: DepthMap,
    objective: Objective,
    simulator: Simulator,
    layers: usize,
    layout: RasterLayout,
    start_um: Vec<f64>,
}

impl MillingJob {
    /// Lays passes of `profile` over `target`.
    ///
    /// Pixels too coarse for the footprint are divided, points are an eighth of the footprint's
    /// reach apart, and passes go three quarters of it beyond the target; what they do there does not
    /// count. The layers' passes lie between one another.
    ///
    /// # Errors
    /// [`MillingError::EmptyTarget`]; [`MillingError::TooDeep`] and [`MillingError::TooShallow`]
    /// name where the speeds exclude the target; [`MillingError::GridSize`] and
    /// [`MillingError::WindowTooLarge`] for targets too large or pixels too fine for the footprint;
    /// [`MillingError::InvalidOption`] for options and profiles out of range.
    pub fn new(
        target: &DepthMap,
        profile: Profile,
        options: JobOptions,
    ) -> Result<Self, MillingError> {
        Self::lay_out(target, None, profile, options)
    }

    /// As [`MillingJob::new`], on a workpiece that is milled in part: `measured` is its surface, of the
    /// same width and height as the target, with pixels of its own. Layers count from there on.
    /// Ground that is too deep already, or that the fastest pass makes too deep, is no error here.
    ///
    /// # Errors
    /// As [`MillingJob::new`]; [`MillingError::MeasuredSize`] for a surface of another size,
    /// [`MillingError::EmptyTarget`] where nothing is left to remove.
    pub fn continued(
        target: &DepthMap,
        measured: &DepthMap,
        profile: Profile,
        options: JobOptions,
    ) -> Result<Self, MillingError> {
        let size = |map: &DepthMap| {
            let Grid { rows, columns, cell_um, .. } = *map.grid();
            (rows as f64 * cell_um, columns as f64 * cell_um)
        };
        let ((height_um, width_um), (measured_height_um, measured_width_um)) =
            (size(target), size(measured));
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a;
        if !(same(height_um, measured_height_um) && same(width_um, measured_width_um)) {
            return Err(MillingError::MeasuredSize {
                width_um,
                height_um,
                measured_width_um,
                measured_height_um,
            });
        }
        Self::lay_out(target, Some(measured), profile, options)
    }

    fn lay_out(
        target: &DepthMap,
        measured: Option<&DepthMap>,
        profile: Profile,
        options: JobOptions,
    ) -> Result<Self, MillingError> {
        profile.validate()?;
        let reach_um = profile.process.footprint.reach_um();
        let pixel_um = target.grid().cell_um;
        let factor = (pixel_um / (0.2 * reach_um) * (1.0 - 1e-9)).ceil().clamp(1.0, 1e9) as usize;
        let target = if factor > 1 { target.refined(factor)? } else { target.clone() };
        let layers = choose_layers(&target, measured, &profile, options)?;

        let cell_um = target.grid().cell_um;
        let lead_um = LEAD * reach_um;
        let spacing_um = cell_um.max(SPACING * reach_um);
        let width_um = target.grid().columns as f64 * cell_um;
        let height_um = target.grid().rows as f64 * cell_um;
        let points = ((width_um + 2.0 * lead_um) / spacing_um).ceil() as usize + 1;
        let passes = ((height_um + 2.0 * lead_um) / profile.pitch_um).ceil() as usize + 1;
        let layout = RasterLayout {
            first_x_um: (width_um - (points - 1) as f64 * spacing_um) / 2.0,
            spacing_um,
            points,
            first_y_um: (height_um - (passes - 1) as f64 * profile.pitch_um) / 2.0,
            pitch_um: profile.pitch_um,
            passes,
        };

        // Ends of the raster, shifted layers and free passes, footprint, neighbours.
        let beyond_um = -layout.first_x_um.min(layout.first_y_um) + profile.pitch_um + reach_um;
        let margin = (beyond_um / cell_um).ceil() as usize + 3;
        let grid = target.grid().with_margin(margin)?;
        let target_um = (0..grid.len())
            .map(|k| target.at_um(grid.x_um(k % grid.columns), grid.y_um(k / grid.columns)))
            .collect();
        let surface_um = |measured: &DepthMap| {
            let at = |k: usize| (grid.x_um(k % grid.columns), grid.y_um(k / grid.columns));
            (0..grid.len()).map(|k| measured.at_um(at(k).0, at(k).1)).collect()
        };
        let start_um = measured.map_or_else(|| vec![0.0; grid.len()], surface_um);
        let inner = target.grid();
        let (rows, columns) = (margin..margin + inner.rows, margin..margin + inner.columns);
        let objective = Objective::new(grid, target_um, rows, columns)?;
        let (_, longest) = profile.dwell_range_s_mm();
        let longest = LENGTHENING * longest;
        let substeps = Simulator::stable_substeps(&profile.process, cell_um, spacing_um, longest);
        let simulator = Simulator::new(grid, &profile.process, substeps)?;
        Ok(Self { profile, target, objective, simulator, layers, layout, start_um })
    }

    /// The process and its limits.
    #[must_use]
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// The target, with pixels as fine as the footprint needs.
    #[must_use]
    pub fn target(&self) -> &DepthMap {
        &self.target
    }

    /// What the surface is compared with.
    #[must_use]
    pub fn objective(&self) -> &Objective {
        &self.objective
    }

    /// The forward model, on the target's grid with a margin.
    #[must_use]
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// The grid of the simulation.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        self.simulator.grid()
    }

    /// Number of layers.
    #[must_use]
    pub fn layers(&self) -> usize {
        self.layers
    }

    /// Where the passes of a layer lie, before its shift.
    #[must_use]
    pub fn layout(&self) -> &RasterLayout {
        &self.layout
    }

    /// The surface before the first pass, on the simulation's grid, µm: flat, or as measured.
    #[must_use]
    pub fn start_um(&self) -> &[f64] {
        &self.start_um
    }

    /// The part of a field on the simulation's grid that lies on the target, row by row.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] unless there is a value for each cell.
    pub fn on_target(&self, field: &[f64]) -> Result<Vec<f64>, MillingError> {
        self.grid().check_len("field", field)?;
        let columns = self.objective.columns();
        Ok(self
            .objective
            .rows()
            .flat_map(|row| {
                let start = row * self.grid().columns;
                field[start + columns.start..start + columns.end].iter().copied()
            })
            .collect())
    }

    /// The passes that a controller would make pixel by pixel: at each point the dwell that removes
    /// the depth there from flat ground with f = 1, as if no other point removed anything, within
    /// the speed limits. `removed_um` is the depth that the surface already has; `layers` layers are
    /// left.
    ///
    /// Where a layer at full speed would remove more than its share, fewer layers are used; where
    /// even one would remove more than twice the depth, the beam is off, if the profile allows it.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] unless there is a depth for each cell,
    /// [`MillingError::InvalidOption`] for no layer.
    pub fn pixel_by_pixel(
        &self,
        removed_um: &[f64],
        layers: usize,
    ) -> Result<BeamPath, MillingError> {
        self.grid().check_len("removed_um", removed_um)?;
        let ok = (1..=MAX_LAYERS).contains(&layers);
        check_option("layers", layers as f64, ok, "from 1 to 100")?;
        let law = &self.profile.process.law;
        let (least, most) = self.profile.dwell_range_s_mm();
        let least_dose = law.dose_s_mm(least);
        let per_um = 1.0 / self.profile.layer_depth_um(law.dwell_of_dose_s_mm(1.0));
        let grid = self.grid();
        let left_um = |x_um: f64, y_um: f64| {
            let cell = |place_um: f64, origin_um: f64, count: usize| {
                (((place_um - origin_um) / grid.cell_um) as usize).min(count - 1)
            };
            let row = cell(y_um, grid.origin_y_um, grid.rows);
            let column = cell(x_um, grid.origin_x_um, grid.columns);
            self.target.at_um(x_um, y_um) - removed_um[row * grid.columns + column]
        };
        let layers_used = |dose: f64| {
            let fitting = (dose / least_dose * (1.0 + 1e-9)).max(0.0) as usize;
            let at_least = usize::from(dose >= 0.5 * least_dose);
            if self.profile.can_switch_off { fitting.clamp(at_least, layers) } else { layers }
        };

        let mut path = self.straight(layers)?;
        let points = self.layout.points;
        for pass in 0..path.passes() {
            let layer = pass / self.layout.passes;
            let y_um = path.y_um[pass * points];
            for point in 0..points {
                let dose = left_um(path.x_um(point), y_um).max(0.0) * per_um;
                let share = dose / layers_used(dose).max(1) as f64;
                path.dwell_s_mm[pass * points + point] =
                    law.dwell_of_dose_s_mm(share).clamp(least, most);
                if point + 1 < points {
                    let middle_um = path.x_um(point) + self.layout.spacing_um / 2.0;
                    let dose = left_um(middle_um, y_um) * per_um;
                    path.beam_on[pass * (points - 1) + point] = layers_used(dose) > layer;
                }
            }
        }
        Ok(path)
    }

    /// Straight passes of `layers` layers, layer by layer, each shifted by its part of the pitch.
    fn straight(&self, layers: usize) -> Result<BeamPath, MillingError> {
        let layout =
            RasterLayout { passes: self.layout.passes.saturating_mul(layers), ..self.layout };
        let mut path = BeamPath::raster(&layout, 1.0)?;
        for (k, y_um) in path.y_um.iter_mut().enumerate() {
            let pass = k / self.layout.points;
            let (layer, row) = (pass / self.layout.passes, pass % self.layout.passes);
            let shift = (layer as f64 - (layers - 1) as f64 / 2.0) / layers as f64;
            *y_um = self.layout.first_y_um + (row as f64 + shift) * self.layout.pitch_um;
        }
        Ok(path)
    }
}

/// Checks that the layers reach the target, or chooses how many do.
fn choose_layers(
    target: &DepthMap,
    measured: Option<&DepthMap>,
    profile: &Profile,
    options: JobOptions,
) -> Result<usize, MillingError> {
    let place = |index: usize| (index / target.grid().columns, index % target.grid().columns);
    let depths = || {
        target.depth_um().iter().enumerate().map(|(index, &depth_um)| {
            let (row, column) = place(index);
            let (x_um, y_um) = (target.grid().x_um(column), target.grid().y_um(row));
            (index, depth_um - measured.map_or(0.0, |measured| measured.at_um(x_um, y_um)))
        })
    };
    let Some((deepest, depth_um)) = depths().max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return Err(MillingError::EmptyTarget);
    };
    if depth_um <= 0.0 {
        return Err(MillingError::EmptyTarget);
    }
    let (least, most) = profile.dwell_range_s_mm();
    let (least_um, most_um) = (profile.layer_depth_um(least), profile.layer_depth_um(most));
    let (row, column) = place(deepest);
    let needed = (depth_um / most_um * (1.0 - 1e-9)).ceil().clamp(1.0, 1e9) as usize;
    let automatic = (RESERVE * depth_um / most_um).ceil().clamp(1.0, 1e9) as usize;
    let layers = options.layers.unwrap_or_else(|| automatic.min(MAX_LAYERS));
    let ok = (1..=MAX_LAYERS).contains(&layers);
    check_option("layers", layers as f64, ok, "from 1 to 100")?;
    if layers < needed {
        let reach_um = layers as f64 * most_um;
        return Err(MillingError::TooDeep { row, column, depth_um, layers, reach_um, needed });
    }
    if !profile.can_switch_off && measured.is_none() {
        let least_um = layers as f64 * least_um;
        let shallowest = depths().min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, depth_um)) = shallowest.filter(|(_, depth)| *depth < least_um) {
            let (row, column) = place(index);
            return Err(MillingError::TooShallow { row, column, depth_um, least_um });
        }
    }
    Ok(layers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(depth_um: f64) -> DepthMap {
        DepthMap::new(30, 40, 5.0, vec![depth_um; 1200]).unwrap()
    }

    fn laser() -> Profile {
        Profile::shipped("laser-graphite").unwrap()
    }

    fn jet() -> Profile {
        Profile::shipped("waterjet-garnet").unwrap()
    }

    #[test]
    fn pixel_by_pixel_is_right_on_flat_ground() {
        for depth_um in [8.0, 14.0, 37.0] {
            let job = MillingJob::new(&flat(depth_um), laser(), JobOptions::default()).unwrap();
            let mut surface = vec![0.0; job.grid().len()];
            let path = job.pixel_by_pixel(&surface, job.layers()).unwrap();
            job.simulator().mill(&path, &mut surface).unwrap();
            let middle = job.on_target(&surface).unwrap()[15 * 40 + 20];
            assert!((middle / depth_um - 1.0).abs() < 0.01, "{middle} for {depth_um}");
        }
    }

    #[test]
    fn the_beam_is_off_where_nothing_is_to_be_removed() {
        let depths = (0..1200).map(|k| if k % 40 < 20 { 0.0 } else { 12.0 }).collect();
        let target = DepthMap::new(30, 40, 5.0, depths).unwrap();
        let job = MillingJob::new(&target, laser(), JobOptions::default()).unwrap();
        let path = job.pixel_by_pixel(&vec![0.0; job.grid().len()], job.layers()).unwrap();
        for (k, on) in path.beam_on.iter().enumerate() {
            let x_um = path.x_um(k % (path.points - 1)) + path.spacing_um / 2.0;
            if (x_um - 100.0).abs() > 6.0 {
                assert_eq!(*on, x_um > 100.0, "at {x_um}");
            }
        }
    }

    #[test]
    fn targets_out_of_reach_are_refused_by_place() {
        let mut depths = vec![10.0; 1200];
        depths[7 * 40 + 9] = 90.0;
        let target = DepthMap::new(30, 40, 5.0, depths).unwrap();
        match MillingJob::new(&target, laser(), JobOptions { layers: Some(2) }).unwrap_err() {
            MillingError::TooDeep { row: 7, column: 9, layers: 2, needed, .. } => {
                assert!(
                    MillingJob::new(&target, laser(), JobOptions { layers: Some(needed) }).is_ok()
                );
            }
            other => panic!("{other}"),
        }
        assert!(matches!(
            MillingJob::new(&target, jet(), JobOptions::default()),
            Err(MillingError::TooShallow { row: 0, column: 0, .. })
        ));
    }

    #[test]
    fn a_measured_surface_is_where_the_job_begins() {
        // Measured with pixels twice as coarse, one half 10 µm deep.
        let depths = (0..300).map(|k| if k % 20 < 10 { 10.0 } else { 0.0 }).collect();
        let measured = DepthMap::new(15, 20, 10.0, depths).unwrap();
        let options = JobOptions::default();
        let job = MillingJob::continued(&flat(22.0), &measured, laser(), options).unwrap();
        let start = job.on_target(job.start_um()).unwrap();
        assert!((start[0] - 10.0).abs() < 1e-12 && start[39].abs() < 1e-12);
        assert_eq!(job.layers(), MillingJob::new(&flat(22.0), laser(), options).unwrap().layers());
        let path = job.pixel_by_pixel(job.start_um(), job.layers()).unwrap();
        let mut surface = job.start_um().to_vec();
        job.simulator().mill(&path, &mut surface).unwrap();
        let surface = job.on_target(&surface).unwrap();
        for middle in [15 * 40 + 10, 15 * 40 + 30] {
            assert!((surface[middle] / 22.0 - 1.0).abs() < 0.02, "{}", surface[middle]);
        }
        // The rest is within reach of a single layer.
        let one = JobOptions { layers: Some(1) };
        let nearly = DepthMap::new(30, 40, 5.0, vec![14.0; 1200]).unwrap();
        assert!(MillingJob::new(&flat(22.0), laser(), one).is_err());
        assert_eq!(MillingJob::continued(&flat(22.0), &nearly, laser(), one).unwrap().layers(), 1);
    }

    #[test]
    fn measured_surfaces_of_another_size_or_deep_enough_are_refused() {
        let options = JobOptions::default();
        let other = DepthMap::new(30, 41, 5.0, vec![1.0; 1230]).unwrap();
        assert!(matches!(
            MillingJob::continued(&flat(20.0), &other, laser(), options),
            Err(MillingError::MeasuredSize { .. })
        ));
        assert!(matches!(
            MillingJob::continued(&flat(20.0), &flat(20.0), laser(), options),
            Err(MillingError::EmptyTarget)
        ));
    }

    #[test]
    fn bad_jobs_are_refused() {
        assert!(matches!(
            MillingJob::new(&flat(0.0), laser(), JobOptions::default()),
            Err(MillingError::EmptyTarget)
        ));
        for layers in [0, MAX_LAYERS + 1] {
            assert!(matches!(
                MillingJob::new(&flat(9.0), laser(), JobOptions { layers: Some(layers) }),
                Err(MillingError::InvalidOption { name: "layers", .. })
            ));
        }
        let fine = DepthMap::new(3, 3, 1e-3, vec![9.0; 9]).unwrap();
        assert!(matches!(
            MillingJob::new(&fine, laser(), JobOptions::default()),
            Err(MillingError::WindowTooLarge { .. } | MillingError::GridSize { .. })
        ));
    }
}
