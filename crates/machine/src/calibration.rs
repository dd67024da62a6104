//! Where the camera sees the pattern.

use lasergym_geom::Point;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Which distortions a calibration allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CalibrationModel {
    /// One scale, a rotation and an offset: 4 numbers, for square camera pixels and a square stage.
    Similarity,
    /// Any linear map: 6 numbers, also for axes that are not square or have different scales.
    #[default]
    Affine,
}

impl CalibrationModel {
    /// Fewest pairs that leave a residual to judge the fit by.
    #[must_use]
    pub fn least_pairs(self) -> usize {
        match self {
            Self::Similarity => 3,
            Self::Affine => 4,
        }
    }
}

/// How a calibration is fitted and when it is refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationOptions {
    /// Which distortions are allowed. Default affine.
    pub model: CalibrationModel,
    /// Largest residual that is accepted, RMS in µm, above 0. Every mark of a job may be off by as
    /// much. Default 0.3, the accuracy that marks are found with.
    pub max_residual_um: f64,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        Self { model: CalibrationModel::default(), max_residual_um: 0.3 }
    }
}

/// A test pulse: where the stage was, and where its mark is in the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationPair {
    /// Position of the stage, µm.
    pub stage_um: Point,
    /// Centre of the mark, frame px.
    pub frame_px: Point,
}

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// Not enough pairs.
    #[error("{pairs} test pulses were found, but a calibration needs {least}: fire more of them")]
    TooFewPairs {
        /// Pairs there are.
        pairs: usize,
        /// Fewest that are accepted.
        least: usize,
    },
    /// All test pulses lie on a line.
    #[error(
        "the test pulses lie within {spread_um} µm of a line: spread them over the whole pattern"
    )]
    Collinear {
        /// How far they are from a line, RMS in µm.
        spread_um: f64,
    },
    /// A number that is not finite.
    #[error("pair {index} of the calibration is not finite: leave it out")]
    NotFinite {
        /// Index of the pair.
        index: usize,
    },
    /// The fit is too bad to work with.
    #[error(
        "the calibration is off by {residual_um} µm RMS, but {max_residual_um} µm is allowed: \
         check that the stage repeats and the camera is fixed, and calibrate again"
    )]
    Residual {
        /// Residual of the fit, RMS in µm.
        residual_um: f64,
        /// Largest residual that is accepted, µm.
        max_residual_um: f64,
    },
    /// A calibration from a file that is none.
    #[error("this is no calibration ({reason}): calibrate again")]
    Invalid {
        /// What does not fit.
        reason: String,
    },
    /// An option outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the option.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A device failed during calibration.
    #[error("the {device} failed during calibration: {message}")]
    Device {
        /// Stage, laser or camera.
        device: &'static str,
        /// What it said.
        message: String,
    },
    /// The frames of the calibration cannot be used.
    #[error("the frames of the calibration cannot be used: {0}")]
    Frames(#[from] crate::ObserverError),
}

/// The linear map from the pattern to the frames that are taken from the imaging position.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SavedCalibration", into = "SavedCalibration")]
pub struct CameraCalibration {
    width_px: usize,
    height_px: usize,
    frame_from_pattern: [[f64; 3]; 2],
    pattern_from_frame: [[f64; 3]; 2],
    residual_um: f64,
    pairs: usize,
}

/// A calibration as it is saved.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedCalibration {
    frame_width_px: usize,
    frame_height_px: usize,
    /// Rows x and y of the frame; columns x, y of the pattern and 1.
    frame_from_pattern: [[f64; 3]; 2],
    residual_um: f64,
    pairs: usize,
}

impl From<CameraCalibration> for SavedCalibration {
    fn from(calibration: CameraCalibration) -> Self {
        Self {
            frame_width_px: calibration.width_px,
            frame_height_px: calibration.height_px,
            frame_from_pattern: calibration.frame_from_pattern,
            residual_um: calibration.residual_um,
            pairs: calibration.pairs,
        }
    }
}

impl TryFrom<SavedCalibration> for CameraCalibration {
    type Error = CalibrationError;

    fn try_from(saved: SavedCalibration) -> Result<Self, CalibrationError> {
        let SavedCalibration { frame_width_px, frame_height_px, frame_from_pattern, .. } = saved;
        Self::from_map(
            frame_width_px,
            frame_height_px,
            frame_from_pattern,
            saved.residual_um,
            saved.pairs,
        )
    }
}

