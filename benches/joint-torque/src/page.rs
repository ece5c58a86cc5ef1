//! The page of results as text.

use crate::judge::{FUSED, Outcome};
use crate::lara8::Lara8;
use std::fmt::Write as _;

/// Figures of all joints.
pub struct Results {
    /// Z's joint (and G's, and U's at its size): nominal.
    pub z: Vec<Outcome>,
    /// S's joint: nominal.
    pub s: Vec<Outcome>,
    /// Report of each fit on Z's joint and on S's.
    pub reports: [Vec<String>; 2],
    /// Redrawn joints of Z's kind, then of S's: seed and outcomes.
    pub redrawn: [Vec<(u64, Vec<Outcome>)>; 2],
    /// The real joint.
    pub lara8: Lara8,
}

/// G's RMS errors, per cent of RMS torque.
const G: [(&str, f64); 4] = [
    ("slow", 1.62),
    ("fast", 2.53),
    ("sudden", 0.63),
    ("frequent", 2.5),
];
/// S's RMS errors of the piecewise model and the network, N·m.
const S: [(&str, f64, f64); 4] = [
    ("slow", 42.3, 14.48),
    ("fast", 67.06, 11.3),
    ("sudden", 32.99, 2.84),
    ("static", 14.48, 5.9),
];
/// U's RMS errors of CM, CM-KF and CM-UKF, N·m.
const U: [(&str, [f64; 3]); 2] = [
    ("U fast small", [0.6022, 0.1949, 0.0626]),
    ("U slow large", [1.1723, 2.9487, 0.0482]),
];
/// CM-UKF shall be this much below CM, per cent.
const U_AIM: f64 = 85.0;
/// The fused torque's RMS over that of its best source, at most.
const FUSED_AIM: f64 = 1.05;

fn outcome<'a>(outcomes: &'a [Outcome], name: &str) -> Option<&'a Outcome> {
    outcomes.iter().find(|o| o.name == name)
}

fn percent(outcomes: &[Outcome], scenario: &str, estimator: &str) -> f64 {
    outcome(outcomes, scenario).map_or(f64::NAN, |o| o.percent(estimator))
}

fn rms(outcomes: &[Outcome], scenario: &str, estimator: &str) -> f64 {
    let found = outcome(outcomes, scenario).and_then(|o| o.of(estimator));
    found.map_or(f64::NAN, |f| f.rms)
}

/// RMS error of CM-UKF (with the added states) below that of CM, per cent.
fn below(outcomes: &[Outcome], scenario: &str, estimator: &str) -> f64 {
    let cm = rms(outcomes, scenario, "compliance");
    100.0 * (1.0 - rms(outcomes, scenario, estimator) / cm)
}

fn verdict(reached: bool) -> &'static str {
    if reached {
        "reached"
    } else {
        "**not reached**"
    }
}

/// Every estimator in every scenario.
fn table(text: &mut String, joint: &str, outcomes: &[Outcome]) {
    let _ = writeln!(
        text,
        "<!-- rows: joint-torque-{joint}.csv, 3 least of slow -->\n"
    );
    let mut heading = "| estimator |".to_owned();
    let mut line = "| --- |".to_owned();
    for o in outcomes {
        let _ = write!(heading, " {} |", o.name);
        line += " ---: |";
    }
    let _ = writeln!(text, "{heading}\n{line}");
    let names = outcomes.first().map(|o| o.figures.iter().map(|(n, _)| n));
    for name in names.into_iter().flatten() {
        let _ = write!(text, "| {name} |");
        for o in outcomes {
            let _ = match o.of(name) {
                Some(f) => write!(text, " {:.2} ({:.3}; {:.2}) |", f.rms_percent, f.rms, f.max),
                None => write!(text, " - |"),
            };
        }
        text.push('\n');
    }
    let _ = write!(text, "| *fused / best source* |");
    for o in outcomes {
        let _ = write!(text, " *{:.3}* |", o.fused_over_best());
    }
    text.push_str("\n\n");
}

/// The whole page.
#[must_use]
pub fn page(r: &Results) -> String {
    let mut text = HEAD.to_owned();
    for o in &r.z {
        let _ = writeln!(text, "- **{}**: {}.", o.name, o.about);
    }
    text.push_str("\n## Z's and G's joint: 16 N·m, 100:1\n\n");
    text.push_str("RMS error in % of the RMS torque (RMS; largest, N·m):\n\n");
    table(&mut text, "z", &r.z);
    text.push_str("![true and estimated torque](joint-torque-z.svg)\n\n");
    text.push_str("[Report of `fit all`](joint-torque-z-fit.txt).\n\n");
    beside_g(&mut text, &r.z);
    beside_u(&mut text, &r.z);
    text.push_str("\n## S's joint: 400 N·m, 160:1\n\n");
    table(&mut text, "s", &r.s);
    text.push_str("![true and estimated torque](joint-torque-s.svg)\n\n");
    text.push_str("[Report of `fit all`](joint-torque-s-fit.txt).\n\n");
    beside_s(&mut text, &r.s);
    fused(&mut text, r);
    redrawn(&mut text, r);
    real(&mut text, &r.lara8);
    text.push_str(TAIL);
    text
}

