//! ODrive, CANSimple: classic frames, little endian, floats in revolutions of the motor; it sends by
//! itself, each kind of frame at a rate of its own.

use super::packing::is_finite;
use super::{
    Address, Family, Feedback, GainRanges, Heard, Identity, Model, Sequence, SetPoint, State,
};
use crate::canopen::with_data;
use can_codec::{EXTENDED_ID, Frame};
use core::f64::consts::TAU;
use core::ops::RangeInclusive;

/// ODrive.
#[derive(Clone, Copy, Debug)]
pub struct Odrive;

const HEARTBEAT: u32 = 0x01;
const ERRORS: u32 = 0x03;
const SET_STATE: u32 = 0x07;
const ESTIMATES: u32 = 0x09;
const SET_MODE: u32 = 0x0B;
const SET_POSITION: u32 = 0x0C;
const CURRENTS: u32 = 0x14;
const TEMPERATURES: u32 = 0x15;
const SUPPLY: u32 = 0x17;
const CLEAR: u32 = 0x18;
const TORQUES: u32 = 0x1C;
const POWERS: u32 = 0x1D;
const SET_POSITION_GAIN: u32 = 0x1A;
const SET_VELOCITY_GAINS: u32 = 0x1B;
/// States of an axis.
const UNDEFINED: u32 = 0;
const IDLE: u32 = 1;
const CLOSED_LOOP: u32 = 8;
const LAST_STATE: u8 = 14;
/// Positions are controlled, and a target is taken as it is.
const POSITION_CONTROL: u32 = 3;
const PASS_THROUGH: u32 = 1;

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
    two(at, SET_STATE, state.to_le_bytes(), [0; 4])
}

