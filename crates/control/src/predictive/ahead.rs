//! Prediction: where motor and torque are when the next command acts.

use super::observers::{Rotor, RotorStep};
use super::{PredictiveLaw, Sent};

/// The state when a command acts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
    pub(super) theta: f64,
    /// omega - dq: velocity of the torsion, rad/s.
    pub(super) torsion_velocity: f64,
    pub(super) omega: f64,
    pub(super) torque: f64,
    /// z: torque of the drive's integral, N·m.
    pub(super) integral: f64,
}

impl PredictiveLaw {
    /// Runs the observers ahead to the middle of the time for which the next command acts.
    pub(super) fn ahead(&self) -> Ahead {
        let (p, stiffness) = (&self.parameters, self.stiffness);
        let (theta, velocity) = (self.rotor.theta, self.link.velocity());
        let mut rotor = self.rotor;
        let (mut time, mut integral) = (0.0, self.integral);
        let torque_at = |rotor: &Rotor, time: f64| {
            self.torque + stiffness * ((rotor.theta - theta) - velocity * time)
        };
        let mut run = |step: &RotorStep, sent: Sent| {
            let force = p.motor_torque(sent.command, rotor.theta) + integral - sent.friction;
            rotor.advance(step, force - torque_at(&rotor, time));
            time += step.time;
            let acted = (sent.command, step.time);
            integral = p.wound_up(integral, acted, [rotor.theta, rotor.omega]);
        };
        for pair in self.commands.windows(2) {
            if let [now, next] = *pair {
                run(&self.steps.lag, now);
                run(&self.steps.rest, next);
            }
        }
        let last = self.commands.last().copied().unwrap_or(self.before);
        run(&self.steps.lag, last);
        // The command to come follows the link as the last one did.
        let follows = p.measured_origin(velocity * p.sample_period);
        let next = Sent {
            command: last.command + follows,
            ..last
        };
        run(&self.steps.half, next);
        Ahead {
            theta: rotor.theta,
            torsion_velocity: rotor.omega - velocity,
            omega: rotor.omega,
            torque: torque_at(&rotor, time),
            integral,
        }
    }
}
