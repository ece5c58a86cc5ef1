//! `[safety]`: when the robot may move, and how long waits may last.

use crate::parameters::SafetySettings;
use crate::reader::{Allowed, Section};
use robot_state::{Event, Reaction, Reactions};

/// Without the table an operator enables the robot.
pub(crate) fn safety(root: &Section<'_, '_>, sample_period: f64) -> SafetySettings {
    let mut settings = SafetySettings {
        automatic: false,
        time_limit: 2.0,
        send_failing: 0.02,
        late_share: 0.5,
        publisher_timeout: 1.0,
        reactions: Reactions::default(),
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
    let within = Allowed::Within(least_ms, 10_000.0);
    let failing_ms = section.number_or("send_failing_ms", 20.0, within);
    settings.send_failing = failing_ms * 1e-3;
    let late = section.number_or("late_per_cent", 50.0, Allowed::Within(0.1, 100.0));
    settings.late_share = late * 0.01;
    let timeout_ms = section.number_or(
        "publisher_timeout_ms",
        1000.0,
        Allowed::Within(50.0, 10_000.0),
    );
    settings.publisher_timeout = timeout_ms * 1e-3;
    if let Some(section) = section.optional_section("reactions") {
        settings.reactions = reactions(section, root.has("external_torque"));
    }
    section.finish();
    settings
}

/// `[safety.reactions]`: events by name, each with a reaction no weaker than its least one. `detects`:
/// contacts are detected.
fn reactions(section: Section<'_, '_>, detects: bool) -> Reactions {
    let mut reactions = Reactions::default();
    for &event in Event::ALL {
        if !section.has(event.name()) {
            continue;
        }
        let allowed: Vec<_> = event.allowed_reactions().map(Reaction::name).collect();
        let allowed = allowed.join(", ");
        let Some(text) = section.text(event.name(), &allowed) else {
            continue;
        };
        let named = Reaction::ALL.into_iter().find(|r| r.name() == text.value);
        if named.is_some_and(Reaction::yields) && event == Event::ExternalContact && !detects {
            let what = format!(
                "nothing detects the contact to which {:?} reacts",
                text.value
            );
            section.problem(event.name(), what, "a table [external_torque]");
        }
        if !named.is_some_and(|reaction| reactions.choose(event, reaction)) {
            let what = format!(
                "{:?} is not allowed for event {}",
                text.value,
                event.number()
            );
            section.problem(event.name(), what, &allowed);
        }
    }
    section.finish();
    reactions
}
