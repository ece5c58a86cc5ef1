//! The motion from which a drive is identified: planned, checked, and followed through the daemon.

use super::DriveArguments;
use crate::excite::{figure, follow, running, text, urdf_of};
use crate::motion::{by_joint, catch_signals, spinner};
use crate::requests::Failure;
use excitation::{Constant, Kind, Part, Prepared, SelfCheck, supposed};
use identification::drive::chirp::Chirp;
use problem::{Problem, Problems, listed};
use robot_config::{JointParameters, Robot};
use std::path::{Path, PathBuf};
use torqued_client::robot_state::JointKind;

/// Shares of the motion's amplitudes that are tried where the whole motion is refused: a heavy joint
/// leaves less torque for it, one near its limits less room.
const SMALLER: [f64; 3] = [0.7, 0.5, 0.35];
/// Distance that the motion keeps from the position limits, rad; of prismatic joints the way that
/// counts as much.
const MARGIN: f64 = std::f64::consts::PI / 180.0;

/// Plans the motion and shows it; nothing moves.
///
/// # Errors
/// Every reason for which the robot must not follow it.
pub(super) fn dry_run(arguments: &DriveArguments, config: &Path) -> Result<String, Problems> {
    let robot = load(config)?;
    let names = names(&robot);
    let from = by_joint(&names, &arguments.from)?;
    let pose = by_joint(&names, &arguments.pose)?;
    let here = supposed(&robot, &from, &pose);
    let prepared = planned(arguments, config, &here)?;
    Ok(text(
        &prepared,
        arguments.no_self_distance,
        arguments.json,
        None,
    ))
}

/// Moves the joint and has the daemon record it; gives the recording's path, and what was followed.
///
/// # Errors
/// The outer ones: the robot must not follow the motion. The inner ones: it did not.
pub(super) fn record(
    arguments: &DriveArguments,
    config: &Path,
) -> Result<Result<(PathBuf, String), Failure>, Problems> {
    let robot = load(config)?;
    let stop = catch_signals()?;
    let (mut client, here) = match running(arguments.robot.as_ref(), &robot, config) {
        Ok(running) => running,
        Err(failure) => return Ok(Err(failure)),
    };
    let prepared = planned(arguments, config, &here)?;
    let path = match &arguments.record {
        Some(path) => path.clone(),
        None => PathBuf::from(format!("drive-{}.mcap", arguments.joint)),
    };
    let recording = Some((path.as_path(), arguments.force));
    Ok(
        follow(&mut client, &prepared, recording, &stop).and_then(|(done, recording)| {
            let followed = Some((done, recording.as_deref()));
            let text = text(&prepared, arguments.no_self_distance, false, followed);
            if done {
                Ok((path, text))
            } else {
                Err(Failure::Stopped(format!(
                    "{text}stopped on its way; the robot holds"
                )))
            }
        }),
    )
}

fn load(config: &Path) -> Result<Robot, Problems> {
    let config = config.display().to_string();
    robot_config::load(&config, &|path: &str| terminal::read_text(path))
}

fn names(robot: &Robot) -> Vec<(&str, JointKind)> {
    let joints = robot.parameters.joints.iter();
    joints
        .map(|joint| (joint.name.as_str(), joint.kind))
        .collect()
}

/// The largest share of the motion that the robot may follow, from `here`, rad.
fn planned(arguments: &DriveArguments, config: &Path, here: &[f64]) -> Result<Prepared, Problems> {
    let mut prepared = attempt(arguments, config, here, 1.0);
    for share in SMALLER {
        if prepared.is_ok() {
            break;
        }
        prepared = attempt(arguments, config, here, share);
    }
    let prepared = prepared?;
    if let Some(path) = &arguments.plot {
        figure(&prepared).write(path)?;
    }
    Ok(prepared)
}

fn attempt(
    arguments: &DriveArguments,
    config: &Path,
    here: &[f64],
    share: f64,
) -> Result<Prepared, Problems> {
    let robot = load(config)?;
    let names = names(&robot);
    let Some(index) = names.iter().position(|(name, _)| *name == arguments.joint) else {
        let what = format!("--joint: the robot has no joint {:?}", arguments.joint);
        let names = listed(names.into_iter().map(|(name, _)| name));
        return Err(Problem::new(what, names).into());
    };
    let joint = &robot.parameters.joints[index];
    let given = by_joint(&names, &arguments.pose)?;
    let mut pose: Vec<f64> = (given.iter().zip(here))
        .map(|(given, here)| given.unwrap_or(*here))
        .collect();
    let parts = parts(joint, share);
    if given[index].is_none() {
        pose[index] = inward(joint, pose[index], &parts)?;
    }
    let urdf = urdf_of(&robot, arguments.no_self_distance)?;
    let self_check = urdf
        .as_deref()
        .map_or(SelfCheck::LeftOut, |urdf| SelfCheck::Done {
            urdf,
            given: None,
        });
    let bar = spinner();
    let prepared = excitation::prepare(robot, &parts, here, pose, self_check, &mut |text| {
        bar.set_message(text.to_owned());
    });
    bar.finish_and_clear();
    prepared
}

/// The swing and the sweeps of one joint, as parts of a plan.
fn parts(joint: &JointParameters, share: f64) -> Vec<Part> {
    let chirp = Chirp::of_joint(joint.kind, joint.limits.velocity, joint.acceleration());
    let parts = chirp.parts().into_iter().map(|part| {
        let [from, to] = part.frequencies;
        let plan = Part {
            duration_s: Some(part.duration),
            ..Part::of(Kind::Chirp, vec![joint.name.clone()])
        };
        let plan = plan.with_amplitude(joint.kind, share * part.amplitude);
        match part.power {
            0 => Part {
                kind: Kind::GrowingSine,
                frequency_hz: Some(from),
                ..plan
            },
            power => Part {
                from_hz: Some(from),
                to_hz: Some(to),
                constant: Some(match power {
                    1 => Constant::Velocity,
                    _ => Constant::Acceleration,
                }),
                ..plan
            },
        }
    });
    parts.collect()
}

/// The middle of the motion, rad or m: where the joint is, or as far inwards as the motion needs.
fn inward(joint: &JointParameters, here: f64, parts: &[Part]) -> Result<f64, Problem> {
    let kind = joint.kind;
    let reach = parts.iter().filter_map(|part| part.amplitude(kind));
    let reach = reach.fold(0.0, f64::max) + kind.threshold(MARGIN);
    let limits = &joint.limits;
    let (low, high) = (limits.position_min + reach, limits.position_max - reach);
    if low > high {
        let range = kind.shown(limits.position_max - limits.position_min);
        let unit = kind.units("deg");
        let what = format!("joint {:?} has a range of {range:.1} {unit}", joint.name);
        let allowed = format!("{:.1} {unit} and more", kind.shown(2.0 * reach));
        return Err(Problem::new(what, allowed));
    }
    Ok(here.clamp(low, high))
}
