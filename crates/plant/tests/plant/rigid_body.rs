//! The plant's rigid bodies: conservation laws, closed forms, and an independent Newton-Euler.

use dynamics::{Force, Se3};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use plant::articulated::{Dynamics, GRAVITY};
use plant::random::Random;
use plant::spatial::{split, stack, wrench_of};
use plant::tree::{State, Tree, integrate};
use plant::urdf::Urdf;

const HUMANOID: &str = include_str!("../../../../robot-models/humanoid/robot.urdf");
const LIFT_GRIPPER: &str = include_str!("../../../../robot-models/lift-gripper/robot.urdf");
const LEG: &str = include_str!("../../../../robot-models/leg/robot.urdf");

fn tree(urdf: &str, floating: bool, cuts: &[&str]) -> Tree {
    Tree::new(&Urdf::parse(urdf, "robot.urdf").unwrap(), floating, cuts).unwrap()
}

fn random_state(tree: &Tree, random: &mut Random) -> State {
    let mut state = tree.rest();
    if tree.floating() {
        state.position = random.normal3(1.0);
        state.orientation = UnitQuaternion::from_scaled_axis(random.normal3(1.0));
        state.twist = Vector6::from_fn(|_, _| random.normal());
    }
    state.q.fill_with(|| random.symmetric());
    state.dq.fill_with(|| random.symmetric());
    // As a step without time leaves them: where those that follow others belong.
    let still = vec![0.0; state.q.len()];
    integrate(tree, &mut state, &Vector6::zeros(), &still, 0.0);
    state
}

/// A random tree of revolute, prismatic and fixed joints, every third moving joint following an earlier
/// one, which may follow another itself.
fn random_robot(seed: u64) -> String {
    let mut random = Random::new(seed, 9);
    let mut three = |size: f64| {
        let v = random.normal3(size);
        format!("{} {} {}", v.x, v.y, v.z)
    };
    let mut text = String::from("<robot name=\"random\"><link name=\"l0\"/>");
    let mut moving: Vec<usize> = Vec::new();
    let mut choice = Random::new(seed, 10);
    for i in 1..=9 {
        let parent = (choice.unit() * i as f64) as usize;
        let kind = ["revolute", "prismatic", "revolute", "fixed"][(4.0 * choice.unit()) as usize];
        let [xx, yy, zz] = std::array::from_fn(|_| 0.01 + 0.05 * choice.unit());
        text += &format!(
            "<link name=\"l{i}\"><inertial><origin xyz=\"{}\" rpy=\"{}\"/><mass value=\"{}\"/>
             <inertia ixx=\"{}\" iyy=\"{}\" izz=\"{}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>
             <joint name=\"j{i}\" type=\"{kind}\"><parent link=\"l{parent}\"/><child link=\"l{i}\"/>
             <origin xyz=\"{}\" rpy=\"{}\"/><axis xyz=\"{}\"/>
             <limit lower=\"-3\" upper=\"3\" effort=\"10\" velocity=\"5\"/>",
            three(0.1),
            three(1.0),
            0.2 + 3.0 * choice.unit(),
            yy + zz,
            xx + zz,
            xx + yy,
            three(0.3),
            three(1.0),
            three(1.0),
        );
        if kind != "fixed" {
            if moving.len() % 3 == 2 {
                let driver = moving[(choice.unit() * moving.len() as f64) as usize];
                let (ratio, offset) = (2.0 * choice.symmetric(), choice.symmetric());
                text += &format!(
                    "<mimic joint=\"j{driver}\" multiplier=\"{ratio}\" offset=\"{offset}\"/>"
                );
            }
            moving.push(i);
        }
        text += "</joint>";
    }
    text + "</robot>"
}

/// Rates of a state: base acceleration and joint accelerations without any torque.
fn free(tree: &Tree, dynamics: &mut Dynamics, state: &State) -> (Vector6<f64>, Vec<f64>) {
    let zeros = vec![0.0; state.q.len()];
    let mut ddq = zeros.clone();
    dynamics.kinematics(tree, state);
    let base = dynamics.solve(tree, &zeros, &zeros, &mut ddq);
    (base, ddq)
}

