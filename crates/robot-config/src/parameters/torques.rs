//! Parameters of the torques from F/T sensors and IMU: contacts, their detection, and the cross-check.

use super::{AngularAcceleration, SignalFilters};
use whole_body::{Hypothesis, LoadRule, Weighting};

/// Contacts, and the estimation of torques from F/T sensors and IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodySettings {
    /// The link of a floating robot that a stand holds; none: the IMU measures the motion.
    pub stand: Option<Stand>,
    /// The link that an unknown wrench may act on (D 2.4); the root if none is named.
    pub unknown_wrench_link: Option<String>,
    /// Source of the IMU's angular acceleration.
    pub angular_acceleration: AngularAcceleration,
    /// Weights of the equations where there are fewer unknowns than equations.
    pub weighting: Weighting,
    /// Relative standard deviation of the model's masses, 1.
    pub sigma_model: f64,
    /// The contact sets; the first holds at the start. Empty: a full wrench beyond each
    /// F/T sensor and one on `unknown_wrench_link`.
    pub contacts: Vec<ContactSet>,
    /// Time over which one contact set is blended into the next, s.
    pub blend: f64,
    /// Forces at which an F/T sensor's part counts as loaded; none: only clients choose contact sets.
    pub load_rule: Option<LoadRule>,
}

/// A stand that holds a robot with a floating base.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// The link that stands still.
    pub link: String,
    /// g: acceleration of gravity in that link's axes, m/s² (3).
    pub gravity: [f64; 3],
}

/// A contact set.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSet {
    /// Its name and its contacts.
    pub hypothesis: Hypothesis,
    /// The state of load at which the rule chooses it: indices of F/T sensors and whether each is
    /// loaded. Empty: only clients choose it.
    pub loaded: Vec<(usize, bool)>,
}

/// Detection of contacts by external torques, and what follows from one.
#[derive(Debug, Clone, PartialEq)]
pub struct ExternalTorqueSettings {
    /// Filters of all signals of the fast part.
    pub filters: SignalFilters,
    /// K: bandwidth of the momentum observer, 1/s.
    pub gain: f64,
    /// Lower thresholds.
    pub threshold: ContactThreshold,
    /// Upper threshold over the lower one, 1.
    pub upper_ratio: f64,
    /// Time for which a threshold must be exceeded, s.
    pub hold: f64,
    /// Time for which both torques must stay below two thirds of their thresholds until the contact is
    /// over, s.
    pub release: f64,
    /// Frame at which the contact force is estimated; none: it is not.
    pub frame: Option<String>,
    /// How a limb yields.
    pub reaction: ContactReaction,
}

/// Lower thresholds of external torques: multiples of the standard deviation, plus shares of each
/// joint's torque limit, 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactThreshold {
    /// Standard deviations.
    pub sigmas: f64,
    /// For the change of the external torque, a joint at rest.
    pub change: f64,
    /// For the external torque itself, a joint at rest.
    pub lasting: f64,
    /// More at the velocity limit, and proportionally less below.
    pub at_velocity_limit: f64,
    /// More at the acceleration that the torque limit gives the joint, and proportionally less below.
    pub at_acceleration_limit: f64,
    /// Of the change of the joint's torque within half a second.
    pub of_torque_change: f64,
}

/// How a limb yields to a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactReaction {
    /// Greatest way of a joint that complies, of a revolute (rad) and of a prismatic joint (m); then it is
    /// stopped.
    pub comply: [f64; 2],
    /// Time without contact after which complying ends, s; none: only the operator ends it.
    pub comply_until_gone: Option<f64>,
    /// Way back of the joint that has come furthest, of a revolute (rad) and of a prismatic joint (m).
    pub retract: [f64; 2],
}

/// Thresholds from which on torque sources of a joint disagree.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossCheckSettings {
    /// Normal difference of encoders and F/T sensors, as a share of the torque limit, 1.
    pub encoder_share: f64,
    /// Torque from which on the current is judged, as a share of the torque limit, 1.
    pub current_load_share: f64,
    /// Smallest and largest normal ratio of the current's torque to the others'.
    pub current_ratio: [f64; 2],
    /// Normal residual of a part, in standard deviations.
    pub residual_ratio: f64,
    /// Time over which differences are averaged, s.
    pub average: f64,
    /// Shortest disagreement that counts, s.
    pub hold: f64,
}
