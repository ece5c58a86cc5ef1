//! Mass, centre of mass and inertia of one link, or of a payload on it, from what a robot measures beside
//! it: F/T sensors or joint torques, with the offsets of these, and the misalignment of an F/T sensor.
//!
//! In: samples of wrenches or torques beside the model's, and how these depend on the link's inertia.
//! Out: each number with its 95 % interval; what the poses do not determine stays at its prior and is
//! named. Model: measured = R (modelled + Y delta) + offset, linear but for the small rotation R and for
//! the inertia about a centre of mass that moves; both are solved again about the last solution. Rows
//! weigh by the rest of their own channel, samples that contradict all others (something touched the
//! robot) not at all, and the intervals are those of [`crate::blocks`], by blocks left out in turn.

pub mod checks;
mod fit;
pub mod motion;
mod spoilt;
pub mod untouched;

use crate::drive::Value;
use dynamics::Inertia;
use nalgebra::Vector3;
use problem::Problem;

/// Inertial parameters of a body: `m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about its frame's origin.
pub const BODY: usize = 10;
/// Angles of a misalignment.
const ANGLES: usize = 3;
/// Fewest samples.
const FEWEST: usize = 50;

/// One instant.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sample {
    /// Measured, by channel: N and N·m.
    pub measured: Vec<f64>,
    /// By the model as it is.
    pub modelled: Vec<f64>,
    /// Derivatives by the link's inertial parameters; zeros where it does not carry the load.
    pub columns: Vec<[f64; BODY]>,
    /// Error that may have the same sign in all samples, by channel.
    pub common: Vec<f64>,
    /// Acceleration of the link less gravity, in its axes, m/s²; zeros where it does not carry the load.
    pub up: Vector3<f64>,
}

/// One measured number.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name in messages.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Standard deviation of its samples.
    pub sigma: f64,
    /// Standard deviation that its offset has before.
    pub offset_sigma: f64,
}

/// Starting point of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Knowledge {
    /// The channels.
    pub channels: Vec<Channel>,
    /// The link's inertia, of the model.
    pub inertia: Inertia,
    /// Standard deviation of its mass, kg.
    pub mass_sigma: f64,
    /// That of its centre of mass, m.
    pub centre_sigma: f64,
    /// The six channels are a sensor's, whose axes may be turned.
    pub sensor: bool,
    /// Standard deviation of the angles by which they are, rad.
    pub angle_sigma: f64,
}

/// Result of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Offsets by channel: measured without any load.
    pub offset: Vec<Value>,
    /// m, kg.
    pub mass: Value,
    /// c, m (3).
    pub centre: [Value; 3],
    /// Inertia about c, kg·m²: xx, xy, yy, xz, yz, zz.
    pub central: [Value; 6],
    /// Angles about x, y, z by which a sensor's axes are turned, rad; zeros for joints.
    pub angle: [Value; ANGLES],
    /// The link's inertia with what was found.
    pub inertia: Inertia,
    /// Parameters that stayed at their prior, by name.
    pub undetermined: Vec<String>,
    /// Ratio of the largest to the smallest singular value of what was determined, in units of priors.
    pub condition: f64,
    /// Largest angle between two directions of gravity in the link's axes, rad.
    pub turned: f64,
    /// RMS over all channels of one unit, as configured, with offsets alone, and with everything; on parts
    /// that were held out but for the first. By unit.
    pub rms: Vec<(&'static str, [f64; 3])>,
    /// Samples that were used, and share that was not since something else acted.
    pub samples: usize,
    /// Share of samples left out.
    pub left_out: f64,
}

impl Load {
    /// Held-out errors with what was found are not larger than with offsets alone.
    #[must_use]
    pub fn helps(&self) -> bool {
        let ratio = self
            .rms
            .iter()
            .map(|(_, [_, tared, found])| found / tared.max(1e-12));
        ratio.fold(1.0, |all, r| all * r) <= 1.0
    }
}

/// Identifies a load from samples of a log, in their order, over so many seconds.
///
/// # Errors
/// Too few samples; samples of which a large part contradicts the others.
pub fn identify(known: &Knowledge, samples: &[Sample], seconds: f64) -> Result<Load, Problem> {
    if samples.len() < FEWEST {
        let reason = format!("{} samples", samples.len());
        return Err(Problem::new(reason, format!("{FEWEST} or more")));
    }
    fit::Fit::new(known, samples, seconds).run()
}
