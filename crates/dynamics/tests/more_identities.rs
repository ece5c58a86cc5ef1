//! Momentum, energy, regressor and edited models by independent routes, on random robots.

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
            (u64::from(seed), Kind { links, base, mimic })
        },
    )
}

/// Torques by name of joint.
fn torques(model: &Model, tau: &[f64]) -> std::collections::BTreeMap<String, f64> {
    let base = model.nv() - model.joint_count();
    let joints = model.joint_names().map(str::to_owned);
    joints.zip(tau[base..].iter().copied()).collect()
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

    /// A re-rooted robot that moves the same needs the same joint torques, and stays put where the
    /// first one was.
    #[test]
    fn another_root((seed, kind) in kinds(), pick in any::<prop::sample::Index>()) {
        let model = random_model(seed, Kind { base: Base::Floating, ..kind });
        let frame = pick.index(model.frames().len());
        let other = model.rerooted(frame, Base::Floating).unwrap();
        prop_assert!((other.total_mass() - model.total_mass()).abs() < 1e-9);
        let [q, v, mut tau] = random_state(seed, &model);
        let (mut data, mut other_data) = (Data::new(&model), Data::new(&other));
        // No wrench may act on either root: nothing but the joints' torques moves the robot.
        tau[..6].fill(0.0);
        let a = aba(&model, &mut data, &q, &v, &tau, None).to_vec();
        let scale = a.iter().fold(100.0f64, |m, x| m.max(x.abs()));
        let tau = torques(&model, &tau);
        forward_kinematics_acceleration(&model, &mut data, &q, &v, &a);
        let m = frame_placement(&model, &data, frame);
        let quaternion = nalgebra::UnitQuaternion::from_rotation_matrix(
            &nalgebra::Rotation3::from_matrix_unchecked(m.rotation),
        );
        let (twist, acceleration) = (
            frame_velocity(&model, &data, frame, ReferenceFrame::Local),
            frame_acceleration(&model, &data, frame, ReferenceFrame::Local),
        );
        let by_name = |x: &[f64], n: usize| -> Vec<f64> {
            other.joint_names().map(|name| x[n + model.joint_index(name).unwrap()]).collect()
        };
        let pose = [m.translation.as_slice(), quaternion.coords.as_slice()].concat();
        let q2 = [pose, by_name(&q, 7)].concat();
        let v2 = [twist.to_array().to_vec(), by_name(&v, 6)].concat();
        let a2 = [acceleration.to_array().to_vec(), by_name(&a, 6)].concat();
        let tau2 = torques(&other, rnea(&other, &mut other_data, &q2, &v2, &a2, None));
        for (name, t) in &tau {
            prop_assert!((t - tau2[name]).abs() < 1e-9 * scale, "{name} {t} {}", tau2[name]);
        }
        forward_kinematics(&other, &mut other_data, &q2);
        for link in model.frames() {
            let k = other.frame_index(&link.name).unwrap();
            let (x, y) = (
                frame_placement(&model, &data, model.frame_index(&link.name).unwrap()),
                frame_placement(&other, &other_data, k),
            );
            prop_assert!((x.translation - y.translation).norm() < 1e-9);
            prop_assert!((x.rotation - y.rotation).norm() < 1e-9);
        }
        prop_assert_eq!(other.frames()[frame].parent, None);
    }

    /// Locked joints are joints that rest.
    #[test]
    fn locked_joints((seed, kind) in kinds(), choice in any::<u32>()) {
        let model = random_model(seed, kind);
        let (bv, bq) = match model.base() { Base::Fixed => (0, 0), Base::Floating => (6, 7) };
        let [q, mut v, mut a] = random_state(seed, &model);
        let mut locked = Vec::new();
        for joint in (0..model.joint_count()).filter(|j| choice >> (j % 32) & 1 == 1) {
            locked.push((joint, q[bq + joint]));
            (v[bv + joint], a[bv + joint]) = (0.0, 0.0);
        }
        let other = model.with_locked_joints(&locked);
        prop_assert_eq!(other.joint_count(), model.joint_count() - locked.len());
        let keep = |x: &[f64], n: usize| -> Vec<f64> {
            let joints = other.joint_names().map(|name| x[n + model.joint_index(name).unwrap()]);
            x[..n].iter().copied().chain(joints).collect()
        };
        let (mut data, mut other_data) = (Data::new(&model), Data::new(&other));
        let tau = rnea(&model, &mut data, &q, &v, &a, None);
        let expected = keep(tau, bv);
        let ours = rnea(&other, &mut other_data, &keep(&q, bq), &keep(&v, bv), &keep(&a, bv), None);
        prop_assert!(error(ours, &expected) < 1e-11);
    }

    /// What is taken off weighs what it weighed; what remains moves as before.
    #[test]
    fn parts_taken_off((seed, kind) in kinds(), pick in any::<prop::sample::Index>()) {
        let model = random_model(seed, kind);
        let frame = pick.index(model.frames().len());
        let Some(other) = model.without(frame) else {
            prop_assert!(model.frames()[frame].parent.is_none());
            return Ok(());
        };
        let cut = model.cut(frame).unwrap();
        let carried = |c: &usize| -> f64 {
            let bodies = model.bodies().iter().enumerate();
            bodies.filter(|(i, _)| model.supports(*c, *i)).map(|(_, b)| b.inertia.mass).sum()
        };
        let off = cut.inertia.mass + cut.children.iter().map(carried).sum::<f64>();
        prop_assert!((model.total_mass() - off - other.total_mass()).abs() < 1e-9);
        prop_assert!(other.frame_index(&model.frames()[frame].name).is_none());
        if kind.mimic {
            return Ok(()); // Joints that follow one taken off become independent.
        }
        // What was taken off acts on what remains as its wrench at the cut did.
        let (bv, bq) = (model.nv() - model.joint_count(), model.nq() - model.joint_count());
        let [q, v, a] = random_state(seed, &model);
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a, None).to_vec();
        let keep = |x: &[f64], n: usize| -> Vec<f64> {
            let joints = other.joint_names().map(|name| x[n + model.joint_index(name).unwrap()]);
            x[..n].iter().copied().chain(joints).collect()
        };
        let at_cut = wrench_at_cut(&model, &mut data, frame, &cut, [&q, &v, &a]);
        let carrier = &model.frames()[model.frames()[frame].parent.unwrap()];
        let carrier = other.frame_index(&carrier.name).unwrap();
        let mut f = vec![Force::zero(); other.bodies().len()];
        let body = other.frames()[carrier].body;
        let (mut other_data, [q, v, a]) = (Data::new(&other), [keep(&q, bq), keep(&v, bv), keep(&a, bv)]);
        forward_kinematics(&other, &mut other_data, &q);
        f[body] -= other_data.placements()[body].inverse().act_force(at_cut);
        let ours = rnea(&other, &mut other_data, &q, &v, &a, Some(&f));
        prop_assert!(error(ours, &keep(&tau, bv)) < 1e-10);
    }
}

/// The wrench that holds what is cut off, in the world: what its parts need to move as they do.
fn wrench_at_cut(
    model: &Model,
    data: &mut Data,
    frame: usize,
    cut: &dynamics::Cut,
    [q, v, a]: [&[f64]; 3],
) -> Force {
    forward_kinematics_acceleration(model, data, q, v, a);
    let mut sum = Force::zero();
    let mut add = |inertia: &Inertia, body: usize, place: &Se3| {
        let world = data.placements()[body].compose(place);
        let up = Motion::new(
            -(data.placements()[body].rotation.transpose() * model.gravity()),
            nalgebra::Vector3::zeros(),
        );
        let (v, a) = (data.velocities()[body], data.accelerations()[body] + up);
        let wrench = inertia.wrench(place.inverse_act_motion(v), place.inverse_act_motion(a));
        sum += world.act_force(wrench);
    };
    add(&cut.inertia, cut.body, &model.frames()[frame].placement);
    for (i, body) in model.bodies().iter().enumerate() {
        if cut.children.iter().any(|c| model.supports(*c, i)) {
            add(&body.inertia, i, &Se3::identity());
        }
    }
    sum
}
