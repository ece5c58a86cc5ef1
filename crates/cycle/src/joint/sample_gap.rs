//! Sample gap: how fast a joint moves whose samples have stayed away for some cycles.
//!
//! The filters of velocities bridge such a gap with what was before it. What comes then is no line through it: an
//! encoder that has slipped meanwhile looks to them like a joint that runs. Until their window has nothing of the gap,
//! the way since the first sample after it says how fast the joint moves.

/// Samples that stay away in a row from which on the filters are not believed: two are in order at 1 kHz, as answers
/// may be a cycle late.
const MISSED: u32 = 3;
/// Cycles until the velocity filters' window has nothing of a gap any more.
const WINDOW: u32 = 20;

/// Velocities of a joint's link and motor, link side, rad/s, and how they are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Known {
    /// By the filters.
    Filtered([f64; 2]),
    /// By the filters before a gap: this is the first sample after it.
    Before([f64; 2]),
    /// By the way since the first sample after a gap.
    After([f64; 2]),
}

/// Samples of a joint that stay away, and come back.
#[derive(Debug, Clone, Default)]
pub(super) struct SampleGap {
    missed: u32,
    /// The filters' velocities before samples stayed away.
    before: [f64; 2],
    /// The angles of the first sample after a gap, rad, and the cycles since then.
    first: Option<([f64; 2], u32)>,
}

impl SampleGap {
    /// A cycle: `sample`: angles of link and motor, link side, rad, if there are any that can be used; `filtered`:
    /// velocities by the filters, rad/s; `dt`: sample period, s.
    pub(super) fn update(
        &mut self,
        sample: Option<[f64; 2]>,
        filtered: [f64; 2],
        dt: f64,
    ) -> Known {
        let Some(angles) = sample else {
            self.missed = self.missed.saturating_add(1);
            return Known::Filtered(filtered);
        };
        let missed = std::mem::take(&mut self.missed);
        if missed >= MISSED {
            self.first = Some((angles, 0));
            return Known::Before(self.before);
        }
        let known = match &mut self.first {
            None => Known::Filtered(filtered),
            Some((first, cycles)) => {
                // One that stays away meanwhile is bridged by the time.
                *cycles += missed + 1;
                let time = f64::from(*cycles) * dt;
                let way = [0, 1].map(|side| angles[side] - first[side]);
                if *cycles > WINDOW {
                    self.first = None;
                    Known::Filtered(filtered)
                } else {
                    Known::After(way.map(|way| way / time))
                }
            }
        };
        if let Known::Filtered(velocities) | Known::After(velocities) = known {
            self.before = velocities;
        }
        known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_gap_the_way_since_then_is_the_velocity() {
        let mut gap = SampleGap::default();
        let mut update = |sample: Option<f64>, filtered: f64| {
            gap.update(sample.map(|angle| [angle; 2]), [filtered; 2], 1e-3)
        };
        assert_eq!(update(Some(0.1), 0.5), Known::Filtered([0.5; 2]));
        for _ in 1..MISSED {
            assert_eq!(update(None, 0.6), Known::Filtered([0.6; 2]));
        }
        assert_eq!(update(Some(0.1), 0.5), Known::Filtered([0.5; 2]));
        for _ in 0..MISSED {
            update(None, 0.6);
        }
        // A slip within the gap is no velocity.
        assert_eq!(update(Some(0.2), 7.0), Known::Before([0.5; 2]));
        let is_one = |known: Known| matches!(known, Known::After([v, _]) if (v - 1.0).abs() < 1e-9);
        assert!(is_one(update(Some(0.201), 8.0)));
        update(None, 9.0);
        assert!(is_one(update(Some(0.203), 9.0)));
        let after = (0..).find(|_| update(Some(0.203), 0.0) == Known::Filtered([0.0; 2]));
        assert_eq!(after, Some(17));
    }
}
