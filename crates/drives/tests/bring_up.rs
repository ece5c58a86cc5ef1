//! Set-ups of CANopen drives against a node, whole and interrupted.

use can_codec::Frame;
use drives::canopen::bring_up::{BringUp, Limits, Outcome, Plan, Trouble};
use drives::canopen::server::Server;
use drives::canopen::{NodeState, Object, SDO_ANSWER_ID, SDO_REQUEST_ID};
use drives::cia402::{Drive, Kind, MASTER, Mode, Reported, Side, simulated};
use proptest::prelude::*;

const NODE: u8 = 3;
const MS: u64 = 1_000_000;

fn kind(mode: Mode) -> Kind {
    Kind {
        mode,
        side: Side::Link,
        other_angle: Some(Object::new(0x2240, 0)),
        velocity_unit: None,
        rated_current: 5.0,
        current_per_torque: 5.0,
        rated_torque: 100.0,
        reported: Reported::default(),
        heartbeat_ms: 100,
        vendor: None,
        product: None,
        sdo: vec![(Object::new(0x6065, 0), 5000u32.to_le_bytes().to_vec())],
    }
}

fn plan(kind: &Kind) -> Plan {
    let drive = Drive {
        kind,
        name: "knee",
        bus: 0,
        node: NODE,
        period: 1e-3,
        position_count: ("count", 1.0),
        asked: None,
    };
    drive.plan().expect("a plan")
}

/// What a line between both does to the frame of that number, sent by the master or not.
type Line<'l> = &'l mut dyn FnMut(usize, bool, &Frame) -> bool;

/// Runs a set-up against a node until it ends; the frames of both, and the time that it took, ms.
fn run(master: &mut BringUp, node: &mut Server, pass: Line<'_>) -> (Vec<(bool, Frame)>, u64) {
    let mut all = Vec::new();
    for ms in 0..60_000 {
        let now = ms * MS;
        let mut to_node = Vec::new();
        master.poll(now, &mut to_node);
        // Answers cross the bus at once; each may call for the next frame.
        let mut to_master = Vec::new();
        node.poll(now, &mut to_master);
        while !(to_node.is_empty() && to_master.is_empty()) {
            for frame in std::mem::take(&mut to_node) {
                let passes = pass(all.len(), true, &frame);
                all.push((true, frame));
                if passes {
                    node.receive(&frame, now, &mut to_master);
                }
            }
            node.poll(now, &mut to_master);
            for frame in std::mem::take(&mut to_master) {
                let passes = pass(all.len(), false, &frame);
                all.push((false, frame));
                if passes {
                    master.receive(&frame, now, &mut to_node);
                }
            }
        }
        if !matches!(master.outcome(), Outcome::Working(_)) {
            return (all, ms);
        }
    }
    panic!("it does not end: {:?}", master.outcome());
}

fn set_up(kind: &Kind, node: &mut Server, pass: Line<'_>) -> (Outcome, Vec<(bool, Frame)>, u64) {
    let mut master = BringUp::new(plan(kind), Limits::default());
    let (frames, ms) = run(&mut master, node, pass);
    (master.outcome().clone(), frames, ms)
}

fn trouble(outcome: &Outcome) -> &Trouble {
    match outcome {
        Outcome::Failed(trouble) => trouble,
        other => panic!("{other:?}"),
    }
}

/// A drive as it comes that takes the mode that it is sent.
fn node(kind: &Kind) -> Server {
    let mut node = simulated::drive(0, NODE, kind);
    node.set(Object::new(0x6064, 0), &123_456i32.to_le_bytes());
    node
}

