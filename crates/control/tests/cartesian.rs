//! Cartesian impedance against what defines it: damping ratios of the closed loop, bounds in joint space,
//! singular poses, no steps.

use control::{CartesianLaw, CartesianLimits, CartesianTarget, Limb, pose_error};
use dynamics::{
    Base, Data, Model, Random, ReferenceFrame, Se3, crba, forward_kinematics, frame_jacobian,
    frame_placement,
};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, Rotation3, Vector3, Vector6};

const LIMITS: CartesianLimits = CartesianLimits {
    wrench: [200.0, 20.0],
    rise_s: 0.3,
    stiffness: [5000.0, 200.0],
    velocity: [0.5, 2.0],
    k_f: 0.25,
};
const DT: f64 = 1e-3;

/// A robot's limb at a configuration.
struct Arm {
    mass: DMatrix<f64>,
    columns: Vec<Vector6<f64>>,
    pose: Se3,
    bounds: Vec<[f64; 2]>,
}

impl Arm {
    fn leg(q: &[f64]) -> Self {
        let urdf = test_support::read_project_file("robot-models/leg/robot.urdf").unwrap();
        let model = Model::from_urdf(&urdf, "leg", Base::Fixed).unwrap();
        let frame = model.frame_index("foot").unwrap();
        let mut data = Data::new(&model);
        let mass = crba(&model, &mut data, q).clone();
        forward_kinematics(&model, &mut data, q);
        let mut j = Matrix6xX::zeros(model.nv());
        let axes = ReferenceFrame::LocalWorldAligned;
        frame_jacobian(&model, &data, frame, axes, &mut j);
        Self {
            mass,
            columns: j.column_iter().map(|c| c.into_owned()).collect(),
            pose: frame_placement(&model, &data, frame),
            bounds: vec![[1e9, 1e9]; model.nv()],
        }
    }

    fn jacobian(&self) -> DMatrix<f64> {
        DMatrix::from_fn(6, self.columns.len(), |i, j| self.columns[j][i])
    }

    fn mobility(&self) -> Matrix6<f64> {
        let j = self.jacobian();
        let inverse = self.mass.clone().try_inverse().unwrap();
        let wide = &j * inverse * j.transpose();
        Matrix6::from_fn(|i, k| wide[(i, k)])
    }

    /// Torques of the law for velocities of the joints.
    fn torques(
        &self,
        law: &mut CartesianLaw,
        target: &CartesianTarget,
        dq: &[f64],
    ) -> DVector<f64> {
        let limb = Limb {
            pose: self.pose,
            jacobian: &self.columns,
            mobility: self.mobility(),
            dq,
            bounds: &self.bounds,
            force: None,
            late: 0.0,
        };
        let wrench = law.wrench(target, &limb, DT).sum();
        DVector::from_iterator(
            self.columns.len(),
            self.columns.iter().map(|c| c.dot(&wrench)),
        )
    }
}

const BENT: [f64; 6] = [0.1, -0.15, -0.5, 1.0, -0.4, 0.1];

fn target(pose: Se3, stiffness: [f64; 6], damping_ratio: f64) -> CartesianTarget {
    CartesianTarget {
        pose,
        velocity: Vector6::zeros(),
        stiffness: stiffness.into(),
        force: Vector6::zeros(),
        damping_ratio,
        feedback: [false; 6],
        axes: Matrix3::identity(),
    }
}

/// Columns of the map from velocities to torques.
fn damping_in_joint_space(arm: &Arm, target: &CartesianTarget) -> DMatrix<f64> {
    let n = arm.columns.len();
    let mut damping = DMatrix::zeros(n, n);
    for j in 0..n {
        let mut law = CartesianLaw::new(LIMITS);
        law.start(&arm.pose, None, target);
        let mut dq = vec![0.0; n];
        dq[j] = 1.0;
        damping.set_column(j, &-arm.torques(&mut law, target, &dq));
    }
    damping
}

/// `M q'' + J^T D J q' + J^T K J q = 0`: every mode has the damping ratio that was asked for.
#[test]
fn every_mode_has_the_damping_ratio() {
    let arm = Arm::leg(&BENT);
    for (stiffness, ratio) in [
        ([3000.0, 1500.0, 4000.0, 100.0, 150.0, 60.0], 0.7),
        ([1000.0, 1000.0, 1000.0, 40.0, 40.0, 40.0], 1.0),
        ([4000.0, 500.0, 2500.0, 20.0, 180.0, 90.0], 0.4),
    ] {
        let target = target(arm.pose, stiffness, ratio);
        let j = arm.jacobian();
        let springs =
            j.transpose() * DMatrix::from_diagonal(&DVector::from_row_slice(&stiffness)) * j;
        let damping = damping_in_joint_space(&arm, &target);
        let n = arm.columns.len();
        let inverse = arm.mass.clone().try_inverse().unwrap();
        let mut loop_ = DMatrix::zeros(2 * n, 2 * n);
        loop_.view_mut((0, n), (n, n)).fill_with_identity();
        loop_
            .view_mut((n, 0), (n, n))
            .copy_from(&-(&inverse * springs));
        loop_
            .view_mut((n, n), (n, n))
            .copy_from(&-(&inverse * damping));
        for pole in loop_.complex_eigenvalues().iter() {
            let found = -pole.re / pole.norm();
            if ratio < 1.0 {
                assert!(
                    (found - ratio).abs() < 0.03,
                    "{pole}: {found:.3} of {ratio}"
                );
            } else {
                assert!(found > 0.9, "{pole}: {found:.3} of {ratio}");
            }
        }
    }
}

