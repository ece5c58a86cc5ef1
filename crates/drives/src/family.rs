//! Actuators that are commanded by one frame of position, velocity, torque and gains, or less: a file
//! for each family, a row of data for each of its models.
//!
//! To add a family, implement [`Family`] in a file of its own and add it to [`FAMILIES`]; the tests of
//! all families then hold for it too. To add a model, add a row to its family's `MODELS`.

mod cubemars;
mod damiao;
mod moteus;
mod myactuator;
mod odrive;
mod packing;
mod robstride;
pub mod translation;

use can_codec::Frame;
use core::ops::RangeInclusive;

pub use cubemars::Cubemars;
pub use damiao::Damiao;
pub use moteus::Moteus;
pub use myactuator::Myactuator;
pub use odrive::Odrive;
pub use robstride::Robstride;

/// All families.
pub const FAMILIES: [&dyn Family; 6] = [
    &Cubemars,
    &Damiao,
    &Moteus,
    &Myactuator,
    &Odrive,
    &Robstride,
];

/// An actuator on its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// Index of the bus.
    pub bus: u8,
    /// Its identifier.
    pub node: u8,
    /// The identifier to which it answers, where its family has one.
    pub master: u16,
}

/// A model, by the ranges of its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Name.
    pub name: &'static str,
    /// Position at either end of its range, rad.
    pub position: f64,
    /// Velocity at either end of its range, rad/s.
    pub velocity: f64,
    /// Torque at either end of its range, N·m.
    pub torque: f64,
}

/// A command, of the actuator's output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SetPoint {
    /// Position, rad.
    pub position: f64,
    /// Velocity, rad/s.
    pub velocity: f64,
    /// Torque besides that of the gains, N·m.
    pub torque: f64,
    /// Torque for an error of position, N·m/rad.
    pub kp: f64,
    /// Torque for an error of velocity, N·m·s/rad.
    pub kd: f64,
}

/// What an actuator does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// No torque.
    #[default]
    Off,
    /// It follows commands.
    Enabled,
    /// An error of its own; no torque.
    Fault,
    /// Something of its own that may move it: a calibration, a search for its index.
    Busy,
}

/// Gains that a family's frames hold, where it counts its positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainRanges {
    /// Least and greatest torque for an error of position, N·m/rad.
    pub kp: [f64; 2],
    /// Least and greatest torque for an error of velocity, N·m·s/rad.
    pub kd: [f64; 2],
}

/// What an actuator has told so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heard {
    /// Its position.
    pub position: bool,
    /// Its current.
    pub current: bool,
    /// Its state.
    pub state: bool,
}

/// Frames that are sent in a row; none: fewer are needed.
pub type Sequence = [Option<Frame>; 4];

/// What a frame of an actuator tells; none: the frame does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Feedback {
    /// Position, rad.
    pub position: Option<f64>,
    /// Velocity, rad/s.
    pub velocity: Option<f64>,
    /// Torque by its own estimate, N·m.
    pub torque: Option<f64>,
    /// Current of its motor that makes torque, A.
    pub current: Option<f64>,
    /// Temperature of its winding or, where only one is sent, of the actuator, °C.
    pub temperature: Option<f64>,
    /// Voltage of its supply, V.
    pub voltage: Option<f64>,
    /// State.
    pub state: Option<State>,
    /// Its error's number; 0: none.
    pub error: Option<u32>,
}

/// What an actuator says of itself when it is asked who it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identity {
    /// Its identifier.
    pub node: u8,
    /// The identifier to which it answers, where it told it.
    pub reply: Option<u16>,
    /// State.
    pub state: Option<State>,
    /// Its error's number; 0: none.
    pub error: Option<u32>,
    /// What else it tells: names and values with units.
    pub facts: Vec<(&'static str, String)>,
}

