//! Joint: the controller of one joint, a state for each mode.
//!
//! ```text
//!                 ┌───────────────┐  goal: torque            ┌─────────┐
//!   engaged ────► │ hold position │ ───────────────────────► │ torque  │
//!   (position-    │   or          │ ◄─────────────────────── └─────────┘
//!   commanded or  │ carry         │  goal: hold                 ▲   │ goal: the other one
//!   current-      │   torque law  │                             │   ▼
//!   commanded     │               │ ◄─────────────────────── ┌──────────────────┐
//!   drive)        └───────────────┘ ───────────────────────► │ inverse dynamics │
//!                                    goal: inverse dynamics  └──────────────────┘
//! ```
//!
//! Modes Cartesian, passive, torque-feedback motion and low-gain tracking are inverse dynamics with other
//! torques and gains. From any state, goals stop and fault lead to a hold as well. A joint that is not engaged has no
//! state and no command. A hold depends on no single sensor: a position-commanded drive keeps its
//! last command, brought to rest where the joint was moving; a current-commanded one
//! [carries](super::carry) its joint.
//!
//! A state owns its torque loop's integral and its transition, and is made anew at each change of
//! mode: nothing of an earlier visit survives.

mod enter;

use control::predictive::{PredictiveLaw, TorqueTerms};
use control::{MotorModel, TorqueLoop};
use robot_state::{
    JointCommanded, JointMeasured, JointReference, Mode, command_flags, measured_flags,
};

use super::carry::Carry;
use super::impedance::Impedance;
use super::late::LateTorque;
use super::law::{JointInput, Law, link_velocity};
use super::predictive::{predictive_command, sensed};
use super::reference::Goal;
use super::rejoin::Rejoin;
use super::rest::{self, Rest};
use super::transition::{Stop, Transition};
use crate::measure::NOT_USED;
use problem::Problem;
use robot_config::{Parameters, TorqueLaw};
use supervisor::{Actuation, Deviation, Following, Limiter, Motion, Shown};

/// State of the joint's present mode.
#[derive(Debug, Clone)]
enum State {
    /// The drive's own position loop holds at `hold_q`, which comes to rest as `stop` does.
    HoldPosition { hold_q: f64, stop: Stop },
    /// Hold and stop of a drive without a position loop.
    Carry(Carry),
    /// Follows `tau_d` of the reference.
    Torque {
        torque_loop: TorqueLoop,
        transition: Transition,
        rest: Rest,
    },
    /// Follows `q_d dq_d ddq_d` of the reference, or yields, by the torques of its mode.
    InverseDynamics {
        torque_loop: TorqueLoop,
        transition: Transition,
        impedance: Impedance,
        /// Back to the reference after a gap of the loop.
        rejoin: Option<Rejoin>,
        /// Where the joint stands that mode passive has let go.
        rest: Rest,
        mode: Mode,
    },
}

impl State {
    fn mode(&self) -> Mode {
        match self {
            Self::HoldPosition { .. } | Self::Carry(_) => Mode::Hold,
            Self::Torque { .. } => Mode::Torque,
            Self::InverseDynamics { mode, .. } => *mode,
        }
    }

    /// A client's mode goes on from the torque, and from where the joint is, to which its drive has led it on its own
    /// in a gap of the loop.
    fn resume(&mut self, torque: f64, back: Rejoin) {
        match self {
            Self::HoldPosition { .. } | Self::Carry(_) => {}
            Self::Torque { transition, .. } => *transition = Transition::resuming(torque),
            Self::InverseDynamics {
                transition, rejoin, ..
            } => {
                *transition = Transition::resuming(torque);
                *rejoin = Some(back);
            }
        }
    }
}

/// The controller of one joint.
#[derive(Debug, Clone)]
pub(crate) struct JointController {
    law: Law,
    limiter: Limiter,
    following: Following,
    /// None: the PI law (D11).
    predictive: Option<PredictiveLaw>,
    /// The drive is known to be unlike the configured one.
    unlike: bool,
    /// Feedback of the PI law without a link-side encoder.
    late: Option<LateTorque>,
    /// Its only encoder is in doubt since the last mode: so is the velocity that it shows.
    doubted: bool,
    /// None while no set-points are sent.
    state: Option<State>,
}

