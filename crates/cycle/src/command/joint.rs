//! Joint: the controller of one joint, a state for each mode.
//!
//! ```text
//!                 ┌───────────────┐  goal: torque            ┌─────────┐
//!   start ──────► │ hold position │ ───────────────────────► │ torque  │
//!   (position-    │   or          │ ◄─────────────────────── └─────────┘
//!   commanded or  │ hold by       │  goal: hold                 ▲   │ goal: the other one
//!   current-      │   torque law  │                             │   ▼
//!   commanded     │               │ ◄─────────────────────── ┌──────────────────┐
//!   drive)        └───────────────┘ ───────────────────────► │ inverse dynamics │
//!                                    goal: inverse dynamics  └──────────────────┘
//! ```
//!
//! A state owns its torque loop's integral and its transition, and is made anew at each change of
//! mode: nothing of an earlier visit survives.

use control::{JointGains, JointLimits, MotorModel, TorqueLoop};
use robot_state::{
    JointCommanded, JointMeasured, JointReference, Mode, TorqueEstimate, torque_flags,
};

use super::transition::Transition;

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
    /// Zero in mode hold.
    pub(crate) reference: &'a JointReference,
    pub(crate) inverse_dynamics: InverseDynamicsTorque,
    pub(crate) measured: &'a JointMeasured,
    pub(crate) tau_encoder: &'a TorqueEstimate,
    /// The torque that is fed back.
    pub(crate) tau_hat: &'a TorqueEstimate,
    /// Sample period, s.
    pub(crate) dt: f64,
}

/// Terms of the desired torque, N·m.
#[derive(Debug, Clone, Copy)]
struct Terms {
    feedforward: f64,
    force: f64,
    position: f64,
    velocity: f64,
}

/// What the joint does in its mode, with what it remembers there.
#[derive(Debug, Clone)]
enum State {
    /// The drive's own position loop holds at `hold_q`.
    HoldPosition { hold_q: f64, transition: Transition },
    /// The torque law holds at `hold_q`, for drives without a position loop.
    HoldTorque {
        hold_q: f64,
        torque_loop: TorqueLoop,
        transition: Transition,
    },
    /// Follows `tau_d` of the reference.
    Torque {
        torque_loop: TorqueLoop,
        transition: Transition,
    },
    /// Follows `q_d dq_d ddq_d` of the reference.
    InverseDynamics {
        torque_loop: TorqueLoop,
        transition: Transition,
    },
}

