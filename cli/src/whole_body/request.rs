//! The request: joints, contacts and instants.

use problem::Problem;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use whole_body::{ContactKind, ContactParameters};

/// Request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cases {
    /// Names of the joints, in the order of `q dq ddq tau`; all, in the model's order, if left out.
    /// A mimic joint that is named here is taken as independent.
    #[serde(default)]
    pub(crate) joints: Option<Vec<String>>,
    /// Contacts of cases that give none; those of the sensors' file if left out.
    #[serde(default)]
    pub(crate) contacts: Option<Vec<ContactRecord>>,
    /// Instants.
    pub(crate) cases: Vec<Case>,
}

/// One instant.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Case {
    /// `q`, rad or m, one per joint.
    pub(crate) q: Vec<f64>,
    /// `dq`, rad/s; zero if left out.
    #[serde(default)]
    pub(crate) dq: Option<Vec<f64>>,
    /// `ddq`, rad/s²; zero if left out.
    #[serde(default)]
    pub(crate) ddq: Option<Vec<f64>>,
    /// Angular velocity in the IMU's axes, rad/s (3).
    #[serde(default)]
    pub(crate) gyro: Option<[f64; 3]>,
    /// Acceleration minus gravity in the IMU's axes, m/s² (3).
    #[serde(default)]
    pub(crate) accelerometer: Option<[f64; 3]>,
    /// Angular acceleration in the IMU's axes, rad/s² (3).
    #[serde(default)]
    pub(crate) gyro_derivative: Option<[f64; 3]>,
    /// Reading of every F/T sensor by name, N and N·m, force first (6).
    #[serde(default)]
    pub(crate) ft: Readings,
    /// Contacts.
    #[serde(default)]
    pub(crate) contacts: Option<Vec<ContactRecord>>,
}

/// Readings by the sensors' names, none of them twice.
#[derive(Clone, Debug, Default)]
pub(crate) struct Readings(pub(crate) Vec<(String, [f64; 6])>);

impl<'de> Deserialize<'de> for Readings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Each;
        impl<'de> Visitor<'de> for Each {
            type Value = Readings;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("an object of six numbers for each F/T sensor's name")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Readings, A::Error> {
                let mut all = Vec::<(String, [f64; 6])>::new();
                while let Some((name, reading)) = map.next_entry::<String, _>()? {
                    if all.iter().any(|(other, _)| *other == name) {
                        let message = format!("F/T sensor \"{name}\" is named twice");
                        return Err(serde::de::Error::custom(message));
                    }
                    all.push((name, reading));
                }
                Ok(Readings(all))
            }
        }
        deserializer.deserialize_map(Each)
    }
}

/// A contact in a file.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub(crate) struct ContactRecord {
    /// The link that is touched.
    pub(crate) link: String,
    /// Its unknowns.
    #[serde(rename = "type")]
    pub(crate) kind: ContactType,
    /// The point that is touched, in the link's frame, m; its origin if left out.
    #[serde(default)]
    pub(crate) point_m: [f64; 3],
    /// Direction of the force in the link's axes, of any length, for `known_direction` alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) direction: Option<[f64; 3]>,
}

/// Names of [`ContactKind`]s in files.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ContactType {
    /// Force and torque.
    FullWrench,
    /// A force through the point.
    PureForce,
    /// A force through the point along a direction.
    KnownDirection,
    /// Nothing touches the part that the link belongs to.
    None,
}

impl ContactRecord {
    /// The contact.
    ///
    /// # Errors
    /// A direction where none belongs, or a missing one.
    pub(crate) fn parameters(&self) -> Result<ContactParameters, Problem> {
        let refuse = |reason: &str, allowed: &str| {
            Err(Problem::new(reason, allowed).of(format!("contact on link \"{}\"", self.link)))
        };
        let kind = match (self.kind, self.direction) {
            (ContactType::KnownDirection, Some(d)) => ContactKind::KnownDirection(d.into()),
            (ContactType::KnownDirection, None) => {
                let reason = "type \"known_direction\" needs a direction";
                return refuse(reason, "three numbers, not all zero");
            }
            (_, Some(_)) => {
                return refuse("a direction", "with type \"known_direction\" only");
            }
            (ContactType::FullWrench, None) => ContactKind::FullWrench,
            (ContactType::PureForce, None) => ContactKind::PureForce,
            (ContactType::None, None) => ContactKind::Nothing,
        };
        Ok(ContactParameters {
            link: self.link.clone(),
            point: self.point_m.into(),
            kind,
        })
    }
}
