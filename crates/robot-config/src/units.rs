//! Units of signals, as DBC files write them.

use can_codec::Signal;
use core::f64::consts::TAU;
use problem::Problem;

/// Quantity that a signal measures or commands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Quantity {
    /// An angle; the unit `count` needs the counts of a turn, which `key` of the drive gives.
    Angle {
        counts_per_turn: Option<f64>,
        key: &'static str,
    },
    /// A way; the unit `count` needs the counts of a mm, which `key` of the drive gives.
    Length {
        counts_per_mm: Option<f64>,
        key: &'static str,
    },
    Velocity,
    Current,
    Force,
    Torque,
    Acceleration,
    Temperature,
    Voltage,
    /// A number whose unit does not matter.
    Status,
}

/// Standard gravity (CGPM 1901), m/s²: the unit `g`.
const STANDARD_GRAVITY: f64 = 9.80665;

/// Steps of a position that no drive has, rad or m.
const COARSE: f64 = 0.1;

impl Quantity {
    /// An angle or a way: its integers count on beyond their range.
    pub(crate) fn is_position(self) -> bool {
        matches!(self, Self::Angle { .. } | Self::Length { .. })
    }

    /// Refuses a position whose integers are whole radians or so, each `resolution` in SI: a float whose type is missing.
    pub(crate) fn too_coarse(self, signal: &Signal, resolution: f64) -> Option<Problem> {
        let (unit, scale) = (&signal.unit, signal.scale);
        let fine = resolution < COARSE || matches!(unit.as_str(), "count" | "counts");
        if fine || !signal.coding.is_integer() || !self.is_position() {
            return None;
        }
        let reason = format!(
            "signal {} is an integer of {} bits that counts in steps of {scale} {unit}",
            signal.name, signal.size
        );
        let allowed =
            "finer steps; for a float, its type in the DBC file (`SIG_VALTYPE_ id name : 1;`)";
        Some(Problem::new(reason, allowed))
    }

    /// SI units per `unit`.
    pub(crate) fn si_per(self, unit: &str) -> Result<f64, Problem> {
        let degree = TAU / 360.0;
        let refused = |allowed| Problem::new(format!("unit {unit:?} is not allowed"), allowed);
        let table: &[(&str, f64)] = match self {
            Self::Angle {
                counts_per_turn,
                key,
            } => {
                if matches!(unit, "count" | "counts") {
                    return counts_per_turn.map(|counts| TAU / counts).ok_or_else(|| {
                        let allowed = format!("rad, deg, or count with {key} of the drive");
                        refused(allowed)
                    });
                }
                &[("rad", 1.0), ("deg", degree)]
            }
            Self::Length { counts_per_mm, key } => {
                if matches!(unit, "count" | "counts") {
                    return counts_per_mm.map(|counts| 1e-3 / counts).ok_or_else(|| {
                        refused(format!("m, mm, um, or count with {key} of the drive"))
                    });
                }
                &[("m", 1.0), ("mm", 1e-3), ("um", 1e-6)]
            }
            Self::Velocity => &[("rad/s", 1.0), ("deg/s", degree), ("rpm", TAU / 60.0)],
            Self::Current => &[("A", 1.0), ("mA", 1e-3)],
            Self::Force => &[("N", 1.0)],
            Self::Torque => &[("Nm", 1.0), ("N.m", 1.0), ("N*m", 1.0)],
            Self::Acceleration => &[("m/s2", 1.0), ("m/s^2", 1.0), ("g", STANDARD_GRAVITY)],
            Self::Temperature => &[("degC", 1.0), ("°C", 1.0)],
            Self::Voltage => &[("V", 1.0), ("mV", 1e-3)],
            Self::Status => return Ok(1.0),
        };
        let found = table.iter().find(|(name, _)| *name == unit);
        found.map(|(_, factor)| *factor).ok_or_else(|| {
            let mut names: Vec<&str> = table.iter().map(|(name, _)| *name).collect();
            if self.is_position() {
                names.push("count");
            }
            refused(names.join(", "))
        })
    }
}

/// Desired positions may lie this far beyond a limit, rad of a revolute joint: it may be held there by
/// its load.
pub(crate) const BEYOND_LIMIT: f64 = core::f64::consts::PI / 180.0;
