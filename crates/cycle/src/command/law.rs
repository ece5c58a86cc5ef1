//! Law: what one joint's drive and gains make of its measured values, whatever its mode.

use control::predictive::{PredictiveLaw, TorqueTerms};
use control::{JointGains, MotorModel, TorqueLoop};
use robot_state::{
    JointCommanded, JointMeasured, JointReference, Mode, TorqueEstimate, command_flags,
    torque_flags,
};
use supervisor::{Actuation, Limits, Motion, Shown};

use super::carry::{CarryParameters, smaller};
use super::impedance::Impedance;
use super::late::LateTorque;

/// Torques of one joint by inverse dynamics, N·m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct InverseDynamicsTorque {
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

/// All that a joint's command depends on in one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointInput<'a> {
    /// At the instant of this cycle; zero in mode hold.
    pub(crate) reference: JointReference,
    /// Stiffness and damping of the reference; none: the configured ones.
    pub(crate) impedance: Option<Impedance>,
    pub(crate) inverse_dynamics: InverseDynamicsTorque,
    pub(crate) measured: &'a JointMeasured,
    /// The joint's encoders do not contradict each other.
    pub(crate) trusted: bool,
    /// Torque that carries the joint's weight, by no sensor of the last 0.1 s but encoders, N·m.
    pub(crate) weight: f64,
    pub(crate) tau_encoder: &'a TorqueEstimate,
    /// The torque that is fed back.
    pub(crate) tau_hat: &'a TorqueEstimate,
    /// The torque that the predictive law feeds back, N·m.
    pub(crate) fast: Option<f64>,
    /// The limb is in contact and braked, or yields, or does so from this cycle on.
    pub(crate) in_contact: bool,
    pub(crate) yields: bool,
    pub(crate) yields_anew: bool,
    /// A frame leads the joint: nothing but a torque holds it.
    pub(crate) led: bool,
    /// Sample period, s.
    pub(crate) dt: f64,
    /// Periods before this cycle in which the loop did not run.
    pub(crate) skipped: u32,
    /// They were so many that nothing goes on.
    pub(crate) overslept: bool,
    /// They were so many that the drive has braked the joint, and a mode goes on.
    pub(crate) resumes: bool,
}

impl JointInput<'_> {
    /// The torque that is fed back, where it is valid, N·m.
    pub(super) fn torque(&self) -> Option<f64> {
        let valid = self.tau_hat.flags & torque_flags::VALID != 0;
        valid.then_some(self.tau_hat.tau)
    }

    /// By how much the joint is behind its reference, rad and rad/s, with a velocity of `dq`.
    pub(super) fn behind(&self, dq: f64) -> [f64; 2] {
        let JointReference { q_d, dq_d, .. } = self.reference;
        [q_d - self.measured.q, dq_d - dq]
    }
}

/// Constants of one joint's control law.
#[derive(Debug, Clone)]
pub(super) struct Law {
    pub(super) motor: MotorModel,
    pub(super) gains: JointGains,
    pub(super) limits: Limits,
    pub(super) actuation: Actuation,
    pub(super) gear_ratio: f64,
    /// Without an encoder on its link a joint is where its motor is: commands lead the motor-side angle.
    pub(super) has_link_encoder: bool,
    /// Motor torque per current, link side, N·m/A.
    pub(super) torque_per_current: f64,
    /// Greatest |dq| in mode torque, rad/s.
    pub(super) torque_velocity: f64,
    /// Friction that the loop adds in mode torque, N·m.
    pub(super) rest_friction: f64,
    /// The same of a joint that mode passive lets go.
    pub(super) let_go_friction: f64,
}

/// Velocity of the link, rad/s: the law's observer, where there is one, is younger than the filter.
pub(super) fn link_velocity(predictive: Option<&PredictiveLaw>, measured: &JointMeasured) -> f64 {
    predictive.map_or(measured.dq, PredictiveLaw::link_velocity)
}

impl Law {
    pub(super) fn motion(&self, input: &JointInput<'_>) -> Motion {
        let measured = input.measured;
        let (theta, omega) = (
            measured.theta / self.gear_ratio,
            measured.omega / self.gear_ratio,
        );
        let (q, dq) = match self.has_link_encoder {
            // The velocity that both encoders agree on.
            true => (measured.q, smaller(measured.dq, omega)),
            // By no torque of F/T sensors: a sensor that fails must not move the joint.
            false => (theta, omega),
        };
        Motion {
            q,
            theta,
            dq,
            weight: input.weight,
        }
    }

    /// The drive's own signal: by each encoder the position plus the lead of torque and velocity, rad; of
    /// a drive that takes currents its current, A.
    pub(super) fn shown(
        &self,
        measured: &JointMeasured,
        motion: &Motion,
        after_gap: Option<[f64; 2]>,
    ) -> Shown {
        let (set_points, lead, lag) = match self.actuation {
            Actuation::Position {
                k_tau,
                k_tau_motor,
                k_v,
            } => {
                let tau = self.torque_per_current * measured.current;
                let filtered = [measured.dq, measured.omega / self.gear_ratio];
                let [dq, omega] = after_gap.unwrap_or(filtered);
                let lead = k_tau_motor * tau;
                //= D6: delta_q = K_tau tau + K_v dq + K_c sign(dq)
                let set_points = [
                    motion.theta + lead + k_v * omega,
                    motion.q + k_tau * tau + k_v * self.velocity(dq, omega),
                ];
                (set_points, lead, k_v * omega)
            }
            Actuation::Current { .. } => ([measured.current; 2], 0.0, 0.0),
        };
        Shown {
            set_points,
            velocity: motion.dq,
            lead,
            lag,
            followed: false,
            blind: false,
        }
    }

