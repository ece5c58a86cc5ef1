//! Standard deviations of torques, contact wrenches and residuals of random robots: against the
//! effect of each input by itself, and against random draws of all of them.

use crate::common;

use common::{Robot, Scene};
use robot_state::Wrench;
use test_support::Random;
use whole_body::{
    LastingErrors, MotionSource, Residual, Weighting, WholeBody, WholeBodyEstimate,
    WholeBodyParameters,
};

const COMBINATIONS: [(Weighting, Residual); 4] = [
    (Weighting::Unit, Residual::Stays),
    (Weighting::Unit, Residual::HandedOn),
    (Weighting::Expected, Residual::Stays),
    (Weighting::Expected, Residual::HandedOn),
];

fn numbers(w: &Wrench) -> impl Iterator<Item = f64> {
    w.force.into_iter().chain(w.torque)
}

fn outputs(e: &WholeBodyEstimate) -> Vec<f64> {
    let mut all = e.tau.clone();
    all.extend(e.contacts.iter().flat_map(|c| numbers(&c.wrench)));
    all.extend(e.parts.iter().flat_map(|p| numbers(&p.residual)));
    all
}

/// In the order of `outputs`.
fn sigmas(e: &WholeBodyEstimate) -> Vec<f64> {
    let mut all = e.sigma.clone();
    all.extend(e.contacts.iter().flat_map(|c| numbers(&c.sigma)));
    all.extend(e.parts.iter().flat_map(|p| numbers(&p.residual_sigma)));
    all
}

/// Random points and directions may nearly depend on one another: the largest response.
fn largest(sigmas: &[f64]) -> f64 {
    sigmas.iter().fold(1.0f64, |m, x| m.max(*x))
}

/// Calls back with the scene in which one input has changed by `change(sigma)`, for every input.
fn each_input(
    parameters: &WholeBodyParameters,
    scene: &mut Scene,
    mut change: impl FnMut(&mut Scene, f64, fn(&mut Scene, usize, usize, f64), (usize, usize)),
) {
    for (s, sensor) in parameters.ft_sensors.iter().enumerate() {
        for axis in 0..3 {
            change(
                scene,
                sensor.sigma_force,
                |x, s, k, d| x.ft[s].force[k] += d,
                (s, axis),
            );
            change(
                scene,
                sensor.sigma_torque,
                |x, s, k, d| x.ft[s].torque[k] += d,
                (s, axis),
            );
        }
    }
    for (j, sigma) in parameters.sigma_ddq.iter().enumerate() {
        change(scene, *sigma, |x, j, _, d| x.ddq[j] += d, (j, 0));
    }
    let MotionSource::Imu(imu) = &parameters.source else {
        unreachable!("random robots have an IMU")
    };
    for axis in 0..3 {
        let [linear, angular] = [imu.sigma_accelerometer, imu.sigma_angular_acceleration];
        change(
            scene,
            linear,
            |x, k, _, d| x.imu.proper_acceleration[k] += d,
            (axis, 0),
        );
        change(
            scene,
            angular,
            |x, k, _, d| x.imu.angular_acceleration[k] += d,
            (axis, 0),
        );
    }
}

