//! Calibrates a camera with test pulses.

use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use crate::vision::{Vision, VisionOptions};
use crate::{
    CalibrationError, CalibrationOptions, CalibrationPair, Camera, CameraCalibration, Laser,
    Observer, Stage, Verdict,
};

/// Pulses this many times farther off than the median are strays.
const STRAY: f64 = 4.0;

/// How test pulses are fired and looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationRun {
    /// Where frames are taken, µm. Default (50, 50), the centre of the pattern.
    pub imaging_um: Point,
    /// Test pulses along x and along y, in 2..=15. Default 5.
    pub side_pulses: usize,
    /// How far the outer test pulses are from the edge of the pattern, µm, in [0, 45]. Default 10.
    pub margin_um: f64,
    /// Every position is approached from this far to the upper left, µm in [0, 20], which takes up
    /// the stage's backlash the same way each time. Default 5.
    pub approach_um: f64,
    /// Roughly the scale of the camera, frame px per µm: within 10 %.
    pub rough_scale_frame_px_per_um: f64,
    /// What marks look like.
    pub vision: VisionOptions,
    /// How the map is fitted and when it is refused.
    pub fit: CalibrationOptions,
}

impl CalibrationRun {
    /// 5 × 5 test pulses for a camera of roughly this scale, frame px per µm.
    #[must_use]
    pub fn new(rough_scale_frame_px_per_um: f64) -> Self {
        Self {
            imaging_um: Point::new(50.0, 50.0),
            side_pulses: 5,
            margin_um: 10.0,
            approach_um: 5.0,
            rough_scale_frame_px_per_um,
            vision: VisionOptions::default(),
            fit: CalibrationOptions::default(),
        }
    }

    /// Fires the test pulses on a spare piece of ground and fits the map to their marks. A pulse
    /// whose mark is not seen for sure, or lies far from where all others say it should, is left
    /// out. The laser is disarmed at the end and on every
    /// error.
    ///
    /// # Errors
    /// Any [`CalibrationError`]; too few pairs where less than half of the marks were seen.
    pub fn calibrate<S: Stage, L: Laser, C: Camera>(
        &self,
        stage: &mut S,
        laser: &mut L,
        camera: &mut C,
    ) -> Result<CameraCalibration, CalibrationError> {
        self.validate()?;
        let result = self.fire_and_fit(stage, laser, camera);
        let safe = laser.disarm().map_err(|error| device("laser", &error));
        let calibration = result?;
        safe?;
        Ok(calibration)
    }

    fn validate(&self) -> Result<(), CalibrationError> {
        let refuse =
            |name, value, expected| Err(CalibrationError::InvalidOption { name, value, expected });
        if !(2..=15).contains(&self.side_pulses) {
            return refuse("side_pulses", self.side_pulses as f64, "in 2..=15");
        }
        if !(0.0..=45.0).contains(&self.margin_um) {
            return refuse("margin_um", self.margin_um, "in [0, 45]");
        }
        if !(0.0..=20.0).contains(&self.approach_um) {
            return refuse("approach_um", self.approach_um, "in [0, 20]");
        }
        Ok(())
    }

