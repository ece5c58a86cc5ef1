//! Drives that err themselves: their own loop, their frames and the daemon see the same, alone and all at once.

use plant::DriveFaults;

use super::{ENABLED, POWER_ON, Place, Scenario, before};
use crate::rig::{Fault, Rig};

const GROUP: &str = "Drives that err themselves";

/// Changes a drive's faults in the first cycle; the second argument is the joint's true motor angle.
fn errs(joint: usize, change: fn(&mut DriveFaults, f64)) -> Fault {
    before(move |rig, k| {
        if k == 0 {
            change_one(rig, joint, change);
        }
    })
}

/// All drives err in one cycle, as of a wrong sign, scale or zero in the configuration of all.
fn all_err(change: fn(&mut DriveFaults, f64)) -> Fault {
    before(move |rig, k| {
        if k == 0 {
            for joint in 0..rig.robot.parameters.joints.len() {
                change_one(rig, joint, change);
            }
        }
    })
}

fn change_one(rig: &mut Rig, joint: usize, change: fn(&mut DriveFaults, f64)) {
    let theta = rig.plant.truth().joints[joint].theta;
    if let Some(faults) = rig.plant.robot_mut().drive_faults(joint) {
        change(faults, theta);
    }
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    vec![
        new(
            "the drive's motor encoder drifts at 0.6 deg/s",
            ENABLED,
            |p: Place| errs(p.joint, |f, _| f.motor.rate = 100.0 * 0.6_f64.to_radians()),
        )
        .of_switched_positions(),
        new(
            "the drive's motor encoder drifts at 6 deg/s",
            ENABLED,
            |p: Place| errs(p.joint, |f, _| f.motor.rate = 100.0 * 6_f64.to_radians()),
        )
        .of_switched_positions(),
        new("the drive's motor encoder is stuck", ENABLED, |p: Place| {
            errs(p.joint, |f, theta| f.motor.stuck = Some(theta))
        })
        .of_switched_positions()
        .physics(),
        new("all drives' motor encoders are stuck", ENABLED, |_| {
            all_err(|f, theta| f.motor.stuck = Some(theta))
        })
        .of_switched_positions()
        .physics(),
        new("one drive goes to 0", ENABLED, |p: Place| {
            errs(p.joint, |f, _| f.set_point.scale = 0.0)
        })
        .of_switched_positions()
        .straying(),
        new("all drives go to 0", ENABLED, |_| {
            all_err(|f, _| f.set_point.scale = 0.0)
        })
        .of_switched_positions()
        .straying(),
        new("all drives mirror their set-points", ENABLED, |_| {
            all_err(|f, _| f.set_point.scale = -1.0)
        })
        .of_switched_positions()
        .straying(),
        new(
            "all drives mirror their set-points from power-on",
            POWER_ON,
            |_| all_err(|f, _| f.set_point.scale = -1.0),
        )
        .of_switched_positions()
        .straying(),
        new(
            "all drives keep targets of their own until enabled",
            POWER_ON,
            |_| all_err(|f, _| f.keeps_target = true),
        )
        .of_switched_positions(),
    ]
}
