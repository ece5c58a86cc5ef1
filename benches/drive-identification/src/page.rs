//! The page of results.

use crate::Outcome;
use crate::variant::Variant;
use identification::drive::{Drive, Value};
use std::fmt::Write as _;

/// A parameter with its aim: a share of the truth, or ms.
struct Parameter {
    name: &'static str,
    aim: f64,
    /// The aim is in ms, not a share.
    absolute: bool,
    of: fn(&Drive) -> Option<Value>,
    truth: fn(&Outcome) -> f64,
}

const PARAMETERS: [Parameter; 5] = [
    Parameter {
        name: "k_d",
        aim: 0.15,
        absolute: false,
        of: |d| d.stiffness,
        truth: |o| o.truth.stiffness,
    },
    Parameter {
        name: "d_d",
        aim: 0.15,
        absolute: false,
        of: |d| d.damping,
        truth: |o| o.truth.damping,
    },
    Parameter {
        name: "dead zone",
        aim: 0.2,
        absolute: false,
        of: |d| d.dead_zone,
        truth: |o| o.truth.dead_zone,
    },
    Parameter {
        name: "J",
        aim: 0.15,
        absolute: false,
        of: |d| Some(d.inertia),
        truth: |o| o.truth.inertia,
    },
    Parameter {
        name: "delay",
        aim: 0.2,
        absolute: true,
        of: |d| Some(d.delay),
        truth: |o| o.truth.delay,
    },
];

impl Parameter {
    /// Error in the aim's unit, whether the interval covers the truth, whether it is determined.
    fn error(&self, outcome: &Outcome) -> Option<(f64, bool, bool)> {
        let value = (self.of)(outcome.drive.as_ref().ok()?)?;
        let truth = (self.truth)(outcome);
        let [least, most] = value.interval();
        let error = match self.absolute {
            true => 1e3 * (value.value - truth),
            // A share of a dead zone of nothing means nothing: of the shipped smallest one.
            false => {
                (value.value - truth) / truth.max(if self.name == "dead zone" { 4e-5 } else { 0.0 })
            }
        };
        Some((error, (least..=most).contains(&truth), value.determined))
    }

    fn show(&self, error: f64) -> String {
        if self.absolute {
            format!("{error:+.2} ms")
        } else {
            format!("{:+.0} %", 100.0 * error)
        }
    }

    /// Cases; within the aim, covered, determined (shares); the worst error; the median of its size.
    fn summary<'a>(&self, outcomes: impl Iterator<Item = &'a Outcome>) -> Option<[f64; 6]> {
        let errors: Vec<_> = outcomes.filter_map(|o| self.error(o)).collect();
        let n = errors.len() as f64;
        let share = |is: &dyn Fn(&(f64, bool, bool)) -> bool| {
            errors.iter().filter(|e| is(e)).count() as f64 / n
        };
        let worst = errors
            .iter()
            .map(|e| e.0)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        let mut sizes: Vec<f64> = errors.iter().map(|e| e.0.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        Some([
            n,
            share(&|e| e.0.abs() <= self.aim),
            share(&|e| e.1),
            share(&|e| e.2),
            worst,
            sizes[sizes.len() / 2],
        ])
    }
}

/// Every outcome, a line each.
pub(crate) fn lines(outcomes: &[Outcome]) -> String {
    let mut text = String::new();
    for outcome in outcomes {
        let _ = write!(
            text,
            "{} {} seed {}: ",
            outcome.case.robot, outcome.joint, outcome.case.seed
        );
        match &outcome.drive {
            Err(why) => text += why,
            Ok(drive) => {
                for p in &PARAMETERS {
                    if let Some((error, covered, determined)) = p.error(outcome) {
                        let marks = [covered, determined].map(|yes| if yes { "" } else { "!" });
                        let _ = write!(text, "{} {}{}  ", p.name, p.show(error), marks.concat());
                    }
                }
                let _ = write!(
                    text,
                    "Coulomb {:+.0} %, left {:.0} % {:.0} % {:?}",
                    100.0 * (drive.coulomb.value / outcome.truth.coulomb - 1.0),
                    100.0 * drive.current[1] / drive.current[0],
                    100.0 * drive.torque[1] / drive.torque[0],
                    drive.notes
                );
            }
        }
        text.push('\n');
    }
    text
}

const HEAD: &str = "\
# Identification of drives: results

Written by `cargo run --release -p drive-identification-bench`; [method, and what limits
it](../drive-identification.md). Simulated robots with every disturbance of `sim.toml` on move their joints through the
loop by the planned motion of 12 s. Of the leg two joints move at a time, of the humanoid in its harness two of each
limb.

True are the plant's k_d and d_d with torque constant and current gain as drawn (up to 2 and 1 % off, which no recording
shows). The true delay is the mean time from a sample to the current of its command. *Covered*: the 95 % interval holds
the truth. *Determined*: so says the identification. Else the value is the configuration's, which is the truth but for
the delay (1.4 instead of 1.2 ms), and flatters the shares within the aim.
";

