//! The limits of a set-point: its motion first, then how far it leads the joint, then rate and power of its torque, and
//! how a held one gives way.

use control::PositionDrive;
use robot_state::command_flags;

use super::{Limiter, Motion, RESUMING_CONTROLLED, RESUMING_SHARE, YIELD_SPEED};

/// Torque that a lead over the motor makes, and back.
struct Lead<'d> {
    drive: &'d PositionDrive,
    theta: f64,
    /// Velocity of the motor, rad/s, link side.
    omega: f64,
}

impl Lead<'_> {
    fn torque(&self, x: f64) -> f64 {
        (x - self.theta - self.drive.k_v * self.omega) / self.drive.k_tau_motor
    }

    fn set_point(&self, torque: f64) -> f64 {
        self.theta + self.drive.k_v * self.omega + self.drive.k_tau_motor * torque
    }
}

impl Limiter {
    /// The set-point that may be sent instead of `asked`, rad, and the limits that acted. `held`: it holds, and whether
    /// the sample is usable.
    pub(super) fn limit_position(
        &mut self,
        drive: &PositionDrive,
        asked: f64,
        motion: &Motion,
        held: Option<bool>,
    ) -> (f64, u32) {
        let mut flags = 0;
        let moved = self.within_motion(asked, &mut flags);
        let range = self.led_by_either_encoder(drive, motion);
        let led = moved.clamp(range.0, range.1);
        if led != moved {
            flags |= if self.limits.lead < drive.k_tau * self.torque {
                command_flags::LEAD_LIMITED
            } else {
                command_flags::TORQUE_LIMITED
            };
        }
        // Rate and power: of the torque that the lead over the motor makes.
        let lead = Lead {
            drive,
            theta: motion.theta,
            omega: self.motor_velocity.unwrap_or(motion.dq),
        };
        let made = lead.torque(led);
        let allowed = self.within_rate_and_power(&lead, made, motion, held, &mut flags);
        let x = if allowed == made {
            led
        } else {
            // By a wrong velocity of the motor it would lead further than the torque limit.
            lead.set_point(allowed).clamp(range.0, range.1)
        };
        self.last_torque = allowed;
        let Some(usable) = held else {
            return (x, flags);
        };
        if usable {
            self.give_way(x - moved);
        }
        let x = moved + self.yielded;
        self.last_torque = lead.torque(x).clamp(-self.torque, self.torque);
        (x, flags)
    }

    /// How fast the set-point itself may move, and where to.
    fn within_motion(&self, asked: f64, flags: &mut u32) -> f64 {
        let last = self.last - self.yielded;
        let (down, up) = self.allowed_velocity(last);
        let step = self.sample_period;
        let x = asked.clamp(last - down * step, last + up * step);
        if x != asked {
            let outward = if asked > last { up } else { down };
            *flags |= if outward < self.velocity {
                command_flags::POSITION_LIMITED
            } else {
                command_flags::VELOCITY_LIMITED
            };
        }
        x
    }

    /// The set-points that by one encoder at least lead the joint by no more than the torque limit.
    fn led_by_either_encoder(&self, drive: &PositionDrive, motion: &Motion) -> (f64, f64) {
        let most = self.limits.lead;
        let ends = |tau: f64| {
            let link = motion.q + (drive.k_tau * tau).clamp(-most, most);
            let motor = motion.theta + (drive.k_tau_motor * tau).clamp(-most, most);
            (link, motor)
        };
        let ((a, b), (c, d)) = (ends(self.torque), ends(-self.torque));
        let (low, high) = (
            c.min(d) + drive.k_v * motion.dq.min(0.0),
            a.max(b) + drive.k_v * motion.dq.max(0.0),
        );
        (low.min(high), high.max(low))
    }

    /// The torque that may be made instead of `made`, N·m.
    fn within_rate_and_power(
        &mut self,
        lead: &Lead<'_>,
        made: f64,
        motion: &Motion,
        held: Option<bool>,
        flags: &mut u32,
    ) -> f64 {
        let change = self.limits.torque_rate * self.sample_period;
        let (mut low, mut high) = (self.last_torque - change, self.last_torque + change);
        let resumes = self.resuming > 0 && held.is_none();
        self.resuming = self.resuming.saturating_sub(1);
        if resumes {
            // The drive's motion by the last command may end.
            let allowed = if self.controlled {
                RESUMING_CONTROLLED * self.torque
            } else {
                RESUMING_SHARE * change
            };
            let kept = lead.torque(self.last);
            (low, high) = (kept.min(0.0) - allowed, kept.max(0.0) + allowed);
        }
        let mut wanted = made.max(low).min(high);
        if wanted != made && (resumes || wanted.abs() < made.abs()) {
            *flags |= command_flags::TORQUE_RATE_LIMITED;
            self.kept_back = made - wanted;
        } else {
            // A torque that falls is never held up.
            wanted = made;
        }
        if wanted * motion.dq > self.limits.power {
            *flags |= command_flags::POWER_LIMITED;
            wanted = self.limits.power / motion.dq;
        }
        wanted
    }

    /// A held set-point gives way by so much more, rad, slowly and no further than it may.
    fn give_way(&mut self, asked: f64) {
        let change = YIELD_SPEED * self.limits.velocity * self.sample_period;
        let yielded = asked.clamp(self.yielded - change, self.yielded + change);
        let most = self.limits.gives_way;
        self.yielded = yielded.clamp(-most, most);
    }
}
