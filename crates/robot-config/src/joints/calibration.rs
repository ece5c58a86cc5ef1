//! The joint file of a joint, and its learned feed-forward.

use super::Reader;
use crate::drives::Drive;
use crate::parameters::JointCalibration;
use crate::paths;
use estimators::features::FeatureSet;
use estimators::local_gp::LocalGpParameters;
use joint_file::{JointFile, TrainedLocalGp, feed_forward_base};
use robot_state::JointKind;
use std::f64::consts::TAU;

impl Reader<'_, '_, '_> {
    /// The joint file that `calibration` names; it must match this joint's drive and rate.
    pub(super) fn calibration(
        &self,
        drive: Option<&Drive>,
        torque_limit: f64,
    ) -> Option<JointCalibration> {
        const ALLOWED: &str = "the path of a joint file that `torquectl fit` wrote";
        let section = self.section;
        let named = section.optional_text("calibration", ALLOWED)?;
        let path = paths::resolved(self.files.config, named.value);
        let problem = |what: String| section.problem("calibration", what, ALLOWED);
        let text = match (self.files.read)(&path) {
            Ok(text) => text,
            Err(error) => {
                problem(format!("{path}: {error}"));
                return None;
            }
        };
        // Estimators that cannot be built are refused here, not by the loop.
        let file = JointFile::parse(&text, &path, self.files.read)
            .and_then(|file| file.estimators().map(|_| file));
        let file = match file {
            Ok(file) => file,
            Err(error) => {
                let key = section.path("calibration");
                section.note(error.or_at(&path, 0).of(key));
                return None;
            }
        };
        self.matches(&file, &path, drive, torque_limit)
            .then_some(JointCalibration::new(file))
    }

    /// The learned feed-forward that `feed_forward` names; it must be this joint's.
    pub(super) fn feed_forward(&self, name: &str) -> Option<LocalGpParameters> {
        const ALLOWED: &str = "the path of a file that `torquectl learn` wrote for this joint";
        let section = self.section;
        let named = section.optional_text("feed_forward", ALLOWED)?;
        let path = paths::resolved(self.files.config, named.value);
        let text = match (self.files.read)(&path) {
            Ok(text) => text,
            Err(error) => {
                section.problem("feed_forward", format!("{path}: {error}"), ALLOWED);
                return None;
            }
        };
        let trained = match TrainedLocalGp::from_text(&text, &path) {
            Ok(trained) => trained,
            Err(error) => {
                let key = section.path("feed_forward");
                section.note(error.or_at(&path, 0).of(key));
                return None;
            }
        };
        let base = feed_forward_base(name);
        let learned = trained.parameters.features == FeatureSet::Motion;
        if trained.base != base || !learned {
            let what = format!("{path} corrects {:?}, not {base:?}", trained.base);
            section.problem("feed_forward", what, ALLOWED);
            return None;
        }
        Some(trained.parameters)
    }

    /// True if the joint file is for a joint like this one; notes each difference.
    fn matches(
        &self,
        file: &JointFile,
        path: &str,
        drive: Option<&Drive>,
        torque_limit: f64,
    ) -> bool {
        let theirs = &file.joint;
        let prismatic = self.section.kind == JointKind::Prismatic;
        if prismatic != theirs.radius.is_some() {
            let what = if prismatic {
                format!("{path} is for a joint that turns, and this one is prismatic")
            } else {
                format!("{path} is for a prismatic joint, and this one turns")
            };
            let allowed = if prismatic {
                "a joint file with radius_m, as `torquectl calibrate` writes it"
            } else {
                "a joint file without radius_m"
            };
            self.section.problem("calibration", what, allowed);
            return false;
        }
        let radius = theirs.radius.unwrap_or(1.0);
        // Counts of a prismatic joint's encoder are those of a mm.
        let per_turn = if prismatic { 1e3 * TAU * radius } else { 1.0 };
        let counts = |of: fn(&Drive) -> Option<f64>| drive.and_then(of);
        let mut matches = true;
        for (key, theirs, ours) in [
            (
                "sample_rate_hz",
                theirs.sample_rate,
                Some(1.0 / self.timing.sample_period),
            ),
            (
                "gear_ratio",
                theirs.gear_ratio,
                drive.map(|d| d.gear_ratio * radius),
            ),
            (
                "torque_constant_Nm_per_A",
                theirs.torque_constant,
                drive.map(|d| d.wave_generator.torque_constant),
            ),
            (
                "motor_counts_per_turn",
                theirs.motor_counts_per_turn,
                counts(|d| d.motor_counts_per_turn),
            ),
            (
                "link_counts_per_turn",
                theirs.link_counts_per_turn,
                counts(|d| d.link_counts).map(|counts| counts * per_turn),
            ),
        ] {
            let Some(ours) = ours else { continue };
            if (theirs - ours).abs() > 1e-6 * ours.abs() {
                let what = format!("{path} is for {key} = {theirs}, this joint has {ours}");
                let allowed = "a joint file of such a joint at such a rate";
                self.section.problem("calibration", what, allowed);
                matches = false;
            }
        }
        // Estimates saturate at the file's limit: one below the joint's would hide its largest torques.
        let limit = file.torque_limit();
        let torque_limit = torque_limit * radius;
        if limit < torque_limit {
            let what =
                format!("{path} is for torque_limit_Nm = {limit}, this joint has {torque_limit}");
            let allowed = format!("a torque_limit_Nm of at least {torque_limit} in the joint file");
            self.section.problem("calibration", what, allowed);
            matches = false;
        }
        matches
    }
}
