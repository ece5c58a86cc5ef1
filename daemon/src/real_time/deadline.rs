//! Absolute-time sleep on a fixed grid of cycle starts.

use nix::errno::Errno;
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

const NS_PER_S: u64 = 1_000_000_000;

/// Now on `CLOCK_MONOTONIC`, ns: the clock of every stamp and deadline. No system call on
/// kernels with a vDSO.
#[must_use]
pub fn monotonic_ns() -> u64 {
    clock_ns(ClockId::CLOCK_MONOTONIC)
}

/// Now on `CLOCK_REALTIME`, ns.
pub(crate) fn realtime_ns() -> u64 {
    clock_ns(ClockId::CLOCK_REALTIME)
}

fn clock_ns(clock: ClockId) -> u64 {
    // The clocks used here exist on every Linux: the call has no other way to fail.
    clock_gettime(clock).map_or(0, |t| {
        t.tv_sec().unsigned_abs() * NS_PER_S + t.tv_nsec().unsigned_abs()
    })
}

/// Sleeps until `until_ns` on `CLOCK_MONOTONIC`; signals do not shorten it.
pub fn sleep_until(until_ns: u64) {
    // Both fit: seconds of an u64 of ns, and a remainder below 1e9.
    let request = TimeSpec::new((until_ns / NS_PER_S) as i64, (until_ns % NS_PER_S) as i64);
    while clock_nanosleep(
        ClockId::CLOCK_MONOTONIC,
        ClockNanosleepFlags::TIMER_ABSTIME,
        &request,
    ) == Err(Errno::EINTR)
    {}
}

/// Start of a cycle: planned and actual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WakeReport {
    /// Planned start of the cycle, ns.
    pub scheduled_ns: u64,
    /// Actual start, ns.
    pub woke_ns: u64,
    /// True if the last cycle ended after this one's start, or after the start of a skipped one.
    pub late: bool,
    /// Number of skipped starts.
    pub skipped: u64,
}

impl WakeReport {
    /// Delay of the thread's wake-up, ns.
    #[must_use]
    pub fn wake_late_ns(&self) -> u64 {
        self.woke_ns.saturating_sub(self.scheduled_ns)
    }
}

/// The starts of the cycles: a grid that never moves.
///
/// ```text
/// on time      |--work--.....|--work--.....|
/// late         |------work------|work.|--work--      begins at once, the grid stays
/// very late    |------work--------------------|work|   starts that passed whole are skipped
/// ```
/// A late cycle delays at most the one after it; lost cycles are never run in a burst.
#[derive(Debug, Clone)]
pub struct Schedule {
    next_ns: u64,
    period_ns: u64,
}

impl Schedule {
    /// The first start at `first_ns`, then one every `period_ns` (at least 1).
    #[must_use]
    pub fn new(first_ns: u64, period_ns: u64) -> Self {
        Self {
            next_ns: first_ns,
            period_ns: period_ns.max(1),
        }
    }

    /// Takes the start due at `now_ns`: the start, true if the last cycle ran into it, and the number
    /// of skipped starts.
    pub fn take(&mut self, now_ns: u64) -> (u64, bool, u64) {
        let overrun = now_ns.saturating_sub(self.next_ns);
        let skipped = overrun / self.period_ns;
        let start = self.next_ns + skipped * self.period_ns;
        self.next_ns = start + self.period_ns;
        (start, overrun > 0, skipped)
    }
}

/// Waits for each cycle's start: in real time, or on a virtual clock that leaps there.
pub trait Pace {
    /// Returns at the next cycle's start; at once if that has passed.
    fn wait(&mut self) -> WakeReport;
}

/// Waits for each cycle's start in real time.
#[derive(Debug, Clone)]
pub struct Deadline {
    schedule: Schedule,
}

impl Deadline {
    /// Cycles every `period_ns`, the first one period from now.
    #[must_use]
    pub fn new(period_ns: u64) -> Self {
        Self {
            schedule: Schedule::new(monotonic_ns() + period_ns, period_ns),
        }
    }
}

impl Pace for Deadline {
    fn wait(&mut self) -> WakeReport {
        let (scheduled_ns, late, skipped) = self.schedule.take(monotonic_ns());
        if !late {
            sleep_until(scheduled_ns);
        }
        WakeReport {
            scheduled_ns,
            woke_ns: monotonic_ns(),
            late,
            skipped,
        }
    }
}
