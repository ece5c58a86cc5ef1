//! ODrive, CANSimple: classic frames, little endian, floats in revolutions; it sends by itself.

use super::packing::is_finite;
use super::{Address, Family, Feedback, Model, SetPoint, State};
use crate::canopen::with_data;
use can_codec::{EXTENDED_ID, Frame};
use core::f64::consts::TAU;

/// ODrive.
#[derive(Clone, Copy, Debug)]
pub struct Odrive;

const HEARTBEAT: u32 = 0x01;
const SET_STATE: u32 = 0x07;
const ESTIMATES: u32 = 0x09;
const SET_POSITION: u32 = 0x0C;
const CLEAR: u32 = 0x18;
/// States of an axis.
const IDLE: u32 = 1;
const CLOSED_LOOP: u32 = 8;

/// The frames have floats; feed-forward of velocity and torque end at 32.767 rev/s and N·m.
const MODELS: &[Model] = &[Model {
    name: "ODrive",
    position: f64::MAX,
    velocity: 32.767 * TAU,
    torque: 32.767,
}];

fn frame(at: Address, command: u32, data: &[u8]) -> Frame {
    with_data(at.bus, u32::from(at.node) << 5 | command, data)
}

fn state(at: Address, state: u32) -> Frame {
    let mut data = [0; 8];
    data[..4].copy_from_slice(&state.to_le_bytes());
    frame(at, SET_STATE, &data)
}

/// A thousandth of a unit for each count, within 16 bits.
fn thousandths(x: f64) -> [u8; 2] {
    let count = (1000.0 * x).round_ties_even();
    (count.clamp(-32768.0, 32767.0) as i16).to_le_bytes()
}

fn float(data: &[u8; 8], first: usize) -> f64 {
    let bytes = [
        data[first],
        data[first + 1],
        data[first + 2],
        data[first + 3],
    ];
    f64::from(f32::from_le_bytes(bytes))
}

impl Family for Odrive {
    fn name(&self) -> &'static str {
        "odrive"
    }

    fn models(&self) -> &'static [Model] {
        MODELS
    }

    fn poll(&self, _: Address) -> Option<Frame> {
        None
    }

    fn command(&self, at: Address, _: &Model, s: &SetPoint) -> Option<Frame> {
        let position = (s.position / TAU) as f32;
        if !is_finite(s) || !position.is_finite() {
            return None;
        }
        let [a, b, c, d] = position.to_le_bytes();
        let [v0, v1] = thousandths(s.velocity / TAU);
        let [t0, t1] = thousandths(s.torque);
        Some(frame(at, SET_POSITION, &[a, b, c, d, v0, v1, t0, t1]))
    }

    fn enable(&self, at: Address) -> Frame {
        state(at, CLOSED_LOOP)
    }

    fn disable(&self, at: Address) -> Frame {
        state(at, IDLE)
    }

    fn clear(&self, at: Address) -> Frame {
        frame(at, CLEAR, &[0; 8])
    }

    fn feedback(&self, at: Address, _: &Model, frame: &Frame) -> Option<Feedback> {
        let data = <[u8; 8]>::try_from(frame.payload()).ok()?;
        let own = frame.bus == at.bus && frame.id & EXTENDED_ID == 0 && !frame.error;
        if !own || frame.id >> 5 != u32::from(at.node) {
            return None;
        }
        match frame.id & 0x1F {
            HEARTBEAT => {
                let error = u32::from_le_bytes([data[0], data[1], data[2], data[3]]);
                Some(Feedback {
                    state: Some(match (error, u32::from(data[4])) {
                        (0, CLOSED_LOOP) => State::Enabled,
                        (0, _) => State::Off,
                        _ => State::Fault,
                    }),
                    error: Some(error),
                    ..Feedback::default()
                })
            }
            ESTIMATES => {
                let (position, velocity) = (float(&data, 0) * TAU, float(&data, 4) * TAU);
                (position.is_finite() && velocity.is_finite()).then(|| Feedback {
                    position: Some(position),
                    velocity: Some(velocity),
                    ..Feedback::default()
                })
            }
            _ => None,
        }
    }

    fn answer(&self, at: Address, _: &Model, f: &Feedback) -> Vec<Frame> {
        let turns = |x: Option<f64>| ((x.unwrap_or(0.0) / TAU) as f32).to_le_bytes();
        let mut estimates = [0; 8];
        estimates[..4].copy_from_slice(&turns(f.position));
        estimates[4..].copy_from_slice(&turns(f.velocity));
        let mut heartbeat = [0; 8];
        heartbeat[..4].copy_from_slice(&f.error.unwrap_or(0).to_le_bytes());
        heartbeat[4] = match f.state.unwrap_or_default() {
            State::Enabled => CLOSED_LOOP as u8,
            State::Off | State::Fault => IDLE as u8,
        };
        vec![
            frame(at, ESTIMATES, &estimates),
            frame(at, HEARTBEAT, &heartbeat),
        ]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error {
            0 => "no error",
            _ => "see `axis.active_errors` in the maker's tool",
        }
    }
}
