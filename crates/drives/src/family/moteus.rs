//! moteus controllers: CAN FD, registers in subframes, little endian, floats in revolutions of the
//! output; silent unless asked.

use super::packing::is_finite;
use super::{Address, Family, Feedback, GainRanges, Identity, Model, SetPoint, State};
use can_codec::{EXTENDED_ID, Frame};
use core::f64::consts::TAU;

/// moteus.
#[derive(Clone, Copy, Debug)]
pub struct Moteus;

/// Set in an identifier of 16 bits: an answer is asked for.
const ANSWER: u32 = 0x8000;
/// Subframes: a write and a reading of one byte each, floats, and what fills a frame up.
const WRITE_BYTE: u8 = 0x01;
const WRITE_FLOATS: u8 = 0x0C;
const NOTHING: u8 = 0x50;
/// Registers.
const MODE: u32 = 0x000;
const POSITION: u32 = 0x001;
const VELOCITY: u32 = 0x002;
const TORQUE: u32 = 0x003;
const Q_CURRENT: u32 = 0x004;
const VOLTAGE: u32 = 0x00D;
const TEMPERATURE: u32 = 0x00E;
const FAULT: u32 = 0x00F;
const COMMAND: u8 = 0x20;
/// Modes.
const STOPPED: i32 = 0;
const FAULTY: i32 = 1;
/// From the begin to the end of switching on.
const STARTING: i32 = 2;
const STARTED: i32 = 4;
const POSITION_MODE: i32 = 10;
const TIMED_OUT: i32 = 11;
/// Number for its mode of time-out, which is no error of its own.
const NO_COMMAND: u32 = 256;
/// Four floats from the mode on would round it: mode as a byte, four floats, then three bytes.
const QUESTION: [u8; 7] = [
    0x11,
    MODE as u8,
    0x1C,
    4,
    POSITION as u8,
    0x13,
    VOLTAGE as u8,
];

/// The frames have floats.
const MODELS: &[Model] = &[Model {
    name: "moteus",
    position: f64::MAX,
    velocity: 1e3,
    torque: 1e3,
}];

/// Collects subframes, and fills the frame up to a length that CAN FD has.
struct Subframes {
    data: [u8; 64],
    used: usize,
}

impl Subframes {
    fn new() -> Self {
        Self {
            data: [NOTHING; 64],
            used: 0,
        }
    }

    fn push(mut self, bytes: &[u8]) -> Self {
        if let Some(to) = self.data.get_mut(self.used..self.used + bytes.len()) {
            to.copy_from_slice(bytes);
            self.used += bytes.len();
        }
        self
    }

    fn float(self, x: f64) -> Self {
        self.push(&(x as f32).to_le_bytes())
    }

    fn frame(self, bus: u8, id: u32) -> Frame {
        let lengths = [0u8, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
        let fits = |length: &u8| usize::from(*length) >= self.used;
        let length = lengths.into_iter().find(fits).unwrap_or(64);
        let mut frame = Frame::zeroed(bus, id | EXTENDED_ID, length, true);
        let used = usize::from(length);
        frame.data[..used].copy_from_slice(&self.data[..used]);
        frame
    }
}

fn to(at: Address, subframes: Subframes) -> Frame {
    let source = u32::from(at.master & 0x7F) << 8;
    subframes.frame(at.bus, ANSWER | source | u32::from(at.node))
}

/// A position command: where, how fast, torque, shares of its own gains.
fn command(at: Address, [position, velocity, torque, kp, kd]: [f64; 5]) -> Frame {
    let written = Subframes::new()
        .push(&[WRITE_BYTE, MODE as u8, POSITION_MODE as u8])
        .push(&[WRITE_FLOATS, 5, COMMAND])
        .float(position)
        .float(velocity)
        .float(torque)
        .float(kp)
        .float(kd);
    to(at, written.push(&QUESTION))
}

impl Family for Moteus {
    fn name(&self) -> &'static str {
        "moteus"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn gains(&self) -> GainRanges {
        // They are its own, set by the maker's tool.
        GainRanges {
            kp: [1e-3, 1e5],
            kd: [0.0, 1e4],
        }
    }

    fn needs_fd(&self) -> bool {
        true
    }

    fn poll(&self, at: Address) -> Option<Frame> {
        Some(to(at, Subframes::new().push(&QUESTION)))
    }

    fn identify(&self, frame: &Frame) -> Option<Identity> {
        let id = frame.id & !EXTENDED_ID;
        let node = u8::try_from(id >> 8).ok()?;
        let at = Address {
            bus: frame.bus,
            node,
            master: (id & 0x7F) as u16,
        };
        let told = self.feedback(at, &MODELS[0], frame)?;
        // Of all that has such an identifier only a moteus tells its mode like this.
        told.state?;
        Some(Identity::of(node, &told))
    }

    fn command(&self, at: Address, _: &Model, s: &SetPoint) -> Option<Frame> {
        let share = |gain: f64| f64::from(u8::from(gain != 0.0));
        let [position, velocity] = [s.position, s.velocity].map(|x| x / TAU);
        let fits = (position as f32).is_finite() && (velocity as f32).is_finite();
        let numbers = [position, velocity, s.torque, share(s.kp), share(s.kd)];
        (is_finite(s) && fits && (s.torque as f32).is_finite()).then(|| command(at, numbers))
    }

