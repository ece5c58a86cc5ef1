//! IMU check: whether gyroscope and accelerometer can both be right.
//!
//! Gravity, as the sensor measures it, turns with the sensor: `g' = -omega x g`, corrected slowly by
//! the accelerometer. A base is not accelerated by more than [`ACCELERATION`] beside it for longer
//! than an impact lasts, and its rate of turn does not step. A sample beyond that is not used; a
//! sensor whose axes are exchanged, reversed or offset from one sample to the next goes stale so.
//! Errors that are there from the start are not found here.

use nalgebra::Vector3;

/// Acceleration of the base beside gravity, m/s²: more than that of a free fall (9.81), less than the difference of two
/// axes of which one shows gravity (13.9).
const ACCELERATION: f64 = 11.5;
/// Time constant with which the accelerometer corrects the direction of gravity, s. Chosen; no experiment recorded.
const CORRECTION: f64 = 1.0;
/// Step of the rate of turn, rad/s per second between samples, as an impact can make it.
/// Chosen; no experiment recorded.
const TURN_STEP: f64 = 400.0;
/// Further change of the rate of turn per second since a sample was used, rad/s². Chosen; no experiment recorded.
const TURN_RATE: f64 = 10.0;
/// Time without a plausible sample after which the check begins anew if the robot holds, s.
/// Chosen; no experiment recorded.
const RESTART: f64 = 1.0;

/// Follows one IMU.
#[derive(Debug, Clone)]
pub(super) struct ImuCheck {
    /// Longest time between samples, s.
    gap: f64,
    /// Proper acceleration at rest, m/s², and rate of turn of the last plausible sample, rad/s; none
    /// before the first.
    last: Option<[Vector3<f64>; 2]>,
    /// Time since then, s.
    since: f64,
}

impl ImuCheck {
    pub(super) fn new(gap: f64) -> Self {
        Self {
            gap,
            last: None,
            since: 0.0,
        }
    }

    /// Time passes without a sample, s.
    pub(super) fn wait(&mut self, dt: f64) {
        self.since += dt;
        if let Some([gravity, gyro]) = &mut self.last {
            turn(gravity, gyro, dt);
        }
    }

    /// Whether the sample, `dt` (s) after the last cycle, can be right; `holds`: nothing depends on it.
    pub(super) fn is_plausible(
        &mut self,
        gyro: [f64; 3],
        acceleration: [f64; 3],
        dt: f64,
        holds: bool,
    ) -> bool {
        let (gyro, acceleration) = (Vector3::from(gyro), Vector3::from(acceleration));
        if holds && self.since > RESTART {
            self.last = None;
        }
        let Some([gravity, last]) = &mut self.last else {
            self.last = Some([acceleration, gyro]);
            self.since = 0.0;
            return true;
        };
        let turned = (gyro - *last).norm() <= TURN_STEP * self.gap + TURN_RATE * self.since;
        turn(gravity, if turned { &gyro } else { last }, dt);
        if !turned || (acceleration - *gravity).norm() > ACCELERATION {
            self.since += dt;
            return false;
        }
        *gravity += (acceleration - *gravity) * (dt / CORRECTION).min(1.0);
        (*last, self.since) = (gyro, 0.0);
        true
    }
}

/// A vector that stands, seen from axes that turn.
fn turn(v: &mut Vector3<f64>, omega: &Vector3<f64>, dt: f64) {
    *v -= omega.cross(v) * dt;
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: [f64; 3] = [0.0, 0.0, 9.81];

    fn settled() -> ImuCheck {
        let mut check = ImuCheck::new(1e-3);
        assert!((0..100).all(|_| check.is_plausible([0.0; 3], UP, 1e-3, false)));
        check
    }

    #[test]
    fn a_base_that_turns_and_is_shaken_is_plausible() {
        let mut check = settled();
        // 3 rad/s within 20 ms, through a whole turn, shaken by 6 m/s².
        let (mut angle, mut rate): (f64, f64) = (0.0, 0.0);
        for k in 0..2000 {
            rate = (rate + 0.15).min(3.0);
            angle += 1e-3 * rate;
            let shaken = 6.0 * (0.05 * f64::from(k)).sin();
            let gravity = [0.0, 9.81 * angle.sin() + shaken, 9.81 * angle.cos()];
            assert!(
                check.is_plausible([rate, 0.0, 0.0], gravity, 1e-3, false),
                "{k}"
            );
        }
    }

    /// Half a second of free fall by a noisy sensor that shows 3 % too much, and the landing.
    #[test]
    fn a_fall_is_plausible_and_a_landing_is_over_soon() {
        let mut check = settled();
        let up = [0.0, 0.0, 1.03 * 9.81];
        assert!((0..3000).all(|_| check.is_plausible([0.0; 3], up, 1e-3, false)));
        for k in 0..500 {
            let noise = 0.3 * (1.7 * f64::from(k)).sin();
            let falling = [noise, -noise, noise];
            assert!(check.is_plausible([0.0; 3], falling, 1e-3, false), "{k}");
        }
        assert!((0..15).all(|_| !check.is_plausible([0.0; 3], [0.0, 0.0, 60.0], 1e-3, false)));
        assert!(check.is_plausible([0.0; 3], up, 1e-3, false));
    }

    #[test]
    fn axes_that_change_and_a_gyroscope_that_steps_are_not() {
        let still = |gyro: [f64; 3], acceleration: [f64; 3]| {
            let mut check = settled();
            (0..80).all(|_| !check.is_plausible(gyro, acceleration, 1e-3, false))
        };
        assert!(still([0.0; 3], [0.0, 9.81, 0.0]));
        assert!(still([0.0; 3], [0.0, 0.0, -9.81]));
        assert!(still([0.0, 1.5, 0.0], UP));
        // The check begins anew while the robot holds.
        let mut check = settled();
        let reversed = [0.0, 0.0, -9.81];
        let used = (0..1500).position(|_| check.is_plausible([0.0; 3], reversed, 1e-3, true));
        assert!(used.is_some_and(|k| (1000..1003).contains(&k)), "{used:?}");
    }
}
