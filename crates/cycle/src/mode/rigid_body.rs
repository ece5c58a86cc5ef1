//! Rigid body: the joints' torques by inverse dynamics (D12).

use control::InverseDynamics;
use robot_config::Robot;
use robot_state::{MAX_FT_SENSORS, Mode, Reference, Wrench};

use crate::inputs::Seen;

/// Torque of one joint that follows a desired motion, by its parts, N·m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct RigidBodyTorque {
    /// `M ddq_d + h_hat - J^T f_d`: torque of the reference.
    pub(crate) feedforward: f64,
    /// `-J^T K_f (f_d - f_hat)`: feedback of the contact force.
    pub(crate) force_feedback: f64,
    /// `-J^T (f_d - f_hat)`: share of the contact force in the torque error.
    pub(crate) contact_error: f64,
    /// `J^T K (x_d - x)` of frames that are led.
    pub(crate) frame_position: f64,
    /// `J^T D (v_d - v)` of frames that are led.
    pub(crate) frame_velocity: f64,
}

impl RigidBodyTorque {
    /// Nothing but this torque, N·m.
    pub(crate) fn feedforward(torque: f64) -> Self {
        Self {
            feedforward: torque,
            ..Self::default()
        }
    }
}

/// The robot as rigid bodies, and the torques of this cycle.
#[derive(Debug)]
pub(crate) struct RigidBody {
    inverse_dynamics: InverseDynamics,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    q_hat: Vec<f64>,
    dq_hat: Vec<f64>,
    ddq_d: Vec<f64>,
    torques: Vec<RigidBodyTorque>,
    free: Vec<f64>,
    k_f: f64,
}

impl RigidBody {
    pub(crate) fn new(robot: &Robot) -> Self {
        let parameters = &robot.parameters;
        let frames = parameters.ft_sensors.iter();
        let frames = frames.filter_map(|ft| robot.model.frame_index(&ft.sensor.frame));
        let n = robot.model.joint_count();
        Self {
            inverse_dynamics: InverseDynamics::new(&robot.model, &frames.collect::<Vec<_>>()),
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            q_hat: vec![0.0; n],
            dq_hat: vec![0.0; n],
            ddq_d: vec![0.0; n],
            torques: vec![RigidBodyTorque::default(); parameters.joints.len()],
            free: vec![0.0; parameters.joints.len()],
            k_f: parameters.k_f,
        }
    }

    /// The torque of a joint.
    pub(crate) fn torque(&self, joint: usize) -> RigidBodyTorque {
        self.torques.get(joint).copied().unwrap_or_default()
    }

    /// The torques of all joints, to which a mode may add.
    pub(crate) fn torques_mut(&mut self) -> &mut [RigidBodyTorque] {
        &mut self.torques
    }

    /// `h_hat - J^T f_hat`: the torques of the present motion under the contact wrenches `f_hat`.
    pub(crate) fn rest(&mut self, seen: &Seen<'_>, f_hat: &[Wrench; MAX_FT_SENSORS]) {
        self.set(None, seen, f_hat);
    }

    /// `M ddq_d + h_hat - J^T f` for the desired contact wrenches, where the reference has any, and for the estimated
    /// ones `f_hat`.
    pub(crate) fn follow(
        &mut self,
        reference: &Reference,
        seen: &Seen<'_>,
        f_hat: &[Wrench; MAX_FT_SENSORS],
    ) {
        self.set(Some(reference), seen, f_hat);
        if reference.contact_wrench_given != 1 || reference.mode == Mode::Cartesian.number() {
            return;
        }
        let with_desired = self.inverse_dynamics.torque(&reference.contact_wrench);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            // All other terms are equal: the difference is -J^T (f_d - f_hat).
            let contact_error = with_desired[place] - torque.feedforward;
            *torque = RigidBodyTorque {
                feedforward: with_desired[place],
                //= D12: f* = f_d + K_f (f_d - f_hat)
                force_feedback: self.k_f * contact_error,
                contact_error,
                ..RigidBodyTorque::default()
            };
        }
    }

    fn set(
        &mut self,
        reference: Option<&Reference>,
        seen: &Seen<'_>,
        f_hat: &[Wrench; MAX_FT_SENSORS],
    ) {
        let joints = self.model_index.iter().zip(&seen.measured.joints);
        for (j, (&place, joint)) in joints.enumerate() {
            self.q_hat[place] = joint.q_hat;
            self.dq_hat[place] = joint.dq_hat;
            self.ddq_d[place] = reference.map_or(0.0, |r| r.joints[j].ddq_d);
        }
        let (q, dq, ddq) = (&self.q_hat, &self.dq_hat, &self.ddq_d);
        (self.inverse_dynamics).set_motion(seen.base_motion, q, dq, ddq);
        let with_estimated = self.inverse_dynamics.torque(f_hat);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            *torque = RigidBodyTorque::feedforward(with_estimated[place]);
        }
    }

    /// Computes the torques without any contact, at the motion that was set last.
    pub(crate) fn update_free(&mut self) {
        let free = (self.inverse_dynamics).torque(&[Wrench::default(); MAX_FT_SENSORS]);
        for (own, &place) in self.free.iter_mut().zip(&self.model_index) {
            *own = free.get(place).copied().unwrap_or(0.0);
        }
    }

    /// The torque of a joint without any contact, N·m.
    pub(crate) fn free(&self, joint: usize) -> f64 {
        self.free.get(joint).copied().unwrap_or(0.0)
    }
}
