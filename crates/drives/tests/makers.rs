//! Object dictionaries as four makers have them: held against what a joint needs, and set up.
//!
//! Types, access, mappability and defaults are those of the makers' own files: Elmo Gold (Elmo.dcf), joints of Schunk
//! (firmware 0.63) and of the Pilz PRBT (prbt_0_1.dcf), ZeroErr eRob (ZeroErrDriver.eds). The files here are made of
//! them.

use can_codec::Frame;
use drives::canopen::bring_up::{BringUp, Limits, Outcome};
use drives::canopen::eds::ObjectDictionary;
use drives::canopen::server::{Server, Value};
use drives::canopen::{NodeState, Object};
use drives::cia402::{Drive, Kind, Mode, Reported, Side};
use std::collections::BTreeMap;
use std::fmt::Write as _;

const NODE: u8 = 3;

/// Type (CiA 301), access, mappable.
type Facts = (u8, &'static str, bool);

/// Objects that all four dictionaries have, or three of them.
const COMMON: &[(&str, Facts)] = &[
    ("1000", (7, "ro", false)),
    ("1001", (5, "ro", false)),
    ("1016sub1", (7, "rw", false)),
    ("1017", (6, "rw", false)),
    ("1018sub1", (7, "ro", false)),
    ("1018sub2", (7, "ro", false)),
    ("6040", (6, "rww", true)),
    ("6041", (6, "ro", true)),
    ("6060", (2, "rww", true)),
    ("6061", (2, "ro", true)),
    ("6064", (4, "ro", true)),
    ("6065", (7, "rw", false)),
    ("606C", (4, "ro", true)),
    ("6073", (6, "rww", true)),
    ("6075", (7, "rw", false)),
    ("6077", (3, "ro", true)),
    ("607A", (4, "rw", true)),
    ("60C2sub1", (5, "rw", false)),
    ("60C2sub2", (2, "rw", false)),
    ("6502", (7, "ro", false)),
];

/// A maker's drive, by how it differs.
struct Maker {
    name: &'static str,
    /// Number of PDOs that it receives.
    received: u16,
    /// PDOs beyond the first are off at power-on.
    off: bool,
    lacks: &'static [&'static str],
    own: &'static [(&'static str, Facts)],
    defaults: &'static [(&'static str, i64)],
    /// Object of a second encoder.
    other_angle: Option<Object>,
}

const ELMO: Maker = Maker {
    name: "Elmo Motion Control",
    received: 4,
    off: false,
    lacks: &[],
    own: &[
        ("6007", (3, "rw", false)),
        ("603F", (6, "ro", false)),
        ("6071", (3, "rww", true)),
        ("6072", (6, "rw", false)),
        ("6073", (6, "rw", false)),
        ("6076", (7, "rw", false)),
        ("6078", (3, "ro", true)),
        ("607A", (4, "rww", true)),
        ("20A0", (4, "rwr", true)),
    ],
    // Its file has no value of 6502: as its manual has it, that of all cyclic modes.
    defaults: &[
        ("1000", 0x192),
        ("1018sub1", 0x9A),
        ("6502", 0x3AD),
        ("60C2sub2", -3),
    ],
    other_angle: Some(Object::new(0x20A0, 0)),
};

const EROB: Maker = Maker {
    name: "ZEROERR CONTROL",
    received: 4,
    off: true,
    lacks: &["6073"],
    own: &[
        ("1001", (5, "ro", true)),
        ("603F", (6, "ro", true)),
        ("6065", (4, "rww", true)),
        ("6071", (3, "rww", true)),
        ("6075", (7, "ro", true)),
        ("6076", (7, "ro", true)),
        ("6078", (3, "ro", true)),
        ("6079", (7, "ro", true)),
        ("607A", (4, "rww", true)),
        ("60C2sub1", (5, "rww", true)),
        ("60C2sub2", (2, "rww", false)),
        ("6502", (7, "ro", true)),
        ("2240", (4, "ro", true)),
    ],
    defaults: &[
        ("1000", 0x42_0192),
        ("1018sub1", 0x5A65_726F),
        ("6502", 909),
        ("60C2sub2", -3),
    ],
    other_angle: Some(Object::new(0x2240, 0)),
};

