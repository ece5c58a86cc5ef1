//! Rigid body: the joints' torques by inverse dynamics (D12).
//!
//! Contact wrenches that a client does not give are those by which the ground carries the robot in its desired motion
//! ([`Support`]), and none on ends that bear nothing. Measured ones are late: fed forward they would ask of a joint
//! what it bore some time before, which a robot on its feet does not survive, and what presses would press ever harder.

use control::{Imbalance, InverseDynamics, Support};
use nalgebra::Vector3;
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
    support: Support,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    /// Newest angles, and those of the instant of all filtered signals, model order, rad.
    q: Vec<f64>,
    q_hat: Vec<f64>,
    dq_hat: Vec<f64>,
    ddq_d: Vec<f64>,
    torques: Vec<RigidBodyTorque>,
    free: Vec<f64>,
    loaded: Vec<f64>,
    k_f: f64,
}

impl RigidBody {
    pub(crate) fn new(robot: &Robot) -> Self {
        let parameters = &robot.parameters;
        let frames = parameters.ft_sensors.iter();
        let frames = frames.filter_map(|ft| robot.model.frame_index(&ft.sensor.frame));
        let frames: Vec<usize> = frames.collect();
        // A stand carries what a fixed base does.
        let stands = parameters.whole_body.stand.is_some();
        let n = robot.model.joint_count();
        Self {
            inverse_dynamics: InverseDynamics::new(&robot.model, &frames),
            support: Support::new(&robot.model, if stands { &[] } else { &frames }),
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            q: vec![0.0; n],
            q_hat: vec![0.0; n],
            dq_hat: vec![0.0; n],
            ddq_d: vec![0.0; n],
            torques: vec![RigidBodyTorque::default(); parameters.joints.len()],
            free: vec![0.0; parameters.joints.len()],
            loaded: vec![0.0; parameters.joints.len()],
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

    /// Share of the robot's weight on the end-effector beyond an F/T sensor.
    pub(crate) fn load(&self, sensor: usize) -> f64 {
        self.support.load(sensor)
    }

    /// Up in the axes of an F/T sensor beyond which the robot stands on the ground; none where it does not.
    pub(crate) fn ground_under(&self, sensor: usize) -> Option<Vector3<f64>> {
        self.support.ground_under(sensor)
    }

    /// For how long the end-effector beyond an F/T sensor has stood, s.
    pub(crate) fn stands_for(&self, sensor: usize) -> f64 {
        self.support.stands_for(sensor)
    }

    /// The wrenches that F/T sensors measure, less the one that carries the robot at rest; none where nothing bears it.
    pub(crate) fn imbalance(&mut self) -> Option<Imbalance> {
        self.support.imbalance(&self.q_hat)
    }

    /// Takes what is measured in this cycle, whatever the mode.
    pub(crate) fn observe(&mut self, seen: &Seen<'_>) {
        for (&place, joint) in self.model_index.iter().zip(&seen.measured.joints) {
            self.q[place] = joint.q;
            self.q_hat[place] = joint.q_hat;
        }
        let (_, proper) = seen.base_motion;
        let contact = seen.contact_wrenches();
        (self.support).observe(&proper.linear, &self.q_hat, &contact, seen.dt);
    }

    /// `h_hat - J^T f*`: the torques of the present motion, the ground carrying the robot.
    pub(crate) fn rest(&mut self, seen: &Seen<'_>) {
        self.set_motion(None, seen);
        let carried = self.carried();
        self.set_torques(&carried);
    }

    /// `M ddq_d + h_hat - J^T f*` for the desired contact wrenches, where the reference has any, else for those by
    /// which the ground carries the robot; returns `f*`.
    pub(crate) fn follow(
        &mut self,
        reference: &Reference,
        seen: &Seen<'_>,
    ) -> [Wrench; MAX_FT_SENSORS] {
        self.set_motion(Some(reference), seen);
        if reference.contact_wrench_given != 1 || reference.mode == Mode::Cartesian.number() {
            let carried = self.carried();
            self.set_torques(&carried);
            return carried;
        }
        self.set_torques(&seen.contact_wrenches());
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
        reference.contact_wrench
    }

    /// `M ddq_d + h_hat - J^T f` for wrenches that do not change while they are followed.
    pub(crate) fn follow_under(
        &mut self,
        reference: &Reference,
        seen: &Seen<'_>,
        contact: &[Wrench; MAX_FT_SENSORS],
    ) {
        self.set_motion(Some(reference), seen);
        self.set_torques(contact);
    }

    /// The wrenches by which the ground carries the robot in the motion that was set last.
    fn carried(&mut self) -> [Wrench; MAX_FT_SENSORS] {
        *self.support.wrenches(&self.q, &self.ddq_d)
    }

    fn set_motion(&mut self, reference: Option<&Reference>, seen: &Seen<'_>) {
        let joints = self.model_index.iter().zip(&seen.measured.joints);
        for (j, (&place, joint)) in joints.enumerate() {
            self.dq_hat[place] = joint.dq_hat;
            self.ddq_d[place] = reference.map_or(0.0, |r| r.joints[j].ddq_d);
        }
        let (q, dq, ddq) = (&self.q_hat, &self.dq_hat, &self.ddq_d);
        (self.inverse_dynamics).set_motion(seen.base_motion, q, dq, ddq);
    }

    fn set_torques(&mut self, contact: &[Wrench; MAX_FT_SENSORS]) {
        let torques = self.inverse_dynamics.torque(contact);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            *torque = RigidBodyTorque::feedforward(torques[place]);
        }
    }

    /// Computes the torques without any contact, and under the measured ones, at the motion that was set last.
    pub(crate) fn update_contacts(&mut self, seen: &Seen<'_>) {
        let none = [Wrench::default(); MAX_FT_SENSORS];
        for (own, contact) in [
            (&mut self.free, none),
            (&mut self.loaded, seen.contact_wrenches()),
        ] {
            let torques = self.inverse_dynamics.torque(&contact);
            for (own, &place) in own.iter_mut().zip(&self.model_index) {
                *own = torques.get(place).copied().unwrap_or(0.0);
            }
        }
    }

    /// The torque of a joint without any contact, N·m.
    pub(crate) fn free(&self, joint: usize) -> f64 {
        self.free.get(joint).copied().unwrap_or(0.0)
    }

    /// Contribution of the measured contacts to the torque, N·m.
    pub(crate) fn by_contacts(&self, joint: usize) -> f64 {
        self.loaded.get(joint).copied().unwrap_or(0.0) - self.free(joint)
    }
}
