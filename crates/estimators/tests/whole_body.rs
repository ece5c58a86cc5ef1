//! Whole-body torques against the full inverse dynamics of random robots.

#[allow(dead_code)] // each test uses a part of it
mod common;

use common::robots::{Robot, Scene};
use dynamics::Base;
use estimators::whole_body::{WholeBody, WholeBodyEstimate, WholeBodyInput, WholeBodyParameters};
use proptest::prelude::*;
use robot_state::Wrench;

fn numbers(w: &Wrench) -> impl Iterator<Item = f64> {
    w.force.into_iter().chain(w.torque)
}

fn close(a: impl IntoIterator<Item = f64>, b: impl IntoIterator<Item = f64>, tolerance: f64) {
    let (a, b): (Vec<f64>, Vec<f64>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    for (x, y) in a.iter().zip(&b) {
        assert!((x - y).abs() <= tolerance * scale, "{a:?}\n{b:?}");
    }
}

fn estimate(robot: &Robot, scene: &Scene, parameters: &WholeBodyParameters) -> WholeBodyEstimate {
    let mut whole_body = WholeBody::new(&robot.model, parameters).unwrap();
    let estimate = whole_body.update(&scene.input());
    assert!(estimate.valid);
    estimate.clone()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Torques, contacts and the unexplained wrench are those that were put in.
    #[test]
    fn agrees_with_inverse_dynamics(seed in any::<u64>(), floating in any::<bool>()) {
        let base = if floating { Base::Floating } else { Base::Fixed };
        let robot = Robot::random(seed, base);
        let scene = Scene::random(&robot, seed ^ 1);
        let result = estimate(&robot, &scene, &robot.parameters());
        close(result.tau, scene.tau.iter().copied(), 1e-10);
        for (ours, truth) in result.contact.iter().zip(&scene.contact) {
            close(numbers(ours), numbers(truth), 1e-9);
        }
        close(numbers(&result.unknown_wrench), numbers(&scene.unknown), 1e-9);
    }

    /// The IMU may sit anywhere, and the sensors may be listed in any order.
    #[test]
    fn imu_link_and_sensor_order_do_not_matter(seed in any::<u64>()) {
        let robot = Robot::random(seed, Base::Floating);
        let scene = Scene::random(&robot, seed ^ 2);
        let parameters = robot.parameters();
        let reference = estimate(&robot, &scene, &parameters);
        for link in robot.links().into_iter().step_by(3) {
            let mut moved = parameters.clone();
            moved.imu.as_mut().unwrap().frame = link.clone();
            let result = estimate(&robot, &scene.with_imu_on(&robot, &link), &moved);
            close(result.tau, reference.tau.iter().copied(), 1e-10);
            close(numbers(&result.unknown_wrench), numbers(&reference.unknown_wrench), 1e-9);
        }
        let mut reversed = parameters;
        reversed.ft_sensors.reverse();
        let mut other = scene.clone();
        other.ft.reverse();
        let mut result = estimate(&robot, &other, &reversed);
        result.contact.reverse();
        close(result.tau, reference.tau.iter().copied(), 1e-12);
        close(result.sigma, reference.sigma.iter().copied(), 1e-12);
        for (a, b) in result.contact.iter().zip(&reference.contact) {
            close(numbers(a), numbers(b), 1e-12);
        }
    }

    /// A floating base that does not move gives what a fixed one gives.
    #[test]
    fn a_base_at_rest_is_a_fixed_base(seed in any::<u64>()) {
        let mut fixed = Robot::random(seed, Base::Fixed);
        let scene = Scene::random(&fixed, seed ^ 3);
        let parameters = WholeBodyParameters { unknown_wrench_link: None, ..fixed.parameters() };
        let reference = estimate(&fixed, &scene, &parameters);
        fixed.make_floating();
        let result = estimate(&fixed, &scene, &parameters);
        close(result.tau, reference.tau, 1e-10);
        close(numbers(&result.unknown_wrench), numbers(&reference.unknown_wrench), 1e-9);
    }

    /// Every output's variance is the sum of the squares of its inputs' effects: the outputs are
    /// linear in F/T signals, accelerometer and joint accelerations, so differences show them.
    #[test]
    fn sigma_is_that_of_the_inputs(seed in any::<u64>(), floating in any::<bool>()) {
        let base = if floating { Base::Floating } else { Base::Fixed };
        let robot = Robot::random(seed, base);
        let scene = Scene::random(&robot, seed ^ 4);
        let parameters = robot.parameters();
        let mut whole_body = WholeBody::new(&robot.model, &parameters).unwrap();
        let reference = whole_body.update(&scene.input()).clone();
        let mut tau = vec![0.0; reference.tau.len()];
        let mut unknown = [0.0; 6];
        let mut effect = |scene: &Scene, sigma: f64| {
            let moved = whole_body.update(&scene.input());
            for ((v, a), b) in tau.iter_mut().zip(&moved.tau).zip(&reference.tau) {
                *v += (sigma * (a - b)).powi(2);
            }
            let moved = numbers(&moved.unknown_wrench).zip(numbers(&reference.unknown_wrench));
            for (v, (a, b)) in unknown.iter_mut().zip(moved) {
                *v += (sigma * (a - b)).powi(2);
            }
        };
        for (s, sensor) in parameters.ft_sensors.iter().enumerate() {
            for axis in 0..3 {
                let mut scene = scene.clone();
                scene.ft[s].force[axis] += 1.0;
                effect(&scene, sensor.sigma_force);
                scene.ft[s].force[axis] -= 1.0;
                scene.ft[s].torque[axis] += 1.0;
                effect(&scene, sensor.sigma_torque);
            }
        }
        for (j, sigma) in parameters.sigma_ddq.iter().enumerate() {
            let mut scene = scene.clone();
            scene.ddq[j] += 1.0;
            effect(&scene, *sigma);
        }
        if floating {
            for axis in 0..3 {
                let mut scene = scene.clone();
                scene.imu.proper_acceleration[axis] += 1.0;
                effect(&scene, parameters.imu.as_ref().unwrap().sigma_accelerometer);
            }
        }
        close(reference.sigma, tau.into_iter().map(f64::sqrt), 1e-8);
        close(numbers(&reference.unknown_wrench_sigma), unknown.into_iter().map(f64::sqrt), 1e-8);
    }
}

#[test]
fn signals_that_are_not_finite_leave_the_last_estimate() {
    let robot = Robot::random(5, Base::Floating);
    let scene = Scene::random(&robot, 6);
    let mut whole_body = WholeBody::new(&robot.model, &robot.parameters()).unwrap();
    assert!(!whole_body.estimate().valid, "nothing seen yet");
    let good = whole_body.update(&scene.input()).clone();
    let mut broken = vec![scene.clone(); 4];
    broken[0].q[0] = f64::NAN;
    broken[1].ft[0].torque[2] = f64::INFINITY;
    broken[2].imu.angular_velocity.x = f64::NAN;
    broken[3].ddq.pop();
    for scene in &broken {
        let bad = whole_body.update(&scene.input());
        assert!(!bad.valid);
        assert_eq!((&bad.tau, &bad.contact), (&good.tau, &good.contact));
    }
    assert_eq!(whole_body.update(&scene.input()), &good);
    let short = WholeBodyInput {
        ft: &[],
        ..scene.input()
    };
    assert!(!whole_body.update(&short).valid);
}

#[test]
fn what_does_not_follow_is_refused_by_name() {
    let floating = Robot::random(8, Base::Floating);
    let fixed = Robot::random(8, Base::Fixed);
    let message = |robot: &Robot, change: &dyn Fn(&mut WholeBodyParameters)| {
        let mut parameters = robot.parameters();
        parameters.unknown_wrench_link = None;
        change(&mut parameters);
        WholeBody::new(&robot.model, &parameters)
            .unwrap_err()
            .to_string()
    };
    let tip = floating.parameters().ft_sensors[0].frame.clone();
    let moving = floating.model.bodies()[1].name.replace("joint", "link");
    type Change<'a> = &'a dyn Fn(&mut WholeBodyParameters);
    let cases: [(&Robot, Change, &str); 12] = [
        (&floating, &|p| p.imu = None, "a floating base needs an IMU"),
        (
            &floating,
            &|p| p.imu.as_mut().unwrap().frame = "moon".into(),
            "IMU: link `moon` is not",
        ),
        (
            &floating,
            &|p| p.joints[0] = "elbow".into(),
            "joint `elbow` is not in the robot model",
        ),
        (
            &floating,
            &|p| p.joints[0] = p.joints[1].clone(),
            "must be listed exactly once",
        ),
        (
            &floating,
            &|p| drop(p.joints.pop()),
            "must be listed exactly once",
        ),
        (
            &floating,
            &|p| p.ft_sensors[0].frame = "link0".into(),
            "F/T sensor `s0` is on the root",
        ),
        (
            &floating,
            &|p| p.ft_sensors[0].frame = "x".into(),
            "F/T sensor `s0`: link `x` is not in",
        ),
        (
            &floating,
            &|p| p.ft_sensors.push(p.ft_sensors[0].clone()),
            "at the same place",
        ),
        (
            &floating,
            &|p| p.ft_sensors[0].contact_link = Some("link0".into()),
            "is not beyond",
        ),
        (
            &floating,
            &|p| p.ft_sensors[0].sigma_force = f64::NAN,
            "deviation of F/T sensor `s0`",
        ),
        (
            &floating,
            &|p| p.unknown_wrench_link = Some(tip.clone()),
            "lies beyond F/T sensor `s0`",
        ),
        (
            &fixed,
            &|p| p.unknown_wrench_link = Some(moving.clone()),
            "the base is fixed",
        ),
    ];
    for (robot, change, expected) in cases {
        let message = message(robot, change);
        assert!(message.contains(expected), "{message}");
    }
}
