//! Order statistics of samples.

/// The value below which a share of the samples lies; 0 without samples.
pub(crate) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let place = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Absolute steps from each value to the next.
pub(crate) fn steps(x: &[f64]) -> Vec<f64> {
    x.windows(2).map(|w| (w[1] - w[0]).abs()).collect()
}

/// Range that holds all but a hundredth of the values at either end.
pub(crate) fn span(x: &[f64]) -> f64 {
    quantile(x.to_vec(), 0.99) - quantile(x.to_vec(), 0.01)
}
