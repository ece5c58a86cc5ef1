//! Report of the identification, as text, as a table of friction and as JSON.

use identification::inertia::base::{BaseParameter, unit, words};
use identification::inertia::judge::{Judged, Model};
use identification::inertia::{Calibration, Robot, consistent};
use serde_json::{Value, json};
use std::fmt::Write as _;
use terminal::TextTable;

/// Base parameters that the text lists at most.
const LISTED: usize = 12;

/// The report as text.
pub(super) fn text(robot: &Robot<'_>, found: &Calibration, written: &[String]) -> String {
    let mut out = summary(robot, found).join("\n");
    let _ = write!(out, "\n\n{}", accuracy(robot, &found.judged, "held out"));
    if !found.judged_on_others.is_empty() {
        let _ = write!(
            out,
            "\n{}",
            accuracy(robot, &found.judged_on_others, "other logs")
        );
    }
    for line in remarks(robot, found) {
        let _ = writeln!(out, "{line}");
    }
    let _ = write!(out, "\n{}\n", friction_lines(robot, found).join("\n"));
    let _ = writeln!(out, "\n{}", base_lines(robot, found).join("\n"));
    for line in &found.notes {
        let _ = writeln!(out, "note: {line}");
    }
    if !written.is_empty() {
        let _ = writeln!(out, "\nwritten: {}", written.join(", "));
    }
    out
}

/// Robot, logs and filters.
pub(super) fn summary(robot: &Robot<'_>, found: &Calibration) -> Vec<String> {
    let still: Vec<&str> = (0..robot.measured.len())
        .filter(|&k| !found.motion.moves[k])
        .map(|k| robot.name(k))
        .collect();
    let mut lines = vec![
        format!(
            "{}: {} joints; {:.1} s at {:.0} Hz, {} rows a joint",
            robot.model.name(),
            robot.measured.len(),
            found.duration,
            found.rate,
            found.rows
        ),
        format!(
            "torques and regressor low-passed alike, zero-phase, half at {:.1} Hz; motion from {}, smoothed below {:.1} Hz",
            found.sampling.cut_off,
            found.smoothing.source.words(),
            found.smoothing.cut_off
        ),
        if found.guessed_prior {
            "the URDF has no masses: the prior is a guess (2 kg a link), so single links' values mean little; torques do".to_owned()
        } else {
            format!(
                "weight of the URDF's inertias, by inner held-out blocks: {:e}",
                found.lambda
            )
        },
    ];
    if !still.is_empty() {
        lines.push(format!(
            "joints that do not move, whose friction is not determined: {}",
            still.join(", ")
        ));
    }
    lines
}

/// Table of RMS on held-out quarters.
fn accuracy(robot: &Robot<'_>, judged: &[Judged], of: &str) -> String {
    let head = [
        &format!("{of}, RMS N·m (N)"),
        "torque",
        "URDF",
        "plain LS",
        "base",
        "identified",
        "95 %",
        "of largest",
        "in motion",
        "unfiltered",
        "over sigma",
    ];
    let mut table = vec![head.map(str::to_owned).to_vec()];
    for (k, judged) in judged.iter().enumerate() {
        let (low, high) = judged.interval(Model::Identified);
        let row = [
            robot.name(k).to_owned(),
            format!("{:.3}", judged.torque()),
            format!("{:.3}", judged.residual(Model::Urdf)),
            format!("{:.3}", judged.residual(Model::Plain)),
            format!("{:.3}", judged.residual(Model::Base)),
            format!("{:.3}", judged.residual(Model::Identified)),
            format!("{low:.3} to {high:.3}"),
            format!(
                "{:.2} %",
                100.0 * judged.residual(Model::Identified) / judged.largest().max(1e-12)
            ),
            judged.in_motion_and_at_rest(Model::Identified)[0]
                .map_or("-".to_owned(), |rms| format!("{rms:.3}")),
            format!("{:.3}", judged.raw_residual(Model::Identified)),
            format!("{:.2}", judged.sigma_check()),
        ];
        table.push(row.to_vec());
    }
    TextTable(table).to_string()
}

