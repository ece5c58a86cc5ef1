//! The sensors' file: TOML.

use super::request::ContactRecord;
use dynamics::{Model, Se3};
use problem::{Problem, line_at};
use serde::Deserialize;
use toml::Spanned;
use whole_body::{
    ContactProblem, FtSensorParameters, Hypothesis, ImuParameters, LastingErrors, MotionSource,
    Place, Residual, Weighting, WholeBody, WholeBodyError, WholeBodyParameters,
};

/// Sensors of a robot and their places; docs/whole-body-files.md describes the format.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SensorsFile {
    /// The IMU; this or `fixed_base`.
    #[serde(default)]
    pub(crate) imu: Option<ImuRecord>,
    /// A link held by a stand; this or `imu`.
    #[serde(default)]
    pub(crate) fixed_base: Option<FixedBaseRecord>,
    /// The F/T sensors.
    #[serde(default, rename = "ft_sensor")]
    pub(crate) ft_sensors: Vec<FtSensorRecord>,
    /// Contacts of cases that give none.
    #[serde(default, rename = "contact")]
    pub(crate) contacts: Vec<Spanned<ContactRecord>>,
    /// Least squares.
    #[serde(default)]
    pub(crate) least_squares: LeastSquaresRecord,
    /// Standard deviation of every joint's acceleration, rad/s².
    #[serde(default)]
    pub sigma_ddq_rad_per_s2: f64,
    /// Standard deviation of the model's masses, per cent.
    #[serde(default)]
    pub(crate) model_sigma_per_cent: f64,
    /// The text and the file's name, for messages.
    #[serde(skip)]
    text: String,
    #[serde(skip)]
    file: String,
}

/// `[imu]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImuRecord {
    frame: Spanned<String>,
    #[serde(default)]
    xyz_m: [f64; 3],
    #[serde(default)]
    rpy_deg: [f64; 3],
    #[serde(default)]
    angular_acceleration: AngularAcceleration,
    #[serde(default)]
    sigma_m_per_s2: f64,
    #[serde(default)]
    sigma_rad_per_s2: f64,
}

impl ImuRecord {
    /// Whether the gyro's derivative is taken as zero.
    #[must_use]
    pub(crate) fn neglects_angular_acceleration(&self) -> bool {
        self.angular_acceleration == AngularAcceleration::Neglect
    }
}

#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
enum AngularAcceleration {
    #[default]
    Given,
    Neglect,
}

/// `[fixed_base]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FixedBaseRecord {
    link: Spanned<String>,
    #[serde(default = "standard_gravity")]
    gravity_m_per_s2: [f64; 3],
}

fn standard_gravity() -> [f64; 3] {
    [0.0, 0.0, -dynamics::GRAVITY]
}

/// `[[ft_sensor]]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FtSensorRecord {
    /// The sensor's name.
    pub(crate) name: Spanned<String>,
    frame: Spanned<String>,
    #[serde(default)]
    cut: Option<Spanned<String>>,
    #[serde(default)]
    xyz_m: [f64; 3],
    #[serde(default)]
    rpy_deg: [f64; 3],
    /// 1: it measures the wrench of the part beyond on the part before; -1: the reverse.
    #[serde(default = "one", deserialize_with = "sign")]
    pub(crate) sign: i8,
    #[serde(default, rename = "sigma_N")]
    sigma_force: f64,
    #[serde(default, rename = "sigma_Nm")]
    sigma_torque: f64,
}

impl FtSensorRecord {
    /// The first link beyond the sensor.
    fn cut(&self) -> &Spanned<String> {
        self.cut.as_ref().unwrap_or(&self.frame)
    }
}

fn one() -> i8 {
    1
}

fn sign<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<i8, D::Error> {
    match i64::deserialize(deserializer)? {
        1 => Ok(1),
        -1 => Ok(-1),
        other => Err(serde::de::Error::custom(format!(
            "sign {other}; allowed: 1 or -1"
        ))),
    }
}

