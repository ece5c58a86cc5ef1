//! Actuators of a robot as the loop sees them: a message of state, one of set-points and one of control
//! words for each, whatever its family; and these messages turned into the family's frames and back.

mod live;
mod load;
mod reports;

use super::{Address, FAMILIES, Family, Model};
use can_codec::{Coding, Dbc, EXTENDED_ID, Frame, Frames, Message, Signal};
use live::{Live, Whose};
pub use load::Exchanged;
use problem::Problem;
pub use reports::{Report, Reports};

/// Identifiers of the loop's own messages: none of them is ever on a bus.
const OWN_ID: u32 = EXTENDED_ID | 0x1F80_0000;
const OWN_MASK: u32 = EXTENDED_ID | 0x1FFF_0000;
/// The message that begins a cycle: every actuator of the bus is asked for its state.
const ASK_ID: u32 = OWN_ID | 0xFFFF;
/// Length of a message of state, bytes.
const STATE_LEN: u8 = 32;
/// Kinds of messages, in the two lowest bits of an identifier.
const STATE: u32 = 0;
const COMMAND: u32 = 1;
const CONTROL: u32 = 2;

/// Control word: no torque.
pub const DISABLE: u32 = 0;
/// Control word: it follows set-points.
pub const ENABLE: u32 = 1;
/// Control word: its error is cleared.
pub const RESET: u32 = 2;
/// Control word: it follows no position, but goes on with its torque of before, damped.
pub const BEAR: u32 = 3;
/// Status word of an actuator that does, as far as it reports its torque.
pub const BEARS: u32 = 4;
/// Status word of an actuator of whose state nothing has been heard for [`SILENT_NS`].
const UNKNOWN: u32 = 3;
/// Time after which a state counts as unknown, ns: families that send it apart do so at 10 Hz.
const SILENT_NS: u64 = 500_000_000;
/// Count of positions where a family sends floats, rad.
const FINE: f64 = 1e-5;

/// An actuator of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    /// Its family.
    pub family: &'static str,
    /// Its model.
    pub model: Model,
    /// Where it is.
    pub at: Address,
    /// What it moves: a prefix of its messages' names.
    pub name: String,
    /// Torque for an error of position, N·m/rad.
    pub kp: f64,
    /// Torque for an error of velocity, N·m·s/rad.
    pub kd: f64,
    /// Turns of the motor for one of the output.
    pub gear_ratio: f64,
    /// Torque of the output for each ampere of the motor, N·m/A.
    pub torque_per_current: f64,
}

/// The family of that name.
#[must_use]
pub fn named(name: &str) -> Option<&'static dyn Family> {
    FAMILIES.into_iter().find(|family| family.name() == name)
}

/// Why drives of these two families must not share a bus; none: they may.
#[must_use]
pub fn conflict(a: &str, b: &str) -> Option<&'static str> {
    match (a, b) {
        ("damiao", "odrive") | ("odrive", "damiao") => Some(
            "questions to Damiao's actuators have the identifier 0x7FF, which tells every ODrive to \
             enter its firmware loader",
        ),
        _ => None,
    }
}

/// The frame that begins a cycle on a bus with actuators; never sent itself.
#[must_use]
pub fn ask(bus: u8) -> Frame {
    Frame::zeroed(bus, ASK_ID, 0, false)
}

/// The identifier is that of a message between loop and translation.
#[must_use]
pub fn is_own(id: u32) -> bool {
    id & OWN_MASK == OWN_ID & OWN_MASK
}

impl Actuator {
    fn id(&self, kind: u32) -> u32 {
        OWN_ID | u32::from(self.at.node) << 2 | kind
    }

    /// What the family counts for the output's one: turns, and by their inverse torque.
    fn ratio(&self, family: &dyn Family) -> f64 {
        if family.at_motor() {
            self.gear_ratio
        } else {
            1.0
        }
    }

    /// Its frames have positions of 16 bits, not floats.
    fn counts(&self) -> bool {
        self.model.position < 1e3
    }

    /// One count of its position, rad of the output.
    fn count(&self) -> f64 {
        if self.counts() {
            2.0 * self.model.position / 65535.0
        } else {
            FINE
        }
    }