/// Joints on which the URDF or the unbounded solution is better, and whether sigma is right.
pub(super) fn remarks(robot: &Robot<'_>, found: &Calibration) -> Vec<String> {
    let mut lines = Vec::new();
    if found.urdf_kept {
        lines.push("The URDF's inertias predict held-out quarters better than identified ones: they are kept, friction alone is new.".to_owned());
    }
    lines.extend(
        found
            .contradictions
            .iter()
            .map(|c| format!("contradicts the URDF: {c}")),
    );
    lines.extend(found.verdicts.iter().cloned());
    let (mut loss, mut joints) = (0.0, 0.0);
    for (k, judged) in found.judged.iter().enumerate() {
        let name = robot.name(k);
        let (difference, half) = judged.against_urdf();
        let [urdf, identified] = [Model::Urdf, Model::Identified].map(|m| judged.residual(m));
        if identified > urdf && !found.urdf_kept {
            let sure = if difference > half {
                ""
            } else {
                " (within the blocks' scatter)"
            };
            lines.push(format!(
                "{name}: the URDF is better by {:.1} %{sure}",
                100.0 * (identified / urdf - 1.0)
            ));
        }
        loss += (identified / judged.residual(Model::Base).max(1e-12)).ln();
        joints += 1.0;
    }
    let loss = 100.0 * (f64::exp(loss / f64::max(joints, 1.0)) - 1.0);
    lines.push(format!(
        "links that can exist, against base parameters without bounds: residual {} by {:.1} % on held-out quarters",
        if loss >= 0.0 { "larger" } else { "smaller" },
        loss.abs()
    ));
    lines
}

/// Friction of each joint.
pub(super) fn friction_lines(robot: &Robot<'_>, found: &Calibration) -> Vec<String> {
    let mut lines = vec!["friction and drive, N·m (N) with dq in rad/s (m/s):".to_owned()];
    for (k, friction) in found.friction.iter().enumerate() {
        let term = |(term, value): &(identification::inertia::friction::Term, f64)| {
            format!("{} {value:.4}", term.name())
        };
        let terms: Vec<String> = friction.terms.iter().map(term).collect();
        lines.push(format!("  {}: {}", robot.name(k), terms.join(", ")));
    }
    lines
}

/// A combination in words: `mass of a + 0.3 mass of b`.
fn combination(robot: &Robot<'_>, parameter: &BaseParameter) -> String {
    let mut out = String::new();
    for (k, (place, factor)) in parameter.parts.iter().enumerate() {
        if k == 3 && parameter.parts.len() > 4 {
            let _ = write!(out, " and {} more", parameter.parts.len() - 3);
            break;
        }
        let name = words(robot, *place);
        let _ = match (k, factor) {
            (0, _) => write!(out, "{name}"),
            (_, f) if *f < 0.0 => write!(out, " - {:.3} {name}", -f),
            (_, f) => write!(out, " + {f:.3} {name}"),
        };
    }
    out
}

/// Number of base parameters, condition, and what is not determined, with the likely reason.
pub(super) fn base_lines(robot: &Robot<'_>, found: &Calibration) -> Vec<String> {
    let (all, loose): (usize, Vec<&BaseParameter>) = (
        found.base_parameters.len(),
        found
            .base_parameters
            .iter()
            .filter(|p| !p.determined)
            .collect(),
    );
    let mut lines = vec![format!(
        "base parameters: the torques depend on {all} sums of {} link parameters, {} others have no effect; condition number {:.0}",
        10 * robot.bodies - found.base.without_effect.len(),
        found.base.without_effect.len(),
        found.condition
    )];
    if loose.is_empty() {
        lines.push("every base parameter is determined by these logs".to_owned());
        return lines;
    }
    lines.push(format!(
        "{} of them these logs hardly determine (the written URDF stays near its own values there):",
        loose.len()
    ));
    for parameter in loose.iter().take(LISTED) {
        let place = parameter.parts[0].0;
        lines.push(format!(
            "  {}: {:.4} ± {:.4} {}; {}",
            combination(robot, parameter),
            parameter.value,
            parameter.half_interval,
            unit(place),
            reason(robot, found, place)
        ));
    }
    if loose.len() > LISTED {
        lines.push(format!(
            "  and {} more, in inertia.json",
            loose.len() - LISTED
        ));
    }
    lines
}

/// Why a parameter is not determined: the motion that would show it.
fn reason(robot: &Robot<'_>, found: &Calibration, place: usize) -> String {
    let body = place / 10;
    let carrying: Vec<usize> = (0..robot.measured.len())
        .filter(|&k| robot.carried[k].contains(&body))
        .collect();
    let still: Vec<&str> = carrying
        .iter()
        .filter(|&&k| !found.motion.moves[k])
        .map(|&k| robot.name(k))
        .collect();
    let Some(&own) = carrying.last() else {
        return "no joint carries it".to_owned();
    };
    match place % 10 {
        _ if !still.is_empty() => format!("move {}", still.join(", ")),
        0..=3 => format!(
            "other poses and larger ways of {} would show it",
            robot.name(own)
        ),
        _ => format!(
            "faster changes of speed would show it: {} reaches {:.1} {}",
            robot.name(own),
            found.motion.acceleration[own],
            if robot.unit(own) == "N" {
                "m/s²"
            } else {
                "rad/s²"
            }
        ),
    }
}