impl CameraCalibration {
    /// Fits the map to test pulses whose marks were found in frames of `width_px` × `height_px`.
    ///
    /// # Errors
    /// Any [`CalibrationError`] but those about devices and frames.
    pub fn fit(
        pairs: &[CalibrationPair],
        width_px: usize,
        height_px: usize,
        options: CalibrationOptions,
    ) -> Result<Self, CalibrationError> {
        let CalibrationOptions { model, max_residual_um } = options;
        if max_residual_um.is_nan() || max_residual_um <= 0.0 {
            return Err(CalibrationError::InvalidOption {
                name: "max_residual_um",
                value: max_residual_um,
                expected: "above 0",
            });
        }
        let finite = |point: Point| point.x.is_finite() && point.y.is_finite();
        let broken = |pair: &CalibrationPair| !(finite(pair.stage_um) && finite(pair.frame_px));
        if let Some(index) = pairs.iter().position(broken) {
            return Err(CalibrationError::NotFinite { index });
        }
        if pairs.len() < model.least_pairs() {
            let least = model.least_pairs();
            return Err(CalibrationError::TooFewPairs { pairs: pairs.len(), least });
        }
        let spread_um = spread_across_line_um(pairs);
        if spread_um < LEAST_SPREAD_UM {
            return Err(CalibrationError::Collinear { spread_um });
        }
        let map = least_squares(pairs, model).ok_or(CalibrationError::Collinear { spread_um })?;
        let mut calibration = Self::from_map(width_px, height_px, map, 0.0, pairs.len())?;
        let squares: f64 = pairs
            .iter()
            .map(|pair| calibration.pattern_px(pair.frame_px).distance(pair.stage_um).powi(2))
            .sum();
        calibration.residual_um = (squares / pairs.len() as f64).sqrt();
        if calibration.residual_um > max_residual_um {
            let residual_um = calibration.residual_um;
            return Err(CalibrationError::Residual { residual_um, max_residual_um });
        }
        Ok(calibration)
    }

    /// A rough map for looking for the first marks: `scale_frame_px_per_um` all about
    /// `center_px` of the pattern in the middle of the frame.
    ///
    /// # Errors
    /// [`CalibrationError::Invalid`] for a scale that is not above 0.
    pub fn rough(
        width_px: usize,
        height_px: usize,
        scale_frame_px_per_um: f64,
        center_px: Point,
    ) -> Result<Self, CalibrationError> {
        let scale = scale_frame_px_per_um;
        let origin = [
            0.5 * width_px as f64 - scale * center_px.x,
            0.5 * height_px as f64 - scale * center_px.y,
        ];
        let map = [[scale, 0.0, origin[0]], [0.0, scale, origin[1]]];
        Self::from_map(width_px, height_px, map, 0.0, 0)
    }

    /// A map that is known and can be inverted.
    pub(crate) fn exact(width_px: usize, height_px: usize, map: [[f64; 3]; 2]) -> Self {
        let pattern_from_frame = inverse(map);
        Self {
            width_px,
            height_px,
            frame_from_pattern: map,
            pattern_from_frame,
            residual_um: 0.0,
            pairs: 0,
        }
    }

    fn from_map(
        width_px: usize,
        height_px: usize,
        map: [[f64; 3]; 2],
        residual_um: f64,
        pairs: usize,
    ) -> Result<Self, CalibrationError> {
        let refuse = |reason: &str| Err(CalibrationError::Invalid { reason: reason.to_owned() });
        if !(1..=MAX_SIDE_PX).contains(&width_px) || !(1..=MAX_SIDE_PX).contains(&height_px) {
            return refuse("the sides of the frame are out of range");
        }
        if !(residual_um >= 0.0 && residual_um.is_finite()) {
            return refuse("the residual is not a length");
        }
        let calibration = Self { residual_um, pairs, ..Self::exact(width_px, height_px, map) };
        let numbers = map.iter().chain(&calibration.pattern_from_frame).flatten();
        if !numbers.into_iter().all(|value| value.is_finite()) {
            return refuse("the map is not finite or cannot be inverted");
        }
        if !SCALES.contains(&calibration.scale_frame_px_per_um()) {
            return refuse("the scale is out of range");
        }
        Ok(calibration)
    }

    /// Columns of the frames, px.
    #[must_use]
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Rows of the frames, px.
    #[must_use]
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// How far the test pulses are from the map, RMS in µm.
    #[must_use]
    pub fn residual_um(&self) -> f64 {
        self.residual_um
    }

