//! Parameters of the estimator: sensors, the source of the base's motion, contacts.

use dynamics::Se3;
use nalgebra::Vector3;

/// A place on the robot: a link, and a frame fixed to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The link.
    pub link: String,
    /// Placement of the frame in the link's own.
    pub placement: Se3,
}

impl Place {
    /// The link's own frame.
    #[must_use]
    pub fn link(link: &str) -> Self {
        Self {
            link: link.to_owned(),
            placement: Se3::identity(),
        }
    }
}

/// A force/torque sensor that cuts the tree just before a link.
#[derive(Debug, Clone, PartialEq)]
pub struct FtSensorParameters {
    /// The sensor's name, for messages.
    pub name: String,
    /// The first link beyond the sensor.
    pub cut: String,
    /// The frame in which it measures, on any link.
    pub frame: Place,
    /// Standard deviation of each force axis as passed to `update`, N.
    pub sigma_force: f64,
    /// Standard deviation of each torque axis as passed to `update`, N·m.
    pub sigma_torque: f64,
    /// Errors that last, beside those of single samples.
    pub lasting: LastingErrors,
}

/// Errors of an F/T sensor that no average removes, as standard deviations of each axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LastingErrors {
    /// Of the force where nothing acts: what a tare leaves, N.
    pub force: f64,
    /// Standard deviation of the torque's offset, each axis, N·m.
    pub torque: f64,
    /// Share of the force, and of the torque, that acts: gain, cross-talk, alignment, 1.
    pub share: f64,
}

/// Source of the motion of the whole robot in space.
#[derive(Debug, Clone, PartialEq)]
pub enum MotionSource {
    /// An inertial measurement unit.
    Imu(ImuParameters),
    /// A link that stands still, held by a stand.
    Fixed {
        /// The link.
        link: String,
        /// g: acceleration of gravity in that link's axes, m/s² (3).
        gravity: Vector3<f64>,
    },
}

/// The inertial measurement unit, on any link.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuParameters {
    /// The frame in which it measures.
    pub frame: Place,
    /// Standard deviation of each accelerometer axis as passed to `update`, m/s².
    pub sigma_accelerometer: f64,
    /// Standard deviation of each axis of the angular acceleration as passed to `update`, rad/s².
    pub sigma_angular_acceleration: f64,
    /// Standard deviation of what lasts of each accelerometer axis' errors: its bias, m/s².
    pub lasting_accelerometer: f64,
}

/// Unknowns of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ContactKind {
    /// Force and torque: six unknowns.
    FullWrench,
    /// A force through the point: three unknowns.
    PureForce,
    /// A force through the point along a direction, in the link's axes: one unknown.
    KnownDirection(Vector3<f64>),
    /// The part that the link belongs to is untouched: no unknowns, six checks.
    Nothing,
}

impl ContactKind {
    /// Number of unknowns.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        match self {
            Self::FullWrench => 6,
            Self::PureForce => 3,
            Self::KnownDirection(_) => 1,
            Self::Nothing => 0,
        }
    }
}

/// A contact that the robot may have.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactParameters {
    /// The link that is touched.
    pub link: String,
    /// p: the point that is touched, in the link's frame, m (3).
    pub point: Vector3<f64>,
    /// Its unknowns.
    pub kind: ContactKind,
}

/// All contacts that the robot is taken to have at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// Its name, for messages and for choosing it.
    pub name: String,
    /// The contacts, in any order.
    pub contacts: Vec<ContactParameters>,
}

/// Weights of the equations where there are fewer unknowns than equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weighting {
    /// A newton as much as a newton-metre about the origin of the part's first link.
    #[default]
    Unit,
    /// Each by its expected error: generalised least squares.
    Expected,
}

/// Treatment of the residual of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Residual {
    /// It stays at the sensor that cuts the part off: joints before the sensor trust the sensor.
    #[default]
    Stays,
    /// It is passed on to the root: joints before the sensor trust the contacts beyond it.
    HandedOn,
}

/// Parameters of the whole-body estimator.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodyParameters {
    /// Names of the joints in the order of every per-joint slice here.
    pub joints: Vec<String>,
    /// Standard deviation of each joint's acceleration as passed to `update`, rad/s², same order.
    pub sigma_ddq: Vec<f64>,
    /// The F/T sensors, in any order.
    pub ft_sensors: Vec<FtSensorParameters>,
    /// Source of the motion in space.
    pub source: MotionSource,
    /// The contact sets that may be chosen at run time; the first is chosen at the start.
    pub hypotheses: Vec<Hypothesis>,
    /// Weights of the equations.
    pub weighting: Weighting,
    /// Treatment of residuals.
    pub residual: Residual,
    /// Relative standard deviation of the model's masses: every part's inertial and gravity wrench
    /// is uncertain by this share.
    pub sigma_model: f64,
}
