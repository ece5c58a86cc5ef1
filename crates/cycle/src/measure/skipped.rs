//! Cycles that the loop left out.

use robot_state::JointMeasured;

use super::Measure;
use super::filtered::Filtered;
use super::joint::JointReader;
use crate::time::{SECONDS_PER_NS, Stamp};

/// Most skipped cycles that are bridged: after a longer gap the default filters, of at most 80 samples, hold none
/// anyway.
const MAX_BRIDGED: f64 = 100.0;

impl Measure {
    /// Cycles that were skipped enter encoders and filters as cycles without a sample: else motion
    /// would look faster by as much as time is missing.
    pub(super) fn bridge_skipped(&mut self, sync: Stamp, joints: &mut [JointMeasured]) {
        let period_ns = self.sample_period / SECONDS_PER_NS;
        let last = self.last_sync.replace(sync);
        let elapsed = last.map_or(0.0, |last| sync.0.saturating_sub(last.0) as f64 / period_ns);
        let skipped = (elapsed.round() - 1.0).clamp(0.0, MAX_BRIDGED) as u32;
        self.skipped = skipped;
        if skipped == 0 {
            return;
        }
        self.joints.iter_mut().for_each(JointReader::note_gap);
        self.angles.fill(f64::NAN);
        self.both_angles.fill(f64::NAN);
        self.axes.fill(f64::NAN);
        for k in (1..=skipped).rev() {
            let instant = Stamp(sync.0.saturating_sub((f64::from(k) * period_ns) as u64));
            self.joints.iter_mut().for_each(JointReader::skip);
            self.filter(instant);
            for measured in joints.iter_mut().take(self.joints.len()) {
                measured.q += measured.dq * self.sample_period;
                measured.theta += measured.omega * self.sample_period;
            }
        }
        if self.overslept() {
            // The way since then would look like a velocity.
            self.long.reset();
            self.short.reset();
            self.contact.iter_mut().for_each(Filtered::reset);
            self.control_filter.reset();
        }
    }

    /// The loop has not run for longer than samples may be old.
    pub(super) fn overslept(&self) -> bool {
        f64::from(self.skipped) * self.sample_period > self.stale_after
    }
}
