//! The bus suite without a kernel: two threads' queues, lock-step, and a fault injector around
//! either that injects nothing; then the faults themselves.

mod bus;

use bus::{Rig, STRANGER, answers, conforms, frames, receive, table};
use can_codec::{Frame, Frames, Gather, MAX_FRAMES};
use torqued::bus::in_process::{InProcess, LockStep, Peer, VirtualClock, VirtualDeadline, pair};
use torqued::bus::{Bus, FaultInjector, Faults};
use torqued::real_time::Pace;

/// Small enough that the suite fills it.
const CAPACITY: usize = 1_024;

struct Pair<B> {
    bus: B,
    other: InProcess,
}

impl<B: Bus> Rig for Pair<B> {
    fn bus(&mut self) -> &mut dyn Bus {
        &mut self.bus
    }
    fn send_from_peer(&mut self, frames: &Frames) {
        assert_eq!(self.other.send(frames), frames.len());
    }
    fn received_by_peer(&mut self) -> (Vec<Frame>, u64) {
        let mut rx = Frames::new(CAPACITY);
        let mut never = Gather::new(1);
        self.other.receive(&mut rx, &mut never, &table(), 0);
        (rx.as_slice().to_vec(), self.other.counters().dropped)
    }
}

/// Sends the frames that it was given, and keeps those that it receives.
struct ScriptedPeer {
    outgoing: Vec<Frame>,
    received: Vec<Frame>,
}

impl Peer for ScriptedPeer {
    fn exchange(&mut self, frames: &Frames, _now_ns: u64, out: &mut Frames) {
        self.received.extend_from_slice(frames.as_slice());
        for frame in self.outgoing.drain(..) {
            out.push(frame);
        }
    }
}

impl Rig for LockStep<ScriptedPeer> {
    fn bus(&mut self) -> &mut dyn Bus {
        self
    }
    fn send_from_peer(&mut self, frames: &Frames) {
        self.peer_mut()
            .outgoing
            .extend_from_slice(frames.as_slice());
        self.send(&Frames::new(0));
    }
    fn received_by_peer(&mut self) -> (Vec<Frame>, u64) {
        (std::mem::take(&mut self.peer_mut().received), 0)
    }
}

fn lock_step() -> LockStep<ScriptedPeer> {
    let peer = ScriptedPeer {
        outgoing: Vec::with_capacity(CAPACITY),
        received: Vec::with_capacity(CAPACITY),
    };
    LockStep::new(peer, &VirtualClock::new())
}

fn with_faults(faults: Faults, seed: u64) -> Pair<FaultInjector<InProcess>> {
    let (bus, other) = pair(CAPACITY);
    let bus = FaultInjector::new(bus, &table(), faults, seed);
    Pair { bus, other }
}

#[test]
fn two_threads_queues_conform() {
    conforms(|| {
        let (bus, other) = pair(CAPACITY);
        Pair { bus, other }
    });
}

#[test]
fn lock_step_conforms() {
    conforms(lock_step);
}

#[test]
fn fault_injector_without_faults_conforms() {
    conforms(|| with_faults(Faults::default(), 1));
}

#[test]
fn two_threads_exchange_frames() {
    const CYCLES: usize = 200;
    let (mut daemon, mut robot) = pair(64);
    let answering = std::thread::spawn(move || {
        let (table, mut never) = (table(), Gather::new(1));
        let (mut rx, answers) = (Frames::new(MAX_FRAMES), frames(&answers()));
        while robot.counters().received < CYCLES as u64 {
            rx.clear();
            let until = robot.now_ns() + 1_000_000;
            robot.receive(&mut rx, &mut never, &table, until);
            for _ in &rx {
                assert_eq!(robot.send(&answers), answers.len());
            }
        }
    });
    let table = table();
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    for _ in 0..CYCLES {
        rx.clear();
        gather.begin();
        daemon.send(&frames(&[bus::frame(0, STRANGER, 0, false, 0)]));
        let until = daemon.now_ns() + 20_000_000_000;
        daemon.receive(&mut rx, &mut gather, &table, until);
        assert!(gather.complete());
        assert_eq!(rx.len(), 4);
    }
    answering.join().unwrap();
}

