//! Damiao in MIT mode, by the frames of PyPI damiao-motor and the maker's manual.

use super::actuator::{Actuator, Trouble};
use super::mit;
use super::motor::Motor;
use super::wire::Wire;
use can_codec::Frame;
use std::collections::BTreeMap;

/// Identifier of questions and registers, to all.
const TO_ALL: u32 = 0x7FF;
/// Registers.
const REPLY: u8 = 7;
const NODE: u8 = 8;
const TIME_OUT: u8 = 9;
const MODE: u8 = 10;
const SUB_VERSION: u8 = 14;
const RANGES: [u8; 3] = [21, 22, 23];
/// Unit of the time-out, ns.
const TICK_NS: u64 = 50_000;

/// Its registers, as counts or as the bits of floats.
#[derive(Debug, Clone)]
pub(super) struct Registers(BTreeMap<u8, u32>);

impl Registers {
    pub(super) fn new(actuator: &Actuator) -> Self {
        let ticks = (actuator.time_out / TICK_NS) as u32;
        let mut registers = BTreeMap::from([
            (REPLY, u32::from(actuator.sheet.reply)),
            (NODE, u32::from(actuator.node)),
            (TIME_OUT, ticks),
            (MODE, 1),
            (SUB_VERSION, 5013),
        ]);
        for (register, range) in RANGES.into_iter().zip(actuator.sheet.ranges) {
            registers.insert(register, (range as f32).to_bits());
        }
        Self(registers)
    }

    pub(super) fn hear(
        &mut self,
        actuator: &mut Actuator,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        let Ok(data) = <[u8; 8]>::try_from(frame.payload()) else {
            return false;
        };
        if frame.id == TO_ALL {
            let [low, high, what, register, ref value @ ..] = data;
            if u16::from_le_bytes([low, high]) != u16::from(actuator.node) {
                return false;
            }
            match what {
                0xCC => answer(actuator, wire, motor),
                0x33 | 0x55 => {
                    if what == 0x55 {
                        self.write(register, u32::from_le_bytes(*value), actuator);
                    }
                    let value = self.0.get(&register).copied().unwrap_or(0);
                    let [a, b, c, d] = value.to_le_bytes();
                    let reply = [low, high, what, register, a, b, c, d];
                    wire.send(u32::from(actuator.sheet.reply), &reply);
                }
                _ => return false,
            }
            return true;
        }
        if frame.id != u32::from(actuator.node) {
            return false;
        }
        match data {
            [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, word @ 0xFB..=0xFE] => match word {
                0xFC => actuator.enable(wire.now, motor),
                0xFD => actuator.disable(motor),
                0xFB => actuator.clear(motor),
                // The zero is set by the maker's tool: it stays.
                _ => {}
            },
            _ => {
                let command = mit::command(data, actuator.sheet.ranges);
                actuator.follow(command, wire.now, motor);
            }
        }
        answer(actuator, wire, motor);
        true
    }

    /// The time-out can be changed; of the modes there is one, and all else is for the maker's tool.
    fn write(&mut self, register: u8, value: u32, actuator: &mut Actuator) {
        if register == TIME_OUT {
            self.0.insert(register, value);
            actuator.time_out = u64::from(value) * TICK_NS;
        }
    }
}

/// State and identifier, position, velocity, torque, temperatures of drive and winding.
fn answer(actuator: &Actuator, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
    let state = match actuator.trouble(motor) {
        Some(Trouble::NoCommand) => 0xD,
        Some(Trouble::Drive(1)) => 0xA,
        Some(Trouble::Drive(2)) => 0xC,
        Some(Trouble::Drive(_)) => 0xE,
        None => u8::from(actuator.is_on()),
    };
    let [a, b, c, d, e] = mit::state(actuator, motor);
    let hot = mit::degrees(motor.reading().report.temperature);
    let first = state << 4 | actuator.node & 0xF;
    let data = [first, a, b, c, d, e, hot, hot];
    wire.send(u32::from(actuator.sheet.reply), &data);
}
