//! Faults in front of the daemon's loop: each leaves a black box that names what came first.

use crate::common;

use std::path::Path;

use can_codec::{Frames, Gather, Table};
use common::recorded::{Recorded, START_NS, black_boxes, read, robot_and_files};
use common::{RunDir, plant, sim};
use plant::{CanRobot, DriveError};
use recording::{Happening, Header, Span, Timeline, cause_of};
use robot_state::{DriveState, Event, measured_flags};
use torqued::bus::{Bus, BusCounters, LockStep};

const KNEE: usize = 3;
/// The fault's cause begins in this cycle: the leg holds since long.
const FROM: u64 = 2600;

#[derive(Debug, Clone, Copy)]
enum Trouble {
    /// The knee's frames are lost.
    Silent,
    /// The knee's drive reports too much current.
    OverCurrent,
    /// The knee's drive is no longer powered.
    NoPower,
    BusOff,
    /// A defect of the program.
    Panic,
}

struct Troubled {
    bus: LockStep<CanRobot>,
    trouble: Trouble,
    knee: Vec<(u8, u32)>,
    done: bool,
    counters: BusCounters,
    kept: Frames,
}

impl Troubled {
    fn is_on(&self) -> bool {
        self.bus.now_ns() >= START_NS + FROM * 1_000_000
    }

    fn begin(&mut self) {
        let knee = self.bus.peer_mut();
        match self.trouble {
            Trouble::OverCurrent => {
                let states = knee.drive_states(KNEE).expect("a drive with states");
                states.set_cause(Some(DriveError::OverCurrent));
            }
            Trouble::NoPower => {
                let states = knee.drive_states(KNEE).expect("a drive with states");
                states.set_power(false);
            }
            Trouble::BusOff => self.counters.bus_off = 1,
            Trouble::Panic => panic!("a defect, on purpose"),
            Trouble::Silent => {}
        }
    }
}

impl Bus for Troubled {
    fn send(&mut self, frames: &Frames) -> usize {
        if self.is_on() && !std::mem::replace(&mut self.done, true) {
            self.begin();
        }
        self.bus.send(frames)
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        self.kept.clear();
        self.bus.receive(&mut self.kept, gather, table, until_ns);
        for frame in &self.kept {
            let of_knee = self.knee.contains(&(frame.bus, frame.id));
            let lost = matches!(self.trouble, Trouble::Silent) && of_knee && self.is_on();
            if lost {
                continue;
            }
            rx.push(*frame);
        }
    }

    fn counters(&self) -> BusCounters {
        BusCounters {
            bus_off: self.counters.bus_off,
            ..self.bus.counters()
        }
    }

    fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }
}

/// Runs the leg into the trouble; the time line of its only black box.
fn box_of(trouble: Trouble) -> (Header, Vec<Span>, Vec<u64>, String) {
    let (mut robot, files) = robot_and_files("leg", |_, text| text);
    robot.parameters.safety.publisher_timeout = 10.0;
    let directory = RunDir::new();
    let knee = (0..robot.receive.message_count())
        .filter(|&m| {
            let slot = robot_config::slots::link_angle(KNEE);
            robot.receive.slots(m).any(|s| s == slot)
        })
        .filter_map(|m| robot.receive.message(m))
        .map(|message| (message.bus, message.id))
        .collect();
    let recorded = Recorded {
        robot: &robot,
        files,
        directory: &directory,
        record: None,
        stop_at: FROM + 900,
    };
    let lost = recorded.run(
        |clock| Troubled {
            bus: LockStep::new(plant(&robot, &sim("leg")), clock),
            trouble,
            knee,
            done: false,
            counters: BusCounters::default(),
            kept: Frames::default(),
        },
        &mut |_| {},
    );
    assert_eq!(lost, 0);
    let boxes = black_boxes(&directory);
    assert_eq!(boxes.len(), 1, "{trouble:?}: {boxes:?}");
    let mut timeline = Timeline::default();
    let mut cycles = Vec::new();
    let header = read(&boxes[0], |_, message| {
        cycles.push(message.record.cycle.sequence);
        timeline.observe(message);
    });
    (header, timeline.finish(), cycles, file_name(&boxes[0]))
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .expect("a name")
        .to_string_lossy()
        .into_owned()
}

fn fault_of(spans: &[Span]) -> &Span {
    let fault = spans
        .iter()
        .find(|span| matches!(span.what, Happening::Fault(_)));
    fault.expect("a fault in the black box")
}

#[test]
fn the_black_box_names_what_came_first() {
    let fault = DriveState::Fault.number();
    let enabled = DriveState::Enabled.number();
    for (trouble, event) in [
        (Trouble::Silent, Event::JointStale),
        (Trouble::OverCurrent, Event::DriveFault),
        (Trouble::NoPower, Event::DriveLost),
        (Trouble::BusOff, Event::BusDown),
    ] {
        let (header, spans, cycles, name) = box_of(trouble);
        assert!(
            name.ends_with(&format!("_{}_{}.mcap", event.number(), event.name())),
            "{name}"
        );
        let latched = fault_of(&spans);
        assert_eq!(
            latched.what,
            Happening::Fault(event.number()),
            "{trouble:?}"
        );
        let cause = cause_of(&spans, latched).expect("a cause");
        let words = cause.words(&header);
        // The first cycle of the trouble, or the next: what was on its way still arrives.
        let begin = FROM..=FROM + 3;
        assert!(
            begin.contains(&cause.cycle),
            "{trouble:?}: {} {words}",
            cause.cycle
        );
        match trouble {
            Trouble::Silent => {
                assert_eq!(cause.what, Happening::JointFlag(measured_flags::MISSED));
                assert_eq!(cause.subjects, [KNEE]);
                let age = (latched.begin_ns - cause.begin_ns) as f64 * 1e-6;
                // The configuration's limit, counted from the last good sample.
                assert!((18.0..=21.0).contains(&age), "{age} ms");
            }
            Trouble::OverCurrent | Trouble::NoPower => {
                assert!(matches!(cause.what, Happening::StatusWord(..)), "{words}");
                assert_eq!(cause.subjects, [KNEE], "{words}");
                let followed = spans.iter().any(|span| match span.what {
                    Happening::DriveState(from, to) => {
                        span.subjects == [KNEE] && from == enabled && (to == fault || to != enabled)
                    }
                    _ => false,
                });
                assert!(followed, "{trouble:?}");
            }
            _ => assert_eq!(cause.what, Happening::Event(event.number()), "{words}"),
        }
        // Two seconds before the fault and half a second after it, without a hole.
        assert!(cycles.windows(2).all(|pair| pair[1] == pair[0] + 1));
        let (first, last) = (cycles[0], cycles[cycles.len() - 1]);
        assert!((1999..=2001).contains(&(latched.cycle - first)), "{first}");
        assert!((499..=501).contains(&(last - latched.cycle)), "{last}");
    }
}

#[test]
fn a_loop_that_ends_by_a_defect_leaves_a_black_box() {
    let (header, spans, cycles, name) = box_of(Trouble::Panic);
    assert_eq!(header.black_box, Some(Event::LoopEnded));
    assert!(name.ends_with("_505_loop_ended.mcap"), "{name}");
    assert!(
        spans
            .iter()
            .all(|span| !matches!(span.what, Happening::Fault(_)))
    );
    let last = cycles[cycles.len() - 1];
    assert!(
        (FROM - 2..=FROM).contains(&last),
        "up to the defect: {last}"
    );
    assert!((1999..=2002).contains(&cycles.len()));
}
