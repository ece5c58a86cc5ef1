//! Roll: how the floor gives way under the feet.
//!
//! Feet that roll on a soft floor turn the body with them, and no joint shows that. A gyroscope does. Up in its axes
//! follows from its angular velocities, corrected slowly by the feet, on which up is known:
//!
//! ```text
//! u' = u x (omega - b) + (R^T n - u) / T        R: sensor to base, n: up in the base's axes by the feet
//! b' = (R^T n - u) x u / (T T_b)                b: offset of the gyroscope
//! ```
//!
//! It is the explicit complementary filter of R. Mahony, T. Hamel and J.-M. Pflimlin (2008). Motion slower than `T` is left
//! to the feet, and a gyroscope that errs turns up by no more than [`MOST`].

use super::{Balance, BalanceInput};
use dynamics::frame_placement;
use nalgebra::{Matrix3, Vector3};

/// Time constant `T`, s. Chosen on the simulated humanoid, whose feet swung at 14 Hz, with velocities observed at 35 rad/s on
/// one foot, too: from 0.3 to 2 s it stepped quietly, with 0.1 and 0.2 it fell.
const CORRECTS_S: f64 = 0.3;
/// Time `T_b` in which the offset of the gyroscope is found, s: longer than a roll that is to be left to the feet, some steps
/// long. Chosen; no experiment recorded.
const FINDS_S: f64 = 10.0;
/// Greatest turn from the up of the feet, rad. Chosen on the simulated humanoid: with half a degree a gyroscope that drifts
/// moves a knee by 1.2 degrees, with a quarter by 0.5, and it steps as quietly.
const MOST: f64 = 0.25 * core::f64::consts::PI / 180.0;

/// Up by a gyroscope.
#[derive(Debug, Clone)]
pub(super) struct Roll {
    /// Frame of the gyroscope.
    frame: usize,
    /// In the sensor's axes, and as the feet had it in the last cycle; none before the first one.
    up: Option<[Vector3<f64>; 2]>,
    /// Offset of the gyroscope, rad/s.
    offset: Vector3<f64>,
}

impl Roll {
    pub(super) fn new(frame: usize) -> Self {
        Self {
            frame,
            up: None,
            offset: Vector3::zeros(),
        }
    }

    pub(super) fn restart(&mut self) {
        (self.up, self.offset) = (None, Vector3::zeros());
    }

    /// A cycle passes with this angular velocity, rad/s, in the sensor's axes, if it is known; `rotation`: from them to the
    /// base's axes; `by_feet`: up in the base's axes as the feet have it. Returns up in the base's axes.
    pub(super) fn update(
        &mut self,
        rotation: &Matrix3<f64>,
        by_feet: &Vector3<f64>,
        gyro: Option<Vector3<f64>>,
        dt: f64,
    ) -> Vector3<f64> {
        let feet = rotation.tr_mul(by_feet);
        let [up, feet_before] = self.up.unwrap_or([feet; 2]);
        // Without a gyroscope the body turns as the feet have it.
        let turned = gyro.map_or(feet - feet_before, |gyro| {
            up.cross(&(gyro - self.offset)) * dt
        });
        let beside = (up + turned - feet) * (CORRECTS_S / (CORRECTS_S + dt));
        let beside = beside * (MOST / beside.norm().max(MOST));
        self.offset += beside.cross(&feet) * (dt / (CORRECTS_S * FINDS_S));
        let up = (feet + beside).try_normalize(0.1).unwrap_or(feet);
        self.up = Some([up, feet]);
        rotation * up
    }
}

impl Balance {
    /// Up in the axes of the feet that stand: they roll on a floor that gives way.
    pub(super) fn roll(&mut self, input: &BalanceInput<'_>) {
        for (foot, up) in self.feet.iter_mut().zip(&input.up) {
            foot.up = *up;
        }
        let Some((up, roll)) = self.up().zip(self.roll.as_mut()) else {
            return;
        };
        let rotation = frame_placement(&self.model, &self.data, roll.frame).rotation;
        let up = roll.update(&rotation, &up, input.gyro, input.dt);
        for foot in self.feet.iter_mut().filter(|foot| foot.stands) {
            foot.up = Some(foot.at.rotation.tr_mul(&up));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, UnitVector3};

    const DT: f64 = 1e-3;

    /// Turns of up from where the feet have it, rad, of a sensor whose axes are not the base's, cycle by cycle.
    fn turns(gyro: impl Fn(u32) -> Option<Vector3<f64>>, cycles: u32) -> Vec<Vector3<f64>> {
        let rotation = Rotation3::from_euler_angles(0.4, -0.7, 1.1);
        let mut roll = Roll::new(0);
        let mut turn = |k| {
            // Of the base, in the axes of the sensor.
            let gyro = gyro(k).map(|gyro| rotation.inverse() * gyro);
            let up = roll.update(rotation.matrix(), &Vector3::z(), gyro, DT);
            Vector3::z().cross(&up)
        };
        (0..cycles).map(&mut turn).collect()
    }

    /// A base that swings by 0.1 degrees at 10 Hz about an axis, though the feet do not show it.
    #[test]
    fn a_roll_that_the_joints_do_not_show_is_seen() {
        let (size, rate) = (0.1_f64.to_radians(), 63.0);
        let axis = UnitVector3::new_normalize(Vector3::new(1.0, 0.5, 0.0));
        let time = |k| f64::from(k) * DT;
        let gyro = |k| Some(*axis * size * rate * (rate * time(k)).cos());
        for (k, turn) in (0..).zip(turns(gyro, 1000)) {
            // Up in the base's axes turns the other way.
            let expected = *axis * -size * (rate * time(k)).sin();
            // A high-pass of 0.3 s leads by 1 / (63 0.3), and by as much again when it begins.
            assert!(
                (turn - expected).norm() < 0.12 * size,
                "{k}: {turn} {expected}"
            );
        }
    }

    #[test]
    fn an_offset_of_the_gyroscope_is_found() {
        let turns = turns(|_| Some(Vector3::new(0.004, -0.002, 0.0)), 40_000);
        assert!(turns[2000].norm() > 1e-3, "{}", turns[2000].norm());
        assert!(turns[39_000..].iter().all(|turn| turn.norm() < 1e-4));
    }

    #[test]
    fn a_gyroscope_that_errs_turns_up_by_a_quarter_of_a_degree_at_most() {
        let offset = |_| Some(Vector3::new(0.0, 2.0, 0.0));
        let most = |turns: &[Vector3<f64>]| turns.iter().fold(0.0, |most, t| t.norm().max(most));
        let turned = most(&turns(offset, 3000));
        assert!((0.9..1.001).contains(&(turned / MOST)), "{turned}");
        let lost = |k| offset(k).filter(|_| k < 1000);
        assert!(most(&turns(lost, 5000)[4900..]) < 0.01 * MOST);
    }
}
