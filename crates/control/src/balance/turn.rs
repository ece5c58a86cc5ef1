//! Turn: how the base is turned to where the desired pose has it against the feet, as far as the soles can hold it.

use super::floor::{Floor, Soles};
use super::observer::Observer;
use super::{Balance, BalanceInput, Foot, MOST_TURN, small_turn};
use crate::sole::nearest_within;
use dynamics::center_of_mass;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Frequency of the base's orientation, critically damped, rad/s. Chosen on the simulated humanoid
/// (docs/results/standing.md).
pub(crate) const TURNS_BACK: f64 = 10.0;
/// Time in which what turns the base off is found, s, and the greatest angular acceleration by which it is held back,
/// rad/s². At the crossover of the base's loop, 20 rad/s, the integral takes 1.4° of phase. Its bound is what a torque
/// off by half a degree of `TURNS_BACK` asks for, so that a push cannot fill it.
pub(crate) const FINDS: f64 = 2.0;
const MOST_FOUND: f64 = 1.0;

impl Foot {
    /// From where the base is to where the desired pose has it, by this foot, in whose axes up is: tilt (rad, in the base's
    /// axes), turn about up, rad, and up.
    fn turned(&self, up: &Vector3<f64>) -> Option<(Vector3<f64>, f64, Vector3<f64>)> {
        let first_up = self.first_up?;
        let now = self.at.rotation * up;
        let e = self.at.rotation * self.desired.rotation.transpose();
        let tilt = (self.desired.rotation * first_up).cross(&now);
        Some((tilt, small_turn(&e).dot(&now), now))
    }
}

impl Balance {
    /// The angular acceleration that turns the base to where the desired pose has it, against the feet.
    pub(super) fn turn(&mut self, input: &BalanceInput<'_>) -> Vector3<f64> {
        let error = self.turned_off();
        let mut desired = [Vector3::zeros(); 2];
        let mut feet = 0.0;
        for foot in self.feet.iter().filter(|foot| foot.stands) {
            let motions = [input.desired[1], input.desired[2]];
            for (own, motion) in desired.iter_mut().zip(motions) {
                for (column, x) in foot.jacobian.column_iter().skip(6).zip(motion) {
                    *own -= column.fixed_rows::<3>(3) * *x;
                }
            }
            feet += 1.0;
        }
        let feet = f64::max(feet, 1.0);
        let [rate, acceleration] = desired.map(|x| x / feet);
        let now = Vector3::from_fn(|k, _| self.v.get(3 + k).copied().unwrap_or(0.0));
        let observes = self.observes();
        let observed = self.turned.get_or_insert(Observer {
            at: -error,
            rate: now - rate,
            disturbance: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        });
        observed.update(&-error, observes, input.dt);
        let off = observed.rate;
        let stiff = error * TURNS_BACK * TURNS_BACK;
        self.found += stiff * (input.dt / FINDS);
        let most = self.found.norm().max(MOST_FOUND) / MOST_FOUND;
        self.found /= most;
        let back = stiff + self.found - 2.0 * TURNS_BACK * off;
        let asked = (acceleration + back).map(|x| x.clamp(-MOST_TURN, MOST_TURN));
        if let Some(turned) = &mut self.turned {
            turned.acceleration = asked - acceleration - self.found;
        }
        asked
    }

    /// From where the base is to where the desired pose has it, by the feet that stand, rad. Each shows the tilt by where up
    /// is in its axes, against where it was when it first stood; and the turn about it, from where it was put down.
    pub(super) fn turned_off(&mut self) -> Vector3<f64> {
        let known = self.feet.iter().filter_map(|foot| {
            let (tilt, turn, up) = foot.turned(foot.up.as_ref()?)?;
            Some((tilt, turn - foot.put_down?, up))
        });
        let (tilt, turn, up, count) = known.fold(
            (Vector3::zeros(), 0.0, Vector3::zeros(), 0.0),
            |(tilts, turns, ups, count), (tilt, turn, up)| {
                (tilts + tilt, turns + turn, ups + up, count + 1.0)
            },
        );
        let feet = f64::max(count, 1.0);
        let (mut tilt, mut turn, mut up, mut all) = (tilt, turn, up, count);
        for foot in &mut self.feet {
            let Some(own_up) = foot.up.filter(|_| foot.put_down.is_none()) else {
                continue;
            };
            foot.first_up.get_or_insert(own_up);
            if let Some((own_tilt, own_turn, own_up)) = foot.turned(&own_up) {
                // The first feet show it as it is.
                let put_down = if count > 0.0 {
                    own_turn - turn / feet
                } else {
                    0.0
                };
                foot.put_down = Some(put_down);
                (tilt, turn, up) = (tilt + own_tilt, turn + own_turn - put_down, up + own_up);
                all += 1.0;
            }
        }
        let up = up.try_normalize(0.1).unwrap_or_default();
        (tilt + up * turn) / f64::max(all, 1.0)
    }

    /// The angular acceleration of the base as far as the soles can hold it beside a centre of pressure: about horizontal
    /// axes it shifts the centre of pressure.
    pub(super) fn within_soles(
        &self,
        floor: &Floor,
        soles: &Soles,
        pressure: Vector2<f64>,
        turn: &Vector3<f64>,
    ) -> Vector3<f64> {
        let m = self.data.mass_matrix();
        let mass = m[(0, 0)];
        let lever = center_of_mass(&self.model, &self.data).cross_matrix();
        // The robot's inertia about its centre of mass: more than what turns, so that too little is asked for.
        let inertia: Matrix3<f64> = m.fixed_view::<3, 3>(3, 3) + lever * lever * mass;
        let up: Vector3<f64> = floor.axes.column(2).into();
        let about_up = up * up.dot(turn);
        let across = turn - about_up;
        let shift = up.cross(&(inertia * across)) / (mass * self.gravity);
        let shift = floor.axes.tr_mul(&shift).xy();
        let held = nearest_within(soles.held(), 1.0, pressure + shift - soles.middle);
        let possible = soles.middle + held - pressure;
        let share = possible.dot(&shift) / shift.norm_squared().max(f64::MIN_POSITIVE);
        about_up + across * share.clamp(0.0, 1.0)
    }
}
