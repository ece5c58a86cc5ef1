//! External: what pushes the joints besides the declared contacts.

use dynamics::Force;
use estimators::filter_bank::FilterBank;
use robot_config::{ExternalTorqueSettings, Robot};
use robot_state::{CycleRecord, Event, measured_flags};
use whole_body::{MomentumObserver, MomentumObserverParameters, WholeBody};

use crate::error::CycleError;
use crate::events::Counts;

/// The observer of all joints, fed with signals of one instant: that of the filters.
#[derive(Debug)]
pub(crate) struct External {
    observer: MomentumObserver,
    /// Torques of the encoders, late like everything else.
    filter: FilterBank,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    newest: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    tau: Vec<f64>,
    forces: Vec<Force>,
    contact: Vec<bool>,
}

impl External {
    pub(crate) fn new(
        robot: &Robot,
        settings: &ExternalTorqueSettings,
    ) -> Result<Self, CycleError> {
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
            contact: vec![false; joints],
        })
    }

    pub(crate) fn update(
        &mut self,
        whole_body: &WholeBody,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        let joints = self.model_index.len();
        for (newest, joint) in self.newest.iter_mut().zip(&record.joints) {
            *newest = joint.tau_encoder.tau;
        }
        self.filter.update(&self.newest);
        let unready = measured_flags::NEVER | measured_flags::SETTLING | measured_flags::STALE;
        let mut flags = 0;
        for (j, (&place, joint)) in self.model_index.iter().zip(&record.joints).enumerate() {
            self.q[place] = joint.measured.q_hat;
            self.dq[place] = joint.measured.dq_hat;
            self.tau[place] = self.filter.values()[j];
            flags |= joint.measured.flags;
        }
        if flags & unready != 0 || !whole_body.estimate().valid || self.filter.settling(0) {
            self.observer.reset();
            for joint in record.joints.iter_mut().take(joints) {
                (joint.tau_ext, joint.contact) = (0.0, 0);
            }
            self.contact.fill(false);
            return;
        }
        self.forces.fill(Force::zero());
        whole_body.add_contact_forces(&mut self.forces);
        let base = whole_body.base_motion();
        let forces = Some(self.forces.as_slice());
        let tau_ext = (self.observer).update(&self.q, &self.dq, &self.tau, base, forces);
        for (joint, &place) in record.joints.iter_mut().zip(&self.model_index) {
            joint.tau_ext = tau_ext[place];
        }
        let contacts = self.observer.contacts();
        for (j, &place) in self.model_index.iter().enumerate() {
            if contacts[place] && !self.contact[j] {
                counts.add(Event::ExternalContact);
            }
            self.contact[j] = contacts[place];
            record.joints[j].contact = u32::from(contacts[place]);
        }
    }
}