impl JointController {
    pub(crate) fn new(index: usize, parameters: &Parameters) -> Result<Self, Problem> {
        let joint = &parameters.joints[index];
        let sample_period = parameters.timing.sample_period;
        let has_link = joint.has_link_encoder;
        Ok(Self {
            law: Law {
                motor: joint.motor,
                gains: joint.gains,
                limits: joint.limits,
                actuation: joint.actuation,
                gear_ratio: joint.encoders.gear_ratio,
                has_link_encoder: has_link,
                torque_per_current: joint.encoders.gear_ratio
                    * joint.estimator.wave_generator.torque_constant,
                torque_velocity: joint.torque_velocity,
                rest_friction: rest::friction(joint, parameters),
                let_go_friction: rest::friction_let_go(joint, parameters),
            },
            following: Following::new(joint.following),
            limiter: Limiter::new(joint.limits, joint.actuation, sample_period),
            predictive: (has_link && matches!(parameters.torque_law, TorqueLaw::Predictive(_)))
                .then(|| PredictiveLaw::new(joint.law).staggered(index)),
            unlike: false,
            late: (!has_link)
                .then(|| LateTorque::new(joint, parameters))
                .transpose()?,
            doubted: false,
            state: None,
        })
    }

    /// The joint feeds back the torque from F/T sensors and IMU, whatever the robot's law is.
    pub(crate) fn is_late(&self) -> bool {
        self.late.is_some()
    }

    /// Velocity of the link, rad/s.
    pub(crate) fn velocity(&self, measured: &JointMeasured) -> f64 {
        link_velocity(self.predictive.as_ref(), measured)
    }

    /// Its drive takes currents.
    pub(crate) fn takes_current(&self) -> bool {
        matches!(self.law.actuation, Actuation::Current { .. })
    }

    /// The last command, rad or A; none while no set-points are sent.
    pub(crate) fn last(&self) -> Option<f64> {
        self.state.as_ref().map(|_| self.limiter.last())
    }

    /// The effect of earlier set-points is forgotten: they end, and begin anew where the joint then stands.
    pub(crate) fn forget(&mut self) {
        self.state = None;
        self.following.restart();
        if let Some(predictive) = &mut self.predictive {
            predictive.reset();
        }
    }

    /// No set-points from now on.
    pub(crate) fn release(&mut self, q: f64, commanded: &mut JointCommanded) {
        self.forget();
        *commanded = JointCommanded {
            q_c: q,
            ..JointCommanded::default()
        };
    }

    /// While a mode is followed the drive turns out to be unlike the configured one, in this cycle.
    pub(crate) fn finds_another_drive(&mut self, mode: Mode) -> bool {
        let unlike = (self.predictive.as_ref()).is_some_and(PredictiveLaw::drive_is_unlike);
        let before = self.unlike;
        self.unlike = unlike && (before || mode != Mode::Hold);
        self.unlike && !before
    }

