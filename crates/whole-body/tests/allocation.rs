//! No update allocates, under any kind of contact and weights.

#[allow(dead_code)] // each test uses a part of it
mod common;

use common::{Robot, Scene};
use test_support::allocations;
use whole_body::{
    DelayCompensator, DelayCompensatorParameters, DelayedTorque, Weighting, WholeBody,
    WholeBodyParameters,
};

#[test]
fn nothing_allocates() {
    for seed in 0..30 {
        let robot = Robot::random(seed);
        let scene = Scene::random(&robot, seed);
        for weighting in [Weighting::Unit, Weighting::Expected] {
            let mut parameters = WholeBodyParameters {
                weighting,
                ..robot.parameters()
            };
            let mut second = parameters.hypotheses[0].clone();
            second.name = "the same".into();
            parameters.hypotheses.push(second);
            let mut whole_body = WholeBody::new(&robot.model, &parameters).unwrap();
            let before = allocations();
            assert!(whole_body.update(&scene.input()).valid);
            whole_body.blend(&[0.3, 0.7]);
            assert!(whole_body.update(&scene.input()).valid);
            let _ = whole_body.net_at_sensor(0);
            let mut broken = scene.input();
            broken.q = &[];
            assert!(!whole_body.update(&broken).valid);
            assert_eq!(allocations() - before, 0, "allocations");
        }
    }
    let mut compensator = DelayCompensator::new(DelayCompensatorParameters {
        sample_period: 1e-3,
        kernel: vec![0.1; 10],
        fast_sigma: 0.1,
        torque_limit: 100.0,
        stands_within: 0.0087,
        gain: 1.0,
        error_per_angle: 600.0,
    });
    let before = allocations();
    for k in 0..100 {
        let delayed = DelayedTorque {
            tau: f64::from(k),
            sigma: 0.1,
        };
        compensator.update((k % 20 < 10).then_some(1.0), (k % 7 > 0).then_some(delayed));
    }
    assert_eq!(allocations() - before, 0, "allocations");
}
