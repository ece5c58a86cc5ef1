//! Stand: how far the feedback of a late torque may change while its joint stands.
//!
//! In: the motor's angle, the desired torque, the feedback that the torque's error asks for. Out: the feedback
//! within what is explained. An error of the torque has two causes: the desired torque has changed, and friction
//! and stiffness of the drive make another torque of it, by at most the change; or the joint has turned, and
//! friction with it. Where neither has happened, an error is the sensor's, or a load's that friction holds: a
//! load that overcomes friction turns the joint. So a joint that stands keeps its feedback, but for creep. For
//! [`SETTLING_S`] after a motion the feedback follows freely, as the torque is late; when the desired torque has
//! stood for as long, the feedback that it has led to is the one that stands.

use supervisor::time_in_a_row;

/// Angle within which a joint stands, rad. Chosen on the simulated leg without link-side encoders, with F/T sensors
/// that err (docs/results/motor-alone.md).
const STANDS_WITHIN: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Time after which the feedback has settled, s: of an integral of at least 3 per second, of whose step exp(-4.5) = 1 %
/// is left, and the torque's delay.
const SETTLING_S: f64 = 1.5;
/// Change of the feedback without a cause, share of the torque limit: creep of gear and sensor.
/// Chosen as [`STANDS_WITHIN`].
const CREEP_SHARE: f64 = 5e-4;
/// Change of the desired torque below which it stands, share of the torque limit. Chosen; no experiment recorded.
const SAME_SHARE: f64 = 5e-3;

/// A joint that stands, and what its feedback may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    angle: f64,
    /// The feedback that has settled, N·m, and the least and greatest desired torque since.
    feedback: f64,
    desired: (f64, f64),
    /// The desired torque that stands, N·m, and for how long, s.
    standing: f64,
    stood: f64,
    /// Time left for which the feedback follows, s.
    settling: f64,
}

impl Stand {
    pub(super) fn at(angle: f64, feedback: f64, tau_d: f64, settling: f64) -> Self {
        Self {
            angle,
            feedback,
            desired: (tau_d, tau_d),
            standing: tau_d,
            stood: 0.0,
            settling,
        }
    }

    /// The feedback that `asked` is limited to, N·m.
    pub(super) fn bound(
        &mut self,
        (angle, tau_d): (f64, f64),
        asked: f64,
        torque_limit: f64,
        dt: f64,
    ) -> f64 {
        if (angle - self.angle).abs() > STANDS_WITHIN {
            *self = Self::at(angle, asked, tau_d, SETTLING_S);
            return asked;
        }
        if self.settling > 0.0 {
            *self = Self::at(self.angle, asked, tau_d, self.settling - dt);
            return asked;
        }
        let (low, high) = self.desired;
        self.desired = (low.min(tau_d), high.max(tau_d));
        let change = self.desired.1 - self.desired.0;
        let most = CREEP_SHARE * torque_limit + change;
        // max and min, not clamp: they cannot panic.
        let bound = asked.max(self.feedback - most).min(self.feedback + most);
        let same = SAME_SHARE * torque_limit;
        let changes = (tau_d - self.standing).abs() > same;
        let stood = time_in_a_row(&mut self.stood, !changes, dt);
        if stood <= 0.0 {
            self.standing = tau_d;
        } else if stood > SETTLING_S && change > same {
            *self = Self::at(self.angle, bound, tau_d, 0.0);
        }
        bound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 200.0;
    const DT: f64 = 1e-3;

    /// The feedback after a time in which an integral of 8 per second follows a sensor that errs.
    fn followed(
        stand: &mut Stand,
        error: f64,
        tau_d: f64,
        angle: impl Fn(f64) -> f64,
        s: f64,
    ) -> f64 {
        let mut feedback = stand.feedback;
        for k in 0..(s / DT) as usize {
            let asked = feedback + 8.0 * error * DT;
            feedback = stand.bound((angle(k as f64 * DT), tau_d), asked, LIMIT, DT);
        }
        feedback
    }

    #[test]
    fn an_error_alone_changes_nothing_but_by_creep() {
        let mut stand = Stand::at(0.3, 5.0, 20.0, 0.0);
        let feedback = followed(&mut stand, 30.0, 20.0, |_| 0.3, 60.0);
        assert!(
            (feedback - 5.0).abs() <= CREEP_SHARE * LIMIT + 1e-12,
            "{feedback}"
        );
    }

    #[test]
    fn a_change_of_the_desired_torque_is_corrected_by_as_much_and_then_stands() {
        let mut stand = Stand::at(0.3, 5.0, 20.0, 0.0);
        let corrected = followed(&mut stand, 30.0, 24.0, |_| 0.3, 2.0);
        // By as much as the change, and creep twice: before it stood and after.
        assert!((corrected - 9.2).abs() < 1e-9, "{corrected}");
        let after = followed(&mut stand, -30.0, 24.0, |_| 0.3, 3.0);
        assert!(
            (corrected - after).abs() <= 2.0 * CREEP_SHARE * LIMIT + 1e-9,
            "{after}"
        );
    }

    #[test]
    fn a_joint_that_turns_is_followed_freely() {
        let mut stand = Stand::at(0.3, 5.0, 20.0, 0.0);
        let feedback = followed(&mut stand, 3.0, 20.0, |t| 0.3 + 0.2 * t, 1.0);
        assert!(feedback > 25.0, "{feedback}");
    }
}
