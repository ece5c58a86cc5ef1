//! A moving body and its joint.

use crate::spatial::{Force, Inertia, Motion, Se3};
use nalgebra::{Matrix3, Vector3};

/// How a joint moves its body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Rotates about the axis, within limits.
    Revolute,
    /// Rotates about the axis without limits. Its configuration is one angle, rad.
    Continuous,
    /// Translates along the axis.
    Prismatic,
}

impl JointKind {
    /// True for revolute joints, continuous ones included.
    pub fn is_revolute(self) -> bool {
        !matches!(self, JointKind::Prismatic)
    }
}

/// A moving body: all the links that fixed joints hold together.
///
/// Its frame is that of the link its joint carries; body 0 is the root (the world, for a fixed base).
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name of the URDF's joint that moves it; the root link's name for body 0.
    pub name: String,
    /// The body that carries it; 0 for body 0.
    pub parent: usize,
    /// Placement of the joint's frame in the parent body's frame, at `q = 0`.
    pub placement: Se3,
    /// How the joint moves.
    pub kind: JointKind,
    /// Joint axis, in the body's frame, of length 1.
    pub axis: Vector3<f64>,
    /// Index of the independent joint that drives it.
    pub joint: usize,
    /// `q_body = ratio q_joint + offset`: 1 and 0, but for a mimic joint.
    pub ratio: f64,
    /// See `ratio`; rad or m.
    pub offset: f64,
    /// Inertia of all links of the body, in its frame.
    pub inertia: Inertia,
}

impl Body {
    /// `S`: twist of the body, in its frame, for unit speed of its own joint axis.
    #[inline]
    pub fn subspace(&self) -> Motion {
        if self.kind.is_revolute() {
            Motion::new(Vector3::zeros(), self.axis)
        } else {
            Motion::new(self.axis, Vector3::zeros())
        }
    }
    /// Placement of the body in its parent at the joint's configuration (mimic ratio applied).
    #[inline]
    pub fn placement_at(&self, q: f64) -> Se3 {
        let p = &self.placement;
        if self.kind.is_revolute() {
            Se3::new(p.rotation * axis_angle(&self.axis, q), p.translation)
        } else {
            Se3::new(p.rotation, p.translation + p.rotation * (self.axis * q))
        }
    }
    /// Component of a wrench along the joint axis, N·m or N.
    #[inline]
    pub fn along_axis(&self, f: Force) -> f64 {
        if self.kind.is_revolute() {
            self.axis.dot(&f.angular)
        } else {
            self.axis.dot(&f.linear)
        }
    }
}

/// Rotation about a unit axis (Rodrigues).
#[inline]
fn axis_angle(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let a = axis * (1.0 - c);
    let (sx, sy, sz) = (axis.x * s, axis.y * s, axis.z * s);
    let (xy, xz, yz) = (a.x * axis.y, a.x * axis.z, a.y * axis.z);
    Matrix3::new(
        a.x * axis.x + c,
        xy - sz,
        xz + sy,
        xy + sz,
        a.y * axis.y + c,
        yz - sx,
        xz - sy,
        yz + sx,
        a.z * axis.z + c,
    )
}
