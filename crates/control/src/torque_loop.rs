//! Feedback on the estimated torque (D11).

use crate::gains::JointGains;

/// The torque loop of one joint: the desired torque plus PI feedback of its error. Its integral
/// lives as long as the mode that owns the loop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TorqueLoop {
    integral: f64,
}

impl TorqueLoop {
    /// tau*: torque that the motor is to produce, N·m (D11).
    ///
    /// Without a valid estimate the error counts as zero, so the integral keeps its value. It stops
    /// growing where it would push further into `torque_limit` (anti-windup).
    #[must_use]
    pub fn update(
        &mut self,
        tau_d: f64,
        tau_hat: Option<f64>,
        gains: &JointGains,
        torque_limit: f64,
        dt: f64,
    ) -> f64 {
        let error = tau_hat.map_or(0.0, |tau_hat| tau_d - tau_hat);
        let integral = self.integral + error * dt;
        //= D11: tau* = tau_d + K_p (tau_d - tau_hat) + K_i integral(tau_d - tau_hat)
        let tau_star = tau_d + gains.k_p * error + gains.k_i * integral;
        let winds_up = tau_star.abs() > torque_limit && tau_star * error > 0.0;
        if !winds_up {
            self.integral = integral;
        }
        tau_star
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: JointGains = JointGains {
        k_p: 2.0,
        k_i: 10.0,
        k_s: 0.0,
        k_d: 0.0,
    };

    #[test]
    fn integral_removes_a_constant_error_of_the_motor_model() {
        // The motor produces 80 % of tau*, less 1 N·m.
        let mut torque_loop = TorqueLoop::default();
        let mut tau = 0.0;
        for _ in 0..5000 {
            let tau_star = torque_loop.update(10.0, Some(tau), &GAINS, 100.0, 1e-3);
            tau += 0.05 * (0.8 * tau_star - 1.0 - tau);
        }
        assert!((tau - 10.0).abs() < 1e-6, "tau = {tau}");
    }

    #[test]
    fn integral_does_not_wind_up_at_the_limit() {
        let mut torque_loop = TorqueLoop::default();
        for _ in 0..10_000 {
            let _ = torque_loop.update(50.0, Some(0.0), &GAINS, 20.0, 1e-3);
        }
        // With an error of opposite sign, the loop leaves the limit at once.
        let tau_star = torque_loop.update(0.0, Some(5.0), &GAINS, 20.0, 1e-3);
        assert!(tau_star < 0.0, "tau_star = {tau_star}");
    }

    #[test]
    fn without_an_estimate_only_the_feed_forward_remains() {
        let mut torque_loop = TorqueLoop::default();
        assert_eq!(torque_loop.update(7.0, None, &GAINS, 20.0, 1e-3), 7.0);
    }
}
