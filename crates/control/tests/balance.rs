//! Balance, against constrained dynamics that are solved densely: a robot whose feet are fixed to the ground is
//! accelerated by the torques, with nothing of the balance's own equations.

use control::{Balance, BalanceInput, Balanced, MAX_FEET, Sole};
use dynamics::{
    Base, Data, Model, ReferenceFrame, center_of_mass, crba, forward_kinematics,
    forward_kinematics_acceleration, frame_acceleration, frame_jacobian, frame_placement,
    integrate, nle,
};
use nalgebra::{DMatrix, DVector, Matrix6xX, Vector3, Vector6};
use test_support::read_project_file;

const DT: f64 = 2e-3;

fn sole() -> Sole {
    let corners = [[0.14, 0.07], [0.14, -0.07], [-0.1, 0.07], [-0.1, -0.07]];
    Sole::new(&corners.map(|[x, y]| [x, y, -0.055])).unwrap()
}

/// The humanoid on two feet that cannot leave the ground.
struct World {
    model: Model,
    data: Data,
    feet: Vec<usize>,
    q: Vec<f64>,
    v: Vec<f64>,
}

impl World {
    fn new() -> Self {
        let file = "robot-models/humanoid/robot.urdf";
        let text = read_project_file(file).expect("the robot's URDF is part of the project");
        let model = Model::from_urdf(&text, file, Base::Floating).expect("valid");
        let feet = ["left_foot", "right_foot"].map(|name| model.frame_index(name).unwrap());
        let mut q = vec![0.0; model.nq()];
        q[6] = 1.0;
        for side in ["left", "right"] {
            for (joint, angle) in [("hip_pitch", -0.35), ("knee", 0.7), ("ankle_pitch", -0.35)] {
                q[7 + model.joint_index(&format!("{side}_{joint}")).unwrap()] = angle;
            }
        }
        Self {
            data: Data::new(&model),
            feet: feet.to_vec(),
            v: vec![0.0; model.nv()],
            model,
            q,
        }
    }

    fn joint(&self, name: &str) -> usize {
        self.model.joint_index(name).unwrap()
    }

    /// The joints move at these rates, and the base so that the left foot stands.
    fn set_rates(&mut self, rates: &[(&str, f64)]) {
        for (name, rate) in rates {
            let joint = self.joint(name);
            self.v[6 + joint] = *rate;
        }
        forward_kinematics(&self.model, &mut self.data, &self.q);
        let jacobian = self.jacobian(0);
        let moves = &jacobian * DVector::from_column_slice(&self.v);
        let base = jacobian.fixed_columns::<6>(0).into_owned();
        let rest = base.try_inverse().unwrap() * moves;
        for (v, rest) in self.v.iter_mut().zip(rest.iter()) {
            *v -= rest;
        }
    }

    fn jacobian(&self, foot: usize) -> Matrix6xX<f64> {
        let mut jacobian = Matrix6xX::zeros(self.model.nv());
        let world = ReferenceFrame::World;
        frame_jacobian(
            &self.model,
            &self.data,
            self.feet[foot],
            world,
            &mut jacobian,
        );
        jacobian
    }

    /// Accelerations under these torques, and the wrench of the ground in all, about the world's origin.
    fn accelerations(&mut self, torque: &[f64]) -> (DVector<f64>, Vector6<f64>) {
        let nv = self.model.nv();
        let zeros = vec![0.0; nv];
        forward_kinematics_acceleration(&self.model, &mut self.data, &self.q, &self.v, &zeros);
        let rows = 6 * self.feet.len();
        let mut whole = DMatrix::zeros(nv + rows, nv + rows);
        let mut right = DVector::zeros(nv + rows);
        for foot in 0..self.feet.len() {
            let jacobian = self.jacobian(foot);
            let at = nv + 6 * foot;
            whole.view_mut((at, 0), (6, nv)).copy_from(&jacobian);
            whole
                .view_mut((0, at), (nv, 6))
                .copy_from(&-jacobian.transpose());
            let world = ReferenceFrame::World;
            let bias = frame_acceleration(&self.model, &self.data, self.feet[foot], world);
            right.rows_mut(at, 6).copy_from(&-bias.to_vector());
        }
        let m = crba(&self.model, &mut self.data, &self.q).clone();
        whole.view_mut((0, 0), (nv, nv)).copy_from(&m);
        let h = nle(&self.model, &mut self.data, &self.q, &self.v);
        for (k, h) in h.iter().enumerate() {
            right[k] = -h + if k < 6 { 0.0 } else { torque[k - 6] };
        }
        let solution = whole.lu().solve(&right).expect("feet hold the robot");
        let total =
            (0..self.feet.len()).map(|foot| solution.fixed_rows::<6>(nv + 6 * foot).into_owned());
        (solution.rows(0, nv).into_owned(), total.sum())
    }

