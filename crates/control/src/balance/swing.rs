//! Swing: a foot in the air goes to where the desired pose has it, against the feet that stand.
//!
//! The base sways and is led aside while a foot is in the air. Its joints alone would carry that over to where it comes
//! down: feet would wander apart from step to step, and come down on an edge.

use dynamics::{ReferenceFrame, Se3, frame_jacobian};
use nalgebra::{Matrix3, Matrix6, Vector3};

use super::floor::Floor;
use super::{Balance, small_turn};
use crate::six::six;

/// Rate with which a foot in the air is led, 1/s, and its greatest velocities, m/s and rad/s. Chosen; no experiment recorded.
const LEADS: f64 = 5.0;
const FASTEST: [f64; 2] = [0.15, 0.5];
/// Damping by which a leg that is stretched out does not move fast, m and rad. Chosen; no experiment recorded.
const STRETCHED: f64 = 0.02;

impl Balance {
    /// Velocities of joints (in the order of the model, rad/s), besides those that are desired, that lead a foot in the air
    /// to its place in the desired pose against a foot that stands, its sole parallel to the ground and so far (m) below
    /// that place. Nothing before the first update.
    pub fn lead_sole(&mut self, foot: usize, below: f64, mut add: impl FnMut(usize, f64)) {
        let Some(target) = self.place_of(foot, below) else {
            return;
        };
        let Some(own) = self.feet.get_mut(foot) else {
            return;
        };
        let world = ReferenceFrame::World;
        frame_jacobian(&self.model, &self.data, own.frame, world, &mut own.jacobian);
        let middle = own.at.act_point(own.sole.origin());
        let between = target.rotation * own.at.rotation.transpose();
        let turn = small_turn(&between);
        let limited = |x: Vector3<f64>, most: f64| x * (most / x.norm().max(most));
        let linear = limited((target.translation - middle) * LEADS, FASTEST[0]);
        let angular = limited(turn * LEADS, FASTEST[1]);
        // Twist of the sole about its middle for each joint of the leg.
        let twist = |j: usize| {
            let column = own.jacobian.column(6 + j);
            let angular: Vector3<f64> = column.fixed_rows::<3>(3).into();
            let linear = column.fixed_rows::<3>(0) + angular.cross(&middle);
            six(&linear, &angular)
        };
        let mut gram = Matrix6::identity() * (STRETCHED * STRETCHED);
        for &j in &own.joints {
            gram += twist(j) * twist(j).transpose();
        }
        if let Some(factor) = gram.cholesky() {
            let multipliers = factor.solve(&six(&linear, &angular));
            for &j in &own.joints {
                add(j, twist(j).dot(&multipliers));
            }
        }
    }

    /// The middle of a sole, and the rotation of its sensor, in the axes of the base, where the desired pose has it.
    fn place_of(&self, foot: usize, below: f64) -> Option<Se3> {
        let own = self.feet.get(foot)?;
        let floor = self.floor.as_ref()?;
        let stands = self.feet.get(floor.foot)?;
        let desired_up = stands.desired.rotation * stands.first_up?;
        let desired = Floor::under(floor.foot, &stands.sole, &stands.desired, &desired_up)?;
        let up: Vector3<f64> = floor.axes.column(2).into();
        let turn: Matrix3<f64> = floor.axes * desired.axes.transpose();
        let middle = own.desired.act_point(own.sole.origin()) - desired.origin;
        let rotation = turn * own.desired.rotation;
        let normal: Vector3<f64> = rotation * own.sole.axes().column(2);
        let level = nalgebra::Rotation3::rotation_between(&normal, &up)?;
        Some(Se3 {
            translation: floor.origin + turn * middle - up * below,
            rotation: level.matrix() * rotation,
        })
    }
}
