//! From the checked tree to the model: fixed links lumped, joints in Pinocchio's order.

use super::text::Source;
use super::tree::Tree;
use super::{inertia, problem_at, units};
use crate::body::{Body, JointKind};
use crate::model::{Base, Frame, GRAVITY, Joint, JointLimits, Model};
use crate::spatial::{Inertia, Se3};
use nalgebra::Vector3;
use problem::Problem;
use std::collections::HashMap;
use urdf_rs::JointType;

/// Range that is no limit of a joint that turns without end, rad: a turn, but for rounding.
const WHOLE_TURN: f64 = 0.99 * std::f64::consts::TAU;

pub(super) fn model(source: &Source, tree: &Tree, base: Base) -> Result<Model, Problem> {
    let mut build = Build {
        source,
        tree,
        joint_of: vec![None; source.robot.joints.len()],
        link_of: Vec::new(),
        model: Model {
            name: source.robot.name.clone(),
            base,
            bodies: Vec::new(),
            joints: Vec::new(),
            frames: Vec::new(),
            gravity: Vector3::new(0.0, 0.0, -GRAVITY),
            dof_parent: Vec::new(),
            warnings: tree.warnings.clone(),
            schedule: Default::default(),
        },
    };
    build.walk()?;
    build.follow_drivers();
    build.check_bodies()?;
    build.warn_of_massless();
    build.read_transmissions()?;
    build.model.finish();
    Ok(build.model)
}

struct Build<'a> {
    source: &'a Source,
    tree: &'a Tree,
    /// Index in `model.joints` of each independent joint of the URDF.
    joint_of: Vec<Option<usize>>,
    /// The URDF's link of each frame.
    link_of: Vec<usize>,
    model: Model,
}

