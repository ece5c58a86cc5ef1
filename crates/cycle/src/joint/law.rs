//! Torque law: how one joint's drive is made to produce the desired torque.
//!
//! A law is a file behind [`Law`]. It sees each sample, is told of gaps and of what was sent, begins at a present
//! torque, and makes the command of a cycle from the terms of the desired torque.

mod motor_side;
mod predictive;

use control::predictive::{PredictiveLaw, TorqueTerms};
use control::{DriveModel, TorqueLoop};
use problem::Problem;
use robot_config::Parameters;
use robot_state::{JointCommanded, command_flags, torque_flags};
use supervisor::Motion;

use super::constants::Constants;
use super::transition::Transition;
use super::{Gap, JointInput};
use motor_side::MotorSide;
use predictive::{predictive_command, sensed};

#[derive(Debug, Clone)]
pub(super) enum Law {
    /// The motor's angle is led by a model of gear and drive, from a torque without delay.
    Predictive(Box<PredictiveLaw>),
    /// D's proportional-integral feedback of the torque (D11).
    ProportionalIntegral(TorqueLoop),
    /// Feedback of the late torque from F/T sensors and IMU, without a link-side encoder.
    MotorSide(Box<MotorSide>),
}

/// The desired torque of a cycle, by its parts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Desired {
    pub(super) terms: TorqueTerms,
    /// Share of the contact force in the torque error, N·m.
    pub(super) contact_error: f64,
}

impl Law {
    /// # Errors
    /// A filter that cannot be used.
    pub(super) fn new(index: usize, parameters: &Parameters) -> Result<Self, Problem> {
        let joint = &parameters.joints[index];
        Ok(match parameters.torque_law {
            _ if !joint.has_link_encoder => {
                Self::MotorSide(Box::new(MotorSide::new(joint, parameters)?))
            }
            robot_config::TorqueLaw::Predictive(_) => {
                Self::Predictive(Box::new(PredictiveLaw::new(joint.law).staggered(index)))
            }
            robot_config::TorqueLaw::ProportionalIntegral(_) => {
                Self::ProportionalIntegral(TorqueLoop::default())
            }
        })
    }

    /// The effect of earlier commands is forgotten.
    pub(super) fn reset(&mut self) {
        if let Self::Predictive(law) = self {
            law.reset();
        }
    }

    /// Takes the sample of this cycle, after a gap or none.
    pub(super) fn observe(&mut self, joint: &Constants, motion: &Motion, input: &JointInput<'_>) {
        let Self::Predictive(law) = self else {
            return;
        };
        match input.gap {
            Gap::None => {}
            Gap::Bridged(cycles) => (0..cycles).for_each(|_| law.skip()),
            Gap::Braked(cycles) => (0..cycles).for_each(|_| law.sleep()),
            Gap::Overslept(_) => law.reset(),
        }
        let per_current = joint.torque_per_current;
        law.observe(&sensed(input.measured, motion, input.fast, per_current));
    }

    /// The predictive law, which alone observes joint and drive.
    pub(super) fn predictive(&self) -> Option<&PredictiveLaw> {
        match self {
            Self::Predictive(law) => Some(law),
            _ => None,
        }
    }

    /// Velocity of the link by the law's observer, if it has one, rad/s: younger than the filter's.
    pub(super) fn link_velocity(&self) -> Option<f64> {
        self.predictive().map(PredictiveLaw::link_velocity)
    }

    /// A mode begins after the command `last`. Returns from where its transition leads: a command, or the torque
    /// from which the desired one goes on.
    pub(super) fn begin(
        &mut self,
        last: f64,
        joint: &Constants,
        motion: &Motion,
        input: &JointInput<'_>,
    ) -> f64 {
        match self {
            Self::Predictive(law) => law.hold_reference(),
            Self::MotorSide(law) => {
                let lead = last - motion.theta - joint.drive.friction_part(motion.dq);
                law.begin(lead, input.torque(), &joint.gains)
            }
            Self::ProportionalIntegral(torque_loop) => {
                *torque_loop = TorqueLoop::default();
                last
            }
        }
    }

