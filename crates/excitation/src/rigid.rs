//! The robot's rigid bodies along a planned motion, its base held where it is.

use control::PlannedMotion;
use dynamics::{
    Base, Data, Model, PARAMETERS, Se3, forward_kinematics, joint_torque_regressor, neutral, rnea,
};
use nalgebra::DMatrix;
use robot_config::Robot;

/// Model and state.
pub(crate) struct Rigid<'a> {
    robot: &'a Robot,
    data: Data,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    torques: Vec<f64>,
}

impl<'a> Rigid<'a> {
    pub(crate) fn new(robot: &'a Robot) -> Self {
        let model = &robot.model;
        Self {
            robot,
            data: Data::new(model),
            q: neutral(model),
            v: vec![0.0; model.nv()],
            a: vec![0.0; model.nv()],
            torques: vec![0.0; robot.parameters.joints.len()],
        }
    }

    pub(crate) fn model(&self) -> &'a Model {
        &self.robot.model
    }

    /// Takes a point of all joints, in config order.
    pub(crate) fn set(&mut self, point: &[PlannedMotion]) {
        let (bv, bq) = self.robot.model.base_size();
        for (joint, point) in self.robot.parameters.joints.iter().zip(point) {
            let place = joint.model_index;
            self.q[bq + place] = point.q;
            (self.v[bv + place], self.a[bv + place]) = (point.dq, point.ddq);
        }
    }

    /// Torques that the gears carry, N·m, in config order.
    pub(crate) fn torques(&mut self) -> &[f64] {
        let model = &self.robot.model;
        let bv = model.base_size().0;
        let tau = rnea(model, &mut self.data, &self.q, &self.v, &self.a, None);
        for (out, joint) in self.torques.iter_mut().zip(&self.robot.parameters.joints) {
            *out = tau[bv + joint.model_index];
        }
        &self.torques
    }

    /// Rotor inertia of a joint on the link side, kg·m².
    pub(crate) fn rotor(&self, joint: usize) -> f64 {
        let joint = &self.robot.parameters.joints[joint];
        joint.rotor_inertia * joint.encoders.gear_ratio.powi(2)
    }

    pub(crate) fn empty_regressor(&self) -> DMatrix<f64> {
        let model = &self.robot.model;
        let first = usize::from(model.base() == Base::Fixed);
        let columns = PARAMETERS * (model.bodies().len() - first);
        DMatrix::zeros(model.nv(), columns)
    }

    pub(crate) fn regressor(&mut self, out: &mut DMatrix<f64>) {
        let model = &self.robot.model;
        joint_torque_regressor(model, &mut self.data, &self.q, &self.v, &self.a, out);
    }

    /// Row of a joint in the regressor.
    pub(crate) fn row(&self, joint: usize) -> usize {
        self.robot.model.base_size().0 + self.robot.parameters.joints[joint].model_index
    }

    /// Places of all bodies.
    pub(crate) fn places(&mut self) -> &[Se3] {
        forward_kinematics(&self.robot.model, &mut self.data, &self.q);
        self.data.placements()
    }
}