/// Coefficients by joint and term, with the formulas.
pub(super) fn friction(robot: &Robot<'_>, found: &Calibration) -> String {
    let mut out = "joint,term,coefficient,factor,v,sigma\n".to_owned();
    for (k, friction) in found.friction.iter().enumerate() {
        for (term, value) in &friction.terms {
            let _ = writeln!(
                out,
                "{},{},{value},\"{}\",{},{}",
                robot.name(k),
                term.name(),
                term.formula(),
                friction.speed,
                friction.sigma
            );
        }
    }
    out
}

fn judged(judged: &Judged) -> Value {
    let model = |model: Model| {
        let (low, high) = judged.interval(model);
        json!({
            "rms": judged.residual(model), "interval_95": [low, high],
            "quarters": judged.quarters(model), "rms_unfiltered": judged.raw_residual(model),
            "rms_in_motion": judged.in_motion_and_at_rest(model)[0], "rms_at_rest": judged.in_motion_and_at_rest(model)[1],
        })
    };
    json!({
        "torque_rms": judged.torque(), "torque_largest": judged.largest(),
        "urdf": model(Model::Urdf), "plain_least_squares": model(Model::Plain),
        "base": model(Model::Base), "identified": model(Model::Identified),
        "rms_over_sigma": judged.sigma_check(),
    })
}

/// Everything as JSON.
pub(super) fn json(robot: &Robot<'_>, found: &Calibration, written: &[String]) -> Value {
    let joint = |k: usize| {
        let friction = &found.friction[k];
        let terms: Vec<Value> = friction
            .terms
            .iter()
            .map(|(term, value)| json!({"term": term.name(), "coefficient": value, "factor": term.formula()}))
            .collect();
        let (low, high) = found.motion.range[k];
        json!({
            "joint": robot.name(k), "unit": robot.unit(k), "held_out": judged(&found.judged[k]),
            "friction": {"terms": terms, "v": friction.speed, "smooth_sign": "s = tanh(dq / (0.02 v))", "sigma": friction.sigma},
            "other_logs": found.judged_on_others.get(k).map(judged),
            "motion": {"moves": found.motion.moves[k], "from": low, "to": high, "speed": found.motion.speed[k], "acceleration": found.motion.acceleration[k]},
        })
    };
    let link = |(name, i): (String, dynamics::Inertia)| {
        let (c, inertia) = (i.center(), i.central());
        json!({
            "link": name, "mass": i.mass, "centre": [c.x, c.y, c.z],
            "inertia_xx_xy_xz_yy_yz_zz": [inertia[(0, 0)], inertia[(0, 1)], inertia[(0, 2)], inertia[(1, 1)], inertia[(1, 2)], inertia[(2, 2)]],
        })
    };
    let base = |p: &BaseParameter| {
        let parts: Vec<Value> = p
            .parts
            .iter()
            .map(|(place, factor)| json!([words(robot, *place), factor]))
            .collect();
        json!({
            "sum_of": parts, "unit": unit(p.parts[0].0), "urdf": p.urdf, "value": p.value,
            "half_interval_95": p.half_interval, "determined": p.determined,
        })
    };
    json!({
        "robot": robot.model.name(),
        "duration_s": found.duration, "rate_hz": found.rate, "rows": found.rows,
        "low_pass_hz": found.sampling.cut_off, "smoothing_hz": found.smoothing.cut_off,
        "motion_from": found.smoothing.source.words(),
        "prior_weight": found.lambda, "prior_guessed": found.guessed_prior, "urdf_kept": found.urdf_kept,
        "condition_number": found.condition,
        "joints": (0..found.friction.len()).map(joint).collect::<Vec<_>>(),
        "links": consistent::of_links(robot, &found.inertias).into_iter().map(link).collect::<Vec<_>>(),
        "base_parameters": found.base_parameters.iter().map(base).collect::<Vec<_>>(),
        "without_effect": found.base.without_effect.iter().map(|p| words(robot, *p)).collect::<Vec<_>>(),
        "contradictions": found.contradictions, "verdicts": found.verdicts,
        "remarks": remarks(robot, found), "notes": found.notes, "written": written,
    })
}
