//! Enter: the state in which a joint begins.

use control::DriveModel;
use supervisor::Motion;

use super::carry::Carry;
use super::constants::Constants;
use super::controller::State;
use super::followed::Followed;
use super::rest::Rest;
use super::transition::{Stop, Transition};
use super::{JointInput, Trust};
use crate::mode::{Entry, Impedance, JointGoal};

impl Constants {
    /// The state in which a joint begins now, after the command `last`; its transition begins at `from`.
    pub(super) fn enter(
        &self,
        goal: &JointGoal,
        (last, from): (f64, f64),
        motion: &Motion,
        input: &JointInput<'_>,
        doubted: bool,
    ) -> State {
        let deceleration = self.limits.deceleration;
        match (goal, &self.drive) {
            (JointGoal::Follow(follow), _) => State::Follow(Followed {
                mode: follow.mode,
                transition: if follow.entry == Entry::Usual {
                    Transition::from(from)
                } else {
                    Transition::yielding(from)
                },
                impedance: Impedance::asked(
                    follow.spring.and_then(|spring| spring.impedance),
                    &self.gains,
                ),
                resynchronisation: None,
                rest: Rest::at(input.measured.q),
            }),
            (_, DriveModel::Position(drive))
                if doubted || matches!(goal, JointGoal::StopPressing) =>
            {
                State::HoldPosition {
                    hold_q: last - drive.k_v * motion.dq,
                    stop: Stop::from(0.0, deceleration),
                }
            }
            (_, DriveModel::Position(_)) => State::HoldPosition {
                hold_q: last,
                stop: match input.trust {
                    Trust::Sound => Stop::from(motion.dq, deceleration),
                    Trust::Distrusted => Stop::doubted(motion.dq, deceleration),
                },
            },
            (JointGoal::Hold, DriveModel::Current(_)) => {
                let torque = last * self.carry_parameters().k_1;
                State::Carry(Carry::hold(motion, input.weight, torque, deceleration))
            }
            (_, DriveModel::Current(_)) => State::Carry(Carry::stop(input.weight)),
        }
    }
}
