//! Standstill: a motor that shows no motion though it must move.
//!
//! In: what both encoders show, the motor's velocity some time ago and its torque. Out: whether it can stand. It cannot
//! while its torque changes by more than friction holds, nor right after a motion that nothing could have ended within
//! a sample. A position drive holds its motor against every torque, but the gear between two encoders winds up by it.
//! Where neither changes, one or both are flat, or a brake blocks the rotor.

use super::PlausibilityParameters;
use crate::in_a_row::count_in_a_row;

/// The motor's state by a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorSample {
    /// theta, rad.
    pub theta: f64,
    /// q, rad.
    pub q: f64,
    /// Velocity some time ago, rad/s, link side.
    pub velocity: f64,
    /// Torque of the motor's current, N·m, link side.
    pub torque: f64,
    /// Set-point of the joint's position, rad; NaN: its drive has none.
    pub target: f64,
    /// Whether the joint's drive follows set-points: then no brake takes that torque over.
    pub driven: bool,
    /// Encoders of another joint are known to stand still: those of this one may as well.
    pub warned: bool,
}

impl MotorSample {
    /// This sample of a motor whose velocity before is not known.
    pub(super) fn without_velocity(self) -> Self {
        Self {
            velocity: 0.0,
            ..self
        }
    }

    /// Whether both encoders show what they did before, but for their noise.
    fn stands_at(&self, from: &Self, still: [f64; 2]) -> bool {
        let ways = [self.theta - from.theta, self.q - from.q];
        ways.iter()
            .zip(still)
            .all(|(way, still)| way.abs() <= still)
    }
}

/// Velocity from which on friction is known to oppose the motion that ended, rad/s. Chosen; no experiment recorded.
const SLIDES: f64 = 0.05;
/// Shares of Coulomb friction by which a torque may rise in the direction in which the motor slid last, and otherwise,
/// before the motor moves. Static friction is up to 1.5 of sliding friction: 0.5 more onwards, and 1 + 1.5 where it has
/// to be overcome in the other direction.
const BREAKS_AWAY: [f64; 2] = [0.5, 2.5];

/// Share of Coulomb friction between static friction in one direction and in the other.
const FROM_REST: f64 = 3.0;

/// Ways at the end of which a motor may stand at once, from which on half of the samples are enough.
/// Chosen; no experiment recorded.
const CERTAIN: f64 = 3.0;

/// Samples for which one counts at most, by the torque over the one that would move the motor: a drive whose encoder
/// stands still is the faster the more it presses. Chosen on the simulated leg: its knee, stopped at a quarter of its
/// velocity limit, moves by 2.0 degrees where each counts once, and by 1.1 so.
const MOST: f64 = 3.0;

/// Samples whose mean a standstill of two encoders goes on from where noise leaves the first one. Chosen on a simulated
/// leg that shares no code with this project, all of whose encoders froze at a turn: without it noise began the standstill
/// anew under full torque. In 4 of 30 runs a joint was not found, and moved by 80 degrees. Only a torque that winds the
/// gear up is judged from there, as a sound joint that turns round stays near both places for longer than near one.
const FIRST: u32 = 8;

/// No sample yet with a torque that would move the motor.
const NOT_PUSHED: (u32, f64) = (0, 0.0);

/// Longest time, squared, for which an angle may stay within a way of where it was, by that way over the mean change of
/// its acceleration meanwhile, where that changes evenly from one sign to the other. By trying all velocities.
const HIDES: f64 = 62.0;

/// Torque that brings a joint to rest on one and a half ways, over `hidden` and the square of its velocity: a third, and
/// less as the joint is slower at the end of the way by which its velocity is taken. Chosen on a simulated arm of another
/// make, whose sound motion latched a fault with 0.2.
const STOPS: f64 = 0.1;

/// Where a motor stands since its last motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Standstill {
    from: MotorSample,
    /// Mean of angles and torque of its first samples.
    mean: MotorSample,
    /// Whether the motor moved too fast before to stand all at once.
    halted: bool,
    /// Whether the motor moved so fast that no impact explains its standstill.
    certain: bool,
    /// Whether the motor came to stand in or right after a gap: by sliding, or at rest before.
    unknown: bool,
    /// Samples in a row with a torque that would move it, or since it halted; a greater torque counts several times.
    pressed: u32,
    /// Samples in a row with such a torque, and the sum of what it is beyond the one that holds, N·m.
    pushed: (u32, f64),
    /// Samples since the motor stands.
    stood: u32,
    /// Velocity with which it came to stand, in ways that its only encoder's noise hides, a sample.
    entry: f64,
    /// Samples since a drive has begun to take the torque over from a brake.
    taken_over: u32,
}

impl Standstill {
    /// This standstill where no velocity of before counts, only torque that winds the gear up.
    pub(super) fn without_velocity(self) -> Self {
        Self {
            from: self.from.without_velocity(),
            mean: self.mean.without_velocity(),
            halted: false,
            certain: false,
            unknown: true,
            ..self
        }
    }

