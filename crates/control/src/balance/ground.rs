//! Ground: how it shares what it must carry among the soles.
//!
//! In: the wrench that the ground is to apply in all, and where the soles are. Out: a wrench on each sole that the ground
//! can apply: it pushes, its centre of pressure is within the sole, its tangential force within friction. The least
//! squares of all wrenches is brought into each sole's bounds, and what is then missing is shared again.

use super::MAX_FEET;
use crate::six::wrench_map;
use crate::sole::Sole;
use dynamics::{Force, Se3};
use nalgebra::{Matrix6, Vector2, Vector6};

/// Greatest tangential force as a share of the normal one. Chosen on the simulated humanoid, whose floor bears 0.7
/// (config/humanoid/sim.toml).
const FRICTION: f64 = 0.5;
/// Share of the way from a sole's middle to its edge that the centre of pressure stays off the edge: there the foot
/// tilts. Chosen on the simulated humanoid: 10 % are 7 mm of its soles' sides.
pub(super) const EDGE: f64 = 0.1;
/// Share of the weight that each of several feet bears at least: one that bears less is about to lift. Chosen: above the
/// share from which on a foot bears (`BEARS` of crates/control/src/support.rs).
pub(super) const LOAD: f64 = 0.12;
/// Least share by which the sharing counts a foot: it stays regular.
const LEAST_SHARE: f64 = 1e-3;
/// Rounds in which what is missing is shared again. Chosen on the drawn wrenches of the tests below, of which they leave
/// less than 1 % of the greatest force.
const ROUNDS: usize = 40;
/// What is missing that is shared no more, N and N·m.
const LEAST: f64 = 1e-3;

/// A sole on the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sharing<'a> {
    pub(super) sole: &'a Sole,
    /// Placement of its F/T sensor's frame in the axes of the total wrench.
    pub(super) at: Se3,
    /// Greatest share of the total force that it bears, 0 to 1.
    pub(super) bears: f64,
    /// Least share of the total force that it bears.
    pub(super) least: f64,
}

impl Sharing<'_> {
    /// Greatest normal force that it bears of such a force in all; one that may bear all is not bounded.
    fn most(&self, force: f64) -> f64 {
        if self.bears < 1.0 {
            self.bears * force
        } else {
            f64::INFINITY
        }
    }
}

/// From a wrench on the sole's middle in the sole's axes to one at the origin of `at`'s axes.
fn map(foot: &Sharing<'_>) -> Matrix6<f64> {
    let rotation = foot.at.rotation * foot.sole.axes();
    wrench_map(&rotation, &foot.at.act_point(foot.sole.origin()))
}

/// Distance of the sole's edge from its middle along x and y, m.
fn reach(sole: &Sole) -> [f64; 2] {
    let corners = sole.corners().iter();
    corners.fold([0.0, 0.0], |[x, y]: [f64; 2], corner| {
        [x.max(corner.x.abs()), y.max(corner.y.abs())]
    })
}

