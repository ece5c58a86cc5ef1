//! Rules for frames that leave.

use crate::common::Bench;
use control::DriveModel;
use robot_config::slots;
use robot_state::{JointKind, Mode, RobotState, command_flags};

/// The signals' resolution and rounding, in the commands' units; of a prismatic joint m.
const RESOLUTION: f64 = 1.1e-3;
const RESOLUTION_M: f64 = 1e-6;

/// Frames sent to a joint before.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Before {
    /// The set-point, rad.
    q_c: Option<f64>,
    /// Cycles in a row for which it was held, in this fault or none.
    held: u32,
    fault: u32,
}

/// Cycles within which a joint that is held has come to rest: half of pi times 0.2 s from its velocity
/// limit.
const AT_REST: u32 = 350;
/// Share of the velocity limit at which a set-point at rest gives way.
const YIELDS: f64 = 0.03;

impl Before {
    /// A held set-point may lead a joint that is pulled away from it by any angle: it may itself move no
    /// faster than the joint may while it comes to rest, and then only give way.
    fn holds(&self, q_c: f64, velocity: f64) -> bool {
        let share = if self.held < AT_REST { 1.0 } else { YIELDS };
        let step = share * velocity * 1e-3 + 1e-9;
        self.q_c.is_some_and(|last| (q_c - last).abs() <= step)
    }
}

/// Sent frames are those of the record, finite, within limits, and only to engaged joints.
pub(crate) fn check(bench: &Bench, before: &mut [Before]) {
    let record = bench.cycle.record();
    let state = RobotState::from_number(record.state).expect("a state");
    let table = &bench.robot.send;
    let mut values = vec![f64::NAN; slots::send_len(&bench.robot.parameters)];
    for frame in bench.tx.iter() {
        table
            .decode(frame, &mut values)
            .expect("a frame of the robot's");
    }
    for (j, parameters) in bench.robot.parameters.joints.iter().enumerate() {
        let (commanded, limits) = (&record.commanded.joints[j], &parameters.limits);
        let resolution = match parameters.kind {
            JointKind::Revolute => RESOLUTION,
            JointKind::Prismatic => RESOLUTION_M,
        };
        let engaged = commanded.flags & command_flags::ENGAGED != 0;
        let sent = Some(values[slots::command(j)]).filter(|x| !x.is_nan());
        assert!(commanded.q_c.is_finite() && commanded.delta_q.is_finite());
        assert!(commanded.current_c.is_finite());
        let takes_current = !parameters.takes_position();
        if matches!(state, RobotState::Boot) {
            // No current is no set-point.
            let none = sent.is_none() || takes_current && sent == Some(0.0);
            assert!(none, "a set-point in boot");
        }
        let last = std::mem::take(&mut before[j]);
        let Some(sent) = sent else {
            continue;
        };
        let measured = &record.measured.joints[j];
        if !engaged {
            // No current; or its place in a message that an engaged joint needs, and no torque.
            let table = &bench.robot.send;
            let messages = (0..table.message_count()).map(|m| table.slots(m).collect::<Vec<_>>());
            let mut its = messages.filter(|slots| slots.contains(&slots::command(j)));
            let needed = its.any(|slots| {
                let joints = record.commanded.joints.iter().enumerate();
                let mut engaged = joints.filter(|(_, c)| c.flags & command_flags::ENGAGED != 0);
                engaged.any(|(other, _)| slots.contains(&slots::command(other)))
            });
            let profile = parameters.drive_profile.as_ref();
            let off = profile.is_some_and(|profile| profile.control.is_some());
            let harmless = if takes_current {
                sent == 0.0
            } else {
                let q = measured.q.clamp(limits.position_min, limits.position_max);
                // A drive that is about to be enabled is sent where its motor stands.
                let theta = measured.theta / parameters.encoders.gear_ratio;
                let theta = theta.clamp(limits.position_min, limits.position_max);
                let begins = state == RobotState::Enabling && off;
                needed && off && (sent - q).abs() < resolution
                    || begins && (sent - theta).abs() < resolution
            };
            assert!(harmless, "{sent} to joint {j}, which is not engaged");
            continue;
        }
        match parameters.drive_model {
            DriveModel::Position(drive) => {
                assert!((sent - commanded.q_c).abs() < resolution, "{sent}");
                let theta = measured.theta / parameters.encoders.gear_ratio;
                // Inside, or pulled out by a joint that both encoders show outside.
                let reach = limits.lead + parameters.kind.threshold(0.3);
                let low = limits.position_min.min(measured.q.min(theta)) - reach;
                let high = limits.position_max.max(measured.q.max(theta)) + reach;
                assert!((low..=high).contains(&sent), "joint {j}: {sent}");
                // By one encoder at least it asks for no more than the torque limit.
                let dq = measured.dq.abs();
                let lead =
                    |k: f64| (k * limits.torque).min(limits.lead) + drive.k_v * dq + resolution;
                let within = (sent - measured.q).abs() <= lead(drive.k_tau)
                    || (sent - theta).abs() <= lead(drive.k_tau_motor)
                    || (sent - measured.q) * (sent - theta) < 0.0;
                let holds = record.mode == Mode::Hold.number();
                let kept = commanded.flags & command_flags::NOT_FINITE != 0
                    || holds && last.holds(commanded.q_c, limits.velocity);
                // A fault brakes the joint from the velocity at which it then gives way.
                let goes_on = holds && (record.fault == 0 || record.fault == last.fault);
                before[j] = Before {
                    q_c: Some(commanded.q_c),
                    held: if goes_on { last.held + 1 } else { 0 },
                    fault: record.fault,
                };
                assert!(
                    within || kept,
                    "{}, joint {j}: {sent} leads too far: {state:?}, mode {}, q {}, theta {theta}, \
                     {commanded:?} after {last:?}, flags {:#x}",
                    bench.robot.parameters.name,
                    record.mode,
                    measured.q,
                    measured.flags
                );
            }
            DriveModel::Current(drive) => {
                assert!((sent - commanded.current_c).abs() < RESOLUTION, "{sent}");
                let most = drive.current_limit.min(limits.torque / drive.k_1) + RESOLUTION;
                assert!(sent.abs() <= most, "joint {j}: {sent} A");
            }
        }
    }
}
