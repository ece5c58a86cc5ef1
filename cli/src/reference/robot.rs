//! The robot whose torques are computed: URDF, payloads, sensors, contacts.

use super::torques::Estimated;
use crate::whole_body::request::ContactRecord;
use crate::whole_body::sensors_file::SensorsFile;
use dynamics::{Base, Inertia, Model, UrdfOptions};
use nalgebra::Matrix3;
use problem::Problem;
use robot_config::FilterGains;
use std::str::FromStr;
use whole_body::{Hypothesis, WholeBodyParameters};

/// A payload fixed to a link.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Payload {
    link: String,
    mass: f64,
    centre: [f64; 3],
}

impl Payload {
    /// The link that carries it.
    pub(crate) fn link(&self) -> &str {
        &self.link
    }
}

impl FromStr for Payload {
    type Err = Problem;

    fn from_str(text: &str) -> Result<Self, Problem> {
        let allowed = || {
            let reason = format!("payload {text:?}");
            Problem::new(
                reason,
                "LINK=kg or LINK=kg,x,y,z with a mass > 0 and lengths in m",
            )
        };
        let (link, numbers) = text.split_once('=').ok_or_else(allowed)?;
        let numbers: Option<Vec<f64>> = numbers
            .split(',')
            .map(|x| x.trim().parse().ok().filter(|x: &f64| x.is_finite()))
            .collect();
        let (mass, centre) = match numbers.as_deref() {
            Some([mass]) => (*mass, [0.0; 3]),
            Some([mass, x, y, z]) => (*mass, [*x, *y, *z]),
            _ => return Err(allowed()),
        };
        if mass <= 0.0 || link.is_empty() {
            return Err(allowed());
        }
        Ok(Self {
            link: link.to_owned(),
            mass,
            centre,
        })
    }
}

/// Standard deviation of the model's masses where no sensors' file states one, per cent.
const MODEL_SIGMA_PER_CENT: f64 = 2.0;
/// Rotational inertia of a payload, kg·m²: a point mass, but not singular.
const POINT_INERTIA: f64 = 1e-9;

/// Model and sensors.
pub(super) struct ReferenceRobot {
    model: Model,
    pub(super) sensors: SensorsFile,
    /// Joints in the model's order.
    pub(super) joints: Vec<String>,
    hypothesis: Hypothesis,
}

impl ReferenceRobot {
    /// Reads URDF and sensors' file, each a text with its name.
    ///
    /// # Errors
    /// Refusals of both readers; a payload on a link that is not there.
    pub(super) fn new(
        (urdf, urdf_file): (&str, &str),
        sensors: Option<(&str, &str)>,
        payloads: &[Payload],
    ) -> Result<Self, Problem> {
        let options = UrdfOptions {
            base: Base::Floating,
            independent: Vec::new(),
        };
        let mut model = Model::from_urdf_with(urdf, urdf_file, &options)?;
        if let Some(payload) = payloads
            .iter()
            .find(|p| model.frame_index(&p.link).is_none())
        {
            let reason = format!("payload: no link \"{}\"", payload.link);
            return Err(Problem::new(reason, "a link of the URDF").at(urdf_file, 0));
        }
        if !payloads.is_empty() {
            model = Model::from_urdf_with(&with_payloads(urdf, payloads), urdf_file, &options)?;
        }
        let sensors = match sensors {
            Some((text, file)) => SensorsFile::parse(text, file)?,
            None => SensorsFile::parse(&standing(&model), urdf_file)?,
        };
        let joints: Vec<String> = model.joint_names().map(str::to_owned).collect();
        sensors.check(&model, &joints)?;
        let contacts = sensors.contacts();
        let contacts = contacts.iter().map(ContactRecord::parameters);
        let hypothesis = Hypothesis {
            name: String::new(),
            contacts: contacts.collect::<Result<_, _>>()?,
        };
        Ok(Self {
            joints,
            model,
            sensors,
            hypothesis,
        })
    }
}

impl Estimated for ReferenceRobot {
    fn model(&self) -> &Model {
        &self.model
    }

    /// The sensors' file states noise as it is behind the filters; encoders' noise is found in the log.
    fn parameters(&self, gains: &FilterGains) -> Result<WholeBodyParameters, Problem> {
        let parameters = self
            .sensors
            .parameters(&self.joints, self.hypothesis.clone())?;
        let stated = parameters.sigma_ddq.iter().zip(&gains.sigma_ddq);
        let sigma_ddq = stated.map(|(a, b)| a.hypot(*b)).collect();
        Ok(WholeBodyParameters {
            sigma_ddq,
            ..parameters
        })
    }

    fn contact_set(&self) -> usize {
        0
    }
}

/// Sensors' file of a robot whose root link stands still, and which nothing else touches.
fn standing(model: &Model) -> String {
    let root = model.bodies().first().map_or("", |b| b.name.as_str());
    format!(
        "model_sigma_per_cent = {MODEL_SIGMA_PER_CENT}\n[fixed_base]\nlink = {root:?}\n\
         [[contact]]\nlink = {root:?}\ntype = \"full_wrench\"\n"
    )
}

/// The URDF with a link of its own for each payload.
pub(crate) fn with_payloads(urdf: &str, payloads: &[Payload]) -> String {
    let each = payloads.iter().map(|payload| {
        let point = Matrix3::zeros();
        let inertia = Inertia::from_central(payload.mass, payload.centre.into(), point);
        (payload.link.as_str(), inertia)
    });
    with_links(urdf, &each.collect::<Vec<_>>())
}

/// The URDF with a link of its own for a payload, in the axes of the link that carries it.
pub(crate) fn with_payload(urdf: &str, link: &str, inertia: &Inertia) -> String {
    with_links(urdf, &[(link, *inertia)])
}

fn with_links(urdf: &str, payloads: &[(&str, Inertia)]) -> String {
    let Some(end) = urdf.rfind("</robot>").filter(|_| !payloads.is_empty()) else {
        return urdf.to_owned();
    };
    let mut text = urdf[..end].to_owned();
    for (i, (link, inertia)) in payloads.iter().enumerate() {
        let link = link
            .replace('&', "&amp;")
            .replace('"', "&quot;")
            .replace('<', "&lt;");
        let (c, about) = (inertia.center(), inertia.central());
        let at = |r: usize, c: usize| about[(r, c)] + if r == c { POINT_INERTIA } else { 0.0 };
        text += &format!(
            "<link name=\"__payload_{i}\"><inertial><origin xyz=\"{} {} {}\"/><mass value=\"{}\"/>\
             <inertia ixx=\"{}\" iyy=\"{}\" izz=\"{}\" ixy=\"{}\" ixz=\"{}\" iyz=\"{}\"/></inertial></link>\
             <joint name=\"__payload_{i}\" type=\"fixed\"><parent link=\"{link}\"/>\
             <child link=\"__payload_{i}\"/></joint>",
            c.x,
            c.y,
            c.z,
            inertia.mass,
            at(0, 0),
            at(1, 1),
            at(2, 2),
            at(0, 1),
            at(0, 2),
            at(1, 2)
        );
    }
    text + &urdf[end..]
}
