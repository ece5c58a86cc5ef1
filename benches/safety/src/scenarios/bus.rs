//! Frames that are lost, late, doubled, out of order, corrupt or another joint's.

use can_codec::{EXTENDED_ID, Frame};
use robot_config::slots;

use super::{
    ALL_STARTS, AT_REST, ENABLED, ENABLED_PRESSING, POWER_ON, Place, Scenario, answers, both,
    commands, noise,
};
use crate::rig::Fault;

const GROUP: &str = "Buses and frames";

/// Cycles from one wrong bit to the next.
const BIT_EVERY: usize = 15;

/// A slot of the joint's.
fn of(joint: usize) -> impl Fn(usize) -> bool + Copy {
    move |slot| slots::source(slot) == slots::Source::Joint(joint)
}

fn lose(place: Place, when: fn(usize) -> bool) -> Fault {
    answers(move |rig, k| {
        if when(k) {
            rig.lose(of(place.joint));
        }
    })
}

/// Answers and commands of buses are lost.
fn cut(is_cut: impl Fn(u8, usize) -> bool + Copy + 'static) -> Fault {
    both(
        answers(move |rig, k| rig.rx.retain(|f| !is_cut(f.bus, k))),
        commands(move |rig, k| rig.sent.retain(|f| !is_cut(f.bus, k))),
    )
}

fn silence_then_burst(_: Place) -> Fault {
    let mut kept: Vec<Frame> = Vec::new();
    answers(move |rig, k| match k {
        0..10 => kept.append(&mut rig.rx),
        10 => rig.rx.splice(0..0, kept.drain(..)).for_each(drop),
        _ => {}
    })
}

fn late_for_ever(place: Place) -> Fault {
    let mut kept: Vec<Frame> = Vec::new();
    answers(move |rig, _| {
        let late = std::mem::replace(&mut kept, rig.lose(of(place.joint)));
        rig.rx.extend(late);
    })
}

fn older_after_newer(_: Place) -> Fault {
    let mut last: Vec<Frame> = Vec::new();
    answers(move |rig, _| {
        let now = rig.rx.clone();
        rig.rx.append(&mut last);
        last = now;
    })
}

fn identifiers_exchanged(place: Place) -> Fault {
    answers(move |rig, _| {
        let id = |rig: &crate::rig::Rig, joint| {
            let its = rig.rx.iter().find(|f| rig.carries(f, of(joint)));
            its.map(|f| (f.bus, f.id))
        };
        let (Some(a), Some(b)) = (id(rig, place.joint), id(rig, place.other)) else {
            return;
        };
        for frame in &mut rig.rx {
            let now = (frame.bus, frame.id);
            if now == a || now == b {
                (frame.bus, frame.id) = if now == a { b } else { a };
            }
        }
    })
}

fn stamps(change: fn(u64, f64) -> u64) -> Fault {
    let mut random = noise(7);
    answers(move |rig, _| {
        for frame in &mut rig.rx {
            frame.stamp_ns = change(frame.stamp_ns, random());
        }
    })
}

fn corrupt(place: Place, when: fn(usize) -> bool) -> Fault {
    let mut random = noise(11);
    answers(move |rig, k| {
        if !when(k) {
            return;
        }
        for j in 0..rig.rx.len() {
            let its = rig.carries(&rig.rx[j], of(place.joint));
            let frame = &mut rig.rx[j];
            let length = usize::from(frame.len);
            if its && let Some(payload) = frame.data.get_mut(..length) {
                payload.fill_with(|| (random() * 128.0) as i8 as u8);
            }
        }
    })
}

fn bits_flipped(_: Place) -> Fault {
    let mut random = noise(13);
    answers(move |rig, _| {
        for frame in &mut rig.rx {
            let bit = ((random() + 1.0) * 32.0) as usize;
            if random() > 0.96 && bit / 8 < usize::from(frame.len) {
                frame.data[bit / 8] ^= 1 << (bit % 8);
            }
        }
    })
}

