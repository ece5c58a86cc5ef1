//! Velocity: the joints follow `dq_d` of the client, by inverse dynamics.
//!
//! Velocities may come at any pace, as from a joystick or a servo node: the loop leads to them within the limits of
//! acceleration and jerk, and brakes before position limits (K). A joint that something holds back is waited for: the
//! desired position leads it by no more than what makes [`LEAD_SHARE`] of its torque limit, so that its spring is not
//! stretched ever further.

use control::{PlannedMotion, VelocityPlanner, VelocityStream};
use robot_config::{JointParameters, Robot};
use robot_state::{Mode, Reference};

use super::{Asked, Bounds, ClientMode, Made, ModeCycle, Unfit};

/// For rounding of velocities that are meant to be the limit: as `ROUNDING` of crates/control/src/trajectory.rs.
const ROUNDING: f64 = 1.001;

/// Torque of the spring towards the desired position, of the limit, from which on a joint is waited for: an unknown
/// payload of that much is still moved. Chosen; no experiment recorded.
const LEAD_SHARE: f64 = 0.3;

#[derive(Debug)]
struct Velocity {
    joints: Vec<VelocityStream>,
    /// Desired position of each joint in the last cycle, rad, and by how much it may lead the joint.
    desired: Vec<f64>,
    lead: Vec<f64>,
    /// Greatest velocity of each joint, rad/s.
    most: Vec<f64>,
    planner: VelocityPlanner,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    let joints = p.joints.iter().zip(p.motion_limits());
    let joints = joints.map(|(joint, limits)| VelocityStream::new(limits, joint.desired_range()));
    let lead = |joint: &JointParameters| LEAD_SHARE * joint.limits.torque / joint.gains.k_s;
    Ok(Some(Box::new(Velocity {
        joints: joints.collect(),
        desired: vec![0.0; p.joints.len()],
        lead: p.joints.iter().map(lead).collect(),
        most: p.joints.iter().map(|joint| joint.limits.velocity).collect(),
        planner: VelocityPlanner::new(),
    })))
}

impl ClientMode for Velocity {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        let mut joints = self.most.iter().zip(&reference.joints);
        bounds.softened(reference)
            && joints.all(|(most, asked)| asked.dq_d.abs() <= most * ROUNDING)
    }

    /// Nothing but the velocity is followed, and that is led to.
    fn paces(&self, _: &Reference, _: usize) -> bool {
        false
    }

    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, seen) = (cycle.asked, cycle.seen);
        let mut reference = *asked.reference;
        let joints = self
            .joints
            .iter_mut()
            .zip(&mut self.desired)
            .zip(&self.lead);
        let records = reference.joints.iter_mut().zip(&seen.measured.joints);
        for (((joint, before), lead), (wanted, measured)) in joints.zip(records) {
            if asked.begins {
                joint.start(PlannedMotion {
                    q: measured.q,
                    dq: measured.dq,
                    ddq: 0.0,
                });
                *before = measured.q;
            }
            let ahead = *before - measured.q;
            let is_held_back = ahead * wanted.dq_d > 0.0 && ahead.abs() > *lead;
            let velocity = if is_held_back { 0.0 } else { wanted.dq_d };
            let next = joint.advance(&mut self.planner, velocity, seen.dt);
            (wanted.q_d, wanted.dq_d, wanted.ddq_d) = (next.q, next.dq, next.ddq);
            *before = next.q;
        }
        reference.contact_wrench_given = 0;
        cycle.body.follow(&reference, seen);
        let planned = Asked::planned(&reference);
        cycle.track(Mode::Velocity, &planned, |_, follow| follow);
        Ok(())
    }
}
