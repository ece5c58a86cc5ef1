//! Units of a drive's tables: those of a prismatic joint's drive have keys in m, mm and N.

use problem::Problem;
use robot_state::JointKind;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Why a `sim.toml` cannot be read.
pub(super) enum ReadError {
    /// It is no TOML, or has an unknown key or a value that is not allowed.
    Toml(toml::de::Error),
    /// A key has the units of another kind of joint; and its place.
    Units(Problem, usize),
}

impl From<toml::de::Error> for ReadError {
    fn from(error: toml::de::Error) -> Self {
        Self::Toml(error)
    }
}

/// Tables of a drive with keys of the link side, and these keys, with the units of a revolute joint.
const LINK_SIDE: [(&str, &[&str]); 4] = [
    (
        "transmission",
        &[
            DETERMINES_KIND,
            "stiffening_per_rad2",
            "windup_rad",
            "damping_Nms_per_rad",
            "hysteresis_Nm",
            "hysteresis_rad",
        ],
    ),
    ("bearing", &["coulomb_Nm", "viscous_Nms_per_rad"]),
    (
        "controller",
        &["K_4_A_per_rad", "K_5_As_per_rad", "dead_zone_rad"],
    ),
    ("kinematic_error", &["link_deg", "motor_deg"]),
];

/// The key of the table `transmission` whose units are those of the drive's joints.
const DETERMINES_KIND: &str = "stiffness_Nm_per_rad";

/// Renames the keys of drives of prismatic joints to those of revolute ones; names these drives.
pub(super) fn to_revolute(root: &mut DeTable<'_>) -> Result<Vec<String>, ReadError> {
    let mut prismatic = Vec::new();
    let Some(DeValue::Table(drives)) = root.get_mut("drive").map(Spanned::get_mut) else {
        return Ok(prismatic);
    };
    for (name, drive) in drives.iter_mut() {
        let DeValue::Table(drive) = drive.get_mut() else {
            continue;
        };
        let determines = JointKind::Prismatic.units(DETERMINES_KIND);
        let transmission = drive.get("transmission").map(Spanned::get_ref);
        let slides = transmission
            .and_then(DeValue::as_table)
            .is_some_and(|table| table.contains_key(&*determines));
        if slides {
            rename(name.get_ref(), drive)?;
            prismatic.push(name.get_ref().to_string());
        }
    }
    Ok(prismatic)
}

fn rename(name: &str, drive: &mut DeTable<'_>) -> Result<(), ReadError> {
    for (section, keys) in LINK_SIDE {
        let Some(DeValue::Table(table)) = drive.get_mut(section).map(Spanned::get_mut) else {
            continue;
        };
        for revolute in keys {
            let prismatic = JointKind::Prismatic.units(revolute);
            if let Some((key, _)) = table.get_key_value(*revolute) {
                let what =
                    format!("drive.{name}.{section}.{revolute}: the drive is for prismatic joints");
                let place: Range<usize> = key.span();
                let problem = Problem::new(what, prismatic);
                return Err(ReadError::Units(problem, place.start));
            }
            if let Some((key, value)) = table.remove_entry(&*prismatic) {
                table.insert(Spanned::new(key.span(), (*revolute).into()), value);
            }
        }
    }
    Ok(())
}
