//! Limits of one joint's command; the cycle applies them last.

use robot_state::command_flags;

/// Limits of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Smallest commanded position, rad.
    pub position_min: f64,
    /// Largest commanded position, rad.
    pub position_max: f64,
    /// Largest |tau|, N·m.
    pub torque: f64,
    /// Largest |delta_q|, rad: lead of the command over the measured position.
    pub delta_q: f64,
    /// Largest |current|, A (current-commanded drives).
    pub current: f64,
}

/// A limited value and the flag of the limit, if one is active.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limited {
    /// The value within its limits.
    pub value: f64,
    /// Bits of `command_flags`.
    pub flags: u32,
}

impl JointLimits {
    /// A torque within the limit. NaN passes: the finite check comes after every limit.
    #[must_use]
    pub fn torque(&self, tau: f64) -> Limited {
        limited(
            tau,
            -self.torque,
            self.torque,
            command_flags::TORQUE_LIMITED,
        )
    }

    /// An offset to the measured position within the limit.
    #[must_use]
    pub fn delta_q(&self, delta_q: f64) -> Limited {
        limited(
            delta_q,
            -self.delta_q,
            self.delta_q,
            command_flags::DELTA_Q_LIMITED,
        )
    }

    /// A position within the limits.
    #[must_use]
    pub fn position(&self, q: f64) -> Limited {
        limited(
            q,
            self.position_min,
            self.position_max,
            command_flags::POSITION_LIMITED,
        )
    }

    /// A current within the limit; it is reported as a torque limit.
    #[must_use]
    pub fn current(&self, current: f64) -> Limited {
        limited(
            current,
            -self.current,
            self.current,
            command_flags::TORQUE_LIMITED,
        )
    }
}

fn limited(x: f64, min: f64, max: f64, flag: u32) -> Limited {
    if x < min {
        Limited {
            value: min,
            flags: flag,
        }
    } else if x > max {
        Limited {
            value: max,
            flags: flag,
        }
    } else {
        Limited { value: x, flags: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: JointLimits = JointLimits {
        position_min: -1.0,
        position_max: 2.0,
        torque: 30.0,
        delta_q: 0.05,
        current: 8.0,
    };

    proptest! {
        #[test]
        fn values_stay_within_limits_and_flags_report_it(x in prop::num::f64::NORMAL | prop::num::f64::INFINITE) {
            for (result, min, max) in [
                (LIMITS.torque(x), -30.0, 30.0),
                (LIMITS.delta_q(x), -0.05, 0.05),
                (LIMITS.position(x), -1.0, 2.0),
                (LIMITS.current(x), -8.0, 8.0),
            ] {
                prop_assert!(result.value >= min && result.value <= max);
                prop_assert_eq!(result.flags != 0, result.value != x);
            }
        }
    }
}
