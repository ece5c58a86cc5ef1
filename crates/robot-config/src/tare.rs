//! `[tare]`.

use crate::reader::{Allowed, Section};
use whole_body::TareParameters;

/// Motion below which a robot counts as at rest, and standard deviations of model and sensors.
pub(crate) fn tare(root: &Section<'_, '_>, sample_period: f64) -> TareParameters {
    let defaults = TareParameters::default();
    // A robot on its feet sways with a period of about 1 s: the mean covers two of them.
    let mut time = 2.0;
    let mut tare = defaults.clone();
    if let Some(section) = root.optional_section("tare") {
        let number = |key, default| section.number_or(key, default, Allowed::Positive);
        time = section.number_or("time_s", time, Allowed::Within(0.1, 60.0));
        let [force, torque] = defaults.max_change;
        let [drift_force, drift_torque] = defaults.drift;
        tare = TareParameters {
            samples: 0,
            max_joint_velocity: number("max_velocity_rad_per_s", defaults.max_joint_velocity),
            max_angular_velocity: number(
                "max_angular_velocity_rad_per_s",
                defaults.max_angular_velocity,
            ),
            max_change: [
                number("max_change_N", force),
                number("max_change_Nm", torque),
            ],
            drift: [
                number("drift_N", drift_force),
                number("drift_Nm", drift_torque),
            ],
            accelerometer_bias: number("accelerometer_bias_m_per_s2", defaults.accelerometer_bias),
            sigma_model: 0.01 * number("model_sigma_per_cent", 100.0 * defaults.sigma_model),
        };
        section.finish();
    }
    tare.samples = (time / sample_period).ceil() as usize;
    tare
}
