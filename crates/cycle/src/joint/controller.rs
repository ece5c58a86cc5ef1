//! Controller: one joint's state, its law and its limits.

use control::DriveModel;
use control::predictive::PredictiveLaw;
use problem::Problem;
use robot_config::Parameters;
use robot_state::{JointCommanded, command_flags, measured_flags};
use supervisor::{Deviation, Following, Limited, Limiter, Motion, Shown};

use super::carry::Carry;
use super::constants::Constants;
use super::followed::Followed;
use super::hold_guard::HoldGuard;
use super::law::Law;
use super::rest;
use super::sample_gap::{Known, SampleGap};
use super::transition::Stop;
use super::{Gap, JointInput, Trust};
use crate::measure::NOT_USED;
use crate::mode::{Entry, JointGoal, Speed};

/// Torque that a joint whose drive is hot may make at least, over that of its weight: a limit below it would let the
/// joint fall. A payload of a fifth of the limb's mass may be unknown to the model.
const WEIGHT_MARGIN: f64 = 1.2;

#[derive(Debug, Clone)]
pub(super) enum State {
    /// The drive's own position loop holds at `hold_q`, which comes to rest as `stop` does.
    HoldPosition { hold_q: f64, stop: Stop },
    /// Hold and stop of a drive without a position loop.
    Carry(Carry),
    /// The joint follows a desired torque.
    Follow(Followed),
}

