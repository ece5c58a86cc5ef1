//! Delay of commands, as measured: how many periods after a command the motor's current shows it.
//!
//! In: the commands that were sent, motor-side angles and currents, while a client is followed. Out: for each
//! joint the delay from the sample that a command is computed from to its effect, with its standard
//! deviation. One joint at a time, for a second: the change of the current in a cycle is regressed on the
//! changes of the last commands and angles,
//!
//! ```text
//! i(k) - i(k-1) = g (u(k-j) - u(k-j-1)) + sum_m b_m (x(k-m) - x(k-m-1))
//! ```
//!
//! and the `j` that explains it best, by far better than any other, is the number of periods after which a
//! command shows. It acts up to a period before, so what is found is the delay in whole periods, and parts of
//! one only where it varies from one time to the next; `torquectl identify drive` finds parts from a motion
//! that excites the drive. Here whatever the client asks for has to do: torque control answers
//! the encoders' noise in every cycle, which is enough; a held set-point shows nothing.

use nalgebra::{SMatrix, SVector};
use robot_config::{JointParameters, Robot};
use robot_state::{CommandedRecord, Event, MeasuredRecord, Mode, command_flags, measured_flags};

use crate::events::{Counts, Subject};
use crate::measure::NOT_USED;

/// Most periods after which a command shows that are looked for, and angles that explain a current.
const PERIODS: usize = 6;
const ANGLES: usize = 3;
const TERMS: usize = PERIODS + ANGLES;
const FEW: usize = 1 + ANGLES;
type Few = SVector<f64, FEW>;
/// Time for which a joint is measured, s.
const MEASURED_S: f64 = 1.0;
/// Logarithm of the likelihood of the best number of periods over that of the next best from which on it
/// counts as known.
const KNOWN: f64 = 8.0;
/// Periods that the measured delay may leave the range that the configured one explains.
const SLACK: f64 = 0.25;
/// Measurements in a row of another delay than configured that raise the event: a burst of lost commands is
/// none.
const IN_A_ROW: u32 = 2;
/// Share of an earlier measurement's weight that is left with the next one of the joint.
const KEPT: f64 = 0.7;

#[derive(Debug, Clone, Copy)]
struct Joint {
    /// Delay that is configured, from the joint's sample, and age of the sample at SYNC, s.
    configured: f64,
    latency: f64,
    per_turn: f64,
    /// Mean of the periods found, and the number of times that it stands for.
    periods: f64,
    weight: f64,
    off: u32,
}

/// The delay of all joints' commands.
#[derive(Debug)]
pub(super) struct CommandDelay {
    joints: Vec<Joint>,
    period: f64,
    /// The joint that is being measured.
    joint: usize,
    cycles: usize,
    /// Commands, angles and current of the last cycles, newest first, and how many of them count.
    commands: [f64; PERIODS + 1],
    angles: [f64; ANGLES + 1],
    current: f64,
    kept: usize,
    normal: SMatrix<f64, TERMS, TERMS>,
    right: SVector<f64, TERMS>,
    square: f64,
    rows: f64,
}