    /// The command of this cycle within all limits, with its contributions in `commanded`. Returns
    /// how the drive deviates from those before, and whether that begins.
    pub(crate) fn update(
        &mut self,
        goal: &Goal<'_>,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> Option<(Deviation, bool)> {
        let motion = self.law.motion(input);
        let resumes = self.resumes(input);
        if let Some(predictive) = &mut self.predictive {
            match (input.overslept, resumes) {
                (true, _) => predictive.reset(),
                (false, true) => (0..input.skipped).for_each(|_| predictive.sleep()),
                (false, false) => (0..input.skipped).for_each(|_| predictive.skip()),
            }
            let per_current = self.law.torque_per_current;
            predictive.observe(&sensed(input.measured, &motion, input.fast, per_current));
        }
        let fresh = input.measured.flags & measured_flags::MISSED == 0;
        let after_gap = self.predictive.as_ref();
        let after_gap = after_gap.and_then(PredictiveLaw::velocities_after_gap);
        let deviation = fresh.then(|| {
            let shown = self.law.shown(input.measured, &motion, after_gap);
            self.following.update(&Shown {
                followed: (self.state.as_ref()).is_some_and(|state| state.mode() != Mode::Hold),
                // The position of a joint whose encoders contradict each other is the last one before.
                blind: !input.trusted && !self.takes_current(),
                ..shown
            })
        });
        let is_doubtful = matches!(deviation.flatten(), Some((Deviation::Doubtful, _)));
        self.doubted |= self.late.is_some() && is_doubtful;
        let braked = JointInput {
            in_contact: input.in_contact || self.doubted,
            resumes,
            ..*input
        };
        let asked = self.asked(goal, &motion, &braked, commanded);
        self.limiter.judge_by(after_gap.map(|[_, rotor]| rotor));
        self.limiter.allow_velocity(match &self.state {
            // Nothing but this bounds the velocity that a torque leads to.
            Some(State::Torque { .. }) => self.law.torque_velocity,
            Some(_) if input.yields || input.led => self.law.torque_velocity,
            // Nor the one that an error of it leads to against a soft spring, beside the motion asked for.
            Some(State::InverseDynamics {
                mode: Mode::LowGainTracking,
                ..
            }) => self.law.torque_velocity + input.reference.dq_d.abs(),
            _ => self.law.limits.velocity,
        });
        let limited = match &self.state {
            Some(State::HoldPosition { .. }) => {
                // Nor does it give way to what an encoder in doubt shows.
                let usable = input.measured.flags & NOT_USED == 0 && !self.doubted;
                self.limiter.hold(asked, &motion, usable)
            }
            Some(State::Carry(carry)) => {
                let weight = carry.weight();
                let motion = Motion { weight, ..motion };
                match carry.is_damped() {
                    true => self.limiter.stop(asked, &motion),
                    false => self.limiter.limit(asked, &motion),
                }
            }
            _ => self.limiter.limit(asked, &motion),
        };
        self.following.note_sent(limited.applied);
        commanded.following_error = self.following.error();
        if let Some(predictive) = &mut self.predictive {
            predictive.sent(limited.applied);
        }
        if limited.flags & command_flags::NOT_FINITE != 0 {
            // The cause of it is no contribution to the command that stands.
            *commanded = JointCommanded {
                following_error: commanded.following_error,
                ..JointCommanded::default()
            };
        }
        commanded.asked = limited.asked;
        commanded.flags |= limited.flags | command_flags::ENGAGED;
        match self.law.motor {
            MotorModel::Position { .. } => {
                commanded.q_c = limited.applied;
                commanded.delta_q = limited.applied - motion.q;
            }
            MotorModel::Current { .. } => commanded.current_c = limited.applied,
        }
        deviation.flatten()
    }

    /// The loop returns after a gap in which the drive has braked the joint, and a law goes on that controls its torque.
    /// A joint that stood has not been braked: what the law knew of it still holds.
    fn resumes(&mut self, input: &JointInput<'_>) -> bool {
        let rest = self.law.limits.rest;
        let moved = |law: &PredictiveLaw| law.link_velocity().abs() > rest;
        let braked = self.predictive.as_ref().is_some_and(moved) && !input.overslept;
        self.limiter.resume(input.skipped, braked) && braked
    }