/// One step of a fourth-order Runge-Kutta scheme, for tests that want exact motion.
fn runge_kutta(tree: &Tree, dynamics: &mut Dynamics, state: &mut State, h: f64) {
    type Rate = (Vector6<f64>, Vec<f64>, Vector6<f64>, Vec<f64>);
    let rate = |s: &State, dynamics: &mut Dynamics| -> Rate {
        let (a, ddq) = free(tree, dynamics, s);
        (s.twist, s.dq.clone(), a, ddq)
    };
    let moved = |r: &Rate, h: f64| {
        let mut s = state.clone();
        for i in 0..s.q.len() {
            s.q[i] += h * r.1[i];
            s.dq[i] += h * r.3[i];
        }
        let (omega, v) = split(&r.0);
        // A constant twist for a time h, to fourth order: fine for small h.
        s.twist += h * r.2;
        let turn = UnitQuaternion::from_scaled_axis(h * omega);
        let point = |p: Vector3<f64>| v + omega.cross(&p);
        let p = s.position;
        let k1 = point(p);
        let k2 = point(p + 0.5 * h * k1);
        let k3 = point(p + 0.5 * h * k2);
        let k4 = point(p + h * k3);
        s.position += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        s.orientation = turn * s.orientation;
        s
    };
    let k1 = rate(state, dynamics);
    let k2 = rate(&moved(&k1, 0.5 * h), dynamics);
    let k3 = rate(&moved(&k2, 0.5 * h), dynamics);
    let k4 = rate(&moved(&k3, h), dynamics);
    let mean = |f: &dyn Fn(&Rate) -> Vec<f64>| -> Vec<f64> {
        let (a, b, c, d) = (f(&k1), f(&k2), f(&k3), f(&k4));
        (0..a.len())
            .map(|i| (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]) / 6.0)
            .collect()
    };
    let six = |v: Vec<f64>| Vector6::from_column_slice(&v);
    let average: Rate = (
        six(mean(&|r| r.0.as_slice().to_vec())),
        mean(&|r| r.1.clone()),
        six(mean(&|r| r.2.as_slice().to_vec())),
        mean(&|r| r.3.clone()),
    );
    *state = moved(&average, h);
}

#[test]
fn a_tumbling_humanoid_keeps_energy_and_momentum() {
    let tree = tree(HUMANOID, true, &["left_ankle_ft", "right_wrist_ft"]);
    let mut dynamics = Dynamics::new(&tree);
    let mut state = random_state(&tree, &mut Random::new(3, 0));
    dynamics.kinematics(&tree, &state);
    let (energy, momentum) = (dynamics.energy(), dynamics.momentum());
    let com = dynamics.centre_of_mass(&tree);
    let (h, steps) = (2e-4, 1000);
    for _ in 0..steps {
        runge_kutta(&tree, &mut dynamics, &mut state, h);
    }
    dynamics.kinematics(&tree, &state);
    let now = dynamics.energy();
    let drift = (now.0 + now.1 - energy.0 - energy.1).abs();
    assert!((now.0 - energy.0).abs() > 1.0, "nothing moved");
    assert!(
        drift < 1e-5 * energy.0,
        "energy drifts by {drift} of {energy:?}"
    );

    let time = h * f64::from(steps);
    let weight = -tree.mass() * GRAVITY * Vector3::z();
    let linear = split(&momentum).1;
    // Weight acts at the centre of mass, which flies on a parabola.
    let middle = com + 0.5 * time * linear / tree.mass();
    let expected = momentum + time * wrench_of(&middle, &weight);
    let off = dynamics.momentum() - expected;
    assert!(off.norm() < 1e-4 * momentum.norm(), "momentum off by {off}");
}

#[test]
fn the_semi_implicit_step_converges_on_the_same_motion() {
    let tree = tree(LEG, false, &[]);
    let mut dynamics = Dynamics::new(&tree);
    let start = random_state(&tree, &mut Random::new(5, 0));
    let mut exact = start.clone();
    for _ in 0..500 {
        runge_kutta(&tree, &mut dynamics, &mut exact, 2e-4);
    }
    let mut error = |dt: f64| {
        let mut state = start.clone();
        for _ in 0..(0.1 / dt).round() as usize {
            let (base, ddq) = free(&tree, &mut dynamics, &state);
            integrate(&tree, &mut state, &base, &ddq, dt);
        }
        (state.q.iter().zip(&exact.q)).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
    };
    let (coarse, fine) = (error(1e-4), error(5e-5));
    let ratio = coarse / fine;
    assert!((1.8..2.2).contains(&ratio), "{coarse} {fine}");
}

fn rods(count: usize) -> String {
    let mut text = String::from("<robot name=\"rods\"><link name=\"l0\"/>");
    for i in 1..=count {
        let z = if i == 1 { 0.0 } else { -0.7 };
        text += &format!(
            "<link name=\"l{i}\"><inertial><origin xyz=\"0 0 -0.7\"/><mass value=\"{i}\"/>
             <inertia ixx=\"0\" iyy=\"0\" izz=\"0\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>
             <joint name=\"j{i}\" type=\"continuous\"><parent link=\"l{}\"/><child link=\"l{i}\"/>
             <origin xyz=\"0 0 {z}\"/><axis xyz=\"0 1 0\"/></joint>",
            i - 1
        );
    }
    text + "</robot>"
}

