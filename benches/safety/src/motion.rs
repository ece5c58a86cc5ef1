//! How the joints truly move.

use robot_state::EVENT_COUNT;
use serde::Serialize;

use crate::rig::Rig;

/// Cycles over which a torque step is taken: a drive's loops need some milliseconds to follow one.
pub(crate) const STEP_CYCLES: usize = 5;

/// Motion of the joints, the worst of them. Of a prismatic joint 0.1 m counts as much as a radian.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Moved {
    /// Greatest speed, rad/s.
    pub speed: f64,
    /// Greatest share of a joint's velocity limit, 1.
    pub speed_share: f64,
    /// The same of the velocity limit of modes in which nothing but a torque holds the joint, 1.
    pub torque_speed_share: f64,
    /// Greatest displacement, rad.
    pub displacement: f64,
    /// Greatest change of the true torque within 5 ms that the run without the fault does not have at
    /// that time, share of the joint's limit, 1.
    pub step_share: f64,
}

/// The same robot, state and time without a fault.
#[derive(Debug, Clone)]
pub struct Reference {
    pub(crate) events: Vec<[u64; EVENT_COUNT]>,
    /// Least and greatest q of each joint, and greatest |dq|.
    pub(crate) range: Vec<(f64, f64, f64)>,
    /// True torques in each cycle, N·m, from the one before the first on.
    pub(crate) taus: Vec<Vec<f64>>,
    /// Its motion without a client.
    pub moved: Moved,
}

/// Follows the joints from the fault on.
pub(crate) struct Motion<'a> {
    /// Least and greatest q that count as commanded, and |dq|.
    pub(crate) range: Vec<(f64, f64, f64)>,
    pub(crate) taus: Vec<Vec<f64>>,
    pub(crate) moved: Moved,
    limits: Vec<JointLimits>,
    reference: Option<&'a Reference>,
}

struct JointLimits {
    velocity: f64,
    torque_velocity: f64,
    torque: f64,
    /// rad or m that count as 1 rad.
    unit: f64,
}

impl<'a> Motion<'a> {
    pub(crate) fn of(rig: &Rig, reference: Option<&'a Reference>) -> Self {
        let joints = &rig.plant.truth().joints;
        let here = joints.iter().map(|j| (j.q, j.q, 0.0)).collect();
        let limits = rig.robot.parameters.joints.iter();
        Self {
            range: reference.map_or(here, |reference| reference.range.clone()),
            taus: vec![joints.iter().map(|j| j.tau).collect()],
            moved: Moved::default(),
            limits: limits
                .map(|j| JointLimits {
                    velocity: j.limits.velocity,
                    torque_velocity: j.torque_velocity,
                    torque: j.limits.torque,
                    unit: j.kind.threshold(1.0),
                })
                .collect(),
            reference,
        }
    }

    pub(crate) fn take(&mut self, rig: &Rig) {
        let joints = &rig.plant.truth().joints;
        for (j, joint) in joints.iter().enumerate() {
            let limits = &self.limits[j];
            let (low, high, speed) = self.range[j];
            let beyond = (low - joint.q).max(joint.q - high).max(0.0);
            let faster = (joint.dq.abs() - speed).max(0.0);
            let step = self.step(j, joint.tau);
            let moved = &mut self.moved;
            let most = |most: &mut f64, x: f64| *most = most.max(x);
            most(&mut moved.displacement, beyond / limits.unit);
            most(&mut moved.speed, faster / limits.unit);
            most(&mut moved.speed_share, faster / limits.velocity);
            most(
                &mut moved.torque_speed_share,
                faster / limits.torque_velocity,
            );
            most(&mut moved.step_share, step / limits.torque);
        }
        self.taus.push(joints.iter().map(|j| j.tau).collect());
    }

    /// Change of a torque over the last cycles, beyond what it does without the fault: a robot that
    /// is stopped does not make the steps that it would have made, nor the other way round.
    fn step(&self, joint: usize, tau: f64) -> f64 {
        let now = self.taus.len();
        let before = now.saturating_sub(STEP_CYCLES);
        let change = tau - self.taus[before][joint];
        let without = self.reference.and_then(|reference| {
            let at = |k: usize| reference.taus.get(k).map(|taus| taus[joint]);
            Some(at(now)? - at(before)?)
        });
        change.abs().min((change - without.unwrap_or(0.0)).abs())
    }

    /// From now on, only its own motion counts.
    pub(crate) fn widen(&mut self, rig: &Rig) {
        if self.reference.is_none() {
            for (range, joint) in self.range.iter_mut().zip(&rig.plant.truth().joints) {
                *range = (
                    range.0.min(joint.q),
                    range.1.max(joint.q),
                    joint.dq.abs().max(range.2),
                );
            }
        }
    }
}
