//! `[drive.NAME.thermal]`: how hot a drive may get.

use crate::parameters::Thermal;
use crate::reader::{Allowed, Section};

/// Keys of the temperatures, in their order.
const KEYS: [&str; 3] = ["warn_C", "derate_C", "stop_C"];

/// Reads the table.
pub(super) fn read(section: Section<'_, '_>) -> Thermal {
    let temperatures = KEYS.map(|key| section.optional_number(key, Allowed::Within(-50.0, 300.0)));
    let given: Vec<f64> = temperatures.into_iter().flatten().collect();
    let rises = given.is_sorted_by(|a, b| a <= b) && given.get(1) < given.get(2);
    let all = <[f64; 3]>::try_from(given);
    if all.is_err() && temperatures.iter().any(Option::is_some) || all.is_ok() && !rises {
        let what = "these temperatures are not allowed";
        let allowed =
            "warn_C, derate_C and stop_C, the second not below the first, the third above it";
        section.problem("stop_C", what, allowed);
    }
    let thermal = Thermal {
        continuous_current: section.number("continuous_current_A", Allowed::Positive),
        time_constant: section.number("time_constant_s", Allowed::Positive),
        temperatures: all.ok(),
    };
    section.finish();
    thermal
}
