//! MyActuator RMD actuators with the motion mode of protocol 4: classic frames; commands and their
//! answers are big endian, the other frames little endian. They do not tell whether they are on.

use super::packing::{Bits, count, is_finite, number, take};
use super::{Address, Family, Feedback, Identity, Model, SetPoint, State};
use crate::canopen::with_data;
use can_codec::Frame;
use core::ops::RangeInclusive;

/// MyActuator.
#[derive(Clone, Copy, Debug)]
pub struct Myactuator;

/// Identifiers less the node.
const MOTION: u32 = 0x400;
const MOTION_ANSWER: u32 = 0x500;
const OTHER: u32 = 0x140;
const OTHER_ANSWER: u32 = 0x240;
/// First bytes of the other frames.
const STATUS: u8 = 0x9A;
const SHUT_DOWN: u8 = 0x80;
const KP: f64 = 500.0;
const KD: f64 = 5.0;

const fn model(name: &'static str, torque: f64) -> Model {
    Model {
        name,
        position: 12.5,
        velocity: 45.0,
        torque,
    }
}

/// By the range of torque that firmware and manual of an actuator name.
const MODELS: &[Model] = &[model("RMD-T18", 18.0), model("RMD-T24", 24.0)];

fn other(at: Address, command: u8) -> Frame {
    let id = OTHER + u32::from(at.node);
    with_data(at.bus, id, &[command, 0, 0, 0, 0, 0, 0, 0])
}

impl Family for Myactuator {
    fn name(&self) -> &'static str {
        "myactuator"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn nodes(&self) -> RangeInclusive<u8> {
        1..=32
    }

    fn tells_whether_on(&self) -> bool {
        false
    }

    fn poll(&self, at: Address) -> Option<Frame> {
        // Temperature, voltage and errors.
        Some(other(at, STATUS))
    }

    fn identify(&self, frame: &Frame) -> Option<Identity> {
        let node = u8::try_from(frame.id.checked_sub(OTHER_ANSWER)?).ok()?;
        if !self.nodes().contains(&node) {
            return None;
        }
        let at = Address {
            bus: frame.bus,
            node,
            master: 0,
        };
        let told = self.feedback(at, &MODELS[0], frame)?;
        // Only an answer of status, which always has a voltage, identifies an actuator.
        told.voltage?;
        Some(Identity::of(node, &told))
    }

    fn polls_apart(&self) -> bool {
        true
    }

    fn idle(&self, at: Address, model: &Model) -> Option<Frame> {
        // Angles of the other frames are coarse.
        self.command(at, model, &SetPoint::default())
    }

    fn command(&self, at: Address, m: &Model, s: &SetPoint) -> Option<Frame> {
        let data = Bits::default()
            .push(count(s.position, -m.position, m.position, 16), 16)
            .push(count(s.velocity, -m.velocity, m.velocity, 12), 12)
            .push(count(s.kp, 0.0, KP, 12), 12)
            .push(count(s.kd, 0.0, KD, 12), 12)
            .push(count(s.torque, -m.torque, m.torque, 12), 12);
        let id = MOTION + u32::from(at.node);
        is_finite(s).then(|| with_data(at.bus, id, &data.bytes()))
    }

    fn enable(&self, at: Address) -> Frame {
        // A command enables it: this one without gains and torque.
        let still = SetPoint::default();
        let model = MODELS[0];
        self.command(at, &model, &still)
            .unwrap_or_else(|| other(at, STATUS))
    }

    fn disable(&self, at: Address) -> Frame {
        other(at, SHUT_DOWN)
    }

    fn clear(&self, at: Address) -> Frame {
        other(at, SHUT_DOWN)
    }

    fn feedback(&self, at: Address, m: &Model, frame: &Frame) -> Option<Feedback> {
        let data = <[u8; 8]>::try_from(frame.payload()).ok()?;
        if frame.bus != at.bus || frame.error {
            return None;
        }
        let node = u32::from(at.node);
        if frame.id == MOTION_ANSWER + node && data[0] == at.node {
            return Some(Feedback {
                position: Some(number(take(&data, 8, 16), -m.position, m.position, 16)),
                velocity: Some(number(take(&data, 24, 12), -m.velocity, m.velocity, 12)),
                torque: Some(number(take(&data, 36, 12), -m.torque, m.torque, 12)),
                ..Feedback::default()
            });
        }
        if frame.id != OTHER_ANSWER + node {
            return None;
        }
        if data[0] != STATUS {
            // An echo, as the actuator answers a shutdown too.
            return Some(Feedback::default());
        }
        let error = u32::from(u16::from_le_bytes([data[6], data[7]]));
        Some(Feedback {
            temperature: Some(f64::from(data[1] as i8)),
            voltage: Some(f64::from(u16::from_le_bytes([data[4], data[5]])) / 10.0),
            state: (error != 0).then_some(State::Fault),
            error: Some(error),
            ..Feedback::default()
        })
    }

    fn answer(&self, at: Address, m: &Model, f: &Feedback) -> Vec<Frame> {
        let position = f.position.unwrap_or(0.0);
        let velocity = f.velocity.unwrap_or(0.0);
        let motion = Bits::default()
            .push(u32::from(at.node), 8)
            .push(count(position, -m.position, m.position, 16), 16)
            .push(count(velocity, -m.velocity, m.velocity, 12), 12)
            .push(count(f.torque.unwrap_or(0.0), -m.torque, m.torque, 12), 12)
            .push(0, 16);
        let error = match f.state {
            Some(State::Fault) => f.error.unwrap_or(0),
            _ => 0,
        };
        let mut status = [STATUS, 0, 0, 0, 0, 0, 0, 0];
        status[1] = f.temperature.unwrap_or(0.0).round() as i8 as u8;
        let voltage = (10.0 * f.voltage.unwrap_or(0.0)).round() as u16;
        status[4..6].copy_from_slice(&voltage.to_le_bytes());
        status[6..].copy_from_slice(&(error as u16).to_le_bytes());
        let node = u32::from(at.node);
        vec![
            with_data(at.bus, MOTION_ANSWER + node, &motion.bytes()),
            with_data(at.bus, OTHER_ANSWER + node, &status),
        ]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error & error.wrapping_neg() {
            0 => "no error",
            0x2 => "motor is blocked",
            0x4 => "under-voltage",
            0x8 => "over-voltage",
            0x10 => "over-current",
            0x40 => "too much power",
            0x80 => "parameters of its calibration cannot be written",
            0x100 => "too fast",
            0x800 => "power stage too hot",
            0x1000 => "motor too hot",
            0x2000 => "calibration of its encoder",
            0x4000 => "encoder",
            _ => "an error that the maker does not name",
        }
    }
}