fn two(at: Address, command: u32, first: [u8; 4], second: [u8; 4]) -> Frame {
    let mut data = [0; 8];
    data[..4].copy_from_slice(&first);
    data[4..].copy_from_slice(&second);
    frame(at, command, &data)
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

    fn nodes(&self) -> RangeInclusive<u8> {
        // 63 is all of them.
        0..=62
    }

    fn at_motor(&self) -> bool {
        true
    }

    fn gains(&self) -> GainRanges {
        // Its gain of position is the ratio of the two.
        GainRanges {
            kp: [1e-4, 1e4],
            kd: [1e-5, 1e3],
        }
    }

    fn tells_apart(&self) -> bool {
        true
    }

    fn commands_gains(&self) -> bool {
        false
    }

    fn cure(&self, heard: Heard) -> &'static str {
        match heard {
            Heard { state: false, .. } => {
                "no heartbeat: supply, wiring, bit rate, `node`, `axis0.config.can.heartbeat_msg_rate_ms`"
            }
            Heard {
                position: false, ..
            } => "no estimates: set `axis0.config.can.encoder_msg_rate_ms` to the loop's period",
            _ => "no current: set `axis0.config.can.iq_msg_rate_ms` to the loop's period",
        }
    }

    fn prepare(&self, at: Address, model: &Model, hold: &SetPoint) -> Sequence {
        let float = |x: f64| (x as f32).to_le_bytes();
        // Torque is velocity gain * (position gain * error of position + error of velocity).
        let (of_position, of_velocity) = (hold.kp / hold.kd, hold.kd * TAU);
        let mode = two(
            at,
            SET_MODE,
            POSITION_CONTROL.to_le_bytes(),
            PASS_THROUGH.to_le_bytes(),
        );
        let position_gain = two(at, SET_POSITION_GAIN, float(of_position), [0; 4]);
        // Without integrator: the loop takes the drive for a spring.
        let velocity_gains = two(at, SET_VELOCITY_GAINS, float(of_velocity), float(0.0));
        [
            Some(mode),
            Some(position_gain),
            Some(velocity_gains),
            self.command(at, model, hold),
        ]
    }

    fn identify(&self, frame: &Frame) -> Option<Identity> {
        let node = u8::try_from(frame.id >> 5).ok()?;
        let &[.., state, _, flag, _] = frame.payload() else {
            return None;
        };
        let is_heartbeat = frame.id & 0x1F == HEARTBEAT && self.nodes().contains(&node);
        if !is_heartbeat || state > LAST_STATE || flag > 1 {
            return None;
        }
        let at = Address {
            bus: frame.bus,
            node,
            master: 0,
        };
        let told = self.feedback(at, &MODELS[0], frame)?;
        Some(Identity {
            facts: vec![("axis_state", state.to_string())],
            ..Identity::of(node, &told)
        })
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
                        (0, UNDEFINED | IDLE) => State::Off,
                        (0, _) => State::Busy,
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
            CURRENTS => finite(float(&data, 4)).map(|measured| Feedback {
                current: Some(measured),
                ..Feedback::default()
            }),
            // Without a thermistor the motor's is no number.
            TEMPERATURES => {
                let [stage, motor] = [0, 4].map(|first| finite(float(&data, first)));
                Some(Feedback {
                    temperature: motor.filter(|&motor| motor != 0.0).or(stage),
                    ..Feedback::default()
                })
            }
            SUPPLY => finite(float(&data, 0)).map(|voltage| Feedback {
                voltage: Some(voltage),
                ..Feedback::default()
            }),
            // They may be sent by themselves as well, and bring nothing that is not known.
            ERRORS | TORQUES | POWERS => Some(Feedback::default()),
            _ => None,
        }
    }

    fn answer(&self, at: Address, _: &Model, f: &Feedback) -> Vec<Frame> {
        let float = |x: Option<f64>| (x.unwrap_or(0.0) as f32).to_le_bytes();
        let turns = |x: Option<f64>| float(x.map(|x| x / TAU));
        let mut heartbeat = [0; 4];
        heartbeat[0] = match f.state.unwrap_or_default() {
            State::Enabled => CLOSED_LOOP as u8,
            State::Off | State::Fault => IDLE as u8,
            // Calibration of motor and encoder.
            State::Busy => 3,
        };
        vec![
            two(at, ESTIMATES, turns(f.position), turns(f.velocity)),
            two(at, CURRENTS, float(f.current), float(f.current)),
            two(at, TEMPERATURES, float(f.temperature), float(f.temperature)),
            two(at, SUPPLY, float(f.voltage), [0; 4]),
            two(at, HEARTBEAT, f.error.unwrap_or(0).to_le_bytes(), heartbeat),
        ]
    }

    fn error_text(&self, error: u32) -> &'static str {
        match error & error.wrapping_neg() {
            0 => "no error",
            0x1 => "it is starting",
            0x2 => "system error, see the maker's tool",
            0x4 => "its control loop came too late",
            0x8 => "no estimate of position or velocity: encoder or calibration",
            0x10 => "its configuration is not complete, or contradicts itself",
            0x20 => "gate driver",
            0x40 => "no input",
            0x100 => "supply's voltage too high",
            0x200 => "supply's voltage too low",
            0x400 => "supply's current too high",
            0x800 => "too much current fed back to the supply",
            0x1000 => "motor's current beyond its limit",
            0x2000 => "motor too hot",
            0x4000 => "power stage too hot",
            0x8000 => "velocity beyond its limit",
            0x1_0000 => "position beyond its limit",
            0x100_0000 => "watchdog: no command came in its time",
            0x200_0000 => "emergency stop was asked for",
            0x400_0000 => "spin-out: encoder slipped, or its offset is wrong",
            0x800_0000 => "brake resistor is disarmed",
            0x1000_0000 => "thermistor is not connected",
            0x4000_0000 => "calibration failed",
            _ => "an error that the maker does not name",
        }
    }
}

fn finite(x: f64) -> Option<f64> {
    Some(x).filter(|x| x.is_finite())
}
