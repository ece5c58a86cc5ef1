//! An axis of an ODrive, CANSimple of firmware 0.6, by the DBC file of PyPI odrive-can and the maker's documentation. It
//! counts turns of the motor, and sends by clocks of its own.

use super::actuator::{Actuator, Trouble};
use super::motor::Motor;
use super::wire::Wire;
use can_codec::Frame;
use std::f64::consts::TAU;

/// Commands, below the node in an identifier.
const HEARTBEAT: u32 = 0x01;
const STOP: u32 = 0x02;
const ERRORS: u32 = 0x03;
const STATE: u32 = 0x07;
const ESTIMATES: u32 = 0x09;
const MODE: u32 = 0x0B;
const INPUT_POSITION: u32 = 0x0C;
const INPUT_VELOCITY: u32 = 0x0D;
const INPUT_TORQUE: u32 = 0x0E;
const CURRENT: u32 = 0x14;
const TEMPERATURE: u32 = 0x15;
const REBOOT: u32 = 0x16;
const VOLTAGE: u32 = 0x17;
const CLEAR: u32 = 0x18;
const POSITION_GAIN: u32 = 0x1A;
const VELOCITY_GAINS: u32 = 0x1B;
/// States of the axis.
const IDLE: u32 = 1;
const CLOSED_LOOP: u32 = 8;
/// Modes of control.
const TORQUE_CONTROL: u32 = 1;
const VELOCITY_CONTROL: u32 = 2;
const POSITION_CONTROL: u32 = 3;
/// Times between two heartbeats, and between two values that change slowly, ns.
const BEAT_NS: u64 = 100_000_000;
const SLOW_NS: u64 = 100_000_000;

/// What an axis keeps: gains as the firmware presets them, N·m and turns of the motor.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    mode: u32,
    position_gain: f64,
    velocity_gain: f64,
    /// Position, velocity, torque.
    input: [f64; 3],
    beat: u64,
    slow: u64,
    sampled: u64,
}

impl Default for Axis {
    fn default() -> Self {
        Self {
            mode: VELOCITY_CONTROL,
            position_gain: 20.0,
            velocity_gain: 0.167,
            input: [0.0; 3],
            beat: 0,
            slow: 0,
            sampled: 0,
        }
    }
}

impl Axis {
    pub(super) fn hear(
        &mut self,
        actuator: &mut Actuator,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        if frame.id >> 5 != u32::from(actuator.node) {
            return false;
        }
        let mut data = [0; 8];
        let len = frame.payload().len().min(8);
        data[..len].copy_from_slice(&frame.payload()[..len]);
        let [a, b, c, d, e, f, g, h] = data;
        let (first, second) = ([a, b, c, d], [e, f, g, h]);
        let float = |bytes: [u8; 4]| f64::from(f32::from_le_bytes(bytes));
        let thousandths = |bytes: [u8; 2]| 1e-3 * f64::from(i16::from_le_bytes(bytes));
        let mut is_input = false;
        match frame.id & 0x1F {
            STOP => actuator.disable(motor),
            STATE => match u32::from_le_bytes(first) {
                CLOSED_LOOP => {
                    actuator.enable(wire.now, motor);
                    is_input = true;
                }
                // Calibrations are not simulated.
                _ => actuator.disable(motor),
            },
            MODE => self.mode = u32::from_le_bytes(first),
            INPUT_POSITION => {
                self.input = [float(first), thousandths([e, f]), thousandths([g, h])];
                is_input = true;
            }
            INPUT_VELOCITY => {
                self.input = [self.input[0], float(first), float(second)];
                is_input = true;
            }
            INPUT_TORQUE => {
                self.input[2] = float(first);
                is_input = true;
            }
            REBOOT => {
                actuator.disable(motor);
                *self = Self::default();
            }
            CLEAR => actuator.clear(motor),
            POSITION_GAIN => self.position_gain = float(first),
            VELOCITY_GAINS => self.velocity_gain = float(first),
            _ => return false,
        }
        if is_input {
            actuator.follow(self.command(motor), wire.now, motor);
        }
        true
    }

    /// What the axis makes of its inputs and gains, of the output in N·m and rad.
    fn command(&self, motor: &Motor<'_>) -> [f64; 5] {
        let ratio = motor.sheet().gear_ratio;
        let turn = TAU / ratio;
        let [position, velocity, torque] = self.input;
        let kd = self.velocity_gain * ratio / turn;
        let kp = kd * self.position_gain;
        match self.mode {
            POSITION_CONTROL => [position * turn, velocity * turn, torque * ratio, kp, kd],
            VELOCITY_CONTROL => [0.0, velocity * turn, torque * ratio, 0.0, kd],
            TORQUE_CONTROL => [0.0, 0.0, torque * ratio, 0.0, 0.0],
            _ => [0.0; 5],
        }
    }

    /// What it sends by its clocks.
    pub(super) fn poll(
        &mut self,
        actuator: &mut Actuator,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) {
        let of = |command: u32| u32::from(actuator.node) << 5 | command;
        let now = wire.now;
        if now >= self.beat + BEAT_NS {
            self.beat = now;
            let [a, b, c, d] = error(actuator, motor).to_le_bytes();
            let state = if actuator.is_on() { CLOSED_LOOP } else { IDLE };
            wire.send(of(HEARTBEAT), &[a, b, c, d, state as u8, 0, 0, 0]);
        }
        if now >= self.slow + SLOW_NS {
            self.slow = now;
            let report = motor.reading().report;
            wire.send(
                of(TEMPERATURE),
                &floats(report.temperature, report.temperature),
            );
            wire.send(of(VOLTAGE), &floats(report.voltage, 0.0));
            let errors = u64::from(error(actuator, motor));
            wire.send(of(ERRORS), &errors.to_le_bytes());
        }
        let period = (1e9 * actuator.sheet.period) as u64;
        if now >= self.sampled + period {
            self.sampled = now;
            let current = motor.mounted.motor.direction * motor.reading().current;
            wire.send(of(CURRENT), &floats(current, current));
            let turns = |rad: f64| rad / TAU;
            let (angle, velocity) = (turns(motor.angle()), turns(motor.velocity()));
            wire.send(of(ESTIMATES), &floats(angle, velocity));
        }
    }
}

/// Errors of an axis: 0x1000 current limit, 0x2000 motor over-temperature, 0x20000000 missing estimate, 0x1000000
/// watchdog.
fn error(actuator: &Actuator, motor: &mut Motor<'_>) -> u32 {
    match actuator.trouble(motor) {
        None => 0,
        Some(Trouble::NoCommand) => 0x0100_0000,
        Some(Trouble::Drive(1)) => 0x1000,
        Some(Trouble::Drive(2)) => 0x2000,
        Some(Trouble::Drive(3)) => 0x2000_0000,
        Some(Trouble::Drive(_)) => 0x2,
    }
}

fn floats(a: f64, b: f64) -> [u8; 8] {
    let [a, b] = [a, b].map(|x| (x as f32).to_le_bytes());
    [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
}