fn beside_g(text: &mut String, z: &[Outcome]) {
    text.push_str("### Beside Z and G\n\n");
    text.push_str("% of RMS torque; Z's CM reports 0.4061 N·m slow, 0.445 fast, 0.215 static.\n\n");
    text.push_str(
        "| scenario | G reports | our CM-GP | fused | aim: CM-GP or fused at most G's |\n",
    );
    text.push_str("| --- | ---: | ---: | ---: | --- |\n");
    for (name, reported) in G {
        let (gp, fused) = (percent(z, name, "compliance_gp"), percent(z, name, FUSED));
        let reached = verdict(gp.min(fused) <= reported);
        let _ = writeln!(
            text,
            "| {name} | {reported} | {gp:.2} | {fused:.2} | {reached} |"
        );
    }
    text.push('\n');
}

fn beside_u(text: &mut String, z: &[Outcome]) {
    text.push_str(
        "### Beside U\n\n| experiment | U: CM / CM-KF / CM-UKF, N·m | ours: CM | CM-KF | ",
    );
    text.push_str("CM-UKF | with added states | below CM | aim: 85 % |\n");
    text.push_str("| --- | --- | ---: | ---: | ---: | ---: | ---: | --- |\n");
    for (name, [cm, kf, ukf]) in U {
        let ours = |estimator| rms(z, name, estimator);
        let below = below(z, name, "unscented_added");
        let _ = writeln!(
            text,
            "| {name} | {cm} / {kf} / {ukf} | {:.4} | {:.4} | {:.4} | {:.4} | {below:.1} % | {} |",
            ours("compliance"),
            ours("kalman"),
            ours("unscented"),
            ours("unscented_added"),
            verdict(below >= U_AIM)
        );
    }
}

fn beside_s(text: &mut String, s: &[Outcome]) {
    text.push_str("### Beside S\n\nN·m RMS:\n\n");
    text.push_str(
        "| scenario | S: piecewise | network | ratio | ours: deformation | network | ratio |\n",
    );
    text.push_str("| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n");
    for (name, piecewise, network) in S {
        let ours = [rms(s, name, "deformation"), rms(s, name, "network")];
        let _ = writeln!(
            text,
            "| {name} | {piecewise} | {network} | {:.2} | {:.2} | {:.2} | {:.2} |",
            piecewise / network,
            ours[0],
            ours[1],
            ours[0] / ours[1]
        );
    }
    let [_, (_, piecewise, network), ..] = S;
    let (theirs, ours) = (
        piecewise / network,
        rms(s, "fast", "deformation") / rms(s, "fast", "network"),
    );
    let _ = writeln!(
        text,
        "\nAim: the network below the piecewise model by S's ratio in the fast scenario, \
         {theirs:.2}: {}, {ours:.2}.\n",
        verdict(ours >= theirs)
    );
}

fn fused(text: &mut String, r: &Results) {
    let both = r.z.iter().chain(&r.s);
    let worst = both.max_by(|a, b| a.fused_over_best().total_cmp(&b.fused_over_best()));
    let Some(worst) = worst else { return };
    let ratio = worst.fused_over_best();
    let _ = writeln!(
        text,
        "## Fused against its best source\n\nAim: in no scenario worse than {FUSED_AIM} times the best \
         source. Worst of both joints: {ratio:.3} in \"{}\": {}.\n",
        worst.name,
        verdict(ratio <= FUSED_AIM)
    );
}