impl State {
    fn mode(&self) -> Mode {
        match self {
            Self::HoldPosition { .. } | Self::HoldTorque { .. } => Mode::Hold,
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
    limits: JointLimits,
}

/// The controller of one joint.
#[derive(Debug, Clone)]
pub(crate) struct JointController {
    law: Law,
    /// None before the first command.
    state: Option<State>,
    last: Option<f64>,
}

impl JointController {
    pub(crate) fn new(motor: MotorModel, gains: JointGains, limits: JointLimits) -> Self {
        Self {
            law: Law {
                motor,
                gains,
                limits,
            },
            state: None,
            last: None,
        }
    }

    /// The last command, rad or A; none before the first.
    pub(crate) fn last(&self) -> Option<f64> {
        self.last
    }

    pub(crate) fn motor_and_limits(&self) -> (&MotorModel, &JointLimits) {
        (&self.law.motor, &self.law.limits)
    }

    /// Remembers the command of this cycle after all limits.
    pub(crate) fn commit(&mut self, command: f64) {
        self.last = Some(command);
    }

    /// The record where a command is not finite: the last one stands.
    pub(crate) fn kept(&self, q: f64) -> JointCommanded {
        match self.law.motor {
            MotorModel::Position { .. } => {
                let q_c = self.last.unwrap_or(q);
                JointCommanded {
                    q_c,
                    delta_q: q_c - q,
                    ..JointCommanded::default()
                }
            }
            MotorModel::Current { .. } => JointCommanded {
                current_c: self.last.unwrap_or(0.0),
                ..JointCommanded::default()
            },
        }
    }

    /// The command of this cycle before limits, with its contributions in `commanded`.
    pub(crate) fn update(
        &mut self,
        mode: Mode,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        // Before the first command the robot's pose may still change under the controller.
        let stays = |state: &State| self.last.is_some() && state.mode() == mode;
        let state = match self.state.take().filter(stays) {
            Some(state) => state,
            None => self.law.enter(mode, self.last, input),
        };
        let state = self.state.insert(state);
        let law = &self.law;
        let reference = input.reference;
        let (command, transition) = match state {
            State::HoldPosition { hold_q, transition } => {
                (law.hold_position(*hold_q, input, commanded), transition)
            }
            State::HoldTorque {
                hold_q,
                torque_loop,
                transition,
            } => {
                let terms = law.tracking_terms(*hold_q, 0.0, input);
                (
                    law.torque_command(terms, torque_loop, input, commanded),
                    transition,
                )
            }
            State::Torque {
                torque_loop,
                transition,
            } => {
                let terms = Terms {
                    feedforward: reference.tau_d,
                    force: 0.0,
                    position: 0.0,
                    velocity: 0.0,
                };
                (
                    law.torque_command(terms, torque_loop, input, commanded),
                    transition,
                )
            }
            State::InverseDynamics {
                torque_loop,
                transition,
            } => {
                let terms = law.tracking_terms(reference.q_d, reference.dq_d, input);
                (
                    law.torque_command(terms, torque_loop, input, commanded),
                    transition,
                )
            }
        };
        transition.blend(command, input.dt)
    }
}

impl Law {
    /// The state of a mode that begins now, after the command `last` of the mode before.
    fn enter(&self, mode: Mode, last: Option<f64>, input: &JointInput<'_>) -> State {
        let transition = Transition::from(last);
        let torque_loop = TorqueLoop::default();
        match (mode, self.motor) {
            (Mode::Hold, MotorModel::Position { .. }) => State::HoldPosition {
                hold_q: self.position_with_load(last, input),
                transition,
            },
            (Mode::Hold, MotorModel::Current { .. }) => State::HoldTorque {
                hold_q: input.measured.q,
                torque_loop,
                transition,
            },
            (Mode::Torque, _) => State::Torque {
                torque_loop,
                transition,
            },
            (Mode::InverseDynamics, _) => State::InverseDynamics {
                torque_loop,
                transition,
            },
        }
    }

    /// The set-point that carries the joint's load where it stands: the last command; at the
    /// start, the one that follows from the joint's torque.
    fn position_with_load(&self, last: Option<f64>, input: &JointInput<'_>) -> f64 {
        let (q, tau) = (input.measured.q, input.tau_encoder);
        let lead = match last {
            Some(last) => last - q,
            None if tau.flags & torque_flags::VALID != 0 => self.motor.torque_part(tau.tau),
            None => self.motor.torque_part(0.0),
        };
        q + self.limits.delta_q(lead).value
    }

    fn hold_position(
        &self,
        hold_q: f64,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let delta_q = hold_q - input.measured.q;
        *commanded = JointCommanded {
            delta_q,
            feedback_position: delta_q,
            ..JointCommanded::default()
        };
        hold_q
    }

    /// Terms that follow a position and a velocity by inverse dynamics.
    fn tracking_terms(&self, q_d: f64, dq_d: f64, input: &JointInput<'_>) -> Terms {
        let (measured, torque) = (input.measured, &input.inverse_dynamics);
        // Position feedback uses the newest sample: docs/decisions/0003.
        Terms {
            feedforward: torque.feedforward,
            force: torque.force_feedback,
            position: self.gains.k_s * (q_d - measured.q),
            velocity: self.gains.k_d * (dq_d - measured.dq),
        }
    }

    fn torque_command(
        &self,
        terms: Terms,
        torque_loop: &mut TorqueLoop,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let Terms {
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
        let limited = self.limits.torque(tau_star);
        let friction = self.motor.friction_part(measured.dq);
        //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
        let command = self.motor.torque_part(limited.value) + friction;

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
            flags: limited.flags,
            ..JointCommanded::default()
        };
        match self.motor {
            MotorModel::Position { .. } => measured.q + command,
            MotorModel::Current { .. } => command,
        }
    }
}
