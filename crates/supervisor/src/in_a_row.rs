//! How long a condition has held without a break.

/// Counts the samples in a row for which a condition `holds`; returns how many.
pub fn count_in_a_row(samples: &mut u32, holds: bool) -> u32 {
    *samples = if holds { samples.saturating_add(1) } else { 0 };
    *samples
}

/// Adds up the time for which a condition `holds`, in cycles of `dt`, s; returns it, s.
pub fn time_in_a_row(time: &mut f64, holds: bool, dt: f64) -> f64 {
    *time = if holds { *time + dt } else { 0.0 };
    *time
}
