//! Drives of CiA 402 (IEC 61800-7-201): their process data and their set-up.

mod set_up;
pub mod simulated;

use crate::canopen::bring_up::{Bound, Check, Plan, Step, Write};
use crate::canopen::eds::ObjectDictionary;
use crate::canopen::pdo::{self, Direction, Mapped, PDOS, Pdo};
use crate::canopen::{NODES, Object};
use can_codec::{Coding, Dbc, Message, Signal};
use core::f64::consts::TAU;
use problem::{Problem, Problems};

/// Control word.
pub const CONTROL_WORD: Object = Object::new(0x6040, 0);
/// Status word.
pub const STATUS_WORD: Object = Object::new(0x6041, 0);
const MODE: Object = Object::new(0x6060, 0);
const MODE_DISPLAY: Object = Object::new(0x6061, 0);
const POSITION: Object = Object::new(0x6064, 0);
const VELOCITY: Object = Object::new(0x606C, 0);
const TARGET_TORQUE: Object = Object::new(0x6071, 0);
const RATED_CURRENT: Object = Object::new(0x6075, 0);
const CURRENT: Object = Object::new(0x6078, 0);
const ERROR: Object = Object::new(0x603F, 0);
const TORQUE: Object = Object::new(0x6077, 0);
const SUPPLY: Object = Object::new(0x6079, 0);
const TARGET_POSITION: Object = Object::new(0x607A, 0);
const MODES: Object = Object::new(0x6502, 0);

/// State of a drive by its status word, in words.
#[must_use]
pub fn state_text(status: u16) -> &'static str {
    match (status & 0x6F, status & 0x4F) {
        (0x21, _) => "ready to switch on",
        (0x23, _) => "switched on",
        (0x27, _) => "operation enabled",
        (0x07, _) => "quick stop active",
        (_, 0x00) => "not ready to switch on",
        (_, 0x40) => "switch on disabled",
        (_, 0x0F) => "fault reaction active",
        (_, 0x08) => "fault",
        _ => "unknown",
    }
}

/// Node identifier under which the daemon's own heartbeat is sent.
pub const MASTER: u8 = 127;

/// How a drive is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Cyclic synchronous position.
    Position,
    /// Cyclic synchronous torque.
    Torque,
}

impl Mode {
    /// The value of object 6060.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Position => 8,
            Self::Torque => 10,
        }
    }

    /// Its bit in object 6502.
    fn supported(self) -> u32 {
        match self {
            Self::Position => 1 << 7,
            Self::Torque => 1 << 9,
        }
    }

    fn target(self) -> Mapped {
        match self {
            Self::Position => long(TARGET_POSITION),
            Self::Torque => word(TARGET_TORQUE),
        }
    }
}

/// The side of the gear on which object 6064 counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The motor's: the joint's angle is another object's.
    Motor,
    /// The joint's: the motor's angle is another object's.
    Link,
}

/// What a drive reports of itself besides what the loop needs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reported {
    /// Number of its error (603F).
    pub error: bool,
    /// Its own torque (6077).
    pub torque: bool,
    /// Voltage of its supply (6079).
    pub voltage: bool,
    /// The object of a temperature and its length in bits, and one count of it, °C.
    pub temperature: Option<(Mapped, f64)>,
}

/// A kind of drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Kind {
    /// How it is commanded.
    pub mode: Mode,
    /// The side on which 6064 counts, and 607A.
    pub side: Side,
    /// The object of the other side's angle, 32 bits; none: there is no other encoder.
    pub other_angle: Option<Object>,
    /// The velocity (606C) is exchanged too, rpm of the motor per count; none: it is not.
    pub velocity_unit: Option<f64>,
    /// Rated current, A: object 6075, by which 6078 counts.
    pub rated_current: f64,
    /// Current that makes the rated torque, A: object 6076, by which 6071 counts.
    pub current_per_torque: f64,
    /// Rated torque, N·m at the joint: object 6076, by which 6077 counts.
    pub rated_torque: f64,
    /// What it reports of itself besides, ten times a second.
    pub reported: Reported,
    /// Time after which the drive counts the daemon as lost, ms.
    pub heartbeat_ms: u16,
    /// Number of the maker (1018:01), if it must be that.
    pub vendor: Option<u32>,
    /// Number of the product (1018:02), if it must be that.
    pub product: Option<u32>,
    /// Further objects to write: the maker's own, limits.
    pub sdo: Vec<(Object, Vec<u8>)>,
}

