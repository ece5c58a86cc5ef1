//! Current sensors, F/T sensors and IMU.

use can_codec::Frame;
use robot_config::slots;
use robot_config::slots::Source;
use std::collections::VecDeque;

use super::{
    AT_REST, ENABLED, ENABLED_PRESSING, FOLLOWING, FOLLOWING_PRESSING, Place, STAND, Scenario,
    answers,
};
use crate::rig::{Fault, Rig};

const GROUP: &str = "Current, F/T sensors, IMU";

/// Greatest reading of an F/T sensor's electronics, over the measured range.
const BEYOND: f64 = 1.0667;

/// Changes values of a source in each cycle.
fn of(source: Source, mut change: impl FnMut(&mut [f64], usize) + 'static) -> Fault {
    answers(move |rig: &mut Rig, k| {
        let mut values = vec![0.0; slots::receive_len(&rig.robot.parameters)];
        let table = rig.robot.receive.clone();
        let its = |slot| slots::source(slot) == source;
        for frame in &rig.rx {
            if rig.carries(frame, its) {
                // An undecodable frame leaves the values as they are.
                _ = table.decode(frame, &mut values);
            }
        }
        change(&mut values, k);
        // Beyond its range, but none that its frame cannot carry.
        let p = &rig.robot.parameters;
        let most: Vec<f64> = match source {
            Source::Ft(s) => (p.ft_sensors[s].signals.iter())
                .map(|signal| BEYOND * signal.max)
                .collect(),
            Source::Imu(i) => (p.imus[i].signals.iter())
                .map(|signal| signal.max)
                .collect(),
            Source::Joint(_) => Vec::new(),
        };
        rig.spoil(its, |all| {
            let slots = (0..all.len()).filter(|&slot| its(slot));
            for (axis, slot) in slots.enumerate() {
                let most = most.get(axis).copied().unwrap_or(f64::INFINITY);
                all[slot] = values[slot].clamp(-most, most);
            }
        });
    })
}

fn current(place: Place, change: fn(f64) -> f64) -> Fault {
    let slot = slots::current(place.joint);
    of(Source::Joint(place.joint), move |values, _| {
        values[slot] = change(values[slot]);
    })
}

/// The first F/T sensor's six axes.
fn ft(mut change: impl FnMut(&mut [f64; 6], usize) + 'static) -> Fault {
    of(Source::Ft(0), move |values, k| {
        let mut axes = std::array::from_fn(|axis| values[slots::ft(0, axis)]);
        change(&mut axes, k);
        for (axis, x) in axes.into_iter().enumerate() {
            values[slots::ft(0, axis)] = x;
        }
    })
}

/// Gyro x y z, accelerometer x y z.
fn imu(change: impl FnMut(&mut [f64; 6], usize) + 'static) -> Fault {
    nth_imu(0, change)
}

fn nth_imu(n: usize, mut change: impl FnMut(&mut [f64; 6], usize) + 'static) -> Fault {
    of(Source::Imu(n), move |values, k| {
        let mut axes = std::array::from_fn(|axis| match axis {
            0..3 => values[slots::gyro(n, axis)],
            _ => values[slots::accelerometer(n, axis - 3)],
        });
        change(&mut axes, k);
        for (axis, x) in axes.into_iter().enumerate() {
            let slot = match axis {
                0..3 => slots::gyro(n, axis),
                _ => slots::accelerometer(n, axis - 3),
            };
            values[slot] = x;
        }
    })
}

fn silent(source: Source) -> Fault {
    answers(move |rig, _| {
        rig.lose(|slot| slots::source(slot) == source);
    })
}

/// Stays as it was in the first cycle.
fn kept() -> impl FnMut(&mut [f64; 6], usize) {
    let mut first = None;
    move |axes, _| *axes = *first.get_or_insert(*axes)
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    let mut all = vec![
        new("current sensor reads 0", AT_REST, |p| current(p, |_| 0.0)),
        new("current sensor reads 20 A", AT_REST, |p| {
            current(p, |_| 20.0)
        }),
        new("current sensor reversed", AT_REST, |p| current(p, |i| -i)),
        new("F/T sensor silent", ENABLED_PRESSING, |_| {
            silent(Source::Ft(0))
        }),
        new("F/T sensor flat", ENABLED_PRESSING, |_| ft(kept())),
        new("F/T sensor reads 0", FOLLOWING_PRESSING, |_| {
            ft(|axes, _| axes.fill(0.0))
        }),
        new("F/T sensor saturated", FOLLOWING_PRESSING, |_| {
            ft(|axes, _| *axes = [1600.0, 1600.0, 1600.0, 98.0, 98.0, 98.0])
        }),
        new("F/T sensor reversed", FOLLOWING_PRESSING, |_| {
            ft(|axes, _| axes.iter_mut().for_each(|x| *x = -*x))
        }),
        new(
            "F/T sensor steps by 50 N and 5 N·m",
            FOLLOWING_PRESSING,
            |_| ft(|axes, _| (axes[2], axes[4]) = (axes[2] + 50.0, axes[4] + 5.0)),
        ),
        new(
            "F/T sensor drifts by 20 N/s and 4 N·m/s",
            FOLLOWING_PRESSING,
            |_| {
                ft(|axes, k| {
                    let t = 1e-3 * k as f64;
                    (axes[2], axes[4]) = (axes[2] + 20.0 * t, axes[4] + 4.0 * t);
                })
            },
        ),
        new("F/T sensor's axes exchanged", FOLLOWING_PRESSING, |_| {
            ft(|axes, _| *axes = [axes[1], axes[2], axes[0], axes[4], axes[5], axes[3]])
        }),
        new("IMU silent", ENABLED, |_| silent(Source::Imu(0))).with_imu(),
        new("IMU flat", ENABLED, |_| imu(kept())).with_imu(),
        new("IMU's axes exchanged", FOLLOWING, |_| {
            imu(|axes, _| *axes = [axes[1], axes[2], axes[0], axes[4], axes[5], axes[3]])
        })
        .with_imu(),
        new("IMU's accelerometer reversed", FOLLOWING, |_| {
            imu(|axes, _| axes[3..].iter_mut().for_each(|x| *x = -*x))
        })
        .with_imu(),
        new("IMU's gyro steps by 1 rad/s", FOLLOWING, |_| {
            imu(|axes, _| axes[1] += 1.0)
        })
        .with_imu(),
        new("IMU saturated", FOLLOWING, |_| {
            imu(|axes, _| *axes = [30.0, 30.0, 30.0, 150.0, 150.0, 150.0])
        })
        .with_imu(),
        new("second IMU silent", ENABLED, |_| silent(Source::Imu(1))).with_further_imus(),
        new("second IMU flat", ENABLED, |_| nth_imu(1, kept())).with_further_imus(),
        new("second IMU's axes exchanged", FOLLOWING, |_| {
            nth_imu(1, |axes, _| {
                *axes = [axes[1], axes[2], axes[0], axes[4], axes[5], axes[3]];
            })
        })
        .with_further_imus(),
        new(
            "second IMU's accelerometer off by 3 m/s²",
            FOLLOWING,
            |_| nth_imu(1, |axes, _| axes[3] += 3.0),
        )
        .with_further_imus(),
    ];
    all.extend(of_axes().map(|(name, make)| new(name, STAND, make)));
    all.extend(of_standing().map(|(name, make)| new(name, STAND, make)));
    all
}