impl Build<'_> {
    /// Depth first, children sorted by name.
    fn walk(&mut self) -> Result<(), Problem> {
        let root = self.tree.root;
        self.model.bodies.push(Body {
            name: self.source.robot.links[root].name.clone(),
            parent: 0,
            placement: Se3::identity(),
            kind: JointKind::Revolute,
            axis: Vector3::z(),
            joint: usize::MAX,
            ratio: 1.0,
            offset: 0.0,
            inertia: Inertia::zero(),
        });
        self.link(root, 0, Se3::identity(), None, false)?;
        let mut stack: Vec<(usize, usize)> = Vec::new();
        let push = |stack: &mut Vec<(usize, usize)>, tree: &Tree, link: usize, frame: usize| {
            let joints = tree.children[link].iter().rev();
            stack.extend(joints.map(|j| (*j, frame)));
        };
        push(&mut stack, self.tree, root, 0);
        while let Some((joint, frame)) = stack.pop() {
            self.joint(joint, frame)?;
            let last = self.model.frames.len() - 1;
            push(&mut stack, self.tree, self.tree.child[joint], last);
        }
        Ok(())
    }

    fn link(
        &mut self,
        link: usize,
        body: usize,
        placement: Se3,
        parent: Option<usize>,
        rigid: bool,
    ) -> Result<(), Problem> {
        let lines = &self.source.links[link];
        let own = &self.source.robot.links[link];
        let inertia = inertia::of_link(own, lines, &mut self.model.warnings)?;
        self.model.bodies[body].inertia += inertia.transformed(&placement);
        self.link_of.push(link);
        self.model.frames.push(Frame {
            name: own.name.clone(),
            body,
            placement,
            inertia,
            parent,
            rigid,
        });
        Ok(())
    }

    fn joint(&mut self, index: usize, frame: usize) -> Result<(), Problem> {
        let joint = &self.source.robot.joints[index];
        let lines = &self.source.joints[index];
        units::of_joint(joint, lines, &mut self.model.warnings);
        let on = &self.model.frames[frame];
        let origin = Se3::from_xyz_rpy(*joint.origin.xyz, *joint.origin.rpy);
        let (parent, placement) = (on.body, on.placement.compose(&origin));
        let kind = match joint.joint_type {
            JointType::Fixed => {
                let child = self.tree.child[index];
                return self.link(child, parent, placement, Some(frame), true);
            }
            JointType::Revolute => JointKind::Revolute,
            JointType::Continuous => JointKind::Continuous,
            JointType::Prismatic => JointKind::Prismatic,
            ref other => {
                let reason = format!("joint type {other:?} is not known");
                return Err(problem_at(lines.own(), reason, ""));
            }
        };
        let Some(axis) = Model::unit_axis(Vector3::from(*joint.axis.xyz)) else {
            let (name, axis) = (&joint.name, *joint.axis.xyz);
            let reason = format!("joint \"{name}\": axis {axis:?} has no direction");
            return Err(problem_at(lines.of("axis"), reason, "any vector but zero"));
        };
        let driver = self.tree.driver[index];
        let body = self.model.bodies.len();
        if driver.joint == index {
            self.joint_of[index] = Some(self.model.joints.len());
            let limits = self.limits(index, kind)?;
            let dynamics = joint.dynamics.clone().unwrap_or_default();
            self.model.joints.push(Joint {
                name: joint.name.clone(),
                body,
                kind,
                limits,
                armature: 0.0,
                gear_ratio: None,
                rotor_inertia: None,
                damping: dynamics.damping,
                friction: dynamics.friction,
            });
        }
        self.model.bodies.push(Body {
            name: joint.name.clone(),
            parent,
            placement,
            kind,
            axis,
            joint: driver.joint,
            ratio: driver.ratio,
            offset: driver.offset,
            inertia: Inertia::zero(),
        });
        let child = self.tree.child[index];
        self.link(child, body, Se3::identity(), Some(frame), false)
    }

    fn limits(&mut self, index: usize, kind: JointKind) -> Result<JointLimits, Problem> {
        let joint = &self.source.robot.joints[index];
        let lines = &self.source.joints[index];
        let (name, line) = (&joint.name, lines.of("limit"));
        let mut limits = JointLimits {
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            velocity: f64::INFINITY,
            effort: f64::INFINITY,
        };
        if !lines.has("limit") {
            if kind != JointKind::Continuous {
                let reason = format!("joint \"{name}\" has no <limit>: none is assumed");
                self.model.warnings.push(problem_at(line, reason, ""));
            }
            return Ok(limits);
        }
        let given = &joint.limit;
        if given.effort < 0.0 || given.velocity < 0.0 {
            let reason = format!(
                "joint \"{name}\": effort {} velocity {}",
                given.effort, given.velocity
            );
            return Err(problem_at(line, reason, "numbers >= 0"));
        }
        (limits.effort, limits.velocity) = (given.effort, given.velocity);
        let mut warn = |reason: String| {
            let reason = format!("joint \"{name}\": {reason}");
            self.model.warnings.push(problem_at(line, reason, ""));
        };
        for (what, limit) in [("effort", given.effort), ("velocity", given.velocity)] {
            if limit == 0.0 {
                warn(format!("{what} 0 allows none"));
            }
        }
        if kind == JointKind::Continuous {
            // Exporters write zeros, and a whole turn.
            if given.upper - given.lower > 0.0 && given.upper - given.lower < WHOLE_TURN {
                let (lower, upper) = (given.lower, given.upper);
                warn(format!(
                    "lower {lower} and upper {upper} are no limits of a continuous joint"
                ));
            }
            return Ok(limits);
        }
        if given.lower > given.upper {
            let reason = format!(
                "joint \"{name}\": lower {} above upper {}",
                given.lower, given.upper
            );
            return Err(problem_at(line, reason, "lower <= upper"));
        }
        (limits.lower, limits.upper) = (given.lower, given.upper);
        Ok(limits)
    }

    /// Bodies name the URDF's driving joint; make it the model's.
    fn follow_drivers(&mut self) {
        for body in self.model.bodies.iter_mut().skip(1) {
            body.joint = self.joint_of[body.joint].unwrap_or(usize::MAX);
        }
    }

    /// Warns of joints that move no mass: their forward dynamics is undefined.
    fn warn_of_massless(&mut self) {
        let bodies = &self.model.bodies;
        let mut moves: Vec<bool> = bodies
            .iter()
            .map(|b| b.inertia != Inertia::zero())
            .collect();
        for i in (1..bodies.len()).rev() {
            moves[bodies[i].parent] |= moves[i];
        }
        for (index, joint) in self.joint_of.iter().enumerate() {
            let joint = joint.map(|j| &self.model.joints[j]);
            let Some(joint) = joint.filter(|j| !moves[j.body]) else {
                continue;
            };
            let reason = format!(
                "joint \"{}\" moves no mass: forward dynamics has no finite result unless its motor \
                 adds inertia",
                joint.name
            );
            let line = self.source.joints[index].own();
            self.model.warnings.push(problem_at(line, reason, ""));
        }
    }

    fn read_transmissions(&mut self) -> Result<(), Problem> {
        let joints = self.source.robot.joints.iter().zip(&self.joint_of);
        let by_name: HashMap<&str, Option<usize>> =
            joints.map(|(j, own)| (j.name.as_str(), *own)).collect();
        for t in &self.source.transmissions {
            let index = match by_name.get(t.joint.as_str()) {
                Some(Some(index)) => *index,
                // Transmissions of mimic joints are common and mean nothing here.
                Some(None) => continue,
                None => {
                    let reason = format!("transmission of an unknown joint \"{}\"", t.joint);
                    self.model.warnings.push(problem_at(t.line, reason, ""));
                    continue;
                }
            };
            let joint = &mut self.model.joints[index];
            for (own, given) in [
                (&mut joint.gear_ratio, t.gear_ratio),
                (&mut joint.rotor_inertia, t.rotor_inertia),
            ] {
                if let (Some(own), Some(given)) = (*own, given)
                    && own != given
                {
                    let reason = format!(
                        "joint \"{}\" has transmissions with {own} and with {given}",
                        joint.name
                    );
                    return Err(problem_at(t.line, reason, "one value for a joint"));
                }
                *own = own.or(given);
            }
        }
        Ok(())
    }

    /// Refuses bodies with a negative moment of inertia, at the link with the smallest one.
    fn check_bodies(&self) -> Result<(), Problem> {
        let frames = &self.model.frames;
        for (body, frame) in frames.iter().filter(|f| !f.rigid).map(|f| (f.body, f)) {
            inertia::check_body(&frame.name, &self.model.bodies[body].inertia).map_err(
                |problem| {
                    let parts = (0..frames.len()).filter(|f| frames[*f].body == body);
                    let moment = |f: &usize| inertia::smallest_moment(&frames[*f].inertia);
                    let worst = parts.min_by(|a, b| moment(a).total_cmp(&moment(b)));
                    let link = self.link_of[worst.unwrap_or(0)];
                    problem.at("", self.source.links[link].of("inertia"))
                },
            )?;
        }
        Ok(())
    }
}
