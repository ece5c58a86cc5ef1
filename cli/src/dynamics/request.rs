//! The request: joints, frames and states.

use problem::Problem;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Cases {
    /// Names of the joints, in the order of `q dq ddq tau M`; all, in the model's order, if left out.
    /// A mimic joint that is named here is taken as independent.
    #[serde(default)]
    pub(super) joints: Option<Vec<String>>,
    /// Links whose placement, motion and Jacobians are requested too.
    #[serde(default)]
    pub(super) frames: Vec<String>,
    /// Inertia that the motor adds about a joint's axis, kg·m² (or kg); zero if left out.
    #[serde(default)]
    pub(super) armature: BTreeMap<String, f64>,
    /// True if [`More`](super::report::More) is requested too.
    #[serde(default)]
    pub(super) more: bool,
    /// States.
    pub(super) cases: Vec<Case>,
}

/// One state.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Case {
    /// `q`, rad or m, one per joint.
    pub(super) q: Vec<f64>,
    /// `dq`, rad/s; zero if left out.
    #[serde(default)]
    pub(super) dq: Option<Vec<f64>>,
    /// `ddq`, rad/s²; zero if left out.
    #[serde(default)]
    pub(super) ddq: Option<Vec<f64>>,
    /// Floating base; at the origin and at rest if left out.
    #[serde(default)]
    pub(super) base: Option<BaseState>,
    /// External wrenches on links, N and N·m, linear first, in the link's axes and at its origin.
    #[serde(default)]
    pub(super) f_ext: BTreeMap<String, [f64; 6]>,
}

/// State of a floating base.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BaseState {
    /// Position in the world, m.
    pub(super) p: [f64; 3],
    /// Orientation in the world; of length 1, but for rounding in print.
    pub(super) quat_xyzw: [f64; 4],
    /// Velocity, linear then angular, in base axes.
    #[serde(default)]
    pub(super) v: [f64; 6],
    /// Spatial acceleration, linear then angular, in base axes.
    #[serde(default)]
    pub(super) a: [f64; 6],
}

/// Largest difference of a quaternion's length from 1.
const ROUNDING: f64 = 1e-3;

impl BaseState {
    /// At the world's origin, at rest.
    pub(super) const REST: Self = Self {
        p: [0.0; 3],
        quat_xyzw: [0.0, 0.0, 0.0, 1.0],
        v: [0.0; 6],
        a: [0.0; 6],
    };

    /// `p` and the quaternion as a configuration holds them.
    pub(super) fn pose(&self) -> Result<[f64; 7], Problem> {
        let length = self.quat_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > ROUNDING || !length.is_finite() {
            return Err(Problem::new(
                format!("base.quat_xyzw: length {length}"),
                format!("1 (to {ROUNDING})"),
            ));
        }
        let mut pose = [0.0; 7];
        pose[..3].copy_from_slice(&self.p);
        pose[3..].copy_from_slice(&self.quat_xyzw.map(|x| x / length));
        Ok(pose)
    }
}
