//! The shipped joints about which sizes are drawn: what config/ says of them.

use test_support::read_project_file;
use toml::{Table, Value};

/// Robot and drive, rated torque, N·m, and torque limit, N·m. Rated: catalogue of the gear, as config/*/sim.toml has it.
const JOINTS: [(&str, &str, f64, f64); 7] = [
    ("test-joint", "joint", 16.0, 37.0),
    ("leg", "hip_yaw", 28.0, 57.0),
    ("leg", "hip_roll", 110.0, 233.0),
    ("leg", "hip_pitch", 55.0, 110.0),
    ("leg", "knee", 110.0, 233.0),
    ("leg", "ankle_pitch", 55.0, 110.0),
    ("leg", "ankle_roll", 28.0, 57.0),
];

/// A shipped joint's numbers.
#[derive(Debug, Clone)]
pub(crate) struct Catalogue {
    pub(crate) name: String,
    /// N·m.
    pub(crate) rated: f64,
    pub(crate) limit: f64,
    pub(crate) ratio: f64,
    /// N·m/A, motor side.
    pub(crate) torque_constant: f64,
    /// kg·m², motor side.
    pub(crate) rotor: f64,
    pub(crate) max_velocity: f64,
    /// Z's constants: flexspline on the link side, wave generator on the motor's.
    pub(crate) k_fs0: f64,
    pub(crate) c_fs: f64,
    pub(crate) k_wg0: f64,
    pub(crate) c_wg: f64,
    /// N·m and N·m·s/rad, motor side.
    pub(crate) coulomb: f64,
    pub(crate) viscous: f64,
    pub(crate) k_tau: f64,
    pub(crate) k_v: f64,
}

impl Catalogue {
    /// All of them.
    ///
    /// # Errors
    /// A file without them.
    pub(crate) fn all() -> Result<Vec<Self>, String> {
        JOINTS.iter().map(Self::read).collect()
    }

    fn read(&(robot, drive, rated, limit): &(&str, &str, f64, f64)) -> Result<Self, String> {
        let path = format!("config/{robot}/robot.toml");
        let text = read_project_file(&path).map_err(|e| format!("{path}: {e}"))?;
        let table: Table = text.parse().map_err(|e| format!("{path}: {e}"))?;
        let number = |keys: &[&str]| {
            let of_drive = ["drive", drive];
            let mut keys = of_drive.iter().chain(keys);
            let first = table.get(*keys.next().unwrap_or(&""));
            let found = keys.fold(first, |value, key| value?.get(*key));
            match found {
                Some(Value::Float(x)) => Ok(*x),
                Some(Value::Integer(x)) => Ok(*x as f64),
                _ => Err(format!("{path}: drive {drive} without a number")),
            }
        };
        Ok(Self {
            name: drive.to_owned(),
            rated,
            limit,
            ratio: number(&["gear_ratio"])?,
            torque_constant: number(&["torque_constant_Nm_per_A"])?,
            rotor: number(&["rotor_inertia_kg_m2"])?,
            max_velocity: number(&["max_velocity_rad_per_s"])?,
            k_fs0: number(&["compliance", "K_fs0_Nm_per_rad"])?,
            c_fs: number(&["compliance", "C_fs_per_Nm"])?,
            k_wg0: number(&["compliance", "K_wg0_Nm_per_rad"])?,
            c_wg: number(&["compliance", "C_wg_per_Nm"])?,
            coulomb: number(&["friction", "coulomb_Nm"])?,
            viscous: number(&["friction", "viscous_Nms_per_rad"])?,
            k_tau: number(&["motor", "K_tau_rad_per_Nm"])?,
            k_v: number(&["motor", "K_v_s"])?,
        })
    }

    /// k_d of the drive's position loop, N·m/rad (docs/control.md).
    pub(crate) fn drive_stiffness(&self) -> f64 {
        1.0 / (self.k_tau - 1.0 / self.k_fs0)
    }

    /// Torsion of flexspline and wave generator under a torque by Z's equations 12 and 15, rad.
    pub(crate) fn torsion(&self, torque: f64) -> f64 {
        let flexspline = (self.c_fs * torque).atan() / (self.c_fs * self.k_fs0);
        let at_motor = torque / self.ratio;
        let generator = (1.0 - (-self.c_wg * at_motor).exp()) / (self.c_wg * self.k_wg0);
        flexspline + generator / self.ratio
    }
}