type Make = fn(Place) -> Fault;

/// One axis of the F/T sensor above a foot on which the robot stands.
fn axis<const AXIS: usize>(mut change: impl FnMut(f64, usize) -> f64 + 'static) -> Fault {
    ft(move |axes, k| axes[AXIS] = change(axes[AXIS], k))
}

/// N or N·m of an axis that count alike.
const fn unit(axis: usize) -> f64 {
    if axis < 3 { 1.0 } else { 0.1 }
}

/// Faults of each axis alone: a step either way, a drift, a value that stays, and none.
macro_rules! of_axis {
    ($axis:literal, $name:literal) => {
        [
            (
                concat!("F/T sensor steps by 100 N or 10 N·m along ", $name),
                |_| axis::<$axis>(|x, _| x + 100.0 * unit($axis)),
            ),
            (
                concat!("F/T sensor steps by -100 N or -10 N·m along ", $name),
                |_| axis::<$axis>(|x, _| x - 100.0 * unit($axis)),
            ),
            (
                concat!("F/T sensor drifts by 200 N/s or 20 N·m/s along ", $name),
                |_| axis::<$axis>(|x, k| x + 0.2 * k as f64 * unit($axis)),
            ),
            (concat!("F/T sensor stuck along ", $name), |_| {
                let mut first = None;
                axis::<$axis>(move |x, _| *first.get_or_insert(x))
            }),
            (concat!("F/T sensor reads 0 along ", $name), |_| {
                axis::<$axis>(|_, _| 0.0)
            }),
        ]
    };
}

fn of_axes() -> impl Iterator<Item = (&'static str, Make)> {
    let all: [[(&str, Make); 5]; 6] = [
        of_axis!(0, "x"),
        of_axis!(1, "y"),
        of_axis!(2, "z"),
        of_axis!(3, "x, torque"),
        of_axis!(4, "y, torque"),
        of_axis!(5, "z, torque"),
    ];
    all.into_iter().flatten()
}

/// Signals of where up is, and of which feet bear: late, slightly wrong, or the same of both feet.
fn of_standing() -> impl Iterator<Item = (&'static str, Make)> {
    let all: [(&str, Make); 8] = [
        ("IMU late by 20 ms", |_| {
            late(|source| source == Source::Imu(0), 20)
        }),
        ("IMU late by 100 ms", |_| {
            late(|source| source == Source::Imu(0), 100)
        }),
        ("IMU's gyro steps by 0.05 rad/s", |_| {
            imu(|axes, _| axes[1] += 0.05)
        }),
        ("IMU's gyro drifts by 0.5 rad/s²", |_| {
            imu(|axes, k| axes[1] += 5e-4 * k as f64)
        }),
        ("IMU's accelerometer steps by 1 m/s²", |_| {
            imu(|axes, _| axes[3] += 1.0)
        }),
        ("IMU's accelerometer drifts by 2 m/s³", |_| {
            imu(|axes, k| axes[4] += 2e-3 * k as f64)
        }),
        ("all F/T sensors late by 100 ms", |_| {
            late(|source| matches!(source, Source::Ft(_)), 100)
        }),
        ("all F/T sensors silent", |_| {
            answers(|rig, _| {
                rig.lose(|slot| matches!(slots::source(slot), Source::Ft(_)));
            })
        }),
    ];
    all.into_iter()
}

/// Answers of sources come so many cycles late.
fn late(is_its: fn(Source) -> bool, cycles: usize) -> Fault {
    let mut kept: VecDeque<Vec<Frame>> = VecDeque::new();
    answers(move |rig, _| {
        kept.push_back(rig.lose(|slot| is_its(slots::source(slot))));
        if kept.len() > cycles {
            rig.rx.extend(kept.pop_front().unwrap_or_default());
        }
    })
}
