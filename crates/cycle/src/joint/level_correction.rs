//! Level correction: joints of a frame whose force is fed back follow the torque that F/T sensors show, at once.
//!
//! In: the levelled torque `g e + b` and `tau_hat`. Out: what is added to the former. Where the torque of a joint
//! passes zero its gear winds up, and where it turns round hysteresis makes it look other than it is, by up to
//! 3 % of the torque limit. `b` follows that within half a second, while the joint stands not at all. A frame
//! makes a multiple of it where its force has a short lever (the leg's foot about its knee: 25 N of 3 N·m), and
//! the feedback of the force finds it only as fast as the frame gives way.
//!
//! ```text
//! c' = (within(tau_hat - (g e + b), s B) - c) / 10 ms      s: share of the force's feedback, led from 0 to 1
//! ```
//!
//! `B` bounds what an F/T sensor that errs may do to a joint that stands. Both torques contain `g e`, so that the
//! loop through `c` has no more gain than the share by which `g` is wrong.

use robot_config::{FastTorqueFeedback, Parameters, TorqueLaw};
use robot_state::{TorqueEstimate, torque_flags};

/// Time constant of the correction, s. Chosen on the simulated leg, whose knee is wrong for half a second
/// (docs/cartesian.md, The level of the F/T sensors).
const FOLLOWS_S: f64 = 0.01;
/// B, share of the torque limit. Chosen on the simulated leg, whose knee is wrong by 3 % (docs/cartesian.md, The level
/// of the F/T sensors).
const MOST: f64 = 0.05;

/// Corrections of all joints, N·m.
#[derive(Debug)]
pub(super) struct LevelCorrections {
    /// B of each joint, N·m, and its correction.
    joints: Vec<(f64, f64)>,
    share: f64,
}

impl LevelCorrections {
    /// Makes the level corrections; of a robot whose feedback is not the levelled torque all stay zero.
    pub(super) fn new(parameters: &Parameters) -> Self {
        let levelled = TorqueLaw::Predictive(FastTorqueFeedback::Levelled);
        let most = if parameters.torque_law == levelled {
            MOST
        } else {
            0.0
        };
        let limits = parameters.joints.iter().map(|joint| joint.limits.torque);
        Self::within(
            limits.map(|limit| most * limit),
            parameters.timing.sample_period,
        )
    }

    fn within(bounds: impl Iterator<Item = f64>, sample_period: f64) -> Self {
        Self {
            joints: bounds.map(|bound| (bound, 0.0)).collect(),
            share: (sample_period / FOLLOWS_S).min(1.0),
        }
    }

    /// The torque that is fed back of this joint, from the levelled one. `share`: of the force's feedback.
    pub(super) fn update(
        &mut self,
        joint: usize,
        share: f64,
        levelled: Option<f64>,
        hat: &TorqueEstimate,
    ) -> Option<f64> {
        let levelled = levelled?;
        let Some((bound, correction)) = self.joints.get_mut(joint) else {
            return Some(levelled);
        };
        let known =
            hat.flags & (torque_flags::VALID | torque_flags::DEGRADED) == torque_flags::VALID;
        let most = *bound * share;
        let goal = if known && hat.tau.is_finite() {
            (hat.tau - levelled).max(-most).min(most)
        } else {
            0.0
        };
        *correction += (goal - *correction) * self.share;
        Some(levelled + *correction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 100.0;

    fn hat(tau: f64, flags: u32) -> TorqueEstimate {
        TorqueEstimate {
            tau,
            flags,
            ..TorqueEstimate::default()
        }
    }

    /// Corrections of a second with this share.
    fn run(levels: &mut LevelCorrections, share: f64, tau: f64, flags: u32) -> Vec<f64> {
        let step = |_| {
            levels
                .update(0, share, Some(10.0), &hat(tau, flags))
                .unwrap()
                - 10.0
        };
        (0..1000).map(step).collect()
    }

    /// The torque of the sensors is reached, as far as it is believed, without a step; without a feedback of the force,
    /// or where a sensor is missing, the levelled torque stays.
    #[test]
    fn the_level_of_the_sensors_is_reached_within_bounds() {
        let most = MOST * LIMIT;
        for (share, tau, flags, wanted) in [
            (1.0, 13.0, torque_flags::VALID, 3.0),
            (1.0, -200.0, torque_flags::VALID, -most),
            (0.5, 300.0, torque_flags::VALID, most / 2.0),
            (0.0, 13.0, torque_flags::VALID, 0.0),
            (1.0, 13.0, torque_flags::VALID | torque_flags::DEGRADED, 0.0),
            (1.0, 13.0, 0, 0.0),
            (1.0, f64::NAN, torque_flags::VALID, 0.0),
        ] {
            let mut levels = LevelCorrections::within([MOST * LIMIT].into_iter(), 1e-3);
            let corrections = run(&mut levels, share, tau, flags);
            let end = corrections[999];
            assert!((end - wanted).abs() < 1e-6, "{tau}, {flags}: {end}");
            // A step of the torque: 5 % of its limit within 5 ms.
            let steps = corrections.windows(6).map(|six| (six[5] - six[0]).abs());
            assert!(steps.fold(0.0, f64::max) < 0.05 * LIMIT, "{tau}");
            // The correction is led out again.
            let end = run(&mut levels, 0.0, tau, flags)[999];
            assert!(end.abs() < 1e-6, "{tau}: {end}");
        }
    }

    #[test]
    fn without_a_torque_there_is_none() {
        let mut levels = LevelCorrections::within([MOST * LIMIT].into_iter(), 1e-3);
        assert_eq!(levels.update(0, 1.0, None, &hat(3.0, 1)), None);
        assert_eq!(levels.update(7, 1.0, Some(2.0), &hat(3.0, 1)), Some(2.0));
    }
}
