//! F/T sensors from recorded runs: offset, misalignment, and mass and centre of mass of what is beyond.

use super::loads::{Cuts, Reading};
use super::runs::RecordedRun;
use dynamics::{Inertia, Model};
use identification::load::motion::{Cut, rigid_with};
use identification::load::{Channel, Knowledge, Load, checks, identify};
use problem::Problem;
use robot_config::{FtParameters, Robot};

/// Standard deviation of the URDF's mass beyond a sensor: a share, and kg.
const MASS_SIGMA: [f64; 2] = [0.1, 0.05];
/// That of a centre of mass, m.
const CENTRE_SIGMA: f64 = 0.03;
/// That of the angles at which a sensor is mounted, rad.
const ANGLE_SIGMA: f64 = 0.03;
/// Noise that the centred filter leaves of a sample, share.
const FILTERED: f64 = 0.2;
/// Names of the axes.
pub(super) const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];

/// Outcome for a sensor.
pub(super) struct SensorResult {
    pub(super) name: String,
    pub(super) outcome: Result<Sensor, Problem>,
}

/// A calibrated sensor.
pub(super) struct Sensor {
    /// The link whose inertia holds what is beyond.
    pub(super) link: String,
    pub(super) load: Load,
    /// Offset, after calibration and before the sign, as robot.toml has it.
    pub(super) offset: [f64; 6],
    /// The same behind the sign, as it is subtracted.
    pub(super) published: [f64; 6],
    /// The mass and centre found predict what was held out better than the URDF's.
    pub(super) inertia: Option<Inertia>,
}

/// All sensors of a robot; `signs`: the keys `sign`, by sensor.
pub(super) fn all(runs: &[RecordedRun], signs: &[f64], untouched: bool) -> Vec<SensorResult> {
    let Some(first) = runs.first() else {
        return Vec::new();
    };
    let sensors = first.robot.parameters.ft_sensors.iter().enumerate();
    sensors
        .map(|(s, ft)| SensorResult {
            name: ft.sensor.name.clone(),
            outcome: one(runs, s, ft, signs.get(s).copied().unwrap_or(1.0), untouched),
        })
        .collect()
}

/// The link that holds the mass beyond a sensor: the heaviest that moves with its frame.
pub(super) fn carrier(model: &Model, frame: &str) -> Option<usize> {
    let links = rigid_with(model, model.frame_index(frame)?).into_iter();
    let mass = |k: &usize| model.frames()[*k].inertia.mass;
    links.max_by(|a, b| mass(a).total_cmp(&mass(b)))
}

/// The channels of an F/T sensor.
pub(super) fn channels(robot: &Robot, ft: &FtParameters) -> Vec<Channel> {
    let drift = robot.parameters.tare.drift;
    let sigmas = [ft.sensor.sigma_force, ft.sensor.sigma_torque];
    let each = AXES.iter().enumerate().map(|(k, axis)| Channel {
        name: (*axis).to_owned(),
        unit: if k < 3 { "N" } else { "N·m" },
        sigma: (FILTERED * sigmas[k / 3]).max(1e-6),
        offset_sigma: drift[k / 3],
    });
    each.collect()
}

fn one(
    runs: &[RecordedRun],
    sensor: usize,
    ft: &FtParameters,
    sign: f64,
    untouched: bool,
) -> Result<Sensor, Problem> {
    let robot = &runs[0].robot;
    let model = &robot.model;
    let of_sensor = |p: Problem| p.of(format!("F/T sensor {}", ft.sensor.name));
    let Some(frame) = model.frame_index(&ft.sensor.frame) else {
        let reason = format!("no link {:?}", ft.sensor.frame);
        return Err(of_sensor(Problem::new(reason, "a link of the URDF")));
    };
    let carrier = carrier(model, &ft.sensor.frame).unwrap_or(frame);
    let cut = Cut::before_link(model, frame);
    let beyond = cut.mass_beyond(model);
    let cuts = Cuts {
        cuts: vec![(cut, Reading::Sensor(sensor))],
        carrier,
        empty: &[],
        untouched,
    };
    let gathered = cuts.samples(runs).map_err(of_sensor)?;
    checks::wiring(&gathered.samples, Some(beyond), ft.sensor.sigma_force).map_err(of_sensor)?;
    let known = Knowledge {
        channels: channels(robot, ft),
        inertia: model.frames()[carrier].inertia,
        mass_sigma: MASS_SIGMA[0] * beyond + MASS_SIGMA[1],
        centre_sigma: CENTRE_SIGMA,
        sensor: true,
        angle_sigma: ANGLE_SIGMA,
    };
    let load = identify(&known, &gathered.samples, gathered.seconds).map_err(of_sensor)?;
    let moved = load.mass.determined || load.centre.iter().any(|c| c.determined);
    let before = runs[0].stretches.first();
    let before = before.and_then(|s| s.offsets.get(sensor)).copied();
    let before = before.unwrap_or_default();
    // The fit's wrench is the opposite of the one that is published.
    let published: [f64; 6] = std::array::from_fn(|k| before[k] - load.offset[k].value);
    Ok(Sensor {
        link: model.frames()[carrier].name.clone(),
        offset: published.map(|x| sign * x),
        published,
        inertia: (moved && load.helps()).then_some(load.inertia),
        load,
    })
}
