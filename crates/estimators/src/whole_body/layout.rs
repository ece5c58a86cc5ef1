//! Which body, sensor and joint is where: names resolved and checked once.

use super::{FtSensorParameters, WholeBodyError, WholeBodyParameters};
use dynamics::{Base, Inertia, Model, Se3};

/// An F/T sensor's place in the tree.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    /// The link in whose frame it measures.
    pub(super) frame: usize,
    /// The body that the sensor cuts in two.
    pub(super) body: usize,
    /// The sensor's frame in that body's.
    pub(super) placement: Se3,
    /// The cut body's part beyond the sensor, in the sensor's frame.
    pub(super) beyond: Inertia,
    /// All bodies that the part beyond carries.
    pub(super) bodies_beyond: Vec<usize>,
    /// The body that the environment touches.
    pub(super) contact_body: usize,
    /// Sensors beyond this one whose contact is on the cut body.
    pub(super) contacts_on_cut_body: Vec<usize>,
}

/// The whole tree as the estimator walks it.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// The model's index of each joint, in the order of the parameters.
    pub(super) joints: Vec<usize>,
    pub(super) sensors: Vec<Sensor>,
    /// Sensors, those beyond others first.
    pub(super) outermost_first: Vec<usize>,
    /// None with a fixed base.
    pub(super) imu_frame: Option<usize>,
    pub(super) unknown_body: usize,
    /// The unknown-wrench link's frame in its body's.
    pub(super) unknown_placement: Se3,
    /// Bodies whose joints lie between the root and the unknown-wrench link.
    pub(super) path: Vec<usize>,
}

impl Layout {
    pub(super) fn new(model: &Model, p: &WholeBodyParameters) -> Result<Self, WholeBodyError> {
        let joints = joints(model, p)?;
        let (sensors, outermost_first) = sensors(model, &p.ft_sensors)?;
        let imu_frame = match (model.base(), &p.imu) {
            (Base::Fixed, _) => None,
            (Base::Floating, None) => return Err(WholeBodyError::NoImu),
            (Base::Floating, Some(imu)) => Some(frame(model, "IMU", &imu.frame)?),
        };
        let unknown = match &p.unknown_wrench_link {
            Some(link) => frame(model, "unknown wrench", link)?,
            None => 0,
        };
        let unknown_link = &model.frames()[unknown];
        if model.base() == Base::Fixed && unknown_link.body != 0 {
            return Err(WholeBodyError::UnknownWrenchWithFixedBase(
                unknown_link.name.clone(),
            ));
        }
        for parameters in &p.ft_sensors {
            let cut = frame(model, "F/T sensor", &parameters.frame)?;
            if hangs_on(model, unknown, cut) {
                return Err(WholeBodyError::UnknownWrenchBeyondSensor(
                    unknown_link.name.clone(),
                    parameters.name.clone(),
                ));
            }
        }
        let path = (1..model.bodies().len())
            .filter(|&body| model.supports(body, unknown_link.body))
            .collect();
        Ok(Self {
            joints,
            sensors,
            outermost_first,
            imu_frame,
            unknown_body: unknown_link.body,
            unknown_placement: unknown_link.placement,
            path,
        })
    }
}

fn frame(model: &Model, what: &str, link: &str) -> Result<usize, WholeBodyError> {
    let unknown = || WholeBodyError::UnknownLink(what.to_owned(), link.to_owned());
    model.frame_index(link).ok_or_else(unknown)
}

/// True if link `frame` is `ancestor` or carried by it.
fn hangs_on(model: &Model, frame: usize, ancestor: usize) -> bool {
    let carriers = std::iter::successors(Some(frame), |&f| model.frames()[f].parent);
    carriers.into_iter().any(|f| f == ancestor)
}

