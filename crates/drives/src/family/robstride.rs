//! RobStride and CyberGear actuators, private protocol: identifiers of 29 bits that carry values.

use super::packing::{Bits, count, is_finite, number, take};
use super::{Address, Family, Feedback, Identity, Model, SetPoint, State};
use can_codec::{EXTENDED_ID, Frame};
use core::f64::consts::PI;

/// RobStride.
#[derive(Clone, Copy, Debug)]
pub struct Robstride;

const MOTION: u32 = 1;
const FEEDBACK: u32 = 2;
const ENABLE: u32 = 3;
const STOP: u32 = 4;
const READ: u32 = 17;
/// Parameter: position of the output.
const POSITION: u16 = 0x7019;
const KP: f64 = 500.0;
const KD: f64 = 5.0;

const fn model(name: &'static str, velocity: f64, torque: f64) -> Model {
    Model {
        name,
        position: 4.0 * PI,
        velocity,
        torque,
    }
}

const MODELS: &[Model] = &[model("RS02", 44.0, 17.0), model("RS04", 15.0, 120.0)];

fn frame(at: Address, kind: u32, middle: u32, data: [u8; 8]) -> Frame {
    let id = kind << 24 | (middle & 0xFFFF) << 8 | u32::from(at.node);
    let mut frame = Frame::zeroed(at.bus, id | EXTENDED_ID, 8, false);
    frame.data[..8].copy_from_slice(&data);
    frame
}

impl Family for Robstride {
    fn name(&self) -> &'static str {
        "robstride"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn usual_reply(&self, _node: u8) -> u16 {
        0xFD
    }

    fn poll(&self, at: Address) -> Option<Frame> {
        let [low, high] = POSITION.to_le_bytes();
        Some(frame(
            at,
            READ,
            u32::from(at.master),
            [low, high, 0, 0, 0, 0, 0, 0],
        ))
    }

    fn identify(&self, frame: &Frame) -> Option<Identity> {
        let id = frame.id & !EXTENDED_ID;
        let &[low, high, 0, 0, a, b, c, d] = frame.payload() else {
            return None;
        };
        let is_answer = frame.id & EXTENDED_ID != 0 && !frame.error && id >> 24 == READ;
        // Of a question the lowest byte is the actuator, of an answer the host.
        let (node, host) = ((id >> 8) as u8, id & 0xFF);
        let is_ours = host == u32::from(self.usual_reply(node)) && (1..=127).contains(&node);
        if !is_answer || !is_ours || u16::from_le_bytes([low, high]) != POSITION {
            return None;
        }
        let position = f32::from_le_bytes([a, b, c, d]);
        Some(Identity {
            node,
            reply: Some(host as u16),
            facts: vec![("position_rad", format!("{position:.4}"))],
            ..Identity::default()
        })
    }

    fn idle(&self, at: Address, model: &Model) -> Option<Frame> {
        // The answer to a question has one parameter and no state; that to a command has all.
        self.command(at, model, &SetPoint::default())
    }

    fn command(&self, at: Address, m: &Model, s: &SetPoint) -> Option<Frame> {
        let torque = count(s.torque, -m.torque, m.torque, 16);
        let data = Bits::default()
            .push(count(s.position, -m.position, m.position, 16), 16)
            .push(count(s.velocity, -m.velocity, m.velocity, 16), 16)
            .push(count(s.kp, 0.0, KP, 16), 16)
            .push(count(s.kd, 0.0, KD, 16), 16);
        is_finite(s).then(|| frame(at, MOTION, torque, data.bytes()))
    }

    fn enable(&self, at: Address) -> Frame {
        frame(at, ENABLE, u32::from(at.master), [0; 8])
    }

    fn disable(&self, at: Address) -> Frame {
        frame(at, STOP, u32::from(at.master), [0; 8])
    }

    fn clear(&self, at: Address) -> Frame {
        frame(at, STOP, u32::from(at.master), [1, 0, 0, 0, 0, 0, 0, 0])
    }

    fn feedback(&self, at: Address, m: &Model, frame: &Frame) -> Option<Feedback> {
        let data = <[u8; 8]>::try_from(frame.payload()).ok()?;
        let id = frame.id & !EXTENDED_ID;
        let own = frame.bus == at.bus && frame.id & EXTENDED_ID != 0 && !frame.error;
        let from = id >> 8 & 0xFF == u32::from(at.node) && id & 0xFF == u32::from(at.master & 0xFF);
        if !own || !from || id >> 24 != FEEDBACK {
            return None;
        }
        let error = id >> 16 & 0x3F;
        Some(Feedback {
            position: Some(number(take(&data, 0, 16), -m.position, m.position, 16)),
            velocity: Some(number(take(&data, 16, 16), -m.velocity, m.velocity, 16)),
            torque: Some(number(take(&data, 32, 16), -m.torque, m.torque, 16)),
            temperature: Some(f64::from(take(&data, 48, 16)) / 10.0),
            state: Some(match (error, id >> 22 & 3) {
                (0, 2) => State::Enabled,
                (0, _) => State::Off,
                _ => State::Fault,
            }),
            error: Some(error),
            ..Feedback::default()
        })
    }

    fn answer(&self, at: Address, m: &Model, f: &Feedback) -> Vec<Frame> {
        let mode = match f.state.unwrap_or_default() {
            State::Enabled => 2,
            State::Off | State::Fault | State::Busy => 0,
        };
        let error = f.error.unwrap_or(0) & 0x3F;
        let temperature = (f.temperature.unwrap_or(0.0) * 10.0).round().max(0.0) as u32;
        let data = Bits::default()
            .push(
                count(f.position.unwrap_or(0.0), -m.position, m.position, 16),
                16,
            )
            .push(
                count(f.velocity.unwrap_or(0.0), -m.velocity, m.velocity, 16),
                16,
            )
            .push(count(f.torque.unwrap_or(0.0), -m.torque, m.torque, 16), 16)
            .push(temperature & 0xFFFF, 16);
        let middle = mode << 14 | error << 8 | u32::from(at.node);
        let mut frame = frame(at, FEEDBACK, middle, data.bytes());
        frame.id = frame.id & !0xFF | u32::from(at.master & 0xFF);
        vec![frame]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error & error.wrapping_neg() {
            0 => "no error",
            0x01 => "under-voltage",
            0x02 => "over-current",
            0x04 => "too hot",
            0x08 => "magnetic encoder",
            0x10 => "Hall encoder",
            0x20 => "not calibrated",
            _ => "an error that the maker does not name",
        }
    }
}