    /// By the link side's encoder where there is one, else by the motor's, rad/s.
    fn velocity(&self, dq: f64, omega: f64) -> f64 {
        if self.has_link_encoder { dq } else { omega }
    }

    /// The torque that the joint carries where it stands, as far as it is known, N·m.
    pub(super) fn load(&self, input: &JointInput<'_>) -> f64 {
        let tau = input.tau_encoder;
        match (self.motor, tau.flags & torque_flags::VALID != 0) {
            // The lead that the drive holds already, whatever the torque is: none while it is off.
            (MotorModel::Position { .. }, _) if !self.has_link_encoder => {
                self.torque_per_current * input.measured.current
            }
            (MotorModel::Position { .. }, true) => tau.tau,
            _ => 0.0,
        }
    }

    pub(super) fn carry_parameters(&self) -> CarryParameters {
        let (k_1, damping) = match self.actuation {
            Actuation::Current { k_1, damping, .. } => (k_1, damping),
            Actuation::Position { .. } => (1.0, 0.0),
        };
        CarryParameters {
            k_s: self.gains.k_s,
            k_d: self.gains.k_d,
            damping,
            k_1,
            torque: self.limits.torque,
            rest: self.limits.rest,
        }
    }

    pub(super) fn hold_position(
        &self,
        hold_q: f64,
        motion: &Motion,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let delta_q = hold_q - motion.q;
        *commanded = JointCommanded {
            delta_q,
            feedback_position: delta_q,
            ..JointCommanded::default()
        };
        hold_q
    }

    /// Part of the desired motion that the joint is going to make: none where something else leads it, and less the
    /// softer it is asked to be. Low gains are helped by a torque that was learned.
    pub(super) fn foreseen_share(&self, mode: Mode, impedance: Impedance, led: bool) -> f64 {
        match mode {
            _ if led => 0.0,
            Mode::LowGainTracking => 1.0,
            _ if self.gains.k_d > 0.0 => (impedance.damping / self.gains.k_d).min(1.0),
            _ => 0.0,
        }
    }

    /// Terms that follow a position and a velocity by inverse dynamics.
    pub(super) fn tracking_terms(
        &self,
        impedance: Impedance,
        predictive: Option<&PredictiveLaw>,
        input: &JointInput<'_>,
    ) -> TorqueTerms {
        let (measured, torque) = (input.measured, &input.inverse_dynamics);
        let JointReference { q_d, dq_d, .. } = input.reference;
        let dq = link_velocity(predictive, measured);
        // Position feedback uses the newest sample: docs/decisions/0003.
        TorqueTerms {
            feedforward: torque.feedforward,
            force: torque.force_feedback,
            position: impedance.stiffness * (q_d - measured.q) + torque.frame_position,
            velocity: impedance.damping * (dq_d - dq) + torque.frame_velocity,
        }
    }

    /// `late`: how a joint without a link-side encoder feeds its torque back, instead of `torque_loop`.
    pub(super) fn torque_command(
        &self,
        terms: TorqueTerms,
        (torque_loop, mut late): (&mut TorqueLoop, Option<&mut LateTorque>),
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let TorqueTerms {
            feedforward,
            force,
            position,
            velocity,
        } = terms;
        let (measured, tau_hat) = (input.measured, input.tau_hat);
        //= D12: tau_d = M ddq_d + h_hat - J^T f* + K_s (q_d - q) + K_d (dq_d - dq)
        let tau_d = feedforward + force + position + velocity;
        let valid = tau_hat.flags & torque_flags::VALID != 0;
        let fed_back = valid.then_some(tau_hat.tau);
        let tau_star = match &mut late {
            Some(late) => {
                let angle = measured.theta / self.gear_ratio;
                late.update((tau_d, fed_back), angle, &self.gains, input.dt)
            }
            None => {
                let limit = self.limits.torque;
                torque_loop.update(tau_d, fed_back, &self.gains, limit, input.dt)
            }
        };
        let limit = self.limits.torque;
        let limited = tau_star.clamp(-limit, limit);
        let omega = measured.omega / self.gear_ratio;
        let mut friction = self.motor.friction_part(self.velocity(measured.dq, omega));
        if let Some(late) = late {
            let lead = self.motor.torque_part(limited);
            friction += late.against_friction(tau_d, lead, measured.dq, input.dt);
        }
        //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
        let command = self.motor.torque_part(limited) + friction;

        // None of them contains the part that the limit removes.
        //= D 5.5: delta_q = torque and friction feed-forward + feedback of q, dq, ddq and f
        let part = |tau: f64| self.motor.torque_part(tau);
        let k_p = self.gains.k_p;
        let feedback_force = force + k_p * (force + input.inverse_dynamics.contact_error);
        let torque_feedback = tau_star - tau_d;
        let of_position = k_p * position;
        let of_velocity = k_p * velocity;
        let of_force = feedback_force - force;
        *commanded = JointCommanded {
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
            flags: if limited == tau_star {
                0
            } else {
                command_flags::TORQUE_LIMITED
            },
            ..JointCommanded::default()
        };
        match self.motor {
            MotorModel::Position { .. } if self.has_link_encoder => measured.q + command,
            MotorModel::Position { .. } => measured.theta / self.gear_ratio + command,
            MotorModel::Current { .. } => command,
        }
    }
}
