//! Contact wrenches that carry a standing robot's weight, in place of a whole-body planner's.

use dynamics::{Base, Data, Model, Motion, forward_kinematics};
use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};
use robot_state::Wrench;

/// Reasonable distance of the centre of pressure from a sole's centre, m: a moment costs as much
/// as a force divided by it.
const SOLE_REACH: f64 = 0.05;

/// The stance of a robot on some of its F/T sensors' end-effectors.
#[derive(Debug)]
pub(super) struct Stance {
    model: Model,
    data: Data,
    /// (place among the F/T sensors, frame) of each foot on the ground.
    feet: Vec<(usize, usize)>,
    q: Vec<f64>,
}

impl Stance {
    /// A stance on `feet`: places among the F/T sensors, with their frames.
    #[must_use]
    pub(super) fn new(model: &Model, feet: Vec<(usize, usize)>) -> Self {
        let mut q = vec![0.0; model.nq()];
        if model.base() == Base::Floating {
            q[6] = 1.0;
        }
        Self {
            data: Data::new(model),
            model: model.clone(),
            feet,
            q,
        }
    }

    /// Wrenches of least norm on the feet that hold the robot still at the joint angles `q_joints`
    /// (model order, rad), the soles being level. Sensors without ground contact get none.
    pub(super) fn wrenches(&mut self, q_joints: &[f64], contact: &mut [Wrench]) {
        contact.fill(Wrench::default());
        let first = self.q.len() - q_joints.len();
        self.q[first..].copy_from_slice(q_joints);
        forward_kinematics(&self.model, &mut self.data, &self.q);
        let frames: Vec<_> = self
            .feet
            .iter()
            .map(|&(sensor, frame)| {
                let frame = &self.model.frames()[frame];
                (
                    sensor,
                    self.data.placements()[frame.body].compose(&frame.placement),
                )
            })
            .collect();
        let up: Vector3<f64> = frames.iter().map(|(_, p)| p.rotation * Vector3::z()).sum();
        let Some(up) = up.try_normalize(1e-9) else {
            return;
        };
        let needed = self.support(up);

        // Each foot's wrench enters the balance through `map`; least squares weighted by `cost`.
        let cost = Matrix6::from_diagonal(&Vector6::new(
            1.0,
            1.0,
            1.0,
            SOLE_REACH.powi(2),
            SOLE_REACH.powi(2),
            SOLE_REACH.powi(2),
        ));
        let maps: Vec<Matrix6<f64>> = frames
            .iter()
            .map(|(_, p)| {
                let mut map = Matrix6::zeros();
                let lever: SMatrix<f64, 3, 3> = p.translation.cross_matrix() * p.rotation;
                map.fixed_view_mut::<3, 3>(0, 0).copy_from(&p.rotation);
                map.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
                map.fixed_view_mut::<3, 3>(3, 3).copy_from(&p.rotation);
                map
            })
            .collect();
        let balance: Matrix6<f64> = maps.iter().map(|m| m * cost * m.transpose()).sum();
        let Some(multipliers) = balance.lu().solve(&needed) else {
            return;
        };
        for (&(sensor, _), map) in frames.iter().zip(&maps) {
            let w = cost * map.transpose() * multipliers;
            contact[sensor] = Wrench {
                force: [w[0], w[1], w[2]],
                torque: [w[3], w[4], w[5]],
            };
        }
    }

    /// Wrench about the base's origin, in base axes, that holds the whole robot against gravity.
    fn support(&self, up: Vector3<f64>) -> Vector6<f64> {
        let g = self.model.gravity().norm();
        let bodies = self.model.bodies().iter().zip(self.data.placements());
        let wrenches = bodies.map(|(body, placement)| {
            let proper = Motion::new(placement.rotation.tr_mul(&(up * g)), Vector3::zeros());
            let held = body.inertia.wrench(Motion::zero(), proper);
            placement.act_force(held).to_vector()
        });
        wrenches.sum()
    }
}
