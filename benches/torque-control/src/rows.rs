//! Tables of whole robots and of current drives.

use crate::cases::parallel;
use crate::currents::{self, LOOPS};
use crate::robots::{self, Judged};
use crate::variant::{Conditions, Happens, Law, shipped};
use robot_config::FastTorqueFeedback;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Duration of a robot's motion, s.
const SECONDS: f64 = 8.0;
/// K6 of D's experiments on position control.
const K6: [f64; 4] = [1.0, 0.5, 0.25, 0.1];

/// Aims that a row is held to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Aims {
    None,
    /// Torque and position, where the law was tuned.
    Tuned,
    /// Torque and position, with other seeds or delays.
    Seeds,
    /// Torque and position, with parameters that are wrong.
    Wrong,
    /// Steps of the torque.
    Steps,
}

/// Runs under one heading, of which the worst is shown.
struct Row {
    title: String,
    robot: &'static str,
    runs: Vec<Conditions>,
    /// The aims that count here.
    aims: Aims,
}

fn rows() -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    let base = Conditions::new(shipped());
    for robot in ["leg", "humanoid"] {
        let mut row = |title: &str, aims: Aims, runs: Vec<Conditions>| {
            rows.push(Row {
                title: title.to_owned(),
                robot,
                runs,
                aims,
            });
        };
        let cycles = [0.0, 1.0, 2.0];
        for delay_cycles in cycles {
            let law = Law::D { k6: None };
            let d = Conditions {
                delay_cycles,
                ..Conditions::new(law)
            };
            row(
                &format!("D, {delay_cycles} cycles of delay"),
                Aims::None,
                vec![d],
            );
        }
        for delay_cycles in cycles {
            let new = Conditions {
                delay_cycles,
                expected_cycles: delay_cycles,
                ..base
            };
            row(
                &format!("predictive, {delay_cycles} cycles"),
                Aims::Tuned,
                vec![new],
            );
        }
        let unexpected = |delay_cycles| Conditions {
            delay_cycles,
            ..base
        };
        let runs = vec![unexpected(0.0), unexpected(2.0)];
        let title = "predictive, 0 or 2 cycles where 1 is expected";
        row(title, Aims::Seeds, runs);
        let seeds = (2..=5).map(|seed| Conditions { seed, ..base });
        let title = "predictive, seeds 2 to 5";
        row(title, Aims::Seeds, seeds.collect());
        let draws = (1..=4).map(|draw| Conditions {
            error: 0.2,
            draw,
            seed: draw + 1,
            ..base
        });
        let title = "predictive, parameters ±20 %, 4 draws";
        row(title, Aims::Wrong, draws.collect());
        for (friction, title) in [(0.0, "none"), (0.5, "half"), (2.0, "twice as much")] {
            let runs = vec![Conditions { friction, ..base }];
            let title = format!("predictive, {title} of the friction foreseen");
            row(&title, Aims::None, runs);
        }
        let sudden = |law: Law, lost: f64, happens: Happens| {
            vec![Conditions {
                lost,
                happens,
                ..Conditions::new(law)
            }]
        };
        let both = [
            ("D", Law::D { k6: None }, Aims::None),
            ("predictive", shipped(), Aims::Steps),
        ];
        for (name, law, aims) in both {
            let runs = sudden(law, 0.01, Happens::Nothing);
            row(&format!("{name}, 1 % of commands lost"), aims, runs);
        }
        for (name, law, aims) in both {
            let runs = sudden(law, 0.0, Happens::Pushes);
            row(&format!("{name}, pushes of 60 N"), aims, runs);
        }
        if robot == "humanoid" {
            let runs = sudden(shipped(), 0.0, Happens::Contacts);
            let title = "predictive, contact set to one foot and back";
            row(title, Aims::Steps, runs);
        }
        if let Law::Predictive { k6, .. } = shipped() {
            let law = Law::Predictive {
                feedback: FastTorqueFeedback::DelayCompensated,
                k6,
            };
            let title = "predictive, feedback of tau_hat";
            row(title, Aims::None, vec![Conditions::new(law)]);
        }
    }
    rows
}

fn worst(runs: &[Conditions], robot: &str) -> Result<Judged, String> {
    let mut worst = Judged::default();
    for conditions in runs {
        worst = worst.worst(robots::run(robot, SECONDS, conditions)?);
    }
    Ok(worst)
}

/// Tables of robots, and their lines of the summary.
///
/// # Errors
/// A run that fails.
pub(crate) fn tables() -> Result<(String, String), String> {
    let rows = rows();
    let results = parallel(&rows, |row| worst(&row.runs, row.robot))?;
    let mut text = ROBOTS.to_owned();
    for (row, judged) in rows.iter().zip(&results) {
        let [mean, worst] = judged.ripple;
        let fault = if judged.fault == 0 { "none" } else { "yes" };
        let _ = write!(
            text,
            "\n| {} | {} | {:.4} | {:.2} | {mean:.2} ({worst:.2}) | {:.1} | {fault} |",
            row.robot,
            row.title,
            judged.position,
            judged.torque,
            100.0 * judged.step
        );
    }
    text.push('\n');
    text += &position_control()?;
    Ok((text, aims(&rows, &results)))
}

