//! The truth record against `dynamics`, whose code the plant does not share.

use crate::common::{can_robot, parameters, robot};
use dynamics::{Data, Force, Model};
use nalgebra::Vector3;
use plant::Truth;
use plant::parameters::PushParameters;

/// `M(q) a + h(q, v) - sum J^T f`, in the model's order.
fn inverse_dynamics(model: &Model, data: &mut Data, truth: &Truth, names: &[String]) -> Vec<f64> {
    let (nb, nqb) = model.base_size();
    let (nb, nqb) = (nb.min(nqb), nb.max(nqb));
    let (mut q, mut v, mut a) = (
        vec![0.0; model.nq()],
        vec![0.0; model.nv()],
        vec![0.0; model.nv()],
    );
    if nb > 0 {
        q[..3].copy_from_slice(&truth.base_position);
        q[3..7].copy_from_slice(&truth.base_orientation);
        v[..6].copy_from_slice(&truth.base_velocity);
        a[..6].copy_from_slice(&truth.base_acceleration);
    }
    for (joint, name) in truth.joints.iter().zip(names) {
        let i = model.joint_index(name).unwrap();
        (q[nqb + i], v[nb + i], a[nb + i]) = (joint.q, joint.dq, joint.ddq);
    }
    let mut external = vec![Force::zero(); model.bodies().len()];
    for e in &truth.external {
        let frame = &model.frames()[model.frame_index(&e.link).unwrap()];
        let wrench = Force::new(
            Vector3::from(e.wrench.force),
            Vector3::from(e.wrench.torque),
        );
        external[frame.body] += frame.placement.act_force(wrench);
    }
    dynamics::rnea(model, data, &q, &v, &a, Some(&external)).to_vec()
}

#[test]
fn torques_accelerations_and_external_wrenches_are_consistent() {
    let robot = robot("humanoid");
    let mut sim = parameters("humanoid");
    sim.inertia_error = 0.0;
    sim.pushes.push(PushParameters {
        link: "head_pitch_link".into(),
        start: 0.05,
        duration: 0.2,
        force: [30.0, 50.0, -20.0],
        torque: [1.0, 2.0, 3.0],
    });
    let mut simulated = can_robot("humanoid", &sim).unwrap().robot().clone();
    let names: Vec<String> = robot
        .parameters
        .joints
        .iter()
        .map(|j| j.name.clone())
        .collect();
    let mut data = Data::new(&robot.model);
    let mut fastest = 0.0_f64;
    for k in 0..300 {
        for joint in 0..30 {
            let step = if (joint + k) % 3 == 0 { 2e-4 } else { -1e-4 };
            simulated.command(joint, simulated.set_point(joint) + step);
        }
        simulated.advance();
        let truth = simulated.truth();
        let tau = inverse_dynamics(&robot.model, &mut data, truth, &names);
        for missing in &tau[..6] {
            assert!(missing.abs() < 1e-6, "{missing} on the base");
        }
        for (joint, name) in truth.joints.iter().zip(&names) {
            let i = robot.model.joint_index(name).unwrap();
            let off = tau[6 + i] - joint.tau;
            assert!(off.abs() < 1e-7, "{name}: off by {off} of {}", joint.tau);
            fastest = fastest.max(joint.dq.abs());
        }
    }
    assert!(fastest > 0.05, "nothing moved");
}

#[test]
fn at_rest_an_ankle_sensor_carries_the_foot() {
    let mut sim = parameters("leg");
    sim.inertia_error = 0.0;
    let can = can_robot("leg", &sim).unwrap();
    let model = robot("leg").model;
    let foot = model.frames()[model.frame_index("foot").unwrap()]
        .inertia
        .mass;
    let force = can.truth().ft[0].force;
    let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    assert!((size - foot * 9.81).abs() < 0.02, "{size}");
    // The foot pulls the shank down; hips, knees and ankles of the start cancel.
    assert!((force[2] + foot * 9.81).abs() < 0.02, "{force:?}");
}

#[test]
fn the_inertia_error_is_real_and_bounded() {
    let mass = |error: f64| {
        let mut sim = parameters("humanoid");
        sim.inertia_error = error;
        can_robot("humanoid", &sim).unwrap().robot().mass()
    };
    let (exact, off) = (mass(0.0), mass(0.05));
    assert!((exact - robot("humanoid").model.total_mass()).abs() < 1e-9);
    let relative = (off / exact - 1.0).abs();
    assert!(relative > 1e-4 && relative < 0.05, "{relative}");
}