/// A drive of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive<'k> {
    /// Its kind.
    pub kind: &'k Kind,
    /// What it moves: a prefix of its messages' names.
    pub name: &'k str,
    /// Index of its bus.
    pub bus: u8,
    /// Its node.
    pub node: u8,
    /// Interval of SYNC, s.
    pub period: f64,
    /// Unit of a position in 607A, and what one count is in it.
    pub position_count: (&'k str, f64),
    /// Limits of the joint, with which the drive's own are compared; none: they are not read.
    pub asked: Option<Asked>,
}

/// Limits of a joint that its drive must allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// Torque limit of the joint, N·m; of a prismatic joint force, N.
    pub torque: f64,
    /// Current of that torque, A.
    pub current: f64,
    /// Least and greatest position, in counts of 6064; none: not limited.
    pub positions: Option<[f64; 2]>,
    /// By how much a position's set-point may lead the joint, in counts of 6064.
    pub lead: f64,
}

/// Names of a drive's signals in the messages that [`Drive::messages`] makes.
pub mod signals {
    /// Status word.
    pub const STATUS: &str = "status";
    /// Angle of the motor.
    pub const MOTOR_ANGLE: &str = "motor_angle";
    /// Angle of the joint.
    pub const LINK_ANGLE: &str = "link_angle";
    /// Current.
    pub const CURRENT: &str = "current";
    /// Velocity of the motor.
    pub const VELOCITY: &str = "velocity";
    /// Control word.
    pub const CONTROL: &str = "control";
    /// Position or current.
    pub const SET_POINT: &str = "set_point";
    /// Temperature.
    pub const TEMPERATURE: &str = "temperature";
    /// Voltage of the supply.
    pub const VOLTAGE: &str = "voltage";
    /// Its own torque, at the output.
    pub const TORQUE: &str = "drive_torque";
    /// Number of its error; 0: none.
    pub const ERROR: &str = "drive_error";
}

/// Time between two tellings of what changes slowly, s.
const TOLD_S: f64 = 0.1;

const fn word(object: Object) -> Mapped {
    Mapped { object, bits: 16 }
}

const fn long(object: Object) -> Mapped {
    Mapped { object, bits: 32 }
}