    fn fire_and_fit<S: Stage, L: Laser, C: Camera>(
        &self,
        stage: &mut S,
        laser: &mut L,
        camera: &mut C,
    ) -> Result<CameraCalibration, CalibrationError> {
        self.go(stage, self.imaging_um)?;
        let mut before = camera.frame().map_err(|error| device("camera", &error))?;
        let (width_px, height_px) = (before.width_px(), before.height_px());
        let rough = CameraCalibration::rough(
            width_px,
            height_px,
            self.rough_scale_frame_px_per_um,
            self.imaging_um,
        )?;
        let mut vision = Vision::new(rough.clone(), &before, self.vision)?;
        let mut pairs = Vec::new();
        let mut shifts = vec![Point::default()];
        let count = self.side_pulses * self.side_pulses;
        for position in self.positions() {
            self.go(stage, position)?;
            laser.arm().map_err(|error| device("laser", &error))?;
            laser.fire().map_err(|error| device("laser", &error))?;
            laser.disarm().map_err(|error| device("laser", &error))?;
            self.go(stage, self.imaging_um)?;
            let after = camera.frame().map_err(|error| device("camera", &error))?;
            let observation = vision.observe(&before, &after, position)?;
            if let (Verdict::Seen, [mark]) = (observation.verdict, observation.marks.as_slice()) {
                pairs.push((position, mark.center_px, shifts.len()));
            }
            shifts.push(observation.shift_px);
            before = after;
        }
        let least = self.fit.model.least_pairs().max(count / 2);
        if pairs.len() < least {
            return Err(CalibrationError::TooFewPairs { pairs: pairs.len(), least });
        }
        // Marks are found where the first frame shows them. The stage has drifted since, and the
        // first frame was itself taken a little beside the imaging position.
        let drift = Line::fit(&shifts);
        let pairs: Vec<CalibrationPair> = pairs
            .into_iter()
            .map(|(stage_um, center_px, time)| CalibrationPair {
                stage_um,
                frame_px: rough.frame_px(center_px + drift.at(time)),
            })
            .collect();
        let pairs = self.without_strays(pairs, width_px, height_px)?;
        CameraCalibration::fit(&pairs, width_px, height_px, self.fit)
    }

    /// Leaves out pulses that a knock has thrown far from where they should be, the farthest first,
    /// at most a fifth of all.
    fn without_strays(
        &self,
        mut pairs: Vec<CalibrationPair>,
        width_px: usize,
        height_px: usize,
    ) -> Result<Vec<CalibrationPair>, CalibrationError> {
        let unlimited = CalibrationOptions { max_residual_um: f64::INFINITY, ..self.fit };
        for _ in 0..pairs.len() / 5 {
            let map = CameraCalibration::fit(&pairs, width_px, height_px, unlimited)?;
            let off_um =
                |pair: &CalibrationPair| map.pattern_px(pair.frame_px).distance(pair.stage_um);
            let mut all_um: Vec<f64> = pairs.iter().map(off_um).collect();
            all_um.sort_by(f64::total_cmp);
            let least_um = STRAY * all_um[all_um.len() / 2];
            let farthest = (0..pairs.len())
                .max_by(|&a, &b| off_um(&pairs[a]).total_cmp(&off_um(&pairs[b])))
                .filter(|&k| off_um(&pairs[k]) > least_um.max(self.fit.max_residual_um));
            let Some(farthest) = farthest else { break };
            pairs.remove(farthest);
        }
        Ok(pairs)
    }

    /// Where test pulses go: row by row.
    fn positions(&self) -> impl Iterator<Item = Point> {
        let last = (self.side_pulses - 1) as f64;
        let (margin, side) = (self.margin_um, WORKPIECE_SIZE_PX as f64);
        let at = move |k: usize| margin + k as f64 / last * (side - 2.0 * margin);
        let count = self.side_pulses;
        (0..count).flat_map(move |j| (0..count).map(move |i| Point::new(at(i), at(j))))
    }

    /// Goes to `position`, always from the same side as far as the limits allow.
    fn go<S: Stage>(&self, stage: &mut S, position: Point) -> Result<(), CalibrationError> {
        let from = position - Point::new(self.approach_um, self.approach_um);
        if self.approach_um > 0.0 && stage.limits_um().contains(from) {
            stage.move_to(from).map_err(|error| device("stage", &error))?;
        }
        stage.move_to(position).map_err(|error| device("stage", &error))
    }
}

/// A shift that grows evenly with time.
struct Line {
    start: Point,
    step: Point,
}

