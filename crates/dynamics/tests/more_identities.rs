//! Momentum, energy, regressor and rates of Jacobians by independent routes, on random robots.

mod support;

use dynamics::*;
use nalgebra::{DMatrix, DVector, Matrix3xX, Matrix6xX};
use proptest::prelude::*;
use support::{Kind, error, random_model, random_state};

fn kinds() -> impl Strategy<Value = (u64, Kind)> {
    (any::<u32>(), 2..20usize, any::<bool>(), any::<bool>()).prop_map(
        |(seed, links, floating, mimic)| {
            let base = if floating {
                Base::Floating
            } else {
                Base::Fixed
            };
            (
                u64::from(seed),
                Kind {
                    links,
                    base,
                    mimic,
                    chain: seed % 2 == 1,
                    aligned: seed % 4 > 1,
                },
            )
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// The centre of mass moves with its Jacobian, momentum is the map times v, and its linear part
    /// is mass times that velocity.
    #[test]
    fn momentum((seed, kind) in kinds()) {
        let model = random_model(seed, kind);
        let [q, v, _] = random_state(seed, &model);
        let v = DVector::from_vec(v);
        let mut data = Data::new(&model);
        let h = 1e-6;
        let mut center = |dt: f64| {
            let mut q = q.clone();
            integrate(&model, &mut q, v.as_slice(), dt);
            forward_kinematics(&model, &mut data, &q);
            center_of_mass(&model, &data)
        };
        let rate = (center(h) - center(-h)) / (2.0 * h);
        forward_kinematics_velocity(&model, &mut data, &q, v.as_slice());
        let mut j = Matrix3xX::zeros(model.nv());
        center_of_mass_jacobian(&model, &mut data, &mut j);
        prop_assume!(j.iter().all(|x| x.is_finite()));
        let velocity = &j * &v;
        prop_assert!(error(velocity.as_slice(), rate.as_slice()) < 1e-7);
        let mut map = Matrix6xX::zeros(model.nv());
        centroidal_map(&model, &mut data, &mut map);
        let momentum = centroidal_momentum(&model, &data);
        prop_assert!(error((&map * &v).as_slice(), &momentum.to_array()) < 1e-11);
        let first = if model.base() == Base::Fixed { model.bodies()[0].inertia.mass } else { 0.0 };
        let mass = model.total_mass() - first;
        prop_assert!(error((velocity * mass).as_slice(), momentum.linear.as_slice()) < 1e-11);
    }

    /// T = v^T M v / 2; the rate of T + V is the power of the torques.
    #[test]
    fn energy((seed, kind) in kinds()) {
        let mut model = random_model(seed, kind);
        for joint in 0..model.joint_count() {
            model.set_armature(joint, 0.02 * joint as f64);
        }
        let [q, v, a] = random_state(seed, &model);
        let mut data = Data::new(&model);
        let h = 1e-5;
        let mut total = |dt: f64| {
            let mut q = q.clone();
            let half: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + 0.5 * dt * a).collect();
            let end: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + dt * a).collect();
            integrate(&model, &mut q, &half, dt);
            forward_kinematics_velocity(&model, &mut data, &q, &end);
            let kinetic = kinetic_energy(&model, &data, &end);
            let m = crba(&model, &mut data, &q).clone();
            let end = DVector::from_vec(end);
            assert!((kinetic - 0.5 * end.dot(&(m * &end))).abs() < 1e-10 * kinetic.max(1.0));
            kinetic + potential_energy(&model, &data)
        };
        let rate = (total(h) - total(-h)) / (2.0 * h);
        let tau = rnea(&model, &mut data, &q, &v, &a, None);
        let power: f64 = tau.iter().zip(&v).map(|(t, v)| t * v).sum();
        prop_assert!((rate - power).abs() < 1e-5 * power.abs().max(100.0), "{rate} {power}");
    }

    /// The regressor times the parameters is rnea.
    #[test]
    fn regressor((seed, kind) in kinds()) {
        let model = random_model(seed, kind);
        let [q, v, a] = random_state(seed, &model);
        let mut data = Data::new(&model);
        let first = usize::from(model.base() == Base::Fixed);
        let bodies = &model.bodies()[first..];
        let parameters = bodies.iter().flat_map(|b| {
            let (h, i) = (b.inertia.first_moment, b.inertia.rotational);
            [b.inertia.mass, h.x, h.y, h.z, i[(0, 0)], i[(0, 1)], i[(1, 1)], i[(0, 2)], i[(1, 2)], i[(2, 2)]]
        });
        let parameters = DVector::from_iterator(PARAMETERS * bodies.len(), parameters);
        let mut y = DMatrix::zeros(model.nv(), PARAMETERS * bodies.len());
        joint_torque_regressor(&model, &mut data, &q, &v, &a, &mut y);
        let tau = rnea(&model, &mut data, &q, &v, &a, None);
        prop_assert!(error((y * parameters).as_slice(), tau) < 1e-11);
    }

    /// dJ/dt v is the difference quotient of J v.
    #[test]
    fn rate_of_the_jacobian((seed, kind) in kinds(), pick in any::<prop::sample::Index>()) {
        let model = random_model(seed, kind);
        let [q, v, _] = random_state(seed, &model);
        let frame = pick.index(model.frames().len());
        let mut data = Data::new(&model);
        let h = 1e-6;
        for reference in [ReferenceFrame::Local, ReferenceFrame::World, ReferenceFrame::LocalWorldAligned] {
            let mut moved = |dt: f64| {
                let mut q = q.clone();
                integrate(&model, &mut q, &v, dt);
                forward_kinematics_velocity(&model, &mut data, &q, &v);
                frame_velocity(&model, &data, frame, reference)
            };
            let rate = (moved(h) - moved(-h)) * (0.5 / h);
            forward_kinematics_acceleration(&model, &mut data, &q, &v, &vec![0.0; model.nv()]);
            let ours = frame_jacobian_rate_times_velocity(&model, &data, frame, reference);
            prop_assert!(error(&ours.to_array(), &rate.to_array()) < 1e-6);
        }
    }

}