const SCHUNK: Maker = Maker {
    name: "SCHUNK GmbH & Co. KG",
    received: 2,
    off: false,
    lacks: &[],
    own: &[("6060", (2, "rw", true))],
    defaults: &[
        ("1000", 0x192),
        ("6502", 0x43),
        ("60C2sub1", 8),
        ("60C2sub2", -3),
    ],
    other_angle: None,
};

const PILZ: Maker = Maker {
    name: "Pilz GmbH & Co. KG",
    ..SCHUNK
};

impl Maker {
    fn value(&self, name: &str) -> i64 {
        let mut defaults = self.defaults.iter();
        defaults
            .find(|(own, _)| *own == name)
            .map_or(0, |(_, value)| *value)
    }

    /// Its objects but those of PDOs.
    fn objects(&self) -> BTreeMap<&'static str, Facts> {
        let common = COMMON.iter().filter(|(name, _)| !self.lacks.contains(name));
        common.chain(self.own).copied().collect()
    }

    fn file(&self) -> String {
        let mut text = format!("[DeviceInfo]\r\nVendorName={}\r\n", self.name);
        let mut add = |name: &str, (kind, access, mappable): Facts, default: &str| {
            let mappable = u8::from(mappable);
            let _ = write!(
                text,
                "[{name}]\r\nParameterName={name}\r\nDataType=0x{kind:04X}\r\nAccessType={access}\r\n\
                 PDOMapping={mappable}\r\nDefaultValue={default}\r\n"
            );
        };
        for (name, facts) in self.objects() {
            add(name, facts, &self.value(name).to_string());
        }
        for (direction, id, count) in [(0x1400, 0x200, self.received), (0x1800, 0x180, 4)] {
            for number in 0..count {
                let off = if self.off && number > 0 {
                    0x8000_0000_u32
                } else {
                    0
                };
                let (parameters, id) = (direction + number, off + id + 0x100 * u32::from(number));
                add(
                    &format!("{parameters:04X}sub1"),
                    (7, "rw", false),
                    &format!("$NODEID+0x{id:X}"),
                );
                add(&format!("{parameters:04X}sub2"), (5, "rw", false), "255");
                for sub in 0..=8 {
                    let (name, kind) = (
                        format!("{:04X}sub{sub}", parameters + 0x200),
                        if sub == 0 { 5 } else { 7 },
                    );
                    add(&name, (kind, "rw", false), "0");
                }
            }
        }
        text
    }

    fn dictionary(&self) -> ObjectDictionary {
        let file = self.file();
        ObjectDictionary::parse(&file, "drive.eds").unwrap_or_else(|problems| panic!("{problems}"))
    }

    fn kind(&self, mode: Mode) -> Kind {
        Kind {
            mode,
            side: Side::Motor,
            other_angle: self.other_angle,
            velocity_unit: Some(1.0),
            rated_current: 5.0,
            current_per_torque: 5.0,
            rated_torque: 100.0,
            reported: Reported::default(),
            heartbeat_ms: 100,
            vendor: None,
            product: None,
            sdo: Vec::new(),
        }
    }

    /// A node with these objects, each with its file's default.
    fn node(&self) -> Server {
        let dictionary = self.dictionary();
        let mut objects = BTreeMap::new();
        for index in 0x1000..=0x6FFF {
            for sub in 0..=8 {
                let object = Object::new(index, sub);
                let Some(entry) = dictionary.entry(object) else {
                    continue;
                };
                let value = dictionary.value(object, NODE).unwrap_or(0).to_le_bytes();
                let len = usize::from(entry.bits.unwrap_or(32)) / 8;
                let value = Value {
                    bytes: value[..len].to_vec(),
                    writable: entry.writable,
                    mappable: entry.mappable,
                };
                objects.insert(object, value);
            }
        }
        let mut node = Server::new(0, NODE, objects);
        node.mirror(Object::new(0x6060, 0), Object::new(0x6061, 0));
        node.set(Object::new(0x6064, 0), &77_777_i32.to_le_bytes());
        node.set(Object::new(0x6075, 0), &5000_u32.to_le_bytes());
        node
    }
}

