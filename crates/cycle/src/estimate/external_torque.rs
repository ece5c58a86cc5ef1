//! External torque: joint torques of the environment apart from the declared contacts.
//!
//! In: joint motion, torque from encoders, contact wrenches that the F/T sensors determine. Out:
//! `tau_ext` and a contact flag for each joint, by a generalised-momentum observer.

use dynamics::Force;
use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{ExternalTorqueSettings, Robot};
use robot_state::{Event, JointEstimated, JointMeasured};
use whole_body::{MomentumObserver, MomentumObserverParameters, WholeBody};

use super::usable::UNUSABLE;
use crate::events::{Counts, Subject};

/// The observer of all joints; its inputs all have the delay of the long filters.
#[derive(Debug)]
pub(crate) struct ExternalTorque {
    observer: MomentumObserver,
    /// Delays the torque from encoders like the other inputs.
    filter: FilterBank,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    newest: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    tau: Vec<f64>,
    forces: Vec<Force>,
    /// Contact flags of the cycle before.
    contact_flags: Vec<bool>,
}

impl ExternalTorque {
    pub(crate) fn new(robot: &Robot, settings: &ExternalTorqueSettings) -> Result<Self, Problem> {
        let p = &robot.parameters;
        let (n, joints) = (robot.model.joint_count(), p.joints.len());
        let mut threshold = vec![f64::INFINITY; n];
        for joint in &p.joints {
            threshold[joint.model_index] = settings.threshold_share * joint.limits.torque;
        }
        let parameters = MomentumObserverParameters {
            sample_period: p.timing.sample_period,
            gain: settings.gain,
            threshold,
            hold: settings.hold,
        };
        Ok(Self {
            observer: MomentumObserver::new(&robot.model, parameters),
            filter: FilterBank::new(joints, p.filters.long.sensor)?,
            model_index: p.joints.iter().map(|j| j.model_index).collect(),
            newest: vec![f64::NAN; joints],
            q: vec![0.0; n],
            dq: vec![0.0; n],
            tau: vec![0.0; n],
            forces: vec![Force::zero(); robot.model.bodies().len()],
            contact_flags: vec![false; joints],
        })
    }

    pub(crate) fn update(
        &mut self,
        whole_body: &WholeBody,
        measured: &[JointMeasured],
        joints: &mut [JointEstimated],
        counts: &mut Counts,
    ) {
        for (newest, joint) in self.newest.iter_mut().zip(&*joints) {
            *newest = joint.tau_encoder.tau;
        }
        self.filter.update(&self.newest);
        let mut flags = 0;
        for (j, (&place, joint)) in self.model_index.iter().zip(measured).enumerate() {
            self.q[place] = joint.q_hat;
            self.dq[place] = joint.dq_hat;
            self.tau[place] = self.filter.values()[j];
            flags |= joint.flags;
        }
        if flags & UNUSABLE != 0 || !whole_body.estimate().valid || self.filter.settling(0) {
            self.observer.reset();
            for joint in joints.iter_mut().take(self.model_index.len()) {
                (joint.tau_ext, joint.contact_flag) = (0.0, 0);
            }
            self.contact_flags.fill(false);
            return;
        }
        self.forces.fill(Force::zero());
        whole_body.add_contact_forces(&mut self.forces);
        let base = whole_body.base_motion();
        let forces = Some(self.forces.as_slice());
        let tau_ext = (self.observer).update(&self.q, &self.dq, &self.tau, base, forces);
        for (joint, &place) in joints.iter_mut().zip(&self.model_index) {
            joint.tau_ext = tau_ext[place];
        }
        let detected = self.observer.contacts();
        let before = self.contact_flags.iter_mut().zip(&self.model_index);
        for (j, (joint, (before, &place))) in joints.iter_mut().zip(before).enumerate() {
            if detected[place] {
                counts.lasting(Event::ExternalContact, Subject::Joint(j), !*before);
            }
            *before = detected[place];
            joint.contact_flag = u32::from(detected[place]);
        }
    }
}
