//! Files of recorded runs: what was written is read again; damaged ones give what is whole in them.

use std::io::Cursor;

use can_codec::{Frame, Frames};
use cycle::{ClientInput, Instants, OperatorRequest, Stamp};
use recording::{
    AttachedFile, CycleInput, CycleMessage, Encoder, Ending, Glance, Header, ReadError, Run,
    RunWriter, Start,
};
use robot_state::{Content, Event, JointKind, Reference, Settings, SharedRecord};
use test_support::{Random, allocations};

const CYCLES: u64 = 400;

fn header() -> Header {
    Header {
        kinds: vec![JointKind::Prismatic, JointKind::Revolute],
        robot: "leg".to_owned(),
        version: "0.1.0".to_owned(),
        period_s: 0.001,
        joints: ["hip", "knee", "ankle"].map(str::to_owned).to_vec(),
        sensors: vec!["foot".to_owned()],
        imus: ["pelvis", "head"].map(str::to_owned).to_vec(),
        contact_sets: vec!["standing".to_owned()],
        buses: vec!["a".to_owned()],
        start: Start {
            fault: Some(Event::JointStale),
            unix_offset_ns: -5,
        },
        content: Content::All,
        every: 1,
        black_box: Some(Event::LoopEnded),
        files: vec![AttachedFile {
            path: "config/leg/robot.toml".to_owned(),
            text: "[robot]\nname = \"leg\"\n".to_owned(),
        }],
    }
}

/// Input and output of the cycle of that number: noise, which does not compress away.
struct Given {
    at: Instants,
    rx: Frames,
    tx: Frames,
    reference: Reference,
    settings: Settings,
    request: Option<OperatorRequest>,
    record: SharedRecord,
}

fn given(cycle: u64) -> Given {
    let mut random = Random::new(cycle);
    let mut record = SharedRecord::default();
    record.cycle.sequence = cycle;
    record.cycle.stamp_ns = 1000 + cycle * 1_000_000;
    (record.cycle.joint_count, record.cycle.ft_count) = (3, 1);
    for joint in record.cycle.measured.joints.iter_mut().take(3) {
        (joint.q, joint.theta, joint.age_s) = (random.normal(), random.normal(), f64::INFINITY);
    }
    let mut rx = Frames::default();
    for i in 0..5_u8 {
        let mut frame = Frame::zeroed(i % 2, u32::from(i) | 1 << 31, 3 * i, i == 4);
        frame.stamp_ns = random.bits();
        frame.data[..usize::from(frame.len)].fill(i);
        frame.error = i == 3;
        rx.push(frame);
    }
    rx.count_overflow(cycle % 3);
    let mut tx = Frames::default();
    tx.push(Frame::zeroed(0, 0x201, 8, false));
    Given {
        at: Instants {
            sync: Stamp(cycle * 1_000_000),
            now: Stamp(1000 + cycle * 1_000_000),
        },
        rx,
        tx,
        reference: Reference {
            sequence: cycle,
            joint_count: 3,
            ..Reference::default()
        },
        settings: Settings {
            sequence: 7,
            ..Settings::default()
        },
        request: (cycle.is_multiple_of(100)).then_some(OperatorRequest::Acknowledge(104)),
        record,
    }
}

impl Given {
    fn input(&self) -> CycleInput<'_> {
        CycleInput {
            at: self.at,
            rx: &self.rx,
            client: ClientInput {
                reference: Some(&self.reference),
                age_s: 0.25,
                commander: self.record.cycle.commander,
                settings: Some(&self.settings),
                request: self.request,
            },
        }
    }
}

fn file() -> Vec<u8> {
    file_of(&header())
}

fn file_of(header: &Header) -> Vec<u8> {
    let mut encoder = Encoder::new(header.counts());
    let mut writer = RunWriter::new(Cursor::new(Vec::new()), header).expect("in memory");
    for cycle in 1..=CYCLES {
        let given = given(cycle);
        if cycle.is_multiple_of(50) {
            encoder.note(Event::LateCycle, 2);
            encoder.note(Event::SkippedCycle, 0);
        }
        let bytes = encoder.encode(&given.input(), &given.record, &given.tx);
        let glance = Glance::at(bytes).expect("a message");
        assert_eq!((glance.sequence, glance.fault), (cycle, 0));
        writer.write(bytes).expect("in memory");
        if cycle.is_multiple_of(100) {
            writer.flush().expect("in memory");
        }
    }
    writer.finish().expect("in memory").into_inner()
}

