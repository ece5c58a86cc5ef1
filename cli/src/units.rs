//! Units of joints in tables and JSON: headings and keys are those of revolute joints.

use serde_json::Value;
use torqued_client::robot_state::JointKind;

/// A cell of a table whose heading has the unit of revolute joints: of a prismatic joint with its own.
pub(crate) fn cell(kind: JointKind, text: String, unit: &str) -> String {
    match kind {
        JointKind::Revolute => text,
        JointKind::Prismatic => format!("{text} {}", kind.units(unit)),
    }
}

/// An object of a joint whose keys have the units of a revolute joint, with those of its kind.
pub(crate) fn keys(kind: JointKind, object: Value) -> Value {
    // The motor's side is in rad whatever the joint is.
    let motor_side = ["theta_rad", "omega_rad_per_s"];
    match (kind, object) {
        (JointKind::Prismatic, Value::Object(object)) => {
            let pairs = object.into_iter().map(|(key, value)| {
                let own = if motor_side.contains(&key.as_str()) {
                    key
                } else {
                    kind.units(&key).into_owned()
                };
                (own, keys(kind, value))
            });
            Value::Object(pairs.collect())
        }
        (_, other) => other,
    }
}

/// To two digits, without a sign where nothing is left.
pub(crate) fn rounded(x: f64) -> f64 {
    (100.0 * x).round() / 100.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn keys_of_prismatic_joints() {
        let object = json!({
            "q_rad": 1.0, "theta_rad": 2.0, "tau_hat": { "tau_Nm": 3.0 }, "flags": ["missed"],
        });
        assert_eq!(keys(JointKind::Revolute, object.clone()), object);
        let prismatic = json!({
            "q_m": 1.0, "theta_rad": 2.0, "tau_hat": { "tau_N": 3.0 }, "flags": ["missed"],
        });
        assert_eq!(keys(JointKind::Prismatic, object), prismatic);
    }

    #[test]
    fn what_is_rounded_to_nothing_has_no_sign() {
        let shown = |x: f64| format!("{:.2}", rounded(x));
        assert_eq!(shown(-0.004), "0.00");
        assert_eq!(shown(-0.0), "0.00");
        assert_eq!(shown(-0.006), "-0.01");
        assert_eq!(shown(12.345_6), "12.35");
    }
}
