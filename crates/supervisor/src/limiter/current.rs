//! The limits of a current: size, rate and power of its torque, and the velocity that the way to the position limits
//! allows.

use control::CurrentDrive;
use robot_state::command_flags;

use super::{Limiter, Motion, RESUMING_SHARE};

impl Limiter {
    /// The current that may be sent instead of `asked`, A, and the limits that acted.
    pub(super) fn limit_current(
        &mut self,
        drive: &CurrentDrive,
        asked: f64,
        motion: &Motion,
    ) -> (f64, u32) {
        let mut flags = 0;
        let tau = self.within_size_and_rate(drive.k_1 * asked, &mut flags);
        let tau = if tau * motion.dq > self.limits.power {
            flags |= command_flags::POWER_LIMITED;
            self.limits.power / motion.dq
        } else {
            tau
        };
        let tau = self.within_allowed_velocity(tau, motion, &mut flags);
        self.last_torque = tau;
        let most = drive.current_limit;
        let applied = (tau / drive.k_1).clamp(-most, most);
        if applied != tau / drive.k_1 {
            flags |= command_flags::TORQUE_LIMITED;
        }
        (applied, flags)
    }

    fn within_size_and_rate(&mut self, asked: f64, flags: &mut u32) -> f64 {
        let share = match self.resuming {
            0 => 1.0,
            _ => RESUMING_SHARE,
        };
        self.resuming = self.resuming.saturating_sub(1);
        let change = share * self.limits.torque_rate * self.sample_period;
        let mut bounded = |x: f64, bound: f64, flag: u32| {
            let y = x.clamp(-bound, bound);
            if y != x {
                *flags |= flag;
            }
            y
        };
        let within = bounded(asked, self.torque, command_flags::TORQUE_LIMITED);
        let step = within - self.last_torque;
        let tau = self.last_torque + bounded(step, change, command_flags::TORQUE_RATE_LIMITED);
        self.kept_back = within - tau;
        tau
    }

    /// The less velocity is left to what is allowed, the less torque; beyond it, braking, which the rate limit must not
    /// hold back. By both encoders: what one of them shows must not press the joint.
    fn within_allowed_velocity(&self, tau: f64, motion: &Motion, flags: &mut u32) -> f64 {
        let ends = [motion.q, motion.theta].map(|x| self.allowed_velocity(x));
        let [(down, up), (other_down, other_up)] = ends;
        let (down, up) = (down.max(other_down), up.max(other_up));
        let (damping, torque) = (self.limits.braking.damping, self.torque);
        let most = (motion.weight + damping * (up - motion.dq)).clamp(-torque, torque);
        let least = (motion.weight - damping * (down + motion.dq)).clamp(-torque, torque);
        let within = tau.min(most).max(least);
        if within != tau {
            let bound = if within < tau { up } else { down };
            *flags |= if bound < self.velocity {
                command_flags::POSITION_LIMITED
            } else {
                command_flags::VELOCITY_LIMITED
            };
        }
        within
    }
}