/// Every output's variance is the sum of the squares of its inputs' effects: the outputs are linear
/// in F/T signals, accelerometer, accelerations and masses, so differences show them.
#[test]
fn sigma_is_that_of_the_inputs() {
    for seed in 0..300 {
        let robot = Robot::random(seed);
        let mut scene = Scene::random(&robot, seed ^ 4);
        for (weighting, residual) in COMBINATIONS {
            // Masses change the weights too.
            let sigma_model = if weighting == Weighting::Unit {
                0.1
            } else {
                0.0
            };
            let parameters = WholeBodyParameters {
                weighting,
                residual,
                sigma_model,
                ..robot.parameters()
            };
            let mut whole_body = WholeBody::new(&robot.model, &parameters).unwrap();
            let reference = whole_body.update(&scene.input()).clone();
            assert!(reference.valid);
            let at = outputs(&reference);
            let mut variance = vec![0.0; at.len()];
            let mut add = |moved: &[f64], sigma: f64| {
                for ((v, a), b) in variance.iter_mut().zip(moved).zip(&at) {
                    *v += (sigma * (a - b)).powi(2);
                }
            };
            each_input(&parameters, &mut scene, |scene, sigma, change, (i, k)| {
                let mut moved = scene.clone();
                change(&mut moved, i, k, 1.0);
                add(&outputs(whole_body.update(&moved.input())), sigma);
            });
            for part in 0..=parameters.ft_sensors.len() {
                let model = robot.with_doubled(part);
                let mut whole_body = WholeBody::new(&model, &parameters).unwrap();
                add(&outputs(whole_body.update(&scene.input())), sigma_model);
            }
            let ours = sigmas(&reference);
            let tolerance = 1e-7 * largest(&ours);
            for (i, (ours, variance)) in ours.iter().zip(&variance).enumerate() {
                let expected = variance.sqrt();
                assert!(
                    (ours - expected).abs() <= tolerance,
                    "robot {seed}, {weighting:?}, {residual:?}, output {i}: {ours}, not {expected}"
                );
            }
        }
    }
}

/// Outputs left out of `update_torques` change none of its bits.
#[test]
fn torques_alone_are_those_of_the_whole_update() {
    for seed in 0..100 {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 4);
        for (weighting, residual) in COMBINATIONS {
            let parameters = WholeBodyParameters {
                weighting,
                residual,
                ..robot.parameters()
            };
            let mut whole = WholeBody::new(&robot.model, &parameters).unwrap();
            let mut alone = whole.clone();
            let whole = whole.update(&scene.input());
            let torques = alone.update_torques(&scene.input());
            assert!(whole.valid && torques.valid);
            assert_eq!((&whole.tau, &whole.sigma), (&torques.tau, &torques.sigma));
        }
    }
}

/// Covariances of an update stand until it is their turn again; without them torques and wrenches
/// have the same bits.
#[test]
fn covariances_in_their_turn_change_nothing_else() {
    for seed in 0..30 {
        let robot = Robot::random(seed);
        for (weighting, residual) in COMBINATIONS {
            let parameters = WholeBodyParameters {
                weighting,
                residual,
                ..robot.parameters()
            };
            let mut always = WholeBody::new(&robot.model, &parameters).unwrap();
            let mut in_turn = always.clone().with_covariances_every(3, 1);
            let mut last = Vec::new();
            for k in 0..7 {
                let scene = Scene::random(&robot, seed ^ (10 + k));
                let all = always.update(&scene.input());
                let some = in_turn.update(&scene.input());
                assert!(all.valid && some.valid);
                assert_eq!(all.tau, some.tau);
                for (all, some) in all.contacts.iter().zip(&some.contacts) {
                    assert_eq!(all.wrench, some.wrench);
                }
                for (all, some) in all.parts.iter().zip(&some.parts) {
                    assert_eq!((all.net, all.residual), (some.net, some.residual));
                }
                // The first one, as none is known, and then each third: place 0 of 3.
                if k == 0 || k % 3 == 1 {
                    last.clone_from(&all.sigma);
                }
                assert_eq!(some.sigma, last, "update {k}");
            }
        }
    }
}

