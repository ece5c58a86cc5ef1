//! The predictive torque law's model of a joint.

use super::Reader;
use crate::TorqueLaw;
use crate::drives::Drive;
use control::DriveModel;
use control::predictive::{Design, DriveLoop, FrictionModel, GearStiffness, LawParameters};
use supervisor::Limits;

/// Largest disturbance that is believed, as a share of the torque limit: friction is a tenth of it,
/// and a model that is wrong by a quarter as much again.
const DISTURBANCE_SHARE: f64 = 0.25;
/// Share of a drive's lag that lies in its own loop; for the rest a command waits for the loop.
pub(super) const LAG_OF_THE_LOOP: f64 = 0.75;

/// Stiffness of friction's bristles over that of the gear, where `presliding_rad` does not say it. They are once to
/// twice as stiff on the own plant; less than the truth is foreseen too late, more than it too early, which is worse.
const BRISTLES: f64 = 1.2;

impl Reader<'_, '_, '_> {
    pub(super) fn law(&self, drive: &Drive, limits: &Limits) -> LawParameters {
        self.can_integrate(drive);
        let n = drive.gear_ratio;
        let c = &drive.compliance;
        let level = drive.wave_generator.friction * n;
        LawParameters {
            sample_period: self.timing.sample_period,
            delay: self.feedback.command_delay + drive.lag,
            drive: DriveLoop::from(&drive.model),
            rotor_inertia: drive.rotor_inertia * n * n,
            gear: GearStiffness {
                k_fs0: c.k_fs0,
                c_fs: c.c_fs,
                k_wg0: c.k_wg0 * n * n,
                c_wg: c.c_wg / n,
            },
            friction: FrictionModel {
                level,
                stiffness: (drive.presliding).map_or(BRISTLES * c.k_fs0, |way| level * n / way),
            },
            torque_limit: limits.torque,
            disturbance_limit: DISTURBANCE_SHARE * limits.torque,
            design: Design::default(),
        }
    }

    /// Notes a drive whose integral no law of this joint knows: what a lead makes is then not its torque.
    fn can_integrate(&self, drive: &Drive) {
        let predictive = matches!(self.feedback.torque_law, TorqueLaw::Predictive(_));
        let integrates = matches!(drive.model, DriveModel::Position(model) if model.integral > 0.0);
        if !integrates || (predictive && self.has_link) {
            return;
        }
        let what = "its drive's velocity loop has an integral (integral_time_ms), which this joint's torque law does not \
                    know";
        let allowed = if self.has_link {
            "law = \"predictive\" in [control], or a velocity loop without an integral"
        } else {
            "a velocity loop without an integral, as the joint has no link-side encoder"
        };
        self.section.problem("drive", what, allowed);
    }
}