/// `[least_squares]`
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LeastSquaresRecord {
    #[serde(default)]
    weights: Option<Spanned<Weights>>,
    #[serde(default)]
    residual: Rest,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Weights {
    Unit,
    Expected,
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Rest {
    #[default]
    Stays,
    HandedOn,
}

impl SensorsFile {
    /// Reads the file. `file` is only used in messages.
    ///
    /// # Errors
    /// The first problem, with file and line.
    pub(crate) fn parse(text: &str, file: &str) -> Result<Self, Problem> {
        let mut parsed: Self = toml::from_str(text).map_err(|e| {
            let start = e.span().map_or(0, |span| span.start);
            Problem::new(e.message(), "").at(file, line_at(text, start))
        })?;
        parsed.text = text.to_owned();
        parsed.file = file.to_owned();
        let problem = match (&parsed.imu, &parsed.fixed_base) {
            (Some(_), Some(_)) => Problem::new("[imu] and [fixed_base] are both given", "one"),
            (None, None) => Problem::new(
                "neither [imu] nor [fixed_base]",
                "one of them: without, acceleration and weight are unknown",
            ),
            _ => return Ok(parsed),
        };
        Err(problem.at(file, 0))
    }

    /// The file's own contacts.
    pub(crate) fn contacts(&self) -> Vec<ContactRecord> {
        self.contacts.iter().map(|c| c.get_ref().clone()).collect()
    }

    /// Checks sensors and contacts against the robot, whatever the cases.
    ///
    /// # Errors
    /// The first mistake, with file and line.
    pub(crate) fn check(&self, model: &Model, joints: &[String]) -> Result<(), Problem> {
        let mut contacts = Vec::new();
        for c in &self.contacts {
            let contact = c.get_ref().parameters();
            contacts.push(contact.map_err(|p| p.at(&self.file, self.line(c.span())))?);
        }
        let hypothesis = Hypothesis {
            name: String::new(),
            contacts,
        };
        match WholeBody::new(model, &self.parameters(joints, hypothesis)?) {
            // Cases may bring contacts of their own.
            Err(WholeBodyError::Contacts { .. }) if self.contacts.is_empty() => Ok(()),
            Err(e) => Err(self.refusal(&e)),
            Ok(_) => Ok(()),
        }
    }

    /// A refusal of sensors or contacts, at its line in this file.
    fn refusal(&self, error: &WholeBodyError) -> Problem {
        use WholeBodyError as E;
        let line = match error {
            E::UnknownLink(_, link) => self.line_of_link(link),
            E::SensorOnRoot(name) | E::SensorNamedTwice(name) | E::SameCut(_, name, _) => {
                let mut named = self.ft_sensors.iter().rev();
                let sensor = named.find(|s| s.name.get_ref() == name);
                sensor.map_or(0, |s| self.line(s.name.span()))
            }
            E::Contacts {
                problem: ContactProblem::UnknownLink(link),
                ..
            } => {
                let on = |c: &&Spanned<ContactRecord>| c.get_ref().link == *link;
                self.contacts
                    .iter()
                    .find(on)
                    .map_or(0, |c| self.line(c.span()))
            }
            E::Contacts { .. } => self.contacts.first().map_or(0, |c| self.line(c.span())),
            E::SingularWeights(_) => {
                let weights = self.least_squares.weights.as_ref();
                weights.map_or(0, |w| self.line(w.span()))
            }
            _ => 0,
        };
        error.problem().at(&self.file, line)
    }

    /// Line of the first key that names a link.
    fn line_of_link(&self, link: &str) -> usize {
        let imu = self.imu.iter().map(|imu| &imu.frame);
        let stand = self.fixed_base.iter().map(|stand| &stand.link);
        let sensors = self.ft_sensors.iter().flat_map(|s| [s.cut(), &s.frame]);
        let mut places = imu.chain(stand).chain(sensors);
        let named = places.find(|place| place.get_ref() == link);
        named.map_or(0, |place| self.line(place.span()))
    }

    fn line(&self, span: std::ops::Range<usize>) -> usize {
        line_at(&self.text, span.start)
    }

    /// The estimator's parameters.
    ///
    /// # Errors
    /// Neither IMU nor fixed base.
    pub(crate) fn parameters(
        &self,
        joints: &[String],
        hypothesis: Hypothesis,
    ) -> Result<WholeBodyParameters, Problem> {
        let place = |link: &str, xyz: [f64; 3], rpy_deg: [f64; 3]| Place {
            link: link.to_owned(),
            placement: Se3::from_xyz_rpy(xyz, rpy_deg.map(f64::to_radians)),
        };
        let ft_sensor = |s: &FtSensorRecord| FtSensorParameters {
            name: s.name.get_ref().clone(),
            cut: s.cut().get_ref().clone(),
            frame: place(s.frame.get_ref(), s.xyz_m, s.rpy_deg),
            sigma_force: s.sigma_force,
            sigma_torque: s.sigma_torque,
            lasting: LastingErrors::default(),
        };
        let source = match (&self.imu, &self.fixed_base) {
            (Some(imu), _) => MotionSource::Imu(ImuParameters {
                frame: place(imu.frame.get_ref(), imu.xyz_m, imu.rpy_deg),
                sigma_accelerometer: imu.sigma_m_per_s2,
                lasting_accelerometer: 0.0,
                sigma_angular_acceleration: imu.sigma_rad_per_s2,
            }),
            (None, Some(fixed)) => MotionSource::Fixed {
                link: fixed.link.get_ref().clone(),
                gravity: fixed.gravity_m_per_s2.into(),
            },
            (None, None) => {
                return Err(Problem::new(
                    "neither [imu] nor [fixed_base]",
                    "one of them",
                ));
            }
        };
        Ok(WholeBodyParameters {
            joints: joints.to_vec(),
            sigma_ddq: vec![self.sigma_ddq_rad_per_s2; joints.len()],
            ft_sensors: self.ft_sensors.iter().map(ft_sensor).collect(),
            source,
            hypotheses: vec![hypothesis],
            weighting: match self.least_squares.weights.as_ref().map(Spanned::get_ref) {
                None | Some(Weights::Unit) => Weighting::Unit,
                Some(Weights::Expected) => Weighting::Expected,
            },
            residual: match self.least_squares.residual {
                Rest::Stays => Residual::Stays,
                Rest::HandedOn => Residual::HandedOn,
            },
            sigma_model: self.model_sigma_per_cent / 100.0,
        })
    }
}