#[test]
fn virtual_deadline_leaps_from_start_to_start_and_skips_passed_ones() {
    let clock = VirtualClock::new();
    let mut deadline = VirtualDeadline::new(&clock, 1_000);
    assert_eq!(deadline.wait().woke_ns, 1_000);
    let wake = deadline.wait();
    assert_eq!((wake.woke_ns, wake.late, wake.skipped), (2_000, false, 0));
    clock.advance_to(5_100);
    let wake = deadline.wait();
    assert_eq!((wake.scheduled_ns, wake.woke_ns), (5_000, 5_100));
    assert_eq!((wake.late, wake.skipped), (true, 2));
    assert_eq!(deadline.wait().woke_ns, 6_000);
}

/// Thirty answered cycles: all frames that arrived, and the rig.
fn thirty_cycles(faults: Faults, seed: u64) -> (Vec<Frame>, Pair<FaultInjector<InProcess>>) {
    let mut rig = with_faults(faults, seed);
    let mut seen = Vec::new();
    for _ in 0..30 {
        rig.send_from_peer(&frames(&answers()));
        seen.extend_from_slice(receive(rig.bus()).as_slice());
    }
    for frame in &mut seen {
        frame.stamp_ns = 0;
    }
    (seen, rig)
}

#[test]
fn same_seed_gives_the_same_faults_and_another_seed_others() {
    let faults = Faults {
        drop: 0.2,
        duplicate: 0.1,
        delay: 0.2,
        corrupt_length: 0.1,
        unknown_id: 0.1,
        error_frame: 0.1,
    };
    let (first, rig) = thirty_cycles(faults, 7);
    let (again, _) = thirty_cycles(faults, 7);
    let (other, _) = thirty_cycles(faults, 8);
    assert_eq!(first, again);
    assert_ne!(first, other);
    // Each kind has occurred, and the counters add up.
    let injected = rig.bus.injected();
    assert!(injected.dropped > 0 && injected.duplicated > 0 && injected.delayed > 0);
    assert!(injected.corrupted > 0 && injected.unknown > 0 && injected.errors > 0);
    let counters = rig.bus.counters();
    assert_eq!(counters.error_frames, injected.errors);
    assert_eq!(
        counters.received + counters.error_frames,
        first.len() as u64
    );
}

#[test]
fn each_fault_has_the_effect_of_its_name() {
    let sure = 1.0;
    let all = 30 * 4;
    let of = |faults| thirty_cycles(faults, 3).0;
    let drop = of(Faults {
        drop: sure,
        ..Faults::default()
    });
    assert!(drop.is_empty());
    let duplicate = of(Faults {
        duplicate: sure,
        ..Faults::default()
    });
    assert_eq!(duplicate.len(), 2 * all);
    assert_eq!(duplicate[0], duplicate[1]);
    // Each frame is late by one call; those of the last call are still held back.
    let delay = of(Faults {
        delay: sure,
        ..Faults::default()
    });
    assert_eq!(delay.len(), all - 4);
    let corrupt = of(Faults {
        corrupt_length: sure,
        ..Faults::default()
    });
    assert!(corrupt.iter().all(|f| f.len == 7));
    let unknown = of(Faults {
        unknown_id: sure,
        ..Faults::default()
    });
    let table = table();
    let known = |f: &&Frame| table.classify(f).is_some();
    assert_eq!(unknown.iter().filter(known).count(), all);
    assert_eq!(unknown.len(), 2 * all);
    let errors = of(Faults {
        error_frame: sure,
        ..Faults::default()
    });
    assert_eq!(errors.iter().filter(|f| f.error).count(), all);
}

#[test]
fn lost_answer_is_waited_for_until_the_deadline() {
    let faults = Faults {
        drop: 1.0,
        ..Faults::default()
    };
    let table = table();
    let mut bus = FaultInjector::new(lock_step(), &table, faults, 1);
    let mut gather = Gather::new(table.message_count());
    bus.inner_mut().send_from_peer(&frames(&answers()));
    let until = bus.now_ns() + 400_000;
    bus.receive(&mut Frames::new(MAX_FRAMES), &mut gather, &table, until);
    assert_eq!(gather.missing().count(), 4);
    assert_eq!(bus.now_ns(), until);
}
