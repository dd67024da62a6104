//! A scan head with its laser and controller, from a TOML file.

use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::axis::{AxisModel, Follower};
use crate::calibration::{Calibration, HeadCalibration, Regression};
use crate::correction::{SpeedCorrection, check_corrections};
use crate::delays::{Delays, SkyWriting};
use crate::field::Field;
use crate::laser::Laser;
use crate::limited_servo::LimitedServo;
use crate::program::check_speed;
use crate::servo::ServoPoles;
use crate::step_response::StepResponse;

/// The lag that the lines of Penchev et al. show: 431.9 µm at 2 m/s and 107.3 µm at 0.5 m/s, µs.
pub const PENCHEV_LAG_US: f64 = 216.4;

/// The heads that come with the crate: name and TOML text.
const SHIPPED: [(&str, &str); 5] = [
    ("bessel", include_str!("../heads/bessel.toml")),
    ("second-order", include_str!("../heads/second-order.toml")),
    ("dead-time", include_str!("../heads/dead-time.toml")),
    ("acceleration-time", include_str!("../heads/acceleration-time.toml")),
    ("acceleration-limit", include_str!("../heads/acceleration-limit.toml")),
];

const SHIPPED_NAMES: &str =
    "bessel, second-order, dead-time, acceleration-time, acceleration-limit";

/// What a controller does when a program says nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Controller {
    /// Speed of jumps, m/s, in [10⁻⁴, 100]. Default 5.
    pub jump_speed_m_s: f64,
    /// Delays. Default none.
    pub delays: Delays,
    /// Sky writing. Default off.
    pub sky_writing: Option<SkyWriting>,
}

impl Default for Controller {
    fn default() -> Self {
        Self { jump_speed_m_s: 5.0, delays: Delays::default(), sky_writing: None }
    }
}

/// A head: two axes, field, laser, controller, and what calibration and tuning found.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanHead {
    /// The axis that moves along x.
    pub x: AxisModel,
    /// The axis that moves along y.
    pub y: AxisModel,
    /// The field.
    pub field: Field,
    /// The laser.
    pub laser: Laser,
    /// What the controller does by itself.
    pub controller: Controller,
    /// Regressions of measured lines, if there are any.
    pub calibration: Option<HeadCalibration>,
    /// What tuning found, by increasing speed.
    pub corrections: Vec<SpeedCorrection>,
}

impl Default for ScanHead {
    /// The third-order Bessel head with the lag of Penchev et al.
    fn default() -> Self {
        Self::with_axis(AxisModel {
            follower: Follower::Servo(ServoPoles::bessel(PENCHEV_LAG_US)),
            dead_time_us: 0.0,
        })
    }
}

impl ScanHead {
    /// A head with two equal axes, and defaults for the rest.
    #[must_use]
    pub fn with_axis(axis: AxisModel) -> Self {
        Self {
            x: axis.clone(),
            y: axis,
            field: Field::default(),
            laser: Laser::default(),
            controller: Controller::default(),
            calibration: None,
            corrections: Vec::new(),
        }
    }