/// The page.
pub(crate) fn page(outcomes: &[&Outcome]) -> String {
    let mut text = HEAD.to_owned();
    let shipped = |robot: &'static str| {
        outcomes
            .iter()
            .copied()
            .filter(move |o| o.case.variant == Variant::Shipped && o.case.robot == robot)
    };
    text += "\n## As shipped, by seeds\n\n";
    for robot in ["leg", "humanoid"] {
        let mut seeds: Vec<u64> = shipped(robot).map(|o| o.case.seed).collect();
        seeds.dedup();
        let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
        let lost = shipped(robot).filter(|o| o.drive.is_err()).count();
        let _ = writeln!(
            text,
            "- {robot}: seeds {}; {lost} drives without result",
            seeds.join(", ")
        );
    }
    text += "\n| | aim | robot | cases | within the aim | worst | median | covered | determined |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";
    for p in &PARAMETERS {
        for robot in ["leg", "humanoid"] {
            let Some([n, within, covered, determined, worst, median]) = p.summary(shipped(robot))
            else {
                continue;
            };
            let aim = p.show(p.aim).replace('+', "± ");
            let _ = writeln!(
                text,
                "| {} | {aim} | {robot} | {n:.0} | {:.0} % | {} | {} | {:.0} % | {:.0} % |",
                p.name,
                100.0 * within,
                p.show(worst),
                p.show(median).replace('+', ""),
                100.0 * covered,
                100.0 * determined
            );
        }
    }
    text += &by_drive(outcomes);
    text += &variants(outcomes);
    text += &motors(outcomes);
    text
}

/// Worst errors of each joint of the leg, and of each kind of drive of the humanoid.
fn by_drive(outcomes: &[&Outcome]) -> String {
    let mut text = "\n## By joint, worst of the seeds\n\nOf the humanoid left and right together.\n\n<!-- rows: drive-identification-joints.csv, 4 greatest of dead zone -->\n\n| robot | joint | k_d | d_d | dead zone | J | delay | Coulomb friction |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n".to_owned();
    let mut names: Vec<(&str, String)> = Vec::new();
    let name = |o: &Outcome| o.joint.replace("left_", "").replace("right_", "");
    let shipped = || {
        outcomes
            .iter()
            .copied()
            .filter(|o| o.case.variant == Variant::Shipped)
    };
    for o in shipped() {
        if !names.contains(&(o.case.robot, name(o))) {
            names.push((o.case.robot, name(o)));
        }
    }
    for (robot, joint) in names {
        let own = || shipped().filter(|o| o.case.robot == robot && name(o) == joint);
        let worst = PARAMETERS
            .iter()
            .map(|p| p.summary(own()).map_or("-".to_owned(), |s| p.show(s[4])));
        let worst: Vec<String> = worst.collect();
        let coulomb = own()
            .filter_map(|o| Some(o.drive.as_ref().ok()?.coulomb.value / o.truth.coulomb - 1.0));
        let coulomb = coulomb
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(f64::NAN);
        let _ = writeln!(
            text,
            "| {robot} | {joint} | {} | {:+.0} % |",
            worst.join(" | "),
            100.0 * coulomb
        );
    }
    text
}

/// The leg with other drives.
fn variants(outcomes: &[&Outcome]) -> String {
    let mut text = "\n## Drives and transports that nothing was tuned on\n\nThe leg, seed 11, with the shipped configuration: worst error, and share of the 6 cases that are covered. *No recording*: the shipped law, whose model is then wrong, faulted before the motion ended.\n\n<!-- rows: drive-identification-others.csv, 4 greatest of dead zone -->\n\n| | no recording | k_d | d_d | dead zone | J | delay |\n| --- | --- | --- | --- | --- | --- | --- |\n".to_owned();
    for variant in Variant::OTHERS {
        let own = || {
            outcomes
                .iter()
                .copied()
                .filter(|o| o.case.variant == variant)
        };
        let lost = own().filter(|o| o.drive.is_err()).count();
        let cell = |p: &Parameter| match p.summary(own()) {
            Some([_, _, covered, _, worst, _]) => {
                format!("{}, {:.0} %", p.show(worst), 100.0 * covered)
            }
            None => "-".to_owned(),
        };
        let cells: Vec<String> = PARAMETERS.iter().map(cell).collect();
        let lost = if lost == 0 {
            String::new()
        } else {
            format!("{lost}")
        };
        let _ = writeln!(
            text,
            "| {} | {lost} | {} |",
            variant.name(),
            cells.join(" | ")
        );
    }
    text
}

/// K_tau and K_v by D's methods.
fn motors(outcomes: &[&Outcome]) -> String {
    let mut text = "\n## D's motor models from the same recordings\n\nThe leg, seed 1. True K_tau is the softness of drive and gear in series, K_v = d_d / k_d. *Over*: share of the rows whose command is over-estimated, which D 3.3 wants small.\n\n<!-- rows: drive-identification-motors.csv, first 2 -->\n\n| joint | 1e3 K_tau true | least squares | asymmetric | two stages | 1e3 K_v true | least squares | asymmetric | two stages | over |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n".to_owned();
    let own = |o: &&Outcome| {
        o.case.robot == "leg" && o.case.seed == 1 && o.case.variant == Variant::Shipped
    };
    for o in outcomes.iter().copied().filter(own) {
        let cell = |i: usize, x: usize| {
            let fit = o.motor.get(i).and_then(Option::as_ref);
            fit.map_or("-".to_owned(), |fit| format!("{:.3}", 1e3 * fit.x[x]))
        };
        let over: Vec<String> = (o.motor.iter().flatten())
            .map(|fit| format!("{:.0}", 100.0 * fit.over))
            .collect();
        let _ = writeln!(
            text,
            "| {} | {:.3} | {} | {} | {} | {:.2} | {} | {} | {} | {} % |",
            o.joint,
            1e3 * (1.0 / o.truth.stiffness + 1.0 / o.truth.gear),
            cell(0, 0),
            cell(1, 0),
            cell(2, 0),
            1e3 * o.truth.damping / o.truth.stiffness,
            cell(0, 1),
            cell(1, 1),
            cell(2, 1),
            over.join(", ")
        );
    }
    text
}
