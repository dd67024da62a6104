//! Minimisation within bounds: limited-memory BFGS, projected.
//!
//! Components that rest on a bound and would leave it are held; the two-loop recursion works on the
//! others, and the line search follows the path bent by the bounds (Bertsekas 1982, "Projected
//! Newton methods for optimization problems with simple constraints"; Nocedal and Wright, chapter 7).

use std::collections::VecDeque;
use std::ops::ControlFlow;

use crate::MillingError;

/// Pairs of steps and gradient changes that are remembered.
const MEMORY: usize = 12;

/// Fall that is demanded of a step, as a part of what the gradient promises.
const ARMIJO: f64 = 1e-4;

/// Tries of a line search.
const MAX_TRIES: usize = 12;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StopRule {
    /// Most iterations.
    pub(crate) iterations: usize,
    /// Stop when the objective has fallen by less than this part in each of five iterations.
    pub(crate) least_fall: f64,
}

/// The objective and its gradient at a point.
pub(crate) trait Smooth {
    /// Returns the objective at `x` and writes its gradient.
    fn value(&mut self, x: &[f64], gradient: &mut [f64]) -> Result<f64, MillingError>;
}

/// Lowers the objective from `x` within [lower, upper], in place; after each iteration `progress` is
/// told the number of iterations and the objective, and may stop it. The objective never rises.
pub(crate) fn minimise(
    smooth: &mut impl Smooth,
    x: &mut Vec<f64>,
    lower: &[f64],
    upper: &[f64],
    rule: StopRule,
    progress: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> Result<ControlFlow<()>, MillingError> {
    for ((x, low), high) in x.iter_mut().zip(lower).zip(upper) {
        *x = x.clamp(*low, *high);
    }
    let count = x.len();
    let mut gradient = vec![0.0; count];
    let mut value = smooth.value(x, &mut gradient)?;
    let mut pairs: VecDeque<Pair> = VecDeque::new();
    let (mut trial, mut next_gradient) = (x.clone(), gradient.clone());
    let mut slow = 0;
    let mut iteration = 0;
    while iteration < rule.iterations {
        let held: Vec<bool> = (0..count)
            .map(|k| {
                (x[k] <= lower[k] && gradient[k] > 0.0) || (x[k] >= upper[k] && gradient[k] < 0.0)
            })
            .collect();
        let mut direction = search_direction(&gradient, &held, &pairs);
        if dot(&direction, &gradient) >= 0.0 {
            pairs.clear();
            direction = search_direction(&gradient, &held, &pairs);
        }
        if dot(&direction, &gradient) >= 0.0 {
            break;
        }
        // Without memory the length of the direction means nothing: first move by a hundredth.
        let mut length = if pairs.is_empty() { 0.01 / largest(&direction) } else { 1.0 };
        let mut accepted = None;
        for _ in 0..MAX_TRIES {
            for k in 0..count {
                trial[k] = (x[k] + length * direction[k]).clamp(lower[k], upper[k]);
            }
            let next = smooth.value(&trial, &mut next_gradient)?;
            let promised: f64 = (0..count).map(|k| gradient[k] * (trial[k] - x[k])).sum();
            if next.is_finite() && next <= value + ARMIJO * promised && promised < 0.0 {
                accepted = Some(next);
                break;
            }
            // The minimum of the parabola through what is known, within a tenth and a half.
            let bend = next - value - promised;
            let best = if bend > 0.0 { -promised / (2.0 * bend) } else { 0.5 };
            length *= best.clamp(0.1, 0.5);
        }
        let Some(next) = accepted else {
            if pairs.is_empty() {
                break;
            }
            pairs.clear();
            continue;
        };
        let pair = Pair::new(&trial, x, &next_gradient, &gradient);
        if pair.curvature > 1e-12 * dot(&pair.change, &pair.change) {
            pairs.push_back(pair);
            if pairs.len() > MEMORY {
                pairs.pop_front();
            }
        }
        slow = if next > value * (1.0 - rule.least_fall) { slow + 1 } else { 0 };
        value = next;
        std::mem::swap(x, &mut trial);
        std::mem::swap(&mut gradient, &mut next_gradient);
        iteration += 1;
        if progress(iteration, value).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        if slow >= 5 || value <= 0.0 {
            break;
        }
    }
    Ok(ControlFlow::Continue(()))
}

/// A step, the change of the gradient along it, and their product.
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
    curvature: f64,
}

