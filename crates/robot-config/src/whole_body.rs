//! From the configuration to the whole-body estimator's parameters.

use crate::parameters::{AngularAcceleration, FtParameters, Parameters};
use dynamics::{Base, Model};
use whole_body::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, MotionSource,
    Place, Residual, WholeBodyParameters,
};

/// Gains of the filters for sensor noise.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterGains {
    /// Standard deviations of a sensor's filtered value and rate per standard deviation of a sample,
    /// 1 and 1/s.
    pub sensor: [f64; 2],
    /// Standard deviation of each joint's acceleration, rad/s².
    pub sigma_ddq: Vec<f64>,
}

/// Names of the contact sets where the configuration has none: a full wrench on every end, or no
/// contact at the ends, for a tare. The first holds at the start.
const DEFAULT_CONTACTS: [&str; 2] = ["default", "in_the_air"];

/// The estimator's parameters, with the configured contact sets, or else the default ones. None for
/// a floating base without an IMU or a stand.
#[must_use]
pub fn whole_body_parameters(
    parameters: &Parameters,
    model: &Model,
    gains: &FilterGains,
) -> Option<WholeBodyParameters> {
    let [value, rate] = gains.sensor;
    let ft_sensor = |ft: &FtParameters| FtSensorParameters {
        name: ft.sensor.name.clone(),
        cut: ft.sensor.frame.clone(),
        frame: Place::link(&ft.sensor.frame),
        sigma_force: value * ft.sensor.sigma_force,
        sigma_torque: value * ft.sensor.sigma_torque,
        lasting: ft.sensor.lasting,
    };
    let settings = &parameters.whole_body;
    let source = match (model.base(), &settings.stand, parameters.imus.first()) {
        (Base::Fixed, ..) => MotionSource::Fixed {
            link: root(model),
            gravity: model.gravity(),
        },
        (Base::Floating, Some(stand), _) => MotionSource::Fixed {
            link: stand.link.clone(),
            gravity: stand.gravity.into(),
        },
        (Base::Floating, None, Some(imu)) => MotionSource::Imu(ImuParameters {
            frame: Place::link(&imu.frame),
            sigma_accelerometer: value * imu.sigma_accelerometer,
            lasting_accelerometer: parameters.tare.accelerometer_bias,
            sigma_angular_acceleration: match settings.angular_acceleration {
                AngularAcceleration::Differentiate => rate * imu.sigma_gyro,
                AngularAcceleration::Neglect => 0.0,
            },
        }),
        (Base::Floating, None, None) => return None,
    };
    let sets = settings.contacts.iter().map(|set| set.hypothesis.clone());
    let mut hypotheses: Vec<Hypothesis> = sets.collect();
    if hypotheses.is_empty() {
        hypotheses.extend(default_contacts(parameters, model));
    }
    Some(WholeBodyParameters {
        joints: parameters.joints.iter().map(|j| j.name.clone()).collect(),
        sigma_ddq: gains.sigma_ddq.clone(),
        ft_sensors: parameters.ft_sensors.iter().map(ft_sensor).collect(),
        source,
        hypotheses,
        weighting: settings.weighting,
        residual: Residual::Stays,
        sigma_model: settings.sigma_model,
    })
}

/// Names of the contact sets, in the order of the estimator's hypotheses.
#[must_use]
pub fn contact_names(parameters: &Parameters) -> Vec<&str> {
    let sets = &parameters.whole_body.contacts;
    if sets.is_empty() {
        let sets = if parameters.ft_sensors.is_empty() {
            1
        } else {
            2
        };
        return DEFAULT_CONTACTS[..sets].to_vec();
    }
    sets.iter().map(|c| c.hypothesis.name.as_str()).collect()
}

/// Beyond each F/T sensor a full wrench, or no contact; last of all the unknown wrench (D 2.4).
fn default_contacts(parameters: &Parameters, model: &Model) -> Vec<Hypothesis> {
    let touched = |ft: &FtParameters| {
        let link = ft.sensor.contact_link.clone();
        link.unwrap_or_else(|| ft.sensor.frame.clone())
    };
    let unknown = parameters.whole_body.unknown_wrench_link.clone();
    let unknown = unknown.unwrap_or_else(|| root(model));
    let contact = |link: String, kind: ContactKind| ContactParameters {
        link,
        point: [0.0; 3].into(),
        kind,
    };
    let names = contact_names(parameters).into_iter();
    let kinds = [ContactKind::FullWrench, ContactKind::Nothing];
    names
        .zip(kinds)
        .map(|(name, kind)| {
            let sensors = parameters.ft_sensors.iter();
            let ends = sensors.map(|ft| contact(touched(ft), kind));
            let unknown = contact(unknown.clone(), ContactKind::FullWrench);
            Hypothesis {
                name: name.to_owned(),
                contacts: ends.chain([unknown]).collect(),
            }
        })
        .collect()
}

fn root(model: &Model) -> String {
    let root = model.frames().iter().find(|f| f.parent.is_none());
    root.map_or(String::new(), |f| f.name.clone())
}
