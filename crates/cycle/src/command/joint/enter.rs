//! Enter: the state in which a joint begins a mode.

use control::{MotorModel, TorqueLoop};
use robot_state::Mode;
use supervisor::Motion;

use super::State;
use crate::command::carry::Carry;
use crate::command::impedance::Impedance;
use crate::command::law::{JointInput, Law};
use crate::command::reference::Goal;
use crate::command::rest::Rest;
use crate::command::transition::{Stop, Transition};

impl Law {
    /// The state of a mode that begins now, after the command `last`; its transition begins at
    /// `from`.
    pub(super) fn enter(
        &self,
        goal: &Goal<'_>,
        (last, from): (f64, f64),
        motion: &Motion,
        input: &JointInput<'_>,
    ) -> State {
        let transition = match input.yields {
            true => Transition::yielding(from),
            false => Transition::from(from),
        };
        let torque_loop = TorqueLoop::default();
        match (goal.mode(), self.motor) {
            // Where the set-point would be at rest: one that came to rest slowly would press on.
            (Mode::Hold, MotorModel::Position { k_v, .. }) if input.in_contact => {
                State::HoldPosition {
                    hold_q: last - k_v * motion.dq,
                    stop: Stop::from(0.0, self.limits.deceleration),
                }
            }
            (Mode::Hold, MotorModel::Position { .. }) => State::HoldPosition {
                hold_q: last,
                stop: match input.trusted {
                    true => Stop::from(motion.dq, self.limits.deceleration),
                    false => Stop::doubted(motion.dq, self.limits.deceleration),
                },
            },
            (Mode::Hold, MotorModel::Current { .. }) => {
                let weight = input.weight;
                let deceleration = self.limits.deceleration;
                let torque = last * self.carry_parameters().k_1;
                State::Carry(match goal {
                    Goal::Stop => Carry::stop(weight),
                    _ => Carry::hold(motion, weight, torque, deceleration),
                })
            }
            (Mode::Torque, _) => State::Torque {
                torque_loop,
                transition,
                rest: Rest::at(input.measured.q),
            },
            (
                mode @ (Mode::InverseDynamics
                | Mode::Position
                | Mode::Cartesian
                | Mode::Passive
                | Mode::TorqueFeedbackMotion
                | Mode::LowGainTracking),
                _,
            ) => State::InverseDynamics {
                torque_loop,
                transition,
                impedance: Impedance::asked(input.impedance, &self.gains),
                rejoin: None,
                rest: Rest::at(input.measured.q),
                mode,
            },
        }
    }
}