    /// Test pulses that it was fitted to.
    #[must_use]
    pub fn pairs(&self) -> usize {
        self.pairs
    }

    /// Where frames show the point `pattern_px` of the pattern, frame px.
    #[must_use]
    pub fn frame_px(&self, pattern_px: Point) -> Point {
        apply(&self.frame_from_pattern, pattern_px)
    }

    /// Which point of the pattern frames show at `frame_px`, px of the pattern.
    #[must_use]
    pub fn pattern_px(&self, frame_px: Point) -> Point {
        apply(&self.pattern_from_frame, frame_px)
    }

    /// A displacement in the frame as one on the pattern, px.
    #[must_use]
    pub fn pattern_vector(&self, frame_vector: Point) -> Point {
        self.pattern_px(frame_vector) - self.pattern_px(Point::default())
    }

    /// Rows x and y of the frame; columns x, y of the pattern and 1.
    #[must_use]
    pub fn frame_from_pattern(&self) -> &[[f64; 3]; 2] {
        &self.frame_from_pattern
    }

    /// Frame px per µm: the square root of how much larger areas are in the frame.
    #[must_use]
    pub fn scale_frame_px_per_um(&self) -> f64 {
        let [[a, b, _], [c, d, _]] = self.frame_from_pattern;
        (a * d - b * c).abs().sqrt()
    }
}

/// Largest width and height of a frame, px.
const MAX_SIDE_PX: usize = 8192;

/// Scales that are accepted, frame px per µm.
const SCALES: std::ops::RangeInclusive<f64> = 0.5..=64.0;

/// Test pulses nearer to a line say too little about the direction across it, µm.
const LEAST_SPREAD_UM: f64 = 2.0;

fn apply(map: &[[f64; 3]; 2], point: Point) -> Point {
    let [x, y] = map.map(|[a, b, c]| a * point.x + b * point.y + c);
    Point::new(x, y)
}

fn inverse([[a, b, e], [c, d, f]]: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
    let determinant = a * d - b * c;
    [
        [d / determinant, -b / determinant, (b * f - d * e) / determinant],
        [-c / determinant, a / determinant, (c * e - a * f) / determinant],
    ]
}

/// How far the stage positions are from the straight line nearest to them, RMS in µm.
fn spread_across_line_um(pairs: &[CalibrationPair]) -> f64 {
    let count = pairs.len() as f64;
    let mean = pairs.iter().fold(Point::default(), |sum, pair| sum + pair.stage_um) * count.recip();
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for pair in pairs {
        let arm = pair.stage_um - mean;
        xx += arm.x * arm.x / count;
        xy += arm.x * arm.y / count;
        yy += arm.y * arm.y / count;
    }
    let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
    least.max(0.0).sqrt()
}