impl Drive<'_> {
    /// Its process data. The control word has a message of its own: it enables a drive before any
    /// set-point leaves.
    ///
    /// # Errors
    /// More than the messages hold.
    pub fn process_data(&self) -> Result<Vec<Pdo>, Problem> {
        let kind = self.kind;
        let first = [word(STATUS_WORD), word(CURRENT), long(POSITION)];
        let mut second = Vec::new();
        second.extend(kind.other_angle.map(long));
        second.extend(kind.velocity_unit.map(|_| long(VELOCITY)));
        let mut groups: Vec<&[Mapped]> = vec![&first];
        if !second.is_empty() {
            groups.push(&second);
        }
        let mut pdos = pdo::plan(Direction::Transmit, 1, &groups)?;
        let objects = self.objects_reported();
        if !objects.is_empty() {
            let groups: Vec<&[Mapped]> = objects.chunks(1).collect();
            // At every so many SYNCs.
            let every = (TOLD_S / self.period).round().clamp(1.0, 240.0) as u8;
            for mut pdo in pdo::plan(Direction::Transmit, every, &groups)? {
                pdo.number = pdos.len() as u8;
                pdos.push(pdo);
            }
            if pdos.len() > usize::from(PDOS) {
                let what = format!("{} messages are sent by the drive", pdos.len());
                return Err(Problem::new(
                    what,
                    "at most four PDOs of 8 bytes: less in `reports`",
                ));
            }
        }
        // At once: a control word must not wait for the next SYNC, nor a set-point, which is
        // computed from this cycle's samples.
        let receive = |number, mapped| Pdo {
            direction: Direction::Receive,
            number,
            transmission: 255,
            mapped: vec![mapped],
        };
        pdos.push(receive(0, word(CONTROL_WORD)));
        pdos.push(receive(1, kind.mode.target()));
        Ok(pdos)
    }

    /// What it reports of itself besides.
    fn objects_reported(&self) -> Vec<Mapped> {
        let reported = &self.kind.reported;
        let all = [
            reported.error.then_some(word(ERROR)),
            reported.torque.then_some(word(TORQUE)),
            reported.voltage.then_some(long(SUPPLY)),
            reported.temperature.map(|(mapped, _)| mapped),
        ];
        all.into_iter().flatten().collect()
    }

    /// Messages of its process data, as a DBC file would describe them, named `NAME_TPDO1` and so on.
    ///
    /// # Errors
    /// As [`process_data`](Self::process_data).
    pub fn messages(&self) -> Result<Dbc, Problem> {
        let pdos = self.process_data()?;
        let messages = pdos.iter().map(|pdo| {
            let kind = match pdo.direction {
                Direction::Transmit => 'T',
                Direction::Receive => 'R',
            };
            let name = format!("{}_{kind}PDO{}", self.name, pdo.number + 1);
            let places = pdo.places();
            let signals = places
                .map(|(mapped, bit)| self.signal(mapped, bit))
                .collect();
            Message::new(name, pdo.id(self.node), pdo.len(), signals)
        });
        Ok(Dbc {
            file: format!("process data of {} (node {})", self.name, self.node),
            messages: messages.collect(),
        })
    }

    /// `MESSAGE.signal` of a signal's name, if the drive has it.
    #[must_use]
    pub fn path(&self, signal: &str) -> Option<String> {
        let dbc = self.messages().ok()?;
        let found = dbc
            .messages
            .iter()
            .find(|message| message.signal(signal).is_some())?;
        Some(format!("{}.{signal}", found.name))
    }

    fn signal(&self, mapped: Mapped, bit: usize) -> Signal {
        let kind = self.kind;
        let per_mille = kind.rated_current / 1000.0;
        let (own, other) = match kind.side {
            Side::Motor => (signals::MOTOR_ANGLE, signals::LINK_ANGLE),
            Side::Link => (signals::LINK_ANGLE, signals::MOTOR_ANGLE),
        };
        let (name, unit, scale, coding) = match mapped.object {
            STATUS_WORD => (signals::STATUS, "", 1.0, Coding::Unsigned),
            CONTROL_WORD => (signals::CONTROL, "", 1.0, Coding::Unsigned),
            CURRENT => (signals::CURRENT, "A", per_mille, Coding::Signed),
            TARGET_TORQUE => {
                let scale = kind.current_per_torque / 1000.0;
                (signals::SET_POINT, "A", scale, Coding::Signed)
            }
            TARGET_POSITION => {
                let (unit, scale) = self.position_count;
                (signals::SET_POINT, unit, scale, Coding::Signed)
            }
            POSITION => (own, "count", 1.0, Coding::Signed),
            VELOCITY => {
                let rpm = kind.velocity_unit.unwrap_or(1.0);
                (signals::VELOCITY, "rad/s", rpm * TAU / 60.0, Coding::Signed)
            }
            ERROR => (signals::ERROR, "", 1.0, Coding::Unsigned),
            TORQUE => {
                let scale = kind.rated_torque / 1000.0;
                (signals::TORQUE, "Nm", scale, Coding::Signed)
            }
            SUPPLY => (signals::VOLTAGE, "mV", 1.0, Coding::Unsigned),
            object => match kind.reported.temperature {
                Some((mapped, count)) if mapped.object == object => {
                    (signals::TEMPERATURE, "degC", count, Coding::Signed)
                }
                _ => (other, "count", 1.0, Coding::Signed),
            },
        };
        Signal::new(name, unit, coding, bit, mapped.bits, scale)
    }

    /// Checks the drive against its object dictionary.
    ///
    /// # Errors
    /// Objects that it lacks or cannot exchange, and a mode that it does not have.
    pub fn check(&self, dictionary: &ObjectDictionary) -> Result<(), Problems> {
        let mut problems = match self.process_data() {
            Ok(pdos) => pdo::check(&pdos, dictionary),
            Err(problem) => vec![problem],
        };
        for (object, value) in &self.kind.sdo {
            let entry = dictionary.entry(*object);
            let bits = 8 * value.len();
            let what = match entry {
                None => format!("no object {object}"),
                Some(entry) if !entry.writable => format!("{object} cannot be written"),
                Some(entry) if entry.bits.is_some_and(|own| usize::from(own) != bits) => {
                    format!("{object} does not have {bits} bits")
                }
                Some(_) => continue,
            };
            let line = entry.map_or(0, |entry| entry.line);
            let problem = Problem::new(what, "objects of this drive, with their lengths");
            problems.push(problem.at(&dictionary.file, line));
        }
        if let Some(modes) = dictionary.value(MODES, self.node)
            && modes as u32 & self.kind.mode.supported() == 0
            && modes != 0
        {
            let what = format!(
                "object {MODES}: the drive has no mode {}",
                self.kind.mode.number()
            );
            let line = dictionary.entry(MODES).map_or(0, |entry| entry.line);
            problems.push(Problem::new(what, "the other command").at(&dictionary.file, line));
        }
        if problems.is_empty() {
            Ok(())
        } else {
            Err(Problems(problems))
        }
    }
}
