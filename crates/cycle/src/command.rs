//! Command: from the wanted torque or position to what each drive is told (D10-D12).

use control::{InverseDynamics, JointGains, JointLimits, MotorModel, TorqueLoop};
use robot_config::{Robot, TorqueFeedback};
use robot_state::{
    CycleRecord, Event, JointControl, JointRecord, JointReference, MAX_FT_SENSORS, Reference,
    TorqueEstimate, Wrench, mode, torque_flags,
};

mod decide;
mod emit;
mod limit;

use crate::estimate::Estimate;
use crate::events::Counts;
use limit::limit;

pub(crate) use decide::Supervisor;
pub use decide::Wanted;
pub(crate) use emit::Emit;

/// Time over which a change of mode is blended, s. A step in the command would be a step in torque.
const BLEND_S: f64 = 0.3;

/// The commanders of all joints, and what they share.
#[derive(Debug)]
pub(crate) struct Command {
    joints: Vec<JointCommand>,
    /// What each joint would be told if there were no limits.
    unlimited: Vec<f64>,
    inverse_dynamics: InverseDynamics,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    q_hat: Vec<f64>,
    dq_hat: Vec<f64>,
    ddq_d: Vec<f64>,
    torques: Vec<InverseDynamicsTorque>,
    torque_feedback: TorqueFeedback,
    k_f: f64,
    sample_period: f64,
}

impl Command {
    pub(crate) fn new(robot: &Robot) -> Self {
        let parameters = &robot.parameters;
        let n = parameters.joints.len();
        let frames: Vec<usize> = parameters
            .ft_sensors
            .iter()
            .filter_map(|ft| robot.model.frame_index(&ft.sensor.frame))
            .collect();
        Self {
            joints: parameters
                .joints
                .iter()
                .map(|j| JointCommand::new(j.motor, j.gains, j.limits))
                .collect(),
            unlimited: vec![f64::NAN; n],
            inverse_dynamics: InverseDynamics::new(&robot.model, &frames),
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            q_hat: vec![0.0; robot.model.joint_count()],
            dq_hat: vec![0.0; robot.model.joint_count()],
            ddq_d: vec![0.0; robot.model.joint_count()],
            torques: vec![InverseDynamicsTorque::default(); n],
            torque_feedback: parameters.torque_feedback,
            k_f: parameters.k_f,
            sample_period: parameters.timing.sample_period,
        }
    }

    pub(crate) fn joints(&self) -> &[JointCommand] {
        &self.joints
    }

    /// What every joint would be told if there were no limits, in `record.control`.
    pub(crate) fn update(
        &mut self,
        mode: u32,
        reference: Option<&Reference>,
        estimate: &Estimate,
        record: &mut CycleRecord,
    ) {
        self.inverse_dynamics(reference, estimate, record);
        let nothing = JointReference::default();
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let wanted = reference.and_then(|r| r.joints.get(j)).unwrap_or(&nothing);
            let record = &mut record.joints[j];
            let tau_hat = match self.torque_feedback {
                TorqueFeedback::WholeBody => record.tau_whole_body,
                TorqueFeedback::Encoder => record.tau_encoder,
            };
            let torque = &self.torques[j];
            self.unlimited[j] =
                joint.update(mode, wanted, torque, &tau_hat, record, self.sample_period);
        }
    }

    /// Applies the limits and the finite check: the last word on every command.
    pub(crate) fn limit(
        &mut self,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) -> Result<(), Event> {
        let mut result = Ok(());
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let (command, record) = (self.unlimited[j], &mut record.joints[j]);
            match limit(&joint.motor, &joint.limits, command, record, counts) {
                Ok(command) => joint.commit(command),
                Err(event) => {
                    joint.keep_last(record);
                    result = Err(event);
                }
            }
        }
        result
    }

    /// `M ddq_d + h_hat - J^T f` for the wanted contact wrenches and for the estimated ones.
    fn inverse_dynamics(
        &mut self,
        reference: Option<&Reference>,
        estimate: &Estimate,
        record: &CycleRecord,
    ) {
        for (j, &place) in self.model_index.iter().enumerate() {
            let measured = &record.joints[j].measured;
            self.q_hat[place] = measured.q_hat;
            self.dq_hat[place] = measured.dq_hat;
            self.ddq_d[place] = reference.map_or(0.0, |r| r.joints[j].ddq_d);
        }
        self.inverse_dynamics.set_motion(
            estimate.base_motion(),
            &self.q_hat,
            &self.dq_hat,
            &self.ddq_d,
        );
        let contact_hat: [Wrench; MAX_FT_SENSORS] = std::array::from_fn(|s| record.ft[s].contact);
        let with_estimated = self.inverse_dynamics.torque(&contact_hat);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            *torque = InverseDynamicsTorque {
                feedforward: with_estimated[place],
                ..InverseDynamicsTorque::default()
            };
        }
        let Some(reference) = reference.filter(|r| r.contact_given == 1) else {
            return;
        };
        let with_wanted = self.inverse_dynamics.torque(&reference.contact);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            // The rest is equal: the difference is -J^T (f_d - f_hat).
            let contact_error = with_wanted[place] - torque.feedforward;
            *torque = InverseDynamicsTorque {
                feedforward: with_wanted[place],
                //= D12: f* = f_d + K_f (f_d - f_hat)
                force_feedback: self.k_f * contact_error,
                contact_error,
            };
        }
    }
}