#[test]
fn a_pendulum_accelerates_as_its_closed_form() {
    let tree = tree(&rods(1), false, &[]);
    let mut state = tree.rest();
    (state.q[0], state.dq[0]) = (0.8, 3.0);
    let (_, ddq) = free(&tree, &mut Dynamics::new(&tree), &state);
    assert!((ddq[0] + GRAVITY / 0.7 * 0.8_f64.sin()).abs() < 1e-12);
}

#[test]
fn a_double_pendulum_accelerates_as_its_closed_form() {
    let tree = tree(&rods(2), false, &[]);
    let mut state = tree.rest();
    state.q = vec![0.8, -1.5];
    state.dq = vec![3.0, -2.0];
    let (_, ddq) = free(&tree, &mut Dynamics::new(&tree), &state);
    // Absolute angles; textbook equations of two point masses m1 = 1, m2 = 2 on rods of length l.
    let (l, m1, m2) = (0.7, 1.0, 2.0);
    let (a, b) = (0.8_f64, 0.8 - 1.5_f64);
    let (da, db) = (3.0_f64, 3.0 - 2.0_f64);
    let denominator = l * (2.0 * m1 + m2 - m2 * (2.0 * (a - b)).cos());
    let dda = (-GRAVITY * (2.0 * m1 + m2) * a.sin()
        - m2 * GRAVITY * (a - 2.0 * b).sin()
        - 2.0 * (a - b).sin() * m2 * (db * db * l + da * da * l * (a - b).cos()))
        / denominator;
    let ddb = 2.0
        * (a - b).sin()
        * (da * da * l * (m1 + m2)
            + GRAVITY * (m1 + m2) * a.cos()
            + db * db * l * m2 * (a - b).cos())
        / denominator;
    assert!((ddq[0] - dda).abs() < 1e-10, "{} {dda}", ddq[0]);
    assert!((ddq[0] + ddq[1] - ddb).abs() < 1e-10, "{} {ddb}", ddq[1]);
}

/// Random torques and a random external wrench, against `dynamics::rnea`, whose code is not
/// shared.
fn assert_agrees_with_rnea(urdf: &str, floating: bool, pushed: &str) {
    let cuts = &[pushed];
    let tree = tree(urdf, floating, cuts);
    let base = if floating {
        dynamics::Base::Floating
    } else {
        dynamics::Base::Fixed
    };
    let model = dynamics::Model::from_urdf(urdf, "robot.urdf", base).unwrap();
    let mut data = dynamics::Data::new(&model);
    let mut work = Dynamics::new(&tree);
    let mut random = Random::new(11, 0);
    let all = tree.joint_names().len();
    let n = tree.driven_names().len();
    let place: Vec<usize> = (tree.driven_names().iter())
        .map(|name| model.joint_index(name).unwrap())
        .collect();
    let (nb, nqb) = if floating { (6, 7) } else { (0, 0) };
    for _ in 0..20 {
        let state = random_state(&tree, &mut random);
        let driven = |i: usize| f64::from(u8::from(i < n));
        let mut draw = |i, size: f64| driven(i) * size * random.symmetric();
        let tau: Vec<f64> = (0..all).map(|i| draw(i, 30.0)).collect();
        let armature: Vec<f64> = (0..all).map(|i| draw(i, 1.0).abs()).collect();
        let mut ddq = vec![0.0; all];
        work.kinematics(&tree, &state);
        let frame = tree.frame(pushed).unwrap();
        let (r, p) = work.placement(frame);
        let (force, torque) = (random.normal3(50.0), random.normal3(5.0));
        let wrench = wrench_of(&p, &force) + stack(torque, Vector3::zeros());
        work.push(frame.body, &wrench);
        work.clear_external();
        work.note_external(frame.body, &wrench);
        let a0 = work.solve(&tree, &tau, &armature, &mut ddq);

        let mut q = vec![0.0; model.nq()];
        let (mut v, mut a) = (vec![0.0; model.nv()], vec![0.0; model.nv()]);
        if floating {
            q[..3].copy_from_slice(state.position.as_slice());
            q[3..7].copy_from_slice(state.orientation.coords.as_slice());
            let rotation = state.orientation.to_rotation_matrix().into_inner();
            for (to, from) in [(&mut v, &state.twist), (&mut a, &a0)] {
                let (angular, linear) = split(from);
                let here = rotation.tr_mul(&(linear + angular.cross(&state.position)));
                to[..3].copy_from_slice(here.as_slice());
                to[3..6].copy_from_slice(rotation.tr_mul(&angular).as_slice());
            }
        }
        for i in 0..n {
            q[nqb + place[i]] = state.q[i];
            v[nb + place[i]] = state.dq[i];
            a[nb + place[i]] = ddq[i];
        }
        let frame = model.frame_index(pushed).unwrap();
        let mut external = vec![Force::zero(); model.bodies().len()];
        let sensor = &model.frames()[frame];
        let placement: Se3 = sensor.placement;
        external[sensor.body] =
            placement.act_force(Force::new(r.tr_mul(&force), r.tr_mul(&torque)));
        let expected = dynamics::rnea(&model, &mut data, &q, &v, &a, Some(&external));
        for i in 0..n {
            let got = tau[i] - armature[i] * ddq[i];
            let want = expected[nb + place[i]];
            assert!(
                (got - want).abs() < 1e-8 * (1.0 + want.abs()),
                "{got} {want}"
            );
        }
        for missing in &expected[..nb] {
            assert!(missing.abs() < 1e-7, "base force {missing}");
        }
        // The same by the plant's own backward pass.
        work.wrenches(&tree);
        // The linkage of a joint that others follow takes a part, so that they are not compared.
        for i in (0..n).filter(|_| all == n) {
            let got = tau[i] - armature[i] * ddq[i];
            assert!((work.torque(&tree, i) - got).abs() < 1e-8 * (1.0 + got.abs()));
        }
        if floating {
            assert!(work.missing().norm() < 1e-6);
        }
    }
}

