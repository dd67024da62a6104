//! From the output of a network to an action.

use crate::PolicyError;
use crate::manifest::ActionMapping;

/// Name of the actions in error messages.
const OWNER: &str = "actions";

/// Checks that the ranges of a mapping fit a network of `outputs` outputs.
pub(crate) fn check(mapping: &ActionMapping, outputs: usize) -> Result<(), PolicyError> {
    let (ActionMapping::Clip { low, high } | ActionMapping::Squash { low, high }) = mapping else {
        return Ok(());
    };
    let error = |name, value: String, expected: String| PolicyError::InvalidSetting {
        owner: OWNER.to_owned(),
        name,
        value,
        expected,
    };
    for (name, range) in [("low", low), ("high", high)] {
        if range.len() != outputs {
            let value = format!("a list of {} numbers", range.len());
            return Err(error(name, value, format!("a list of {outputs}, one an output")));
        }
    }
    for (low, high) in low.iter().zip(high) {
        if !(low.is_finite() && high.is_finite() && low <= high) {
            let value = low.to_string();
            return Err(error("low", value, format!("finite and at most high, {high}")));
        }
    }
    Ok(())
}

/// Turns outputs into actions in place.
pub(crate) fn apply(mapping: &ActionMapping, outputs: &mut [f32]) {
    match mapping {
        ActionMapping::Identity => {}
        ActionMapping::Clip { low, high } => {
            for ((value, &low), &high) in outputs.iter_mut().zip(low).zip(high) {
                *value = value.clamp(low, high);
            }
        }
        ActionMapping::Squash { low, high } => {
            for ((value, &low), &high) in outputs.iter_mut().zip(low).zip(high) {
                *value = low + 0.5 * (value.tanh() + 1.0) * (high - low);
            }
        }
    }
}
