//! moteus, by its register protocol (mjbots/moteus, docs/protocol/can.md and registers.md): subframes that write and read
//! registers in one of four resolutions.

use super::actuator::{Actuator, Trouble};
use super::motor::Motor;
use super::wire::Wire;
use can_codec::{EXTENDED_ID, Frame};
use std::f64::consts::TAU;

/// Registers.
const MODE: u32 = 0x000;
const POSITION: u32 = 0x001;
const VELOCITY: u32 = 0x002;
const TORQUE: u32 = 0x003;
const Q_CURRENT: u32 = 0x004;
const D_CURRENT: u32 = 0x005;
const VOLTAGE: u32 = 0x00D;
const TEMPERATURE: u32 = 0x00E;
const FAULT: u32 = 0x00F;
const COMMAND: u32 = 0x020;
const LAST_COMMAND: u32 = 0x024;
/// Modes.
const STOPPED: f64 = 0.0;
const FAULTY: f64 = 1.0;
const POSITION_MODE: f64 = 10.0;
const TIMED_OUT: f64 = 11.0;
/// In the source of an identifier: an answer is asked for.
const ANSWER: u32 = 0x80;
const NOTHING: u8 = 0x50;

/// Resolutions, as subframes number them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Resolution {
    Byte,
    Word,
    Long,
    Float,
}

impl Resolution {
    fn of(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::Byte,
            1 => Self::Word,
            2 => Self::Long,
            _ => Self::Float,
        }
    }

    fn len(self) -> usize {
        match self {
            Self::Byte => 1,
            Self::Word => 2,
            Self::Long | Self::Float => 4,
        }
    }

    /// One count of a register, in the register's unit.
    fn count(self, register: u32) -> f64 {
        let [byte, word, long] = match register {
            POSITION | COMMAND => [0.01, 1e-4, 1e-5],
            VELOCITY | 0x021 => [0.1, 2.5e-4, 1e-5],
            TORQUE | 0x022 | 0x025 => [0.5, 0.01, 1e-3],
            Q_CURRENT | D_CURRENT => [1.0, 0.1, 1e-3],
            VOLTAGE => [0.5, 0.1, 1e-3],
            TEMPERATURE => [1.0, 0.1, 1e-3],
            0x023 | 0x024 => [1.0 / 127.0, 1.0 / 32767.0, 1.0 / 2_147_483_647.0],
            _ => [1.0; 3],
        };
        match self {
            Self::Byte => byte,
            Self::Word => word,
            Self::Long => long,
            Self::Float => 1.0,
        }
    }

    /// The value of these bytes; the least integer is "not a number".
    fn value(self, register: u32, bytes: &[u8]) -> f64 {
        let mut all = [0; 4];
        all[..bytes.len()].copy_from_slice(bytes);
        let long = i32::from_le_bytes(all);
        let (count, least) = match self {
            Self::Byte => (i32::from(all[0].cast_signed()), i32::from(i8::MIN)),
            Self::Word => (i32::from(long as i16), i32::from(i16::MIN)),
            Self::Long => (long, i32::MIN),
            Self::Float => return f64::from(f32::from_le_bytes(all)),
        };
        if count == least {
            f64::NAN
        } else {
            f64::from(count) * self.count(register)
        }
    }

    /// The bytes of a value.
    fn bytes(self, register: u32, value: f64) -> [u8; 4] {
        let most = match self {
            Self::Byte => f64::from(i8::MAX),
            Self::Word => f64::from(i16::MAX),
            Self::Long => f64::from(i32::MAX),
            Self::Float => return (value as f32).to_le_bytes(),
        };
        let counts = (value / self.count(register)).round().clamp(-most, most);
        (counts as i32).to_le_bytes()
    }
}

