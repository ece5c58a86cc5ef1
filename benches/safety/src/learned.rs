//! A learned torque for mode low-gain tracking, as `torquectl learn` would write it: what the model lacks at one joint
//! about the pose in which the robot begins.

use estimators::features::FeatureSet;
use estimators::local_gp::{LocalGpParameters, LocalModel};
use estimators::regimes::{Regime, Regimes};
use joint_file::{TrainedLocalGp, feed_forward_base};
use problem::Problem;
use toml::Table;

/// Name of the file.
pub(crate) const LEARNED_FILE: &str = "learned.toml";

/// Inputs: position, velocity and acceleration of the joint and of its neighbours, and their standard deviation.
const INPUTS: usize = 9;
const SPREAD: f64 = 0.2;
/// Learned torque, share of the joint's torque limit.
const SHARE: f64 = 0.005;

/// Names the file in the table of this joint, at `start` (rad), and returns its text; none: there is no such joint.
pub(crate) fn learn(
    joints: Vec<(String, &mut Table)>,
    name: &str,
    start: f64,
) -> Result<Option<String>, Problem> {
    for (_, joint) in joints {
        if joint.get("name").and_then(toml::Value::as_str) == Some(name) {
            let limit = joint.get("torque_limit_Nm").and_then(toml::Value::as_float);
            joint.insert("feed_forward".into(), LEARNED_FILE.into());
            return text(name, start, SHARE * limit.unwrap_or(0.0)).map(Some);
        }
    }
    Ok(None)
}

fn text(joint: &str, start: f64, torque: f64) -> Result<String, Problem> {
    let regime = Regime {
        gain: 1.0,
        sigma: 1.0,
    };
    let mut point = vec![0.0; INPUTS];
    point[0] = start;
    let learned = TrainedLocalGp {
        base: feed_forward_base(joint),
        parameters: LocalGpParameters {
            features: FeatureSet::Motion,
            inputs: vec![(0.0, SPREAD); INPUTS],
            signal_variance: torque * torque,
            noise_variance: 1e-4,
            models: vec![LocalModel {
                centre: point.clone(),
                points: point,
                residuals: vec![torque],
                noise: vec![1e-4],
            }],
            directions: 1,
            tolerance: 0.0,
            regimes: Regimes {
                speed: 1.0,
                time_constant: 1.0,
                sample_period: 1e-3,
                rest: regime,
                moving: regime,
            },
            gear_ratio: 1.0,
        },
        held_out_rms: (torque, 0.1 * torque),
    };
    learned.to_text()
}
