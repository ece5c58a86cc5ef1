//! Joints whose only encoder is the motor's.
//!
//! Such a joint's angle is `theta/N` less the torsion that its estimated torque explains. What needs a
//! measured torsion is refused: a torque law that feeds it back, a joint file, a skew. So is a drive
//! that takes currents: nothing but its one encoder would hold the joint, and an encoder that fails would
//! move it.

use super::Reader;
use crate::drives::Drive;
use crate::parameters::{
    FastTorqueFeedback, JointParameters, Parameters, TorqueFeedback, TorqueLaw,
};
use crate::reader::Section;
use control::MotorModel;

impl Reader<'_, '_, '_> {
    /// The joint has a link-side encoder.
    pub(super) fn has_link(&self) -> bool {
        self.section.has("link_angle")
    }

    /// Notes what a joint without a link-side encoder cannot have.
    pub(super) fn check_motor_alone(&self, drive: &Drive) {
        let section = self.section;
        if matches!(drive.motor, MotorModel::Current { .. }) {
            let what = "the key is missing, and the joint's drive takes currents: an encoder that fails \
                        would move the joint, since nothing else holds it";
            let allowed = "a link-side encoder, or a drive with command = \"position\"";
            section.problem("link_angle", what, allowed);
        }
        let law = self.feedback.torque_law;
        let by_torsion = [
            TorqueLaw::ProportionalIntegral(TorqueFeedback::Encoder),
            TorqueLaw::Predictive(FastTorqueFeedback::Torsion),
        ];
        if by_torsion.contains(&law) {
            let what = "the key is missing, and control.torque_feedback is the torque by torsion, which \
                        takes both encoders";
            let allowed = "a link-side encoder, or a torque_feedback by F/T sensors and IMU: \
                           \"whole_body\", or \"levelled\" or \"tau_hat\" of the predictive law";
            section.problem("link_angle", what, allowed);
        }
        for (key, what) in [
            (
                "calibration",
                "a joint file's estimators need both encoders",
            ),
            ("skew_us", "the joint has one encoder"),
        ] {
            if section.has(key) {
                let allowed = "no such key, or a joint with link_angle";
                section.problem(key, what, allowed);
            }
        }
    }
}

/// Notes drives of joints with and without a link-side encoder: K_tau is the lead over another angle.
pub(super) fn check_drives(root: &Section<'_, '_>, joints: &[JointParameters]) {
    for joint in joints.iter().filter(|joint| !joint.has_link_encoder) {
        let other = |other: &&JointParameters| other.has_link_encoder && other.drive == joint.drive;
        let Some(other) = joints.iter().find(other) else {
            continue;
        };
        let mut sections = root.list("joint").into_iter();
        if let Some(mut section) = sections.find(|section| section.is("name", &joint.name)) {
            section.which = format!(" ({})", joint.name);
            let what = format!(
                "joint {} has this kind of drive too, and a link-side encoder: K_tau is the lead over its \
                 link's angle, here over the motor's",
                other.name
            );
            section.problem(
                "drive",
                what,
                "a kind of drive of its own, whose K_tau contains no gear",
            );
        }
    }
}

/// Notes a feedback of torque where no sensor measures a contact's torque.
pub(crate) fn check_torque_source(root: &Section<'_, '_>, parameters: &Parameters) {
    if !parameters.ft_sensors.is_empty() {
        return;
    }
    let fed_back = |joint: &&JointParameters| {
        !joint.has_link_encoder && (joint.gains.k_p > 0.0 || joint.gains.k_i > 0.0)
    };
    for joint in parameters.joints.iter().filter(fed_back) {
        let mut sections = root.list("joint").into_iter();
        if let Some(mut section) = sections.find(|section| section.is("name", &joint.name)) {
            section.which = format!(" ({})", joint.name);
            let what = "K_p or K_i_per_s is above 0, and the robot has no torque to feed back: the joint \
                        has no link-side encoder, and no F/T sensor measures contacts";
            let allowed = "K_p = 0 and K_i_per_s = 0, a link-side encoder, or an F/T sensor";
            section.problem("gains", what, allowed);
        }
    }
}
