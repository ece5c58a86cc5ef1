//! The preview of a motion to a target: planned without a robot, by the limits of a configuration.

use super::{MoveArguments, by_joint, in_si, within};
use charts::{COLOURS, Figure, Line, Panel};
use control::{MotionLimits, PlannedMotion, PointToPoint};
use problem::{Problem, Problems};
use robot_config::JointParameters;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use torqued_client::robot_state::JointKind;

/// A joint of the preview.
struct Way<'a> {
    joint: &'a JointParameters,
    from: f64,
    to: f64,
    limits: MotionLimits,
}

/// Plans the way and writes what is asked for; its text.
///
/// # Errors
/// A configuration or targets that are bad, a file that cannot be written.
pub(super) fn preview(config: &Path, arguments: &MoveArguments) -> Result<String, Problems> {
    let read = |path: &str| terminal::read_text(path);
    let robot = robot_config::load(&config.display().to_string(), &read)?;
    let parameters = &robot.parameters;
    let names = parameters.joints.iter().map(|j| (j.name.as_str(), j.kind));
    let names: Vec<_> = names.collect();
    let (from, to) = (
        by_joint(&names, &arguments.from)?,
        by_joint(&names, &arguments.targets)?,
    );
    let joints = parameters.joints.iter().zip(parameters.motion_limits());
    let ways: Vec<Way> = joints
        .zip(from.into_iter().zip(to))
        .map(|((joint, limits), (from, to))| {
            let limits = limits.no_faster(in_si(arguments.speed, joint.kind));
            let range = joint.limits.position_min..=joint.limits.position_max;
            let from = from.unwrap_or_else(|| 0.0f64.clamp(*range.start(), *range.end()));
            let to = to.unwrap_or(from);
            within((&joint.name, joint.kind), to, range)?;
            Ok(Way {
                joint,
                from,
                to,
                limits,
            })
        })
        .collect::<Result<_, Problem>>()?;
    let (duration, samples) = plan(&ways, parameters.timing.sample_period)?;
    if let Some(path) = &arguments.output {
        let text = csv(&ways, parameters.timing.sample_period, &samples);
        terminal::write_file(path, &text)?;
    }
    if let Some(path) = &arguments.plot {
        figure(&ways, parameters.timing.sample_period, &samples).write(path)?;
    }
    if !arguments.json {
        return Ok(format!("{duration:.3} s\n"));
    }
    let joint = |way: &Way| {
        let object = json!({
            "joint": way.joint.name, "from_rad": way.from, "to_rad": way.to,
            "velocity_rad_per_s": way.limits.velocity,
            "acceleration_rad_per_s2": way.limits.acceleration,
            "jerk_rad_per_s3": way.limits.jerk,
        });
        crate::units::keys(way.joint.kind, object)
    };
    let joints = Value::from(ways.iter().map(joint).collect::<Vec<_>>());
    Ok(format!(
        "{:#}\n",
        json!({ "duration_s": duration, "joints": joints })
    ))
}

/// Duration, s, and the joints in every period.
fn plan(ways: &[Way], period: f64) -> Result<(f64, Vec<Vec<PlannedMotion>>), Problem> {
    let mut motion = PointToPoint::new(ways.len());
    motion.start(ways.iter().map(|way| PlannedMotion {
        q: way.from,
        ..PlannedMotion::default()
    }));
    let mut samples = vec![motion.advance(period).to_vec()];
    if !motion.go_to(ways.iter().map(|way| (way.to, way.limits))) {
        return Err(Problem::new(
            "there is no such motion",
            "a speed that is not so low",
        ));
    }
    let duration = motion.left_s();
    while motion.left_s() > 0.0 {
        samples.push(motion.advance(period).to_vec());
    }
    Ok((duration, samples))
}

fn csv(ways: &[Way], period: f64, samples: &[Vec<PlannedMotion>]) -> String {
    let mut text = "t".to_owned();
    for way in ways {
        let name = &way.joint.name;
        let _ = write!(text, ",{name}.q,{name}.dq,{name}.ddq");
    }
    for (k, joints) in samples.iter().enumerate() {
        let _ = write!(text, "\n{}", k as f64 * period);
        for PlannedMotion { q, dq, ddq } in joints {
            let _ = write!(text, ",{q},{dq},{ddq}");
        }
    }
    text + "\n"
}

fn figure(ways: &[Way], period: f64, samples: &[Vec<PlannedMotion>]) -> Figure {
    let moving = || {
        ways.iter()
            .enumerate()
            .filter(|(_, way)| way.from != way.to)
    };
    let panel = |caption: &str, value: fn(&PlannedMotion) -> f64| Panel {
        caption: caption.to_owned(),
        x_unit: "s".to_owned(),
        lines: moving()
            .zip(COLOURS.iter().cycle())
            .map(|((j, way), colour)| {
                let points = samples.iter().enumerate();
                let kind = way.joint.kind;
                let points = points.map(|(k, at)| (k as f64 * period, kind.shown(value(&at[j]))));
                let name = match kind {
                    JointKind::Revolute => way.joint.name.clone(),
                    JointKind::Prismatic => format!("{}, mm", way.joint.name),
                };
                Line::new(&name, *colour, points.collect())
            })
            .collect(),
        ..Panel::default()
    };
    Figure {
        title: "Planned motion".to_owned(),
        columns: 1,
        panel_size: (700, 200),
        panels: vec![
            panel("position, degrees", |m| m.q),
            panel("velocity, degrees/s", |m| m.dq),
            panel("acceleration, degrees/s²", |m| m.ddq),
        ],
    }
}
