//! Damiao actuators in MIT mode: classic frames, big endian, silent unless asked.

use super::packing::{Bits, count, is_finite, number, take};
use super::{Address, Family, Feedback, Identity, Model, SetPoint, State};
use crate::canopen::with_data;
use can_codec::Frame;

/// Damiao.
#[derive(Clone, Copy, Debug)]
pub struct Damiao;

/// Identifier of questions and settings, of all actuators of a bus.
const REGISTERS: u32 = 0x7FF;
const REFRESH: u8 = 0xCC;
const READ: u8 = 0x33;
/// Register: the identifier to which it answers.
const REPLY: u8 = 7;
/// Registers that tell who it is: number, name, and whether it is a float.
const TOLD: [(u8, &str, bool); 7] = [
    (REPLY, "reply_id", false),
    (9, "time_out_50us", false),
    (10, "mode", false),
    (14, "firmware", false),
    (21, "position_range_rad", true),
    (22, "velocity_range_rad_per_s", true),
    (23, "torque_range_Nm", true),
];
/// Ends of the ranges of the gains.
const KP: f64 = 500.0;
const KD: f64 = 5.0;
/// One below the greatest count: a command at every end of its ranges begins with seven bytes FF, and
/// would be a word that enables, disables or sets the zero.
const LARGEST_KP: u32 = 0xFFE;

const fn model(name: &'static str, velocity: f64, torque: f64) -> Model {
    Model {
        name,
        position: 12.5,
        velocity,
        torque,
    }
}

/// Registers 21 to 23 as the maker sets them.
const MODELS: &[Model] = &[
    model("DM4310", 30.0, 10.0),
    model("DM4310P", 50.0, 10.0),
    model("DM4340", 10.0, 28.0),
    model("DM8009", 45.0, 54.0),
    model("DM10010L", 25.0, 200.0),
];

/// A word that is no command: seven bytes FF, which as a command would be beyond every end.
fn word(at: Address, last: u8) -> Frame {
    let data = [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, last];
    with_data(at.bus, u32::from(at.node), &data)
}

impl Family for Damiao {
    fn name(&self) -> &'static str {
        "damiao"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn usual_reply(&self, node: u8) -> u16 {
        u16::from(node) + 0x10
    }

    fn poll(&self, at: Address) -> Option<Frame> {
        let data = [at.node, 0, REFRESH, 0, 0, 0, 0, 0];
        Some(with_data(at.bus, REGISTERS, &data))
    }

    fn questions(&self, at: Address) -> Vec<Frame> {
        let read = |&(register, ..): &(u8, &str, bool)| {
            let data = [at.node, 0, READ, register, 0, 0, 0, 0];
            with_data(at.bus, REGISTERS, &data)
        };
        TOLD.iter().map(read).collect()
    }

    fn identify(&self, frame: &Frame) -> Option<Identity> {
        let &[node, 0, READ, register, a, b, c, d] = frame.payload() else {
            return None;
        };
        // A question has the identifier of all, an answer never.
        let answers = frame.id < REGISTERS && !frame.error && (1..=127).contains(&node);
        let told = TOLD.iter().find(|(number, ..)| *number == register);
        let (_, name, is_float) = told.filter(|_| answers)?;
        let value = [a, b, c, d];
        let text = if *is_float {
            f32::from_le_bytes(value).to_string()
        } else {
            u32::from_le_bytes(value).to_string()
        };
        Some(Identity {
            node,
            reply: Some(frame.id as u16),
            facts: vec![(*name, text)],
            ..Identity::default()
        })
    }

    fn command(&self, at: Address, m: &Model, s: &SetPoint) -> Option<Frame> {
        let data = Bits::default()
            .push(count(s.position, -m.position, m.position, 16), 16)
            .push(count(s.velocity, -m.velocity, m.velocity, 12), 12)
            .push(count(s.kp, 0.0, KP, 12).min(LARGEST_KP), 12)
            .push(count(s.kd, 0.0, KD, 12), 12)
            .push(count(s.torque, -m.torque, m.torque, 12), 12);
        is_finite(s).then(|| with_data(at.bus, u32::from(at.node), &data.bytes()))
    }

    fn enable(&self, at: Address) -> Frame {
        word(at, 0xFC)
    }

    fn disable(&self, at: Address) -> Frame {
        word(at, 0xFD)
    }

    fn clear(&self, at: Address) -> Frame {
        word(at, 0xFB)
    }

    fn feedback(&self, at: Address, m: &Model, frame: &Frame) -> Option<Feedback> {
        let data = <[u8; 8]>::try_from(frame.payload()).ok()?;
        let own = frame.bus == at.bus && frame.id == u32::from(at.master) && !frame.error;
        if !own || data[0] & 0xF != at.node & 0xF {
            return None;
        }
        let error = u32::from(data[0] >> 4);
        Some(Feedback {
            position: Some(number(take(&data, 8, 16), -m.position, m.position, 16)),
            velocity: Some(number(take(&data, 24, 12), -m.velocity, m.velocity, 12)),
            torque: Some(number(take(&data, 36, 12), -m.torque, m.torque, 12)),
            temperature: Some(f64::from(data[7])),
            state: Some(match error {
                0 => State::Off,
                1 => State::Enabled,
                _ => State::Fault,
            }),
            error: Some(if error < 2 { 0 } else { error }),
            ..Feedback::default()
        })
    }

    fn answer(&self, at: Address, m: &Model, f: &Feedback) -> Vec<Frame> {
        let state = match f.state.unwrap_or_default() {
            State::Off | State::Busy => 0,
            State::Enabled => 1,
            State::Fault => f.error.unwrap_or(8) & 0xF,
        };
        let temperature = f.temperature.unwrap_or(0.0).round() as u8;
        let data = Bits::default()
            .push(state, 4)
            .push(u32::from(at.node & 0xF), 4)
            .push(
                count(f.position.unwrap_or(0.0), -m.position, m.position, 16),
                16,
            )
            .push(
                count(f.velocity.unwrap_or(0.0), -m.velocity, m.velocity, 12),
                12,
            )
            .push(count(f.torque.unwrap_or(0.0), -m.torque, m.torque, 12), 12)
            .push(u32::from(temperature), 8)
            .push(u32::from(temperature), 8);
        vec![with_data(at.bus, u32::from(at.master), &data.bytes())]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error {
            0 | 1 => "no error",
            0x8 => "over-voltage",
            0x9 => "under-voltage",
            0xA => "over-current",
            0xB => "power stage too hot",
            0xC => "winding too hot",
            0xD => "no command came in its time",
            0xE => "overload",
            _ => "an error that the maker does not name",
        }
    }
}
