//! Encoders that lie, alone and two at once.

use robot_config::slots;

use super::{
    ALL_STARTS, AT_REST, ENABLED, ENABLED_PRESSING, POWER_ON, Place, Scenario, answers, both,
    noise, way,
};
use crate::rig::{Fault, Rig};

pub(super) const GROUP: &str = "Encoders";

/// Changes the link-side angle (rad), the motor-side one (rad) of the joint by `change(q, theta, k)`.
fn encoders(
    joint: usize,
    mut change: impl FnMut(f64, f64, usize) -> (f64, f64) + 'static,
) -> Fault {
    answers(move |rig, k| {
        let mut out = None;
        let (q, theta) = (slots::link_angle(joint), slots::motor_angle(joint));
        // The frame is read, changed once, and written: noise must not be drawn twice.
        read(rig, joint, |values| {
            out = Some(change(values[q], values[theta], k));
        });
        if let Some(out) = out {
            rig.spoil(
                |slot| slot == theta,
                |values| {
                    (values[q], values[theta]) = out;
                },
            );
        }
    })
}

/// The joint's values of this cycle.
fn read(rig: &Rig, joint: usize, mut take: impl FnMut(&[f64])) {
    let table = &rig.robot.receive;
    let mut values = vec![0.0; slots::receive_len(&rig.robot.parameters)];
    for frame in &rig.rx {
        if rig.carries(frame, |slot| slot == slots::motor_angle(joint))
            && table.decode(frame, &mut values).is_ok()
        {
            take(&values);
        }
    }
}

/// The link-side angle errs by `link(k)` rad, or what counts as much of a prismatic joint, the motor-side one by
/// `motor(k)` of its own.
fn errs(joint: usize, link: fn(usize) -> f64, motor: fn(usize) -> f64) -> Fault {
    answers(move |rig, k| {
        let link = way(rig, joint, link(k));
        let (q, theta) = (slots::link_angle(joint), slots::motor_angle(joint));
        rig.spoil(
            |slot| slot == theta,
            |values| (values[q], values[theta]) = (values[q] + link, values[theta] + motor(k)),
        );
    })
}

fn slip(joint: usize, link: fn(usize) -> f64) -> Fault {
    errs(joint, link, |_| 0.0)
}

/// Both angles err as one, as if the joint moved.
fn as_one(joint: usize, angle: fn(usize) -> f64) -> Fault {
    answers(move |rig, k| {
        let link = way(rig, joint, angle(k));
        let motor = rig.robot.parameters.joints[joint].encoders.gear_ratio * link;
        let (q, theta) = (slots::link_angle(joint), slots::motor_angle(joint));
        rig.spoil(
            |slot| slot == theta,
            |values| (values[q], values[theta]) = (values[q] + link, values[theta] + motor),
        );
    })
}

fn first(place: Place, link: bool, motor: bool) -> Fault {
    encoders(place.joint, move |q, theta, k| {
        let zero = |is: bool, x: f64| if is && k == 0 { 0.0 } else { x };
        (zero(link, q), zero(motor, theta))
    })
}

fn flat(joint: usize, link: bool, motor: bool) -> Fault {
    let mut kept = None;
    encoders(joint, move |q, theta, _| {
        let (q0, theta0) = *kept.get_or_insert((q, theta));
        (
            if link { q0 } else { q },
            if motor { theta0 } else { theta },
        )
    })
}

fn reversed(joint: usize) -> Fault {
    let mut kept = None;
    encoders(joint, move |q, theta, _| {
        let q0 = *kept.get_or_insert(q);
        (2.0 * q0 - q, theta)
    })
}

fn noisy(joint: usize, amplitude: f64) -> Fault {
    let mut random = noise(17);
    answers(move |rig, _| {
        let error = way(rig, joint, amplitude * random());
        let q = slots::link_angle(joint);
        rig.spoil(|slot| slot == q, |values| values[q] += error);
    })
}

