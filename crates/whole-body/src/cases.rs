//! Evaluation of instants given as records: what `torquectl whole-body` prints, so that the
//! estimator can be checked against another library. docs/whole-body.md describes the formats.

mod sensors_file;

pub use sensors_file::SensorsFile;

use crate::estimator::{WholeBody, WholeBodyInput};
use crate::parameters::{ContactKind, ContactParameters, Hypothesis, WholeBodyParameters};
use dynamics::{Base, ImuMotion, Model, UrdfOptions};
use nalgebra::Vector3;
use robot_state::Wrench;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// Request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cases {
    /// Names of the joints, in the order of `q dq ddq tau`; all, in the model's order, if left out.
    /// A mimic joint that is named here is taken as independent.
    #[serde(default)]
    pub joints: Option<Vec<String>>,
    /// Contacts of cases that give none; those of the sensors' file if left out.
    #[serde(default)]
    pub contacts: Option<Vec<ContactRecord>>,
    /// Instants.
    pub cases: Vec<Case>,
}

/// One instant.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// `q`, rad or m, one per joint.
    pub q: Vec<f64>,
    /// `dq`, rad/s; zero if left out.
    #[serde(default)]
    pub dq: Option<Vec<f64>>,
    /// `ddq`, rad/s²; zero if left out.
    #[serde(default)]
    pub ddq: Option<Vec<f64>>,
    /// Angular velocity in the IMU's axes, rad/s (3).
    #[serde(default)]
    pub gyro: Option<[f64; 3]>,
    /// Acceleration minus gravity in the IMU's axes, m/s² (3).
    #[serde(default)]
    pub accelerometer: Option<[f64; 3]>,
    /// Angular acceleration in the IMU's axes, rad/s² (3).
    #[serde(default)]
    pub gyro_derivative: Option<[f64; 3]>,
    /// Reading of every F/T sensor by name, N and N·m, force first (6).
    #[serde(default)]
    pub ft: Readings,
    /// Contacts.
    #[serde(default)]
    pub contacts: Option<Vec<ContactRecord>>,
}

/// Readings by the sensors' names, none of them twice.
#[derive(Clone, Debug, Default)]
pub struct Readings(pub Vec<(String, [f64; 6])>);

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

/// A contact, as files give it.
#[derive(Clone, Debug, Deserialize, Serialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ContactRecord {
    /// The link that is touched.
    pub link: String,
    /// What is unknown of it.
    #[serde(rename = "type")]
    pub kind: ContactType,
    /// The point that is touched, in the link's frame, m; its origin if left out.
    #[serde(default)]
    pub point_m: [f64; 3],
    /// Direction of the force in the link's axes, of any length, for `known_direction` alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
}