#[test]
fn from_power_on_to_operational() {
    for mode in [Mode::Position, Mode::Torque] {
        let kind = kind(mode);
        let mut node = node(&kind);
        let (outcome, frames, ms) = set_up(&kind, &mut node, &mut |_, _, _| true);
        assert_eq!(outcome, Outcome::Done);
        assert!(ms < 1000, "{ms} ms");
        assert_eq!(node.state(), NodeState::Operational);
        let is = |index, sub| node.number(Object::new(index, sub));
        assert_eq!(is(0x1A00, 0), Some(3));
        assert_eq!(is(0x1A00, 1), Some(0x6041_0010));
        assert_eq!(is(0x1A00, 3), Some(0x6064_0020));
        assert_eq!(is(0x1A01, 1), Some(0x2240_0020));
        assert_eq!(is(0x1800, 1), Some(0x180 + u32::from(NODE)));
        assert_eq!(is(0x1800, 2), Some(1));
        assert_eq!(is(0x1600, 1), Some(0x6040_0010));
        // What is not used is off.
        assert_eq!(is(0x1403, 1).map(|id| id >> 31), Some(1));
        assert_eq!(is(0x1803, 1).map(|id| id >> 31), Some(1));
        assert_eq!(is(0x1016, 1), Some(u32::from(MASTER) << 16 | 100));
        assert_eq!(is(0x6007, 0), Some(3));
        assert_eq!(is(0x6065, 0), Some(5000));
        assert_eq!((is(0x60C2, 1), is(0x60C2, 2)), (Some(1), Some(0xFD)));
        match mode {
            // No jump by a target of zero.
            Mode::Position => assert_eq!(is(0x607A, 0), Some(123_456)),
            Mode::Torque => assert_eq!(is(0x6071, 0), Some(0)),
        }
        assert_harmless(&frames);
    }
}

/// Nothing that the master has sent switches a drive on or moves it.
fn assert_harmless(frames: &[(bool, Frame)]) {
    for (_, frame) in frames.iter().filter(|(own, _)| *own) {
        let data = frame.payload();
        let sdo = frame.id == SDO_REQUEST_ID + u32::from(NODE);
        assert!(sdo || frame.id == 0, "{frame:?}");
        // No write to the control word, and no process data at all.
        assert!(
            !(sdo && data[0] >> 5 == 1 && data[1..3] == [0x40, 0x60]),
            "{frame:?}"
        );
    }
}

#[test]
fn any_lost_frame_is_made_good() {
    let kind = kind(Mode::Position);
    let whole = set_up(&kind, &mut node(&kind), &mut |_, _, _| true).1.len();
    for lost in 0..whole {
        let pass = &mut |i, _, _: &Frame| i != lost;
        let (outcome, frames, _) = set_up(&kind, &mut node(&kind), pass);
        // The boot-up is awaited by repeated resets; each other frame is asked for again.
        assert_eq!(
            outcome,
            Outcome::Done,
            "frame {lost}: {:?}",
            frames.get(lost)
        );
        assert_harmless(&frames);
    }
}

#[test]
fn a_node_that_falls_silent_anywhere_is_named() {
    let kind = kind(Mode::Torque);
    let whole = set_up(&kind, &mut node(&kind), &mut |_, _, _| true).1.len();
    for from in 0..whole {
        let pass = &mut |i, _, _: &Frame| i < from;
        let (outcome, frames, _) = set_up(&kind, &mut node(&kind), pass);
        let trouble = trouble(&outcome);
        assert_eq!((trouble.node, trouble.name.as_str()), (NODE, "knee"));
        assert!(!trouble.what.is_empty() && !trouble.cure.is_empty());
        assert_harmless(&frames);
        // The operator starts again, with the drive as it was left.
        let again = set_up(&kind, &mut node(&kind), &mut |_, _, _| true);
        assert_eq!(again.0, Outcome::Done);
    }
}

