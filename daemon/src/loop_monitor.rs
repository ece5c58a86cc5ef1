//! Lasting conditions of the process around the cycle, which are faults: buses that are
//! down, frames that cannot be sent, cycles that are late, a publisher thread that no longer runs.
//!
//! While the robot is in boot nothing is commanded and the robot may be switched off: buses and
//! lateness are no faults then.

use robot_config::Robot;
use robot_state::{CycleRecord, Event, RobotState};

use crate::bus::BusCounters;
use crate::real_time::WakeReport;

/// Span over which late cycles are counted, s.
const WINDOW_S: f64 = 1.0;
/// Conditions that are monitored.
const CONDITIONS: usize = 4;

/// The monitor of one loop.
#[derive(Debug, Clone)]
pub struct LoopMonitor {
    counters: BusCounters,
    /// Cycles in a row in which a frame was refused, and the number that is allowed.
    failing: u64,
    max_failing: u64,
    window: u64,
    late_share: f64,
    /// Of the present window: cycles begun or left out, and those that were late or left out.
    begun: u64,
    late: u64,
    /// The publisher thread's last heartbeat, and the cycles since it.
    heartbeat: u64,
    silent: u64,
    max_silent: u64,
    /// The conditions that were found before the last cycle.
    lasting: [bool; CONDITIONS],
}

impl LoopMonitor {
    /// A monitor with the robot's limits; `counters`: those of the bus at the start.
    #[must_use]
    pub fn new(robot: &Robot, counters: BusCounters) -> Self {
        let safety = &robot.parameters.safety;
        let period = robot.parameters.timing.sample_period;
        let cycles = |time: f64| (time / period).ceil() as u64;
        let window = cycles(WINDOW_S);
        Self {
            counters,
            failing: 0,
            max_failing: cycles(safety.send_failing),
            window,
            late_share: safety.late_share,
            begun: 0,
            late: 0,
            heartbeat: 0,
            silent: 0,
            max_silent: cycles(safety.publisher_timeout),
            lasting: [false; CONDITIONS],
        }
    }

    /// The faults found before a cycle; `last`: the last cycle's record.
    pub fn faults(
        &mut self,
        wake: &WakeReport,
        counters: BusCounters,
        heartbeat: u64,
        last: &CycleRecord,
    ) -> impl Iterator<Item = Event> {
        let found = [
            self.buses(counters),
            self.sending(counters),
            self.lateness(wake),
            self.publisher(wake, heartbeat),
        ];
        self.counters = counters;
        let boot = last.state == RobotState::Boot.number();
        let latched = last.state == RobotState::Fault.number();
        let lasting = core::mem::replace(&mut self.lasting, found.map(|event| event.is_some()));
        let found = found.into_iter().zip(lasting);
        // Counted once, not in each cycle of its duration; unless it lasts when the fault has been
        // acknowledged.
        found
            .filter(move |(_, lasting)| !(latched && *lasting))
            .filter_map(|(event, _)| event)
            .filter(move |&event| !boot || event == Event::PublisherGone)
    }

    fn buses(&self, counters: BusCounters) -> Option<Event> {
        let before = &self.counters;
        let more = counters.bus_off > before.bus_off || counters.link_down > before.link_down;
        more.then_some(Event::BusDown)
    }

    fn sending(&mut self, counters: BusCounters) -> Option<Event> {
        if counters.send_failed == self.counters.send_failed {
            self.failing = 0;
            return None;
        }
        self.failing += 1;
        (self.failing > self.max_failing).then_some(Event::SendFailing)
    }

    fn lateness(&mut self, wake: &WakeReport) -> Option<Event> {
        self.begun += 1 + wake.skipped;
        self.late += u64::from(wake.late) + wake.skipped;
        let lasts = self.late as f64 > self.late_share * self.window.max(self.begun) as f64;
        if lasts || self.begun >= self.window {
            (self.begun, self.late) = (0, 0);
        }
        lasts.then_some(Event::LatenessLasts)
    }

