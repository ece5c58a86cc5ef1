//! The sensors' file of a robot that has a configuration.

use super::request::{ContactRecord, ContactType};
use crate::output::read_input;
use problem::{Problem, Problems};
use robot_config::{FilterGains, Robot, whole_body_parameters};
use std::fmt::Write as _;
use std::path::Path;
use whole_body::{ContactKind, ContactParameters, MotionSource, Weighting};

/// Text of a sensors' file, or that which a `robot.toml` amounts to, and its name for messages.
///
/// # Errors
/// A file that cannot be read, or a configuration that is refused.
pub(crate) fn sensors_text(path: &Path) -> Result<(String, String), Problems> {
    let (text, file) = (read_input(path)?, path.display().to_string());
    let is_robot = (text.parse::<toml::Table>())
        .is_ok_and(|table| table.contains_key("joint") && table.contains_key("bus"));
    if !is_robot {
        return Ok((text, file));
    }
    let robot = robot_config::load(&file, &|path| terminal::read_text(path))?;
    let text = sensors_of(&robot).map_err(|problem| problem.at(&file, 0))?;
    Ok((text, file))
}

/// Noise is that of single samples: instants are taken as they are, without filters.
fn sensors_of(robot: &Robot) -> Result<String, Problem> {
    let gains = FilterGains {
        sensor: [1.0, 0.0],
        sigma_ddq: vec![0.0; robot.parameters.joints.len()],
    };
    let Some(parameters) = whole_body_parameters(&robot.parameters, &robot.model, &gains) else {
        let reason = "a floating base without an IMU or a stand: nothing measures its motion";
        return Err(Problem::new(reason, "[imu], or [whole_body.stand]"));
    };
    let mut text = format!(
        "model_sigma_per_cent = {:?}\n",
        100.0 * parameters.sigma_model
    );
    // Writing to a string cannot fail.
    let _ = match &parameters.source {
        MotionSource::Imu(imu) => write!(
            text,
            "[imu]\nframe = {:?}\nsigma_m_per_s2 = {:?}\n",
            imu.frame.link, imu.sigma_accelerometer
        ),
        MotionSource::Fixed { link, gravity } => {
            let [x, y, z]: [f64; 3] = (*gravity).into();
            write!(
                text,
                "[fixed_base]\nlink = {link:?}\ngravity_m_per_s2 = [{x:?}, {y:?}, {z:?}]\n"
            )
        }
    };
    if parameters.weighting == Weighting::Expected {
        text += "[least_squares]\nweights = \"expected\"\n";
    }
    for sensor in &parameters.ft_sensors {
        let _ = write!(
            text,
            "[[ft_sensor]]\nname = {:?}\nframe = {:?}\nsigma_N = {:?}\nsigma_Nm = {:?}\n",
            sensor.name, sensor.frame.link, sensor.sigma_force, sensor.sigma_torque
        );
    }
    let first = parameters.hypotheses.first();
    for contact in first.into_iter().flat_map(|set| &set.contacts) {
        let record = toml::to_string(&record_of(contact));
        let record = record.map_err(|e| Problem::new(e.to_string(), ""))?;
        text += &format!("[[contact]]\n{record}");
    }
    Ok(text)
}

fn record_of(contact: &ContactParameters) -> ContactRecord {
    let (kind, direction) = match contact.kind {
        ContactKind::FullWrench => (ContactType::FullWrench, None),
        ContactKind::PureForce => (ContactType::PureForce, None),
        ContactKind::KnownDirection(d) => (ContactType::KnownDirection, Some(d.into())),
        ContactKind::Nothing => (ContactType::None, None),
    };
    ContactRecord {
        link: contact.link.clone(),
        kind,
        point_m: contact.point.into(),
        direction,
    }
}