#[test]
fn a_power_cut_anywhere_is_named_and_started_again() {
    let kind = kind(Mode::Position);
    let whole = set_up(&kind, &mut node(&kind), &mut |_, _, _| true).1.len();
    for cut in 4..whole {
        let mut node = node(&kind);
        let mut master = BringUp::new(plan(&kind), Limits::default());
        let mut cut_off = false;
        let mut out = Vec::new();
        let (mut sent, mut now) = (0, 0);
        let mut seen = Vec::new();
        while matches!(master.outcome(), Outcome::Working(_)) && now < 60_000 * MS {
            master.poll(now, &mut out);
            let mut answers = Vec::new();
            node.poll(now, &mut answers);
            for frame in out.drain(..) {
                seen.push((true, frame));
                sent += 1;
                node.receive(&frame, now, &mut answers);
            }
            sent += answers.len();
            if sent >= cut && !cut_off {
                cut_off = true;
                answers.clear();
                node.power_cycle();
            }
            for frame in answers {
                master.receive(&frame, now, &mut out);
            }
            now += MS;
        }
        assert!(cut_off, "{cut}");
        // Before anything was set up a power cut is one more boot-up.
        if master.outcome() == &Outcome::Done {
            assert!(cut <= 8, "{cut}");
        } else {
            let trouble = trouble(master.outcome());
            assert!(trouble.what.contains("started anew"), "{cut}: {trouble}");
        }
        assert_harmless(&seen);
        let again = set_up(&kind, &mut node, &mut |_, _, _| true);
        assert_eq!(again.0, Outcome::Done);
    }
}

#[test]
fn what_is_not_as_planned_is_named_with_its_object() {
    let with = |change: &dyn Fn(&mut Kind)| {
        let mut kind = kind(Mode::Position);
        change(&mut kind);
        kind
    };
    let has = kind(Mode::Position);
    let cases: [(Kind, &str, &str); 4] = [
        (
            with(&|k| k.vendor = Some(7)),
            "1018:01",
            "maker is 0x0 instead of 0x7",
        ),
        (
            with(&|k| k.rated_current = 4.0),
            "6075:00",
            "rated current, mA is 0x1388 instead of 0xfa0",
        ),
        (
            with(&|k| k.other_angle = Some(Object::new(0x1016, 1))),
            "1A01:01",
            "cannot be mapped to a PDO (06040041)",
        ),
        (
            with(&|k| k.sdo.push((Object::new(0x1000, 0), vec![0; 4]))),
            "1000:00",
            "can only be read (06010002)",
        ),
    ];
    for (kind, object, what) in cases {
        let (outcome, frames, _) = set_up(&kind, &mut node(&has), &mut |_, _, _| true);
        let text = trouble(&outcome).to_string();
        for part in ["knee (node 3): ", object, what] {
            assert!(text.contains(part), "{part:?} is not in {text}");
        }
        assert_harmless(&frames);
    }
}

/// CiA 301: a node's heartbeat may be a constant.
#[test]
fn a_heartbeat_that_cannot_be_set_stays_unless_there_is_none() {
    let kind = kind(Mode::Position);
    let heartbeat = Object::new(0x1017, 0);
    for own in [100u16, 0] {
        let mut node = node(&kind);
        node.fix(heartbeat, &own.to_le_bytes());
        let mut master = BringUp::new(plan(&kind), Limits::default());
        run(&mut master, &mut node, &mut |_, _, _| true);
        if own == 0 {
            let text = trouble(master.outcome()).to_string();
            assert!(text.contains("1017:00: it is zero"), "{text}");
        } else {
            assert_eq!(master.outcome(), &Outcome::Done);
            let remarks = &master.done().remarks;
            assert!(remarks[0].contains("stays 100"), "{remarks:?}");
        }
    }
}

#[test]
fn a_mode_that_is_not_taken_is_named() {
    let kind = kind(Mode::Torque);
    let mut node = node(&kind);
    node.mirror_nothing();
    let (outcome, _, ms) = set_up(&kind, &mut node, &mut |_, _, _| true);
    let text = trouble(&outcome).to_string();
    assert!(
        text.contains("6061:00") && text.contains("0x1 instead of 0xa"),
        "{text}"
    );
    assert!(ms >= 2000, "it is given its time: {ms} ms");
}

#[test]
fn two_nodes_with_one_id_are_named() {
    let kind = kind(Mode::Position);
    let mut master = BringUp::new(plan(&kind), Limits::default());
    let mut nodes = [node(&kind), node(&kind)];
    let mut out = Vec::new();
    for ms in 0..1000 {
        let now = ms * MS;
        master.poll(now, &mut out);
        let mut answers = Vec::new();
        for frame in out.drain(..) {
            nodes
                .iter_mut()
                .for_each(|node| node.receive(&frame, now, &mut answers));
        }
        nodes
            .iter_mut()
            .for_each(|node| node.poll(now, &mut answers));
        answers
            .iter()
            .for_each(|frame| master.receive(frame, now, &mut out));
    }
    let text = trouble(master.outcome()).to_string();
    assert!(text.contains("two nodes have this id"), "{text}");
}

