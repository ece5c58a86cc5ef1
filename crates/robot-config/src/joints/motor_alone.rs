//! Joints whose only encoder is the motor's.
//!
//! Such a joint's angle is `theta/N` less the torsion that its estimated torque explains. What needs a
//! measured torsion is refused: a torque law that feeds it back, a joint file, a skew. So is a drive
//! that takes currents: nothing but its one encoder would hold the joint, and an encoder that fails would
//! move it.

use super::Reader;
use super::gains::AS_MARGINS_ALLOW;
use crate::drives::Drive;
use crate::parameters::{
    FastTorqueFeedback, JointParameters, Parameters, TorqueFeedback, TorqueLaw,
};
use crate::reader::Section;
use control::margins::{MotorSideLoop, NEEDED};
use estimators::filter_bank::{FilterBank, FilterDesign};

/// Torque at which margins are judged, share of the limit, as those of the predictive law are.
const CARRIED_SHARE: f64 = 0.15;
/// Largest K_i that is chosen, 1/s: friction and errors of the stiffness, which it is for, change more slowly.
const LARGEST_K_I: f64 = 8.0;

impl Reader<'_, '_, '_> {
    /// Notes what a joint without a link-side encoder cannot have.
    pub(super) fn check_motor_alone(&self, drive: &Drive) {
        let section = self.section;
        if !drive.model.takes_position() {
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

/// The feedback of a late torque as its margins are computed from it; none of a joint with a link-side encoder.
#[must_use]
pub fn motor_side_loop(joint: &JointParameters, parameters: &Parameters) -> Option<MotorSideLoop> {
    let filters = &parameters.filters;
    (!joint.has_link_encoder).then(|| MotorSideLoop {
        law: joint.law,
        drive_lag: joint.drive_lag,
        link_inertia: joint.link_inertia,
        torque: CARRIED_SHARE * joint.limits.torque,
        gains: joint.gains,
        smoothing: taps(filters.long.sensor, 0),
        velocity: taps(filters.control.into(), 1),
        torsion_bandwidth: parameters.torsion_bandwidth(),
    })
}

/// Weights of the samples in a filter's value or derivative, oldest first: its response to an impulse, backwards.
pub(super) fn taps(filter: FilterDesign, derivative: usize) -> Vec<f64> {
    let Ok(mut bank) = FilterBank::new(1, filter) else {
        // The configuration refuses it.
        return Vec::new();
    };
    let window = bank.kernel().len();
    (0..window).for_each(|_| bank.update(&[0.0]));
    let response = (0..window).map(|k| {
        bank.update(&[f64::from(u8::from(k == 0))]);
        let values = match derivative {
            0 => bank.values(),
            _ => bank.first_derivatives(),
        };
        values.first().copied().unwrap_or(0.0)
    });
    let mut taps: Vec<f64> = response.collect();
    taps.reverse();
    taps
}

/// Chooses K_i where none is given: the largest that keeps the margins, up to [`LARGEST_K_I`]; 0 where there is no
/// torque to feed back, or no such gain.
pub(crate) fn choose_feedback(parameters: &mut Parameters) {
    let sensed = !parameters.ft_sensors.is_empty();
    for j in 0..parameters.joints.len() {
        let joint = &parameters.joints[j];
        if joint.gains.k_i != AS_MARGINS_ALLOW {
            continue;
        }
        let largest = match motor_side_loop(joint, parameters) {
            Some(feedback) if sensed => feedback.largest_k_i(LARGEST_K_I, NEEDED),
            _ => 0.0,
        };
        parameters.joints[j].gains.k_i = largest;
    }
}

/// Notes a feedback of torque where no sensor measures a contact's torque.
pub(crate) fn check_torque_source(root: &Section<'_, '_>, parameters: &Parameters) {
    let fed_back = |joint: &&JointParameters| {
        !joint.has_link_encoder && (joint.gains.k_p > 0.0 || joint.gains.k_i > 0.0)
    };
    let sensed = !parameters.ft_sensors.is_empty();
    for joint in parameters.joints.iter().filter(fed_back) {
        let (what, allowed) = match sensed {
            false => (
                "K_p or K_i_per_s is above 0, and the robot has no torque to feed back: the joint has no \
                 link-side encoder, and no F/T sensor measures contacts",
                "K_p = 0 and K_i_per_s = 0, a link-side encoder, or an F/T sensor",
            ),
            true if joint.estimator.wave_generator.friction <= 0.0 => (
                "the torque of F/T sensors is fed back without a link-side encoder, and friction.coulomb_Nm of \
                 the drive is 0: motor current cannot show whether that torque is right",
                "K_p = 0 and K_i_per_s = 0, a coulomb_Nm above 0, or a link-side encoder",
            ),
            true => continue,
        };
        let mut sections = root.list("joint").into_iter();
        if let Some(mut section) = sections.find(|section| section.is("name", &joint.name)) {
            section.which = format!(" ({})", joint.name);
            section.problem("gains", what, allowed);
        }
    }
}
