//! Motor side only: feedback of a torque that is late, of joints without a link-side encoder.
//!
//! In: the desired torque, and the torque from F/T sensors and IMU, late by their filters. Out: `tau*`, the
//! torque that the motor is to produce. The two are compared as of one instant:
//!
//! ```text
//! tau* = tau_d + clamp(K_p e + K_i integral(e))     e = h * r * tau_d - tau_hat
//! ```
//!
//! `h`: the smoothing of those filters; `r`: the lag of the joint's own torque behind the desired one. So a
//! step that is followed makes no error, while D11, which compares `tau_d` now with a torque of 40 ms ago,
//! overshoots by `K_p` times the step. Friction is foreseen, as the predictive law does: by a bristle that the
//! desired torque, which winds up the gear, and the joint's motion bend. What is left to correct is what the
//! motor model does not explain: the rest of the friction, errors of the drive's stiffness. The feedback is
//! limited to that much, and while joint and desired torque stand, it stands as well (`stand.rs`): an F/T
//! sensor that fails does not set a joint in motion. A torque that is found invalid takes back what it has led
//! to in the last [`BELIEVED_AFTER_S`].

mod stand;

use control::JointGains;
use control::predictive::{DriveLoop, LawParameters, TorqueTerms, Turned};
use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{JointParameters, Parameters};
use robot_state::JointCommanded;
use stand::Stand;

use super::{Desired, against_friction, lead_motor};
use crate::joint::JointInput;
use crate::joint::constants::Constants;
use crate::joint::transition::Transition;

/// Coulomb friction over the one in motion, by which it holds a joint at rest. Chosen on the simulated robots, whose
/// joints have 1.2 to 1.3 (`static_ratio` of config/*/sim.toml), and a margin.
const STICTION: f64 = 1.5;
/// Share of the desired torque by which stiffness and torque constant may be wrong: between the root mean square (0.28)
/// and the sum (0.4) of a fifth each. Chosen; no experiment recorded.
const MODEL_SHARE: f64 = 0.35;
/// Time until the feedback that a torque has led to is believed, s: once to twice this time is taken back, more
/// than the filters and the check of the torque take.
const BELIEVED_AFTER_S: f64 = 0.1;

/// The feedback of one joint.
#[derive(Debug, Clone)]
pub(in crate::joint) struct MotorSide {
    /// Share of a change by which the joint's torque follows in a cycle, and that torque, N·m.
    share: f64,
    lagged: f64,
    filters: FilterBank,
    integral: f64,
    law: LawParameters,
    /// The bristle's torque, N·m, and the desired torque of the last cycle.
    friction: f64,
    last: f64,
    /// Friction and dead zone, N·m.
    unexplained: f64,
    torque_limit: f64,
    /// Allowed feedback while the joint stands; none before a mode's first cycle.
    stand: Option<Stand>,
    /// The feedback once and twice `BELIEVED_AFTER_S` ago, N·m, the time since the newer one, s, and whether the
    /// estimate was valid in the last cycle.
    believed: [f64; 2],
    since: f64,
    was_valid: bool,
}

impl MotorSide {
    pub(in crate::joint) fn new(
        joint: &JointParameters,
        parameters: &Parameters,
    ) -> Result<Self, Problem> {
        let (dt, law) = (parameters.timing.sample_period, &joint.law);
        // Torque of the spring across the dead zone.
        let dead_zone = match law.drive {
            DriveLoop::Position { dead_zone, .. } => law.drive_stiffness() * dead_zone,
            DriveLoop::Current { .. } => 0.0,
        };
        Ok(Self {
            share: dt / (dt + law.torque_lag()),
            lagged: 0.0,
            filters: FilterBank::new(1, parameters.filters.long.sensor)?,
            integral: 0.0,
            law: *law,
            friction: 0.0,
            last: 0.0,
            unexplained: STICTION * law.friction.level + dead_zone,
            torque_limit: joint.limits.torque,
            stand: None,
            believed: [0.0; 2],
            since: 0.0,
            was_valid: false,
        })
    }

    /// Takes the torque that is desired now, or where none is, the estimated one; returns it as the
    /// estimate will show it, N·m.
    fn follow(&mut self, torque: f64) -> f64 {
        if torque.is_finite() {
            self.lagged += self.share * (torque - self.lagged);
        }
        self.filters.update(&[self.lagged]);
        self.filters.values().first().copied().unwrap_or(torque)
    }

    /// No torque is followed in this cycle; `estimated`: the late one, where it is valid.
    pub(super) fn rest(&mut self, estimated: Option<f64>) {
        if let Some(torque) = estimated {
            self.follow(torque);
        }
    }

