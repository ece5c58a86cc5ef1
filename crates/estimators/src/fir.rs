//! Finite impulse responses, as the filter designs give them and as a filter bank runs them.

use problem::{Allowed, Problem};

const MAX_WINDOW: usize = 1 << 16;
pub(crate) const MAX_DERIVATIVE: usize = 2;

/// Weights of the samples, oldest first.
pub(crate) struct Kernels {
    /// Of the value and of each derivative asked for, per s^d.
    pub(crate) taps: Vec<Vec<f64>>,
    /// Of a polynomial fit, read one sample ahead of the newest.
    pub(crate) ahead: Vec<f64>,
    pub(crate) delay_s: f64,
}

/// Refuses a window or a number of derivatives that no filter has.
pub(crate) fn check_shape(window: usize, least: usize, derivatives: usize) -> Result<(), Problem> {
    if !(least..=MAX_WINDOW).contains(&window) {
        let allowed = format!("{least} to {MAX_WINDOW}");
        return Err(Problem::new(format!("window {window}"), allowed));
    }
    if derivatives > MAX_DERIVATIVE {
        let reason = format!("derivative {derivatives}");
        return Err(Problem::new(reason, "0, 1 or 2"));
    }
    Ok(())
}

/// Refuses a time between samples that is not above zero.
pub(crate) fn check_period(sample_period: f64) -> Result<(), Problem> {
    if Allowed::Positive.admits(sample_period) {
        Ok(())
    } else {
        Err(Problem::new(
            format!("sample period {sample_period} s"),
            Allowed::Positive.to_string(),
        ))
    }
}
