//! D12 against its own terms: `M a + h - J^T f` from CRBA, nle and frame Jacobians.

use control::InverseDynamics;
use dynamics::{
    Base, Data, Model, Motion, Random, ReferenceFrame, crba, forward_kinematics, frame_jacobian,
    nle,
};
use nalgebra::{DMatrix, DVector, Matrix6xX, Vector3, Vector6};
use robot_state::Wrench;
use test_support::read_project_file;

fn robot(name: &str, base: Base) -> Model {
    let file = format!("robot-models/{name}/robot.urdf");
    let text = read_project_file(&file).expect("the robot's URDF is part of the project");
    Model::from_urdf(&text, &file, base).expect("valid")
}

fn compare(model: &Model, frame_names: &[&str]) {
    let frames: Vec<usize> = frame_names
        .iter()
        .map(|name| model.frame_index(name).expect("frame of the robot"))
        .collect();
    let mut data = Data::new(model);
    let mut inverse_dynamics = InverseDynamics::new(model, &frames);
    let mut random = Random::new(7);
    let (bv, bq) = model.base_size();
    for _ in 0..20 {
        let q = random.configuration(model);
        let v: Vec<f64> = (0..model.nv()).map(|_| random.uniform(-2.0, 2.0)).collect();
        let a: Vec<f64> = (0..model.nv()).map(|_| random.uniform(-5.0, 5.0)).collect();
        let wrenches: Vec<Wrench> = frames
            .iter()
            .map(|_| Wrench {
                force: std::array::from_fn(|_| random.uniform(-200.0, 200.0)),
                torque: std::array::from_fn(|_| random.uniform(-20.0, 20.0)),
            })
            .collect();

        crba(model, &mut data, &q);
        let mass_matrix: DMatrix<f64> = data.mass_matrix().clone();
        let h = DVector::from_column_slice(nle(model, &mut data, &q, &v));
        let mut expected = mass_matrix * DVector::from_column_slice(&a) + h;
        for (&frame, wrench) in frames.iter().zip(&wrenches) {
            let mut jacobian = Matrix6xX::zeros(model.nv());
            forward_kinematics(model, &mut data, &q);
            frame_jacobian(model, &data, frame, ReferenceFrame::Local, &mut jacobian);
            let [f, n] = [Vector3::from(wrench.force), Vector3::from(wrench.torque)];
            let wrench = Vector6::new(f.x, f.y, f.z, n.x, n.y, n.z);
            expected -= jacobian.transpose() * wrench;
        }

        // Reading of an IMU in the base: acceleration minus gravity, in base axes.
        let base = if model.base() == Base::Floating {
            let pose = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
                q[6], q[3], q[4], q[5],
            ));
            let up = pose.inverse() * -model.gravity();
            let twist = Motion::from_array(std::array::from_fn(|i| v[i]));
            let proper = Motion::from_array(std::array::from_fn(|i| a[i]));
            (twist, proper + Motion::new(up, Vector3::zeros()))
        } else {
            (Motion::zero(), Motion::zero())
        };
        inverse_dynamics.set_motion(base, &q[bq..], &v[bv..], &a[bv..]);
        let tau = inverse_dynamics.torque(&wrenches);
        for (tau, expected) in tau.iter().zip(expected.iter().skip(bv)) {
            assert!(
                (tau - expected).abs() < 1e-10 * (1.0 + expected.abs()),
                "{tau} {expected}"
            );
        }
    }
}

#[test]
fn equals_mass_matrix_bias_and_contact_terms_on_a_fixed_base() {
    compare(&robot("leg", Base::Fixed), &["ankle_ft"]);
}

#[test]
fn equals_mass_matrix_bias_and_contact_terms_on_a_floating_base() {
    let feet_and_hands = [
        "left_ankle_ft",
        "right_ankle_ft",
        "left_wrist_ft",
        "right_wrist_ft",
    ];
    compare(&robot("humanoid", Base::Floating), &feet_and_hands);
}
