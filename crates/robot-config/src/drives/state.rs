//! `[drive.NAME.state]`: states of a drive by its status word, and the words that control it.

use crate::reader::{Allowed, Section};
use drives_of_makers::family::translation;
use robot_state::DriveState;
use supervisor::{ControlWords, DriveProfile, StatusBits, StatusPattern};

/// One more than the greatest word.
const WORDS: u64 = 1 << 32;

/// The preset CiA 402 with the default time limit.
pub(super) fn cia402(sample_period: f64) -> DriveProfile {
    DriveProfile::cia402(step_limit(STEP_LIMIT_MS, sample_period))
}

/// The states of an actuator's own message, with the default time limit; `bears`: it may bear its joint by torque.
pub(super) fn actuator(sample_period: f64, bears: bool) -> DriveProfile {
    let row = |value, state| StatusPattern {
        mask: 0xFF,
        value,
        state,
    };
    DriveProfile {
        status: vec![
            row(0, DriveState::Off),
            row(1, DriveState::Enabled),
            row(2, DriveState::Fault),
            row(translation::BEARS, DriveState::Stopping),
        ],
        control: Some(ControlWords {
            prepare: translation::ENABLE,
            switch_on: translation::ENABLE,
            enable: translation::ENABLE,
            disable: translation::DISABLE,
            reset: translation::RESET,
            quick_stop: bears.then_some(translation::BEAR),
        }),
        step_limit: step_limit(STEP_LIMIT_MS, sample_period),
        brake: false,
        bears,
        time_out_set: None,
    }
}

fn step_limit(limit_ms: f64, sample_period: f64) -> u32 {
    (limit_ms * 1e-3 / sample_period).ceil().max(1.0) as u32
}

/// Default of the time limit of a step, ms.
const STEP_LIMIT_MS: f64 = 500.0;

/// The preset CiA 402, or the words of a table of its own.
pub(super) fn read(section: Section<'_, '_>, sample_period: f64) -> DriveProfile {
    let limit_ms = section.number_or(
        "step_time_limit_ms",
        STEP_LIMIT_MS,
        Allowed::Within(1.0, 60_000.0),
    );
    let step_limit = step_limit(limit_ms, sample_period);
    let cia402 = section.choice_or("profile", false, &[("cia402", true), ("table", false)]);
    let brake = section.choice_or("brake", false, &[("while_off", true), ("none", false)]);
    let time_out_set = section.optional_section("time_out_set").map(|section| {
        let (mask, value) = bits(&section);
        section.finish();
        StatusBits { mask, value }
    });
    let profile = if cia402 {
        DriveProfile {
            brake,
            time_out_set,
            ..DriveProfile::cia402(step_limit)
        }
    } else {
        DriveProfile {
            status: status(&section),
            control: section.optional_section("control").map(control),
            step_limit,
            brake,
            bears: false,
            time_out_set,
        }
    };
    section.finish();
    profile
}

fn status(section: &Section<'_, '_>) -> Vec<StatusPattern> {
    let rows: Vec<_> = section.list("status").into_iter().map(row).collect();
    if !rows.iter().any(|row| row.state == DriveState::Enabled) {
        let allowed = "profile = \"cia402\", or a list of rows { state, mask, value }, one of them \
                       with state = \"enabled\"";
        section.problem(
            "status",
            "no status word stands for an enabled drive",
            allowed,
        );
    }
    rows
}

fn row(section: Section<'_, '_>) -> StatusPattern {
    // Unknown is where no row fits.
    let known = DriveState::ALL.iter().skip(1);
    let states: Vec<_> = known.map(|&state| (state.name(), state)).collect();
    let state = section.choice("state", &states);
    let (mask, value) = bits(&section);
    section.finish();
    StatusPattern { mask, value, state }
}

/// Bits that matter, and their values.
fn bits(section: &Section<'_, '_>) -> (u32, u32) {
    let [mask, value] = ["mask", "value"].map(|key| section.integer(key, 0..WORDS) as u32);
    if value & !mask != 0 {
        section.problem(
            "value",
            "has bits outside the mask: no word fits",
            "bits of the mask",
        );
    }
    (mask, value)
}

fn control(section: Section<'_, '_>) -> ControlWords {
    let word = |key| section.integer(key, 0..WORDS) as u32;
    let words = ControlWords {
        prepare: word("prepare"),
        switch_on: word("switch_on"),
        enable: word("enable"),
        disable: word("disable"),
        reset: word("reset"),
        quick_stop: section
            .optional_integer("quick_stop", 0..WORDS)
            .map(|word| word as u32),
    };
    section.finish();
    words
}
