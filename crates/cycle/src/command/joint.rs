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
//! From any state, goals stop and fault lead to a hold as well. A joint that is not engaged has no
//! state and no command. A hold depends on no single sensor: a position-commanded drive keeps its
//! last command, brought to rest where the joint was moving; a current-commanded one
//! [carries](super::carry) its joint.
//!
//! A state owns its torque loop's integral and its transition, and is made anew at each change of
//! mode: nothing of an earlier visit survives.

use control::predictive::{PredictiveLaw, TorqueTerms};
use control::{JointGains, MotorModel, TorqueLoop};
use robot_state::{
    JointCommanded, JointMeasured, JointReference, Mode, TorqueEstimate, command_flags,
    measured_flags, torque_flags,
};

use super::carry::{Carry, CarryParameters, smaller};
use super::impedance::Impedance;
use super::predictive::{predictive_command, sensed};
use super::reference::Goal;
use super::transition::{Stop, Transition};
use crate::measure::NOT_USED;
use robot_config::{JointParameters, Parameters, TorqueLaw};
use supervisor::{Actuation, Deviation, Following, Limiter, Limits, Motion};

/// Torques of one joint by inverse dynamics, N·m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct InverseDynamicsTorque {
    /// `M ddq_d + h_hat - J^T f_d`: torque of the reference.
    pub(crate) feedforward: f64,
    /// `-J^T K_f (f_d - f_hat)`: feedback of the contact force.
    pub(crate) force_feedback: f64,
    /// `-J^T (f_d - f_hat)`: share of the contact force in the torque error.
    pub(crate) contact_error: f64,
}

/// All that a joint's command depends on in one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointInput<'a> {
    /// At the instant of this cycle; zero in mode hold.
    pub(crate) reference: JointReference,
    /// What the reference asks for; none: the configured one.
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
    /// Sample period, s.
    pub(crate) dt: f64,
    /// Periods before this cycle in which the loop did not run.
    pub(crate) skipped: u32,
    /// They were so many that nothing goes on.
    pub(crate) overslept: bool,
}

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
    },
    /// Follows `q_d dq_d ddq_d` of the reference.
    InverseDynamics {
        torque_loop: TorqueLoop,
        transition: Transition,
        impedance: Impedance,
    },
}

impl State {
    fn mode(&self) -> Mode {
        match self {
            Self::HoldPosition { .. } | Self::Carry(_) => Mode::Hold,
            Self::Torque { .. } => Mode::Torque,
            Self::InverseDynamics { .. } => Mode::InverseDynamics,
        }
    }
}

/// Constants of one joint's control law.
#[derive(Debug, Clone)]
struct Law {
    motor: MotorModel,
    gains: JointGains,
    limits: Limits,
    actuation: Actuation,
    gear_ratio: f64,
    /// Motor torque per current, link side, N·m/A.
    torque_per_current: f64,
}

/// The controller of one joint.
#[derive(Debug, Clone)]
pub(crate) struct JointController {
    law: Law,
    limiter: Limiter,
    following: Following,
    /// None: the PI law (D11).
    predictive: Option<PredictiveLaw>,
    /// None while no set-points are sent.
    state: Option<State>,
}

impl JointController {
    pub(crate) fn new(joint: &JointParameters, parameters: &Parameters) -> Self {
        let sample_period = parameters.timing.sample_period;
        Self {
            law: Law {
                motor: joint.motor,
                gains: joint.gains,
                limits: joint.limits,
                actuation: joint.actuation,
                gear_ratio: joint.encoders.gear_ratio,
                torque_per_current: joint.encoders.gear_ratio
                    * joint.estimator.wave_generator.torque_constant,
            },
            following: Following::new(joint.following),
            limiter: Limiter::new(joint.limits, joint.actuation, sample_period),
            predictive: matches!(parameters.torque_law, TorqueLaw::Predictive(_))
                .then(|| PredictiveLaw::new(joint.law)),
            state: None,
        }
    }

    /// Its drive takes currents.
    pub(crate) fn takes_current(&self) -> bool {
        matches!(self.law.actuation, Actuation::Current { .. })
    }

    /// The last command, rad or A; none while no set-points are sent.
    pub(crate) fn last(&self) -> Option<f64> {
        self.state.as_ref().map(|_| self.limiter.last())
    }

    /// No set-points from now on.
    pub(crate) fn release(&mut self, q: f64, commanded: &mut JointCommanded) {
        self.state = None;
        self.following.restart();
        if let Some(predictive) = &mut self.predictive {
            predictive.reset();
        }
        *commanded = JointCommanded {
            q_c: q,
            ..JointCommanded::default()
        };
    }

