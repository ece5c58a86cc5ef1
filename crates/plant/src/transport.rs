//! Set-points on their way from the loop to a drive.

use crate::parameters::TransportParameters;
use crate::random::Random;
use std::collections::VecDeque;

/// How the frames with set-points travel: late, unevenly late, or not at all.
#[derive(Debug, Clone)]
pub struct Transport {
    delay: f64,
    jitter: f64,
    lost: f64,
    random: Random,
}

impl Transport {
    /// Transport by `[transport]` of `sim.toml`, in a loop with this period, s.
    #[must_use]
    pub fn new(parameters: &TransportParameters, period: f64, random: Random) -> Self {
        Self {
            delay: parameters.delay.unwrap_or(period),
            jitter: parameters.jitter,
            lost: parameters.lost,
            random,
        }
    }

    /// Time until the next frame acts, s; none for one that is lost.
    pub fn next_delay(&mut self) -> Option<f64> {
        // Both are drawn for every frame, so that one setting does not change the other's draws.
        let (late, lost) = (self.random.unit(), self.random.unit());
        (lost >= self.lost).then_some(self.delay + self.jitter * late)
    }
}

/// The set-points that are on their way to one drive. They arrive in the order of their sending.
#[derive(Debug, Clone)]
pub struct OnTheWay<T> {
    /// Step in which each begins to act, and the set-point.
    queue: VecDeque<(u64, T)>,
}

impl<T> Default for OnTheWay<T> {
    fn default() -> Self {
        Self {
            queue: VecDeque::new(),
        }
    }
}

impl<T: Copy> OnTheWay<T> {
    /// A set-point that acts from step `due` on, or with the one before it if that is later.
    pub fn send(&mut self, due: u64, set_point: T) {
        let due = (self.queue.back()).map_or(due, |(before, _)| due.max(*before));
        self.queue.push_back((due, set_point));
    }

    /// The next set-point that acts in `step`; to be asked until there is none.
    pub fn arrive(&mut self, step: u64) -> Option<T> {
        let (due, set_point) = *self.queue.front()?;
        (due <= step).then(|| {
            self.queue.pop_front();
            set_point
        })
    }
}
