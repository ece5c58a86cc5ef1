//! CubeMars AK actuators in MIT mode: classic frames, big endian, silent unless asked. They do not tell
//! whether they are on.

use super::packing::{Bits, count, is_finite, number, take};
use super::{Address, Family, Feedback, Model, SetPoint, State};
use crate::canopen::with_data;
use can_codec::Frame;

/// CubeMars.
#[derive(Clone, Copy, Debug)]
pub struct Cubemars;

/// Ends of the ranges of the gains.
const KP: f64 = 500.0;
const KD: f64 = 5.0;
/// One below the greatest count, as of Damiao: no command is a word.
const LARGEST_KP: u32 = 0xFFE;

const fn model(name: &'static str, velocity: f64, torque: f64) -> Model {
    Model {
        name,
        position: 12.5,
        velocity,
        torque,
    }
}

/// The maker's table of the MIT mode.
const MODELS: &[Model] = &[
    model("AK10-9", 50.0, 65.0),
    model("AK70-10", 50.0, 25.0),
    model("AK80-6", 76.0, 12.0),
    model("AK80-9", 50.0, 18.0),
    model("AK80-64", 8.0, 144.0),
];

fn word(at: Address, last: u8) -> Frame {
    let data = [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, last];
    with_data(at.bus, u32::from(at.node), &data)
}

impl Family for Cubemars {
    fn name(&self) -> &'static str {
        "cubemars"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn usual_reply(&self, node: u8) -> u16 {
        u16::from(node)
    }

    fn tells_whether_on(&self) -> bool {
        false
    }

    fn poll(&self, _: Address) -> Option<Frame> {
        // It has no question but a command.
        None
    }

    fn idle(&self, at: Address, model: &Model) -> Option<Frame> {
        self.command(at, model, &SetPoint::default())
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
        // Leaving the mode does: it has no word of its own for it.
        word(at, 0xFD)
    }

    fn feedback(&self, at: Address, m: &Model, frame: &Frame) -> Option<Feedback> {
        // Six bytes of older firmware, temperature and error of newer.
        let payload = frame.payload();
        let mut data = [0; 8];
        let whole = matches!(payload.len(), 6 | 8);
        data.get_mut(..payload.len())?.copy_from_slice(payload);
        // Firmware of the first series answers to 0.
        let from = frame.id == u32::from(at.master) || frame.id == 0;
        let own = frame.bus == at.bus && from && !frame.error && !frame.fd;
        if !own || !whole || data[0] != at.node {
            return None;
        }
        let error = u32::from(data[7]);
        Some(Feedback {
            position: Some(number(take(&data, 8, 16), -m.position, m.position, 16)),
            velocity: Some(number(take(&data, 24, 12), -m.velocity, m.velocity, 12)),
            torque: Some(number(take(&data, 36, 12), -m.torque, m.torque, 12)),
            temperature: (payload.len() == 8).then(|| f64::from(data[6] as i8)),
            state: (error != 0).then_some(State::Fault),
            error: Some(error),
            ..Feedback::default()
        })
    }

    fn answer(&self, at: Address, m: &Model, f: &Feedback) -> Vec<Frame> {
        let temperature = f.temperature.unwrap_or(0.0).round() as i8;
        let error = match f.state {
            Some(State::Fault) => f.error.unwrap_or(0),
            _ => 0,
        };
        let position = f.position.unwrap_or(0.0);
        let velocity = f.velocity.unwrap_or(0.0);
        let data = Bits::default()
            .push(u32::from(at.node), 8)
            .push(count(position, -m.position, m.position, 16), 16)
            .push(count(velocity, -m.velocity, m.velocity, 12), 12)
            .push(count(f.torque.unwrap_or(0.0), -m.torque, m.torque, 12), 12)
            .push(u32::from(temperature as u8), 8)
            .push(error & 0xFF, 8);
        vec![with_data(at.bus, u32::from(at.master), &data.bytes())]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error {
            0 => "no error",
            1 => "motor too hot",
            2 => "over-current",
            3 => "over-voltage",
            4 => "under-voltage",
            5 => "encoder",
            6 => "power stage too hot",
            7 => "motor is blocked",
            _ => "an error that the maker does not name",
        }
    }
}
