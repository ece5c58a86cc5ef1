//! `[external_torque]`: detection of contacts, and the limits within which a limb yields to one.

use crate::filters::matched;
use crate::parameters::{ContactReaction, ContactThreshold, ExternalTorqueSettings};
use crate::reader::{Allowed, Section};

/// Default ways of complying and of going back.
const COMPLY_DEG: f64 = 30.0;
const COMPLY_MM: f64 = 50.0;
const RETRACT_DEG: f64 = 5.0;
const RETRACT_MM: f64 = 10.0;

/// Longest window of the fast part, samples: beyond it would not be fast.
const MAX_WINDOW: u64 = 100;

/// None without the table.
pub(crate) fn external_torque(
    root: &Section<'_, '_>,
    sample_period: f64,
) -> Option<ExternalTorqueSettings> {
    let section = root.optional_section("external_torque")?;
    let share = |key, default| 0.01 * section.number_or(key, default, Allowed::Within(0.0, 100.0));
    let least_ms = if sample_period.is_nan() {
        0.1
    } else {
        sample_period * 1e3
    };
    let time = |key, default, most| {
        1e-3 * section.number_or(key, default, Allowed::Within(least_ms, most))
    };
    let window = section.optional_integer("window", 5..MAX_WINDOW + 1);
    let settings = ExternalTorqueSettings {
        filters: matched(window.unwrap_or(12) as usize, sample_period),
        gain: section.number_or("gain_per_s", 30.0, Allowed::Within(1.0, 1000.0)),
        threshold: ContactThreshold {
            sigmas: section.number_or("sigmas", 4.0, Allowed::Within(1.0, 20.0)),
            change: share("change_per_cent", 2.0),
            lasting: share("lasting_per_cent", 8.0),
            at_velocity_limit: share("velocity_per_cent", 4.0),
            at_acceleration_limit: share("acceleration_per_cent", 4.0),
            of_torque_change: share("torque_change_per_cent", 10.0),
        },
        upper_ratio: section.number_or("upper_ratio", 1.5, Allowed::Within(1.0, 20.0)),
        hold: time("hold_ms", 2.0, 1000.0),
        release: time("release_ms", 100.0, 10_000.0),
        frame: (section.optional_text("frame", "a link of the URDF")).map(|t| t.value.to_owned()),
        reaction: reaction(&section, least_ms),
    };
    section.finish();
    Some(settings)
}

/// `[external_torque.reaction]`.
fn reaction(section: &Section<'_, '_>, least_ms: f64) -> ContactReaction {
    let mut reaction = ContactReaction {
        comply: [COMPLY_DEG.to_radians(), 1e-3 * COMPLY_MM],
        comply_until_gone: None,
        retract: [RETRACT_DEG.to_radians(), 1e-3 * RETRACT_MM],
    };
    let Some(section) = section.optional_section("reaction") else {
        return reaction;
    };
    let angle = |key, default: f64| {
        let degrees = section.number_or(key, default, Allowed::Within(0.1, 180.0));
        degrees.to_radians()
    };
    let length =
        |key, default| 1e-3 * section.number_or(key, default, Allowed::Within(0.1, 1000.0));
    reaction.comply = [
        angle("comply_deg", COMPLY_DEG),
        length("comply_mm", COMPLY_MM),
    ];
    reaction.retract = [
        angle("retract_deg", RETRACT_DEG),
        length("retract_mm", RETRACT_MM),
    ];
    let ends = [("operator", false), ("contact_gone", true)];
    let gone = section.choice_or("comply_ends", false, &ends);
    let after = section.number_or("gone_ms", 1000.0, Allowed::Within(least_ms, 60_000.0));
    if section.has("gone_ms") && !gone {
        let what = "complying does not end with the contact";
        section.problem("gone_ms", what, "with comply_ends = \"contact_gone\"");
    }
    reaction.comply_until_gone = gone.then_some(1e-3 * after);
    section.finish();
    reaction
}