    /// A mode begins after a command that leads the motor by `lead`, rad, without what is against its
    /// velocity. Returns the torque from which the desired one is to be led: the estimated one, as the rest
    /// of what the lead makes is friction, and what the feedback is for.
    pub(super) fn begin(&mut self, lead: f64, estimated: Option<f64>, gains: &JointGains) -> f64 {
        let made = self.law.motor_torque(lead, 0.0);
        let level = self.law.friction.level;
        let rest = estimated.map_or(0.0, |tau_hat| made - tau_hat);
        self.friction = rest.max(-level).min(level);
        self.integral = match estimated {
            Some(tau_hat) if gains.k_i > 0.0 => self.within(rest - self.friction, tau_hat),
            _ => 0.0,
        };
        (self.stand, self.believed, self.since) = (None, [self.integral; 2], 0.0);
        self.was_valid = estimated.is_some();
        self.last = made - self.friction - self.integral;
        self.last
    }

    /// As much of a feedback as is allowed at a desired torque, N·m.
    fn within(&self, feedback: f64, tau_d: f64) -> f64 {
        let most = self.unexplained + MODEL_SHARE * tau_d.abs();
        // max and min, not clamp: they cannot panic.
        feedback.max(-most).min(most)
    }

    /// tau*: the torque that the motor is to produce, N·m, for the desired one and the late estimate,
    /// without which the feedback stays as it is; `angle`: the motor's, link side.
    pub(super) fn update(
        &mut self,
        (tau_d, estimated): (f64, Option<f64>),
        angle: f64,
        gains: &JointGains,
        dt: f64,
    ) -> f64 {
        let shown = self.follow(tau_d);
        let error = estimated.map_or(0.0, |tau_hat| shown - tau_hat);
        self.believe(estimated.is_some(), dt);
        let proportional = gains.k_p * error;
        let asked = proportional + self.integral + gains.k_i * error * dt;
        let stand = (self.stand).get_or_insert(Stand::at(angle, self.integral, tau_d, 0.0));
        let bound = stand.bound((angle, tau_d), asked, self.torque_limit, dt);
        let feedback = self.within(bound, tau_d);
        // Torque beyond the limits is not gathered.
        if feedback.is_finite() {
            self.integral = feedback - proportional;
        }
        tau_d + self.within(proportional + self.integral, tau_d)
    }

    /// The command for the desired torque, rad or A, to which `transition` leads: the torque, as its feedback has to
    /// know it.
    pub(super) fn command(
        &mut self,
        desired: &Desired,
        transition: &mut Transition,
        joint: &Constants,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let tau_d = desired.terms.sum();
        let led = transition.blend(tau_d, input.dt);
        let desired = Desired {
            terms: TorqueTerms {
                feedforward: desired.terms.feedforward + led - tau_d,
                ..desired.terms
            },
            ..*desired
        };
        let tau_d = desired.terms.sum();
        let angle = input.measured.theta / joint.gear_ratio;
        let tau_star = self.update((tau_d, input.torque()), angle, &joint.gains, input.dt);
        let limit = joint.limits.torque;
        let lead = joint.drive.torque_part(tau_star.clamp(-limit, limit));
        let friction = against_friction(joint, input)
            + self.against_friction(tau_d, lead, input.measured.dq, input.dt);
        lead_motor(&desired, (tau_star, friction), joint, input, commanded)
    }

    /// Takes back what a torque has led to that is found invalid, as it may have erred before.
    fn believe(&mut self, valid: bool, dt: f64) {
        if self.was_valid && !valid {
            self.integral = self.believed[1];
        }
        self.was_valid = valid;
        self.since += dt;
        if self.since > BELIEVED_AFTER_S || !valid {
            (self.believed, self.since) = ([self.integral, self.believed[0]], 0.0);
        }
    }

    /// The lead against friction and dead zone, rad, for the desired torque, the lead that makes the motor's,
    /// rad, and the joint's velocity, rad/s.
    pub(super) fn against_friction(&mut self, tau_d: f64, lead: f64, dq: f64, dt: f64) -> f64 {
        let turned = (tau_d - self.last) / self.law.gear.at(tau_d) + dq * dt;
        let friction = (self.law.friction).after(self.friction, &Turned::asked(turned));
        if friction.is_finite() && tau_d.is_finite() {
            (self.friction, self.last) = (friction, tau_d);
        }
        let DriveLoop::Position { stiffness, .. } = self.law.drive else {
            return 0.0;
        };
        let bristle = self.friction / stiffness;
        bristle + self.law.dead_zone_inverse(lead + bristle)
    }
}