/// Each bit of a joint's frames wrong in one frame, one bit after the other.
fn each_bit_once(place: Place) -> Fault {
    answers(move |rig, k| {
        let bit = k / BIT_EVERY;
        for j in 0..rig.rx.len() {
            let its = k % BIT_EVERY == 0 && rig.carries(&rig.rx[j], of(place.joint));
            let frame = &mut rig.rx[j];
            if its && bit / 8 < usize::from(frame.len) {
                frame.data[bit / 8] ^= 1 << (bit % 8);
            }
        }
    })
}

/// A byte of a joint's frames has a bit that stays set.
fn bit_stuck(place: Place, byte: usize) -> Fault {
    answers(move |rig, _| {
        for j in 0..rig.rx.len() {
            if rig.carries(&rig.rx[j], of(place.joint)) && byte < usize::from(rig.rx[j].len) {
                rig.rx[j].data[byte] |= 1;
            }
        }
    })
}

/// Another node sends a joint's frames too, as they were when it began.
fn sent_by_two(place: Place) -> Fault {
    let mut other: Vec<Frame> = Vec::new();
    answers(move |rig, k| {
        if k == 0 {
            let its = rig.rx.iter().filter(|f| rig.carries(f, of(place.joint)));
            other = its.copied().collect();
        }
        let stamp_ns = rig.rx.last().map_or(0, |frame| frame.stamp_ns);
        let now = other.iter().map(|frame| Frame { stamp_ns, ..*frame });
        rig.rx.extend(now);
    })
}

/// The clock of a bus's controller is set back.
fn clock_set_back(place: Place) -> Fault {
    answers(move |rig, _| {
        for frame in rig.rx.iter_mut().filter(|frame| frame.bus == place.bus) {
            frame.stamp_ns = frame.stamp_ns.saturating_sub(10_000_000);
        }
    })
}

fn late_now_and_then(place: Place) -> Fault {
    let mut kept: Vec<Frame> = Vec::new();
    answers(move |rig, k| {
        let late = std::mem::take(&mut kept);
        if k.is_multiple_of(7) {
            kept = rig.lose(of(place.joint));
        }
        rig.rx.splice(0..0, late);
    })
}

fn commands_delayed_now_and_then(_: Place) -> Fault {
    let mut kept: Vec<Frame> = Vec::new();
    commands(move |rig, k| {
        let late = std::mem::take(&mut kept);
        if k.is_multiple_of(7) {
            kept = std::mem::take(&mut rig.sent);
        }
        rig.sent.splice(0..0, late);
    })
}

fn flood(_: Place) -> Fault {
    answers(|rig, k| {
        let strange = |n: u32| Frame::zeroed(0, (n * 7919 + k as u32) | EXTENDED_ID, 8, false);
        let before: Vec<Frame> = (0..600).map(strange).collect();
        rig.rx.splice(0..0, before);
    })
}

