//! Drives, brakes, power, gear, and hands that push.

use plant::{DriveError, DriveStates};
use robot_config::slots;
use std::f64::consts::PI;

use super::{
    ALL_STARTS, AT_REST, ENABLED, ENABLED_PRESSING, HOLD, POWER_ON, PRESSING, Place, Scenario,
    answers, before, both, commands, way,
};
use crate::rig::{Fault, Rig};

const GROUP: &str = "Drives, power, gear, load";

fn states(rig: &mut Rig, joint: usize, change: impl Fn(&mut DriveStates)) {
    if let Some(states) = rig.plant.drive_states(joint) {
        change(states);
    }
}

fn each(rig: &mut Rig, change: impl Fn(&mut DriveStates)) {
    for joint in 0..rig.robot.parameters.joints.len() {
        states(rig, joint, &change);
    }
}

/// In the fault's first cycle.
fn once(change: impl Fn(&mut Rig) + 'static) -> Fault {
    before(move |rig, k| {
        if k == 0 {
            change(rig);
        }
    })
}

fn power_lost(_: Place) -> Fault {
    once(|rig| each(rig, |drive| drive.set_power(false)))
}

fn brakes_stay_open(place: Place) -> Fault {
    let open = once(|rig| each(rig, |drive| drive.set_stuck_brake(Some(false))));
    both(open, power_lost(place))
}

/// The status word is another one on its way.
fn status(place: Place, lie: fn(u32, usize) -> u32) -> Fault {
    let slot = slots::status(place.joint);
    answers(move |rig, k| {
        rig.spoil(
            |s| s == slot,
            |values| values[slot] = f64::from(lie(values[slot] as u32, k)),
        );
    })
}

/// Set-points are others on their way: rad or A.
fn set_point(place: Place, mut change: impl FnMut(&Rig, f64) -> f64 + 'static) -> Fault {
    let slot = slots::command(place.joint);
    commands(move |rig, _| {
        let mut value = None;
        rig.alter(|s| s == slot, |_| {});
        let table = rig.robot.send.clone();
        let mut values = vec![f64::NAN; slots::send_len(&rig.robot.parameters)];
        for frame in &rig.sent {
            if table.decode(frame, &mut values).is_ok() && !values[slot].is_nan() {
                value = Some(change(rig, values[slot]));
                break;
            }
        }
        if let Some(value) = value {
            rig.alter(|s| s == slot, |values| values[slot] = value);
        }
    })
}

/// Control words that nobody sent: shutdown, switch on, enable.
fn enabled_by_others(_: Place) -> Fault {
    commands(|rig, k| {
        let word = f64::from([0x06, 0x07, 0x0f][(k / 50).min(2)]);
        let table = rig.robot.send.clone();
        let joints = rig.robot.parameters.joints.len();
        let values = vec![word; slots::send_len(&rig.robot.parameters)];
        let is_control = |slot| matches!(slots::sent(slot), slots::Sent::Control(j) if j < joints);
        for message in 0..table.message_count() {
            if !table.slots(message).all(is_control) {
                continue;
            }
            if let Some(entry) = table.message(message) {
                let mut frame = can_codec::Frame::zeroed(entry.bus, entry.id, 8, false);
                if table.encode(message, &values, &mut frame) {
                    rig.sent.push(frame);
                }
            }
        }
    })
}

fn control_words_lost(_: Place) -> Fault {
    commands(|rig, _| {
        let table = rig.robot.send.clone();
        let is_control = |slot| matches!(slots::sent(slot), slots::Sent::Control(_));
        rig.sent.retain(|frame| {
            let message = table.classify(frame);
            !message.is_some_and(|message| table.slots(message).any(is_control))
        });
    })
}

/// An external torque: a share of the joint's torque limit over time, s.
fn load(place: Place, share: fn(f64) -> f64) -> Fault {
    before(move |rig, k| {
        let limit = rig.robot.parameters.joints[place.joint].limits.torque;
        let torque = share(1e-3 * k as f64) * limit;
        rig.plant.robot_mut().set_load(place.joint, torque);
    })
}

fn hang_weight(rig: &mut Rig, place: &Place) {
    let limit = rig.robot.parameters.joints[place.joint].limits.torque;
    rig.plant.robot_mut().set_load(place.joint, 0.2 * limit);
}

/// A joint whose torque a client commands, that is let go or held softly, or that a frame leads, moves when its load
/// changes: that is its purpose.
fn in_torque(place: &Place) -> bool {
    place.start.gives_way()
}

fn gear_slips(place: Place) -> Fault {
    once(move |rig| {
        let teeth = way(rig, place.joint, 0.0314);
        rig.plant.robot_mut().slip_gear(place.joint, teeth);
    })
}