/// What inverse dynamics says of one joint, N·m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct InverseDynamicsTorque {
    /// `M ddq_d + h_hat - J^T f_d`: what the reference asks for.
    pub(crate) feedforward: f64,
    /// `-J^T K_f (f_d - f_hat)`: feedback of the contact force.
    pub(crate) force_feedback: f64,
    /// `-J^T (f_d - f_hat)`: how much of the torque error is the contact's.
    pub(crate) contact_error: f64,
}

/// The commander of one joint.
#[derive(Debug, Clone)]
pub(crate) struct JointCommand {
    motor: MotorModel,
    gains: JointGains,
    limits: JointLimits,
    torque_loop: TorqueLoop,
    mode: u32,
    /// Where to hold: the position that carries the load where the joint stands.
    hold_q: f64,
    last: Option<f64>,
    bump: f64,
    blend_left_s: f64,
}

impl JointCommand {
    pub(crate) fn new(motor: MotorModel, gains: JointGains, limits: JointLimits) -> Self {
        Self {
            motor,
            gains,
            limits,
            torque_loop: TorqueLoop::default(),
            mode: mode::HOLD,
            hold_q: 0.0,
            last: None,
            bump: 0.0,
            blend_left_s: 0.0,
        }
    }

    /// What was last commanded, rad or A; none before the first command.
    pub(crate) fn last(&self) -> Option<f64> {
        self.last
    }

    /// Remembers what was commanded after all limits.
    pub(crate) fn commit(&mut self, command: f64) {
        self.last = Some(command);
    }

    /// Shows what stands instead of a command that is not finite: the last one.
    fn keep_last(&self, record: &mut JointRecord) {
        let last = self.last.unwrap_or(record.measured.q);
        record.control = match self.motor {
            MotorModel::Position { .. } => JointControl {
                q_c: last,
                delta_q: last - record.measured.q,
                ..JointControl::default()
            },
            MotorModel::Current { .. } => JointControl {
                current_c: self.last.unwrap_or(0.0),
                ..JointControl::default()
            },
        };
    }

    /// The command of this cycle before the last limits, with its parts in `record.control`.
    pub(crate) fn update(
        &mut self,
        wanted_mode: u32,
        reference: &JointReference,
        inverse_dynamics: &InverseDynamicsTorque,
        tau_hat: &TorqueEstimate,
        record: &mut JointRecord,
        dt: f64,
    ) -> f64 {
        let changed = wanted_mode != self.mode || self.last.is_none();
        if changed {
            self.enter(wanted_mode, record);
        }
        let command = match (self.motor, self.mode) {
            (MotorModel::Position { .. }, mode::HOLD) => self.hold_position(record),
            (_, mode::HOLD) => {
                let still = JointReference {
                    q_d: self.hold_q,
                    ..JointReference::default()
                };
                self.torque_command(&still, inverse_dynamics, tau_hat, record, dt)
            }
            _ => self.torque_command(reference, inverse_dynamics, tau_hat, record, dt),
        };
        self.blend(command, changed, dt)
    }

