//! Faults of the process: late and skipped cycles, the clock, events of the threads around the loop.

use robot_state::Event;

use super::{AT_REST, ENABLED, ENABLED_PRESSING, Scenario, before};
use crate::rig::{Fault, Rig};

const GROUP: &str = "Clock and process";

fn skip(cycles: usize) -> Fault {
    before(move |rig, k| {
        rig.asleep = k < cycles;
        if k == cycles {
            rig.cycle.note(Event::SkippedCycle, cycles as u64);
        }
    })
}

/// The cycle ends after the next one should have begun.
fn late(when: fn(usize) -> bool) -> Fault {
    before(move |rig, k| {
        if when(k) {
            rig.late_ns = 950_000;
            rig.cycle.note(Event::LateCycle, 1);
        }
    })
}

fn clock(change: fn(u64) -> u64) -> Fault {
    before(move |rig, k| {
        if k == 0 {
            rig.now = change(rig.now);
        }
    })
}

fn note(event: Event) -> Fault {
    before(move |rig: &mut Rig, k| {
        if k == 0 {
            rig.cycle.note(event, 1);
        }
    })
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    vec![
        new("one late cycle", ENABLED, |_| late(|k| k == 0)).step(),
        new("every cycle late", ENABLED, |_| late(|_| true)).step(),
        new("1 cycle skipped", ENABLED, |_| skip(1)).gap(1),
        new("3 cycles skipped", ENABLED_PRESSING, |_| skip(3)).gap(3),
        new("10 cycles skipped", ENABLED_PRESSING, |_| skip(10)).gap(10),
        new("the loop sleeps for 0.2 s", ENABLED, |_| skip(200)).physics_of_currents(),
        new("the clock is set back by 1 s", ENABLED, |_| {
            clock(|now| now.saturating_sub(900_000_000))
        }),
        new("the clock is set forward by 1 s", ENABLED, |_| {
            clock(|now| now + 1_000_000_000)
        }),
        new("lateness lasts", ENABLED, |_| note(Event::LatenessLasts)),
        new("a bus is down", AT_REST, |_| note(Event::BusDown)),
        new("frames cannot be sent", AT_REST, |_| {
            note(Event::SendFailing)
        }),
        new("the thread for clients has ended", ENABLED, |_| {
            note(Event::PublisherGone)
        }),
        new("the loop's thread has panicked", AT_REST, |_| {
            note(Event::LoopEnded)
        })
        .physics(),
    ]
}
