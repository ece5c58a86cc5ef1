//! `[drive.NAME.actuator]`: an actuator with frames of its maker's own, which need no DBC file.

use crate::reader::{Allowed, Section};
use drives_of_makers::family::{Model, translation};

/// A kind of actuator.
#[derive(Clone)]
pub(crate) struct ActuatorKind {
    pub(crate) family: &'static str,
    pub(crate) model: Model,
    /// N·m/rad.
    pub(crate) kp: f64,
    /// N·m·s/rad.
    pub(crate) kd: f64,
}

/// Reads the table; nothing if there is a problem with it.
pub(super) fn read(
    section: Section<'_, '_>,
    family: &'static str,
    gear_ratio: f64,
) -> Option<ActuatorKind> {
    let made = translation::named(family)?;
    let models = made.models();
    let choices: Vec<_> = models
        .iter()
        .map(|model| (model.name, Some(*model)))
        .collect();
    let text = section.text(
        "model",
        &problem::listed(models.iter().map(|model| model.name)),
    );
    let model = text.and_then(|text| {
        let found = choices.iter().find(|(name, _)| *name == text.value);
        if found.is_none() {
            let what = format!("{:?} is not allowed", text.value);
            let allowed = problem::listed(models.iter().map(|model| model.name));
            section.problem("model", what, allowed);
        }
        found?.1
    });
    // At the output, as all gains of a configuration are.
    let stiffer = if made.at_motor() {
        gear_ratio * gear_ratio
    } else {
        1.0
    };
    let within = |[least, most]: [f64; 2]| Allowed::Within(least * stiffer, most * stiffer);
    let gains = made.gains();
    let kp = section.number("kp_Nm_per_rad", within(gains.kp));
    let kd = section.number("kd_Nms_per_rad", within(gains.kd));
    section.finish();
    let finite = kp.is_finite() && kd.is_finite();
    finite.then_some(ActuatorKind {
        family,
        model: model?,
        kp,
        kd,
    })
}