/// Whatever is asked for, springs and dampers in joint space stay below what the joints may have.
#[test]
fn joints_are_not_stiffer_than_they_may_be() {
    let mut random = Random::new(5);
    for _ in 0..200 {
        let q = random.vector(6, 1.0);
        let mut arm = Arm::leg(&q);
        let gains = random.vector(6, 1.0);
        arm.bounds = gains
            .iter()
            .map(|x| {
                let k_s = 200.0 + 150.0 * x;
                [k_s, 0.01 * k_s]
            })
            .collect();
        let stiffness = [5000.0, 5000.0, 5000.0, 200.0, 200.0, 200.0];
        let target = target(arm.pose, stiffness, 1.0);
        let damping = damping_in_joint_space(&arm, &target);
        let scale = DVector::from_iterator(6, arm.bounds.iter().map(|b| b[1].sqrt().recip()));
        let scaled = DMatrix::from_diagonal(&scale) * damping * DMatrix::from_diagonal(&scale);
        let most = scaled.clone().symmetric_eigenvalues().max();
        assert!(most < 1.0 + 1e-9, "{most}");
        assert!(scaled.symmetric_eigenvalues().min() > -1e-9);
    }
}

/// Stretched out, and with nothing to lever: numbers, and bounded ones.
#[test]
fn singular_poses_are_harmless() {
    for q in [[0.0; 6], [0.0, 0.0, 0.3, 0.0, 0.0, 0.0]] {
        let mut arm = Arm::leg(&q);
        arm.bounds = vec![[3000.0, 30.0]; 6];
        let mut away = target(arm.pose, [5000.0, 5000.0, 5000.0, 200.0, 200.0, 200.0], 1.0);
        away.pose.translation += Vector3::new(0.0, 0.0, -0.3);
        away.pose.rotation =
            Rotation3::from_euler_angles(3.1, 0.2, -2.0).into_inner() * away.pose.rotation;
        let mut law = CartesianLaw::new(LIMITS);
        law.start(&arm.pose, None, &away);
        let (mut most, mut last) = (0.0f64, DVector::zeros(6));
        for _ in 0..3000 {
            let torques = arm.torques(&mut law, &away, &[0.0; 6]);
            assert!(torques.iter().all(|x| x.is_finite()));
            most = most.max((&torques - &last).amax());
            last = torques;
        }
        // The wrench rises within 0.3 s: levers of less than a metre.
        let rise = (LIMITS.wrench[0] + LIMITS.wrench[1]) * DT / LIMITS.rise_s;
        assert!(most < 1.2 * rise, "{most} N·m in a cycle");
        assert!(last.amax() < LIMITS.wrench[0] + LIMITS.wrench[1]);
    }
}

/// The error leads from the pose to the desired one, and vanishes at half a turn instead of jumping.
#[test]
fn the_error_of_an_orientation_does_not_jump() {
    let mut random = Random::new(2);
    for _ in 0..200 {
        let [x, y, z] = random.vector(3, 0.8)[..] else {
            unreachable!()
        };
        let start = Rotation3::from_euler_angles(x, z, y);
        let turn = Vector3::new(x, y, z);
        let end = Rotation3::from_scaled_axis(turn) * start;
        let pose = |r: Rotation3<f64>| Se3::new(r.into_inner(), Vector3::zeros());
        let error = pose_error(&pose(end), &pose(start));
        let error: Vector3<f64> = error.fixed_rows::<3>(3).into_owned();
        assert!((error - turn).norm() < 1e-9);
    }
    let axis = Vector3::new(0.6, 0.0, 0.8);
    let at = |angle: f64| {
        let turned = Rotation3::from_scaled_axis(axis * angle);
        let error = pose_error(
            &Se3::new(turned.into_inner(), Vector3::zeros()),
            &Se3::identity(),
        );
        error.fixed_rows::<3>(3).dot(&axis)
    };
    let mut last = at(0.0);
    for k in 1..8000 {
        let now = at(f64::from(k) * 1e-3);
        assert!((now - last).abs() < 2e-3, "{k}: {last} to {now}");
        last = now;
    }
}

/// A force on which the mode begins is taken over, and led to the one asked for.
#[test]
fn a_force_is_led() {
    let arm = Arm::leg(&BENT);
    let mut wanted = target(arm.pose, [0.0; 6], 1.0);
    wanted.force[2] = 100.0;
    let mut law = CartesianLaw::new(LIMITS);
    let bears = Vector6::new(0.0, 0.0, 40.0, 0.0, 0.0, 0.0);
    law.start(&arm.pose, Some(bears), &wanted);
    assert_eq!(law.led_force(), bears);
    let first = arm.torques(&mut law, &wanted, &[0.0; 6]);
    let expected = arm.jacobian().transpose() * DVector::from_column_slice((-bears).as_slice());
    let step = LIMITS.wrench[0] * DT / LIMITS.rise_s;
    assert!((first - expected).amax() < step);
    for _ in 0..400 {
        arm.torques(&mut law, &wanted, &[0.0; 6]);
    }
    assert!((law.led_force() - wanted.force).norm() < 1e-9);
}