/// Names of [`ContactKind`]s in files.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum ContactType {
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
    /// A direction where none belongs, or none where one does.
    pub fn parameters(&self) -> Result<ContactParameters, String> {
        let at = |what: &str| format!("contact on link \"{}\": {what}", self.link);
        let kind = match (self.kind, self.direction) {
            (ContactType::KnownDirection, Some(d)) => ContactKind::KnownDirection(d.into()),
            (ContactType::KnownDirection, None) => {
                return Err(at(
                    "type \"known_direction\" needs a direction; allowed: three numbers, not all zero",
                ));
            }
            (_, Some(_)) => {
                return Err(at(
                    "a direction; allowed: with type \"known_direction\" only",
                ));
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

/// Answer.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Names of the joints, in the order of every per-joint array.
    pub joints: Vec<String>,
    /// What the URDF reader found odd.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Answers, one per case.
    pub cases: Vec<CaseReport>,
}

/// Torques and wrenches of one instant.
#[derive(Clone, Debug, Serialize)]
pub struct CaseReport {
    /// Joint torques, N·m (N for sliding joints).
    pub tau: Vec<f64>,
    /// Their standard deviations.
    pub sigma: Vec<f64>,
    /// Contacts with their wrenches, in the order of the request.
    pub contacts: Vec<ContactReport>,
    /// The part with the root, then the part beyond each sensor, in the order of the sensors' file.
    pub parts: Vec<PartReport>,
}

/// A contact's wrench.
#[derive(Clone, Debug, Serialize)]
pub struct ContactReport {
    /// The contact as asked for.
    #[serde(flatten)]
    pub contact: ContactRecord,
    /// Wrench that the environment applies to the link, at the point, in the link's axes.
    pub wrench: [f64; 6],
    /// Standard deviation of each component.
    pub sigma: [f64; 6],
}

/// A part of the robot between F/T sensors.
#[derive(Clone, Debug, Serialize)]
pub struct PartReport {
    /// The sensor that cuts it off; null for the part with the root.
    pub beyond: Option<String>,
    /// The part's first link: its wrenches are told in that link's frame.
    pub first_link: String,
    /// All its links.
    pub links: Vec<String>,
    /// Unknowns of its contacts.
    pub unknowns: u32,
    /// Sum of all wrenches from outside, as motion and sensors demand it.
    pub net: [f64; 6],
    /// What of it the contacts cannot explain.
    pub residual: [f64; 6],
    /// Expected standard deviation of each component of the residual.
    pub residual_sigma: [f64; 6],
}

/// Evaluates cases on a URDF.
///
/// # Errors
/// What is wrong and what is allowed.
pub fn evaluate(
    urdf: &str,
    urdf_file: &str,
    sensors: &SensorsFile,
    request: &Cases,
) -> Result<Report, String> {
    let options = UrdfOptions {
        base: Base::Floating,
        independent: request.joints.clone().unwrap_or_default(),
    };
    let model = Model::from_urdf_with(urdf, urdf_file, &options).map_err(|e| e.to_string())?;
    let names = model.joint_names().map(str::to_owned);
    let joints = request.joints.clone().unwrap_or_else(|| names.collect());
    let evaluation = Evaluation {
        model: &model,
        sensors,
        request,
        joints,
    };
    let mut cases = Vec::new();
    for (index, case) in request.cases.iter().enumerate() {
        let report = evaluation.case(case);
        cases.push(report.map_err(|e| format!("cases[{index}]: {e}"))?);
    }
    Ok(Report {
        joints: evaluation.joints,
        warnings: model.warnings().to_vec(),
        cases,
    })
}

struct Evaluation<'a> {
    model: &'a Model,
    sensors: &'a SensorsFile,
    request: &'a Cases,
    joints: Vec<String>,
}

impl Evaluation<'_> {
    fn case(&self, case: &Case) -> Result<CaseReport, String> {
        let contacts = (case.contacts.as_ref())
            .or(self.request.contacts.as_ref())
            .unwrap_or(&self.sensors.contacts);
        let parameters = self.parameters(contacts)?;
        let imu = self.imu(case)?;
        let ft = self.readings(case)?;
        let q = self.joint_vector("q", Some(&case.q))?;
        let dq = self.joint_vector("dq", case.dq.as_deref())?;
        let ddq = self.joint_vector("ddq", case.ddq.as_deref())?;
        let mut whole_body = WholeBody::new(self.model, &parameters).map_err(|e| e.to_string())?;
        let input = WholeBodyInput {
            q: &q,
            dq: &dq,
            ddq: &ddq,
            ft: &ft,
            imu,
        };
        if !whole_body.update(&input).valid {
            return Err(undetermined(&whole_body));
        }
        Ok(self.report(&whole_body, contacts))
    }

    fn parameters(&self, contacts: &[ContactRecord]) -> Result<WholeBodyParameters, String> {
        let contacts = contacts.iter().map(ContactRecord::parameters);
        let hypothesis = Hypothesis {
            name: String::new(),
            contacts: contacts.collect::<Result<_, _>>()?,
        };
        self.sensors.parameters(&self.joints, hypothesis)
    }

    fn joint_vector(&self, key: &str, x: Option<&[f64]>) -> Result<Vec<f64>, String> {
        let n = self.joints.len();
        match x {
            None => Ok(vec![0.0; n]),
            Some(x) if x.len() == n => Ok(x.to_vec()),
            Some(x) => Err(format!(
                "{key}: {} numbers; allowed: {n}, one per joint",
                x.len()
            )),
        }
    }

    fn imu(&self, case: &Case) -> Result<ImuMotion, String> {
        let given = [
            ("gyro", case.gyro),
            ("accelerometer", case.accelerometer),
            ("gyro_derivative", case.gyro_derivative),
        ];
        let Some(imu) = &self.sensors.imu else {
            return match given.iter().find(|(_, x)| x.is_some()) {
                Some((key, _)) => Err(format!(
                    "{key}: the base is fixed; allowed: with [imu] in the sensors' file only"
                )),
                None => Ok(ImuMotion {
                    angular_velocity: Vector3::zeros(),
                    angular_acceleration: Vector3::zeros(),
                    proper_acceleration: Vector3::zeros(),
                }),
            };
        };
        let need = |(key, x): (&str, Option<[f64; 3]>)| {
            let missing = || format!("{key} is missing; allowed: three numbers, in the IMU's axes");
            x.map(Vector3::from).ok_or_else(missing)
        };
        let angular_acceleration = match imu.neglects_angular_acceleration() {
            true => Vector3::zeros(),
            false => need(given[2])?,
        };
        Ok(ImuMotion {
            angular_velocity: need(given[0])?,
            angular_acceleration,
            proper_acceleration: need(given[1])?,
        })
    }

    /// Readings in the order of the sensors' file, as what lies beyond applies to what lies before.
    fn readings(&self, case: &Case) -> Result<Vec<Wrench>, String> {
        let sensors = &self.sensors.ft_sensors;
        let known = |name: &str| sensors.iter().any(|s| s.name == name);
        if let Some((name, _)) = case.ft.0.iter().find(|(name, _)| !known(name)) {
            return Err(format!("ft: no F/T sensor \"{name}\" in the sensors' file"));
        }
        let find = |s: &sensors_file::FtSensorRecord| {
            let reading = case.ft.0.iter().find(|(name, _)| *name == s.name);
            let missing = || format!("ft: the reading of F/T sensor \"{}\" is missing", s.name);
            let (_, [a, b, c, d, e, f]) = reading.ok_or_else(missing)?;
            let sign = f64::from(s.sign);
            Ok(Wrench {
                force: [a, b, c].map(|x| sign * x),
                torque: [d, e, f].map(|x| sign * x),
            })
        };
        sensors.iter().map(find).collect()
    }

    fn report(&self, whole_body: &WholeBody, contacts: &[ContactRecord]) -> CaseReport {
        let estimate = whole_body.estimate();
        let six = |w: &Wrench| {
            let ([a, b, c], [d, e, f]) = (w.force, w.torque);
            [a, b, c, d, e, f]
        };
        let contact = |(contact, told): (&ContactRecord, &crate::ContactEstimate)| ContactReport {
            contact: contact.clone(),
            wrench: six(&told.wrench),
            sigma: six(&told.sigma),
        };
        let links = whole_body.part_links();
        let part = |(i, part): (usize, &crate::PartEstimate)| PartReport {
            beyond: i
                .checked_sub(1)
                .map(|s| self.sensors.ft_sensors[s].name.clone()),
            first_link: links[i].first().cloned().unwrap_or_default(),
            links: links[i].clone(),
            unknowns: part.unknowns,
            net: six(&part.net),
            residual: six(&part.residual),
            residual_sigma: six(&part.residual_sigma),
        };
        CaseReport {
            tau: estimate.tau.clone(),
            sigma: estimate.sigma.clone(),
            contacts: contacts
                .iter()
                .zip(&estimate.contacts)
                .map(contact)
                .collect(),
            parts: estimate.parts.iter().enumerate().map(part).collect(),
        }
    }
}

/// Why the last update was not valid.
fn undetermined(whole_body: &WholeBody) -> String {
    let parts = whole_body.estimate().parts.iter();
    let poor = parts
        .zip(whole_body.part_labels())
        .find(|(p, _)| p.rank < p.unknowns);
    match poor {
        Some((part, label)) => format!(
            "{label}: at this pose the contacts depend on one another: of {} unknowns only {} can \
             be told apart; allowed: other contacts or another pose",
            part.unknowns, part.rank
        ),
        None => "a number is not finite; allowed: finite numbers".to_owned(),
    }
}
