//! The immutable description of a robot: bodies, joints and frames.

use crate::body::{Body, JointKind};
use crate::lane_schedule::{LaneSchedule, Skeleton};
use crate::spatial::{Inertia, Se3};
use nalgebra::{Unit, Vector3};
use problem::Problem;

/// How the root link is attached to the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// The root link does not move.
    Fixed,
    /// The root link moves freely: 7 more configuration and 6 more velocity components.
    Floating,
}

/// Limits of a joint, as in its URDF; infinite where the file gives none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Smallest `q`, rad or m.
    pub lower: f64,
    /// Largest `q`, rad or m.
    pub upper: f64,
    /// Largest `|dq|`, rad/s or m/s.
    pub velocity: f64,
    /// Largest `|tau|`, N·m or N.
    pub effort: f64,
}

/// An independent joint: one component of `q` and of `v`.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name of the URDF's joint.
    pub name: String,
    /// The body that it moves.
    pub body: usize,
    /// How it moves.
    pub kind: JointKind,
    /// Limits.
    pub limits: JointLimits,
    /// Inertia that the motor adds about the joint axis, link side, kg·m² (or kg).
    pub armature: f64,
    /// `N`, motor turns per joint turn, from `<transmission>` or `<ros2_control>`.
    pub gear_ratio: Option<f64>,
    /// Inertia of the motor's rotor, motor side, kg·m², from the same.
    pub rotor_inertia: Option<f64>,
    /// Viscous friction of the URDF's `<dynamics>`, N·m·s/rad; no algorithm here uses it.
    pub damping: f64,
    /// Coulomb friction of the URDF's `<dynamics>`, N·m; no algorithm here uses it.
    pub friction: f64,
}

/// A link of the URDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Name of the link.
    pub name: String,
    /// The body that it belongs to.
    pub body: usize,
    /// Placement in the body's frame.
    pub placement: Se3,
    /// Inertia of this link alone, in its own frame.
    pub inertia: Inertia,
    /// The link that carries it.
    pub parent: Option<usize>,
    /// True if a fixed joint (or none) holds it to `parent`.
    pub rigid: bool,
}

/// A robot's bodies, joints and frames.
///
/// Configuration `q` is `[position (3), quaternion xyzw (4), joints]` and velocity `v` is
/// `[linear (3), angular (3) in base axes, joints]` for a floating base, joints alone for a fixed
/// one. Joints come depth first, children sorted by the name of their joint, as in Pinocchio; but a
/// continuous joint has one angle here, not a cosine and a sine. A mimic joint has no component.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub(crate) name: String,
    pub(crate) base: Base,
    pub(crate) bodies: Vec<Body>,
    pub(crate) joints: Vec<Joint>,
    pub(crate) frames: Vec<Frame>,
    pub(crate) gravity: Vector3<f64>,
    /// The nearest component of `v` that supports each component (all before it, with mimic joints).
    pub(crate) dof_parent: Vec<Option<usize>>,
    pub(crate) warnings: Vec<Problem>,
    pub(crate) schedule: LaneSchedule,
}

/// Standard gravity as Pinocchio takes it, m/s².
pub const GRAVITY: f64 = 9.81;

impl Model {
    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// How the root is attached.
    pub fn base(&self) -> Base {
        self.base
    }
    /// Components of `v` and `q` before the joints': (6, 7) or (0, 0).
    #[inline]
    pub fn base_size(&self) -> (usize, usize) {
        match self.base {
            Base::Fixed => (0, 0),
            Base::Floating => (6, 7),
        }
    }
    /// Length of the configuration `q`.
    #[inline]
    pub fn nq(&self) -> usize {
        self.joints.len() + self.base_size().1
    }
    /// Length of the velocity `v`.
    #[inline]
    pub fn nv(&self) -> usize {
        self.joints.len() + self.base_size().0
    }
    /// Number of independent joints.
    #[inline]
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }
    /// Independent joints, in the order of `v`.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }
    /// Their names.
    pub fn joint_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.joints.iter().map(|j| j.name.as_str())
    }
    /// Index of an independent joint.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }
    /// Limits of a joint.
    pub fn joint_limits(&self, joint: usize) -> Option<JointLimits> {
        self.joints.get(joint).map(|j| j.limits)
    }
    /// Sets the inertia that a joint's motor adds about its axis (rotor inertia × gear ratio²), kg·m².
    pub fn set_armature(&mut self, joint: usize, armature: f64) {
        debug_assert!(armature.is_finite() && armature >= 0.0);
        if let Some(j) = self.joints.get_mut(joint) {
            j.armature = armature;
            self.schedule.set_armature(j.body, armature);
        }
    }
    /// Sets the armature of every joint of which the URDF gives gear ratio and rotor inertia.
    pub fn apply_rotor_inertias(&mut self) {
        for joint in 0..self.joints.len() {
            let j = &self.joints[joint];
            if let (Some(ratio), Some(inertia)) = (j.gear_ratio, j.rotor_inertia) {
                self.set_armature(joint, ratio * ratio * inertia);
            }
        }
    }
    /// Moving bodies; 0 is the root, and each comes after its parent.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }
    /// The body that carries `body`; none for the root.
    pub fn parent(&self, body: usize) -> Option<usize> {
        match body {
            0 => None,
            _ => self.bodies.get(body).map(|b| b.parent),
        }
    }
    /// Links of the URDF.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }
    /// Index of a link.
    pub fn frame_index(&self, name: &str) -> Option<usize> {
        self.frames.iter().position(|f| f.name == name)
    }
    /// True if `body` is `ancestor` or moves with it.
    pub fn supports(&self, ancestor: usize, mut body: usize) -> bool {
        while body > ancestor {
            match self.parent(body) {
                Some(p) => body = p,
                None => return false,
            }
        }
        body == ancestor
    }
    /// `g`, acceleration of gravity in the world, m/s² (3).
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }
    /// Sets the acceleration of gravity in the world, m/s².
    pub fn set_gravity(&mut self, gravity: Vector3<f64>) {
        self.gravity = gravity;
    }
    /// Sum of all masses, kg; the root's counts also when it is fixed.
    pub fn total_mass(&self) -> f64 {
        self.bodies.iter().map(|b| b.inertia.mass).sum()
    }
    /// Odd but usable parts of the URDF, each with file and line.
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }
    /// True if some joint follows another.
    pub fn has_mimic(&self) -> bool {
        self.bodies.len() != self.joints.len() + 1
    }
    /// Derives schedule and parents of components from bodies and joints.
    pub(crate) fn finish(&mut self) {
        let base = self.base_size().0;
        self.schedule = LaneSchedule::new(Skeleton {
            bodies: &self.bodies,
            joint_count: self.joints.len(),
            base_size: base,
        });
        let before = |i: usize| i.checked_sub(1);
        self.dof_parent = (0..self.nv()).map(before).collect();
        if self.has_mimic() {
            return;
        }
        for (i, joint) in self.joints.iter().enumerate() {
            let parent = self.bodies[joint.body].parent;
            self.dof_parent[base + i] = match parent {
                0 => base.checked_sub(1),
                p => Some(base + self.bodies[p].joint),
            };
        }
    }
    /// Unit axis from any finite vector that is long enough to have a direction.
    pub(crate) fn unit_axis(v: Vector3<f64>) -> Option<Vector3<f64>> {
        // The square of a large component would overflow.
        let largest = v.amax();
        let scaled = if largest > 1.0 { v / largest } else { v };
        Unit::try_new(scaled, 1e-9).map(Unit::into_inner)
    }
}