fn redrawn(text: &mut String, r: &Results) {
    let seeds = r.redrawn.each_ref().map(Vec::len);
    let _ = writeln!(
        text,
        "## Joints redrawn\n\nEvery parameter of the simulated joint (stiffness, hysteresis, friction, \
         kinematic error, bearing, sensors) redrawn within ±30 %, calibrated and judged anew: {} \
         joints of Z's kind, {} of S's. Worst joint of each scenario, RMS in % of RMS torque \
         (seed), median in brackets.\n",
        seeds[0], seeds[1]
    );
    for ((title, file), joints) in [("Z's kind", "z"), ("S's kind", "s")]
        .iter()
        .zip(&r.redrawn)
    {
        let Some((_, first)) = joints.first() else {
            continue;
        };
        let _ = writeln!(
            text,
            "<!-- rows: joint-torque-redrawn-{file}.csv, 2 greatest of fused / best -->\n\n\
             | {title} | compliance | compliance_gp | hysteresis | unscented_added | network | fused \
             | fused / best |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
        );
        for o in first {
            let _ = write!(text, "| {} |", o.name);
            let names = [
                "compliance",
                "compliance_gp",
                "hysteresis",
                "unscented_added",
                "network",
            ];
            for name in names.into_iter().chain([FUSED]) {
                worst(text, joints, &|outcomes| percent(outcomes, o.name, name), 2);
            }
            let ratio = |outcomes: &[Outcome]| {
                outcome(outcomes, o.name).map_or(f64::NAN, Outcome::fused_over_best)
            };
            worst(text, joints, &ratio, 3);
            text.push('\n');
        }
        text.push('\n');
    }
    let joints = &r.redrawn[0];
    let over = G.map(|(name, reported)| {
        let over = |(_, o): &&(u64, Vec<Outcome>)| percent(o, name, FUSED) > reported;
        format!("{} ({name})", joints.iter().filter(over).count())
    });
    let short = U.map(|(name, _)| {
        let short = |(_, o): &&(u64, Vec<Outcome>)| below(o, name, "unscented_added") < U_AIM;
        format!("{} ({name})", joints.iter().filter(short).count())
    });
    let _ = writeln!(
        text,
        "Of {} joints of Z's kind the fused torque is above G's figure on {}. CM-UKF with added states is less than {U_AIM} % \
         below CM on {}.\n",
        joints.len(),
        over.join(", "),
        short.join(", ")
    );
}

type Value<'a> = &'a dyn Fn(&[Outcome]) -> f64;

fn worst(text: &mut String, joints: &[(u64, Vec<Outcome>)], value: Value<'_>, digits: usize) {
    let mut values: Vec<(f64, u64)> = joints.iter().map(|(seed, o)| (value(o), *seed)).collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let median = values.get(values.len() / 2).map_or(f64::NAN, |v| v.0);
    if let Some((worst, seed)) = values.last() {
        let _ = write!(text, " {worst:.digits$} ({seed}) [{median:.digits$}] |");
    }
}

fn real(text: &mut String, l: &Lara8) {
    let [first, second, both] = l.rms;
    let _ = writeln!(
        text,
        "## A real joint\n\nJoint 3 of a NEURA LARA8, one sweep with a payload \
         (`benches/joint-torque/data/lara8_joint3`, with its licence). There is no torque sensor \
         in the joint: the external torque is judged against the F/T sensor at the flange, fitted \
         on alternate half-second blocks and judged on the others, then the other way round.\n\n\
         | | |\n| --- | --- |\n\
         | skew (motor-side encoder later) | {:.2} ± {:.2} ms |\n\
         | stiffness | {:.1} ± {:.1} kN·m/rad |\n\
         | external torque, RMS error | **{both:.2} N·m** ({first:.2} and {second:.2} on the halves) |\n\
         | motor current less feed-forward | {:.2} N·m |\n\
         | network of the data's source, trained on far more | 2.67 N·m |\n\
         | plain regression on torsion, velocity, feed-forward | 2.0 N·m |\n\n\
         Intervals: 95 %, by leaving out half-second blocks. Aim: below 1.5 N·m, {}.\n",
        1e3 * l.skew.0,
        1e3 * l.skew.1,
        1e-3 * l.stiffness.0,
        1e-3 * l.stiffness.1,
        l.current_rms,
        verdict(both < 1.5)
    );
}

const HEAD: &str = "\
# Joint torque: every estimator side by side

Made by `cargo run --release -p joint-torque-bench -- results`. **All but the last section is simulated**
(`crates/plant`, which shares no model with the estimators); the papers' figures come from their own hardware. What
limits the figures: [decision 9](../decisions/0009-fused-torque.md#where-the-figures-end).

`torquectl fit all` calibrates each joint from two separate runs: one unloaded output turn each way, and 150 s of loaded
motion and rest beside a torque sensor with noise. Always on are hysteresis, wind-up, stiffening, friction that depends
on position and load, stiction, friction of the output bearing, and kinematic harmonics that Z does not have. So are
errors of the current's gain and offset, encoder noise and counts, and 0.25 ms of skew between the encoders. Estimates
are causal; nothing is taken off for their delay.

| name | source |
| --- | --- |
| compliance | Z: compliance model (CM) with its low-pass |
| hysteresis | compliance with slipping springs, wind-up, damping, bearing; torsion followed by interacting models |
| deformation | S: piecewise deformation model |
| network | S: back-propagation network, theta by its phase |
| compliance_gp | G: CM (with a short low-pass) and local Gaussian processes (CM-GP) |
| kalman, unscented | U: CM-KF, CM-UKF as reconstructed |
| unscented_added | CM-UKF with torque rate and slow motor torque as states, and the gear of `hysteresis` |
| current | D3: motor current less friction, with friction that grows with the torque |
| fused | all of them, by their variances |

";

const TAIL: &str = "\
## Time

`cargo bench -p estimators` measures the time per estimate; `torquectl estimate` shows it for a joint's own parameters.
";
