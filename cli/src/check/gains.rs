//! Gains of position-commanded drives, as D's experiments state them.

use control::DriveModel;
use robot_config::JointParameters;

/// Gains and their equivalents in the commanded position (D13-14): K8 is this factor times the
/// mass matrix, K9 this factor times the transposed contact Jacobian.
pub(super) struct Gains {
    pub(super) k6: f64,
    pub(super) k7: f64,
    pub(super) k8_per_m: f64,
    pub(super) k9_per_jt: f64,
}

pub(super) fn equivalent(joint: &JointParameters, k_f: f64) -> Option<Gains> {
    let DriveModel::Position(drive) = joint.drive_model else {
        return None;
    };
    let (k_p, k_tau) = (joint.gains.k_p, drive.k_tau);
    let gains = joint.gains.equivalent(k_tau);
    Some(Gains {
        k6: gains.k6,
        k7: gains.k7,
        k8_per_m: k_tau * k_p,
        k9_per_jt: -k_tau * (k_p * (1.0 + k_f) + k_f),
    })
}