    /// Names and TOML texts of the heads that come with the crate.
    #[must_use]
    pub fn shipped_texts() -> &'static [(&'static str, &'static str)] {
        &SHIPPED
    }

    /// A head that comes with the crate. All have the lag of Penchev et al.
    ///
    /// # Errors
    /// [`GalvoError::UnknownName`] lists the names.
    pub fn shipped(name: &str) -> Result<Self, GalvoError> {
        let found = SHIPPED.iter().find(|(shipped, _)| *shipped == name);
        let Some((_, text)) = found else {
            return Err(GalvoError::UnknownName {
                name: "head",
                value: name.chars().take(60).collect(),
                accepted: SHIPPED_NAMES,
            });
        };
        Self::from_toml(text)
    }

    /// The head in a TOML text. Without `axis`, `x` and `y` the axes are Bessel servos with the lag
    /// of the calibration, or of Penchev et al.
    ///
    /// # Errors
    /// [`GalvoError::Settings`] for what is not understood, [`GalvoError::InvalidOption`] and
    /// [`GalvoError::StepResponse`] for values out of range.
    pub fn from_toml(text: &str) -> Result<Self, GalvoError> {
        let file: HeadFile = toml::from_str(text)
            .map_err(|error| GalvoError::Settings { what: "head", reason: error.to_string() })?;
        let calibration = file.calibration.map(CalibrationFile::calibration).transpose()?;
        let axis = |own: Option<AxisFile>, known: Option<&Calibration>| {
            if let Some(axis) = own.or_else(|| file.axis.clone()) {
                return axis.model();
            }
            let lag_us = known.map_or(PENCHEV_LAG_US, |known| known.lag.slope_us.clamp(1.0, 1e5));
            let follower = Follower::Servo(ServoPoles::bessel(lag_us));
            Ok(AxisModel { follower, dead_time_us: 0.0 })
        };
        let head = Self {
            x: axis(file.x, calibration.as_ref().map(|known| &known.x))?,
            y: axis(file.y, calibration.as_ref().map(|known| &known.y))?,
            field: file.field.unwrap_or_default().field(),
            laser: file.laser.unwrap_or_default(),
            controller: file.controller.unwrap_or_default(),
            calibration,
            corrections: file.correction,
        };
        head.validate()?;
        Ok(head)
    }

    /// Checks every part.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        self.x.validate()?;
        self.y.validate()?;
        self.field.validate()?;
        self.laser.validate()?;
        check_speed("jump_speed_m_s", self.controller.jump_speed_m_s)?;
        self.controller.delays.validate()?;
        if let Some(sky) = &self.controller.sky_writing {
            sky.validate()?;
        }
        check_corrections(&self.corrections)?;
        self.calibration.as_ref().map_or(Ok(()), HeadCalibration::validate)
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct HeadFile {
    axis: Option<AxisFile>,
    x: Option<AxisFile>,
    y: Option<AxisFile>,
    field: Option<FieldFile>,
    laser: Option<Laser>,
    controller: Option<Controller>,
    calibration: Option<CalibrationFile>,
    #[serde(default)]
    correction: Vec<SpeedCorrection>,
}

/// Regressions of both axes, or of each.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationFile {
    lag: Option<Regression>,
    acceleration: Option<Regression>,
    lead: Option<Regression>,
    x: Option<Calibration>,
    y: Option<Calibration>,
}

impl CalibrationFile {
    fn calibration(self) -> Result<HeadCalibration, GalvoError> {
        match self {
            Self { lag: Some(lag), acceleration: Some(acceleration), lead, x: None, y: None } => {
                let both = Calibration { lag, acceleration, lead };
                Ok(HeadCalibration { x: both.clone(), y: both })
            }
            Self { lag: None, acceleration: None, lead: None, x: Some(x), y: Some(y) } => {
                Ok(HeadCalibration { x, y })
            }
            _ => Err(GalvoError::Settings {
                what: "head",
                reason: "the section calibration needs lag and acceleration, or x and y with both \
                         each"
                    .to_owned(),
            }),
        }
    }
}

/// An axis as a file describes it.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum AxisFile {
    Bessel {
        lag_us: f64,
        #[serde(default)]
        dead_time_us: f64,
    },
    SecondOrder {
        lag_us: f64,
        damping: f64,
        #[serde(default)]
        dead_time_us: f64,
    },
    ThirdOrder {
        natural_rad_us: f64,
        damping: f64,
        real_rad_us: f64,
        #[serde(default)]
        dead_time_us: f64,
    },
    AccelerationTime {
        acceleration_time_us: f64,
        #[serde(default)]
        dead_time_us: f64,
    },
    AccelerationLimit {
        lag_us: f64,
        damping: f64,
        acceleration_limit_m_s2: f64,
        #[serde(default)]
        dead_time_us: f64,
    },
    StepResponse {
        samples: Vec<(f64, f64)>,
        #[serde(default)]
        dead_time_us: f64,
    },
}