    /// After one more sample; `in_a_row`: the one before was that of the last cycle.
    pub(super) fn after(
        last: Option<Self>,
        in_a_row: bool,
        sample: MotorSample,
        p: &PlausibilityParameters,
    ) -> Self {
        match last {
            Some(last) if sample.stands_at(&last.from, p.still) => last.goes_on(&sample, p),
            Some(last) if p.winds() && sample.stands_at(&last.mean, p.still) => {
                let (from, halted, certain) = (last.mean, false, false);
                let on = Self {
                    from,
                    halted,
                    certain,
                    ..last
                };
                on.goes_on(&sample, p)
            }
            last => {
                let moving = last.filter(|last| in_a_row && last.pressed == 0);
                let way = moving.map_or(0.0, |last| (sample.theta - last.from.theta).abs());
                let samples = moving.map_or(1, |last| last.stood.saturating_add(1));
                Self {
                    from: sample,
                    // The direction of the last slide is that of friction; two encoders judge by the gear's torsion alone.
                    mean: MotorSample {
                        velocity: if p.torsion_shows.is_finite() {
                            0.0
                        } else {
                            sample.velocity
                        },
                        ..sample
                    },
                    halted: way > p.stop_way,
                    certain: way > CERTAIN * p.stop_way,
                    unknown: false,
                    pressed: 0,
                    pushed: NOT_PUSHED,
                    stood: 0,
                    entry: way / (p.still[0] * f64::from(samples)),
                    taken_over: 0,
                }
            }
        }
    }

    fn goes_on(mut self, sample: &MotorSample, p: &PlausibilityParameters) -> Self {
        self.stood = self.stood.saturating_add(1);
        if self.stood < FIRST {
            let share = 1.0 / f64::from(self.stood + 1);
            self.mean.theta += share * (sample.theta - self.mean.theta);
            self.mean.q += share * (sample.q - self.mean.q);
            self.mean.torque += share * (sample.torque - self.mean.torque);
        }
        let takes_over = sample.driven && !self.from.driven;
        if count_in_a_row(&mut self.taken_over, takes_over) >= p.samples_to_trust {
            (self.from, self.mean) = (*sample, *sample);
        }
        let change = sample.torque - self.from.torque;
        let moved = self.from.velocity.abs() > SLIDES;
        let onwards = change * self.from.velocity > 0.0;
        let share = BREAKS_AWAY[usize::from(!(onwards && moved))];
        let is_judged = moved && sample.driven || !p.holds_itself;
        let over = |least: f64| change.abs() / least;
        let held = share * p.friction + p.torque_margin;
        let moves = if is_judged { over(held) } else { 0.0 };
        // A hand changes the torque of a drive that holds, and a wall stops a link: neither stops a motor that is asked
        // to turn before it has wound the gear up.
        let asked = (sample.target - self.from.target) * change.signum();
        let is_asked = sample.driven && self.from.driven && asked > p.asked;
        let swallowed = if sample.warned {
            p.friction
        } else {
            let share = if self.unknown {
                FROM_REST
            } else {
                BREAKS_AWAY[1]
            };
            share * p.friction + p.torque_margin
        };
        let turns = if !is_asked {
            0.0
        } else if sample.warned && p.motor_shows.is_finite() {
            over(swallowed + p.torque_margin)
        } else {
            over(swallowed + p.motor_shows)
        };
        // A brake that opens hands the motor a torque that has wound the gear up already.
        let winds_up = if sample.driven && self.from.driven {
            over(swallowed + p.torsion_shows)
        } else {
            0.0
        };
        let is_pushed = moves > 1.0 || is_asked && over(held) > 1.0;
        let over = moves.max(winds_up).max(turns);
        if self.halted || over > 1.0 {
            self.pressed = self.pressed.saturating_add(over.clamp(1.0, MOST) as u32);
        } else {
            self.pressed = 0;
        }
        self.pushed = match self.pushed {
            (samples, sum) if is_pushed => (samples.saturating_add(1), sum + change.abs() - held),
            _ => NOT_PUSHED,
        };
        self
    }

    /// Whether the motor stands although it cannot, and has for long enough: `samples_to_doubt`, or half of them where
    /// that is certain, and until a joint that only turns round would have left the encoder's counts.
    pub(super) fn is_impossible(&self, p: &PlausibilityParameters) -> bool {
        let enough = p.samples_to_doubt / if self.certain { 2 } else { 1 };
        self.pressed >= enough && (self.halted || !self.turns_round(p))
    }

    /// Whether a joint that has only one encoder may just turn round within its counts.
    fn turns_round(&self, p: &PlausibilityParameters) -> bool {
        let (samples, sum) = self.pushed;
        // Torque that brings it to rest, and the greatest that it may have had.
        let stops = STOPS * p.hidden * self.entry * self.entry;
        let there_was = self.from.torque.abs() + sum / f64::from(samples.max(1)) + p.friction;
        stops < there_was && f64::from(samples) * sum < HIDES * p.hidden
    }
}
