//! The report that is printed.

use super::request::ContactRecord;
use problem::Problem;
use serde::Serialize;

/// Results of all cases.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Report {
    /// Names of the joints, in the order of every per-joint array.
    pub(super) joints: Vec<String>,
    /// Odd but usable parts of the URDF, each with file and line.
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "as_texts")]
    pub(super) warnings: Vec<Problem>,
    /// One per requested case.
    pub(super) cases: Vec<CaseReport>,
}

/// Torques and wrenches of one instant.
#[derive(Clone, Debug, Serialize)]
pub(super) struct CaseReport {
    /// Joint torques, N·m (N for prismatic joints).
    pub(super) tau: Vec<f64>,
    /// Their standard deviations.
    pub(super) sigma: Vec<f64>,
    /// Contacts with their wrenches, in the order of the request.
    pub(super) contacts: Vec<ContactReport>,
    /// The part with the root, then the part beyond each sensor, in the order of the sensors' file.
    pub(super) parts: Vec<PartReport>,
}

/// A contact's wrench.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ContactReport {
    /// The requested contact.
    #[serde(flatten)]
    pub(super) contact: ContactRecord,
    /// Wrench that the environment applies to the link, at the point, in the link's axes.
    pub(super) wrench: [f64; 6],
    /// Standard deviation of each component.
    pub(super) sigma: [f64; 6],
}

/// A part of the robot between F/T sensors.
#[derive(Clone, Debug, Serialize)]
pub(super) struct PartReport {
    /// The sensor that cuts it off; null for the part with the root.
    pub(super) beyond: Option<String>,
    /// The part's first link, in whose frame its wrenches are.
    pub(super) first_link: String,
    /// All its links.
    pub(super) links: Vec<String>,
    /// Unknowns of its contacts.
    pub(super) unknowns: u32,
    /// Sum of all external wrenches that motion and sensors require.
    pub(super) net: [f64; 6],
    /// Part of it that the contacts do not explain.
    pub(super) residual: [f64; 6],
    /// Expected standard deviation of each component of the residual.
    pub(super) residual_sigma: [f64; 6],
}

fn as_texts<S: serde::Serializer>(problems: &[Problem], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(problems.iter().map(Problem::to_string))
}
