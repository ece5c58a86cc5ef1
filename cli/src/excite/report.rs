//! Needs of a plan, as text, JSON and picture.

use crate::units::{cell, keys};
use charts::{COLOURS, Figure, Line, Panel};
use excitation::{Need, Prepared, SPACING_S};
use serde_json::json;
use std::fmt::Write as _;
use terminal::TextTable;
use torqued_client::robot_state::JointKind;

/// Points of a curve at most; a picture shows no more.
const POINTS: usize = 1500;

/// Needs of the plan, and whether it was followed to its end.
pub(crate) fn text(
    prepared: &Prepared,
    no_self_distance: bool,
    as_json: bool,
    followed: Option<(bool, Option<&str>)>,
) -> String {
    if as_json {
        format!("{:#}\n", as_value(prepared, followed))
    } else {
        as_text(prepared, no_self_distance, followed)
    }
}

fn as_value(prepared: &Prepared, followed: Option<(bool, Option<&str>)>) -> serde_json::Value {
    let joints = &prepared.robot.parameters.joints;
    let needs = &prepared.needs;
    let joint = |(joint, need): (&robot_config::JointParameters, &Need)| {
        let object = json!({
            "joint": joint.name,
            "least_rad": need.least, "most_rad": need.most,
            "velocity_share": need.velocity, "acceleration_share": need.acceleration,
            "torque_share": need.torque, "lead_share": need.lead,
        });
        keys(joint.kind, object)
    };
    let distance = needs.distance.as_ref().map(|distance| {
        json!({
            "least_m": distance.least_m, "between": distance.between, "time_s": distance.time_s,
            "not_compared": needs.touching, "without_geometry": needs.without,
        })
    });
    let choices = prepared.motion.choices.iter().map(|choice| {
        json!({
            "part": choice.title, "base_parameters": choice.parameters, "tries": choice.tries,
            "condition_before": choice.before, "condition_after": choice.after,
        })
    });
    let spans = prepared.motion.spans.iter().map(|span| {
        json!({
            "title": span.title,
            "from_s": span.points.start as f64 * SPACING_S,
            "to_s": span.points.end as f64 * SPACING_S,
        })
    });
    json!({
        "robot": prepared.robot.parameters.name,
        "duration_s": prepared.motion.duration(),
        "joints": joints.iter().zip(&needs.joints).map(joint).collect::<Vec<_>>(),
        "self_distance": distance,
        "multisines": choices.collect::<Vec<_>>(),
        "parts": spans.collect::<Vec<_>>(),
        "followed": followed.map(|(done, _)| done),
        "recording": followed.and_then(|(_, recording)| recording),
    })
}

fn as_text(
    prepared: &Prepared,
    no_self_distance: bool,
    followed: Option<(bool, Option<&str>)>,
) -> String {
    let needs = &prepared.needs;
    let mut out = format!(
        "{}: {:.1} s\n",
        prepared.robot.parameters.name,
        prepared.motion.duration()
    );
    let head = [
        "joint",
        "from deg",
        "to",
        "velocity %",
        "acceleration %",
        "torque %",
        "lead %",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for (joint, need) in prepared.robot.parameters.joints.iter().zip(&needs.joints) {
        if need.velocity == 0.0 {
            continue;
        }
        let kind = joint.kind;
        let position = |at: f64| cell(kind, format!("{:.1}", kind.shown(at)), "deg");
        let per_cent = |share: f64| format!("{:.0}", 100.0 * share);
        rows.push(vec![
            joint.name.clone(),
            position(need.least),
            position(need.most),
            per_cent(need.velocity),
            per_cent(need.acceleration),
            per_cent(need.torque),
            per_cent(need.lead),
        ]);
    }
    let _ = write!(out, "{}", TextTable(rows));
    out.push_str("% of each joint's limits; torques with the base held where it is\n");
    for choice in &prepared.motion.choices {
        let _ = writeln!(
            out,
            "{}: condition number {:.0}, before the search {:.0}; {} base parameters, {} tries",
            choice.title, choice.after, choice.before, choice.parameters, choice.tries
        );
    }
    match &needs.distance {
        Some(distance) => {
            let (a, b) = &distance.between;
            let _ = writeln!(
                out,
                "least self-distance: {:.0} mm, {a} and {b} at {:.1} s",
                1e3 * distance.least_m,
                distance.time_s
            );
        }
        None if no_self_distance => out.push_str("self-distance: NOT checked, as asked\n"),
        None => out.push_str("self-distance: no two bodies to compare\n"),
    }
    if !needs.touching.is_empty() {
        let pairs = needs.touching.iter().map(|(a, b)| format!("{a} and {b}"));
        let pairs: Vec<_> = pairs.collect();
        let _ = writeln!(
            out,
            "not compared, as they touch at the start: {}",
            pairs.join("; ")
        );
    }
    if !needs.without.is_empty() {
        let _ = writeln!(
            out,
            "not compared, without geometry: {}",
            needs.without.join(", ")
        );
    }
    if let Some((done, recording)) = followed {
        if done {
            out.push_str("followed to its end; the robot holds\n");
        }
        if let Some(recording) = recording {
            let _ = writeln!(out, "{recording}");
        }
    }
    out
}

/// The unit of a caption in that of prismatic joints.
fn unit(caption: &str) -> String {
    let own = JointKind::Prismatic.units(caption);
    own.rsplit(", ").next().unwrap_or_default().to_owned()
}

/// Positions, velocities and torques of the joints that move.
pub(crate) fn figure(prepared: &Prepared) -> Figure {
    let motion = &prepared.motion;
    let joints = &prepared.robot.parameters.joints;
    let moving: Vec<usize> = (0..joints.len())
        .filter(|&j| prepared.needs.joints[j].velocity > 0.0)
        .collect();
    let step = (motion.len() / POINTS).max(1);
    let mut curves = vec![vec![Vec::new(); moving.len()]; 3];
    prepared.each_torque(step, |t, index, torques| {
        let point = motion.point(index);
        for (k, &j) in moving.iter().enumerate() {
            let at = point[j];
            let kind = joints[j].kind;
            let values = [kind.shown(at.q), kind.shown(at.dq), torques[j]];
            for (curve, value) in curves.iter_mut().zip(values) {
                curve[k].push((t, value));
            }
        }
    });
    let captions = ["position, degrees", "velocity, degrees/s", "torque, N·m"].map(|caption| {
        let kinds = moving.iter().map(|&j| joints[j].kind);
        let prismatic = kinds
            .clone()
            .filter(|kind| *kind == JointKind::Prismatic)
            .count();
        match prismatic {
            0 => caption.to_owned(),
            n if n == moving.len() => JointKind::Prismatic.units(caption).into_owned(),
            _ => format!("{caption} (of prismatic joints {})", unit(caption)),
        }
    });
    let panel = |(caption, curves): (String, Vec<Vec<(f64, f64)>>)| Panel {
        caption,
        x_unit: "s".to_owned(),
        lines: (curves.into_iter().zip(&moving).zip(COLOURS.iter().cycle()))
            .map(|((points, &j), colour)| Line::new(&joints[j].name, *colour, points))
            .collect(),
        ..Panel::default()
    };
    Figure {
        title: format!("Plan of {}", prepared.robot.parameters.name),
        columns: 1,
        panel_size: (760, 190),
        panels: captions.into_iter().zip(curves).map(panel).collect(),
    }
}
