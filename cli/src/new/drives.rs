//! What is known of a drive that was found, and what is guessed.

use drives::family::{Model, translation};
use drives::scan::Found;

/// A kind of drive: those of one kind share a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Kind {
    /// `profile`.
    pub(super) family: &'static str,
    /// Its model, and whether the drive has reported it; none: CiA 402.
    pub(super) model: Option<(Model, bool)>,
    /// Turns of the motor for one of the output.
    pub(super) gear_ratio: f64,
    /// rad/s.
    pub(super) velocity: f64,
    /// Rated current, A; reported by CiA 402 drives.
    pub(super) rated_current: Option<f64>,
    /// Maker and product of a CiA 402 drive, as it reports them.
    pub(super) identity: Option<(String, String)>,
}

impl Kind {
    /// Of a device; none: it has no profile. `fastest`: of the URDF's joints, rad/s.
    pub(super) fn of(device: &Found, fastest: f64) -> Option<Self> {
        let fact = |name: &str| {
            let mut facts = device.facts.iter();
            facts
                .find(|(known, _)| *known == name)
                .map(|(_, value)| value.clone())
        };
        let number = |name: &str| fact(name)?.parse::<f64>().ok();
        if device.family == "cia402" {
            return Some(Self {
                family: "cia402",
                model: None,
                gear_ratio: 100.0,
                velocity: 1.5 * fastest,
                rated_current: number("rated_current_mA").map(|ma| ma / 1000.0),
                identity: fact("vendor").zip(fact("product")),
            });
        }
        let family = translation::named(device.family)?;
        let reported = |model: &&Model| {
            let near = |name, x: f64| number(name).is_some_and(|own| (own - x).abs() < 0.01 * x);
            near("velocity_range_rad_per_s", model.velocity)
                && near("torque_range_Nm", model.torque)
        };
        let model = family.models().iter().find(reported);
        let is_reported = model.is_some() || family.models().len() == 1;
        let model = model.or_else(|| family.models().first())?;
        let counts = model.position < 1e3;
        Some(Self {
            family: family.name(),
            model: Some((*model, is_reported)),
            gear_ratio: 10.0,
            velocity: if counts {
                model.velocity
            } else {
                1.5 * fastest
            },
            rated_current: None,
            identity: None,
        })
    }
}