fn drive(kind: &Kind) -> Drive<'_> {
    Drive {
        kind,
        name: "knee",
        bus: 0,
        node: NODE,
        period: 1e-3,
        position_count: ("count", 1.0),
        asked: None,
    }
}

/// Sets a node up: the master at its end.
fn set_up(kind: &Kind, node: &mut Server) -> BringUp {
    let mut master = BringUp::new(drive(kind).plan().expect("a plan"), Limits::default());
    let (mut out, mut answers) = (Vec::<Frame>::new(), Vec::<Frame>::new());
    for now in (0..60_000).map(|ms| ms * 1_000_000) {
        master.poll(now, &mut out);
        out.drain(..)
            .for_each(|frame| node.receive(&frame, now, &mut answers));
        node.poll(now, &mut answers);
        answers
            .drain(..)
            .for_each(|frame| master.receive(&frame, now, &mut out));
        if !matches!(master.outcome(), Outcome::Working(_)) {
            return master;
        }
    }
    panic!("{:?}", master.outcome());
}

#[test]
fn drives_with_what_a_joint_needs_fit_and_become_operational() {
    for maker in [ELMO, EROB] {
        for mode in [Mode::Position, Mode::Torque] {
            let (kind, mut node) = (maker.kind(mode), maker.node());
            if let Err(problems) = drive(&kind).check(&maker.dictionary()) {
                panic!("{}: {problems}", maker.name);
            }
            let master = set_up(&kind, &mut node);
            assert_eq!(master.outcome(), &Outcome::Done, "{}", maker.name);
            assert_eq!(node.state(), NodeState::Operational);
            let is = |index, sub| node.number(Object::new(index, sub));
            assert_eq!(is(0x1A00, 0), Some(3), "{}", maker.name);
            let other = maker.other_angle.map(|it| u32::from(it.index) << 16 | 32);
            assert_eq!(is(0x1A01, 1), other, "{}", maker.name);
            assert_eq!(is(0x1801, 1), Some(0x283), "{}", maker.name);
            assert_eq!(is(0x1403, 1).map(|id| id >> 31), Some(1), "{}", maker.name);
            if mode == Mode::Position {
                assert_eq!(is(0x607A, 0), Some(77_777), "{}", maker.name);
            }
            // A drive without a reaction to a lost master is named.
            let missing = master.done().changes.iter().filter(|change| change.missing);
            let missing: Vec<u16> = missing.map(|change| change.object.index).collect();
            let expected: &[u16] = if maker.name == EROB.name {
                &[0x6007]
            } else {
                &[]
            };
            assert_eq!(missing, expected, "{}", maker.name);
        }
    }
}

#[test]
fn drives_without_it_are_refused_and_named() {
    for maker in [SCHUNK, PILZ] {
        for (mode, number) in [(Mode::Position, 8), (Mode::Torque, 10)] {
            let kind = maker.kind(mode);
            let refused = drive(&kind).check(&maker.dictionary());
            let refused = refused.expect_err("it lacks the current").to_string();
            for part in [
                "no object 6078:00".to_owned(),
                format!("the drive has no mode {number}"),
            ] {
                assert!(
                    refused.contains(&part),
                    "{}: {part:?} is not in {refused}",
                    maker.name
                );
            }
            let master = set_up(&kind, &mut maker.node());
            let Outcome::Failed(trouble) = master.outcome() else {
                panic!("{}: {:?}", maker.name, master.outcome());
            };
            let text = trouble.to_string();
            let cure = format!("the drive lacks mode {number}");
            for part in ["knee (node 3)", "6502:00", cure.as_str()] {
                assert!(
                    text.contains(part),
                    "{}: {part:?} is not in {text}",
                    maker.name
                );
            }
        }
    }
}
