//! Margins of the hold of a drive that takes currents: a spring, damping by filtered velocities, and an integral.
//!
//! Gear and link turn as one: where they do not, the two encoders show opposite velocities, and the hold uses
//! neither. The loop is opened at the motor's torque:
//!
//! ```text
//! L = (K_s + K_s² / (10 K_d s) + K_d V) D / (J s²)
//! ```
//!
//! with the taps `V` of the velocities' filter and `D`, transport and hold of a command. Friction helps, and is
//! not counted on.

use super::response::{Delays, nyquist};
use super::{Load, Margins};
use nalgebra::Complex;

/// Integral time of a hold in units of K_d / K_s: slow enough to leave spring and damping as they are. Where they meet
/// it takes atan(1/10) = 6 degrees of phase.
pub const INTEGRAL_TIMES: f64 = 10.0;

/// The hold of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct HoldLoop {
    /// Inertia of rotor and link, kg·m², link side.
    pub inertia: [f64; 2],
    /// K_s: spring, N·m/rad.
    pub k_s: f64,
    /// K_d: its damping, N·m·s/rad.
    pub k_d: f64,
    /// Weights of the angles in the velocity that control uses, oldest first, 1/s.
    pub velocity: Vec<f64>,
    /// Time from a sample to the torque that it leads to, s.
    pub delay: f64,
    /// Sample period, s.
    pub sample_period: f64,
}

impl HoldLoop {
    /// The least margins over the loads that move, each with the load at which it occurs.
    #[must_use]
    pub fn least_margins(&self) -> (Margins, [Load; 2]) {
        super::least(&Load::MOVING, |load| self.margins(load))
    }

    /// The largest stiffness, N·m/rad, with this hold's damping over stiffness, that keeps these margins, within a
    /// tenth; zero if there is none. With much less stiffness the integral is too fast for it, so the search goes
    /// downwards.
    #[must_use]
    pub fn largest_stiffness(&self, needed: Margins) -> f64 {
        let shares = (1..80).map(|k| 0.9_f64.powi(k));
        let mut tried = shares.map(|share| Self {
            k_s: share * self.k_s,
            k_d: share * self.k_d,
            ..self.clone()
        });
        tried
            .find(|tried| tried.least_margins().0.keeps(&needed))
            .map_or(0.0, |tried| tried.k_s)
    }

    /// Gain and phase margin with a load that moves.
    #[must_use]
    pub fn margins(&self, load: Load) -> Margins {
        let poles = match (self.integral_rate() > 0.0, self.k_s > 0.0) {
            (true, _) => 3,
            (false, true) => 2,
            (false, false) => 1,
        };
        nyquist(poles, self.sample_period, |w| self.open_loop(w, load))
    }

    fn open_loop(&self, w: f64, load: Load) -> Complex<f64> {
        let [rotor, link] = self.inertia;
        let inertia = rotor + link * load.inertia_share();
        let delays = Delays::new(w, self.sample_period);
        let integral = delays.sum(self.sample_period * self.integral_rate());
        let rate = delays.taps(&self.velocity);
        let transport = delays.hold() * delays.of(self.delay);
        (integral + self.k_s + rate * self.k_d) * transport / (-inertia * w * w)
    }

    /// Torque of the integral, N·m per rad and second.
    fn integral_rate(&self) -> f64 {
        if self.k_d > 0.0 {
            self.k_s * self.k_s / (INTEGRAL_TIMES * self.k_d)
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A joint at this rate, its velocity by a difference over `window` periods, with 3 Hz and this damping ratio.
    fn hold(rate_hz: f64, window: usize, ratio: f64, times: f64) -> HoldLoop {
        let (rotor, link) = (0.9, 0.6);
        let frequency = TAU * 3.0;
        let k_s = times * (rotor + link) * frequency * frequency;
        let mut velocity = vec![0.0; window + 1];
        let per_s = rate_hz / window as f64;
        (velocity[0], velocity[window]) = (-per_s, per_s);
        HoldLoop {
            inertia: [rotor, link],
            k_s,
            k_d: times * 2.0 * ratio * frequency * (rotor + link),
            velocity,
            delay: 1.5 / rate_hz,
            sample_period: 1.0 / rate_hz,
        }
    }

    /// Whether the hold comes to rest, by steps of the same sums in time.
    fn comes_to_rest(of: &HoldLoop) -> bool {
        let substeps = 50;
        let dt = of.sample_period / f64::from(substeps);
        let inertia = of.inertia[0] + of.inertia[1];
        let lag = (of.delay / dt).round() as usize;
        let (mut x, mut v, mut integral) = (0.01, 0.0, 0.0);
        let mut angles = vec![x; of.velocity.len()];
        let mut torques = vec![0.0; lag + 1];
        let mut largest = [0.0_f64; 2];
        let periods = (8.0 / of.sample_period) as usize;
        for period in 0..periods {
            angles.rotate_left(1);
            *angles.last_mut().unwrap() = x;
            integral += of.integral_rate() * x * of.sample_period;
            let rate: f64 = angles.iter().zip(&of.velocity).map(|(a, w)| a * w).sum();
            let torque = -(of.k_s * x + integral + of.k_d * rate);
            for _ in 0..substeps {
                torques.rotate_left(1);
                *torques.last_mut().unwrap() = torque;
                v += torques[0] / inertia * dt;
                x += v * dt;
            }
            let late = usize::from(period > periods * 3 / 4);
            largest[late] = largest[late].max(x.abs());
        }
        largest[1] < 0.5 * largest[0]
    }

    #[test]
    fn a_hold_with_margins_comes_to_rest_and_one_without_swings() {
        for (rate, window, ratio, times) in [
            (1000.0, 15, 1.0, 1.0),
            (250.0, 4, 1.0, 1.0),
            (1000.0, 15, 1.0, 2.0),
            (250.0, 15, 1.0, 1.0),
            (250.0, 15, 1.0, 10.0),
            (1000.0, 15, 1.0, 10.0),
            (1000.0, 15, 0.02, 1.0),
            (250.0, 4, 0.5, 3.0),
        ] {
            let of = hold(rate, window, ratio, times);
            let margins = of.margins(Load::Free);
            let stable = margins != Margins::NONE;
            assert_eq!(
                stable,
                comes_to_rest(&of),
                "{rate} Hz, {window}, {ratio}, {times}: {margins:?}"
            );
        }
        let good = hold(1000.0, 15, 1.0, 1.0).least_margins().0;
        assert!(good.keeps(&super::super::NEEDED), "{good:?}");
        // Ten times the gains, and a filter that is as long in samples at a quarter of the rate.
        let poor = hold(250.0, 15, 1.0, 10.0);
        assert_eq!(poor.least_margins().0, Margins::NONE);
        // No stiffness helps a filter so late; with a shorter one a lesser stiffness does.
        assert_eq!(poor.largest_stiffness(super::super::NEEDED), 0.0);
        let stiff = hold(250.0, 4, 1.0, 10.0);
        let most = stiff.largest_stiffness(super::super::NEEDED);
        assert!(most > 0.0 && most < 0.5 * stiff.k_s, "{most}");
    }
}