    /// The command of this cycle within all limits, with its contributions in `commanded`. Returns
    /// how the drive deviates from those before.
    pub(crate) fn update(
        &mut self,
        goal: &Goal<'_>,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> Option<Deviation> {
        let motion = self.law.motion(input);
        let fresh = input.measured.flags & measured_flags::MISSED == 0;
        let deviation = fresh.then(|| {
            let shown = self.law.shown(input.measured, &motion);
            self.following.update(shown, motion.dq)
        });
        if let Some(predictive) = &mut self.predictive {
            match input.overslept {
                true => predictive.reset(),
                false => (0..input.skipped).for_each(|_| predictive.skip()),
            }
            predictive.observe(&sensed(input.measured, &motion, input.fast));
        }
        let asked = self.asked(goal, &motion, input, commanded);
        let limited = match &self.state {
            Some(State::HoldPosition { .. }) => {
                let usable = input.measured.flags & NOT_USED == 0;
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
            // What made it so is no contribution to the command that stands.
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
        let state = match self.state.take().filter(|state| state.mode() == mode) {
            Some(state) => state,
            None => {
                let from = match &mut self.predictive {
                    // The desired torque goes on from the present one, not the command.
                    Some(predictive) => predictive.hold_reference(),
                    None => last,
                };
                // A drive that had the same set-point for so long stands.
                let dq = if input.overslept { 0.0 } else { motion.dq };
                law.enter(goal, (last, from), &Motion { dq, ..*motion }, input)
            }
        };
        let state = self.state.insert(state);
        let reference = input.reference;
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
            } => {
                let terms = TorqueTerms {
                    feedforward: reference.tau_d,
                    ..TorqueTerms::default()
                };
                (terms, torque_loop, transition)
            }
            State::InverseDynamics {
                torque_loop,
                transition,
                impedance,
            } => {
                impedance.lead(input.impedance, &law.gains, input.dt);
                let terms = law.tracking_terms(*impedance, self.predictive.as_ref(), input);
                (terms, torque_loop, transition)
            }
        };
        match &mut self.predictive {
            Some(predictive) => {
                predictive_command(predictive, terms, transition, input.dt, commanded)
            }
            None => {
                let command = law.torque_command(terms, torque_loop, input, commanded);
                transition.blend(command, input.dt)
            }
        }
    }
}

impl Law {
    fn motion(&self, input: &JointInput<'_>) -> Motion {
        let measured = input.measured;
        let (theta, omega) = (
            measured.theta / self.gear_ratio,
            measured.omega / self.gear_ratio,
        );
        Motion {
            q: measured.q,
            theta,
            // The velocity that both encoders agree on.
            dq: smaller(measured.dq, omega),
            weight: input.weight,
        }
    }

    /// The set-points that motor-side and link-side encoder show: the position plus the lead of
    /// torque and velocity, rad; of a drive that takes currents its current, A.
    fn shown(&self, measured: &JointMeasured, motion: &Motion) -> [f64; 2] {
        match self.actuation {
            Actuation::Position {
                k_tau,
                k_tau_motor,
                k_v,
            } => {
                let tau = self.torque_per_current * measured.current;
                let omega = measured.omega / self.gear_ratio;
                //= D6: delta_q = K_tau tau + K_v dq + K_c sign(dq)
                [
                    motion.theta + k_tau_motor * tau + k_v * omega,
                    motion.q + k_tau * tau + k_v * measured.dq,
                ]
            }
            Actuation::Current { .. } => [measured.current; 2],
        }
    }

    /// The torque that the joint carries where it stands, as far as it is known, N·m.
    fn load(&self, input: &JointInput<'_>) -> f64 {
        let tau = input.tau_encoder;
        match (self.motor, tau.flags & torque_flags::VALID != 0) {
            (MotorModel::Position { .. }, true) => tau.tau,
            _ => 0.0,
        }
    }

    fn carry_parameters(&self) -> CarryParameters {
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
        }
    }

    /// The state of a mode that begins now, after the command `last`; its transition begins at
    /// `from`.
    fn enter(
        &self,
        goal: &Goal<'_>,
        (last, from): (f64, f64),
        motion: &Motion,
        input: &JointInput<'_>,
    ) -> State {
        let transition = Transition::from(from);
        let torque_loop = TorqueLoop::default();
        match (goal.mode(), self.motor) {
            (Mode::Hold, MotorModel::Position { .. }) => State::HoldPosition {
                hold_q: last,
                stop: Stop::from(motion.dq, self.limits.deceleration),
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
            },
            (Mode::InverseDynamics | Mode::Position, _) => State::InverseDynamics {
                torque_loop,
                transition,
                impedance: Impedance::asked(input.impedance, &self.gains),
            },
        }
    }

    fn hold_position(&self, hold_q: f64, motion: &Motion, commanded: &mut JointCommanded) -> f64 {
        let delta_q = hold_q - motion.q;
        *commanded = JointCommanded {
            delta_q,
            feedback_position: delta_q,
            ..JointCommanded::default()
        };
        hold_q
    }

    /// Terms that follow a position and a velocity by inverse dynamics.
    fn tracking_terms(
        &self,
        impedance: Impedance,
        predictive: Option<&PredictiveLaw>,
        input: &JointInput<'_>,
    ) -> TorqueTerms {
        let (measured, torque) = (input.measured, &input.inverse_dynamics);
        let JointReference { q_d, dq_d, .. } = input.reference;
        // The observer's velocity is younger than the filter's.
        let dq = predictive.map_or(measured.dq, PredictiveLaw::link_velocity);
        // Position feedback uses the newest sample: docs/decisions/0003.
        TorqueTerms {
            feedforward: torque.feedforward,
            force: torque.force_feedback,
            position: impedance.stiffness * (q_d - measured.q),
            velocity: impedance.damping * (dq_d - dq),
        }
    }

    fn torque_command(
        &self,
        terms: TorqueTerms,
        torque_loop: &mut TorqueLoop,
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
        let tau_star = torque_loop.update(
            tau_d,
            valid.then_some(tau_hat.tau),
            &self.gains,
            self.limits.torque,
            input.dt,
        );
        let limit = self.limits.torque;
        let limited = tau_star.clamp(-limit, limit);
        let friction = self.motor.friction_part(measured.dq);
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
            MotorModel::Position { .. } => measured.q + command,
            MotorModel::Current { .. } => command,
        }
    }
}
