//! Limits of one joint's command: the last word, whatever came before.
//!
//! Each limit that acts is recorded: which, what was asked, what was applied. For a command that is not finite the last
//! one stands.
//!
//! Position-commanded drives. A command is a spring of the drive's stiffness between its own and the measured
//! position: torque limits are limits on how far a command leads the joint. *Motion* limits come first: the set-point
//! moves no faster than the velocity limit and, near a position limit, no faster than the configured deceleration can
//! stop; outside the limits only inwards. The *lead* comes last, by both encoders: a set-point is pulled towards the
//! joint only where each of them indicates that it leads too far, so that no single encoder can move a joint. A *held*
//! set-point gives way to a load by a small angle and slowly, and not at all by samples that cannot be used: two
//! encoders that fail alike, e.g. by frames of another joint, must not lead it away.
//!
//! Current-commanded drives. The torque is limited in size, rate and power, and by the velocity that the distance to
//! the position limits allows by both encoders: the less of it is left the less torque, and beyond it braking.

mod current;
mod limits;
mod position;

use control::DriveModel;
pub use limits::{Braking, Limits};
use robot_state::command_flags;

/// Where the joint is and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// q: link-side angle, rad.
    pub q: f64,
    /// theta/N: motor-side angle on the link side, rad.
    pub theta: f64,
    /// dq: velocity, rad/s.
    pub dq: f64,
    /// Torque that carries the joint's weight, N·m, as far as it is known.
    pub weight: f64,
}

/// A command that may be sent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limited {
    /// Command before the limits, rad or A.
    pub asked: f64,
    /// Command after the limits, rad or A.
    pub applied: f64,
    /// Bits of [`command_flags`]: the limits that acted; zero if `applied` is what was asked.
    pub flags: u32,
}

/// A torque rate that was limited is noted where the torque stayed behind by this share of the torque limit, or for
/// several cycles in a row to one side. Less is noise of what is measured, by stiff drives or short periods.
/// Chosen; no experiment recorded.
const RATE_NOTABLE_SHARE: f64 = 0.05;
const RATE_NOTABLE_CYCLES: i32 = 5;

/// Greatest velocity at which a held set-point gives way, share of the velocity limit (docs/safety-promises.md, 2).
/// Chosen; no experiment recorded.
const YIELD_SPEED: f64 = 0.03;

/// Greatest velocity at which a drive that takes currents leads a joint back that is beyond its position limits, share of
/// the velocity limit; and how far beyond, over the way from which on it is as fast as that. Further out it is kept from
/// going on, but not led back: an encoder that lies by a radian must not move it. Chosen; no experiment recorded.
const RETURN_SHARE: f64 = 0.05;
const RETURN_DEPTH: f64 = 3.0;

/// Skipped periods from which on the loop resumes slowly, and the cycles for which it does, of position and of current
/// drives: a position drive brakes while its set-point stands, and must not be kept from following again.
const RESUMED_FROM: u32 = 5;
const RESUMING: [u32; 2] = [8, 40];
/// Share of the torque's rate with which a loop that resumes slowly begins. Chosen; no experiment recorded.
const RESUMING_SHARE: f64 = 0.1;
/// Share of the torque limit within which a law that goes on from the torque that is may move the motor's at once. To
/// lead a gear that is wound up back slowly takes quick torques of the motor; held back they let it swing.
/// Chosen on the simulated leg, lift-gripper and humanoid (docs/control-law.md, A gap of the loop).
const RESUMING_CONTROLLED: f64 = 0.3;

