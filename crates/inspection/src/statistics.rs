//! Order statistics of samples, and lines across missing ones.

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

/// Straight lines across rows without a measurement.
pub(crate) fn fill(values: &mut [f64], lost: &[usize]) {
    let mut k = 0;
    while k < lost.len() {
        let start = lost[k];
        let mut end = start + 1;
        while k + 1 < lost.len() && lost[k + 1] == end {
            k += 1;
            end += 1;
        }
        k += 1;
        let before = start.checked_sub(1).map(|i| values[i]);
        let after = values.get(end).copied();
        let (Some(a), Some(b)) = (before.or(after), after.or(before)) else {
            continue;
        };
        let length = (end - start + 1) as f64;
        for (i, x) in values[start..end].iter_mut().enumerate() {
            *x = a + (b - a) * (i + 1) as f64 / length;
        }
    }
}
