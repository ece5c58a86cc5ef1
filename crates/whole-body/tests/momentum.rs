//! The momentum observer on random robots that fall freely or are pushed, integrated by forward
//! dynamics.

use crate::common;

use common::Robot;
use dynamics::{Data, Force, Motion, aba, forward_kinematics_acceleration, integrate};
use test_support::Random;
use whole_body::{MomentumObserver, MomentumObserverParameters};

const DT: f64 = 1e-4;

/// External torques `tau_ext` on the joints are found after a few time constants, to the lag.
#[test]
fn external_torques_are_found() {
    for seed in 0..6 {
        let robot = Robot::random(seed);
        let model = &robot.model;
        let n = model.joint_count();
        let mut random = Random::new(seed ^ 7);
        let mut data = Data::new(model);
        let mut q = dynamics::neutral(model);
        q[7..].iter_mut().for_each(|x| *x = random.symmetric());
        let mut v = vec![0.0; model.nv()];
        v.iter_mut().for_each(|x| *x = 0.3 * random.symmetric());
        let pushed = random.below(n);
        let mut observer = MomentumObserver::new(
            model,
            MomentumObserverParameters {
                sample_period: DT,
                gain: 200.0,
            },
        );
        for k in 0..1000 {
            // Torques that hold the joints together loosely, and a push from 20 ms on.
            let mut tau = vec![0.0; model.nv()];
            for j in 0..n {
                tau[6 + j] = -20.0 * q[7 + j] - 2.0 * v[6 + j];
            }
            let known = tau.clone();
            let push = if k > 200 { 3.0 } else { 0.0 };
            tau[6 + pushed] += push;
            let a = aba(model, &mut data, &q, &v, &tau, None).to_vec();
            forward_kinematics_acceleration(model, &mut data, &q, &v, &a);
            // Measurement of an IMU at the root: acceleration less gravity, and no linear velocity.
            let twist = data.velocities()[0];
            let rotation = data.placements()[0].rotation;
            let point = data.accelerations()[0].linear + twist.angular.cross(&twist.linear)
                - rotation.tr_mul(&model.gravity());
            let base = (
                Motion::new(nalgebra::Vector3::zeros(), twist.angular),
                Motion::new(point, data.accelerations()[0].angular),
            );
            let tau_ext = observer
                .update(&q[7..], &v[6..], &known[6..], base, None)
                .to_vec();
            for (j, r) in tau_ext.iter().enumerate() {
                let truth = if j == pushed { push } else { 0.0 };
                if !(200..=600).contains(&k) {
                    assert!(
                        (r - truth).abs() < 0.4,
                        "seed {seed}, joint {j}, step {k}: {r} of {truth}"
                    );
                }
            }
            for (v, a) in v.iter_mut().zip(&a) {
                *v += DT * a;
            }
            integrate(model, &mut q, &v, DT);
        }
    }
}

/// Wrenches that are known are not external.
#[test]
fn known_wrenches_are_not_external() {
    let robot = Robot::random(3);
    let model = &robot.model;
    let n = model.joint_count();
    let parameters = MomentumObserverParameters {
        sample_period: 1e-3,
        gain: 50.0,
    };
    let mut observer = MomentumObserver::new(model, parameters);
    let q = vec![0.3; n];
    let zero = vec![0.0; n];
    let base = (
        Motion::zero(),
        Motion::new(-model.gravity(), nalgebra::Vector3::zeros()),
    );
    let mut f = vec![Force::zero(); model.bodies().len()];
    let last = f.len() - 1;
    f[last] = Force::from_array([5.0, -4.0, 3.0, 1.0, 2.0, -1.0]);
    // The torques that hold the robot against weight and these wrenches.
    let mut full_q = dynamics::neutral(model);
    full_q[7..].copy_from_slice(&q);
    let still = vec![0.0; model.nv()];
    let tau = dynamics::rnea(
        model,
        &mut Data::new(model),
        &full_q,
        &still,
        &still,
        Some(&f),
    )[6..]
        .to_vec();
    for _ in 0..500 {
        observer.update(&q, &zero, &tau, base, Some(&f));
    }
    let r = observer.update(&q, &zero, &tau, base, Some(&f)).to_vec();
    assert!(r.iter().all(|r| r.abs() < 1e-9), "{r:?}");
    let mut blind = MomentumObserver::new(model, parameters);
    for _ in 0..500 {
        blind.update(&q, &zero, &tau, base, None);
    }
    let missed = blind
        .update(&q, &zero, &tau, base, None)
        .iter()
        .map(|r| r.abs())
        .fold(0.0, f64::max);
    assert!(missed > 0.5, "{missed}");
    // Numbers that are not finite change nothing.
    let before = observer.update(&q, &zero, &tau, base, Some(&f)).to_vec();
    let bad = vec![f64::NAN; n];
    assert_eq!(observer.update(&bad, &zero, &tau, base, Some(&f)), before);
}