/// The wrenches on the soles in the axes of `at`, about its origin, that together come nearest to `total`.
pub(super) fn share(
    total: &Vector6<f64>,
    feet: &[Option<Sharing<'_>>],
) -> [Vector6<f64>; MAX_FEET] {
    let mut maps = [Matrix6::zeros(); MAX_FEET];
    let mut costs = [Vector6::zeros(); MAX_FEET];
    let mut own = [Vector6::zeros(); MAX_FEET];
    let mut balance = Matrix6::zeros();
    for (k, foot) in feet.iter().enumerate().take(MAX_FEET) {
        let Some(foot) = foot else { continue };
        let [x, y] = reach(foot.sole);
        // A moment costs as much as the force that makes it at half the way to the edge.
        costs[k] = Vector6::new(1.0, 1.0, 1.0, y * y, x * x, x * y) * 0.25;
        costs[k].fixed_rows_mut::<3>(0).fill(1.0);
        costs[k] *= foot.bears.max(LEAST_SHARE);
        maps[k] = map(foot);
        balance += maps[k] * Matrix6::from_diagonal(&costs[k]) * maps[k].transpose();
    }
    let Some(factor) = balance.cholesky() else {
        return own;
    };
    let several = feet.iter().flatten().count() > 1;
    let force = total.fixed_rows::<3>(0).norm();
    let mut missing = *total;
    for _ in 0..ROUNDS {
        let multipliers = factor.solve(&missing);
        missing = *total;
        for (k, foot) in feet.iter().enumerate().take(MAX_FEET) {
            let Some(foot) = foot else { continue };
            own[k] += (maps[k].transpose() * multipliers).component_mul(&costs[k]);
            let bounds = if several {
                [foot.least * force, foot.most(force)]
            } else {
                [0.0, f64::INFINITY]
            };
            own[k] = within(&own[k], foot.sole, bounds);
            missing -= maps[k] * own[k];
        }
        if missing.amax() < LEAST {
            break;
        }
    }
    let mut shared = [Vector6::zeros(); MAX_FEET];
    for ((shared, map), own) in shared.iter_mut().zip(&maps).zip(&own) {
        let wrench = map * own;
        if wrench.iter().all(|x| x.is_finite()) {
            *shared = wrench;
        }
    }
    shared
}

/// A wrench on the sole's middle, in its axes, as the ground can apply it, with a normal force within these bounds.
fn within(wrench: &Vector6<f64>, sole: &Sole, [least, most]: [f64; 2]) -> Vector6<f64> {
    let normal = wrench[2].max(least).min(most);
    if normal <= 0.0 {
        return Vector6::zeros();
    }
    let limited = |part: f64, most: f64| part.max(-most).min(most);
    let across = Vector2::new(wrench[0], wrench[1]);
    let across = across * (FRICTION * normal / across.norm().max(f64::MIN_POSITIVE)).min(1.0);
    let pressure = Vector2::new(-wrench[4], wrench[3]) / normal;
    let pressure = sole.nearest(pressure, EDGE) * normal;
    let [x, y] = reach(sole);
    let twist = limited(wrench[5], FRICTION * normal * x.min(y));
    Vector6::new(across.x, across.y, normal, pressure.y, -pressure.x, twist)
}

/// A wrench in the axes of `at` as one on its F/T sensor, in the sensor's axes.
pub(super) fn at_sensor(wrench: &Vector6<f64>, at: &Se3) -> Force {
    at.inverse_act_force(Force::from_array((*wrench).into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    fn sole() -> Sole {
        let corners = [[0.14, 0.07], [0.14, -0.07], [-0.1, 0.07], [-0.1, -0.07]];
        Sole::new(&corners.map(|[x, y]| [x, y, -0.055])).unwrap()
    }

    /// Two feet side by side, their sensors 0.8 m below the origin.
    fn two(sole: &Sole) -> [Option<Sharing<'_>>; 2] {
        [0.1, -0.1].map(|y| {
            let at = Se3::from_xyz_rpy([0.03, y, -0.8], [0.02, -0.03, 0.1 * y]);
            Some(Sharing {
                sole,
                at,
                bears: 1.0,
                least: LOAD,
            })
        })
    }

    fn sum(wrenches: &[Vector6<f64>]) -> Vector6<f64> {
        wrenches.iter().sum()
    }

    #[test]
    fn what_soles_can_bear_is_borne_whole() {
        let sole = sole();
        let feet = two(&sole);
        let mut random = Random::new(3);
        for _ in 0..200 {
            // Corner forces that the ground can apply make a total that it can apply.
            let mut total = Vector6::zeros();
            for foot in feet.iter().flatten() {
                let normal = 100.0 + 300.0 * random.unit();
                let point = Vector2::new(0.08 * random.symmetric(), 0.045 * random.symmetric());
                let across = 0.3 * normal;
                let wrench = Vector6::new(
                    across * random.symmetric(),
                    across * random.symmetric(),
                    normal,
                    normal * point.y,
                    -normal * point.x,
                    0.0,
                );
                total += map(foot) * wrench;
            }
            let shared = share(&total, &feet);
            let missing = sum(&shared) - total;
            assert!(missing.amax() < 0.01 * total.amax(), "{missing} of {total}");
        }
    }

    #[test]
    fn no_sole_is_asked_for_what_the_ground_cannot_apply() {
        let sole = sole();
        let feet = two(&sole);
        let mut random = Random::new(4);
        for _ in 0..1000 {
            let total = Vector6::from_fn(|k, _| {
                [300.0, 300.0, 900.0, 200.0, 200.0, 80.0][k] * random.symmetric()
            });
            let shared = share(&total, &feet);
            for (foot, wrench) in feet.iter().flatten().zip(&shared) {
                let own = map(foot).try_inverse().unwrap() * wrench;
                let normal = own[2];
                assert!(normal >= -1e-9, "{own}");
                assert!(
                    own.fixed_rows::<2>(0).norm() <= FRICTION * normal + 1e-9,
                    "{own}"
                );
                assert!(own[3].abs() <= 0.07 * normal + 1e-9, "{own}");
                assert!(own[4].abs() <= 0.12 * normal + 1e-9, "{own}");
            }
        }
    }

    #[test]
    fn weight_in_the_middle_is_borne_by_both_without_moments_and_beside_a_foot_by_that_foot() {
        let sole = sole();
        let at = |y: f64| {
            Some(Sharing {
                sole: &sole,
                at: Se3::from_xyz_rpy([0.0, y, -0.8], [0.0; 3]),
                bears: 1.0,
                least: LOAD,
            })
        };
        let feet = [at(0.1), at(-0.1)];
        let weight = |y: f64| Vector6::new(0.0, 0.0, 560.0, 560.0 * y, -560.0 * 0.02, 0.0);
        let shared = share(&weight(0.0), &feet);
        assert!((shared[0][2] - 280.0).abs() < 1e-6 && (shared[1][2] - 280.0).abs() < 1e-6);
        let moment = at_sensor(&shared[0], &feet[0].unwrap().at).angular;
        assert!(moment.x.abs() < 1e-6, "{moment}");
        // Beyond the left foot's bounds nearly all of the weight is on it: the other one stays on the ground.
        let shared = share(&weight(0.16), &feet);
        let rest = LOAD * 560.0;
        assert!(
            (shared[1][2] - rest).abs() < 3.0,
            "{} {}",
            shared[0],
            shared[1]
        );
    }

    #[test]
    fn a_foot_bears_no_more_than_its_share() {
        let sole = sole();
        let mut feet = two(&sole);
        for bears in [0.4, 0.2, 0.05, 0.0] {
            if let Some(foot) = &mut feet[1] {
                foot.bears = bears;
            }
            let over_left = 0.1 - 0.5 * bears * 0.2;
            let total = Vector6::new(0.0, 0.0, 560.0, 560.0 * over_left, -560.0 * 0.03, 0.0);
            let shared = share(&total, &feet);
            let missing = sum(&shared) - total;
            assert!(missing.amax() < 0.01 * 560.0, "{missing} at {bears}");
            let own = map(&feet[1].unwrap()).try_inverse().unwrap() * shared[1];
            assert!(own[2] <= bears * 560.0 + 1e-6, "{own} at {bears}");
        }
    }

    #[test]
    fn without_feet_nothing_is_borne() {
        let shared = share(&Vector6::repeat(100.0), &[None, None]);
        assert_eq!(sum(&shared), Vector6::zeros());
    }
}