    fn enable(&self, at: Address) -> Frame {
        // A command enables it: this one without gains and torque, wherever it stands.
        command(at, [f64::NAN, 0.0, 0.0, 0.0, 0.0])
    }

    fn disable(&self, at: Address) -> Frame {
        let stop = Subframes::new().push(&[WRITE_BYTE, MODE as u8, STOPPED as u8]);
        to(at, stop.push(&QUESTION))
    }

    fn clear(&self, at: Address) -> Frame {
        self.disable(at)
    }

    fn feedback(&self, at: Address, _: &Model, frame: &Frame) -> Option<Feedback> {
        let id = u32::from(at.node) << 8 | u32::from(at.master & 0x7F);
        let own = frame.bus == at.bus && frame.id == id | EXTENDED_ID && !frame.error;
        if !own || !frame.fd {
            return None;
        }
        let mut told = Feedback::default();
        let mut mode = None;
        for (register, value) in registers(frame.payload()) {
            let finite = Some(value).filter(|x| x.is_finite());
            match register {
                MODE => mode = Some(value as i32),
                POSITION => told.position = finite.map(|x| x * TAU),
                VELOCITY => told.velocity = finite.map(|x| x * TAU),
                TORQUE => told.torque = finite,
                Q_CURRENT => told.current = finite,
                // Counts of half a volt, and of a degree.
                VOLTAGE => told.voltage = finite,
                TEMPERATURE => told.temperature = finite,
                FAULT => told.error = Some(value as u32),
                _ => {}
            }
        }
        told.state = mode.map(|mode| match mode {
            STOPPED => State::Off,
            FAULTY => State::Fault,
            POSITION_MODE => State::Enabled,
            STARTING..=STARTED => State::Busy,
            _ => State::Fault,
        });
        if mode == Some(TIMED_OUT) && told.error == Some(0) {
            told.error = Some(NO_COMMAND);
        }
        Some(told)
    }

    fn answer(&self, at: Address, _: &Model, f: &Feedback) -> Vec<Frame> {
        let mode = match f.state.unwrap_or_default() {
            State::Off => STOPPED,
            State::Enabled => POSITION_MODE,
            State::Fault => FAULTY,
            State::Busy => STARTING,
        };
        let byte = |x: Option<f64>, unit: f64| (x.unwrap_or(0.0) / unit).round() as i8 as u8;
        let told = Subframes::new()
            .push(&[0x21, MODE as u8, mode as u8])
            .push(&[0x2C, 4, POSITION as u8])
            .float(f.position.unwrap_or(0.0) / TAU)
            .float(f.velocity.unwrap_or(0.0) / TAU)
            .float(f.torque.unwrap_or(0.0))
            .float(f.current.unwrap_or(0.0))
            .push(&[
                0x23,
                VOLTAGE as u8,
                byte(f.voltage, 0.5),
                byte(f.temperature, 1.0),
            ])
            .push(&[f.error.unwrap_or(0) as u8]);
        let id = u32::from(at.node) << 8 | u32::from(at.master & 0x7F);
        vec![told.frame(at.bus, id)]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error {
            0 => "no error",
            32 => "calibration",
            33 => "motor driver",
            34 => "over-voltage",
            35 => "encoder",
            36 => "motor is not configured",
            37 => "its control loop came too late",
            38 => "power stage too hot",
            39 => "outside its limits of position",
            40 => "under-voltage",
            41 => "its configuration has changed",
            42 => "no valid angle",
            43 => "no valid position",
            44 => "driver cannot be enabled",
            45 => "its stop position is not to be used now",
            46 => "timing violation",
            NO_COMMAND => "no command came in its time",
            _ => "an error that the maker does not name",
        }
    }
}

/// Registers and values of an answer; ends at what is no reply.
fn registers(payload: &[u8]) -> impl Iterator<Item = (u32, f64)> + '_ {
    let mut rest = payload;
    let (mut left, mut register, mut kind) = (0u8, 0u32, 0u8);
    core::iter::from_fn(move || {
        while left == 0 {
            let (&code, after) = rest.split_first()?;
            rest = after;
            if code == NOTHING {
                continue;
            }
            if code & 0xF0 != 0x20 {
                rest = &[];
                return None;
            }
            kind = code >> 2 & 3;
            left = code & 3;
            if left == 0 {
                let (&many, after) = rest.split_first()?;
                (left, rest) = (many, after);
            }
            // Registers below 128, of which we ask: one byte.
            let (&first, after) = rest.split_first()?;
            (register, rest) = (u32::from(first), after);
        }
        let (value, after) = value(kind, register, rest)?;
        rest = after;
        left -= 1;
        register += 1;
        Some((register - 1, value))
    })
}

/// A value, in the unit of its register where it is counted in bytes.
fn value(kind: u8, register: u32, rest: &[u8]) -> Option<(f64, &[u8])> {
    match kind {
        0 => {
            let (&byte, after) = rest.split_first()?;
            let unit = if register == VOLTAGE { 0.5 } else { 1.0 };
            Some((f64::from(byte as i8) * unit, after))
        }
        3 => {
            let (bytes, after) = rest.split_first_chunk::<4>()?;
            Some((f64::from(f32::from_le_bytes(*bytes)), after))
        }
        _ => None,
    }
}
