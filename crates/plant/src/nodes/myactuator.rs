//! MyActuator RMD, protocol 4.x in motion mode, by the maker's manual and 2b-t/myactuator_rmd (MIT).

use super::actuator::{Actuator, Trouble};
use super::mit;
use super::motor::Motor;
use super::wire::Wire;
use can_codec::Frame;

/// Identifiers, plus the node: commands and their answers, motion mode and its answers.
const COMMAND: u32 = 0x140;
const ANSWER: u32 = 0x240;
const MOTION: u32 = 0x400;
const MOTION_ANSWER: u32 = 0x500;
/// Commands.
const SHUT_DOWN: u8 = 0x80;
const STOP: u8 = 0x81;
const ANGLE: u8 = 0x92;
const STATUS_1: u8 = 0x9A;
const STATUS_2: u8 = 0x9C;
const TIME_OUT: u8 = 0xB3;

pub(super) fn hear(
    actuator: &mut Actuator,
    frame: &Frame,
    wire: &mut Wire<'_>,
    motor: &mut Motor<'_>,
) -> bool {
    let Ok(data) = <[u8; 8]>::try_from(frame.payload()) else {
        return false;
    };
    let node = u32::from(actuator.node);
    if frame.id == MOTION + node {
        // A command of torque switches it on; one without gains and torque is a question.
        let command @ [_, _, torque, kp, kd] = mit::command(data, actuator.sheet.ranges);
        let half = 0.51 * 2.0 * actuator.sheet.ranges[2] / 4095.0;
        if !actuator.is_on() && (kp > 0.0 || kd > 0.0 || torque.abs() > half) {
            actuator.enable(wire.now, motor);
        }
        actuator.follow(command, wire.now, motor);
        let [a, b, c, d, e] = mit::state(actuator, motor);
        let answer = [actuator.node, a, b, c, d, e, 0, 0];
        wire.send(MOTION_ANSWER + node, &answer);
        return true;
    }
    if frame.id != COMMAND + node {
        return false;
    }
    let mut answer = data;
    match data[0] {
        SHUT_DOWN => {
            actuator.disable(motor);
            actuator.clear(motor);
        }
        STOP => actuator.follow([0.0; 5], wire.now, motor),
        STATUS_1 => answer = status_1(actuator, motor),
        STATUS_2 => answer = status_2(motor),
        ANGLE => {
            let [position, ..] = motor.output();
            let hundredths = (100.0 * position.to_degrees()).round() as i32;
            answer[4..].copy_from_slice(&hundredths.to_le_bytes());
        }
        TIME_OUT => {
            let ms = u32::from_le_bytes([data[4], data[5], data[6], data[7]]);
            actuator.time_out = 1_000_000 * u64::from(ms);
        }
        _ => return false,
    }
    wire.send(ANSWER + node, &answer);
    true
}

/// Temperature, brake, voltage in tenths of a volt, error.
fn status_1(actuator: &Actuator, motor: &mut Motor<'_>) -> [u8; 8] {
    // 0x0002 stalled, 0x0008 over-voltage, 0x0010 over-current, 0x1000 too hot, 0x2000 encoder.
    let error: u16 = match actuator.trouble(motor) {
        None => 0,
        Some(Trouble::Drive(1)) => 0x0010,
        Some(Trouble::Drive(2)) => 0x1000,
        Some(Trouble::Drive(3)) => 0x2000,
        Some(Trouble::NoCommand | Trouble::Drive(_)) => 0x0002,
    };
    let report = motor.reading().report;
    let hot = mit::degrees(report.temperature);
    let [c, d] = ((10.0 * report.voltage).round() as u16).to_le_bytes();
    let [e, f] = error.to_le_bytes();
    [STATUS_1, hot, hot, 1, c, d, e, f]
}

/// Temperature, current in hundredths of an ampere, speed and angle in degrees of the output.
fn status_2(motor: &Motor<'_>) -> [u8; 8] {
    let [position, velocity, _] = motor.output();
    let whole = |x: f64| (x.round() as i16).to_le_bytes();
    let hot = mit::degrees(motor.reading().report.temperature);
    let [a, b] = whole(100.0 * motor.current());
    let [c, d] = whole(velocity.to_degrees());
    let [e, f] = whole(position.to_degrees());
    [STATUS_2, hot, a, b, c, d, e, f]
}