fn commands_delayed(cycles: usize) -> Fault {
    let mut kept: std::collections::VecDeque<Vec<Frame>> = Default::default();
    commands(move |rig, _| {
        kept.push_back(std::mem::take(&mut rig.sent));
        if kept.len() > cycles {
            rig.sent = kept.pop_front().unwrap_or_default();
        }
    })
}

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    vec![
        new("a joint's answer lost once", ALL_STARTS, |p| {
            lose(p, |k| k == 0)
        })
        .step(),
        new("a joint's answer lost 3 times in a row", ENABLED, |p| {
            lose(p, |k| k < 3)
        })
        .step(),
        new("every 10th answer of a joint lost", ENABLED, |p| {
            lose(p, |k| k.is_multiple_of(10))
        })
        .step(),
        new("all answers lost once", ENABLED, |_| {
            answers(|rig, k| {
                if k == 0 {
                    rig.rx.clear();
                }
            })
        })
        .step(),
        new("a joint's first answers lost for 0.5 s", POWER_ON, |p| {
            lose(p, |k| k < 500)
        }),
        new("a joint silent for ever", ENABLED_PRESSING, |p| {
            lose(p, |_| true)
        }),
        new(
            "a joint's answer always after the deadline",
            ENABLED,
            late_for_ever,
        ),
        new("a bus cut for 10 ms", ENABLED_PRESSING, |p| {
            cut(move |bus, k| bus == p.bus && k < 10)
        }),
        new("a bus cut for 0.5 s, then back", ENABLED, |p| {
            cut(move |bus, k| bus == p.bus && k < 500)
        })
        .physics_of_currents(),
        new("all buses cut for 0.5 s, then back", ENABLED, |_| {
            cut(|_, k| k < 500)
        })
        .physics_of_currents(),
        new(
            "answers withheld for 10 ms, then all at once",
            ENABLED,
            silence_then_burst,
        ),
        new("every answer twice", ENABLED, |_| {
            answers(|rig, _| rig.rx.extend_from_within(..))
        })
        .step(),
        new("answers in reverse order", ENABLED, |_| {
            answers(|rig, _| rig.rx.reverse())
        })
        .step(),
        new(
            "the last cycle's answers after each cycle's",
            ENABLED,
            older_after_newer,
        ),
        new(
            "two joints answer under each other's identifier",
            ENABLED,
            identifiers_exchanged,
        ),
        new("the same from power-on", POWER_ON, identifiers_exchanged),
        new("stamps jump by up to 5 ms", ENABLED, |_| {
            stamps(|stamp, r| stamp.saturating_add_signed((5e6 * r) as i64))
        }),
        new("stamps stand still", ENABLED, |_| {
            let mut first = None;
            answers(move |rig, _| {
                for frame in &mut rig.rx {
                    frame.stamp_ns = *first.get_or_insert(frame.stamp_ns);
                }
            })
        }),
        new("stamps lie 10 s ahead", ENABLED, |_| {
            stamps(|stamp, _| stamp.saturating_add(10_000_000_000))
        }),
        new("one corrupt frame of a joint", ENABLED, |p| {
            corrupt(p, |k| k == 0)
        })
        .step(),
        new("a joint's frames corrupt for ever", ENABLED, |p| {
            corrupt(p, |_| true)
        }),
        new("2 % of all frames with a wrong bit", AT_REST, bits_flipped),
        new(
            "each bit of a joint's frames wrong once",
            ENABLED,
            each_bit_once,
        ),
        new("a bit of a joint's first byte stuck", ENABLED, |p| {
            bit_stuck(p, 0)
        }),
        new("a bit of a joint's fourth byte stuck", ENABLED, |p| {
            bit_stuck(p, 3)
        }),
        new("a joint's identifier sent by two", ENABLED, sent_by_two),
        new("a bus's clock set back by 10 ms", ENABLED, clock_set_back),
        new(
            "every 7th answer of a joint a cycle late",
            ENABLED,
            late_now_and_then,
        )
        .step(),
        new(
            "every 7th cycle's commands a cycle late",
            ENABLED,
            commands_delayed_now_and_then,
        ),
        new("600 strange frames before the answers", AT_REST, flood),
        new("answers of the wrong length", AT_REST, |p| {
            answers(move |rig, _| {
                for j in 0..rig.rx.len() {
                    if rig.carries(&rig.rx[j], of(p.joint)) {
                        rig.rx[j].len -= 1;
                    }
                }
            })
        }),
        new("commands lost once", ENABLED, |_| {
            commands(|rig, k| {
                if k == 0 {
                    rig.sent.clear();
                }
            })
        })
        .step(),
        new("commands of a bus lost for 100 ms", ENABLED, |p| {
            commands(move |rig, k| {
                if k < 100 {
                    rig.sent.retain(|f| f.bus != p.bus);
                }
            })
        }),
        new("commands of a bus lost for ever", AT_REST, |p| {
            commands(move |rig, _| rig.sent.retain(|f| f.bus != p.bus))
        }),
        new("commands one cycle late", ENABLED, |_| commands_delayed(1)),
        new("commands five cycles late", AT_REST, |_| {
            commands_delayed(5)
        }),
        new("commands twice", AT_REST, |_| {
            commands(|rig, _| rig.sent.extend_from_within(..))
        })
        .step(),
    ]
}