impl AxisFile {
    fn model(self) -> Result<AxisModel, GalvoError> {
        let (follower, dead_time_us) = match self {
            Self::Bessel { lag_us, dead_time_us } => {
                (Follower::Servo(ServoPoles::bessel(lag_us)), dead_time_us)
            }
            Self::SecondOrder { lag_us, damping, dead_time_us } => {
                (Follower::Servo(ServoPoles::second_order(lag_us, damping)), dead_time_us)
            }
            Self::ThirdOrder { natural_rad_us, damping, real_rad_us, dead_time_us } => {
                let poles = ServoPoles { natural_rad_us, damping, real_rad_us: Some(real_rad_us) };
                (Follower::Servo(poles), dead_time_us)
            }
            Self::AccelerationTime { acceleration_time_us, dead_time_us } => {
                let response = StepResponse::constant_acceleration(acceleration_time_us)?;
                (Follower::Step(response), dead_time_us)
            }
            Self::AccelerationLimit { lag_us, damping, acceleration_limit_m_s2, dead_time_us } => {
                let servo = LimitedServo { lag_us, damping, acceleration_limit_m_s2 };
                (Follower::Limited(servo), dead_time_us)
            }
            Self::StepResponse { samples, dead_time_us } => {
                (Follower::Step(StepResponse::new(&samples)?), dead_time_us)
            }
        };
        Ok(AxisModel { follower, dead_time_us })
    }
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct FieldFile {
    size_mm: f64,
    pillow_x_per_mm2: f64,
    pillow_y_per_mm2: f64,
    barrel_per_mm2: f64,
}

impl Default for FieldFile {
    fn default() -> Self {
        let field = Field::default();
        Self {
            size_mm: field.size_mm,
            pillow_x_per_mm2: field.pillow_x_per_mm2,
            pillow_y_per_mm2: field.pillow_y_per_mm2,
            barrel_per_mm2: field.barrel_per_mm2,
        }
    }
}

impl FieldFile {
    fn field(self) -> Field {
        Field {
            size_mm: self.size_mm,
            pillow_x_per_mm2: self.pillow_x_per_mm2,
            pillow_y_per_mm2: self.pillow_y_per_mm2,
            barrel_per_mm2: self.barrel_per_mm2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_heads_have_the_lag_of_the_paper() {
        for (name, _) in ScanHead::shipped_texts() {
            let head = ScanHead::shipped(name).unwrap();
            assert!((head.x.lag_us() - PENCHEV_LAG_US).abs() < 0.1, "{name}: {}", head.x.lag_us());
        }
        assert_eq!(ScanHead::shipped("bessel").unwrap(), ScanHead::default());
        assert!(matches!(ScanHead::shipped("axe"), Err(GalvoError::UnknownName { .. })));
    }

    #[test]
    fn an_empty_file_is_the_default_head() {
        assert_eq!(ScanHead::from_toml("").unwrap(), ScanHead::default());
    }

    #[test]
    fn axes_may_differ() {
        let text = "[axis]\nkind = \"bessel\"\nlag_us = 200\n[y]\nkind = \"step-response\"\n\
                    samples = [[0, 0], [100, 1]]\ndead_time_us = 5\n";
        let head = ScanHead::from_toml(text).unwrap();
        assert!((head.x.lag_us() - 200.0).abs() < 1e-9 && (head.y.lag_us() - 55.0).abs() < 1e-9);
    }

    #[test]
    fn mistakes_are_named() {
        for (text, word) in [
            ("[axis]\nkind = \"axe\"\n", "axe"),
            ("[axis]\nkind = \"bessel\"\nlag = 200\n", "lag"),
            ("[axis]\nkind = \"bessel\"\nlag_us = -200\n", "natural_rad_us"),
            (
                "[axis]\nkind = \"acceleration-limit\"\nlag_us = 200\ndamping = 0.9\n\
                 acceleration_limit_m_s2 = 0\n",
                "acceleration_limit_m_s2",
            ),
            ("[laser]\nspot_um = -1\n", "spot_um"),
            ("[controller]\njump_speed_m_s = 0\n", "jump_speed_m_s"),
            ("[controller.delays]\nmark_us = -1\n", "mark_us"),
            ("[field]\nsize_mm = 0\n", "size_mm"),
            ("[laser", "line 1"),
        ] {
            let message = ScanHead::from_toml(text).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
