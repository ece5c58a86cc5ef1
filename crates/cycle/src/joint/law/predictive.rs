//! The predictive torque law in the cycle: what it senses, and its command with its contributions.

use control::predictive::{PredictiveLaw, Sensed, TorqueTerms};
use robot_state::{JointCommanded, JointMeasured, command_flags, measured_flags};
use supervisor::Motion;

use crate::joint::transition::Transition;
use crate::measure::NOT_USED;

/// The joint's sample, as the law takes it, with the torque that it feeds back, N·m, and what a current
/// of its motor makes, N·m/A.
pub(in crate::joint) fn sensed(
    measured: &JointMeasured,
    motion: &Motion,
    torque: Option<f64>,
    torque_per_current: f64,
) -> Sensed {
    Sensed {
        theta: motion.theta,
        q: motion.q,
        torque,
        motor_torque: Some(torque_per_current * measured.current),
        fresh: measured.flags & (NOT_USED | measured_flags::STALE) == 0,
    }
}

/// The command for the desired torque, rad or A. A mode begins at the present torque, from which the
/// desired one is led to by `transition`.
pub(super) fn predictive_command(
    law: &mut PredictiveLaw,
    terms: TorqueTerms,
    transition: &mut Transition,
    dt: f64,
    commanded: &mut JointCommanded,
) -> f64 {
    //= D12: tau_d = M ddq_d + h_hat - J^T f* + K_s (q_d - q) + K_d (dq_d - dq)
    let tau_d = terms.sum();
    let led = transition.blend(tau_d, dt);
    let parts = law.command(&TorqueTerms {
        feedforward: terms.feedforward + led - tau_d,
        ..terms
    });
    // The law limits the sum of the terms, which rounds.
    let limited = parts.desired.abs() < led.abs() * (1.0 - 1e-9) - 1e-9;
    *commanded = JointCommanded {
        tau_d,
        tau_star: parts.motor_torque,
        delta_q: parts.command - parts.origin,
        feedforward_torque: parts.feedforward_torque,
        feedforward_friction: parts.feedforward_friction,
        feedback_position: parts.feedback_position,
        feedback_velocity: parts.feedback_velocity,
        feedback_force: parts.feedback_force,
        feedback_acceleration: parts.feedback_torque,
        flags: if limited {
            command_flags::TORQUE_LIMITED
        } else {
            0
        },
        ..JointCommanded::default()
    };
    parts.command
}