fn power_lost_for(place: Place, cycles: usize) -> Fault {
    _ = place;
    before(move |rig, k| {
        if k == 0 || k == cycles {
            each(rig, |drive| drive.set_power(k > 0));
        }
    })
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    vec![
        new("one drive reports over-current", ENABLED, |p| {
            once(move |rig| {
                states(rig, p.joint, |d| d.set_cause(Some(DriveError::OverCurrent)));
            })
        })
        .with_states()
        .physics(),
        new("all drives report over-current", AT_REST, |_| {
            once(|rig| each(rig, |d| d.set_cause(Some(DriveError::OverCurrent))))
        })
        .with_states()
        .physics(),
        new(
            "emergency stop: all drives without power",
            ENABLED,
            power_lost,
        )
        .with_states()
        .physics(),
        new("power lost for 0.5 s, then back", AT_REST, |p| {
            power_lost_for(p, 500)
        })
        .with_states()
        .physics(),
        new(
            "power lost, and brakes that stay open",
            AT_REST,
            brakes_stay_open,
        )
        .with_states()
        .physics(),
        new("brake stays closed from power-on", POWER_ON, |p| {
            once(move |rig| states(rig, p.joint, |d| d.set_stuck_brake(Some(true))))
        })
        .with_states(),
        new("brake closes by itself", ENABLED, |p| {
            once(move |rig| states(rig, p.joint, |d| d.set_stuck_brake(Some(true))))
        })
        .with_states()
        .physics(),
        new("brake open from power-on", POWER_ON, |p| {
            once(move |rig| states(rig, p.joint, |d| d.set_stuck_brake(Some(false))))
        })
        .with_states()
        .physics(),
        new("a drive refuses to be enabled", POWER_ON, |p| {
            once(move |rig| states(rig, p.joint, |d| d.set_refuses(true)))
        })
        .with_states(),
        new("a drive is slow to be enabled", POWER_ON, |p| {
            once(move |rig| states(rig, p.joint, |d| d.set_step_time(0.7)))
        })
        .with_states(),
        new(
            "drives enabled by others at power-on",
            POWER_ON,
            enabled_by_others,
        )
        .with_states(),
        new(
            "status word stays at enabled while the power is lost",
            AT_REST,
            |p| {
                let lie = status(p, |_, _| 0x37);
                let off = once(move |rig| states(rig, p.joint, |d| d.set_power(false)));
                both(lie, off)
            },
        )
        .with_states()
        .physics(),
        new(
            "status word reads fault, the drive is enabled",
            ENABLED,
            |p| status(p, |_, _| 0x18),
        )
        .with_states(),
        new("status word reads off for one cycle", ENABLED, |p| {
            status(p, |word, k| if k == 0 { 0x50 } else { word })
        })
        .with_states(),
        new("status word changes in every cycle", ALL_STARTS, |p| {
            status(p, |_, k| [0x50, 0x31, 0x33, 0x37, 0x18, 0xff][k % 6])
        })
        .with_states(),
        new(
            "control words lost for ever",
            ALL_STARTS,
            control_words_lost,
        )
        .with_states(),
        new("drive follows with an offset of 0.005 rad", AT_REST, |p| {
            set_point(p, move |rig, x| x + way(rig, p.joint, 0.005))
        })
        .of_position_drives()
        .physics(),
        new("drive keeps an old set-point", ENABLED_PRESSING, |p| {
            let mut first = None;
            set_point(p, move |_, x| *first.get_or_insert(x))
        })
        .physics(),
        new(
            "drive keeps an old set-point from power-on",
            POWER_ON,
            |p| {
                let mut first = None;
                set_point(p, move |_, x| *first.get_or_insert(x))
            },
        )
        .physics(),
        new("drive keeps an old set-point for 50 ms", ENABLED, |p| {
            let (mut first, mut count) = (None, 0);
            set_point(p, move |_, x| {
                let kept = *first.get_or_insert(x);
                count += 1;
                if count > 50 { x } else { kept }
            })
        })
        .physics(),
        new("drive turns the other way from power-on", POWER_ON, |p| {
            set_point(p, |_, current| -current)
        })
        .of_current_drives()
        .physics(),
        new("drive turns the other way", ENABLED, |p| {
            set_point(p, |_, current| -current)
        })
        .of_current_drives()
        .physics(),
        new("drive makes 30 % of its torque", ENABLED, |p| {
            set_point(p, |_, current| 0.3 * current)
        })
        .of_current_drives()
        .physics(),
        new("gear slips by 1.8 degrees", ENABLED, gear_slips).physics(),
        new("load of 20 % of the torque limit drops", AT_REST, |p| {
            load(p, |_| 0.0)
        })
        .with_setup(hang_weight)
        .physics()
        .ideal(in_torque),
        new(
            "hand pushes with 30 % of the torque limit for 0.3 s",
            AT_REST,
            |p| {
                load(p, |t| {
                    if t < 0.3 {
                        0.3 * (PI * t / 0.3).sin()
                    } else {
                        0.0
                    }
                })
            },
        )
        .physics()
        .ideal(in_torque),
        new("load of 30 % of the torque limit, and stays", HOLD, |p| {
            load(p, |t| 0.3 * (t / 0.02).min(1.0))
        })
        .physics(),
        new(
            "impact of 100 % of the torque limit for 5 ms",
            AT_REST,
            |p| load(p, |t| if t < 0.005 { 1.0 } else { 0.0 }),
        )
        .physics()
        .ideal(in_torque),
        new("what a frame presses on gives way", PRESSING, |_| {
            once(|rig| rig.plant.robot_mut().release_harness())
        })
        .torque(),
        new("bus cut for 0.5 s, joint pushed meanwhile", HOLD, |p| {
            let cut = answers(move |rig, k| rig.rx.retain(|f| f.bus != p.bus || k > 500));
            let deaf = commands(move |rig, k| rig.sent.retain(|f| f.bus != p.bus || k > 500));
            let push = load(p, |t| if t < 0.4 { 0.3 } else { 0.0 });
            both(both(cut, deaf), push)
        })
        .physics(),
    ]
}