fn joints(model: &Model, p: &WholeBodyParameters) -> Result<Vec<usize>, WholeBodyError> {
    let indices: Vec<usize> = p
        .joints
        .iter()
        .map(|name| {
            model
                .joint_index(name)
                .ok_or_else(|| WholeBodyError::UnknownJoint(name.clone()))
        })
        .collect::<Result<_, _>>()?;
    for (i, name) in model.joint_names().enumerate() {
        if indices.iter().filter(|&&index| index == i).count() != 1 {
            return Err(WholeBodyError::JointNotNamedOnce(name.to_owned()));
        }
    }
    let good = |sigma: f64| sigma.is_finite() && sigma >= 0.0;
    for (i, name) in p.joints.iter().enumerate() {
        if !p.sigma_ddq.get(i).is_some_and(|&sigma| good(sigma)) {
            return Err(WholeBodyError::BadSigma(format!(
                "the acceleration of joint `{name}`"
            )));
        }
    }
    if let Some(bad) = p
        .ft_sensors
        .iter()
        .find(|s| !(good(s.sigma_force) && good(s.sigma_torque)))
    {
        return Err(WholeBodyError::BadSigma(format!(
            "F/T sensor `{}`",
            bad.name
        )));
    }
    if p.imu
        .as_ref()
        .is_some_and(|imu| !good(imu.sigma_accelerometer))
    {
        return Err(WholeBodyError::BadSigma(
            "the IMU's accelerometer".to_owned(),
        ));
    }
    Ok(indices)
}

type Sensors = (Vec<Sensor>, Vec<usize>);

fn sensors(model: &Model, all: &[FtSensorParameters]) -> Result<Sensors, WholeBodyError> {
    let frames: Vec<usize> = all
        .iter()
        .map(|s| frame(model, &format!("F/T sensor `{}`", s.name), &s.frame))
        .collect::<Result<_, _>>()?;
    let mut sensors = Vec::new();
    for (i, s) in all.iter().enumerate() {
        if model.frames()[frames[i]].parent.is_none() {
            return Err(WholeBodyError::SensorOnRoot(s.name.clone()));
        }
        if let Some(j) = (0..i).find(|&j| frames[j] == frames[i]) {
            return Err(WholeBodyError::SameCut(all[j].name.clone(), s.name.clone()));
        }
        let contact_body = contact_body(model, all, &frames, i)?;
        let unknown =
            || WholeBodyError::UnknownLink(format!("F/T sensor `{}`", s.name), s.frame.clone());
        let cut = model.cut(frames[i]).ok_or_else(unknown)?;
        sensors.push(Sensor {
            frame: frames[i],
            body: cut.body,
            placement: model.frames()[frames[i]].placement,
            beyond: cut.inertia,
            bodies_beyond: (0..model.bodies().len())
                .filter(|&body| {
                    cut.children
                        .iter()
                        .any(|&child| model.supports(child, body))
                })
                .collect(),
            contact_body,
            contacts_on_cut_body: Vec::new(),
        });
    }
    for i in 0..sensors.len() {
        sensors[i].contacts_on_cut_body = (0..sensors.len())
            .filter(|&j| j != i && hangs_on(model, frames[j], frames[i]))
            .filter(|&j| sensors[j].contact_body == sensors[i].body)
            .collect();
    }
    let mut outermost_first: Vec<usize> = (0..sensors.len()).collect();
    let carried_by = |i: usize| {
        frames
            .iter()
            .filter(|&&other| hangs_on(model, frames[i], other))
            .count()
    };
    outermost_first.sort_by_key(|&i| std::cmp::Reverse(carried_by(i)));
    Ok((sensors, outermost_first))
}

/// The body on which sensor `i`'s contact wrench acts.
fn contact_body(
    model: &Model,
    all: &[FtSensorParameters],
    frames: &[usize],
    i: usize,
) -> Result<usize, WholeBodyError> {
    let s = &all[i];
    let Some(link) = &s.contact_link else {
        return Ok(model.frames()[frames[i]].body);
    };
    let contact = frame(model, &format!("F/T sensor `{}`", s.name), link)?;
    if !hangs_on(model, contact, frames[i]) {
        return Err(WholeBodyError::ContactNotBeyond(
            s.name.clone(),
            link.clone(),
        ));
    }
    let between = |&j: &usize| {
        j != i && hangs_on(model, contact, frames[j]) && hangs_on(model, frames[j], frames[i])
    };
    if let Some(j) = (0..all.len()).find(between) {
        let other = all[j].name.clone();
        return Err(WholeBodyError::ContactBeyondOther(
            s.name.clone(),
            link.clone(),
            other,
        ));
    }
    Ok(model.frames()[contact].body)
}