    /// Its messages as a DBC file would describe them, in the names of [`crate::cia402::signals`].
    #[must_use]
    pub fn messages(&self) -> Dbc {
        use crate::cia402::signals;
        let message = |name, kind, len, signals| {
            let mut message =
                Message::new(format!("{}_{name}", self.name), self.id(kind), 8, signals);
            (message.len, message.fd) = (len, true);
            message
        };
        let count = self.count() * self.gear_ratio;
        let float = |name, unit, bit| Signal::new(name, unit, Coding::Float32, bit, 32, 1.0);
        let state = vec![
            Signal::new(signals::MOTOR_ANGLE, "rad", Coding::Signed, 0, 32, count),
            float(signals::VELOCITY, "rad/s", 32),
            float(signals::CURRENT, "A", 64),
            Signal::new(signals::STATUS, "", Coding::Unsigned, 96, 32, 1.0),
            float(signals::TORQUE, "Nm", 128),
            float(signals::TEMPERATURE, "degC", 160),
            float(signals::VOLTAGE, "V", 192),
            Signal::new(signals::ERROR, "", Coding::Unsigned, 224, 32, 1.0),
        ];
        let position = Signal::new(signals::SET_POINT, "rad", Coding::Float64, 0, 64, 1.0);
        let word = Signal::new(signals::CONTROL, "", Coding::Unsigned, 0, 32, 1.0);
        Dbc {
            file: format!("messages of {} (node {})", self.name, self.at.node),
            messages: vec![
                message("STATE", STATE, STATE_LEN, state),
                message("COMMAND", COMMAND, 8, vec![position]),
                message("CONTROL", CONTROL, 4, vec![word]),
            ],
        }
    }

    /// `MESSAGE.signal` of a signal's name, if it has it.
    #[must_use]
    pub fn path(&self, signal: &str) -> Option<String> {
        let dbc = self.messages();
        let mut messages = dbc.messages.iter();
        let found = messages.find(|message| message.signal(signal).is_some())?;
        Some(format!("{}.{signal}", found.name))
    }
}

/// Turns a robot's messages of actuators into their frames, and back. Allocates only when it is made.
pub struct Translator {
    actuators: Vec<Live>,
    reports: Reports,
}

impl Translator {
    /// For these actuators; none: there are none.
    ///
    /// # Errors
    /// A family that there is not.
    pub fn new(actuators: &[Actuator]) -> Result<Option<Self>, Problem> {
        let live = |setting: &Actuator| {
            let family = named(setting.family).ok_or_else(|| {
                let what = format!("there is no family {:?}", setting.family);
                Problem::new(what, "a family of FAMILIES")
            })?;
            Ok(Live::new(setting, family))
        };
        let live = actuators.iter().map(live).collect::<Result<Vec<_>, _>>()?;
        let reports = Reports::new(live.len());
        Ok((!live.is_empty()).then_some(Self {
            actuators: live,
            reports,
        }))
    }

    /// What the actuators tell besides what the loop takes, in their order; another thread may look at
    /// it at any time.
    #[must_use]
    pub fn reports(&self) -> Reports {
        self.reports.clone()
    }

    /// Frames that one frame of the loop can become, at most.
    #[must_use]
    pub fn most(&self) -> usize {
        live::MOST * self.actuators.len()
    }

    /// Turns a frame with an actuator's position into that actuator's message of state; others stay as they are.
    /// Returns whether the loop is to have the frame: false for an actuator's frame without a position.
    #[must_use]
    pub fn receive(&mut self, frame: &mut Frame) -> bool {
        if is_own(frame.id) {
            // Somebody else's: without data it is no message of ours.
            frame.len = 0;
            return true;
        }
        for (index, live) in self.actuators.iter_mut().enumerate() {
            let whose = live.receive(frame);
            if !matches!(whose, Whose::Others) {
                self.reports.set(index, live.report());
                return matches!(whose, Whose::Message);
            }
        }
        true
    }

    /// Appends what leaves on the bus for a frame of the loop.
    pub fn send(&mut self, frame: &Frame, out: &mut Frames) {
        if !is_own(frame.id) {
            out.push(*frame);
            return;
        }
        for live in &mut self.actuators {
            live.send(frame, out);
        }
    }
}
