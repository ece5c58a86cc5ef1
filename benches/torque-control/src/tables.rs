//! Tables of single joints.

use crate::cases::{Case, PREDICTIVE, SEEDS, WRONG};
use crate::joint::JOINTS;
use crate::scenario::{Blocked, Moved, SINES, VELOCITIES};
use charts::{COLOURS, Figure, Line, Panel};
use std::fmt::Write;

/// Figure, its aim, how it is measured in a row, and its unit.
type Aim<'a> = (&'a str, &'a str, &'a dyn Fn(usize) -> f64, &'a str);

/// The figures against their aims, of the predictive law.
pub(crate) fn aims(all: &[Case], blocked: &[Blocked], moved: &[Vec<Moved>]) -> String {
    let range = |name: &str, of: &dyn Fn(usize) -> f64| {
        let named = (0..all.len()).filter(|&i| all[i].name == name);
        named
            .map(of)
            .fold((f64::INFINITY, 0.0_f64), |(low, high), x| {
                (low.min(x), high.max(x))
            })
    };
    let hz = |at: usize| move |i: usize| blocked[i].bandwidth[at].unwrap_or(0.0);
    let (small, large) = (hz(0), hz(1));
    let overshoot = |i: usize| blocked[i].step[1];
    let error = |i: usize| blocked[i].step[3];
    let (mean, reversal) = (
        |i: usize| moved[i][1].mean.abs(),
        |i: usize| moved[i][1].reversal,
    );
    let lines: [Aim<'_>; 6] = [
        (
            "Blocked, -3 dB at 20 % of rated",
            "at least 20 Hz",
            &large,
            "Hz",
        ),
        (
            "Blocked, -3 dB at 2 % of rated",
            "at least 10 Hz",
            &small,
            "Hz",
        ),
        (
            "Blocked, overshoot of a step of 20 %",
            "at most 6 %",
            &overshoot,
            "%",
        ),
        (
            "Blocked, steady error",
            "at most 0.5 % of rated",
            &error,
            "%",
        ),
        (
            "Moved at 0.5 rad/s, tau_d = 0, mean torque",
            "at most 1 % of rated",
            &mean,
            "%",
        ),
        (
            "Reversal at 0.5 rad/s within 50 ms",
            "at most 40 % of rated",
            &reversal,
            "%",
        ),
    ];
    let mut text = String::new();
    for (what, aim, of, unit) in lines {
        let _ = write!(text, "| {what} | {aim} |");
        for name in [PREDICTIVE, SEEDS, WRONG] {
            let (low, high) = range(name, of);
            let digits = if high < 1.0 { 2 } else { 1 };
            let _ = write!(text, " {low:.digits$} to {high:.digits$} {unit} |");
        }
        text.push('\n');
    }
    text
}

/// The rows that tables show.
fn shown<'a, T>(all: &'a [Case], results: &'a [T]) -> impl Iterator<Item = (&'a Case, &'a T)> {
    let all = all.iter().zip(results);
    all.filter(|(case, _)| ![SEEDS, WRONG].contains(&case.name))
}

/// Tables of blocked joints.
pub(crate) fn blocked_tables(all: &[Case], results: &[Blocked]) -> String {
    let mut text = String::from(
        "\n## Blocked joint\n\nBias 30 % of rated. Step of 20 % of rated, after a second at 4 Hz in which the torsion's gain is learned. `-`: no bandwidth, as the response begins below -3 dB or peaks above 1.6.\n\n<!-- rows: torque-control-blocked.csv, first 2 -->\n\n| joint | law | -3 dB at 2 % / 20 %, Hz | peak at 2 % / 20 % | rise, ms | overshoot, % | to ±2 % of rated, ms | steady error, % of rated |",
    );
    for frequency in SINES {
        let _ = write!(text, " {frequency} Hz, error % |");
    }
    text += "\n|";
    text += &" --- |".repeat(8 + SINES.len());
    for (case, result) in shown(all, results) {
        let hz = |at: usize| match result.bandwidth[at] {
            Some(hz) if result.peak[at] < 1.6 => format!("{hz:.0}"),
            _ => "-".to_owned(),
        };
        let [rise, over, settled, error] = result.step;
        let _ = write!(
            text,
            "\n| {} | {} | {} / {} | {:.1} / {:.1} | {rise:.0} | {over:.0} | {settled:.0} | {error:.2} |",
            JOINTS[case.index].1,
            case.name,
            hz(0),
            hz(1),
            result.peak[0],
            result.peak[1],
        );
        for sine in result.sines {
            let _ = write!(text, " {sine:.0} |");
        }
    }
    text.push('\n');
    text
}

/// Steps of all joints.
pub(crate) fn figure(all: &[Case], results: &[Blocked]) -> Figure {
    let panel = |index: usize| Panel {
        caption: format!("{}: torque, % of the step", JOINTS[index].1),
        x_unit: " ms".to_owned(),
        y_range: Some((-20.0, 160.0)),
        lines: (shown(all, results))
            .filter(|(case, _)| case.index == index)
            .zip(COLOURS)
            .map(|((case, result), colour)| Line::new(case.name, colour, result.curve.clone()))
            .collect(),
        ..Panel::default()
    };
    Figure {
        title: "Blocked joint: a step of 20 % of rated torque".to_owned(),
        columns: 2,
        panel_size: (330, 170),
        panels: (0..JOINTS.len()).map(panel).collect(),
    }
}

/// Table of joints that a hand moves.
pub(crate) fn moved_table(all: &[Case], results: &[Vec<Moved>]) -> String {
    let mut text = String::from(
        "\n## Moved by hand\n\ntau_d = 0, the link at constant velocity, turned round within 50 ms. Mean torque against the hand (ripple), and the most at the reversal, % of rated.\n\n<!-- rows: torque-control-moved.csv, first 2 -->\n\n| joint | law |",
    );
    for velocity in VELOCITIES {
        let _ = write!(text, " {velocity} rad/s | reversal |");
    }
    text += "\n|";
    text += &" --- |".repeat(2 + 2 * VELOCITIES.len());
    for (case, moved) in shown(all, results) {
        let _ = write!(text, "\n| {} | {} |", JOINTS[case.index].1, case.name);
        for Moved {
            mean,
            ripple,
            reversal,
        } in moved
        {
            let _ = write!(text, " {mean:.1} ({ripple:.1}) | {reversal:.0} |");
        }
    }
    text.push('\n');
    text
}