impl Identity {
    /// State, error and numbers of a feedback.
    fn of(node: u8, told: &Feedback) -> Self {
        let all = [
            ("position_rad", told.position),
            ("velocity_rad_per_s", told.velocity),
            ("torque_Nm", told.torque),
            ("current_A", told.current),
            ("temperature_C", told.temperature),
            ("voltage_V", told.voltage),
        ];
        let known = all.into_iter().filter_map(|(name, x)| Some((name, x?)));
        Self {
            node,
            reply: None,
            state: told.state,
            error: told.error,
            facts: known.map(|(name, x)| (name, format!("{x:.4}"))).collect(),
        }
    }
}

/// A family of actuators.
pub trait Family: Sync {
    /// Name, as a configuration has it.
    fn name(&self) -> &'static str;

    /// Its models.
    fn models(&self) -> &'static [Model];

    /// The identifier to which an actuator answers as makers and users set it; 0 where its family has
    /// none.
    fn usual_reply(&self, _node: u8) -> u16 {
        0
    }

    /// Identifiers that its actuators can have.
    fn nodes(&self) -> RangeInclusive<u8> {
        1..=127
    }

    /// Position, velocity, torque and gains are those of the motor before the gear, not of the output.
    fn at_motor(&self) -> bool {
        false
    }

    /// The gains that it can be given.
    fn gains(&self) -> GainRanges {
        GainRanges {
            kp: [0.1, 500.0],
            kd: [0.0, 5.0],
        }
    }

    /// Its frames are those of CAN FD.
    fn needs_fd(&self) -> bool {
        false
    }

    /// It tells whether it is on; otherwise it counts as on once it has been enabled, answers and has
    /// no error.
    fn tells_whether_on(&self) -> bool {
        true
    }

    /// What [`poll`](Self::poll) asks for is told by no other answer: it is asked now and then.
    fn polls_apart(&self) -> bool {
        false
    }

    /// It tells state and current in frames of their own, at rates of their own.
    fn tells_apart(&self) -> bool {
        false
    }

    /// Its gains are in each command: one without a gain for position bears a joint whose position is not known.
    fn commands_gains(&self) -> bool {
        true
    }

    /// What to do where it has not told all that is needed.
    fn cure(&self, _heard: Heard) -> &'static str {
        "no answer: supply, wiring, bit rate, `node` and `reply_id`"
    }

    /// Frames that are sent before the one that enables: mode, gains, the position where it stands as
    /// its target. None of them can move an actuator that is off.
    fn prepare(&self, _at: Address, _model: &Model, _hold: &SetPoint) -> Sequence {
        [None; 4]
    }

    /// A frame that asks for an answer, and cannot move anything: none where the actuator sends by
    /// itself.
    fn poll(&self, at: Address) -> Option<Frame>;

    /// Frames that ask an actuator who it is, the first whether it is there; none of them can move it,
    /// whatever it does. None where there is no such question.
    fn questions(&self, at: Address) -> Vec<Frame> {
        self.poll(at).into_iter().collect()
    }

    /// What a frame of that bus tells of the actuator that sent it; none if the frame is no answer to
    /// these questions.
    fn identify(&self, _frame: &Frame) -> Option<Identity> {
        None
    }

    /// The frame that it is sent in each cycle while it is off, so that it answers with its state, and
    /// that cannot make torque; none where the actuator sends by itself.
    fn idle(&self, at: Address, _model: &Model) -> Option<Frame> {
        self.poll(at)
    }

    /// The frame of a command; none if a number in it is not finite. What the family has no field for
    /// is left out, what lies beyond a range is limited.
    fn command(&self, at: Address, model: &Model, set_point: &SetPoint) -> Option<Frame>;

    /// The frame after which it follows commands.
    fn enable(&self, at: Address) -> Frame;

    /// The frame after which it makes no torque.
    fn disable(&self, at: Address) -> Frame;

    /// The frame that clears its error.
    fn clear(&self, at: Address) -> Frame;

    /// What a frame of the bus tells of the actuator; none if it is not from it.
    fn feedback(&self, at: Address, model: &Model, frame: &Frame) -> Option<Feedback>;

    /// The frames that an actuator in that condition sends: what a simulated one is made of.
    fn answer(&self, at: Address, model: &Model, feedback: &Feedback) -> Vec<Frame>;

    /// An error's number in words.
    fn error_text(&self, error: u32) -> &'static str;
}