    /// The command before limits.
    fn asked(
        &mut self,
        goal: &Goal<'_>,
        motion: &Motion,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let law = &self.law;
        let last = match &self.state {
            Some(_) => self.limiter.last(),
            None => self.limiter.start(motion, law.load(input)),
        };
        let mode = goal.mode();
        let goes_on = |state: &State| state.mode() == mode && !input.yields_anew;
        let state = match self.state.take().filter(goes_on) {
            Some(state) => state,
            None => {
                let from = match (&mut self.predictive, &mut self.late) {
                    // The desired torque goes on from the present one, not the command.
                    (Some(predictive), _) => predictive.hold_reference(),
                    (None, Some(late)) => {
                        let lead = last - motion.theta - law.motor.friction_part(motion.dq);
                        late.begin(lead, input.torque(), &law.gains)
                    }
                    (None, None) => last,
                };
                // A drive that had the same set-point for so long stands.
                let dq = if input.overslept { 0.0 } else { motion.dq };
                self.doubted &= mode == Mode::Hold;
                law.enter(goal, (last, from), &Motion { dq, ..*motion }, input)
            }
        };
        let state = self.state.insert(state);
        if let (true, Some(predictive)) = (input.resumes, &mut self.predictive) {
            let torque = predictive.go_on();
            let behind = input.behind(predictive.link_velocity());
            state.resume(torque, Rejoin::from(behind, law.limits.velocity));
        }
        let reference = input.reference;
        if let (Some(late), Mode::Hold) = (&mut self.late, state.mode()) {
            late.rest(input.torque());
        }
        let (terms, torque_loop, transition) = match state {
            State::HoldPosition { hold_q, stop } => {
                *hold_q += stop.way(input.dt);
                return law.hold_position(*hold_q, motion, commanded);
            }
            State::Carry(carry) => {
                let parameters = law.carry_parameters();
                let measured = input.measured;
                let velocities = [measured.dq, measured.omega / law.gear_ratio];
                let motion = (motion, velocities);
                carry.skip(input.skipped);
                return carry.update(&parameters, motion, input.trusted, input.dt, commanded);
            }
            State::Torque {
                torque_loop,
                transition,
                rest,
            } => {
                let dq = link_velocity(self.predictive.as_ref(), input.measured);
                let at = (input.measured.q, dq);
                let terms = TorqueTerms {
                    feedforward: reference.tau_d,
                    position: rest.torque(at, &law.gains, law.rest_friction),
                    ..TorqueTerms::default()
                };
                (terms, torque_loop, transition)
            }
            State::InverseDynamics {
                torque_loop,
                transition,
                impedance,
                rejoin,
                rest,
                mode,
            } => {
                impedance.lead(input.impedance, &law.gains, input.dt);
                let set_back = (rejoin.as_mut()).and_then(|r| r.set_back(&reference, input.dt));
                if set_back.is_none() {
                    *rejoin = None;
                }
                let input = &JointInput {
                    reference: set_back.unwrap_or(reference),
                    ..*input
                };
                if let Some(predictive) = &mut self.predictive {
                    let share = law.foreseen_share(*mode, *impedance, input.led);
                    let JointReference { q_d, dq_d, .. } = input.reference;
                    predictive.desire_motion([q_d, dq_d], share);
                }
                let mut terms = law.tracking_terms(*impedance, self.predictive.as_ref(), input);
                match *mode == Mode::Passive && input.led {
                    true => {
                        let at = (
                            input.measured.q,
                            link_velocity(self.predictive.as_ref(), input.measured),
                        );
                        terms.position += rest.torque(at, &law.gains, law.let_go_friction);
                    }
                    false => *rest = Rest::at(input.measured.q),
                }
                (terms, torque_loop, transition)
            }
        };
        match (&mut self.predictive, &mut self.late) {
            (Some(predictive), _) => {
                predictive_command(predictive, terms, transition, input.dt, commanded)
            }
            (None, Some(late)) => {
                // The desired torque is led from that of the last command, as its feedback has to know.
                let tau_d = terms.sum();
                let led = transition.blend(tau_d, input.dt);
                let terms = TorqueTerms {
                    feedforward: terms.feedforward + led - tau_d,
                    ..terms
                };
                law.torque_command(terms, (torque_loop, Some(late)), input, commanded)
            }
            (None, None) => {
                let command = law.torque_command(terms, (torque_loop, None), input, commanded);
                transition.blend(command, input.dt)
            }
        }
    }
}
