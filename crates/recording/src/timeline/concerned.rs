//! The joints that an event is about, by what the record of its cycle shows of them.

use robot_state::{
    CycleRecord, DriveState, Event, command_flags as limits, measured_flags as flags,
};

use super::SUBJECT_IS_JOINT;

/// The joints of an event that was counted in `now`; `last`: the record before. None where the event is about
/// none, or the record does not show which.
pub(super) fn joints<'r>(
    event: Event,
    now: &'r CycleRecord,
    last: &'r CycleRecord,
) -> impl Iterator<Item = usize> + 'r {
    (0..now.joint_count as usize).filter(move |&j| concerns(event, j, now, last))
}

fn concerns(event: Event, j: usize, now: &CycleRecord, last: &CycleRecord) -> bool {
    let (Some(measured), Some(estimated), Some(commanded), Some(before)) = (
        now.measured.joints.get(j),
        now.estimated.joints.get(j),
        now.commanded.joints.get(j),
        last.commanded.joints.get(j),
    ) else {
        return false;
    };
    let shows = |bits: u32| measured.flags & bits != 0;
    let limited = |bits: u32| commanded.flags & bits != 0;
    let state = |state: DriveState| commanded.drive_state == state.number();
    let latched = now.fault == event.number() && now.fault != last.fault;
    let by_fault = latched && now.fault_subject == SUBJECT_IS_JOINT << 16 | j as u32;
    let warned =
        now.estimated.warning == event.number() && now.estimated.warning_subject as usize == j;
    by_fault
        || match event {
            Event::JointMissed => shows(flags::MISSED),
            Event::JointStale => shows(flags::STALE),
            Event::EncoderJump => shows(flags::JUMP),
            Event::EncoderImplausible => shows(flags::IMPLAUSIBLE),
            Event::CurrentImplausible => shows(flags::FLAT | flags::SATURATED),
            Event::ExternalContact => estimated.contact_flag == 1,
            Event::EncoderSlip | Event::TorqueConstant | Event::TorqueSign => warned,
            Event::PositionLimit => limited(limits::POSITION_LIMITED),
            Event::TorqueLimit => {
                let rate = limited(limits::TORQUE_RATE_LIMITED) && !limited(limits::RATE_TRIMMED);
                rate || limited(limits::TORQUE_LIMITED | limits::LEAD_LIMITED)
            }
            Event::VelocityLimit => limited(limits::VELOCITY_LIMITED | limits::POWER_LIMITED),
            Event::CommandNotFinite => limited(limits::NOT_FINITE),
            Event::DriveFault => state(DriveState::Fault),
            Event::DriveLost => {
                before.drive_state == DriveState::Enabled.number() && !state(DriveState::Enabled)
            }
            _ => false,
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_names_the_joints_whose_flags_show_it() {
        let last = CycleRecord {
            joint_count: 3,
            ..CycleRecord::default()
        };
        let mut now = last;
        now.measured.joints[1].flags = flags::JUMP;
        now.commanded.joints[0].flags = limits::TORQUE_RATE_LIMITED | limits::RATE_TRIMMED;
        now.commanded.joints[2].flags = limits::TORQUE_RATE_LIMITED;
        now.estimated.warning = Event::TorqueSign.number();
        now.estimated.warning_subject = 2;
        let of = |event| joints(event, &now, &last).collect::<Vec<_>>();
        assert_eq!(of(Event::EncoderJump), [1]);
        assert_eq!(of(Event::TorqueLimit), [2], "noise is no event");
        assert_eq!(of(Event::TorqueSign), [2]);
        assert!(of(Event::TorqueConstant).is_empty());
        assert!(of(Event::LateCycle).is_empty());
    }

    #[test]
    fn a_fault_names_its_joint_where_no_flag_does() {
        let mut now = CycleRecord {
            joint_count: 3,
            ..CycleRecord::default()
        };
        let last = now;
        now.fault = Event::FollowingDoubtful.number();
        now.fault_subject = SUBJECT_IS_JOINT << 16 | 1;
        let of = |last| joints(Event::FollowingDoubtful, &now, last).collect::<Vec<_>>();
        assert_eq!(of(&last), [1]);
        assert!(of(&now).is_empty(), "only in the cycle that latched it");
    }
}
