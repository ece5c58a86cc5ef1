//! Torques and contact wrenches against the full inverse dynamics of random robots.

use crate::common;

use common::{Robot, Scene};
use dynamics::Se3;
use proptest::prelude::*;
use robot_state::Wrench;
use test_support::Random;
use whole_body::{
    CarriedImu, ContactKind, MotionSource, Place, Residual, Weighting, WholeBody,
    WholeBodyEstimate, WholeBodyParameters,
};

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

/// How much worse a part's contacts are conditioned than a full wrench: random points and
/// directions may nearly depend on one another. The largest share of a contact in its part's net.
fn conditioning(scene: &Scene) -> f64 {
    let wrenches = scene.contact.iter().flat_map(numbers);
    wrenches.fold(1.0f64, |m, x| m.max(x.abs())) / 100.0
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Torques and contacts are those that were put in, whatever the weights; nothing remains.
    #[test]
    fn agrees_with_inverse_dynamics(seed in any::<u64>(), expected in any::<bool>(), on in any::<bool>()) {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 1);
        let weighting = if expected { Weighting::Expected } else { Weighting::Unit };
        let residual = if on { Residual::HandedOn } else { Residual::Stays };
        let parameters = WholeBodyParameters { weighting, residual, ..robot.parameters() };
        let result = estimate(&robot, &scene, &parameters);
        let tolerance = 1e-9 * conditioning(&scene).max(1.0);
        close(result.tau, scene.tau.iter().copied(), tolerance);
        for (ours, truth) in result.contacts.iter().zip(&scene.contact) {
            close(numbers(&ours.wrench), numbers(truth), tolerance);
        }
        for part in &result.parts {
            close(numbers(&part.residual), [0.0; 6], tolerance);
        }
    }

    /// Contacts and sensors may be listed in any order: bit by bit the same.
    #[test]
    fn order_does_not_matter(seed in any::<u64>()) {
        let robot = Robot::random(seed);
        let mut scene = Scene::random(&robot, seed ^ 2);
        // Readings that contradict the contacts.
        for w in &mut scene.ft {
            w.force[0] += 5.0;
            w.torque[1] -= 2.0;
        }
        let parameters = WholeBodyParameters { weighting: Weighting::Expected, ..robot.parameters() };
        let reference = estimate(&robot, &scene, &parameters);
        let mut random = Random::new(seed ^ 3);
        let mut other = parameters.clone();
        let contacts = &mut other.hypotheses[0].contacts;
        let (shift, turn) = (random.below(contacts.len()), random.below(scene.ft.len()));
        contacts.rotate_left(shift);
        contacts.reverse();
        other.ft_sensors.rotate_left(turn);
        let mut shuffled = scene.clone();
        shuffled.ft.rotate_left(turn);
        let mut result = estimate(&robot, &shuffled, &other);
        prop_assert_eq!(&result.tau, &reference.tau);
        prop_assert_eq!(&result.sigma, &reference.sigma);
        result.contacts.reverse();
        result.contacts.rotate_right(shift);
        prop_assert_eq!(&result.contacts, &reference.contacts);
        result.parts[1..].rotate_right(turn);
        prop_assert_eq!(&result.parts, &reference.parts);
    }

    /// The IMU may sit anywhere.
    #[test]
    fn imu_place_does_not_matter(seed in any::<u64>()) {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 2);
        let reference = estimate(&robot, &scene, &robot.parameters());
        let tolerance = 1e-9 * conditioning(&scene).max(1.0);
        for link in robot.links().into_iter().step_by(3) {
            let place = Place { link, placement: Se3::from_xyz_rpy([0.3, -0.2, 0.1], [1.0, 2.0, 3.0]) };
            let mut moved = robot.parameters();
            let MotionSource::Imu(imu) = &mut moved.source else { unreachable!() };
            imu.frame = place.clone();
            let result = estimate(&robot, &scene.with_imu_at(&robot, &place), &moved);
            close(result.tau, reference.tau.iter().copied(), tolerance);
        }
    }

    /// Readings of an IMU at one link, carried over by the joints, are those of an IMU at another link.
    #[test]
    fn an_imu_is_carried_over_to_any_link(seed in any::<u64>()) {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 7);
        let parameters = robot.parameters();
        let joints: Vec<&str> = parameters.joints.iter().map(String::as_str).collect();
        let links = robot.links();
        for (from, to) in links.iter().zip(links.iter().rev()) {
            let way = CarriedImu::new(&robot.model, &joints, from, to).unwrap();
            let own = scene.with_imu_at(&robot, &Place::link(from)).imu;
            let carried = way.motion(&scene.q, &scene.dq, &scene.ddq, &own);
            let there = scene.with_imu_at(&robot, &Place::link(to)).imu;
            for (a, b) in [
                (carried.angular_velocity, there.angular_velocity),
                (carried.angular_acceleration, there.angular_acceleration),
                (carried.proper_acceleration, there.proper_acceleration),
            ] {
                close(a.iter().copied(), b.iter().copied(), 1e-9);
            }
        }
    }

    /// A contact that is there but not declared shows in its part's residual alone.
    #[test]
    fn a_missing_contact_shows(seed in any::<u64>()) {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 5);
        let parameters = WholeBodyParameters { weighting: Weighting::Expected, ..robot.parameters() };
        let mut reported = 0;
        for (s, _) in parameters.ft_sensors.iter().enumerate() {
            // Pushes of 100 N or 50 N·m on the part along each axis, as its sensor feels them: fewer
            // than six unknowns explain some of them, but not all.
            let mut shown = None;
            for k in 0..3 {
                let (mut force, mut torque) = (scene.clone(), scene.clone());
                force.ft[s].force[k] += 100.0;
                torque.ft[s].torque[k] += 50.0;
                for pushed in [force, torque] {
                    let result = estimate(&robot, &pushed, &parameters);
                    if let Some(ratio) = result.parts[s + 1].residual_ratio() {
                        shown = Some(ratio.max(shown.unwrap_or(0.0)));
                    }
                }
            }
            if let Some(ratio) = shown {
                prop_assert!(ratio > 5.0, "{ratio}");
                reported += 1;
            }
            let quiet = estimate(&robot, &scene, &parameters);
            for part in &quiet.parts {
                prop_assert!(part.residual_ratio().unwrap_or(0.0) < 1e-3);
            }
        }
        let fewer = parameters.hypotheses[0].contacts.iter().any(|c| c.kind == ContactKind::Nothing);
        prop_assert!(reported > 0 || !fewer);
    }
}

