//! The compliance of flexspline and wave generator (Z 7-20).

use std::f64::consts::FRAC_PI_2;

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

/// A torque, and whether the torsion's torque exceeds the limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturated {
    /// The torque, N·m, within plus or minus the limit.
    pub tau: f64,
    /// Whether the limit was reached.
    pub saturated: bool,
}

impl ComplianceParameters {
    /// K_fl: local stiffness of the flexspline at torque `tau`, N·m/rad.
    #[must_use]
    pub fn stiffness(&self, tau: f64) -> f64 {
        //= Z10: K_fl = K_fs0 (1 + (C_fs tau)^2)
        self.k_fs0 * (1.0 + (self.c_fs * tau).powi(2))
    }

    /// torsion_fs: the flexspline's torsion at torque `tau`, rad, link side.
    #[must_use]
    pub fn flexspline_torsion(&self, tau: f64) -> f64 {
        //= Z12: torsion_fs = atan(C_fs tau) / (C_fs K_fs0)
        if self.c_fs > 0.0 {
            (self.c_fs * tau).atan() / (self.c_fs * self.k_fs0)
        } else {
            // The limit of Z12 for C_fs -> 0: a linear spring.
            tau / self.k_fs0
        }
    }

    /// torsion_wg: the wave generator's torsion at torque `tau_wg`, rad, both motor side.
    #[must_use]
    pub fn wave_generator_torsion(&self, tau_wg: f64) -> f64 {
        //= Z15: torsion_wg = sign(tau_wg) (1 - exp(-C_wg |tau_wg|)) / (C_wg K_wg0)
        if self.c_wg > 0.0 {
            let yielded = 1.0 - (-self.c_wg * tau_wg.abs()).exp();
            (yielded / (self.c_wg * self.k_wg0)).copysign(tau_wg)
        } else {
            tau_wg / self.k_wg0
        }
    }

    /// tau: the torque that twists the flexspline by `torsion_fs`, at most `limit`, N·m.
    #[must_use]
    pub fn torque(&self, torsion_fs: f64, limit: f64) -> Saturated {
        self.torque_within(torsion_fs, limit, self.flexspline_torsion(limit))
    }

    /// [`Self::torque`], `torsion_limit` being the flexspline's torsion at `limit`.
    pub(super) fn torque_within(
        &self,
        torsion_fs: f64,
        limit: f64,
        torsion_limit: f64,
    ) -> Saturated {
        // Compared as torsions: the tangent changes its sign beyond pi/2 and would wrap.
        if torsion_fs.abs() >= torsion_limit {
            return Saturated {
                tau: limit.copysign(torsion_fs),
                saturated: true,
            };
        }
        let tau = if self.c_fs > 0.0 {
            //= Z20: tau = tan(C_fs K_fs0 torsion_fs) / C_fs
            let angle = self.c_fs * self.k_fs0 * torsion_fs;
            debug_assert!(
                angle.abs() < FRAC_PI_2,
                "beyond the tangent's pole: {angle}"
            );
            angle.tan() / self.c_fs
        } else {
            self.k_fs0 * torsion_fs
        };
        Saturated {
            tau: tau.clamp(-limit, limit),
            saturated: false,
        }
    }
}
