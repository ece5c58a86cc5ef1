//! The hold of drives that take currents, and the margins below which none is run.

use super::motor_alone::taps;
use crate::Robot;
use crate::parameters::{JointParameters, Parameters};
use control::margins::{HoldLoop, NEEDED};
use problem::Problem;

/// The hold of a joint whose drive takes currents; none of another.
#[must_use]
pub fn hold_loop(joint: &JointParameters, parameters: &Parameters) -> Option<HoldLoop> {
    let ratio = joint.encoders.gear_ratio;
    (!joint.takes_position()).then(|| HoldLoop {
        inertia: [joint.rotor_inertia * ratio * ratio, joint.link_inertia],
        k_s: joint.gains.k_s,
        k_d: joint.gains.k_d,
        velocity: taps(parameters.filters.control.into(), 1),
        delay: joint.law.delay,
        sample_period: parameters.timing.sample_period,
    })
}

/// A problem for each joint whose hold has less margin than 30 degrees or 6 dB; `file`: the configuration. A joint
/// without K_s and K_d is not held by them.
#[must_use]
pub fn refused_holds(robot: &Robot, file: &str) -> Vec<Problem> {
    let p = &robot.parameters;
    let refused = |joint: &JointParameters| {
        let hold = hold_loop(joint, p)?;
        let held = hold.k_s > 0.0 || hold.k_d > 0.0;
        let (margins, at) = hold.least_margins();
        if !held || margins.keeps(&NEEDED) {
            return None;
        }
        let (degrees, db) = margins.in_degrees_and_db();
        let window_ms = 1e3 * (hold.velocity.len() - 1) as f64 * hold.sample_period;
        let what = format!(
            "joint {}: hold by K_s and K_d: margins of {degrees:.0} degrees (link {}) and {db:.1} dB (link {}), with \
             a filter of velocities over {window_ms:.0} ms",
            joint.name,
            at[0].name(),
            at[1].name(),
        );
        let most = hold.largest_stiffness(NEEDED);
        let stiffness = if most > 0.0 {
            let unit = joint.kind.units("N·m/rad");
            format!("K_s up to {most:.0} {unit} with this K_d over K_s")
        } else {
            "another K_d over K_s".to_owned()
        };
        let allowed = format!(
            "at least 30 degrees and 6 dB: {stiffness}, or a shorter window of [filters] control"
        );
        Some(Problem::new(what, allowed).at(file, 0))
    };
    p.joints.iter().filter_map(refused).collect()
}
