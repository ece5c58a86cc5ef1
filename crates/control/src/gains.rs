//! Feedback gains of a joint, as torque gains or as equivalent position gains (D13, D14).

/// A joint's feedback gains as the control law uses them (D11, D12).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointGains {
    /// K_p: proportional gain on the torque error, dimensionless.
    pub k_p: f64,
    /// K_i: integral gain on the torque error, 1/s.
    pub k_i: f64,
    /// K_s: stiffness, N·m/rad.
    pub k_s: f64,
    /// K_d: damping, N·m·s/rad.
    pub k_d: f64,
}

/// Gains as factors of the errors in the commanded position (D13).
///
/// K8 and K9 are K_tau K_p times the mass matrix and a product with the contact Jacobian: they
/// depend on the configuration and follow from `k_p` alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EquivalentGains {
    /// K6: commanded rad per rad of position error; 1 equals the drive's own position gain.
    pub k6: f64,
    /// K7: commanded rad per rad/s of velocity error, s.
    pub k7: f64,
}

impl JointGains {
    /// The gains on position and velocity error in the commanded position (D14).
    #[must_use]
    pub fn equivalent(&self, k_tau: f64) -> EquivalentGains {
        //= D14: K6 = K_tau (1 + K_p) K_s, K7 = K_tau (1 + K_p) K_d
        EquivalentGains {
            k6: k_tau * (1.0 + self.k_p) * self.k_s,
            k7: k_tau * (1.0 + self.k_p) * self.k_d,
        }
    }

    /// The gains whose equivalents are `gains` (D14 solved for K_s and K_d).
    #[must_use]
    pub fn from_equivalent(gains: EquivalentGains, k_tau: f64, k_p: f64, k_i: f64) -> Self {
        //= D14: K_s = K6 / (K_tau (1 + K_p)), K_d = K7 / (K_tau (1 + K_p))
        let factor = k_tau * (1.0 + k_p);
        Self {
            k_p,
            k_i,
            k_s: gains.k6 / factor,
            k_d: gains.k7 / factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::JointGains;

    #[test]
    fn equivalent_gains_lead_back_to_the_same_gains() {
        let gains = JointGains {
            k_p: 2.0,
            k_i: 0.5,
            k_s: 2777.0,
            k_d: 12.0,
        };
        let k_tau = 1.2e-4;
        let equivalent = gains.equivalent(k_tau);
        assert!((equivalent.k6 - 0.99972).abs() < 1e-12);
        let back = JointGains::from_equivalent(equivalent, k_tau, gains.k_p, gains.k_i);
        assert!((back.k_s - gains.k_s).abs() < 1e-9);
        assert!((back.k_d - gains.k_d).abs() < 1e-12);
    }
}