/// Figure, its aim, and how it is measured.
type Aim<'a> = (&'a str, &'a str, &'a dyn Fn(&Judged) -> f64);

fn aims(rows: &[Row], results: &[Judged]) -> String {
    let mut text = String::new();
    let most = |robot: &str, aims: Aims, of: &dyn Fn(&Judged) -> f64| {
        let all = rows.iter().zip(results);
        let counted = all.filter(|(row, _)| row.aims == aims && row.robot == robot);
        counted.map(|(_, judged)| of(judged)).fold(0.0, f64::max)
    };
    for (robot, degrees) in [("Leg", "0.01"), ("Humanoid", "0.06")] {
        let name = &robot.to_lowercase();
        let lines: [Aim<'_>; 3] = [
            ("mean torque error, N·m", "0.5", &|j| j.torque),
            ("worst ripple beyond 5 Hz, N·m", "0.4", &|j| j.ripple[1]),
            ("position error, degrees", degrees, &|j| j.position),
        ];
        for (what, aim, of) in lines {
            let [tuned, seeds, wrong] =
                [Aims::Tuned, Aims::Seeds, Aims::Wrong].map(|aims| most(name, aims, of));
            let _ = writeln!(
                text,
                "| {robot}, 0, 1, 2 cycles: {what} | at most {aim} | {tuned:.3} | {seeds:.3} | {wrong:.3} |"
            );
        }
        let value = most(name, Aims::Steps, &|j| 100.0 * j.step);
        let _ = writeln!(
            text,
            "| {robot}, lost commands, pushes, contact sets: torque's change within 1 ms | at most 5 % of the limit | {value:.1} % | | |"
        );
    }
    text
}

/// D's Tables 2 and 3: position control of the leg with falling stiffness.
fn position_control() -> Result<String, String> {
    let Law::Predictive { feedback, .. } = shipped() else {
        return Ok(String::new());
    };
    let laws = K6.map(|k6| {
        let new = Law::Predictive { feedback, k6 };
        [Law::D { k6: Some(k6) }, new]
    });
    let all: Vec<Law> = laws.into_iter().flatten().collect();
    let results = parallel(&all, |law| {
        robots::run("leg", SECONDS, &Conditions::new(*law))
    })?;
    let mut text = POSITION.to_owned();
    for (k6, pair) in K6.iter().zip(results.chunks(2)) {
        if let [d, new] = pair {
            let _ = write!(
                text,
                "\n| {k6} | {:.4} | {:.4} | {:.2} | {:.2} | {:.2} | {:.2} |",
                d.position, new.position, d.torque, new.torque, d.ripple[1], new.ripple[1]
            );
        }
    }
    text.push('\n');
    Ok(text)
}

/// Table of current drives.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn currents() -> Result<String, String> {
    let results = parallel(&LOOPS, currents::best)?;
    let mut text = CURRENTS.to_owned();
    for ((rate, cycles, place), best) in LOOPS.iter().zip(results) {
        let (degrees, db) = best.margins;
        let [blocked, stuck] = best.bandwidth;
        let hz = |x: f64| x / TAU;
        let _ = write!(
            text,
            "\n| {rate:.0} Hz, {place} | {cycles} | {:.0}, {:.0}, {} | {degrees:.0} degrees, {db:.1} dB | {blocked:.0} / {stuck:.0} | {} |",
            hz(best.design.rotor),
            hz(best.design.link),
            best.design.stiffness,
            if best.kept { "yes" } else { "no" },
        );
    }
    text.push('\n');
    Ok(text)
}

const ROBOTS: &str = "
## Robots

The demo's motion, 8 s of which the first 2 s are left out; K6 0.5, K_d = 5 ms / K_tau with the predictive law. The
leg's D is as in the paper (K_p 2, K6 1), the humanoid's as it was quiet (K_p 1, K6 0.5, half of K_v). Errors are root
mean squares over time, means over the joints. Of several runs the worst of each figure.

<!-- rows: torque-control-robots.csv, first 5 -->

| robot | law | position error, degrees | torque error tau - tau_d, N·m | ripple beyond 5 Hz, N·m (worst joint) | largest change within 1 ms, % of limit | fault |
| --- | --- | --- | --- | --- | --- | --- |";

const POSITION: &str = "
## Position control with falling stiffness

The leg as in D's Tables 2 and 3: K6 from 1 to 0.1, K_d = 5 ms / K_tau; D's law with K_p 2.

<!-- rows: torque-control-stiffness.csv, first 2 -->

| K6 | position error, degrees: D | predictive | torque error, N·m: D | predictive | worst ripple, N·m: D | predictive |
| --- | --- | --- | --- | --- | --- | --- |";

const CURRENTS: &str = "
## Current drives

The predictive law around a current, on the same seven joints: of 20 designs the quickest that keeps 30 degrees and 6 dB over the five loads on every joint, or the nearest. Linear, as `torquectl margins` has it.

<!-- rows: torque-control-currents.csv, first 2 -->

| loop | cycles of delay | rotor Hz, link Hz, s | least margins | -3 dB blocked / stuck, Hz | kept |
| --- | --- | --- | --- | --- | --- |";