/// A stand that holds a link is an IMU there which feels gravity alone.
#[test]
fn a_stand_is_an_imu_at_rest() {
    for seed in 0..40 {
        let robot = Robot::random(seed);
        let mut scene = Scene::random(&robot, seed ^ 3);
        let mut parameters = robot.parameters();
        let gravity = nalgebra::Vector3::new(1.0, -2.0, -9.0);
        // The root's part has unknowns; the stand holds the root.
        let MotionSource::Imu(imu) = &mut parameters.source else {
            unreachable!()
        };
        imu.frame = Place::link("link0");
        imu.sigma_accelerometer = 0.0;
        imu.sigma_angular_acceleration = 0.0;
        scene.imu.angular_velocity.fill(0.0);
        scene.imu.angular_acceleration.fill(0.0);
        scene.imu.proper_acceleration = -gravity;
        let reference = estimate(&robot, &scene, &parameters);
        parameters.source = MotionSource::Fixed {
            link: "link0".into(),
            gravity,
        };
        scene.imu.proper_acceleration.fill(f64::NAN);
        assert_eq!(estimate(&robot, &scene, &parameters), reference);
    }
}

#[test]
fn signals_that_are_not_finite_leave_the_last_estimate() {
    let robot = Robot::random(5);
    let scene = Scene::random(&robot, 6);
    let mut whole_body = WholeBody::new(&robot.model, &robot.parameters()).unwrap();
    assert!(!whole_body.estimate().valid, "nothing seen yet");
    let good = whole_body.update(&scene.input()).clone();
    let mut broken = vec![scene.clone(); 5];
    broken[0].q[0] = f64::NAN;
    broken[1].ft[0].torque[2] = f64::INFINITY;
    broken[2].imu.angular_velocity.x = f64::NAN;
    broken[3].ddq.pop();
    broken[4].ft.clear();
    for scene in &broken {
        let bad = whole_body.update(&scene.input());
        assert!(!bad.valid);
        assert_eq!((&bad.tau, &bad.contacts), (&good.tau, &good.contacts));
    }
    assert_eq!(whole_body.update(&scene.input()), &good);
}
