//! External forces on the robot: ground, harness, pushes.

use crate::articulated::Dynamics;
use crate::contact::{Corner, Harness, Push};
use crate::parameters::SimParameters;
use crate::tree::{Frame, Tree};
use crate::truth::ExternalTruth;
use nalgebra::Vector6;
use problem::Problem;

/// External forces on the robot.
#[derive(Debug, Clone)]
pub(crate) struct Surroundings {
    pub(crate) ground: Option<crate::parameters::GroundParameters>,
    /// Corners with the foot they belong to.
    pub(crate) corners: Vec<(usize, Corner)>,
    pub(crate) feet: Vec<Frame>,
    pub(crate) harness: Option<(Frame, Harness)>,
    pub(crate) pushes: Vec<(Frame, Push)>,
}

impl Surroundings {
    pub(crate) fn new(
        tree: &Tree,
        dynamics: &Dynamics,
        sim: &SimParameters,
    ) -> Result<Self, Problem> {
        let (mut feet, mut corners) = (Vec::new(), Vec::new());
        for (i, foot) in sim.feet.iter().enumerate() {
            let frame = tree.frame_of("foot.link", &foot.link)?;
            feet.push(frame.clone());
            corners.extend(foot.corners.iter().map(|c| (i, Corner::new(frame, c))));
        }
        let harness = match &sim.harness {
            Some(p) => {
                let frame = tree.frame_of("harness.link", &p.link)?;
                Some((frame.clone(), Harness::new(p, frame, dynamics)))
            }
            None => None,
        };
        let mut pushes = Vec::new();
        for push in &sim.pushes {
            let frame = tree.frame_of("push.link", &push.link)?;
            pushes.push((frame.clone(), Push::new(push, frame)));
        }
        Ok(Self {
            ground: sim.ground.clone(),
            corners,
            feet,
            harness,
            pushes,
        })
    }

    pub(crate) fn prepare(&mut self, dynamics: &mut Dynamics, time: f64, dt: f64) {
        if let Some(ground) = &self.ground {
            for (_, corner) in &mut self.corners {
                corner.prepare(ground, dynamics, dt);
            }
        }
        if let Some((_, harness)) = &mut self.harness {
            harness.prepare(dynamics, dt);
        }
        for (_, push) in &mut self.pushes {
            push.prepare(dynamics, time);
        }
    }

    pub(crate) fn commit(&mut self, dynamics: &mut Dynamics, dt: f64) {
        dynamics.clear_external();
        for (_, corner) in &mut self.corners {
            corner.commit(dynamics, dt);
        }
        if let Some((_, harness)) = &mut self.harness {
            harness.commit(dynamics, dt);
        }
        for (_, push) in &self.pushes {
            push.commit(dynamics);
        }
    }

    /// External wrenches at the links' origins in the links' axes: feet, harness, pushes.
    pub(crate) fn record(&self, dynamics: &Dynamics, external: &mut [ExternalTruth]) {
        let feet = self.feet.iter().enumerate().map(|(i, frame)| {
            let corners = self.corners.iter().filter(move |(foot, _)| *foot == i);
            let sum = corners.fold(Vector6::zeros(), |sum, (_, c)| sum + c.wrench());
            (frame, sum)
        });
        let harness = (self.harness.iter()).map(|(frame, h)| (frame, h.wrench()));
        let pushes = self.pushes.iter().map(|(frame, p)| (frame, p.wrench()));
        for (truth, (frame, wrench)) in external.iter_mut().zip(feet.chain(harness).chain(pushes)) {
            truth.set(frame, dynamics, &wrench);
        }
    }
}