impl Line {
    /// The least-squares line through shifts at the times 0, 1, 2, …
    fn fit(shifts: &[Point]) -> Self {
        let count = shifts.len() as f64;
        let middle = 0.5 * (count - 1.0);
        let (mut mean, mut moment, mut square) = (Point::default(), Point::default(), 0.0);
        for (time, &shift) in shifts.iter().enumerate() {
            let time = time as f64 - middle;
            mean = mean + shift * count.recip();
            moment = moment + shift * time;
            square += time * time;
        }
        let step = if square > 0.0 { moment * square.recip() } else { Point::default() };
        Self { start: mean - step * middle, step }
    }

    fn at(&self, time: usize) -> Point {
        self.start + self.step * time as f64
    }
}

fn device(device: &'static str, error: &dyn std::error::Error) -> CalibrationError {
    CalibrationError::Device { device, message: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::{Preset, Rig};

    fn run(
        preset: Preset,
        seed: u64,
        fit: CalibrationOptions,
    ) -> (Rig, Result<CameraCalibration, CalibrationError>) {
        let options = preset.options();
        // 5 % off on purpose.
        let rough = options.scale_frame_px_per_um * 1.05;
        let rig = Rig::new(options, seed).unwrap();
        let run = CalibrationRun { fit, ..CalibrationRun::new(rough) };
        let found = run.calibrate(&mut rig.stage(), &mut rig.laser(), &mut rig.camera());
        (rig, found)
    }

    fn farthest_px(a: &CameraCalibration, b: &CameraCalibration) -> f64 {
        [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0), (50.0, 50.0)]
            .map(|(x, y)| {
                let point = Point::new(x, y);
                a.pattern_px(b.frame_px(point)).distance(point)
            })
            .into_iter()
            .fold(0.0, f64::max)
    }

    #[test]
    fn the_grid_finds_an_ideal_camera() {
        let (rig, found) = run(Preset::Ideal, 1, CalibrationOptions::default());
        let found = found.unwrap();
        assert!(found.residual_um() < 0.03, "{}", found.residual_um());
        assert!(farthest_px(&found, &rig.true_calibration()) < 0.05);
    }

    #[test]
    fn the_grid_finds_the_lab_camera() {
        for seed in 0..4 {
            let (rig, found) = run(Preset::Lab, seed, CalibrationOptions::default());
            let found = found.unwrap();
            // Backlash is always taken up the same way and cannot be told from an offset.
            let off = farthest_px(&found, &rig.true_calibration());
            assert!(off < 0.6, "seed {seed}: {off} {}", found.residual_um());
        }
    }

    #[test]
    fn a_stage_that_does_not_repeat_is_refused() {
        let (_, found) = run(Preset::Harsh, 1, CalibrationOptions::default());
        assert!(matches!(found, Err(CalibrationError::Residual { .. })), "{found:?}");
    }

    #[test]
    fn a_laser_that_does_not_fire_leaves_too_few_pairs() {
        let mut options = Preset::Ideal.options();
        options.misfire_probability = 1.0;
        let rig = Rig::new(options, 1).unwrap();
        let run = CalibrationRun::new(4.0);
        let found = run.calibrate(&mut rig.stage(), &mut rig.laser(), &mut rig.camera());
        assert_eq!(found, Err(CalibrationError::TooFewPairs { pairs: 0, least: 12 }));
    }

    #[test]
    fn the_laser_is_safe_after_a_device_fails() {
        let mut options = Preset::Ideal.options();
        options.stage_margin_um = 0.0;
        let rig = Rig::new(options, 1).unwrap();
        let run =
            CalibrationRun { imaging_um: Point::new(150.0, 50.0), ..CalibrationRun::new(4.0) };
        let mut laser = rig.laser();
        laser.arm().unwrap();
        let found = run.calibrate(&mut rig.stage(), &mut laser, &mut rig.camera());
        assert!(matches!(found, Err(CalibrationError::Device { device: "stage", .. })));
        assert!(!rig.state().armed);
    }
}
