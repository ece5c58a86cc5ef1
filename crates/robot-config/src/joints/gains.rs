//! `[joint.gains]`.

use super::Reader;
use crate::drives::Drive;
use crate::parameters::TorqueLaw;
use crate::reader::Allowed;
use control::{DriveModel, EquivalentGains, JointGains};

/// K_i of a joint without a link-side encoder where none is given, until the margins have chosen it.
pub(super) const AS_MARGINS_ALLOW: f64 = f64::INFINITY;

impl Reader<'_, '_, '_> {
    /// Either `K_s` and `K_d`, or for position-commanded drives `K6` and `K7` (D13-14).
    pub(super) fn gains(&self, drive: Option<&Drive>) -> Option<JointGains> {
        let section = self.section.section("gains")?;
        // The predictive law has no gain on the torque's error: its keys are unknown there. A joint without
        // a link-side encoder has the other law in any case.
        let (k_p, k_i) = match self.feedback.torque_law {
            TorqueLaw::Predictive(_) if self.has_link => (0.0, 0.0),
            _ if self.has_link => (
                section.number("K_p", Allowed::NonNegative),
                section.number_or("K_i_per_s", 0.0, Allowed::NonNegative),
            ),
            _ => (
                section.number("K_p", Allowed::NonNegative),
                section.number_or("K_i_per_s", AS_MARGINS_ALLOW, Allowed::NonNegative),
            ),
        };
        let equivalent = section.has("K6") || section.has("K7_s");
        let gains = if equivalent {
            let gains = EquivalentGains {
                k6: section.number("K6", Allowed::NonNegative),
                k7: section.number("K7_s", Allowed::NonNegative),
            };
            match drive.map(|drive| drive.model) {
                Some(DriveModel::Position(drive)) => {
                    Some(JointGains::from_equivalent(gains, drive.k_tau, k_p, k_i))
                }
                Some(DriveModel::Current(_)) => {
                    let what = "the drive takes currents, not positions";
                    let allowed = section.kind.units("K_s_Nm_per_rad and K_d_Nms_per_rad");
                    section.problem("K6", what, allowed);
                    None
                }
                None => None,
            }
        } else {
            Some(JointGains {
                k_p,
                k_i,
                k_s: section.number("K_s_Nm_per_rad", Allowed::NonNegative),
                k_d: section.number("K_d_Nms_per_rad", Allowed::NonNegative),
            })
        };
        section.finish();
        gains
    }
}