    fn center(&mut self) -> Vector3<f64> {
        forward_kinematics(&self.model, &mut self.data, &self.q);
        center_of_mass(&self.model, &self.data)
    }

    /// Middle of the soles, and up in each sensor's axes.
    fn ground(&mut self) -> (Vector3<f64>, [Option<Vector3<f64>>; MAX_FEET]) {
        forward_kinematics(&self.model, &mut self.data, &self.q);
        let mut up = [None; MAX_FEET];
        let mut middle = Vector3::zeros();
        for (up, foot) in up.iter_mut().zip(&self.feet) {
            let at = frame_placement(&self.model, &self.data, *foot);
            *up = Some(at.rotation.tr_mul(&Vector3::z()));
            middle += at.act_point(sole().origin()) / self.feet.len() as f64;
        }
        (middle, up)
    }

    fn step(&mut self, a: &DVector<f64>) {
        for (v, a) in self.v.iter_mut().zip(a.iter()) {
            *v += DT * a;
        }
        integrate(&self.model, &mut self.q, &self.v, DT);
    }
}

fn balance(world: &World) -> Balance {
    let feet: Vec<(usize, Sole)> = world.feet.iter().map(|foot| (*foot, sole())).collect();
    Balance::new(&world.model, &feet, None).unwrap()
}

/// Torques of a cycle in which the pose `q_d` (of all) is desired.
fn torques(
    world: &mut World,
    balance: &mut Balance,
    q_d: &[f64],
    offset: [f64; 2],
) -> (Vec<f64>, Balanced) {
    let (_, up) = world.ground();
    let still = vec![0.0; world.model.joint_count()];
    let (q, dq) = (world.q[7..].to_vec(), world.v[6..].to_vec());
    // Joints besides have no springs here: their reference holds them.
    let mut ddq_d = still.clone();
    for (j, ddq_d) in ddq_d
        .iter_mut()
        .enumerate()
        .filter(|(j, _)| !balance.carries(*j))
    {
        *ddq_d = 100.0 * (q_d[7 + j] - q[j]) - 20.0 * dq[j];
    }
    let input = BalanceInput {
        q: &q,
        dq: &dq,
        desired: [&q_d[7..], &still, &ddq_d],
        up,
        bears: [1.0; MAX_FEET],
        lifts: [false; MAX_FEET],
        offset,
        gyro: None,
        dt: DT,
    };
    let (torque, balanced) = balance.update(&input).unwrap();
    (torque.to_vec(), balanced)
}

#[test]
fn the_ground_applies_the_wrench_that_was_counted_on() {
    let mut world = World::new();
    let mut balance = balance(&world);
    let q_d = world.q.clone();
    world.set_rates(&[
        ("left_ankle_pitch", 0.05),
        ("right_ankle_pitch", 0.05),
        ("chest_pitch", 0.1),
    ]);
    let (torque, balanced) = torques(&mut world, &mut balance, &q_d, [0.0; 2]);
    assert!(balanced.solved && balanced.depth > 0.0, "{balanced:?}");
    let (_, total) = world.accelerations(&torque);
    let counted = (0..2).map(|foot| {
        let own = balance.wrench(foot);
        let at = frame_placement(&world.model, &world.data, world.feet[foot]);
        let force = dynamics::Force::new(own.force.into(), own.torque.into());
        at.act_force(force).to_vector()
    });
    let counted: Vector6<f64> = counted.sum();
    assert!((counted - total).amax() < 0.5, "{counted} {total}");
    assert!(total[2] > 400.0, "it weighs something: {total}");
}