#[test]
fn a_dry_run_writes_nothing_and_tells_old_and_new() {
    let kind = kind(Mode::Position);
    let mut node = node(&kind);
    // As after power-on: nothing resets it first.
    let mut master = BringUp::dry(plan(&kind), Limits::default());
    let (frames, _) = run(&mut master, &mut node, &mut |_, _, _| true);
    assert_eq!(master.outcome(), &Outcome::Done);
    for (_, frame) in frames.iter().filter(|(own, _)| *own) {
        assert_eq!(frame.id, SDO_REQUEST_ID + u32::from(NODE), "{frame:?}");
        assert_eq!(frame.payload()[0] >> 5, 2, "a read: {frame:?}");
    }
    let shown: Vec<_> = master
        .done()
        .changes
        .iter()
        .map(ToString::to_string)
        .collect();
    assert!(
        shown
            .iter()
            .any(|line| line.starts_with("6060:00") && line.ends_with("0x1 -> 0x8")),
        "{shown:?}"
    );
}

#[test]
fn a_master_that_falls_silent_is_noticed_in_its_time() {
    let kind = kind(Mode::Position);
    let mut node = node(&kind);
    set_up(&kind, &mut node, &mut |_, _, _| true);
    let (mut out, start) = (Vec::new(), 100_000 * MS);
    let lost_at = (0..1000).find(|ms| {
        let now = start + ms * MS;
        if *ms < 500 && ms % 33 == 0 {
            let heartbeat = drives::canopen::heartbeat(0, MASTER);
            node.receive(&heartbeat, now, &mut out);
        }
        node.poll(now, &mut out);
        node.has_lost_master()
    });
    // The last heartbeat was at 495 ms.
    assert_eq!(lost_at, Some(596));
    let emergency = out
        .iter()
        .find_map(drives::canopen::emcy::Emergency::of)
        .expect("sent");
    assert_eq!((emergency.node, emergency.code), (NODE, 0x8130));
    assert!(drives::canopen::emcy::text(0x8130).contains("master fell silent"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    /// No bytes on the bus make a set-up panic, hang, or send what could move a drive.
    #[test]
    fn no_bytes_make_it_harmful(
        noise in prop::collection::vec((0u32..0x800, prop::collection::vec(any::<u8>(), 0..=8)), 0..400),
    ) {
        let kind = kind(Mode::Position);
        let mut master = BringUp::new(plan(&kind), Limits::default());
        let (mut node, mut sent) = (node(&kind), Vec::new());
        let mut noise = noise.into_iter();
        for ms in 0..20_000u64 {
            let now = ms * MS;
            let (mut out, mut answers) = (Vec::new(), Vec::new());
            master.poll(now, &mut out);
            node.poll(now, &mut answers);
            if let Some((id, bytes)) = noise.next() {
                // Answers of this node more often than others.
                let id = if id % 3 == 0 { SDO_ANSWER_ID + u32::from(NODE) } else { id };
                let mut frame = Frame::zeroed(0, id, bytes.len() as u8, false);
                frame.data[..bytes.len()].copy_from_slice(&bytes);
                answers.push(frame);
            }
            for frame in &answers {
                master.receive(frame, now, &mut out);
            }
            for frame in out {
                sent.push((true, frame));
                let mut answers = Vec::new();
                node.receive(&frame, now, &mut answers);
                let mut ignored = Vec::new();
                answers.iter().for_each(|answer| master.receive(answer, now, &mut ignored));
                sent.extend(ignored.iter().map(|frame| (true, *frame)));
            }
        }
        prop_assert!(!matches!(master.outcome(), Outcome::Working(_)), "{:?}", master.outcome());
        assert_harmless(&sent);
    }
}