/// Bytes that are read one after the other.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }

    /// A number of seven bits in each byte, the lowest first.
    fn number(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..28).step_by(7) {
            let &[byte] = self.take(1)? else {
                return None;
            };
            value |= u32::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Registers of a command: mode, then position, velocity, torque and shares of both gains.
struct Written {
    mode: Option<f64>,
    command: [f64; 5],
}

pub(super) fn hear(
    actuator: &mut Actuator,
    frame: &Frame,
    wire: &mut Wire<'_>,
    motor: &mut Motor<'_>,
) -> bool {
    let id = frame.id & !EXTENDED_ID;
    let (source, destination) = (id >> 8, id & 0xFF);
    if destination != u32::from(actuator.node) || source > 0xFF {
        return false;
    }
    // Of what is not written position and velocity are "not a number" and 0, shares are whole.
    let mut written = Written {
        mode: None,
        command: [f64::NAN, 0.0, 0.0, 1.0, 1.0],
    };
    let mut answer = Vec::with_capacity(64);
    let mut reader = Reader(frame.payload());
    let mut asked = [(Resolution::Byte, 0, 0); 8];
    let mut count = 0;
    while let Some(&[kind]) = reader.take(1) {
        if kind == NOTHING {
            continue;
        }
        let resolution = Resolution::of(kind >> 2);
        let length = match kind & 3 {
            0 => reader.number(),
            short => Some(u32::from(short)),
        };
        let (Some(length @ 0..=64), Some(first)) = (length, reader.number()) else {
            break;
        };
        let registers = first..first.saturating_add(length);
        match kind >> 4 {
            0 => write(registers, resolution, &mut reader, &mut written),
            1 if count < asked.len() => {
                asked[count] = (resolution, first, length);
                count += 1;
            }
            _ => break,
        }
    }
    act(&written, actuator, wire.now, motor);
    for (resolution, first, length) in asked.into_iter().take(count) {
        answer.extend([0x20 | (resolution as u8) << 2, length as u8, first as u8]);
        for register in first..first + length {
            let value = read(register, actuator, motor);
            let bytes = resolution.bytes(register, value);
            answer.extend_from_slice(&bytes[..resolution.len()]);
        }
    }
    if source & ANSWER != 0 {
        send(&mut answer, source & 0x7F, actuator.node, wire);
    }
    true
}

fn send(answer: &mut Vec<u8>, to: u32, node: u8, wire: &mut Wire<'_>) {
    const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
    let fits = |len: &usize| *len >= answer.len();
    let len = LENGTHS.into_iter().find(fits).unwrap_or(64);
    answer.resize(len, NOTHING);
    wire.send_frame(u32::from(node) << 8 | to | EXTENDED_ID, answer, true);
}

fn write(
    registers: std::ops::Range<u32>,
    resolution: Resolution,
    reader: &mut Reader<'_>,
    written: &mut Written,
) {
    for register in registers {
        let Some(bytes) = reader.take(resolution.len()) else {
            return;
        };
        let value = resolution.value(register, bytes);
        match register {
            MODE => written.mode = Some(value),
            COMMAND..=LAST_COMMAND => {
                written.command[(register - COMMAND) as usize] = value;
            }
            _ => {}
        }
    }
}

/// Does what was written: a command of position mode enables it.
fn act(written: &Written, actuator: &mut Actuator, now: u64, motor: &mut Motor<'_>) {
    let Some(mode) = written.mode else {
        return;
    };
    if mode == STOPPED {
        actuator.disable(motor);
        actuator.clear(motor);
    } else if mode == POSITION_MODE {
        if !actuator.is_on() {
            actuator.enable(now, motor);
        }
        let [position, velocity, torque, kp, kd] = written.command;
        let [own_kp, own_kd] = actuator.sheet.gains;
        let [here, ..] = motor.output();
        // Without a position it is held where it is.
        let target = if position.is_finite() {
            position * TAU
        } else {
            here
        };
        let velocity = if velocity.is_finite() {
            velocity * TAU
        } else {
            0.0
        };
        let shares = [kp * own_kp, kd * own_kd];
        let command = [target, velocity, torque, shares[0], shares[1]];
        actuator.follow(command, now, motor);
    }
}

fn read(register: u32, actuator: &Actuator, motor: &mut Motor<'_>) -> f64 {
    let [position, velocity, torque] = motor.output();
    let reading = motor.reading();
    let trouble = actuator.trouble(motor);
    match register {
        MODE => match trouble {
            Some(Trouble::NoCommand) => TIMED_OUT,
            Some(Trouble::Drive(_)) => FAULTY,
            None if actuator.is_on() => POSITION_MODE,
            None => STOPPED,
        },
        POSITION => position / TAU,
        VELOCITY => velocity / TAU,
        TORQUE => torque,
        Q_CURRENT => motor.mounted.motor.direction * reading.current,
        VOLTAGE => reading.report.voltage,
        TEMPERATURE => reading.report.temperature,
        // 33: encoder; 34: motor driver; 39: over-temperature.
        FAULT => match trouble {
            Some(Trouble::Drive(2)) => 39.0,
            Some(Trouble::Drive(3)) => 33.0,
            Some(Trouble::Drive(_)) => 34.0,
            _ => 0.0,
        },
        _ => 0.0,
    }
}
