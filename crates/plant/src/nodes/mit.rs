//! Commands and answers of actuators in MIT mode: five numbers in 64 bits, each a count of its range.

use super::actuator::Actuator;
use super::motor::Motor;

/// Ends of the ranges of gains.
const KP: f64 = 500.0;
const KD: f64 = 5.0;

/// The number of a count of that many bits between two ends.
fn number(count: u64, bits: u32, [low, high]: [f64; 2]) -> f64 {
    low + count as f64 / ((1_u64 << bits) - 1) as f64 * (high - low)
}

/// The count of a number, limited to its range.
fn count(x: f64, bits: u32, [low, high]: [f64; 2]) -> u64 {
    let share = (x.clamp(low, high) - low) / (high - low);
    (share * ((1_u64 << bits) - 1) as f64).round() as u64
}

/// Position, velocity, torque, kp and kd of a command.
pub(super) fn command(data: [u8; 8], [p, v, t]: [f64; 3]) -> [f64; 5] {
    let all = u64::from_be_bytes(data);
    let part = |first: u32, bits: u32| all >> (64 - first - bits) & ((1 << bits) - 1);
    [
        number(part(0, 16), 16, [-p, p]),
        number(part(16, 12), 12, [-v, v]),
        number(part(52, 12), 12, [-t, t]),
        number(part(28, 12), 12, [0.0, KP]),
        number(part(40, 12), 12, [0.0, KD]),
    ]
}

/// Position, velocity and torque of the output in 40 bits.
pub(super) fn state(actuator: &Actuator, motor: &Motor<'_>) -> [u8; 5] {
    let [p, v, t] = actuator.sheet.ranges;
    let [position, velocity, torque] = motor.output();
    let all = count(position, 16, [-p, p]) << 24
        | count(velocity, 12, [-v, v]) << 12
        | count(torque, 12, [-t, t]);
    let [_, _, _, bytes @ ..] = all.to_be_bytes();
    bytes
}

/// A number in 16 bits between two ends, and back.
pub(super) fn wide(x: f64, end: f64) -> u16 {
    count(x, 16, [-end, end]) as u16
}

/// The number of 16 bits.
pub(super) fn of_wide(bits: u16, ends: [f64; 2]) -> f64 {
    number(u64::from(bits), 16, ends)
}

/// A temperature in one byte, °C.
pub(super) fn degrees(x: f64) -> u8 {
    x.round().clamp(0.0, 255.0) as u8
}
