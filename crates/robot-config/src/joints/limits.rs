//! Limits of a joint: position, torque, current, lead of the command.

use super::Reader;
use crate::drives::Drive;
use crate::reader::Allowed;
use control::JointLimits;
use dynamics::Model;

impl Reader<'_, '_, '_> {
    pub(super) fn limits(
        &self,
        torque_limit: f64,
        drive: Option<&Drive>,
        joint: Option<(&Model, usize)>,
    ) -> Option<JointLimits> {
        let section = self.section;
        let delta_q = section.number("delta_q_limit_deg", Allowed::Within(0.0, 90.0));
        let (min_deg, max_deg) = ("position_min_deg", "position_max_deg");
        // Without a model the limits cannot be checked, but the keys are known.
        let given = [min_deg, max_deg].map(|key| section.optional_number(key, Allowed::Finite));
        let (model, index) = joint?;
        let urdf = model.joint_limits(index)?;
        let min = given[0].map_or(urdf.lower, f64::to_radians);
        let max = given[1].map_or(urdf.upper, f64::to_radians);
        // Limits in degrees may exceed the URDF's by their rounding, rad.
        let rounding = 1e-6;
        let allowed = format!(
            "{:.3} to {:.3}, the URDF's limits",
            urdf.lower.to_degrees(),
            urdf.upper.to_degrees()
        );
        for (key, value) in [(min_deg, min), (max_deg, max)] {
            if value < urdf.lower - rounding || value > urdf.upper + rounding {
                let what = format!("{:.3} is not allowed", value.to_degrees());
                section.problem(key, what, &allowed);
            }
        }
        if min >= max {
            let what = format!("{:.3} is not above {min_deg}", max.to_degrees());
            section.problem(max_deg, what, allowed);
        }
        Some(JointLimits {
            position_min: min,
            position_max: max,
            torque: torque_limit.min(urdf.effort),
            delta_q: delta_q.to_radians(),
            current: drive?.current_limit,
        })
    }
}