/// The cycles that can be read, and how the file ends.
fn read(bytes: &[u8]) -> Result<(u64, Ending), ReadError> {
    let mut run = Run::open(bytes)?;
    let mut message = CycleMessage::default();
    let mut cycles = 0;
    while run.next_cycle(&mut message)? {
        cycles += 1;
        assert_eq!(message.record.cycle.sequence, cycles, "in order and whole");
    }
    Ok((cycles, run.ending().cloned().expect("an end")))
}

#[test]
fn what_was_written_is_read_again() {
    let bytes = file();
    let mut run = Run::open(bytes.as_slice()).expect("a run");
    assert_eq!(*run.header(), header());
    let mut message = CycleMessage::default();
    for cycle in 1..=CYCLES {
        assert!(run.next_cycle(&mut message).expect("readable"));
        let given = given(cycle);
        assert_eq!(*message.record, given.record);
        assert_eq!(message.at, given.at);
        assert_eq!(message.rx.as_slice(), given.rx.as_slice());
        assert_eq!(message.rx.overflow(), given.rx.overflow());
        assert_eq!(message.tx.as_slice(), given.tx.as_slice());
        let client = message.client();
        assert_eq!(client.reference, Some(&given.reference));
        assert_eq!(client.settings, Some(&given.settings));
        assert_eq!((client.age_s, client.request), (0.25, given.request));
        let notes: &[_] = if cycle.is_multiple_of(50) {
            &[(Event::LateCycle, 2)]
        } else {
            &[]
        };
        assert_eq!(message.notes, notes);
    }
    assert!(!run.next_cycle(&mut message).expect("readable"));
    assert_eq!(run.ending(), Some(&Ending::Complete));
}

#[test]
fn frames_are_read_again_with_a_checksum_in_place_of_what_follows_from_them() {
    let header = Header {
        content: Content::Frames,
        ..header()
    };
    let bytes = file_of(&header);
    let mut run = Run::open(bytes.as_slice()).expect("a run");
    assert_eq!(*run.header(), header);
    let mut message = CycleMessage::default();
    let mut checks = Vec::new();
    for cycle in 1..=CYCLES {
        assert!(run.next_cycle(&mut message).expect("readable"));
        let given = given(cycle);
        let head = |record: &SharedRecord| {
            let cycle = &record.cycle;
            (
                cycle.sequence,
                cycle.stamp_ns,
                cycle.joint_count,
                record.timing,
            )
        };
        assert_eq!(head(&message.record), head(&given.record));
        assert_eq!(
            message.record.cycle.measured,
            SharedRecord::default().cycle.measured
        );
        assert_eq!(message.at, given.at);
        assert_eq!(message.rx.as_slice(), given.rx.as_slice());
        assert_eq!(message.rx.overflow(), given.rx.overflow());
        assert!(message.tx.is_empty());
        let client = message.client();
        assert_eq!(client.reference, Some(&given.reference));
        assert_eq!(client.settings, Some(&given.settings));
        assert_eq!((client.age_s, client.request), (0.25, given.request));
        assert_eq!(message.notes.len(), usize::from(cycle.is_multiple_of(50)));
        checks.push(message.check.expect("a checksum"));
    }
    assert!(!run.next_cycle(&mut message).expect("readable"));
    assert_eq!(run.ending(), Some(&Ending::Complete));
    checks.sort_unstable();
    checks.dedup();
    assert_eq!(checks.len() as u64, CYCLES, "each of its own record");
}

#[test]
fn torques_are_read_again_with_seven_digits_of_every_second_cycle() {
    let header = Header {
        content: Content::Torques,
        every: 2,
        ..header()
    };
    let bytes = file_of(&header);
    let mut run = Run::open(bytes.as_slice()).expect("a run");
    let mut message = CycleMessage::default();
    for cycle in (2..=CYCLES).step_by(2) {
        assert!(run.next_cycle(&mut message).expect("readable"));
        let (found, given) = (&message.record.cycle, given(cycle).record.cycle);
        assert_eq!(
            (found.sequence, found.stamp_ns),
            (given.sequence, given.stamp_ns)
        );
        for (found, given) in found.measured.joints.iter().zip(&given.measured.joints) {
            assert_eq!(found.q, f64::from(given.q as f32));
            assert_eq!(found.theta, f64::from(given.theta as f32));
            assert_eq!(found.age_s, 0.0, "not recorded");
        }
        assert!(message.rx.is_empty() && message.reference().is_none());
    }
    assert!(!run.next_cycle(&mut message).expect("readable"));
    assert_eq!(run.ending(), Some(&Ending::Complete));
}

