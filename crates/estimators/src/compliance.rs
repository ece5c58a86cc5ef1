//! Placeholder: parameters of the harmonic drive's compliance model (Z 10-15).

/// Constants of the compliance model (Z Table II).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComplianceParameters {
    /// K_fs0: flexspline stiffness at zero torque, N·m/rad.
    pub k_fs0: f64,
    /// C_fs: growth of the flexspline's stiffness, 1/(N·m).
    pub c_fs: f64,
    /// K_wg0: wave-generator stiffness at zero torque, motor side, N·m/rad.
    pub k_wg0: f64,
    /// C_wg: growth of the wave generator's stiffness, 1/(N·m).
    pub c_wg: f64,
}
