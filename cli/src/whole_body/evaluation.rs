//! The estimator run on one instant after another: from a request to its report.

use super::report::{CaseReport, ContactReport, PartReport, Report};
use super::request::{Case, Cases, ContactRecord};
use super::sensors_file::{FtSensorRecord, SensorsFile};
use dynamics::{Base, ImuMotion, Model, UrdfOptions};
use nalgebra::Vector3;
use problem::Problem;
use robot_state::Wrench;
use whole_body::{
    ContactEstimate, Hypothesis, PartEstimate, WholeBody, WholeBodyInput, WholeBodyParameters,
};

/// Evaluates cases on a URDF: a text and a record, each with the name of its file.
pub(super) fn evaluate(
    (urdf, urdf_file): (&str, &str),
    sensors: &SensorsFile,
    (request, request_file): (&Cases, &str),
) -> Result<Report, Problem> {
    let options = UrdfOptions {
        base: Base::Floating,
        independent: request.joints.clone().unwrap_or_default(),
    };
    let model = Model::from_urdf_with(urdf, urdf_file, &options)?;
    let names = model.joint_names().map(str::to_owned);
    let joints = request.joints.clone().unwrap_or_else(|| names.collect());
    sensors.check(&model, &joints)?;
    let evaluation = Evaluation {
        model: &model,
        sensors,
        own_contacts: sensors.contacts(),
        request,
        joints,
    };
    let mut cases = Vec::new();
    for (index, case) in request.cases.iter().enumerate() {
        let report = evaluation.case(case);
        let in_request = |problem: Problem| problem.of(format!("cases[{index}]"));
        cases.push(report.map_err(|problem| in_request(problem).or_at(request_file, 0))?);
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
    /// Contacts of the sensors' file.
    own_contacts: Vec<ContactRecord>,
    request: &'a Cases,
    joints: Vec<String>,
}

impl Evaluation<'_> {
    fn case(&self, case: &Case) -> Result<CaseReport, Problem> {
        let contacts = (case.contacts.as_ref())
            .or(self.request.contacts.as_ref())
            .unwrap_or(&self.own_contacts);
        let parameters = self.parameters(contacts)?;
        let imu = self.imu(case)?;
        let ft = self.readings(case)?;
        let q = self.joint_vector("q", Some(&case.q))?;
        let dq = self.joint_vector("dq", case.dq.as_deref())?;
        let ddq = self.joint_vector("ddq", case.ddq.as_deref())?;
        let mut whole_body = WholeBody::new(self.model, &parameters).map_err(|e| e.problem())?;
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

    fn parameters(&self, contacts: &[ContactRecord]) -> Result<WholeBodyParameters, Problem> {
        let contacts = contacts.iter().map(ContactRecord::parameters);
        let hypothesis = Hypothesis {
            name: String::new(),
            contacts: contacts.collect::<Result<_, _>>()?,
        };
        self.sensors.parameters(&self.joints, hypothesis)
    }

    fn joint_vector(&self, key: &str, x: Option<&[f64]>) -> Result<Vec<f64>, Problem> {
        let n = self.joints.len();
        match x {
            None => Ok(vec![0.0; n]),
            Some(x) if x.len() == n => Ok(x.to_vec()),
            Some(x) => Err(Problem::new(
                format!("{key}: {} numbers", x.len()),
                format!("{n}, one per joint"),
            )),
        }
    }

    fn imu(&self, case: &Case) -> Result<ImuMotion, Problem> {
        let given = [
            ("gyro", case.gyro),
            ("accelerometer", case.accelerometer),
            ("gyro_derivative", case.gyro_derivative),
        ];
        let Some(imu) = &self.sensors.imu else {
            return match given.iter().find(|(_, x)| x.is_some()) {
                Some((key, _)) => Err(Problem::new(
                    format!("{key}: the base is fixed"),
                    "with [imu] in the sensors' file only",
                )),
                None => Ok(ImuMotion {
                    angular_velocity: Vector3::zeros(),
                    angular_acceleration: Vector3::zeros(),
                    proper_acceleration: Vector3::zeros(),
                }),
            };
        };
        let need = |(key, x): (&str, Option<[f64; 3]>)| {
            let reason = || format!("{key} is missing");
            let missing = || Problem::new(reason(), "three numbers, in the IMU's axes");
            x.map(Vector3::from).ok_or_else(missing)
        };
        let angular_acceleration = if imu.neglects_angular_acceleration() {
            Vector3::zeros()
        } else {
            need(given[2])?
        };
        Ok(ImuMotion {
            angular_velocity: need(given[0])?,
            angular_acceleration,
            proper_acceleration: need(given[1])?,
        })
    }

    /// Readings in the order of the sensors' file, as the part beyond applies to the part before.
    fn readings(&self, case: &Case) -> Result<Vec<Wrench>, Problem> {
        let sensors = &self.sensors.ft_sensors;
        let known = |name: &str| sensors.iter().any(|s| s.name.get_ref() == name);
        if let Some((name, _)) = case.ft.0.iter().find(|(name, _)| !known(name)) {
            let reason = format!("ft: no F/T sensor \"{name}\" in the sensors' file");
            return Err(Problem::new(reason, ""));
        }
        let find = |s: &FtSensorRecord| {
            let reading = case.ft.0.iter().find(|(name, _)| name == s.name.get_ref());
            let name = s.name.get_ref();
            let reason = || format!("ft: the reading of F/T sensor \"{name}\" is missing");
            let missing = || Problem::new(reason(), "");
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
        let contact = |(contact, estimate): (&ContactRecord, &ContactEstimate)| ContactReport {
            contact: contact.clone(),
            wrench: six(&estimate.wrench),
            sigma: six(&estimate.sigma),
        };
        let links = whole_body.part_links();
        let part = |(i, part): (usize, &PartEstimate)| PartReport {
            beyond: i
                .checked_sub(1)
                .map(|s| self.sensors.ft_sensors[s].name.get_ref().clone()),
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

/// Reason why the last update was not valid.
fn undetermined(whole_body: &WholeBody) -> Problem {
    let parts = whole_body.estimate().parts.iter();
    let poor = parts
        .zip(whole_body.part_labels())
        .find(|(p, _)| p.rank < p.unknowns);
    match poor {
        Some((part, label)) => Problem::new(
            format!(
                "{label}: at this pose the contacts depend on one another: of {} unknowns only {} \
                 can be distinguished",
                part.unknowns, part.rank
            ),
            "other contacts or another pose",
        ),
        None => Problem::new(
            "q, dq, ddq, gyro, accelerometer, ft: too large, the result is not finite",
            "",
        ),
    }
}