#[test]
fn damaged_frames_and_torques_are_never_read_wrong() {
    for content in [Content::Frames, Content::Torques] {
        let header = Header {
            content,
            ..header()
        };
        let bytes = file_of(&header);
        let mut random = Random::new(6);
        for _ in 0..100 {
            let length = random.below(bytes.len());
            let _ = read(&bytes[..length]);
            let mut spoilt = bytes.clone();
            let place = random.below(spoilt.len());
            spoilt[place] = random.bits() as u8;
            let _ = read(&spoilt);
        }
        assert_eq!(read(&bytes).expect("whole"), (CYCLES, Ending::Complete));
    }
}

#[test]
fn the_loop_does_not_allocate_for_a_message() {
    let mut encoder = Encoder::new(header().counts());
    let mut many = Frames::default();
    while many.push(Frame::zeroed(0, 1, 64, true)) {}
    let mut given = given(1);
    (given.rx, given.tx) = (many.clone(), many);
    let before = allocations();
    for _ in 0..10 {
        for event in Event::ALL.iter().cycle().take(100) {
            encoder.note(*event, 1);
        }
        assert!(
            encoder
                .encode(&given.input(), &given.record, &given.tx)
                .len()
                > 80_000
        );
    }
    assert_eq!(allocations() - before, 0);
}

#[test]
fn a_truncated_file_gives_every_cycle_that_was_flushed() {
    let bytes = file();
    let mut random = Random::new(3);
    let mut most = 0;
    let lengths = (0..60).map(|_| random.below(bytes.len()));
    let mut lengths: Vec<usize> = lengths.chain([0, 3, 8, bytes.len() - 1]).collect();
    lengths.sort_unstable();
    for length in lengths {
        match read(&bytes[..length]) {
            Ok((cycles, ending)) => {
                assert_ne!(
                    ending,
                    Ending::Complete,
                    "{length} of {} bytes",
                    bytes.len()
                );
                assert!(cycles >= most, "more bytes, no fewer cycles");
                most = cycles;
            }
            Err(ReadError::NotARun | ReadError::NoCycle(_)) => assert_eq!(most, 0),
            Err(other) => panic!("{length} bytes: {other}"),
        }
    }
    // All but the index at the end.
    assert_eq!(most, CYCLES);
}

#[test]
fn damaged_files_are_named_and_never_read_wrong() {
    let bytes = file();
    let mut random = Random::new(5);
    let mut damaged = 0;
    for _ in 0..150 {
        let mut spoilt = bytes.clone();
        for _ in 0..1 + random.below(4) {
            let place = random.below(spoilt.len());
            spoilt[place] = random.bits() as u8;
        }
        // `read` asserts that no cycle is out of order; a chunk's checksum keeps the rest.
        match read(&spoilt) {
            Ok((cycles, Ending::Complete)) => assert!(cycles <= CYCLES),
            Ok(_) | Err(_) => damaged += 1,
        }
    }
    assert!(damaged > 75, "{damaged} of 150 were noticed");
}

#[test]
fn a_recording_that_was_joined_to_another_is_not_left_out_in_silence() {
    let (cycles, ending) = read(&[file(), file()].concat()).expect("read");
    assert_eq!(cycles, CYCLES);
    assert!(
        matches!(&ending, Ending::Damaged(why) if why.contains("more follows")),
        "{ending:?}"
    );
}

#[test]
fn other_files_are_refused_by_what_they_are() {
    let text = b"time,q1,q2\n0.0,1.0,2.0\n";
    assert!(matches!(read(text), Err(ReadError::NotMcap)));
    let mut other = mcap::Writer::new(Cursor::new(Vec::new())).expect("in memory");
    let channel = other.add_channel(0, "/chatter", "raw", &Default::default());
    let header = mcap::records::MessageHeader {
        channel_id: channel.expect("a channel"),
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    other
        .write_to_known_channel(&header, b"hello")
        .expect("in memory");
    other.finish().expect("in memory");
    let other = other.into_inner().into_inner();
    assert!(matches!(read(&other), Err(ReadError::NotARun)));
    let mut later = file();
    let layout = format!("{:016x}", Header::layout());
    let place = later
        .windows(16)
        .position(|w| w == layout.as_bytes())
        .expect("the layout");
    later[place..place + 16].copy_from_slice(b"0123456789abcdef");
    match read(&later) {
        Err(ReadError::OtherVersion { version, found, .. }) => {
            assert_eq!((version.as_str(), found), ("0.1.0", 0x0123_4567_89ab_cdef));
        }
        other => panic!("{other:?}"),
    }
    let none = RunWriter::new(Cursor::new(Vec::new()), &self::header()).expect("in memory");
    let none = none.finish().expect("in memory").into_inner();
    assert!(matches!(read(&none), Err(ReadError::NoCycle(_))));
}
