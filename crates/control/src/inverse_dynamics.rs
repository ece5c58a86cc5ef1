//! Torques of a desired motion under given contact wrenches (D12 without its feedback terms).

use dynamics::{Base, Data, Force, Model, Motion, rnea};
use nalgebra::Vector3;
use robot_state::Wrench;

use crate::six::copy;

/// Inverse dynamics of a robot whose base motion is measured by an IMU, or which is fixed.
#[derive(Debug, Clone)]
pub struct InverseDynamics {
    model: Model,
    data: Data,
    /// Frames at which the contact wrenches act.
    contact_frames: Vec<usize>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    forces: Vec<Force>,
}

impl InverseDynamics {
    /// Inverse dynamics with contact wrenches at these frames of the model.
    #[must_use]
    pub fn new(model: &Model, contact_frames: &[usize]) -> Self {
        let mut model = model.clone();
        let mut q = vec![0.0; model.nq()];
        if model.base() == Base::Floating {
            // The IMU's proper acceleration contains gravity, so neither the base's pose nor
            // gravity is needed (D 2.3): any pose will do.
            model.set_gravity(Vector3::zeros());
            q[6] = 1.0;
        }
        Self {
            data: Data::new(&model),
            contact_frames: contact_frames.to_vec(),
            q,
            v: vec![0.0; model.nv()],
            a: vec![0.0; model.nv()],
            forces: vec![Force::zero(); model.bodies().len()],
            model,
        }
    }

    /// The motion: `q_hat`, `dq_hat`, `ddq_d` of the joints (model order), twist and proper
    /// acceleration of a floating base in its own axes (not used for a fixed one).
    pub fn set_motion(
        &mut self,
        base: (Motion, Motion),
        q_hat: &[f64],
        dq_hat: &[f64],
        ddq_d: &[f64],
    ) {
        let (bv, bq) = self.model.base_size();
        if self.model.base() == Base::Floating {
            copy(&mut self.v, &base.0.to_array());
            copy(&mut self.a, &base.1.to_array());
        }
        copy(self.q.iter_mut().skip(bq), q_hat);
        copy(self.v.iter_mut().skip(bv), dq_hat);
        copy(self.a.iter_mut().skip(bv), ddq_d);
    }

    /// `M ddq_d + h_hat - J^T f` of the joints, N·m, model order, with the environment applying
    /// the wrenches `contact` at the contact frames.
    pub fn torque(&mut self, contact: &[Wrench]) -> &[f64] {
        self.forces.fill(Force::zero());
        for (&frame, wrench) in self.contact_frames.iter().zip(contact) {
            if let Some(frame) = self.model.frames().get(frame)
                && let Some(force) = self.forces.get_mut(frame.body)
            {
                let at_frame = Force::new(wrench.force.into(), wrench.torque.into());
                *force += frame.placement.act_force(at_frame);
            }
        }
        //= D12: tau = M ddq_d + h_hat - J^T f
        let (model, data) = (&self.model, &mut self.data);
        let tau = rnea(model, data, &self.q, &self.v, &self.a, Some(&self.forces));
        tau.get(self.model.base_size().0..).unwrap_or_default()
    }
}
