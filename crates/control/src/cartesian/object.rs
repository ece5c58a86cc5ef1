//! Object: how stiff what a frame presses on is, as its force and way have shown it.

use nalgebra::Vector6;

/// Time for which a force and a way count as a change, and in which what they show is forgotten, s.
/// Chosen on the simulated leg, pressing on objects of 5 to 600 kN/m (`crates/cycle/tests/cartesian.rs`).
const CHANGES_S: [f64; 2] = [0.2, 2.0];
/// Way below which force and way show nothing of the object, m. A count of the leg's link encoders, of 19 bits, is 6 um
/// at a lever of 0.5 m.
const SEEN: f64 = 5e-6;
/// Least stiffness of an object over that as long as nothing shows it. Chosen; no experiment recorded.
const SOFTEST: f64 = 0.05;

/// The object that a frame presses on: averages of place and force, of the way's square, and of its product with the
/// force.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Object {
    means: Option<[Vector6<f64>; 2]>,
    square: Vector6<f64>,
    product: Vector6<f64>,
}

impl Object {
    pub(super) fn update(&mut self, place: Vector6<f64>, force: Vector6<f64>, dt: f64) {
        let [mean_place, mean_force] = self.means.get_or_insert([place, force]);
        let share = (dt / CHANGES_S[0]).min(1.0);
        *mean_place += (place - *mean_place) * share;
        *mean_force += (force - *mean_force) * share;
        let (way, change) = (place - *mean_place, force - *mean_force);
        let share = (dt / CHANGES_S[1]).min(1.0);
        self.square += (way.component_mul(&way) - self.square) * share;
        self.product += (way.component_mul(&change) - self.product) * share;
    }

    /// K_o along an axis, N/m; `else_it`: as long as nothing shows it, and about an axis.
    pub(super) fn stiffness(&self, axis: usize, else_it: f64) -> f64 {
        let known =
            (SEEN * SEEN * else_it - self.product[axis]) / (SEEN * SEEN + self.square[axis]);
        known.max(SOFTEST * else_it)
    }
}