    fn publisher(&mut self, wake: &WakeReport, heartbeat: u64) -> Option<Event> {
        if heartbeat != self.heartbeat {
            (self.heartbeat, self.silent) = (heartbeat, 0);
            return None;
        }
        // A loop that itself stood still cannot judge the thread's silence meanwhile.
        self.silent += u64::from(!wake.late);
        (self.silent > self.max_silent).then_some(Event::PublisherGone)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bench {
        monitor: LoopMonitor,
        wake: WakeReport,
        counters: BusCounters,
        heartbeat: u64,
        last: CycleRecord,
    }

    impl Bench {
        fn new() -> Self {
            let read = test_support::read_project_file;
            let mut leg = robot_config::load("config/leg/robot.toml", &read).expect("the leg");
            leg.parameters.safety.late_share = 0.5;
            Self {
                monitor: LoopMonitor::new(&leg, BusCounters::default()),
                wake: WakeReport::default(),
                counters: BusCounters::default(),
                heartbeat: 0,
                last: CycleRecord {
                    state: RobotState::Active.number(),
                    ..CycleRecord::default()
                },
            }
        }

        /// The first fault within so many cycles, and in which it was found.
        fn first(&mut self, cycles: u64, change: impl Fn(u64, &mut Self)) -> Option<(u64, Event)> {
            (1..=cycles).find_map(|cycle| {
                self.heartbeat += 1;
                change(cycle, self);
                let (wake, counters) = (self.wake, self.counters);
                let mut found = (self.monitor).faults(&wake, counters, self.heartbeat, &self.last);
                found.next().map(|event| (cycle, event))
            })
        }
    }

    #[test]
    fn a_bus_that_is_down_is_a_fault_at_once_but_not_in_boot() {
        for change in [
            (|_, bench| bench.counters.bus_off = 1) as fn(u64, &mut Bench),
            |_, bench| bench.counters.link_down += 4,
        ] {
            assert_eq!(Bench::new().first(9, change), Some((1, Event::BusDown)));
            let mut boot = Bench::new();
            boot.last.state = RobotState::Boot.number();
            assert_eq!(boot.first(100, change), None);
        }
    }

    #[test]
    fn frames_that_cannot_be_sent_for_longer_than_allowed_are_a_fault() {
        let lasting = Bench::new().first(100, |_, bench| bench.counters.send_failed += 1);
        assert_eq!(lasting, Some((21, Event::SendFailing)));
        let now_and_then = Bench::new().first(10_000, |cycle, bench| {
            bench.counters.send_failed += u64::from(cycle % 10 != 0);
        });
        assert_eq!(now_and_then, None);
    }

    #[test]
    fn lateness_is_a_fault_only_if_it_lasts() {
        let one = Bench::new().first(10_000, |cycle, bench| {
            bench.wake.late = cycle % 3 == 0;
        });
        assert_eq!(one, None);
        let lasting = Bench::new().first(10_000, |_, bench| bench.wake.late = true);
        assert_eq!(lasting, Some((501, Event::LatenessLasts)));
        let skipped = Bench::new().first(10_000, |_, bench| {
            bench.wake = WakeReport {
                late: true,
                skipped: 9,
                ..WakeReport::default()
            };
        });
        assert_eq!(skipped, Some((51, Event::LatenessLasts)));
    }

    #[test]
    fn a_publisher_thread_without_a_heartbeat_is_a_fault_even_in_boot() {
        let mut bench = Bench::new();
        bench.last.state = RobotState::Boot.number();
        let found = bench.first(5000, |_, bench| bench.heartbeat = 7);
        assert_eq!(found, Some((1002, Event::PublisherGone)));
        // Latched, it is not counted again.
        bench.last.fault = Event::PublisherGone.number();
        bench.last.state = RobotState::Fault.number();
        assert_eq!(bench.first(5000, |_, bench| bench.heartbeat = 7), None);
        // Acknowledged while it lasts, it is latched again.
        bench.last.state = RobotState::Ready.number();
        let found = bench.first(5000, |_, bench| bench.heartbeat = 7);
        assert_eq!(found, Some((1, Event::PublisherGone)));
    }

    #[test]
    fn a_condition_that_lasts_while_another_fault_is_latched_is_counted_once() {
        let mut bench = Bench::new();
        bench.last.state = RobotState::Fault.number();
        bench.last.fault = Event::JointStale.number();
        let lasts = |_, bench: &mut Bench| {
            bench.counters.send_failed += 1;
            bench.counters.link_down += 1;
        };
        assert_eq!(bench.first(100, lasts), Some((1, Event::BusDown)));
        assert_eq!(bench.first(100, lasts), Some((20, Event::SendFailing)));
        assert_eq!(bench.first(1000, lasts), None);
    }
}