impl CommandDelay {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let joint = |joint: &JointParameters| Joint {
            configured: joint.law.delay,
            latency: joint.sampling.latency,
            per_turn: joint.encoders.gear_ratio.recip(),
            periods: 0.0,
            weight: 0.0,
            off: 0,
        };
        Self {
            joints: p.joints.iter().map(joint).collect(),
            period: p.timing.sample_period,
            joint: 0,
            cycles: 0,
            commands: [0.0; PERIODS + 1],
            angles: [0.0; ANGLES + 1],
            current: 0.0,
            kept: 0,
            normal: SMatrix::zeros(),
            right: SVector::zeros(),
            square: 0.0,
            rows: 0.0,
        }
    }

    /// Takes a cycle in `mode`, and writes what is known into the record.
    pub(super) fn update(
        &mut self,
        mode: Mode,
        gap: bool,
        measured: &MeasuredRecord,
        commanded: &mut CommandedRecord,
        counts: &mut Counts,
    ) {
        // The record of a joint is made anew in each cycle.
        for (shown, joint) in commanded.joints.iter_mut().zip(&self.joints) {
            if joint.weight > 0.0 {
                (shown.command_delay_s, shown.command_delay_sigma_s) = joint.delay(self.period);
            }
        }
        let (Some(sample), Some(sent)) = (
            measured.joints.get(self.joint),
            commanded.joints.get(self.joint),
        ) else {
            return;
        };
        let fresh = sample.flags & (NOT_USED | measured_flags::STALE) == 0;
        let engaged = sent.flags & command_flags::ENGAGED != 0;
        if mode == Mode::Hold || gap || !fresh || !engaged {
            self.kept = 0;
        } else {
            // Only one of them is sent.
            let command = sent.q_c + sent.current_c;
            let per_turn = self.joints.get(self.joint).map_or(1.0, |j| j.per_turn);
            self.take(command, sample.theta * per_turn, sample.current);
            self.cycles += 1;
        }
        if self.cycles as f64 * self.period < MEASURED_S {
            return;
        }
        if let Some(joint) = self.joints.get_mut(self.joint)
            && let Some(found) = periods(&self.normal, &self.right, self.square, self.rows)
        {
            joint.learn(found as f64, self.period);
            if joint.off >= IN_A_ROW {
                counts.add_of(Event::CommandDelay, Subject::Joint(self.joint));
            }
        }
        self.joint = match self.joint + 1 {
            next if next < self.joints.len() => next,
            _ => 0,
        };
        (self.cycles, self.kept) = (0, 0);
        (self.normal, self.right) = (SMatrix::zeros(), SVector::zeros());
        (self.square, self.rows) = (0.0, 0.0);
    }

    /// The command of a cycle acts after its sample: it is the newest that a later one can show.
    fn take(&mut self, command: f64, angle: f64, current: f64) {
        self.angles.rotate_right(1);
        self.angles[0] = angle;
        if self.kept > PERIODS {
            let change = |x: &[f64], k: usize| x[k] - x[k + 1];
            let terms = SVector::<f64, TERMS>::from_fn(|k, _| match k {
                k if k < PERIODS => change(&self.commands, k),
                k => change(&self.angles, k - PERIODS),
            });
            let value = current - self.current;
            self.normal.syger(1.0, &terms, &terms, 1.0);
            self.right += terms * value;
            self.square += value * value;
            self.rows += 1.0;
        }
        self.current = current;
        self.commands.rotate_right(1);
        self.commands[0] = command;
        self.kept += 1;
    }
}

impl Joint {
    /// Delay and its standard deviation, s. A command that shows after `n` periods acts up to one before.
    fn delay(&self, period: f64) -> (f64, f64) {
        let delay = period * (self.periods - 0.5) - self.latency;
        (delay, period / 12f64.sqrt())
    }

    fn learn(&mut self, found: f64, period: f64) {
        let configured = (self.configured + self.latency) / period;
        let range = configured - SLACK..=configured + 1.0 + SLACK;
        self.off = match range.contains(&found) {
            true => 0,
            false => self.off.saturating_add(1),
        };
        let before = KEPT * self.weight;
        self.weight = before + 1.0;
        self.periods += (found - self.periods) / self.weight;
    }
}

/// Number of periods after which commands show best; none where the commands hardly changed, or another
/// number explains the current nearly as well.
fn periods(
    normal: &SMatrix<f64, TERMS, TERMS>,
    right: &SVector<f64, TERMS>,
    square: f64,
    rows: f64,
) -> Option<usize> {
    let at = |i: usize, k: usize| normal[(i.max(k), i.min(k))];
    // The current by one command and the angles: the rest of its square, where the command has its sign.
    let rest = |j: usize| {
        let place = |i: usize| if i == 0 { j } else { PERIODS + i - 1 };
        let scale = Few::from_fn(|i, _| at(place(i), place(i)).max(f64::MIN_POSITIVE).sqrt());
        let matrix = SMatrix::<f64, FEW, FEW>::from_fn(|i, k| {
            let ridge = if i == k { 1e-9 } else { 0.0 };
            at(place(i), place(k)) / (scale[i] * scale[k]) + ridge
        });
        let wanted = Few::from_fn(|i, _| right[place(i)] / scale[i]);
        let found = matrix.cholesky()?.solve(&wanted);
        (found[0] > 0.0).then(|| square - wanted.dot(&found))
    };
    let mut best: Option<(usize, f64)> = None;
    let mut second = square;
    for j in 0..PERIODS {
        let Some(rest) = rest(j) else {
            continue;
        };
        match best {
            Some((_, least)) if rest >= least => second = second.min(rest),
            _ => {
                second = second.min(best.map_or(square, |(_, least)| least));
                best = Some((j, rest));
            }
        }
    }
    let (j, least) = best.filter(|(_, least)| *least > 0.0)?;
    // Logarithm of the ratio of their likelihoods.
    (0.5 * rows * (second / least).ln() > KNOWN).then_some(j + 1)
}
