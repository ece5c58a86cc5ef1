//! Time stamps: unit, rate, regularity, gaps.

use crate::log::LogRow;
use problem::{Problem, Problems};

/// Units that stamps are mistaken in, and what one second is in them.
const UNITS: [(&str, f64); 3] = [("ms", 1e3), ("us", 1e6), ("ns", 1e9)];
/// Largest deviation of the median step from the period, parts.
const MAX_RATE_ERROR: f64 = 0.05;
/// Deviation of a step from a whole number of periods from which it is irregular, periods.
const IRREGULAR: f64 = 0.3;
/// Share of irregular steps that is named, and that is refused. Stamps of a PC beside a bus
/// reach 5 % (logs of a real arm, November 2026).
const IRREGULAR_NAMED: f64 = 0.01;
const IRREGULAR_REFUSED: f64 = 0.15;
/// Share of samples that may be missing.
const MAX_MISSING: f64 = 0.3;

/// Checks the stamps against the sample period, s.
pub(super) fn check(rows: &[LogRow], period: f64, notes: &mut Vec<String>) -> Result<(), Problems> {
    let steps: Vec<f64> = rows.windows(2).map(|w| w[1].t - w[0].t).collect();
    check_rate(&steps, period)?;
    if let Some(row) = steps.iter().position(|s| *s <= 0.0) {
        let (before, now) = (rows[row].t, rows[row + 1].t);
        let count = steps.iter().filter(|s| **s <= 0.0).count();
        let what = if now == before {
            "stands twice"
        } else {
            "runs backwards"
        };
        let reason = format!("`t` {what}: {now} s follows {before} s, {count} times in all");
        return Err(Problem::new(reason, "stamps that increase from row to row")
            .at("", row + 3)
            .into());
    }
    let away = |step: &&f64| {
        let periods = **step / period;
        (periods - periods.round().max(1.0)).abs() > IRREGULAR
    };
    let irregular = steps.iter().filter(away).count() as f64 / steps.len() as f64;
    if irregular > IRREGULAR_REFUSED {
        let reason = format!(
            "stamps are irregular: {:.0} % of the steps are not a whole number of periods of {:.4} ms",
            100.0 * irregular,
            1e3 * period
        );
        let allowed = "samples at a steady rate; `torquectl import` resamples a log";
        return Err(Problem::new(reason, allowed).into());
    }
    if irregular > IRREGULAR_NAMED {
        notes.push(format!(
            "{:.1} % of the stamps are irregular",
            100.0 * irregular
        ));
    }
    let missing: f64 = steps.iter().map(|s| (s / period).round() - 1.0).sum();
    let share = missing / (missing + rows.len() as f64);
    // A pause between two recordings is one step; samples lost here and there are many.
    let gaps = steps.iter().filter(|s| **s > 1.5 * period).count();
    if share > MAX_MISSING && gaps > rows.len() / 10 {
        let reason = format!("{:.0} % of the samples are missing", 100.0 * share);
        return Err(Problem::new(reason, "a log of (nearly) every sample").into());
    }
    if gaps > 0 {
        notes.push(format!("{gaps} gaps, {missing:.0} samples missing"));
    }
    Ok(())
}

/// Checks that steps from stamp to stamp, s, are those of the sample period, s, by their median: the unit and the
/// rate. Without a step nothing is wrong.
///
/// # Errors
/// Stamps in another unit, or another rate.
pub fn check_rate(steps: &[f64], period: f64) -> Result<(), Problem> {
    let mut sorted = steps.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.get(sorted.len() / 2) {
        Some(median) if (median / period - 1.0).abs() > MAX_RATE_ERROR => {
            Err(wrong_rate(*median, period))
        }
        _ => Ok(()),
    }
}

fn wrong_rate(median: f64, period: f64) -> Problem {
    let unit = UNITS
        .iter()
        .find(|(_, factor)| (median / factor / period - 1.0).abs() < MAX_RATE_ERROR);
    let allowed = format!(
        "steps of {period} s, by the joint's `sample_rate_hz` of {}",
        1.0 / period
    );
    let reason = match unit {
        Some((unit, _)) => format!("`t` is in {unit}: its steps are {median:.6}"),
        None => format!(
            "`t` advances by {median:.6} s a row: {:.3} Hz are not the joint's `sample_rate_hz`",
            1.0 / median
        ),
    };
    Problem::new(reason, allowed)
}
