//! The kind of a joint, and with it the units of its quantities.

use std::borrow::Cow;

/// Kind of a joint's motion.
///
/// Every quantity of a joint on the link side of its gear is in the units of its kind: angles in rad and
/// torques in N·m of a revolute joint, lengths in m and forces in N of a prismatic one. All equations of
/// the loop hold for both: the gear ratio N of a prismatic joint is the motor's angle for a way of the
/// joint, rad/m, so that a torque at the motor times N is a force at the joint. The motor side is in rad
/// and N·m of every joint. Nothing but this type knows which unit goes with which kind.
#[repr(u32)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum JointKind {
    /// The joint turns about its axis: revolute and continuous joints of the URDF.
    #[default]
    Revolute = 0,
    /// The joint moves along its axis.
    Prismatic = 1,
}

/// Units of a revolute joint as names and messages have them, the same of a prismatic one.
const UNITS: [(&str, &str); 11] = [
    ("N·m·s", "N·s"),
    ("N·m", "N"),
    ("Nms", "Ns"),
    ("Nm", "N"),
    ("mN·m", "mN"),
    ("rad2", "m2"),
    ("rad²", "m²"),
    ("rad", "m"),
    ("deg", "mm"),
    ("degrees", "mm"),
    ("DEGREES", "MM"),
];

/// Way along the axis of a prismatic joint that counts as much as an angle, m/rad: thresholds that separate
/// rest from motion, or an error from a normal difference, are angles for revolute joints. It is the way
/// of a gear's teeth at 0.1 m from the axis.
const WAY_PER_ANGLE: f64 = 0.1;

impl JointKind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Self; 2] = [Self::Revolute, Self::Prismatic];

    /// The number that records carry.
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// The kind of that number; of an unknown one revolute.
    #[must_use]
    pub fn from_number(number: u32) -> Self {
        let of_number = |kind: &Self| kind.number() == number;
        Self::ALL.into_iter().find(of_number).unwrap_or_default()
    }

    /// Its name, as URDFs have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Prismatic => "prismatic",
        }
    }

    /// A key, a heading or a unit of a revolute joint's link-side quantity with the units of this kind:
    /// `torque_limit_Nm` is `torque_limit_N` of a prismatic joint, `N·m/rad` is `N/m`.
    #[must_use]
    pub fn units(self, of_revolute: &str) -> Cow<'_, str> {
        match self {
            Self::Revolute => Cow::Borrowed(of_revolute),
            Self::Prismatic => Cow::Owned(replaced(of_revolute)),
        }
    }

    /// A position as operators read it: in deg or mm; from rad or m.
    #[must_use]
    pub fn shown(self, position: f64) -> f64 {
        match self {
            Self::Revolute => position.to_degrees(),
            Self::Prismatic => 1e3 * position,
        }
    }

    /// A position in SI units, rad or m; from deg or mm.
    #[must_use]
    pub fn si(self, shown: f64) -> f64 {
        match self {
            Self::Revolute => shown.to_radians(),
            Self::Prismatic => 1e-3 * shown,
        }
    }

    /// The threshold of this kind, rad or m and their rates, that counts as much as an angle in rad.
    #[must_use]
    pub const fn threshold(self, angle: f64) -> f64 {
        match self {
            Self::Revolute => angle,
            Self::Prismatic => WAY_PER_ANGLE * angle,
        }
    }
}

/// The text with each unit of a revolute joint, as a word of its own, replaced.
fn replaced(text: &str) -> String {
    let in_word = |c: char| c.is_alphanumeric() || c == '·';
    let mut result = String::new();
    let mut rest = text;
    while !rest.is_empty() {
        let word = rest.find(|c| !in_word(c)).unwrap_or(rest.len());
        let (head, tail) = rest.split_at(word);
        let unit = UNITS.into_iter().find(|(revolute, _)| *revolute == head);
        result.push_str(unit.map_or(head, |(_, prismatic)| prismatic));
        let gap = tail.find(in_word).unwrap_or(tail.len());
        let (between, next) = tail.split_at(gap);
        result.push_str(between);
        rest = next;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_prismatic_joints() {
        for (revolute, prismatic) in [
            ("torque_limit_Nm", "torque_limit_N"),
            ("K_s_Nm_per_rad", "K_s_N_per_m"),
            ("K_d_Nms_per_rad", "K_d_Ns_per_m"),
            ("K_tau_rad_per_Nm", "K_tau_m_per_N"),
            ("deceleration_rad_per_s2", "deceleration_m_per_s2"),
            ("position_min_deg", "position_min_mm"),
            ("stiffening_per_rad2", "stiffening_per_m2"),
            ("N·m·s/rad", "N·s/m"),
            ("rad/Nm", "m/N"),
            ("max |dq| rad/s", "max |dq| m/s"),
            ("tau_hat N·m", "tau_hat N"),
            ("radius, normal", "radius, normal"),
            ("A", "A"),
            ("", ""),
        ] {
            assert_eq!(JointKind::Prismatic.units(revolute), prismatic);
            assert_eq!(JointKind::Revolute.units(revolute), revolute);
        }
    }

    #[test]
    fn positions_and_numbers_go_there_and_back() {
        for kind in JointKind::ALL {
            assert_eq!(JointKind::from_number(kind.number()), kind);
            assert!((kind.si(kind.shown(0.37)) - 0.37).abs() < 1e-15);
        }
        assert_eq!(JointKind::from_number(7), JointKind::Revolute);
        assert!((JointKind::Prismatic.si(250.0) - 0.25).abs() < 1e-15);
    }
}
