//! `[safety]`: when the robot may move, and how long waits may last.

use crate::parameters::SafetySettings;
use crate::reader::{Allowed, Section};

/// Without the table an operator enables the robot.
pub(crate) fn safety(root: &Section<'_, '_>, sample_period: f64) -> SafetySettings {
    let mut settings = SafetySettings {
        automatic: false,
        time_limit: 2.0,
    };
    let Some(section) = root.optional_section("safety") else {
        return settings;
    };
    let choices = [("operator", false), ("automatic", true)];
    settings.automatic = section.choice_or("enable", false, &choices);
    let least_ms = if sample_period.is_nan() {
        0.1
    } else {
        sample_period * 1e3
    };
    let limit_ms = section.number_or("time_limit_ms", 2000.0, Allowed::Within(least_ms, 60_000.0));
    settings.time_limit = limit_ms * 1e-3;
    section.finish();
    settings
}
