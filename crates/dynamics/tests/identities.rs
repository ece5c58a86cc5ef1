//! The algorithms against each other, by independent routes, on random robots.

mod support;

use dynamics::*;
use nalgebra::{DVector, Matrix6xX, Vector3, Vector6};
use proptest::prelude::*;
use support::{Kind, error, random_model, random_state, random_urdf, textbook};

fn kinds() -> impl Strategy<Value = (u64, Kind)> {
    let flags = any::<[bool; 4]>();
    (any::<u32>(), 1..24usize, flags).prop_map(|(seed, links, flags)| {
        let [floating, mimic, chain, aligned] = flags;
        let base = if floating {
            Base::Floating
        } else {
            Base::Fixed
        };
        let kind = Kind {
            links,
            base,
            mimic,
            chain,
            aligned,
        };
        (u64::from(seed), kind)
    })
}

fn wrenches(seed: u64, model: &Model) -> Vec<Force> {
    let mut r = Random::new(seed + 5);
    let mut one = || Force::from_array(std::array::from_fn(|_| r.uniform(-10.0, 10.0)));
    model.bodies().iter().map(|_| one()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    /// The fast rnea against the textbook's, external wrenches and armatures included.
    #[test]
    fn fast_and_textbook_inverse_dynamics_agree((seed, kind) in kinds()) {
        let mut model = random_model(seed, kind);
        for joint in 0..model.joint_count() {
            model.set_armature(joint, 0.01 * (joint % 3) as f64);
        }
        let [q, v, a] = random_state(seed, &model);
        let f = wrenches(seed, &model);
        let expected = textbook::inverse_dynamics(&model, [&q, &v, &a], &f);
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a, Some(&f));
        prop_assert!(error(tau, &expected) < 1e-12, "{}", error(tau, &expected));
    }

    /// The same of serial arms, each joint revolute, which have a path of their own; and their mass matrix.
    #[test]
    fn serial_arms_agree_with_the_textbook((seed, kind) in kinds(), links in 2..13usize) {
        let kind = Kind { links, chain: true, mimic: false, ..kind };
        let text = random_urdf(seed, kind).replace("prismatic", "revolute");
        let mut model = Model::from_urdf(&text, "arm.urdf", kind.base).unwrap();
        for joint in 0..model.joint_count() {
            model.set_armature(joint, 0.01 * (joint % 3) as f64);
        }
        let [q, v, a] = random_state(seed, &model);
        let f = wrenches(seed, &model);
        let mut data = Data::new(&model);
        for instructions in [Instructions::detect(), Instructions::Portable] {
            data.set_instructions(instructions);
            let expected = textbook::inverse_dynamics(&model, [&q, &v, &a], &f);
            let tau = rnea(&model, &mut data, &q, &v, &a, Some(&f));
            prop_assert!(error(tau, &expected) < 1e-12, "{}", error(tau, &expected));
            let none = vec![Force::zero(); model.bodies().len()];
            let (zero, m) = (vec![0.0; model.nv()], crba(&model, &mut data, &q).clone());
            let still = textbook::inverse_dynamics(&model, [&q, &zero, &zero], &none);
            let moved = textbook::inverse_dynamics(&model, [&q, &zero, &a], &none);
            let expected: Vec<f64> = moved.iter().zip(&still).map(|(m, s)| m - s).collect();
            let product = &m * DVector::from_column_slice(&a);
            prop_assert!(error(product.as_slice(), &expected) < 1e-11);
        }
    }

    /// M a + nle = rnea; M is symmetric.
    #[test]
    fn mass_matrix_and_nle_make_rnea((seed, kind) in kinds()) {
        let model = random_model(seed, kind);
        let [q, v, a] = random_state(seed, &model);
        let mut data = Data::new(&model);
        let bias = DVector::from_column_slice(nle(&model, &mut data, &q, &v));
        let m = crba(&model, &mut data, &q).clone();
        let sum = &m * DVector::from_column_slice(&a) + bias;
        let tau = rnea(&model, &mut data, &q, &v, &a, None);
        prop_assert!(error(sum.as_slice(), tau) < 1e-12);
        prop_assert!(error(m.as_slice(), m.transpose().as_slice()) < 1e-15);
    }

    /// Every set of instructions gives the same torques, to rounding.
    #[test]
    fn instructions_agree((seed, kind) in kinds()) {
        let model = random_model(seed, kind);
        let [q, v, a] = random_state(seed, &model);
        let f = wrenches(seed, &model);
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a, Some(&f)).to_vec();
        let m = crba(&model, &mut data, &q).clone();
        let ddq = aba(&model, &mut data, &q, &v, &tau, Some(&f)).to_vec();
        data.set_instructions(Instructions::Portable);
        let portable = rnea(&model, &mut data, &q, &v, &a, Some(&f));
        prop_assert!(error(&tau, portable) < 1e-12);
        let portable = crba(&model, &mut data, &q);
        prop_assert!(error(m.as_slice(), portable.as_slice()) < 1e-12);
        let portable = aba(&model, &mut data, &q, &v, &tau, Some(&f));
        prop_assert!(error(&ddq, portable) < 1e-8);
    }

    /// aba inverts rnea, external wrenches included; so does solving with M.
    #[test]
    fn forward_inverts_inverse((seed, kind) in kinds()) {
        let mut model = random_model(seed, kind);
        for joint in 0..model.joint_count() {
            model.set_armature(joint, 0.01 * (joint % 3) as f64);
        }
        let [q, v, a] = random_state(seed, &model);
        let f = wrenches(seed, &model);
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a, Some(&f)).to_vec();
        let ddq = aba(&model, &mut data, &q, &v, &tau, Some(&f)).to_vec();
        prop_assert!(error(&ddq, &a) < 1e-8, "{}", error(&ddq, &a));
        let zero = vec![0.0; model.nv()];
        let bias = rnea(&model, &mut data, &q, &v, &zero, Some(&f)).to_vec();
        let mut x: Vec<f64> = tau.iter().zip(&bias).map(|(t, b)| t - b).collect();
        crba(&model, &mut data, &q);
        prop_assert!(cholesky_decompose(&model, &mut data));
        cholesky_solve(&model, &data, &mut x);
        prop_assert!(error(&x, &a) < 1e-8);
    }

    /// J^T f is the effect of f in rnea; J v is the frame's twist.
    #[test]
    fn jacobians_carry_wrenches_and_twists((seed, kind) in kinds(), pick in any::<prop::sample::Index>()) {
        let model = random_model(seed, kind);
        let [q, v, a] = random_state(seed, &model);
        let frame = pick.index(model.frames().len());
        let mut data = Data::new(&model);
        let mut f = vec![Force::zero(); model.bodies().len()];
        let local = wrenches(seed, &model)[0];
        let at = &model.frames()[frame];
        f[at.body] = at.placement.act_force(local);
        let with = rnea(&model, &mut data, &q, &v, &a, Some(&f)).to_vec();
        let without = rnea(&model, &mut data, &q, &v, &a, None).to_vec();
        let effect: Vec<f64> = without.iter().zip(&with).map(|(x, y)| x - y).collect();
        forward_kinematics_velocity(&model, &mut data, &q, &v);
        let mut j = Matrix6xX::zeros(model.nv());
        frame_jacobian(&model, &data, frame, ReferenceFrame::Local, &mut j);
        prop_assert!(error((j.transpose() * local.to_vector()).as_slice(), &effect) < 1e-11);
        for reference in [ReferenceFrame::Local, ReferenceFrame::World, ReferenceFrame::LocalWorldAligned] {
            frame_jacobian(&model, &data, frame, reference, &mut j);
            let twist: Vector6<f64> = &j * DVector::from_column_slice(&v);
            let expected = frame_velocity(&model, &data, frame, reference).to_vector();
            prop_assert!(error(twist.as_slice(), expected.as_slice()) < 1e-12);
        }
    }

    /// The derivative of a placement is the velocity, that of the velocity the classical acceleration.
    #[test]
    fn derivatives_of_placements((seed, kind) in kinds(), pick in any::<prop::sample::Index>()) {
        let model = random_model(seed, kind);
        let [q, v, a] = random_state(seed, &model);
        let frame = pick.index(model.frames().len());
        let reference = ReferenceFrame::LocalWorldAligned;
        let mut data = Data::new(&model);
        let h = 1e-5;
        let mut moved = |dt: f64| {
            let mut q = q.clone();
            let half: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + 0.5 * dt * a).collect();
            let end: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + dt * a).collect();
            integrate(&model, &mut q, &half, dt);
            forward_kinematics_velocity(&model, &mut data, &q, &end);
            (frame_placement(&model, &data, frame), frame_velocity(&model, &data, frame, reference))
        };
        // Bodies that rotate fast need a small step; velocities are too inexact for one.
        let small = 1e-6;
        let (before, after) = (moved(-small).0, moved(small).0);
        let rate = (after.translation - before.translation) / (2.0 * small);
        let turned = after.rotation * before.rotation.transpose();
        let skew = (turned - turned.transpose()) / (4.0 * small);
        let angular_rate = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
        let (before, after) = (moved(-h), moved(h));
        let linear = (after.1.linear - before.1.linear) / (2.0 * h);
        let angular = (after.1.angular - before.1.angular) / (2.0 * h);
        forward_kinematics_acceleration(&model, &mut data, &q, &v, &a);
        let twist = frame_velocity(&model, &data, frame, reference);
        let acceleration = frame_classical_acceleration(&model, &data, frame, reference);
        prop_assert!(error(rate.as_slice(), twist.linear.as_slice()) < 1e-6);
        prop_assert!(error(angular_rate.as_slice(), twist.angular.as_slice()) < 1e-6);
        prop_assert!(error(linear.as_slice(), acceleration.linear.as_slice()) < 1e-5);
        prop_assert!(error(angular.as_slice(), acceleration.angular.as_slice()) < 1e-5);
    }
}
