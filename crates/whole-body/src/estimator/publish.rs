//! Writes solutions under the chosen contacts into the estimate.

use super::{ContactEstimate, WholeBody, wrench};
use crate::covariance::contact_rows;
use crate::least_squares::{Six, dot, quadratic};
use crate::solution::Hypotheses;
use dynamics::Force;
use nalgebra::Vector3;
use robot_state::Wrench;

impl WholeBody {
    pub(super) fn publish_sigmas(&mut self) {
        let hypotheses = Hypotheses {
            sets: &self.sets,
            solutions: &self.solutions,
            weights: &self.weights,
        };
        (self.sigma).torques(&self.layout, &self.mechanics, hypotheses);
        for (sigma, &joint) in self.next.sigma.iter_mut().zip(&self.layout.joints) {
            *sigma = self.sigma.variance[joint].sqrt();
        }
        for (sigma, &joint) in (self.next.lasting_sigma.iter_mut()).zip(&self.layout.joints) {
            *sigma = self.sigma.lasting_variance[joint].sqrt();
        }
    }

    pub(super) fn publish_torques(&mut self) {
        // A mimic joint's torque adds to that of the joint it follows.
        self.by_joint.fill(0.0);
        for (body, tau) in self.model.bodies().iter().zip(&self.tau).skip(1) {
            self.by_joint[body.joint] += tau;
        }
        for (tau, &joint) in self.next.tau.iter_mut().zip(&self.layout.joints) {
            *tau = self.by_joint[joint];
        }
    }

    pub(super) fn publish_contacts(&mut self) {
        let (set, solution) = (&self.sets[self.chosen], &self.solutions[self.chosen]);
        self.next.contacts.fill(ContactEstimate::default());
        for (part, (range, _)) in set.parts.iter().enumerate() {
            let origin = self.mechanics.origin(&self.model, &self.layout, part);
            let covariance = &self.sigma.covariance[part];
            let full = set.single_full(part).is_some();
            let mut first = 0;
            for c in range.clone() {
                let contact = &set.contacts[c];
                let frame = self.mechanics.in_root[contact.body].compose(&contact.placement);
                let n = contact.kind.unknowns();
                let rows = &solution.rows[part][first..first + n];
                let rows = contact_rows(&frame, &origin, full, rows);
                first += n;
                let x: Six = std::array::from_fn(|k| quadratic(covariance, &rows[k]).sqrt());
                let mut sigma = wrench(contact.wrench(&x[..n]));
                sigma.force = sigma.force.map(f64::abs);
                let estimate = &mut self.next.contacts[contact.input];
                estimate.wrench = wrench(solution.local[c]);
                estimate.sigma = sigma;
            }
        }
    }

    pub(super) fn publish_parts(&mut self) {
        let (set, solution) = (&self.sets[self.chosen], &self.solutions[self.chosen]);
        for (part, &output) in self.part_output.iter().enumerate() {
            let frame = (self.mechanics).part_frame(&self.model, &self.layout, part);
            let part_estimate = &mut self.next.parts[output];
            part_estimate.net = wrench(frame.inverse_act_force(self.mechanics.net[part]));
            part_estimate.residual = wrench(frame.inverse_act_force(solution.residual[part]));
            let n = set.parts[part].1;
            if n == 6 {
                part_estimate.residual_sigma = Wrench::default();
                continue;
            }
            let (columns, rows) = (&solution.columns[part], &solution.rows[part]);
            let sigma: Six = std::array::from_fn(|k| {
                let axis = frame.rotation.column(k % 3).into_owned();
                let axis = if k < 3 {
                    Force::new(axis, Vector3::zeros())
                } else {
                    Force::new(Vector3::zeros(), axis)
                };
                // axis^T (1 - A A^+)
                let mut row = axis.to_array();
                for (column, inverse) in columns[..n].iter().zip(&rows[..n]) {
                    let along = dot(&axis.to_array(), column);
                    row.iter_mut()
                        .zip(inverse)
                        .for_each(|(r, i)| *r -= along * i);
                }
                quadratic(&self.sigma.covariance[part], &row)
                    .max(0.0)
                    .sqrt()
            });
            part_estimate.residual_sigma = wrench(Force::from_array(sigma));
        }
    }
}
