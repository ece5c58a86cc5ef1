//! What the ground carries, against the robot's own dynamics: with these wrenches the base needs no other force.

use control::Support;
use dynamics::{Base, Data, Model, Motion, Se3, forward_kinematics, frame_placement, rnea};
use nalgebra::{Vector3, Vector6};
use robot_state::{MAX_FT_SENSORS, Wrench};
use test_support::read_project_file;

const DT: f64 = 1e-3;

struct Standing {
    model: Model,
    feet: Vec<usize>,
    support: Support,
    q: Vec<f64>,
}

impl Standing {
    /// The humanoid with slightly bent legs, its feet parallel.
    fn new() -> Self {
        let file = "robot-models/humanoid/robot.urdf";
        let text = read_project_file(file).expect("the robot's URDF is part of the project");
        let model = Model::from_urdf(&text, file, Base::Floating).expect("valid");
        let feet = ["left_foot", "right_foot"].map(|name| model.frame_index(name).unwrap());
        let mut q = vec![0.0; model.joint_count()];
        for side in ["left", "right"] {
            for (joint, angle) in [("hip_pitch", -0.3), ("knee", 0.6), ("ankle_pitch", -0.3)] {
                q[model.joint_index(&format!("{side}_{joint}")).unwrap()] = angle;
            }
        }
        Self {
            support: Support::new(&model, &feet),
            feet: feet.to_vec(),
            model,
            q,
        }
    }

    /// `loads` on the feet are measured for some seconds, up along the base's z axis turned by `tilt` about x.
    fn measure(&mut self, loads: [f64; 2], tilt: f64, seconds: f64) {
        let proper = Vector3::new(0.0, tilt.sin(), tilt.cos()) * 9.81;
        let mut contact = [Wrench::default(); MAX_FT_SENSORS];
        for (wrench, load) in contact.iter_mut().zip(loads) {
            wrench.force[2] = load;
        }
        for _ in 0..(seconds / DT) as usize {
            self.support.observe(&proper, &self.q, &contact, DT);
        }
    }

    fn place(&self, foot: usize) -> Se3 {
        let mut data = Data::new(&self.model);
        let mut q = vec![0.0; self.model.nq()];
        q[6] = 1.0;
        let first = self.model.base_size().1;
        q[first..].copy_from_slice(&self.q);
        forward_kinematics(&self.model, &mut data, &q);
        frame_placement(&self.model, &data, self.feet[foot])
    }

    /// Sum of the wrenches, on the base.
    fn sum(&self, wrenches: &[Wrench]) -> Vector6<f64> {
        let feet = self.feet.iter().zip(wrenches).enumerate();
        feet.fold(Vector6::zeros(), |sum, (foot, (_, wrench))| {
            let own = dynamics::Force::new(wrench.force.into(), wrench.torque.into());
            sum + self.place(foot).act_force(own).to_vector()
        })
    }

    /// What the base lacks of force when it moves with `base` (proper) and the joints with `ddq`.
    fn lacking(&self, wrenches: &[Wrench], base: Motion, ddq: &[f64]) -> f64 {
        let mut model = self.model.clone();
        model.set_gravity(Vector3::zeros());
        let mut q = vec![0.0; model.nq()];
        q[6] = 1.0;
        let (bv, bq) = model.base_size();
        q[bq..].copy_from_slice(&self.q);
        let mut a = base.to_array().to_vec();
        a.extend_from_slice(ddq);
        let v = vec![0.0; model.nv()];
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a, None);
        (Vector6::from_column_slice(&tau[..bv]) - self.sum(wrenches)).norm()
    }
}

/// The base's acceleration with which neither foot moves.
fn still_feet(standing: &Standing, ddq: &[f64]) -> Motion {
    let mut data = Data::new(&standing.model);
    let mut q = vec![0.0; standing.model.nq()];
    q[6] = 1.0;
    let (bv, bq) = standing.model.base_size();
    q[bq..].copy_from_slice(&standing.q);
    let mut a = vec![0.0; standing.model.nv()];
    a[bv..].copy_from_slice(ddq);
    let v = vec![0.0; standing.model.nv()];
    dynamics::forward_kinematics_acceleration(&standing.model, &mut data, &q, &v, &a);
    let acceleration = |&foot: &usize| {
        let body = standing.model.frames()[foot].body;
        data.placements()[body].act_motion(data.accelerations()[body])
    };
    let [left, right] = [0, 1].map(|foot| acceleration(&standing.feet[foot]));
    Motion::new(
        (left.linear + right.linear) * -0.5,
        (left.angular + right.angular) * -0.5,
    )
}