/// The limiter of one joint.
#[derive(Debug, Clone)]
pub struct Limiter {
    limits: Limits,
    drive: DriveModel,
    sample_period: f64,
    /// Greatest |dq| for now, rad/s, and torque, N·m.
    velocity: f64,
    torque: f64,
    /// The command sent last, rad or A.
    last: f64,
    /// The angle by which it has given way while it is held, rad.
    yielded: f64,
    /// The torque of that command, N·m.
    last_torque: f64,
    /// Cycles left in which the torque rises slowly, as the loop has not run for some.
    resuming: u32,
    controlled: bool,
    /// Velocity of the motor where it is known better than by its encoder's filter, rad/s.
    motor_velocity: Option<f64>,
    /// Share of the velocity limit at which a current may lead a joint back into its position limits.
    return_share: f64,
    /// Torque by which the rate limit keeps this cycle's command back, N·m, and cycles in a row to this side (sign).
    kept_back: f64,
    keeps_back: i32,
}

impl Limiter {
    /// A limiter for commands to this `drive`, one `sample_period` (s) apart.
    #[must_use]
    pub fn new(limits: Limits, drive: DriveModel, sample_period: f64) -> Self {
        Self {
            limits,
            drive,
            sample_period,
            velocity: limits.velocity,
            torque: limits.torque,
            last: 0.0,
            yielded: 0.0,
            last_torque: 0.0,
            resuming: 0,
            controlled: false,
            motor_velocity: None,
            return_share: RETURN_SHARE,
            kept_back: 0.0,
            keeps_back: 0,
        }
    }

    /// The loop has not run for so many periods, in which the drive has kept its command. What it makes of that may end
    /// at once; beyond it the torque rises slowly at first, until velocities are again those of the joint.
    /// `controlled`: the law goes on from the gear's torque that is, and may move a position drive's by a share of its
    /// limit. Returns whether the periods were so many.
    pub fn resume(&mut self, skipped: u32, controlled: bool) -> bool {
        let resumes = skipped >= RESUMED_FROM;
        if resumes {
            self.controlled = controlled;
            self.resuming = match self.drive {
                DriveModel::Position(_) => RESUMING[0],
                DriveModel::Current(_) => RESUMING[1],
            };
        }
        resumes
    }

    /// Starts at a command: the position that carries `torque` (N·m) where the joint stands, or
    /// that torque's current. Returns the command.
    pub fn start(&mut self, motion: &Motion, torque: f64) -> f64 {
        self.yielded = 0.0;
        let limit = self.limits.torque;
        let torque = if torque.is_finite() {
            torque.clamp(-limit, limit)
        } else {
            0.0
        };
        (self.last, self.last_torque) = match &self.drive {
            DriveModel::Position(drive) => {
                let lead = (drive.k_tau * torque).clamp(-self.limits.lead, self.limits.lead);
                let command = motion.q + lead;
                // By the motor side, as every later torque: the two differ by the gear's model.
                (command, (command - motion.theta) / drive.k_tau_motor)
            }
            DriveModel::Current(drive) => {
                let most = drive.current_limit;
                ((torque / drive.k_1).clamp(-most, most), torque)
            }
        };
        self.last
    }

    /// The command sent last, rad or A.
    #[must_use]
    pub fn last(&self) -> f64 {
        self.last
    }

    /// From now on the joint may move no faster than this, rad/s, and than its limit. The damping by which a
    /// current-commanded drive can be braked needs some way to it: at rest the whole torque is allowed.
    pub fn allow_velocity(&mut self, velocity: f64) {
        let least = self.limits.torque / self.limits.braking.damping;
        self.velocity = velocity.max(least).min(self.limits.velocity);
    }

    /// From now on the torque may be no greater than this, N·m, and than its limit; but for braking in a fault.
    pub fn allow_torque(&mut self, torque: f64) {
        self.torque = torque.clamp(0.0, self.limits.torque);
    }

