//! Decides from its record whether a robot may be tared.

use problem::Problem;
use robot_config::Parameters;
use robot_state::{Event, Mode, SharedRecord, measured_flags};

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
    let imu = parameters.imu.iter();
    let imu = imu.map(|imu| ("IMU", imu.frame.as_str(), cycle.measured.imu.flags));
    joints.chain(sensors).chain(imu)
}