    fn enter(&mut self, wanted_mode: u32, record: &JointRecord) {
        self.mode = wanted_mode;
        self.torque_loop.reset();
        let q = record.measured.q;
        // Bumpless: what was last commanded carries the load that the joint carries now; at the
        // start, what the joint's torque asks of its drive does.
        let tau = &record.tau_encoder;
        let tau_hat = if tau.flags & torque_flags::VALID != 0 {
            tau.tau
        } else {
            0.0
        };
        self.hold_q = match (self.motor, self.last) {
            (MotorModel::Position { .. }, Some(last)) => q + self.limits.delta_q(last - q).value,
            (MotorModel::Position { .. }, None) => {
                q + self.limits.delta_q(self.motor.torque_part(tau_hat)).value
            }
            _ => q,
        };
    }

    /// The drive's own position loop holds.
    fn hold_position(&self, record: &mut JointRecord) -> f64 {
        let delta_q = self.hold_q - record.measured.q;
        record.control = JointControl {
            delta_q,
            feedback_position: delta_q,
            ..JointControl::default()
        };
        self.hold_q
    }

    fn torque_command(
        &mut self,
        reference: &JointReference,
        inverse_dynamics: &InverseDynamicsTorque,
        tau_hat: &TorqueEstimate,
        record: &mut JointRecord,
        dt: f64,
    ) -> f64 {
        let JointGains { k_p, k_s, k_d, .. } = self.gains;
        let measured = record.measured;
        // Position feedback uses the newest sample: docs/decisions/0003.
        let (position, velocity, feedforward, force) = if self.mode == mode::TORQUE {
            (0.0, 0.0, reference.tau_d, 0.0)
        } else {
            (
                k_s * (reference.q_d - measured.q),
                k_d * (reference.dq_d - measured.dq),
                inverse_dynamics.feedforward,
                inverse_dynamics.force_feedback,
            )
        };
        //= D12
        let tau_d = feedforward + force + position + velocity;
        let valid = tau_hat.flags & torque_flags::VALID != 0;
        let tau_star = self.torque_loop.update(
            tau_d,
            valid.then_some(tau_hat.tau),
            &self.gains,
            self.limits.torque,
            dt,
        );
        let limited = self.limits.torque(tau_star);
        let friction = self.motor.friction_part(measured.dq);
        //= D10
        let command = self.motor.torque_part(limited.value) + friction;

        // The six contributions of D 5.5; what the limit cuts off is in none of them.
        let part = |tau: f64| self.motor.torque_part(tau);
        let feedback_force = force + k_p * (force + inverse_dynamics.contact_error);
        let torque_feedback = tau_star - tau_d;
        let of_position = k_p * position;
        let of_velocity = k_p * velocity;
        let of_force = feedback_force - force;
        record.control = JointControl {
            tau_d,
            tau_star,
            delta_q: command,
            feedforward_torque: part(feedforward),
            feedforward_friction: friction,
            feedback_position: part(position + if valid { of_position } else { 0.0 }),
            feedback_velocity: part(velocity + if valid { of_velocity } else { 0.0 }),
            feedback_force: part(force + if valid { of_force } else { 0.0 }),
            feedback_acceleration: if valid {
                part(torque_feedback - of_position - of_velocity - of_force)
            } else {
                0.0
            },
            flags: limited.flags,
            ..JointControl::default()
        };
        match self.motor {
            MotorModel::Position { .. } => record.measured.q + command,
            MotorModel::Current { .. } => command,
        }
    }

    /// Lets the difference to the last command fade after a change of mode.
    fn blend(&mut self, command: f64, changed: bool, dt: f64) -> f64 {
        if changed {
            self.bump = self.last.map_or(0.0, |last| last - command);
            self.blend_left_s = BLEND_S;
        }
        let blended = command + self.bump * (self.blend_left_s / BLEND_S);
        self.blend_left_s = (self.blend_left_s - dt).max(0.0);
        blended
    }
}
