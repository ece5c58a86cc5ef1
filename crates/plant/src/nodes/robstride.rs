//! RobStride by its private protocol, by the maker's description and PyPI robstride: kind, 16 bits of data and receiver in
//! an extended identifier.

use super::actuator::{Actuator, Trouble};
use super::mit;
use super::motor::Motor;
use super::wire::Wire;
use can_codec::{EXTENDED_ID, Frame};
use std::collections::BTreeMap;

/// Kinds of frames.
const WHO: u32 = 0;
const MOTION: u32 = 1;
const FEEDBACK: u32 = 2;
const ENABLE: u32 = 3;
const STOP: u32 = 4;
const READ: u32 = 17;
const WRITE: u32 = 18;
/// Parameters: mode, position, velocity, voltage of the supply.
const MODE: u16 = 0x7005;
const POSITION: u16 = 0x7019;
const VELOCITY: u16 = 0x701B;
const VOLTAGE: u16 = 0x701C;
/// Time without a command after which it stops, in 50 µs.
const CAN_TIME_OUT: u16 = 0x7028;
const TICK_NS: u64 = 50_000;
/// Ends of the ranges of gains.
const KP: f64 = 500.0;
const KD: f64 = 5.0;

/// Parameters that were written: floats as their bits.
#[derive(Debug, Clone, Default)]
pub(super) struct Parameters(BTreeMap<u16, u32>);

impl Parameters {
    pub(super) fn hear(
        &mut self,
        actuator: &mut Actuator,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        let id = frame.id & !EXTENDED_ID;
        let its = frame.id & EXTENDED_ID != 0 && id & 0xFF == u32::from(actuator.node);
        let Ok(data) = <[u8; 8]>::try_from(frame.payload()) else {
            return false;
        };
        if !its {
            return false;
        }
        let (kind, middle) = (id >> 24, (id >> 8) as u16);
        // Whom it answers.
        let host = middle as u8;
        match kind {
            WHO => {
                let serial = u64::from(actuator.node).to_le_bytes();
                let id = WHO << 24 | u32::from(actuator.node) << 8 | 0xFE;
                wire.send(id | EXTENDED_ID, &serial);
                return true;
            }
            READ => return self.read(&data, host, actuator, wire, motor),
            MOTION => {
                // The torque is in the identifier: what answers goes to the host that all have.
                let command = command(data, middle, actuator.sheet.ranges);
                actuator.follow(command, wire.now, motor);
                answer(actuator, 0xFD, wire, motor);
                return true;
            }
            ENABLE => actuator.enable(wire.now, motor),
            STOP => {
                actuator.disable(motor);
                if data[0] == 1 {
                    actuator.clear(motor);
                }
            }
            WRITE => self.write(&data, actuator),
            _ => return false,
        }
        answer(actuator, host, wire, motor);
        true
    }

    fn read(
        &self,
        data: &[u8; 8],
        host: u8,
        actuator: &Actuator,
        wire: &mut Wire<'_>,
        motor: &Motor<'_>,
    ) -> bool {
        let parameter = u16::from_le_bytes([data[0], data[1]]);
        let [position, velocity, _] = motor.output();
        let value = match parameter {
            POSITION => (position as f32).to_bits(),
            VELOCITY => (velocity as f32).to_bits(),
            VOLTAGE => (motor.reading().report.voltage as f32).to_bits(),
            CAN_TIME_OUT => (actuator.time_out / TICK_NS) as u32,
            _ => self.0.get(&parameter).copied().unwrap_or(0),
        };
        let mut answer = [data[0], data[1], 0, 0, 0, 0, 0, 0];
        answer[4..].copy_from_slice(&value.to_le_bytes());
        let id = READ << 24 | u32::from(actuator.node) << 8 | u32::from(host);
        wire.send(id | EXTENDED_ID, &answer);
        true
    }

    fn write(&mut self, data: &[u8; 8], actuator: &mut Actuator) {
        let parameter = u16::from_le_bytes([data[0], data[1]]);
        let value = u32::from_le_bytes([data[4], data[5], data[6], data[7]]);
        match parameter {
            CAN_TIME_OUT => actuator.time_out = u64::from(value) * TICK_NS,
            // Of the modes there is that of operation control, 0.
            MODE => {}
            _ => {
                self.0.insert(parameter, value);
            }
        }
    }
}

/// Position, velocity, torque, kp and kd.
fn command(data: [u8; 8], torque: u16, [p, v, t]: [f64; 3]) -> [f64; 5] {
    let word = |at: usize| u16::from_be_bytes([data[at], data[at + 1]]);
    [
        mit::of_wide(word(0), [-p, p]),
        mit::of_wide(word(2), [-v, v]),
        mit::of_wide(torque, [-t, t]),
        mit::of_wide(word(4), [0.0, KP]),
        mit::of_wide(word(6), [0.0, KD]),
    ]
}

/// Errors and mode in the identifier; position, velocity, torque, tenths of a degree.
fn answer(actuator: &Actuator, host: u8, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
    // Bits 16 to 21: under-voltage, over-current, too hot, magnetic encoder, stalled, uncalibrated.
    let errors: u32 = match actuator.trouble(motor) {
        None => 0,
        Some(Trouble::Drive(1)) => 1 << 1,
        Some(Trouble::Drive(2)) => 1 << 2,
        Some(Trouble::Drive(3)) => 1 << 3,
        Some(Trouble::NoCommand | Trouble::Drive(_)) => 1 << 4,
    };
    let mode = if actuator.is_on() { 2 } else { 0 };
    let [p, v, t] = actuator.sheet.ranges;
    let [position, velocity, torque] = motor.output();
    let tenths = (10.0 * motor.reading().report.temperature).round() as u16;
    let words = [
        mit::wide(position, p),
        mit::wide(velocity, v),
        mit::wide(torque, t),
        tenths,
    ];
    let mut data = [0; 8];
    for (place, word) in data.chunks_exact_mut(2).zip(words) {
        place.copy_from_slice(&word.to_be_bytes());
    }
    let id = FEEDBACK << 24
        | mode << 22
        | errors << 16
        | u32::from(actuator.node) << 8
        | u32::from(host);
    wire.send(id | EXTENDED_ID, &data);
}