/// The worst relative error of `sigma` against the spread of the outputs over random draws.
fn monte_carlo(robots: std::ops::Range<u64>, draws: usize) -> f64 {
    let mut worst = 0.0f64;
    for seed in robots {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 4);
        let mut of_robot = 0.0f64;
        for (weighting, residual) in COMBINATIONS {
            let parameters = WholeBodyParameters {
                weighting,
                residual,
                ..robot.parameters()
            };
            let mut whole_body = WholeBody::new(&robot.model, &parameters).unwrap();
            let reference = whole_body.update(&scene.input()).clone();
            let (at, ours) = (outputs(&reference), sigmas(&reference));
            let mut random = Random::new(seed);
            let mut squares = vec![0.0; at.len()];
            let mut moved = scene.clone();
            for _ in 0..draws {
                moved.clone_from(&scene);
                each_input(&parameters, &mut moved, |moved, sigma, change, (i, k)| {
                    change(moved, i, k, sigma * random.normal());
                });
                let estimate = outputs(whole_body.update(&moved.input()));
                for ((sum, x), mean) in squares.iter_mut().zip(&estimate).zip(&at) {
                    *sum += (x - mean).powi(2);
                }
            }
            let rounding = 1e-9 * largest(&ours);
            for (ours, sum) in ours.iter().zip(&squares) {
                let spread = (sum / draws as f64).sqrt();
                let error = (ours - spread).abs() - rounding;
                of_robot = of_robot.max(error / spread.max(rounding));
            }
        }
        #[expect(clippy::disallowed_macros, reason = "progress of ten minutes")]
        {
            println!("robot {seed}: worst {:.2} %", 100.0 * of_robot);
        }
        worst = worst.max(of_robot);
    }
    worst
}

/// Four standard deviations of a standard deviation over that many draws are 4 %.
#[test]
fn sigma_is_the_spread_of_random_draws() {
    assert!(monte_carlo(0..6, 5000) < 0.04);
}

/// The whole: `cargo test --release -p whole-body --test all sigma:: -- --ignored --nocapture`.
#[test]
#[ignore = "ten minutes"]
fn sigma_is_the_spread_of_many_random_draws() {
    assert!(monte_carlo(0..100, 100_000) < 0.02);
}

/// Lasting errors of an F/T sensor: each axis errs by its offset, and by a share of the whole force or torque.
#[test]
fn lasting_errors_are_those_of_the_readings() {
    let lasting = LastingErrors {
        force: 0.7,
        torque: 0.05,
        share: 0.03,
    };
    for seed in 0..100 {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed ^ 4);
        for (weighting, residual) in COMBINATIONS {
            let mut parameters = WholeBodyParameters {
                weighting,
                residual,
                ..robot.parameters()
            };
            for sensor in &mut parameters.ft_sensors {
                sensor.lasting = lasting;
            }
            let mut whole_body = WholeBody::new(&robot.model, &parameters).unwrap();
            let reference = whole_body.update(&scene.input()).clone();
            let mut variance = vec![0.0; reference.tau.len()];
            for s in 0..parameters.ft_sensors.len() {
                let size = |w: [f64; 3]| w.iter().map(|x| x * x).sum::<f64>();
                let Wrench { force, torque } = scene.ft[s];
                let square = |offset: f64, w| offset.powi(2) + lasting.share.powi(2) * size(w);
                for axis in 0..6 {
                    let mut moved = scene.clone();
                    let variance_of_axis = if axis < 3 {
                        moved.ft[s].force[axis] += 1.0;
                        square(lasting.force, force)
                    } else {
                        moved.ft[s].torque[axis - 3] += 1.0;
                        square(lasting.torque, torque)
                    };
                    let moved = whole_body.update(&moved.input());
                    let effects = moved.tau.iter().zip(&reference.tau);
                    for (v, (a, b)) in variance.iter_mut().zip(effects) {
                        *v += variance_of_axis * (a - b).powi(2);
                    }
                }
            }
            let tolerance = 1e-7 * largest(&reference.lasting_sigma);
            for (ours, variance) in reference.lasting_sigma.iter().zip(&variance) {
                let expected = variance.sqrt();
                assert!(
                    (ours - expected).abs() <= tolerance,
                    "robot {seed}, {weighting:?}, {residual:?}: {ours}, not {expected}"
                );
            }
        }
    }
}