    /// Torque that is allowed at present, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.torque
    }

    /// Link-side velocity of the motor, rad/s, by an observer; none: that of the motion. The rate of a position drive's
    /// torque is judged by it: the filter of the measured velocity is late, or has a gap in its window.
    pub fn judge_by(&mut self, motor_velocity: Option<f64>) {
        self.motor_velocity = motor_velocity.filter(|omega| omega.is_finite());
    }

    /// The command that may be sent instead of `asked`.
    pub fn limit(&mut self, asked: f64, motion: &Motion) -> Limited {
        self.yielded = 0.0;
        self.limited(asked, motion, None)
    }

    /// What may be sent instead of a current that brakes in a fault, which the rate limit must not hold back. A joint
    /// beyond its position limits is kept from going further, and is not led back.
    pub fn stop(&mut self, asked: f64, motion: &Motion) -> Limited {
        if let DriveModel::Current(drive) = &self.drive
            && asked.is_finite()
        {
            let limit = self.limits.torque;
            self.last_torque = (drive.k_1 * asked).clamp(-limit, limit);
        }
        self.return_share = 0.0;
        let limited = self.limit(asked, motion);
        self.return_share = RETURN_SHARE;
        limited
    }

    /// What may be sent instead of a set-point that holds: it gives way to a load by a small angle, and stays where
    /// the sample is not `usable`.
    pub fn hold(&mut self, asked: f64, motion: &Motion, usable: bool) -> Limited {
        self.limited(asked, motion, Some(usable))
    }

    /// No current at all, at once, whatever was sent before: where any would drive a joint that is to stand.
    pub fn no_current(&mut self, asked: f64) -> Limited {
        (self.last, self.last_torque) = (0.0, 0.0);
        (self.kept_back, self.keeps_back) = (0.0, 0);
        Limited {
            asked,
            ..Limited::default()
        }
    }

    /// `held`: the set-point holds, and whether the sample is usable.
    fn limited(&mut self, asked: f64, motion: &Motion, held: Option<bool>) -> Limited {
        self.kept_back = 0.0;
        let (applied, flags) = if !asked.is_finite() {
            (self.last, command_flags::NOT_FINITE)
        } else {
            match self.drive {
                DriveModel::Position(drive) => self.limit_position(&drive, asked, motion, held),
                DriveModel::Current(drive) => self.limit_current(&drive, asked, motion),
            }
        };
        // The last resort, should a measurement be worse than thought: what was sent before.
        if applied.is_finite() {
            self.last = applied;
        }
        let applied = self.last;
        Limited {
            asked,
            applied,
            flags: flags | self.trimmed(flags),
        }
    }

    /// [`command_flags::RATE_TRIMMED`] where the rate limit took no more than noise.
    fn trimmed(&mut self, flags: u32) -> u32 {
        if flags & command_flags::TORQUE_RATE_LIMITED == 0 {
            self.keeps_back = 0;
            return 0;
        }
        let side = if self.kept_back > 0.0 { 1 } else { -1 };
        self.keeps_back = side * ((side * self.keeps_back).max(0) + 1).min(RATE_NOTABLE_CYCLES);
        let much = RATE_NOTABLE_SHARE * self.limits.torque;
        if self.kept_back.abs() > much || self.keeps_back.abs() >= RATE_NOTABLE_CYCLES {
            0
        } else {
            command_flags::RATE_TRIMMED
        }
    }

    /// Greatest velocity towards each end, down and up, rad/s: the limit, less where the distance
    /// that is left asks for braking; beyond the end none, and for a current-commanded drive close
    /// to it the negative of the velocity with which it is to return.
    fn allowed_velocity(&self, position: f64) -> (f64, f64) {
        let Limits {
            position_min,
            position_max,
            deceleration,
            braking,
            ..
        } = self.limits;
        let velocity = self.velocity;
        // s = v T + v² / (2 a); beyond the limit, back.
        let lost = deceleration * braking.time;
        let towards = |room: f64| {
            if room < 0.0 {
                let (back, most) = (-room / braking.return_time, self.return_share * velocity);
                return if back < RETURN_DEPTH * most {
                    -back.min(most)
                } else {
                    0.0
                };
            }
            ((lost * lost + 2.0 * deceleration * room).sqrt() - lost).clamp(0.0, velocity)
        };
        (
            towards(position - position_min),
            towards(position_max - position),
        )
    }
}
