//! Series spring: the torque of a gear by its torsion alone.
//!
//! ```text
//! torsion = torsion_fs(tau) + torsion_wg(tau/N)/N          flexspline and wave generator in series
//! ```
//!
//! Z takes the wave generator's torque from the motor current, and where friction hides it keeps the last one known or
//! takes `tau/N` instead (Z 22). Each such case has its own error, up to all of the friction through half of the
//! gear's compliance, so the torque steps when a joint begins to turn. A torque that is fed back at once, or whose
//! changes are compared with another's, must not step: here the wave generator always bears `tau/N`, as it does in
//! balance. The inverse is tabulated at construction; between its points it is a straight line.

use super::law::ComplianceParameters;

/// Intervals of the table. With 256 the lines of the shipped joints are within 0.01 % of the torque limit of the
/// curve.
const INTERVALS: usize = 256;

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct SeriesSpring {
    /// tau at equally distant torsions from zero on, N·m; odd, so that half of it is enough.
    torques: Vec<f64>,
    /// Intervals per torsion, 1/rad.
    per_torsion: f64,
}

impl SeriesSpring {
    /// `limit`: greatest torque, N·m.
    pub(super) fn new(compliance: &ComplianceParameters, gear_ratio: f64, limit: f64) -> Self {
        let torsion = |tau: f64| {
            compliance.flexspline_torsion(tau)
                + compliance.wave_generator_torsion(tau / gear_ratio) / gear_ratio
        };
        let most = torsion(limit);
        let at = |k: usize| {
            let wanted = most * k as f64 / INTERVALS as f64;
            // The torsion grows with the torque, so halving finds it.
            let (mut low, mut high) = (0.0, limit);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if torsion(middle) < wanted {
                    low = middle
                } else {
                    high = middle
                }
            }
            0.5 * (low + high)
        };
        Self {
            torques: (0..=INTERVALS).map(at).collect(),
            per_torsion: INTERVALS as f64 / most,
        }
    }

    /// tau at a torsion, N·m; none from the limit's on.
    pub(super) fn torque(&self, torsion: f64) -> Option<f64> {
        let place = torsion.abs() * self.per_torsion;
        // Not a number becomes 0, and fails the comparison of the line.
        let interval = place as usize;
        let [low, high] = *self.torques.get(interval..)?.first_chunk::<2>()?;
        let tau = low + (place - interval as f64) * (high - low);
        tau.is_finite().then_some(tau.copysign(torsion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const Z: ComplianceParameters = ComplianceParameters {
        k_fs0: 8333.0,
        c_fs: 0.089,
        k_wg0: 1.33,
        c_wg: 83.5,
    };

    fn torsion(tau: f64) -> f64 {
        Z.flexspline_torsion(tau) + Z.wave_generator_torsion(tau / 100.0) / 100.0
    }

    #[test]
    fn it_inverts_flexspline_and_wave_generator_in_series() {
        let spring = SeriesSpring::new(&Z, 100.0, 30.0);
        for k in -299..300 {
            let tau = 0.1 * f64::from(k);
            let found = spring.torque(torsion(tau)).unwrap();
            assert!((found - tau).abs() < 3e-3, "{tau}: {found}");
        }
    }

    #[test]
    fn beyond_the_limit_and_for_no_number_there_is_none() {
        let spring = SeriesSpring::new(&Z, 100.0, 30.0);
        for x in [
            torsion(30.1),
            -torsion(30.1),
            f64::NAN,
            f64::INFINITY,
            1e300,
        ] {
            assert_eq!(spring.torque(x), None, "{x}");
        }
    }
}