/// Lets the robot stand for a time: the largest distance of the centre of mass from the middle on the way, the last one,
/// and the greatest rate in the end.
fn stand(world: &mut World, offset: [f64; 2], seconds: f64) -> (f64, Vector3<f64>, f64) {
    let mut balance = balance(world);
    let q_d = world.q.clone();
    let mut farthest = 0.0;
    for _ in 0..(seconds / DT) as usize {
        let (torque, balanced) = torques(world, &mut balance, &q_d, offset);
        assert!(balanced.solved);
        let (a, _) = world.accelerations(&torque);
        world.step(&a);
        let (middle, _) = world.ground();
        farthest = f64::max(farthest, (world.center() - middle).xy().norm());
    }
    let (middle, _) = world.ground();
    let fastest = world.v.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    (farthest, world.center() - middle, fastest)
}

#[test]
fn a_pushed_robot_comes_back_over_the_middle_of_its_soles() {
    for rate in [-0.25, 0.25] {
        let mut world = World::new();
        // As after 36 N for 0.3 s at 57 kg, backwards and forwards.
        world.set_rates(&[("left_ankle_pitch", rate), ("right_ankle_pitch", rate)]);
        let (farthest, at, fastest) = stand(&mut world, [0.0; 2], 3.0);
        assert!(farthest > 0.02, "it was pushed: {farthest}");
        assert!(at.xy().norm() < 2e-3 && fastest < 0.03, "{at} {fastest}");
        let tilt = 2.0 * world.q[3].hypot(world.q[4]).asin();
        assert!(tilt < 0.02, "{tilt}");
    }
}

#[test]
fn the_centre_of_mass_goes_where_it_is_asked_for() {
    let mut world = World::new();
    let (_, at, fastest) = stand(&mut world, [0.03, -0.04], 4.0);
    let off = at - Vector3::new(0.03, -0.04, at.z);
    assert!(off.norm() < 3e-3 && fastest < 0.02, "{at} {fastest}");
}

#[test]
fn the_capture_point_shows_what_soles_cannot_hold() {
    let mut world = World::new();
    let mut balance = balance(&world);
    let q_d = world.q.clone();
    world.set_rates(&[("left_ankle_pitch", -1.5), ("right_ankle_pitch", -1.5)]);
    let (_, balanced) = torques(&mut world, &mut balance, &q_d, [0.0; 2]);
    assert!(balanced.depth < -0.05, "{balanced:?}");
}

#[test]
fn what_cannot_balance_is_no_balance() {
    let world = World::new();
    assert!(Balance::new(&world.model, &[], None).is_none());
    let file = "robot-models/leg/robot.urdf";
    let text = read_project_file(file).unwrap();
    let model = Model::from_urdf(&text, file, Base::Fixed).unwrap();
    assert!(Balance::new(&model, &[(0, sole())], None).is_none());
    // On no foot there are no torques; on one foot the other bears nothing.
    let mut balance = balance(&world);
    let n = world.model.joint_count();
    let (q, still) = (world.q[7..].to_vec(), vec![0.0; n]);
    let mut input = BalanceInput {
        q: &q,
        dq: &still,
        desired: [&q, &still, &still],
        up: [None; MAX_FEET],
        bears: [1.0; MAX_FEET],
        lifts: [false; MAX_FEET],
        offset: [0.0; 2],
        gyro: None,
        dt: DT,
    };
    assert!(balance.update(&input).is_none());
    input.up[1] = Some(Vector3::z());
    assert!(balance.update(&input).is_some());
    assert_eq!(balance.wrench(0).force, [0.0; 3]);
    assert!(
        balance.carries(world.joint("right_knee")) && !balance.carries(world.joint("left_knee"))
    );
}
