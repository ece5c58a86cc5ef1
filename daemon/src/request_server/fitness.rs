//! Decides from its record whether a robot may be tared.

use problem::Problem;
use robot_config::{JointCalibration, Parameters};
use robot_state::{CycleRecord, Event, Mode, Request, SharedRecord, measured_flags};

/// Flags of a source that exclude a tare, and their reasons.
const UNFIT: [(u32, &str); 3] = [
    (measured_flags::NEVER, "has never answered"),
    (measured_flags::STALE, "has sent no sample"),
    (
        measured_flags::SETTLING,
        "is settling: its filters are not yet full",
    ),
];
/// Flags of a sample that the tare passes over.
const BRIDGED: u32 = measured_flags::MISSED | measured_flags::JUMP;

/// Refuses a robot that cannot be tared, with the reason.
pub(super) fn judge(parameters: &Parameters, record: &SharedRecord) -> Result<(), Problem> {
    let cycle = &record.cycle;
    if cycle.fault != 0 {
        let name = Event::from_number(cycle.fault).map_or("unknown", Event::name);
        let reason = format!("fault {} {name} is latched", cycle.fault);
        return Err(Problem::new(
            reason,
            "no fault: mend its cause and acknowledge it",
        ));
    }
    if cycle.mode != Mode::Hold.number() {
        return Err(not_holding(cycle.mode));
    }
    for (what, name, flags) in sources(parameters, record) {
        if let Some((_, why)) = UNFIT.iter().find(|(bit, _)| flags & bit != 0) {
            return Err(Problem::new(format!("{what} {name} {why}"), ""));
        }
    }
    Ok(())
}

/// Refuses a joint that cannot be tared to a known torque, with the reason.
pub(super) fn judge_joint(
    parameters: &Parameters,
    cycle: &CycleRecord,
    asked: &Request,
) -> Result<(), Problem> {
    let place = asked.joint as usize;
    let joint = parameters.joints.get(place);
    let measured = cycle.measured.joints.get(place);
    let (Some(joint), Some(measured)) = (joint, measured) else {
        let what = format!("the robot has no joint of index {place}");
        return Err(Problem::new(
            what,
            format!("below {}", parameters.joints.len()),
        ));
    };
    let limit = joint.limits.torque;
    let known = asked.torque.abs() <= limit && asked.sigma > 0.0 && asked.sigma <= limit;
    let unit = joint.kind.units("N·m");
    if !known {
        let what = format!(
            "{} {unit} within {} is no torque that is known",
            asked.torque, asked.sigma
        );
        let allowed = format!("at most {limit} {unit}, and a standard deviation above 0");
        return Err(Problem::new(what, allowed));
    }
    if !(joint.calibration.as_ref()).is_some_and(JointCalibration::has_gear) {
        let what = format!(
            "joint {} has no calibrated gear whose zero could be moved",
            joint.name
        );
        return Err(Problem::new(
            what,
            "a joint with `calibration`, a joint file with [hysteresis]",
        ));
    }
    if cycle.mode != Mode::Hold.number() {
        return Err(not_holding(cycle.mode));
    }
    if let Some((_, why)) = UNFIT.iter().find(|(bit, _)| measured.flags & bit != 0) {
        return Err(Problem::new(format!("joint {} {why}", joint.name), ""));
    }
    let rest = joint.limits.rest;
    if measured.dq.abs() > rest {
        let unit = joint.kind.units("rad/s");
        let what = format!("joint {} moves at {:.3} {unit}", joint.name, measured.dq);
        return Err(Problem::new(what, format!("below {rest}")));
    }
    Ok(())
}

/// True if every source has sent a sample in this cycle.
pub(super) fn whole(parameters: &Parameters, record: &SharedRecord) -> bool {
    sources(parameters, record).all(|(_, _, flags)| flags & BRIDGED == 0)
}

pub(super) fn not_holding(mode: u32) -> Problem {
    let name = Mode::from_number(mode).map_or("unknown", Mode::name);
    let reason = format!("the robot is in mode {name}");
    Problem::new(reason, "mode hold, so that it stays where it is")
}

fn sources<'a>(
    parameters: &'a Parameters,
    record: &'a SharedRecord,
) -> impl Iterator<Item = (&'static str, &'a str, u32)> {
    let cycle = &record.cycle;
    let joints = parameters.joints.iter().zip(&cycle.measured.joints);
    let joints = joints.map(|(j, seen)| ("joint", j.name.as_str(), seen.flags));
    let sensors = parameters.ft_sensors.iter().zip(&cycle.measured.ft);
    let sensors = sensors.map(|(s, seen)| ("F/T sensor", s.sensor.name.as_str(), seen.flags));
    let imu = parameters.imus.iter().take(1);
    let imu = imu.map(|imu| ("IMU", imu.frame.as_str(), cycle.measured.imu.flags));
    joints.chain(sensors).chain(imu)
}
