//! Footprint and law from measured trenches.

use nalgebra::{DMatrix, DVector};

use crate::trench::{Trench, trench_depths_um};
use crate::{Footprint, MillingError, Process, RemovalLaw};

/// Most iterations of the fit.
const MAX_ITERATIONS: usize = 60;

/// Relative step of the numerical derivatives.
const STEP: f64 = 1e-4;

/// Half-width of a 95 % interval in standard deviations.
const NORMAL_95: f64 = 1.959_964;

/// A parameter and how well the trenches determine it.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Its name, unit included, as in profiles.
    pub name: &'static str,
    /// The value that fits best.
    pub value: f64,
    /// Half-width of its 95 % confidence interval, from the scatter of the residuals.
    pub confidence_95: f64,
}

/// A process fitted to trenches.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The process.
    pub process: Process,
    /// Its parameters.
    pub parameters: Vec<FittedParameter>,
    /// Root mean square distance between measured and modelled depths, µm.
    pub rms_um: f64,
}

/// Fits peak, radius and law of `start` to trenches of straight passes on flat ground, by
/// Levenberg–Marquardt on all measured depths. Each trench is centred on the centroid of its depths.
///
/// Of the feed-speed law only the exponent is fitted, since its factor and the peak do the same.
///
/// # Errors
/// [`MillingError::Calibration`] where the trenches cannot determine the parameters: too few depths,
/// one speed only, or a table as footprint (use [`crate::abel_inversion`] for that).
pub fn calibrate(start: &Process, trenches: &[Trench]) -> Result<Calibration, MillingError> {
    start.law.validate()?;
    let mut model = Model::new(start)?;
    let count: usize = trenches.iter().map(|trench| trench.y_um.len()).sum();
    let needed = model.names.len() + 1;
    if count < needed {
        return fault(format!("{count} depths for {} parameters", model.names.len()));
    }
    let mut speeds: Vec<f64> = trenches.iter().map(|trench| trench.speed_mm_s).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.dedup();
    if !matches!(start.law, RemovalLaw::Linear) && speeds.len() < 2 {
        return fault("all trenches have the same speed: the law needs two or more".to_owned());
    }
    let centred: Vec<Trench> = trenches.iter().map(Trench::centred).collect();
    model.match_size(&centred)?;

    let measured = DVector::from_iterator(
        count,
        centred.iter().flat_map(|trench| trench.depth_um.iter().copied()),
    );
    let mut residual = &measured - model.depths(&model.values, &centred)?;
    let mut damping = 1e-3;
    let mut jacobian = model.jacobian(&centred)?;
    for _ in 0..MAX_ITERATIONS {
        let normal = jacobian.transpose() * &jacobian;
        let slope = jacobian.transpose() * &residual;
        let mut damped = normal.clone();
        for k in 0..damped.nrows() {
            damped[(k, k)] += damping * normal[(k, k)].max(f64::MIN_POSITIVE);
        }
        let Some(step) = damped.lu().solve(&slope) else {
            return fault("the parameters cannot be told apart".to_owned());
        };
        let trial = model.limited(&(&model.values + &step));
        let next = &measured - model.depths(&trial, &centred)?;
        if next.norm_squared() < residual.norm_squared() {
            let fall = 1.0 - next.norm_squared() / residual.norm_squared();
            (model.values, residual) = (trial, next);
            damping = (damping * 0.2).max(1e-12);
            if fall < 1e-10 {
                break;
            }
            jacobian = model.jacobian(&centred)?;
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    let jacobian = model.jacobian(&centred)?;
    let Some(inverse) = (jacobian.transpose() * &jacobian).try_inverse() else {
        return fault("the parameters cannot be told apart".to_owned());
    };
    let variance = residual.norm_squared() / (count - model.names.len()) as f64;
    let process = model.process(&model.values)?;
    let parameters = (0..model.names.len())
        .map(|k| {
            let deviation = (variance * inverse[(k, k)]).max(0.0).sqrt();
            let (value, per_unit) = model.value(k);
            FittedParameter {
                name: model.names[k],
                value,
                confidence_95: NORMAL_95 * deviation * per_unit,
            }
        })
        .collect();
    let rms_um = (residual.norm_squared() / count as f64).sqrt();
    Ok(Calibration { process, parameters, rms_um })
}

fn fault<T>(reason: String) -> Result<T, MillingError> {
    Err(MillingError::Calibration { reason })
}

/// The process as a function of its free parameters: logarithms of peak and radius, then those of
/// the law.
struct Model {
    start: Process,
    names: Vec<&'static str>,
    values: DVector<f64>,
}

impl Model {
    fn new(start: &Process) -> Result<Self, MillingError> {
        let (peak, radius) = match start.footprint {
            Footprint::Gaussian(g) => (g.peak_um_s, g.radius_um),
            Footprint::Compact(c) => (c.peak_um_s, c.radius_um),
            Footprint::Table(_) => {
                return fault("a table has no parameters: start from another footprint".to_owned());
            }
        };
        let mut names = vec!["peak_um_s", "radius_um"];
        let mut values = vec![peak.ln(), radius.ln()];
        match start.law {
            RemovalLaw::Linear => {}
            RemovalLaw::Slope(law) => {
                names.extend(["first_per_rad", "second_per_rad2"]);
                values.extend([law.first_per_rad, law.second_per_rad2]);
            }
            RemovalLaw::FeedSpeed(law) => {
                names.push("exponent");
                values.push(law.exponent);
            }
        }
        Ok(Self { start: start.clone(), names, values: DVector::from_vec(values) })
    }

    fn process(&self, values: &DVector<f64>) -> Result<Process, MillingError> {
        let (peak, radius) = (values[0].exp(), values[1].exp());
        let footprint = match self.start.footprint {
            Footprint::Gaussian(_) => Footprint::gaussian(peak, radius)?,
            Footprint::Compact(_) | Footprint::Table(_) => Footprint::compact(peak, radius)?,
        };
        let law = match self.start.law {
            RemovalLaw::Linear => RemovalLaw::Linear,
            RemovalLaw::Slope(mut law) => {
                (law.first_per_rad, law.second_per_rad2) = (values[2], values[3]);
                RemovalLaw::Slope(law)
            }
            RemovalLaw::FeedSpeed(mut law) => {
                law.exponent = values[2];
                RemovalLaw::FeedSpeed(law)
            }
        };
        Ok(Process { footprint, law })
    }

    /// Values within what the laws accept.
    fn limited(&self, values: &DVector<f64>) -> DVector<f64> {
        let mut values = values.clone();
        for k in 0..2 {
            values[k] =
                values[k].clamp(self.values[k] - 1.0, self.values[k] + 1.0).clamp(-18.0, 18.0);
        }
        let (low, high) = match self.start.law {
            RemovalLaw::FeedSpeed(_) => (-1.9, 0.94),
            RemovalLaw::Slope(_) | RemovalLaw::Linear => (0.0, 9.9),
        };
        values.iter_mut().skip(2).for_each(|value| *value = value.clamp(low, high));
        values
    }

    /// The parameter `k` in its own unit, and its change for a unit of the free parameter.
    fn value(&self, k: usize) -> (f64, f64) {
        if k < 2 { (self.values[k].exp(), self.values[k].exp()) } else { (self.values[k], 1.0) }
    }

    /// Scales peak and radius so that area and width of the modelled trenches are about those measured.
    fn match_size(&mut self, trenches: &[Trench]) -> Result<(), MillingError> {
        let measured = sizes(trenches.iter().map(|t| (&t.y_um[..], &t.depth_um[..])));
        let process = self.process(&self.values)?;
        let modelled: Vec<Vec<f64>> = trenches
            .iter()
            .map(|trench| trench_depths_um(&process, trench.speed_mm_s, &trench.y_um))
            .collect::<Result<_, _>>()?;
        let modelled =
            sizes(trenches.iter().zip(&modelled).map(|(t, depths)| (&t.y_um[..], &depths[..])));
        let usable = |ratio: f64| if ratio.is_finite() { ratio.clamp(0.1, 10.0) } else { 1.0 };
        let radius = usable(measured.1 / modelled.1);
        let area = usable(measured.0 / modelled.0);
        self.values[1] += radius.ln();
        self.values[0] += area.ln() - 2.0 * radius.ln();
        Ok(())
    }

    fn depths(
        &self,
        values: &DVector<f64>,
        trenches: &[Trench],
    ) -> Result<DVector<f64>, MillingError> {
        let process = self.process(values)?;
        let mut all = Vec::new();
        for trench in trenches {
            all.extend(trench_depths_um(&process, trench.speed_mm_s, &trench.y_um)?);
        }
        Ok(DVector::from_vec(all))
    }

    /// Derivatives of all depths by differences.
    fn jacobian(&self, trenches: &[Trench]) -> Result<DMatrix<f64>, MillingError> {
        let mut columns = Vec::new();
        for k in 0..self.values.len() {
            let (mut above, mut below) = (self.values.clone(), self.values.clone());
            above[k] += STEP;
            // Coefficients of the slope law must not be negative.
            below[k] = if k < 2 { below[k] - STEP } else { self.limited(&below)[k] };
            let change = above[k] - below[k];
            columns
                .push((self.depths(&above, trenches)? - self.depths(&below, trenches)?) / change);
        }
        Ok(DMatrix::from_columns(&columns))
    }
}

/// Mean area and width of trenches: Σ d and √(Σ d y²/Σ d).
fn sizes<'a>(trenches: impl Iterator<Item = (&'a [f64], &'a [f64])>) -> (f64, f64) {
    let (mut area, mut spread) = (0.0, 0.0);
    for (y_um, depth_um) in trenches {
        for (y, depth) in y_um.iter().zip(depth_um) {
            area += depth;
            spread += depth * y * y;
        }
    }
    (area, (spread / area).sqrt())
}