#[test]
fn the_wrenches_carry_the_robot_and_its_motion() {
    let mut standing = Standing::new();
    let weight = 9.80665 * standing.model.total_mass();
    assert!(
        standing
            .support
            .wrenches(&standing.q, &[])
            .iter()
            .all(|w| w.force == [0.0; 3])
    );
    standing.measure([0.5 * weight; 2], 0.0, 1.0);
    let mut ddq = vec![0.0; standing.model.joint_count()];
    for scale in [0.0, 1.0, -2.0] {
        for side in ["left", "right"] {
            for (joint, share) in [("hip_pitch", 1.0), ("knee", -2.0), ("ankle_pitch", 1.0)] {
                let name = format!("{side}_{joint}");
                ddq[standing.model.joint_index(&name).unwrap()] = scale * share;
            }
        }
        let wrenches = *standing.support.wrenches(&standing.q, &ddq);
        let mut base = still_feet(&standing, &ddq);
        base.linear.z += standing.model.gravity().norm();
        let lacking = standing.lacking(&wrenches, base, &ddq);
        assert!(lacking < 1e-6 * weight, "{scale}: {lacking}");
        let vertical = wrenches[0].force[2] + wrenches[1].force[2];
        assert_eq!(scale == 0.0, (vertical - weight).abs() < 0.01 * weight);
    }
}

#[test]
fn a_foot_that_is_lifted_gives_its_share_back() {
    let mut standing = Standing::new();
    let weight = 9.80665 * standing.model.total_mass();
    standing.measure([0.5 * weight; 2], 0.0, 1.0);
    let ddq = vec![0.0; standing.model.joint_count()];
    let mut before = standing.support.wrenches(&standing.q, &ddq)[1].force[2];
    assert!((before - 0.5 * weight).abs() < 0.02 * weight);
    for _ in 0..310 {
        standing.measure([weight, 0.0], 0.0, DT);
        let wrenches = *standing.support.wrenches(&standing.q, &ddq);
        let now = wrenches[1].force[2];
        assert!((now - before).abs() < 0.05 * weight, "{now} after {before}");
        before = now;
    }
    assert_eq!(before, 0.0);
    assert!(!standing.support.bears(1));
    standing.measure([0.0, 0.0], 0.0, 0.4);
    assert_eq!(
        *standing.support.wrenches(&standing.q, &ddq),
        [Wrench::default(); MAX_FT_SENSORS]
    );
}

/// A body that leans for a moment does not turn what is up for feet that stand; one that stays so does.
#[test]
fn up_stays_with_the_feet() {
    let mut standing = Standing::new();
    let weight = 9.80665 * standing.model.total_mass();
    let ddq = vec![0.0; standing.model.joint_count()];
    standing.measure([0.5 * weight; 2], 0.0, 12.0);
    let sideways = |standing: &mut Standing| {
        let wrenches = *standing.support.wrenches(&standing.q, &ddq);
        (wrenches[0].force[1] + wrenches[1].force[1]) / weight
    };
    standing.measure([0.5 * weight; 2], 0.1, 0.2);
    assert!(sideways(&mut standing).abs() < 0.003);
    standing.measure([0.5 * weight; 2], 0.1, 60.0);
    assert!((sideways(&mut standing) - 0.1).abs() < 0.01);
}

/// What is no number changes nothing, and gives nothing that is none.
#[test]
fn what_is_no_number_is_not_taken() {
    let mut standing = Standing::new();
    let weight = 9.80665 * standing.model.total_mass();
    standing.measure([0.5 * weight; 2], 0.0, 1.0);
    let ddq = vec![0.0; standing.model.joint_count()];
    let before = *standing.support.wrenches(&standing.q, &ddq);
    standing.measure([f64::NAN; 2], f64::NAN, 0.1);
    standing.measure([f64::NAN; 2], 0.0, 0.1);
    let q = standing.q.clone();
    let after = *standing.support.wrenches(&q, &ddq);
    assert!((before[0].force[2] - after[0].force[2]).abs() < 1e-6 * weight);
    let none = standing.support.wrenches(&q, &vec![f64::NAN; q.len()]);
    assert_eq!(*none, [Wrench::default(); MAX_FT_SENSORS]);
}
