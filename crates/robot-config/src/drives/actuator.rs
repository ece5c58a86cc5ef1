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

/// Greatest gains that the families' frames hold.
const LARGEST: (f64, f64) = (500.0, 5.0);

/// Reads the table; nothing if there is a problem with it.
pub(super) fn read(section: Section<'_, '_>, family: &'static str) -> Option<ActuatorKind> {
    let models = translation::named(family).map_or(&[][..], |family| family.models());
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
    let kp = section.number("kp_Nm_per_rad", Allowed::Within(0.1, LARGEST.0));
    let kd = section.number("kd_Nms_per_rad", Allowed::Within(0.0, LARGEST.1));
    section.finish();
    let finite = kp.is_finite() && kd.is_finite();
    finite.then_some(ActuatorKind {
        family,
        model: model?,
        kp,
        kd,
    })
}