    /// The joint is held in this cycle.
    pub(super) fn rest(&mut self, input: &JointInput<'_>) {
        if let Self::MotorSide(law) = self {
            law.rest(input.torque());
        }
    }

    /// The torque from which a mode goes on after a gap in which the drive has led the joint on its own, and the
    /// link's velocity, rad/s; none for laws that do not know it.
    pub(super) fn go_on(&mut self) -> Option<(f64, f64)> {
        match self {
            Self::Predictive(law) => Some((law.go_on(), law.link_velocity())),
            _ => None,
        }
    }

    /// The desired motion, rad and rad/s, of which the joint is going to make that share.
    pub(super) fn desire_motion(&mut self, motion: [f64; 2], share: f64) {
        if let Self::Predictive(law) = self {
            law.desire_motion(motion, share);
        }
    }

    /// The command for the desired torque, rad or A, to which `transition` leads.
    pub(super) fn command(
        &mut self,
        desired: &Desired,
        transition: &mut Transition,
        joint: &Constants,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        match self {
            Self::Predictive(law) => {
                predictive_command(law, desired.terms, transition, input.dt, commanded)
            }
            Self::MotorSide(law) => law.command(desired, transition, joint, input, commanded),
            Self::ProportionalIntegral(torque_loop) => {
                let (tau_d, limit) = (desired.terms.sum(), joint.limits.torque);
                let tau_star =
                    torque_loop.update(tau_d, input.torque(), &joint.gains, limit, input.dt);
                let leads = (tau_star, against_friction(joint, input));
                let command = lead_motor(desired, leads, joint, input, commanded);
                transition.blend(command, input.dt)
            }
        }
    }

    /// The command that was sent.
    pub(super) fn sent(&mut self, applied: f64) {
        if let Self::Predictive(law) = self {
            law.sent(applied);
        }
    }
}

/// The command that makes the motor's torque `tau_star`, N·m, with a lead against `friction`, rad or A, and its
/// contributions.
fn lead_motor(
    desired: &Desired,
    (tau_star, friction): (f64, f64),
    joint: &Constants,
    input: &JointInput<'_>,
    commanded: &mut JointCommanded,
) -> f64 {
    let TorqueTerms {
        feedforward,
        force,
        position,
        velocity,
    } = desired.terms;
    //= D12: tau_d = M ddq_d + h_hat - J^T f* + K_s (q_d - q) + K_d (dq_d - dq)
    let tau_d = desired.terms.sum();
    let limit = joint.limits.torque;
    let limited = tau_star.clamp(-limit, limit);
    let measured = input.measured;
    let valid = input.tau_hat.flags & torque_flags::VALID != 0;
    //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
    let command = joint.drive.torque_part(limited) + friction;

    // No share of the command contains the part that the limit removes.
    //= D 5.5: delta_q = torque and friction feed-forward + feedback of q, dq, ddq and f
    let part = |tau: f64| joint.drive.torque_part(tau);
    let k_p = joint.gains.k_p;
    let feedback_force = force + k_p * (force + desired.contact_error);
    let torque_feedback = tau_star - tau_d;
    let of_position = k_p * position;
    let of_velocity = k_p * velocity;
    let of_force = feedback_force - force;
    let fed_back = |part: f64| if valid { part } else { 0.0 };
    *commanded = JointCommanded {
        tau_d,
        tau_star,
        delta_q: command,
        feedforward_torque: part(feedforward),
        feedforward_friction: friction,
        feedback_position: part(position + fed_back(of_position)),
        feedback_velocity: part(velocity + fed_back(of_velocity)),
        feedback_force: part(force + fed_back(of_force)),
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
    match &joint.drive {
        DriveModel::Position(_) if joint.has_link_encoder => measured.q + command,
        DriveModel::Position(_) => measured.theta / joint.gear_ratio + command,
        DriveModel::Current(_) => command,
    }
}

/// The lead against the friction of a joint that moves so, rad or A.
fn against_friction(joint: &Constants, input: &JointInput<'_>) -> f64 {
    let omega = input.measured.omega / joint.gear_ratio;
    (joint.drive).friction_part(joint.velocity(input.measured.dq, omega))
}
