//! Whether a joint that is to stand does stand, when its encoders contradict each other.
//!
//! A position drive closes its loop on its own motor encoder. When that errs, a set-point that stands
//! moves the joint: what the encoder drifts, the joint goes the other way. Nobody knows which of two
//! encoders is right, so either one that shows the joint away from where it is held ends the hold, and so
//! does a motor that presses with all that it may: the drive is switched off, and its brake holds.

use crate::in_a_row::count_in_a_row;

/// What ends the hold of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldWatchParameters {
    /// Greatest way beside the set-point's, rad, also by the velocity that it has.
    pub way: f64,
    /// Cycles ahead for which that velocity counts: as long as switching off takes.
    pub ahead: f64,
    /// Greatest torque of the motor, N·m, link side.
    pub torque: f64,
    /// Cycles for which that torque must last.
    pub samples: u32,
}

/// What a joint shows in a cycle, whether its samples are trusted or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// Motor-side and link-side angle as they were read, rad, link side.
    pub angles: [f64; 2],
    /// Torque of the motor's current, N·m, link side.
    pub torque: f64,
    /// The set-point that was sent last, rad.
    pub set_point: f64,
}

/// Follows one joint from the cycle in which its encoders are no longer trusted.
#[derive(Debug, Clone)]
pub struct HoldWatch {
    parameters: HoldWatchParameters,
    /// Sample with which the watch began.
    from: Option<Held>,
    /// Ways in the last cycles, rad, the newest first.
    ways: [[f64; 2]; SPAN],
    pressed: u32,
}

/// Cycles over which a velocity is taken, so that counts make none.
const SPAN: usize = 5;

impl HoldWatch {
    /// Watch of a joint, not begun yet.
    #[must_use]
    pub fn new(parameters: HoldWatchParameters) -> Self {
        Self {
            parameters,
            from: None,
            ways: [[0.0; 2]; SPAN],
            pressed: 0,
        }
    }

    /// The joint is not to be watched.
    pub fn rest(&mut self) {
        *self = Self::new(self.parameters);
    }

    /// Takes what the joint shows; true: it is not where it is held. An angle that is no number shows
    /// nothing.
    pub fn update(&mut self, held: &Held) -> bool {
        let p = &self.parameters;
        let from = self.from.get_or_insert(*held);
        let asked = held.set_point - from.set_point;
        let ways = [0, 1].map(|i| held.angles[i] - from.angles[i] - asked);
        let before = self.ways[SPAN - 1];
        let ahead = [0, 1].map(|i| ways[i] + (ways[i] - before[i]) / SPAN as f64 * p.ahead);
        let is_away = ahead.iter().any(|way| way.abs() > p.way);
        self.ways.rotate_right(1);
        self.ways[0] = ways;
        let pressed = count_in_a_row(&mut self.pressed, held.torque.abs() >= p.torque);
        is_away || pressed >= p.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: HoldWatchParameters = HoldWatchParameters {
        way: 0.01,
        ahead: 20.0,
        torque: 100.0,
        samples: 10,
    };

    /// The cycle in which the hold ends.
    fn ends(held: impl Fn(f64) -> Held) -> Option<usize> {
        let mut watch = HoldWatch::new(PARAMETERS);
        (0..1000).find(|&k| watch.update(&held(1e-3 * k as f64)))
    }

    const STANDS: Held = Held {
        angles: [0.3, 0.29],
        torque: 20.0,
        set_point: 0.31,
    };

    #[test]
    fn either_encoder_that_moves_away_ends_it_and_one_that_follows_the_set_point_does_not() {
        assert_eq!(ends(|_| STANDS), None);
        for moving in [0, 1] {
            let drift = |t: f64| {
                let mut held = STANDS;
                held.angles[moving] += 0.1 * t;
                held
            };
            // At 100 of 10 mrad, less the 20 cycles ahead.
            assert_eq!(ends(drift), Some(80));
        }
        let braked = |t: f64| {
            let way = 0.1 * t.min(0.5);
            Held {
                angles: STANDS.angles.map(|angle| angle + way - 0.002),
                set_point: STANDS.set_point + way,
                ..STANDS
            }
        };
        assert_eq!(ends(braked), None);
    }

    #[test]
    fn a_motor_at_its_limit_ends_it_when_that_lasts() {
        let pressing = |until: f64| {
            move |t: f64| Held {
                torque: if t < until { -101.0 } else { 0.0 },
                ..STANDS
            }
        };
        assert_eq!(ends(pressing(1.0)), Some(9));
        assert_eq!(ends(pressing(0.0085)), None);
    }
}
