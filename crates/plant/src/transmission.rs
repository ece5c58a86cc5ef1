//! A harmonic drive's torque against its torsion, in a form that no estimator uses.
//!
//! Elastic part: a soft wind-up zone around zero, then a line, then a cubic rise:
//! `T(x) = K x (1 + b x²) - (1 - r) K w tanh(x / w)`, slope `r K` at zero. Hysteresis: four
//! Coulomb-limited springs in parallel (Maxwell slip), independent of rate, closed loops.

use crate::parameters::TransmissionParameters;

const ELEMENTS: usize = 4;
/// Stretch at which each element slips, in units of `hysteresis_span`.
const SLIP: [f64; ELEMENTS] = [0.25, 0.5, 1.0, 2.0];

/// The gear between wave generator and link.
#[derive(Debug, Clone)]
pub struct Transmission {
    parameters: TransmissionParameters,
    /// Stretch of each element, rad.
    stretch: [f64; ELEMENTS],
}

impl Transmission {
    /// A gear at rest without history.
    #[must_use]
    pub fn new(parameters: &TransmissionParameters) -> Self {
        Self {
            parameters: parameters.clone(),
            stretch: [0.0; ELEMENTS],
        }
    }

    /// Elastic torque and stiffness at torsion `x`.
    fn elastic(&self, x: f64) -> (f64, f64) {
        let p = &self.parameters;
        let soft = (1.0 - p.windup_stiffness_ratio) * p.stiffness;
        let t = (x / p.windup).tanh();
        let square = p.stiffening * x * x;
        (
            p.stiffness * x * (1.0 + square) - soft * p.windup * t,
            p.stiffness * (1.0 + 3.0 * square) - soft * (1.0 - t * t),
        )
    }

    /// Torque and stiffness at torsion `x`, reached by a move of `dx` from the last `advance`.
    #[must_use]
    pub fn torque(&self, x: f64, dx: f64) -> (f64, f64) {
        let (mut torque, mut stiffness) = self.elastic(x);
        let share = self.parameters.hysteresis / ELEMENTS as f64;
        for (stretch, slip) in self.stretch.iter().zip(SLIP) {
            let limit = slip * self.parameters.hysteresis_span;
            let stretched = stretch + dx;
            torque += share * (stretched / limit).clamp(-1.0, 1.0);
            if stretched.abs() < limit {
                stiffness += share / limit;
            }
        }
        (torque, stiffness)
    }

    /// Advances the torsion by `dx`.
    pub fn advance(&mut self, dx: f64) {
        for (stretch, slip) in self.stretch.iter_mut().zip(SLIP) {
            let limit = slip * self.parameters.hysteresis_span;
            *stretch = (*stretch + dx).clamp(-limit, limit);
        }
    }

    /// Puts every spring at a part of its limit, -1 to 1, as a past made it; gives the torsion that carries
    /// `torque` then, rad.
    pub fn settle(&mut self, torque: f64, past: f64) -> f64 {
        for (stretch, slip) in self.stretch.iter_mut().zip(SLIP) {
            *stretch = past * slip * self.parameters.hysteresis_span;
        }
        self.torsion_of(torque - past * self.parameters.hysteresis)
    }

    /// The torsion that carries `torque` without hysteresis, rad.
    #[must_use]
    pub fn torsion_of(&self, torque: f64) -> f64 {
        let mut x = torque / self.parameters.stiffness;
        for _ in 0..50 {
            let (t, k) = self.elastic(x);
            x += (torque - t) / k.max(self.parameters.stiffness * 0.5);
        }
        x
    }

    /// `d`: damping, N·m·s/rad.
    #[must_use]
    pub fn damping(&self) -> f64 {
        self.parameters.damping
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gear() -> Transmission {
        Transmission::new(&TransmissionParameters {
            stiffness: 8333.0,
            stiffening: 2.9e5,
            windup_stiffness_ratio: 0.5,
            windup: 1e-4,
            damping: 0.1,
            hysteresis: 0.3,
            hysteresis_span: 1e-4,
        })
    }

    #[test]
    fn a_gear_with_a_past_carries_the_torque_and_forgets_the_past() {
        let (mut gear, mut other) = (gear(), gear());
        let x = gear.settle(4.0, 0.7);
        assert!((gear.torque(x, 0.0).0 - 4.0).abs() < 1e-9);
        let y = other.settle(4.0, -0.7);
        assert!(y > x);
        // Both through the whole hysteresis to one torsion.
        for (gear, from) in [(&mut gear, x), (&mut other, y)] {
            gear.advance(2e-3 - from);
        }
        assert_eq!(gear.stretch, other.stretch);
    }

    #[test]
    fn stiffness_is_the_slope_and_torsion_the_inverse() {
        let gear = gear();
        for i in -20..=20 {
            let x = f64::from(i) * 7.3e-5;
            let h = 1e-8;
            let slope = (gear.elastic(x + h).0 - gear.elastic(x - h).0) / (2.0 * h);
            assert!((slope - gear.elastic(x).1).abs() < 1e-3 * slope);
            assert!((gear.torsion_of(gear.elastic(x).0) - x).abs() < 1e-12);
        }
    }

    #[test]
    fn a_closed_loop_of_torsion_loses_energy_and_comes_back() {
        let mut gear = gear();
        let step = 1e-6;
        let run = |gear: &mut Transmission, from: i32, to: i32| {
            let (mut work, sign) = (0.0, (to - from).signum());
            let mut x = f64::from(from) * step;
            while (x - f64::from(to) * step).abs() > 0.5 * step {
                let dx = f64::from(sign) * step;
                let (torque, _) = gear.torque(x + 0.5 * dx, 0.5 * dx);
                work += torque * dx;
                gear.advance(dx);
                x += dx;
            }
            work
        };
        run(&mut gear, 0, 1000);
        let at_top = gear.stretch;
        let loss = run(&mut gear, 1000, -1000) + run(&mut gear, -1000, 1000);
        for (a, b) in gear.stretch.iter().zip(at_top) {
            assert!((a - b).abs() < 1e-12, "the loop does not close");
        }
        // Each element slips over (stroke - 2 limit) both ways at its share of the torque.
        let expected: f64 = (SLIP.iter())
            .map(|s| 2.0 * 0.3 / 4.0 * (2e-3 - 2.0 * s * 1e-4))
            .sum();
        assert!(
            (loss - expected).abs() < 0.01 * expected,
            "{loss} {expected}"
        );
    }
}