/// The map nearest to the pairs in the frame.
fn least_squares(pairs: &[CalibrationPair], model: CalibrationModel) -> Option<[[f64; 3]; 2]> {
    let right = DVector::from_iterator(
        2 * pairs.len(),
        pairs.iter().flat_map(|pair| [pair.frame_px.x, pair.frame_px.y]),
    );
    let columns = match model {
        CalibrationModel::Similarity => 4,
        CalibrationModel::Affine => 6,
    };
    let rows = pairs.iter().flat_map(|pair| {
        let Point { x, y } = pair.stage_um;
        match model {
            CalibrationModel::Similarity => [vec![x, -y, 1.0, 0.0], vec![y, x, 0.0, 1.0]],
            CalibrationModel::Affine => {
                [vec![x, y, 1.0, 0.0, 0.0, 0.0], vec![0.0, 0.0, 0.0, x, y, 1.0]]
            }
        }
    });
    let left = DMatrix::from_row_iterator(2 * pairs.len(), columns, rows.flatten());
    let found = left.svd(true, true).solve(&right, 1e-12).ok()?;
    Some(match model {
        CalibrationModel::Similarity => {
            [[found[0], -found[1], found[2]], [found[1], found[0], found[3]]]
        }
        CalibrationModel::Affine => {
            [[found[0], found[1], found[2]], [found[3], found[4], found[5]]]
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pairs(map: &CameraCalibration, positions: &[Point]) -> Vec<CalibrationPair> {
        positions
            .iter()
            .map(|&stage_um| CalibrationPair { stage_um, frame_px: map.frame_px(stage_um) })
            .collect()
    }

    fn grid() -> Vec<Point> {
        (0..16).map(|k| Point::new(f64::from(k % 4) * 30.0, f64::from(k / 4) * 30.0)).collect()
    }

    fn fit(pairs: &[CalibrationPair]) -> Result<CameraCalibration, CalibrationError> {
        CameraCalibration::fit(pairs, 640, 480, CalibrationOptions::default())
    }

    proptest! {
        /// A fit to exact pairs is the map they come from, forth and back and through JSON.
        #[test]
        fn exact_pairs_give_their_map(
            scale in 1.0..10.0_f64,
            angle_rad in -3.0..3.0_f64,
            shear in -0.2..0.2_f64,
            (x, y) in (-300.0..300.0, -300.0..300.0),
        ) {
            let (sin, cos) = f64::sin_cos(angle_rad);
            let rows = [[scale * cos, -scale * sin + shear, x], [scale * sin, scale * cos, y]];
            let map = CameraCalibration::exact(640, 480, rows);
            let found = fit(&pairs(&map, &grid())).unwrap();
            prop_assert!(found.residual_um() < 1e-9);
            let json = serde_json::to_string(&found).unwrap();
            let read: CameraCalibration = serde_json::from_str(&json).unwrap();
            prop_assert_eq!(&read, &found);
            for point in grid() {
                prop_assert!(found.frame_px(point).distance(map.frame_px(point)) < 1e-8);
                prop_assert!(read.pattern_px(read.frame_px(point)).distance(point) < 1e-9);
            }
        }
    }

    #[test]
    fn a_similarity_has_square_axes() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.3, 10.0], [0.0, 4.0, 20.0]]);
        let options =
            CalibrationOptions { model: CalibrationModel::Similarity, max_residual_um: 10.0 };
        let found = CameraCalibration::fit(&pairs(&map, &grid()), 640, 480, options).unwrap();
        let [[a, b, _], [c, d, _]] = *found.frame_from_pattern();
        assert!((a - d).abs() < 1e-9 && (b + c).abs() < 1e-9);
        assert!(found.residual_um() > 0.5);
    }

    #[test]
    fn too_few_pairs_are_refused() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
        let error = fit(&pairs(&map, &grid()[..3])).unwrap_err();
        assert_eq!(error, CalibrationError::TooFewPairs { pairs: 3, least: 4 });
    }

    #[test]
    fn pairs_on_a_line_are_refused() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
        let line: Vec<Point> =
            (0..9).map(|k| Point::new(f64::from(k) * 10.0, f64::from(k) * 5.0)).collect();
        assert!(matches!(fit(&pairs(&map, &line)), Err(CalibrationError::Collinear { .. })));
    }

    #[test]
    fn a_pair_that_is_not_finite_is_named() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
        let mut pairs = pairs(&map, &grid());
        pairs[5].frame_px.x = f64::NAN;
        assert_eq!(fit(&pairs), Err(CalibrationError::NotFinite { index: 5 }));
    }

    #[test]
    fn a_mark_that_does_not_fit_is_refused_with_the_residual() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
        let mut pairs = pairs(&map, &grid());
        pairs[5].frame_px.x += 20.0;
        match fit(&pairs) {
            Err(CalibrationError::Residual { residual_um, .. }) => {
                assert!((0.8..1.25).contains(&residual_um), "{residual_um}");
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_limit_that_is_no_length_is_refused() {
        for max_residual_um in [0.0, -1.0, f64::NAN] {
            let options = CalibrationOptions { max_residual_um, ..CalibrationOptions::default() };
            let error = CameraCalibration::fit(&[], 640, 480, options).unwrap_err();
            assert!(matches!(error, CalibrationError::InvalidOption { .. }));
        }
    }

    #[test]
    fn files_that_are_no_calibration_are_refused() {
        let map = CameraCalibration::exact(640, 480, [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
        let json = serde_json::to_string(&map).unwrap();
        for (from, to) in [
            ("640", "0"),
            ("[[4.0", "[[0.0"),
            ("\"residual_um\":0.0", "\"residual_um\":-1.0"),
            ("frame_width_px", "width"),
        ] {
            let broken = json.replacen(from, to, 1);
            assert_ne!(broken, json);
            assert!(serde_json::from_str::<CameraCalibration>(&broken).is_err(), "{broken}");
        }
    }
}
