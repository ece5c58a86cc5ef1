//! The start: a pose in static balance, so that the simulation begins without a shock.

use super::SimRobot;
use crate::parameters::SimParameters;
use crate::spatial::split;
use crate::tree::State;
use nalgebra::{Matrix6, UnitQuaternion, Vector6};
use problem::Problem;

impl SimRobot {
    /// Moves a floating base until floor and harness carry the weight, then winds every gear up
    /// and sets every current so that the joints carry theirs.
    pub(crate) fn balance(&mut self, sim: &SimParameters) -> Result<(), Problem> {
        if let (true, Some(ground)) = (sim.start.on_ground, &sim.ground) {
            let heights = self.surroundings.corners.iter();
            let lowest = heights
                .map(|(_, corner)| corner.place(&self.dynamics).z)
                .fold(f64::INFINITY, f64::min);
            self.state.position.z += ground.height - lowest;
        }
        if self.tree.floating() {
            self.balance_base()?;
        }
        self.load();
        for i in 0..self.joints.len() {
            let mut tau = self.dynamics.torque(&self.tree, i);
            for mimic in self.tree.mimics().iter().filter(|mimic| mimic.driver == i) {
                tau += mimic.ratio * self.dynamics.torque(&self.tree, mimic.follower);
            }
            self.joints[i].settle(self.state.q[i], tau);
        }
        Ok(())
    }

    /// Newton's method on the six directions of the base.
    fn balance_base(&mut self) -> Result<(), Problem> {
        let weight = self.tree.mass() * crate::articulated::GRAVITY;
        for _ in 0..200 {
            let residual = self.load();
            let (torque, force) = split(&residual);
            if force.norm() + torque.norm() < 1e-9 * weight {
                return Ok(());
            }
            const H: f64 = 1e-7;
            let mut stiffness = Matrix6::zeros();
            let here = self.state.clone();
            for k in 0..6 {
                let mut by = Vector6::zeros();
                by[k] = H;
                shift(&mut self.state, &by);
                let column = (self.load() - residual) / H;
                stiffness.set_column(k, &column);
                self.state.clone_from(&here);
            }
            // Directions without support get a token stiffness and stay where they are.
            let token = 1e-6 * weight;
            let system = stiffness + token * Matrix6::identity();
            let Some(by) = system.lu().solve(&-residual) else {
                break;
            };
            // A sole leaves the floor within millimetres: no longer strides than that.
            let stride = by.norm();
            shift(&mut self.state, &(by * (2e-3 / stride).min(1.0)));
        }
        Err(Problem::new(
            "start: nothing carries the robot at this pose",
            "a pose whose centre of mass is above the soles with on_ground = true, or a [harness]",
        ))
    }

    /// Forces at rest in the current pose. Returns the wrench about the world's origin that is
    /// missing for balance.
    fn load(&mut self) -> Vector6<f64> {
        self.dynamics.kinematics(&self.tree, &self.state);
        for (_, corner) in &mut self.surroundings.corners {
            corner.release();
        }
        self.surroundings.prepare(&mut self.dynamics, -1.0, 0.0);
        self.dynamics.rest();
        self.surroundings.commit(&mut self.dynamics, 0.0);
        self.dynamics.wrenches(&self.tree);
        self.dynamics.missing()
    }
}

fn shift(state: &mut State, by: &Vector6<f64>) {
    // Rotation about the base, not about the world's origin: the base stays in place.
    let (turn, step) = split(by);
    state.orientation = UnitQuaternion::from_scaled_axis(turn) * state.orientation;
    state.position += step;
}