#[test]
fn forward_dynamics_agrees_with_an_independent_newton_euler() {
    assert_agrees_with_rnea(HUMANOID, true, "left_ankle_ft");
    assert_agrees_with_rnea(HUMANOID, false, "right_wrist_ft");
    assert_agrees_with_rnea(LEG, false, "ankle_ft");
}

#[test]
fn random_robots_with_prismatic_and_mimic_joints_agree_with_newton_euler() {
    assert_agrees_with_rnea(LIFT_GRIPPER, true, "wrist_ft");
    assert_agrees_with_rnea(LIFT_GRIPPER, false, "finger_follower_link");
    let (mut slide, mut follow) = (0, 0);
    for seed in 0..40 {
        let urdf = random_robot(seed);
        let tree = tree(&urdf, false, &[]);
        slide += tree.slides().iter().filter(|slides| **slides).count();
        follow += tree.joint_names().len() - tree.driven_names().len();
        assert_agrees_with_rnea(&urdf, seed % 2 == 0, "l9");
    }
    assert!(slide > 40 && follow > 30, "{slide} {follow}");
}

#[test]
fn a_robot_with_followers_keeps_its_energy() {
    let tree = tree(LIFT_GRIPPER, true, &[]);
    let mut dynamics = Dynamics::new(&tree);
    let mut state = random_state(&tree, &mut Random::new(4, 0));
    dynamics.kinematics(&tree, &state);
    let energy = dynamics.energy();
    for _ in 0..500 {
        runge_kutta(&tree, &mut dynamics, &mut state, 2e-4);
    }
    dynamics.kinematics(&tree, &state);
    let now = dynamics.energy();
    let drift = (now.0 + now.1 - energy.0 - energy.1).abs();
    assert!((now.0 - energy.0).abs() > 1.0, "nothing moved");
    assert!(
        drift < 1e-5 * energy.0,
        "energy drifts by {drift} of {energy:?}"
    );
    let [finger, follower] = ["finger", "finger_follower"]
        .map(|name| tree.joint_names().iter().position(|n| n == name).unwrap());
    assert!((state.q[finger] - state.q[follower]).abs() < 1e-9);
}

#[test]
fn joints_that_cannot_follow_are_refused() {
    let refused = |from: &str, to: &str| {
        assert!(LIFT_GRIPPER.contains(from));
        let urdf = Urdf::parse(&LIFT_GRIPPER.replace(from, to), "robot.urdf").unwrap();
        Tree::new(&urdf, false, &[]).unwrap_err().to_string()
    };
    let error = refused("mimic joint=\"finger\"", "mimic joint=\"nobody\"");
    assert!(error.contains("finger_follower mimics nobody"), "{error}");
    let error = refused("mimic joint=\"finger\"", "mimic joint=\"finger_follower\"");
    assert!(error.contains("mimics itself"), "{error}");
}