impl Pair {
    fn new(x: &[f64], old_x: &[f64], gradient: &[f64], old_gradient: &[f64]) -> Self {
        let difference =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>();
        let (step, change) = (difference(x, old_x), difference(gradient, old_gradient));
        let curvature = dot(&step, &change);
        Self { step, change, curvature }
    }
}

/// −H g over the components that are free, 0 elsewhere.
fn search_direction(gradient: &[f64], held: &[bool], pairs: &VecDeque<Pair>) -> Vec<f64> {
    let free = |values: &mut [f64]| {
        values.iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(value, _)| *value = 0.0);
    };
    let mut direction: Vec<f64> = gradient.iter().map(|value| -value).collect();
    free(&mut direction);
    let mut weights = Vec::with_capacity(pairs.len());
    for pair in pairs.iter().rev() {
        let weight = dot(&pair.step, &direction) / pair.curvature;
        add_scaled(&mut direction, -weight, &pair.change);
        weights.push(weight);
    }
    if let Some(pair) = pairs.back() {
        let scale = pair.curvature / dot(&pair.change, &pair.change);
        for value in &mut direction {
            *value *= scale;
        }
    }
    for (pair, weight) in pairs.iter().zip(weights.iter().rev()) {
        let back = dot(&pair.change, &direction) / pair.curvature;
        add_scaled(&mut direction, weight - back, &pair.step);
    }
    free(&mut direction);
    direction
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add_scaled(values: &mut [f64], scale: f64, other: &[f64]) {
    values.iter_mut().zip(other).for_each(|(value, other)| *value += scale * other);
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A weighted sum of squared distances from the centre, and of differences of neighbours.
    struct Bowl {
        scales: Vec<f64>,
        centre: Vec<f64>,
    }

    impl Smooth for Bowl {
        fn value(&mut self, x: &[f64], gradient: &mut [f64]) -> Result<f64, MillingError> {
            gradient.fill(0.0);
            let mut sum = 0.0;
            for k in 0..x.len() {
                let rest = x[k] - self.centre[k];
                sum += self.scales[k] * rest * rest;
                gradient[k] += 2.0 * self.scales[k] * rest;
                if k > 0 {
                    let bend = x[k] - x[k - 1];
                    sum += bend * bend;
                    gradient[k] += 2.0 * bend;
                    gradient[k - 1] -= 2.0 * bend;
                }
            }
            Ok(sum)
        }
    }

    proptest! {
        #[test]
        fn the_minimum_within_bounds_has_no_way_down(
            scales in prop::collection::vec(0.1..10.0_f64, 8),
            centre in prop::collection::vec(-2.0..2.0_f64, 8),
        ) {
            let mut bowl = Bowl { scales, centre };
            let mut x = vec![0.0; 8];
            let (lower, upper) = (vec![-1.0; 8], vec![0.5; 8]);
            let rule = StopRule { iterations: 500, least_fall: 0.0 };
            let mut last = f64::INFINITY;
            let mut fell = true;
            let flow = minimise(&mut bowl, &mut x, &lower, &upper, rule, &mut |_, value| {
                fell &= value <= last;
                last = value;
                ControlFlow::Continue(())
            });
            prop_assert!(flow.unwrap().is_continue());
            prop_assert!(fell);
            let mut gradient = vec![0.0; 8];
            bowl.value(&x, &mut gradient).unwrap();
            for k in 0..8 {
                prop_assert!((-1.0..=0.5).contains(&x[k]));
                let down = (x[k] - gradient[k]).clamp(-1.0, 0.5) - x[k];
                prop_assert!(down.abs() < 1e-4, "component {k}: {down}");
            }
        }
    }

    #[test]
    fn it_stops_when_told() {
        let mut bowl = Bowl { scales: vec![1.0, 7.0, 3.0], centre: vec![3.0, -1.0, 2.0] };
        let mut x = vec![0.0; 3];
        let rule = StopRule { iterations: 100, least_fall: 0.0 };
        let mut calls = 0;
        let flow = minimise(&mut bowl, &mut x, &[-9.0; 3], &[9.0; 3], rule, &mut |_, _| {
            calls += 1;
            if calls == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert_eq!((flow, calls), (Ok(ControlFlow::Break(())), 2));
    }
}
