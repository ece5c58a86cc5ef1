//! Followed: a joint that follows a desired torque, and the torque that it desires in a cycle.

use control::predictive::TorqueTerms;
use robot_state::Mode;

use super::JointInput;
use super::constants::Constants;
use super::law::{Desired, Law};
use super::rest::Rest;
use super::resynchronisation::Resynchronisation;
use super::transition::Transition;
use crate::mode::{Bristle, Follow, Impedance};

/// State of a joint that follows a desired torque.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub(super) mode: Mode,
    pub(super) transition: Transition,
    pub(super) impedance: Impedance,
    /// Back to the reference after a gap of the loop.
    pub(super) resynchronisation: Option<Resynchronisation>,
    /// Where the joint stands to which the loop adds friction.
    pub(super) rest: Rest,
}

impl Followed {
    /// A mode goes on from the torque, and from where the joint is, to which its drive has led it on its own in a gap
    /// of the loop.
    pub(super) fn resume(
        &mut self,
        torque: f64,
        follow: &Follow,
        (q, dq): (f64, f64),
        joint: &Constants,
    ) {
        self.transition = Transition::resuming(torque);
        if let Some(spring) = &follow.spring {
            let behind = [spring.q_d - q, spring.dq_d - dq];
            self.resynchronisation = Some(Resynchronisation::from(behind, joint.limits.velocity));
        }
    }

    /// The desired torque of this cycle.
    pub(super) fn desired(
        &mut self,
        follow: &Follow,
        law: &mut Law,
        joint: &Constants,
        input: &JointInput<'_>,
    ) -> Desired {
        let measured = input.measured;
        let terms = match &follow.spring {
            None => TorqueTerms {
                feedforward: follow.torque.feedforward,
                position: self.bristle(follow, law, joint, input).unwrap_or(0.0),
                ..TorqueTerms::default()
            },
            Some(spring) => {
                self.impedance
                    .lead(spring.impedance, &joint.gains, input.dt);
                let wanted = [spring.q_d, spring.dq_d];
                let set_back =
                    (self.resynchronisation.as_mut()).and_then(|r| r.set_back(wanted, input.dt));
                if set_back.is_none() {
                    self.resynchronisation = None;
                }
                let wanted = set_back.unwrap_or(wanted);
                let share = joint.foreseen_share(spring.foresight, self.impedance);
                law.desire_motion(wanted, share);
                let dq = law.link_velocity().unwrap_or(measured.dq);
                let now = (measured.q, dq);
                let mut terms = joint.tracking_terms(follow, self.impedance, wanted, now);
                if let Some(bristle) = self.bristle(follow, law, joint, input) {
                    terms.position += bristle;
                }
                terms
            }
        };
        Desired {
            terms,
            contact_error: follow.torque.contact_error,
        }
    }

    /// Torque of the friction that the loop adds, N·m; none where it adds none.
    fn bristle(
        &mut self,
        follow: &Follow,
        law: &Law,
        joint: &Constants,
        input: &JointInput<'_>,
    ) -> Option<f64> {
        let q = input.measured.q;
        let friction = match follow.bristle {
            Bristle::None => {
                self.rest = Rest::at(q);
                return None;
            }
            Bristle::Torque => joint.rest_friction,
            Bristle::LetGo => {
                let sigma = input.tau_encoder.sigma.max(0.0);
                (joint.let_go_friction).max(joint.unknown_level * sigma)
            }
        };
        let dq = law.link_velocity().unwrap_or(input.measured.dq);
        Some(self.rest.torque((q, dq), &joint.gains, friction))
    }
}
