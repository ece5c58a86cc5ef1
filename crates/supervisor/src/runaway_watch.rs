//! Whether a joint that is to be brought to rest goes the faster the more its torque brakes it.
//!
//! A motor whose commutation is lost by half a turn makes the opposite torque of the one that its current shows. Its
//! drive follows every set-point, so that the current is as it should be. Both encoders show the motion.

use crate::in_a_row::count_in_a_row;

/// Cycles of each of the two ways that are compared.
const SPAN: usize = 10;

/// When a joint runs away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunawayParameters {
    /// Least way of both encoders in a cycle, rad.
    pub way: f64,
    /// Least torque against the motion, N·m, link side.
    pub torque: f64,
    /// Cycles in a row for which the joint must be braked, and not become slower.
    pub samples: u32,
}

/// Follows one joint from the cycle in which it is to come to rest.
#[derive(Debug, Clone)]
pub struct RunawayWatch {
    parameters: RunawayParameters,
    /// Motor-side and link-side angles of the last cycles, rad, the newest last.
    angles: [[f64; 2]; 2 * SPAN + 1],
    seen: usize,
    braked: u32,
}

impl RunawayWatch {
    /// Watch of a joint, not begun yet.
    #[must_use]
    pub fn new(parameters: RunawayParameters) -> Self {
        Self {
            parameters,
            angles: [[0.0; 2]; 2 * SPAN + 1],
            seen: 0,
            braked: 0,
        }
    }

    /// The joint is not to be watched.
    pub fn rest(&mut self) {
        (self.seen, self.braked) = (0, 0);
    }

    /// Takes both angles as they were read, rad, and the torque that was sent, N·m, link side; true: it runs away. An
    /// angle that is no number shows nothing.
    pub fn update(&mut self, angles: [f64; 2], torque: f64) -> bool {
        let p = &self.parameters;
        self.angles.rotate_left(1);
        self.angles[2 * SPAN] = angles;
        self.seen = self.seen.saturating_add(1);
        if self.seen <= 2 * SPAN {
            return false;
        }
        let against = -torque.signum();
        let runs = |side: usize| {
            let [first, middle, last] = [0, SPAN, 2 * SPAN].map(|k| against * self.angles[k][side]);
            let [before, now] = [middle - first, last - middle];
            now > SPAN as f64 * p.way && now >= before
        };
        let runs = torque.abs() >= p.torque && runs(0) && runs(1);
        count_in_a_row(&mut self.braked, runs) >= p.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: RunawayParameters = RunawayParameters {
        way: 3e-4,
        torque: 10.0,
        samples: 20,
    };
    const PERIOD: f64 = 1e-3;

    /// The cycle in which a joint of 2 kg·m² runs away that begins with 1 rad/s and is braked by 3 N·m·s/rad and a
    /// least torque, of which it feels so many times as much.
    fn runs(felt: f64, push: f64) -> Option<usize> {
        let mut watch = RunawayWatch::new(PARAMETERS);
        let (mut q, mut dq) = (0.3, 1.0);
        (0..400).find(|_| {
            let torque = -(12.0 + 3.0 * dq) * f64::signum(dq);
            dq += (felt * torque + push) / 2.0 * PERIOD;
            q += dq * PERIOD;
            watch.update([q + 0.01, q], torque)
        })
    }

    #[test]
    fn a_motor_that_pushes_the_other_way_is_found_and_one_that_brakes_is_not() {
        assert_eq!(runs(-1.0, 0.0), Some(2 * SPAN + 19));
        assert_eq!(runs(1.0, 0.0), None);
        assert_eq!(runs(1.0, 8.0), None, "a hand that gives way");
    }

    #[test]
    fn one_encoder_alone_shows_nothing() {
        for frozen in [0, 1] {
            let mut watch = RunawayWatch::new(PARAMETERS);
            let found = (0..400).any(|k| {
                let mut angles = [1e-6 * f64::from(k * k); 2];
                angles[frozen] = if k < 100 { 0.0 } else { f64::NAN };
                watch.update(angles, -50.0)
            });
            assert!(!found);
        }
    }
}
