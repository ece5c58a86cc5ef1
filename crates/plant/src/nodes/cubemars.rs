//! CubeMars AK in MIT mode, by the maker's manual (AK series module driver user manual, MIT mode).

use super::actuator::{Actuator, Trouble};
use super::mit;
use super::motor::Motor;
use super::wire::Wire;
use can_codec::Frame;

pub(super) fn hear(
    actuator: &mut Actuator,
    frame: &Frame,
    wire: &mut Wire<'_>,
    motor: &mut Motor<'_>,
) -> bool {
    let Ok(data) = <[u8; 8]>::try_from(frame.payload()) else {
        return false;
    };
    if frame.id != u32::from(actuator.node) {
        return false;
    }
    match data {
        [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, word @ 0xFC..=0xFE] => match word {
            0xFC => actuator.enable(wire.now, motor),
            0xFD => {
                actuator.disable(motor);
                actuator.clear(motor);
            }
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

/// Under its own identifier: identifier, position, velocity, current, temperature, error.
fn answer(actuator: &Actuator, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
    // 1 over-temperature, 2 over-current, 5 encoder, 7 motor stalled or lost.
    let error = match actuator.trouble(motor) {
        None => 0,
        Some(Trouble::Drive(1)) => 2,
        Some(Trouble::Drive(2)) => 1,
        Some(Trouble::Drive(3)) => 5,
        Some(Trouble::NoCommand | Trouble::Drive(_)) => 7,
    };
    let [a, b, c, d, e] = mit::state(actuator, motor);
    let temperature = mit::degrees(motor.reading().report.temperature);
    let data = [actuator.node, a, b, c, d, e, temperature, error];
    wire.send(u32::from(actuator.node), &data);
}
