//! Sample gap: how fast a joint moves whose samples have stayed away for some cycles.
//!
//! The filters of velocities bridge such a gap with what was before it. What comes then is no line through it: an
//! encoder that has slipped meanwhile looks to them like a joint that runs. Until their window has nothing of the gap,
//! the way since the first sample after it says how fast the joint moves.

use super::carry::smaller;

/// Samples that stay away in a row from which on the filters are not believed: two are in order at 1 kHz, as answers
/// may be a cycle late.
const MISSED: u32 = 3;
/// Cycles until the velocity filters' window has nothing of a gap any more.
const WINDOW: u32 = 20;

/// What is known of a joint's velocities beside its filters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Known {
    /// The filters know them.
    Filtered,
    /// Nothing: this is the first sample after a gap.
    Nothing,
    /// Of link and motor, link side, rad/s.
    Velocities([f64; 2]),
}

impl Known {
    /// The velocity that both encoders show, rad/s; `filtered`: that by the filters.
    pub(super) fn velocity(self, filtered: f64) -> f64 {
        match self {
            Self::Velocities([link, motor]) => smaller(link, motor),
            _ => filtered,
        }
    }
}

/// Samples of a joint that stay away, and come back.
#[derive(Debug, Clone, Default)]
pub(super) struct SampleGap {
    missed: u32,
    /// The angles of the first sample after a gap, rad, and the cycles since then.
    first: Option<([f64; 2], u32)>,
}

impl SampleGap {
    /// A cycle without a sample.
    pub(super) fn miss(&mut self) {
        self.missed = self.missed.saturating_add(1);
    }

    /// A cycle with one: `angles` of link and motor, link side, rad; `dt`: sample period, s.
    pub(super) fn sample(&mut self, angles: [f64; 2], dt: f64) -> Known {
        let missed = std::mem::take(&mut self.missed);
        if missed >= MISSED {
            self.first = Some((angles, 0));
            return Known::Nothing;
        }
        let Some((first, cycles)) = &mut self.first else {
            return Known::Filtered;
        };
        // One that stays away meanwhile is bridged by the time.
        *cycles += missed + 1;
        if *cycles > WINDOW {
            self.first = None;
            return Known::Filtered;
        }
        let time = f64::from(*cycles) * dt;
        Known::Velocities([0, 1].map(|side| (angles[side] - first[side]) / time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_gap_the_way_since_then_is_the_velocity() {
        let mut gap = SampleGap::default();
        assert_eq!(gap.sample([0.1; 2], 1e-3), Known::Filtered);
        gap.miss();
        gap.miss();
        assert_eq!(gap.sample([0.1; 2], 1e-3), Known::Filtered);
        for _ in 0..MISSED {
            gap.miss();
        }
        // A slip within the gap is no velocity.
        assert_eq!(gap.sample([0.2; 2], 1e-3), Known::Nothing);
        let Known::Velocities([link, motor]) = gap.sample([0.201, 0.202], 1e-3) else {
            panic!("velocities")
        };
        assert!((link - 1.0).abs() < 1e-9 && (motor - 2.0).abs() < 1e-9);
        gap.miss();
        let known = gap.sample([0.203, 0.203], 1e-3);
        assert!((known.velocity(7.0) - 1.0).abs() < 1e-9, "{known:?}");
        let after = (0..).find(|_| gap.sample([0.203; 2], 1e-3) == Known::Filtered);
        assert_eq!(after, Some(17));
    }
}