impl State {
    /// Whether this state goes on with that goal.
    fn goes_on(&self, goal: &JointGoal) -> bool {
        match (self, goal) {
            (Self::Follow(own), JointGoal::Follow(follow)) => {
                own.mode == follow.mode && follow.entry != Entry::ContactAnew
            }
            (Self::Follow(_), _) | (_, JointGoal::Follow(_)) => false,
            (Self::HoldPosition { .. } | Self::Carry(_), _) => true,
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Controller {
    constants: Constants,
    limiter: Limiter,
    following: Following,
    sample_gap: SampleGap,
    law: Law,
    /// The drive is known to be unlike its model.
    mismatches: bool,
    /// The drive makes torque without a lead.
    integrates: bool,
    /// The joint's only encoder is in doubt since the last mode, and so is the velocity that it shows.
    doubted: bool,
    /// Guard against a swinging hold, of drives that take currents.
    hold_guard: Option<HoldGuard>,
    /// What the joint does; none while no set-points are sent.
    state: Option<State>,
}

impl Controller {
    pub(super) fn new(index: usize, parameters: &Parameters) -> Result<Self, Problem> {
        let joint = &parameters.joints[index];
        Ok(Self {
            constants: Constants {
                drive: joint.drive_model,
                gains: joint.gains,
                limits: joint.limits,
                gear_ratio: joint.encoders.gear_ratio,
                has_link_encoder: joint.has_link_encoder,
                torque_per_current: joint.encoders.gear_ratio
                    * joint.estimator.wave_generator.torque_constant,
                way_per_torque: joint.rotor_way_per_torque(parameters.timing.sample_period),
                torque_velocity: joint.torque_velocity,
                rest_friction: rest::friction(joint, parameters),
                let_go_friction: rest::friction_let_go(joint, parameters),
                unknown_level: rest::unknown_level(joint, parameters),
            },
            following: Following::new(joint.following),
            limiter: Limiter::new(
                joint.limits,
                joint.drive_model,
                parameters.timing.sample_period,
            ),
            sample_gap: SampleGap::default(),
            law: Law::new(index, parameters)?,
            mismatches: false,
            integrates: false,
            doubted: false,
            hold_guard: (!joint.takes_position()).then(|| HoldGuard::new(joint)),
            state: None,
        })
    }

    /// Whether the joint is motor-side only: it feeds back the torque from F/T sensors and IMU, whatever the robot's
    /// law is.
    pub(super) fn is_motor_side_only(&self) -> bool {
        matches!(self.law, Law::MotorSide(_))
    }

    /// Velocity of the link by the law's observer, rad/s; none without one.
    pub(super) fn observed_velocity(&self) -> Option<f64> {
        self.law.link_velocity()
    }

    /// Torque that the command may ask for, N·m, where its drive may make that share of the limit: never less than
    /// what carries its weight, with a margin for what is not known of it.
    pub(super) fn torque_limit(&self, share: f64, weight: f64) -> f64 {
        let limit = self.constants.limits.torque;
        let carries = (WEIGHT_MARGIN * weight.abs()).min(limit);
        (share * limit).max(carries)
    }

    fn takes_current(&self) -> bool {
        !self.constants.drive.takes_position()
    }

    /// The last command, rad or A; none while no set-points are sent.
    pub(super) fn last(&self) -> Option<f64> {
        self.state.as_ref().map(|_| self.limiter.last())
    }

    /// The effect of earlier set-points is forgotten: they end, and begin anew where the joint then stands.
    pub(super) fn forget(&mut self) {
        self.state = None;
        self.sample_gap = SampleGap::default();
        self.following.restart();
        self.law.reset();
    }

    /// No set-points from now on.
    pub(super) fn release(&mut self, q: f64, commanded: &mut JointCommanded) {
        self.forget();
        *commanded = JointCommanded {
            q_c: q,
            ..JointCommanded::default()
        };
    }

    /// The drive begins to behave unlike its model in this cycle, while a mode is followed.
    pub(super) fn begins_to_mismatch_model(&mut self, goal: &JointGoal) -> bool {
        let before = self.mismatches;
        let follows = matches!(goal, JointGoal::Follow(_));
        let unlike = (self.law.predictive()).is_some_and(PredictiveLaw::drive_is_unlike);
        self.mismatches = unlike && (before || follows);
        self.mismatches && !before
    }

    /// Whether the joint first shows in this cycle that its drive integrates without being configured so.
    pub(super) fn begins_to_integrate(&mut self) -> bool {
        let integrates = (self.law.predictive()).is_some_and(PredictiveLaw::drive_integrates);
        integrates && !std::mem::replace(&mut self.integrates, integrates)
    }

    /// The hold has begun to swing its joint, in this cycle.
    pub(super) fn begins_to_swing(&mut self) -> bool {
        (self.hold_guard.as_mut()).is_some_and(HoldGuard::take_news)
    }

    /// The command of this cycle within all limits, with its contributions in `commanded`. Returns
    /// how the drive deviates from those before, and whether that begins.
    pub(super) fn update(
        &mut self,
        goal: &JointGoal,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> Option<(Deviation, bool)> {
        let motion = self.constants.motion(input);
        let known = self.known_velocities(&motion, input);
        let motion = self.constants.moving_at(known, motion);
        let input = &JointInput {
            gap: self.resume(input.gap),
            ..*input
        };
        self.law.observe(&self.constants, &motion, input);
        let after_gap = (self.law.predictive()).and_then(PredictiveLaw::velocities_after_gap);
        let deviation = self.deviation(&motion, (known, after_gap), input);
        let is_doubtful = matches!(deviation, Some((Deviation::Doubtful, _)));
        self.doubted |= self.is_motor_side_only() && is_doubtful;
        self.guard_hold(input);
        let asked = self.command(goal, &motion, input, commanded);
        let after_gap = after_gap.map(|[_, rotor]| rotor);
        let quick =
            (self.observed_rotor()).and_then(|rotor| self.constants.quick_velocity(rotor, &motion));
        self.limiter.judge_by(after_gap.or(quick));
        let limited = if self.may_have_slipped(known) {
            self.limiter.hold(self.limiter.last(), &motion, false)
        } else {
            self.limit(goal, asked, &motion, input)
        };
        self.following.note_sent(limited.applied);
        commanded.following_error = self.following.error();
        self.law.sent(limited.applied);
        self.publish(&limited, &motion, commanded);
        deviation
    }

    /// Watches the hold of a drive that takes currents. One that swings its joint ends.
    fn guard_hold(&mut self, input: &JointInput<'_>) {
        let Some(guard) = &mut self.hold_guard else {
            return;
        };
        match &mut self.state {
            Some(State::Carry(carry)) => {
                guard.observe(input.measured, input.shown, carry.integral(), input.dt);
                if guard.swings() {
                    carry.let_loose();
                }
            }
            _ => guard.rest(),
        }
    }

    /// The loop returns after a gap: in a long one the drive has braked the joint, and a law goes on that controls its
    /// torque. A joint that stood has not been braked: what the law knew of it still holds.
    fn resume(&mut self, gap: Gap) -> Gap {
        let rest = self.constants.limits.rest;
        let moved = self.law.link_velocity().is_some_and(|dq| dq.abs() > rest);
        let braked = moved && !matches!(gap, Gap::Overslept(_));
        if self.limiter.resume(gap.periods(), braked) && braked {
            Gap::Braked(gap.periods())
        } else {
            gap
        }
    }

    /// Velocity of the rotor by the law's observer, link side, rad/s, while it makes the command: the filter of the measured
    /// one is 8 ms late, in which a hand changes the torque of a stiff drive's damping by more than may change in a cycle.
    fn observed_rotor(&self) -> Option<f64> {
        let rotor = self.law.predictive()?.rotor_velocity();
        rotor.filter(|_| matches!(self.state, Some(State::Follow(_))))
    }

    /// Velocities of link and motor as far as samples that stayed away leave them known.
    fn known_velocities(&mut self, motion: &Motion, input: &JointInput<'_>) -> Known {
        let measured = input.measured;
        let filtered = [measured.dq, measured.omega / self.constants.gear_ratio];
        let usable = measured.flags & NOT_USED == 0;
        let angles = usable.then_some([motion.q, motion.theta]);
        self.sample_gap.update(angles, filtered, input.dt)
    }

    /// A joint that follows a torque seems to have moved while its samples stayed away, and its drive, which takes
    /// positions, does not show that: its encoders may have slipped, and its set-point stays.
    fn may_have_slipped(&self, known: Known) -> bool {
        let doubtful = match known {
            Known::Filtered(_) => false,
            Known::Before(_) => true,
            Known::After(_) => self.following.exceeds(),
        };
        let follows = matches!(self.state, Some(State::Follow(_)));
        doubtful && follows && !self.takes_current()
    }

    /// How the drive deviates from its commands, and whether that begins; `after_gap`: velocities of link and rotor
    /// that no filter knows yet after a gap of the loop, rad/s.
    fn deviation(
        &mut self,
        motion: &Motion,
        (known, after_gap): (Known, Option<[f64; 2]>),
        input: &JointInput<'_>,
    ) -> Option<(Deviation, bool)> {
        if input.measured.flags & measured_flags::MISSED != 0 {
            self.following.miss();
            return None;
        }
        let after_gap = match known {
            Known::Filtered(_) => after_gap,
            Known::Before(_) => {
                self.following.miss();
                return None;
            }
            Known::After(velocities) => Some(velocities),
        };
        let integral = self.law.predictive();
        let integral = integral.map_or(0.0, PredictiveLaw::drive_integral_torque);
        let shown = (self.constants).shown(input.measured, motion, after_gap, integral, input.dt);
        self.following.update(&Shown {
            followed: matches!(self.state, Some(State::Follow(_))),
            // The position of a joint whose encoders contradict each other is the last one before.
            blind: input.trust == Trust::Distrusted && !self.takes_current(),
            ..shown
        })
    }

    /// The command within all limits.
    fn limit(
        &mut self,
        goal: &JointGoal,
        asked: f64,
        motion: &Motion,
        input: &JointInput<'_>,
    ) -> Limited {
        let by_torque = self.constants.torque_velocity;
        self.limiter.allow_velocity(match goal {
            JointGoal::Follow(follow) => match follow.speed {
                Speed::Motion => self.constants.limits.velocity,
                Speed::Torque => by_torque,
                Speed::TorqueBeside(dq_d) => by_torque + dq_d,
            },
            _ => self.constants.limits.velocity,
        });
        self.limiter.allow_torque(match &self.state {
            // What brakes a joint in a fault is not held back.
            Some(State::Carry(carry)) if carry.is_damped() => self.constants.limits.torque,
            _ => input.torque_limit,
        });
        match &self.state {
            Some(State::HoldPosition { .. }) => {
                // Nor does it give way to what an encoder in doubt shows.
                let usable = input.measured.flags & NOT_USED == 0 && !self.doubted;
                self.limiter.hold(asked, motion, usable)
            }
            Some(State::Carry(carry)) => {
                let weight = carry.weight();
                let motion = Motion { weight, ..*motion };
                let limited = if carry.is_damped() {
                    self.limiter.stop(asked, &motion)
                } else {
                    self.limiter.limit(asked, &motion)
                };
                let stops = !matches!(goal, JointGoal::Hold);
                let guard = self.hold_guard.as_ref();
                if guard.is_some_and(|guard| guard.forbids(limited.applied, stops)) {
                    self.limiter.no_current(asked)
                } else {
                    limited
                }
            }
            _ => self.limiter.limit(asked, motion),
        }
    }

    fn publish(&self, limited: &Limited, motion: &Motion, commanded: &mut JointCommanded) {
        if limited.flags & command_flags::NOT_FINITE != 0 {
            // The cause of it is no contribution to the command that stands.
            *commanded = JointCommanded {
                following_error: commanded.following_error,
                ..JointCommanded::default()
            };
        }
        commanded.asked = limited.asked;
        commanded.torque_limit = self.limiter.torque();
        commanded.flags |= limited.flags | command_flags::ENGAGED;
        match &self.constants.drive {
            DriveModel::Position(_) => {
                commanded.q_c = limited.applied;
                commanded.delta_q = limited.applied - motion.q;
            }
            DriveModel::Current(_) => commanded.current_c = limited.applied,
        }
    }

    /// The command before limits.
    fn command(
        &mut self,
        goal: &JointGoal,
        motion: &Motion,
        input: &JointInput<'_>,
        commanded: &mut JointCommanded,
    ) -> f64 {
        self.begin(goal, motion, input);
        let (constants, law) = (&self.constants, &mut self.law);
        let resumed = match input.gap {
            Gap::Braked(_) => law.go_on(),
            _ => None,
        };
        match (self.state.as_mut(), goal) {
            (Some(State::Follow(own)), JointGoal::Follow(follow)) => {
                if let Some((torque, dq)) = resumed {
                    own.resume(torque, follow, (input.measured.q, dq), constants);
                }
                let desired = own.desired(follow, law, constants, input);
                law.command(&desired, &mut own.transition, constants, input, commanded)
            }
            (Some(State::HoldPosition { hold_q, stop }), _) => {
                law.rest(input);
                *hold_q += stop.way(input.dt);
                constants.hold_position(*hold_q, motion, commanded)
            }
            (Some(State::Carry(carry)), _) => {
                law.rest(input);
                let measured = input.measured;
                let velocities = [measured.dq, measured.omega / constants.gear_ratio];
                carry.skip(input.gap.periods());
                carry.update(
                    &constants.carry_parameters(),
                    (motion, velocities),
                    input.trust == Trust::Sound,
                    input.dt,
                    commanded,
                )
            }
            // Not reached: a goal to follow has begun to be followed.
            (Some(State::Follow(_)) | None, _) => self.limiter.last(),
        }
    }

    /// Makes the state anew where the goal is another one than before.
    fn begin(&mut self, goal: &JointGoal, motion: &Motion, input: &JointInput<'_>) {
        let last = match &self.state {
            Some(_) => self.limiter.last(),
            None => self.limiter.start(motion, self.constants.load(input)),
        };
        if self.state.as_ref().is_some_and(|state| state.goes_on(goal)) {
            return;
        }
        let from = self.law.begin(last, &self.constants, motion, input);
        // A drive that had the same set-point for so long stands.
        let overslept = matches!(input.gap, Gap::Overslept(_));
        let dq = if overslept { 0.0 } else { motion.dq };
        self.doubted &= !matches!(goal, JointGoal::Follow(_));
        let motion = Motion { dq, ..*motion };
        let state = self
            .constants
            .enter(goal, (last, from), &motion, input, self.doubted);
        self.state = Some(state);
    }
}
