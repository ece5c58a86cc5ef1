//! `[filters]`.

use crate::parameters::{Filters, SignalFilters};
use crate::reader::Section;
use estimators::filter_bank::FilterDesign;
use estimators::matched_filter::MatchedFilterParameters;
use estimators::savitzky_golay::SavitzkyGolayParameters;

/// Longest window, samples.
const MAX_WINDOW: u64 = 1000;
/// Default window of the short filters, samples: the one that the demo's figures are taken with.
const DELAY_COMPENSATION: u64 = 24;

/// The long filters of encoders and sensors have one delay, because signals that enter one equation
/// must belong to one instant; so have the short ones. The filter of control's velocities enters no
/// such equation and is short by itself.
pub(crate) fn filters(root: &Section<'_, '_>, sample_period: f64) -> Filters {
    let table = root.optional_section("filters");
    let section = table.as_ref();
    let read = |key, window: usize, order| {
        let table = section.and_then(|section| section.optional_section(key));
        let (window, order) = table.map_or((window as u64, order), |table| {
            let window = table.integer("window", order + 1..MAX_WINDOW + 1);
            let order = table.integer("order", order..window.clamp(order + 1, 6));
            table.finish();
            (window, order)
        });
        (window as usize, order as usize)
    };
    let (window, order) = read("control", 16, 2);
    let control = SavitzkyGolayParameters::centred(window, order, 1, sample_period);
    let window = |key| section.and_then(|section| section.optional_integer(key, 3..MAX_WINDOW + 1));
    let short = window("delay_compensation").unwrap_or(DELAY_COMPENSATION);
    let (long, window) = match (section, window("matched")) {
        (Some(section), Some(window)) => {
            for key in ["encoder", "sensor"] {
                if section.has(key) {
                    let what = "matched filters take the place of the filter of encoders and that of sensors";
                    section.problem(key, what, "matched, or encoder and sensor, not both");
                }
            }
            (matched(window as usize, sample_period), window as usize)
        }
        _ => {
            // Accelerations are second derivatives of angles, and first ones of the gyro.
            let (encoder, sensor) = (read("encoder", 80, 2), read("sensor", 80, 1));
            savitzky_golay(section, encoder, sensor, sample_period)
        }
    };
    let filters = Filters {
        long,
        window,
        short: matched(short as usize, sample_period),
        control,
    };
    if let Some(table) = table {
        table.finish();
    }
    filters
}

pub(crate) fn matched(window: usize, sample_period: f64) -> SignalFilters {
    let design = |derivatives| {
        FilterDesign::Matched(MatchedFilterParameters {
            window,
            derivatives,
            sample_period,
        })
    };
    SignalFilters {
        encoder: design(2),
        sensor: design(1),
    }
}

/// Two filters, each given by window and order, with the delay of half the longer window.
fn savitzky_golay(
    section: Option<&Section<'_, '_>>,
    encoder: (usize, usize),
    sensor: (usize, usize),
    sample_period: f64,
) -> (SignalFilters, usize) {
    let delay_samples = 0.5 * (encoder.0.max(sensor.0) - 1) as f64;
    let shortest = encoder.0.min(sensor.0);
    if let Some(section) = section
        && delay_samples > (shortest - 1) as f64
    {
        let what = format!(
            "windows of {} and {} samples cannot have one delay",
            encoder.0, sensor.0
        );
        let allowed =
            "the longer window at most twice the shorter less one; equal windows are best";
        section.problem("", what, allowed);
    }
    let design = |(window, order), derivatives| {
        FilterDesign::SavitzkyGolay(SavitzkyGolayParameters {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        })
    };
    let filters = SignalFilters {
        encoder: design(encoder, 2),
        sensor: design(sensor, 1),
    };
    (filters, encoder.0.max(sensor.0))
}
