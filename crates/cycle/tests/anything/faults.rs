//! Faults of frames, drives and sensors.

use crate::common::{self, Bench};
use can_codec::{EXTENDED_ID, Frame, Frames};
use plant::DriveError;
use robot_config::slots;
use std::cell::Cell;
use test_support::Random;

/// Spoils the answers of one cycle in some way.
pub(crate) fn spoil(random: &mut Random, rx: &mut Frames, now: u64) {
    let frames: Vec<Frame> = rx.iter().copied().collect();
    rx.clear();
    for mut frame in frames {
        match random.below(40) {
            0 => continue,
            1 => frame.data[random.below(8)] ^= 1 << random.below(8),
            2 => frame.data[..8].fill_with(|| random.bits() as u8),
            3 => frame.len = random.below(9) as u8,
            4 => frame.id = random.bits() as u32,
            5 => frame.error = true,
            6 => frame.stamp_ns = random.bits(),
            7 => frame.stamp_ns = now.saturating_sub(random.below(5_000_000) as u64),
            8 => _ = rx.push(frame),
            _ => {}
        }
        rx.push(frame);
    }
    if random.below(10) == 0 {
        rx.push(Frame::zeroed(
            1,
            random.bits() as u32 | EXTENDED_ID,
            8,
            true,
        ));
    }
}

/// Changes something about one drive.
pub(crate) fn spoil_drive(random: &mut Random, bench: &mut Bench) {
    let joint = random.below(bench.robot.parameters.joints.len());
    let Some(states) = bench.plant.drive_states(joint) else {
        return;
    };
    match random.below(5) {
        0 => states.set_power(random.below(2) == 0),
        1 => states.set_cause(Some(DriveError::OverCurrent)),
        2 => states.set_cause(None),
        3 => states.set_refuses(random.below(2) == 0),
        _ => states.set_step_time(random.unit() * 0.1),
    }
}

/// A sensor that lies, cycle after cycle.
#[derive(Debug, Clone)]
pub(crate) struct Lie {
    joint: usize,
    kind: usize,
    size: f64,
    cycles: f64,
    kept: Cell<Option<f64>>,
}

impl Lie {
    pub(crate) fn new(random: &mut Random, bench: &Bench) -> Self {
        Self {
            joint: random.below(bench.robot.parameters.joints.len()),
            kind: random.below(9),
            size: random.symmetric(),
            cycles: 0.0,
            kept: Cell::default(),
        }
    }

    /// Spoils sound answers.
    pub(crate) fn apply(&mut self, bench: &mut Bench) {
        self.cycles += 1.0;
        let parameters = &bench.robot.parameters.joints[self.joint];
        let (way, n) = (
            parameters.kind.threshold(0.1 * self.size),
            parameters.encoders.gear_ratio,
        );
        let drift = way * 1e-3 * self.cycles;
        let (q, theta) = (
            slots::link_angle(self.joint),
            slots::motor_angle(self.joint),
        );
        let (size, kept) = (self.size, &self.kept);
        match self.kind {
            0 => common::spoil(bench, self.joint, |x| x[q] += way),
            1 => common::spoil(bench, self.joint, |x| x[theta] += n * way),
            2 => common::spoil(bench, self.joint, |x| {
                (x[q], x[theta]) = (x[q] + drift, x[theta] + n * drift);
            }),
            3 => common::spoil(bench, self.joint, |x| {
                x[q] = kept.get().unwrap_or(x[q]);
                kept.set(Some(x[q]));
            }),
            _ if bench.robot.parameters.ft_sensors.is_empty() => {}
            4 => {
                let table = bench.robot.receive.clone();
                let is_ft = |slot| slots::source(slot) == slots::Source::Ft(0);
                bench.drop_answers(|frame| {
                    let message = table.classify(frame);
                    message.is_some_and(|message| table.slots(message).any(is_ft))
                });
            }
            5 => common::spoil_ft(bench, |x| x[2] = (x[2] + 200.0 * size).clamp(-300.0, 300.0)),
            6 => common::spoil_ft(bench, |x| {
                x[4] = (x[4] + size * 1e-2 * self.cycles).clamp(-15.0, 15.0);
            }),
            7 => common::spoil_ft(bench, |x| x.iter_mut().for_each(|x| *x = -*x)),
            _ => common::spoil_ft(bench, |x| x.fill(0.0)),
        }
    }
}

pub(crate) fn mend_drives(bench: &mut Bench) {
    for joint in 0..bench.robot.parameters.joints.len() {
        if let Some(states) = bench.plant.drive_states(joint) {
            states.set_power(true);
            states.set_cause(None);
            states.set_refuses(false);
            states.set_step_time(2e-3);
        }
    }
}