fn exchanged(place: Place) -> Fault {
    answers(move |rig, _| {
        let at = |rig: &Rig, joint| {
            let mut angle = 0.0;
            read(rig, joint, |values| {
                angle = values[slots::link_angle(joint)]
            });
            angle
        };
        let angles = [at(rig, place.joint), at(rig, place.other)];
        for (joint, angle) in [(place.joint, angles[1]), (place.other, angles[0])] {
            let slot = slots::link_angle(joint);
            rig.spoil(|s| s == slot, |values| values[slot] = angle);
        }
    })
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name: &'static str, starts, make| {
        let scenario = Scenario::new(GROUP, name, starts, make);
        if name.starts_with("link encoder") {
            scenario.of_two_encoders()
        } else {
            scenario
        }
    };
    vec![
        new("link encoder reads 0 in its first frame", POWER_ON, |p| {
            first(p, true, false)
        }),
        new("both encoders read 0 in their first frame", POWER_ON, |p| {
            first(p, true, true)
        }),
        new("link encoder reads 0 once", ENABLED, |p| {
            first(p, true, false)
        })
        .step(),
        new("link encoder slips by 0.06 rad", ALL_STARTS, |p| {
            slip(p.joint, |_| 0.06)
        }),
        new("link encoder slips by 0.02 rad", ENABLED_PRESSING, |p| {
            slip(p.joint, |_| 0.02)
        }),
        new("link encoder slips by -0.0035 rad", ENABLED_PRESSING, |p| {
            slip(p.joint, |_| -0.0035)
        }),
        new("link encoder slips by 0.001 rad", ENABLED_PRESSING, |p| {
            slip(p.joint, |_| 0.001)
        }),
        new("motor encoder slips by 1 rad", ENABLED_PRESSING, |p| {
            errs(p.joint, |_| 0.0, |_| 1.0)
        }),
        new("motor encoder slips by -0.2 rad", ENABLED_PRESSING, |p| {
            errs(p.joint, |_| 0.0, |_| -0.2)
        }),
        new(
            "both encoders slip by 0.003 rad, as one",
            ENABLED_PRESSING,
            |p| as_one(p.joint, |_| 0.003),
        ),
        new(
            "both encoders slip by 0.05 rad, as one",
            ENABLED_PRESSING,
            |p| as_one(p.joint, |_| 0.05),
        ),
        new("link encoder flat", ENABLED, |p| flat(p.joint, true, false)),
        new("motor encoder flat", ENABLED, |p| {
            flat(p.joint, false, true)
        }),
        new("both encoders flat", ENABLED, |p| flat(p.joint, true, true)),
        new("link encoder drifts by 0.01 rad/s", ENABLED, |p| {
            slip(p.joint, |k| 1e-5 * k as f64)
        }),
        new("link encoder drifts by 0.1 rad/s", ENABLED_PRESSING, |p| {
            slip(p.joint, |k| 1e-4 * k as f64)
        }),
        new(
            "both encoders drift by 0.1 rad/s, as one",
            ENABLED_PRESSING,
            |p| as_one(p.joint, |k| 1e-4 * k as f64),
        )
        .shown_to_currents(0.1),
        new("both encoders change their signs", ENABLED, |p| {
            encoders(p.joint, |q, theta, _| (-q, -theta))
        }),
        new("motor encoder changes its sign", ENABLED, |p| {
            encoders(p.joint, |q, theta, _| (q, -theta))
        }),
        new("link encoder reversed", ENABLED, |p| reversed(p.joint)),
        new("link encoder scaled by 1.02", ENABLED, |p| {
            encoders(p.joint, |q, theta, _| (1.02 * q, theta))
        }),
        new("link encoder with noise of 0.002 rad", AT_REST, |p| {
            noisy(p.joint, 0.002)
        }),
        new("link encoder with noise of 0.05 rad", AT_REST, |p| {
            noisy(p.joint, 0.05)
        }),
        new(
            "link encoders of two joints exchanged",
            ALL_STARTS,
            exchanged,
        ),
        new(
            "link encoders of two joints slip by 0.02 rad",
            ENABLED,
            |p| both(slip(p.joint, |_| 0.02), slip(p.other, |_| -0.02)),
        ),
        new(
            "link encoder slips by 0.02 rad, another joint falls silent",
            ENABLED,
            |p| {
                let silent = answers(move |rig, _| {
                    rig.lose(|slot| slots::source(slot) == slots::Source::Joint(p.other));
                });
                both(slip(p.joint, |_| 0.02), silent)
            },
        ),
    ]
}
