//! Plausibility of one joint's samples: whether its two encoders can both be right.
//!
//! A gear winds up by what its torque explains and no further. A torsion `theta/N - q` beyond
//! that, or an encoder that moved further than its joint can, means that one of the two encoders
//! is wrong, and nobody knows which: such a sample is not used. A joint is plausible after a
//! number of good samples in a row, and implausible after a number of bad ones, so that one
//! corrupt frame neither starts nor stops a robot. A motor whose torque changes by more than its
//! friction holds moves, or its encoders do not show it. A rotor's inertia lets its velocity change
//! only as fast as torque can: a motor-side angle that steps has jumped, also where the link side's
//! jumps alike and the torsion does not show it. An encoder that has slipped makes its joint
//! implausible until an operator, who has looked after it, acknowledges the fault.

mod standstill;
mod steps;
#[cfg(test)]
mod tests;

use crate::in_a_row::count_in_a_row;
pub use standstill::MotorSample;
use standstill::Standstill;
use steps::{Course, JITTER, Least, Step, Steps};

/// Limits of a plausible sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlausibilityParameters {
    /// Greatest |theta/N - q| that the gear can reach, rad: wind-up at its torque limit with a
    /// margin, kinematic error, backlash.
    pub torsion: f64,
    /// A torsion that steps by more from one sample to the next and then goes on as before, rad,
    /// is an encoder's step: an impact changes a velocity, not a position.
    pub step: f64,
    /// A torsion that is beside its course by more than this, rad, is not used until the next sample shows that it
    /// goes on from there: one wrong sample is not to be felt. No more than `step`.
    pub beside: f64,
    /// Step of the motor-side angle that is an encoder's, rad, link side: what torque can make of the rotor's velocity
    /// within a sample, and a count; infinite where samples are not taken at the cycle's instants.
    pub motor_step: f64,
    /// A motor-side angle that is off its course after readings that jumped, by more than this for each
    /// of them, rad, link side, has stepped: a second encoder shows it only where it did not slip as well.
    pub jump: f64,
    /// Good samples in a row after which a joint is plausible.
    pub samples_to_trust: u32,
    /// Bad samples in a row after which it is no longer.
    pub samples_to_doubt: u32,
    /// Torque of the motor's Coulomb friction, N·m.
    pub friction: f64,
    /// Further change of the motor's torque that is no sign of motion, N·m.
    pub torque_margin: f64,
    /// Greatest way of the motor within a sample, rad, at the end of which it can stand at once;
    /// infinite where a standstill is not judged.
    pub stop_way: f64,
    /// A drive that takes positions holds its motor itself, whatever the torque: only a standstill that ends a motion
    /// is judged by it.
    pub holds_itself: bool,
    /// Torque on the gear from which on its torsion changes by more than the noise of both encoders, N·m; infinite where
    /// one of them is missing.
    pub torsion_shows: f64,
    /// Torque that turns a motor by more than the noise of its encoder though its link is blocked, as it winds up the
    /// gear, N·m; infinite with two encoders, which show that by themselves.
    pub motor_shows: f64,
    /// Way of a joint's set-point from which on its drive is to turn the motor, rad.
    pub asked: f64,
    /// Way by which the noise of an encoder that stands still moves its angle: motor and link side, rad.
    pub still: [f64; 2],
    /// Torque that moves the joint within a sample squared by the way that its only encoder's noise hides, N·m; 0 with two
    /// encoders, between which the gear winds up at once.
    pub hidden: f64,
}

impl PlausibilityParameters {
    /// Whether a motor that stands is judged by what winds its gear up.
    fn winds(&self) -> bool {
        self.torsion_shows.is_finite() || self.holds_itself
    }

    /// Whether a motor that stands is judged by what winds its gear up, and by that alone where its velocity before is
    /// not known.
    fn winds_alone(&self) -> bool {
        self.torsion_shows.is_finite() && self.holds_itself
    }

    /// These, for encoders that are `times` as noisy.
    fn with_noise(&self, times: f64) -> Self {
        Self {
            still: self.still.map(|way| times * way),
            torsion_shows: times * self.torsion_shows,
            ..*self
        }
    }

    /// Greatest change of the velocity of either encoder within a sample, rad/s: by what torque makes of
    /// the rotor, and by what an impact winds up of the gear; 0 where samples are not taken at the cycle's
    /// instants.
    #[must_use]
    pub fn velocity_change(&self, sample_period: f64) -> f64 {
        if self.motor_step.is_finite() {
            (self.motor_step + self.step) / sample_period
        } else {
            0.0
        }
    }
}

/// One sample of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sample {
    /// A fresh and finite sample.
    Angles {
        /// theta/N - q: torsion, rad.
        torsion: f64,
        /// theta/N: motor-side angle on the link side, rad.
        motor: f64,
    },
    /// No sample came in time.
    Missed,
    /// An encoder moved further than its joint can.
    Jump {
        /// To where it had in the sample before.
        again: bool,
    },
}

/// How far a joint is to be believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Trust {
    /// Not enough good samples yet.
    #[default]
    Settling,
    /// Good.
    Plausible,
    /// This sample is bad; too few in a row to distrust the joint.
    Suspect,
    /// Bad for longer than a disturbance lasts.
    Implausible,
}

/// Samples after a gap for which a standstill is not judged: velocities come from windows of 16 samples, half of which
/// they are late, and a drive has come to rest after as many.
const GAP_SAMPLES: u32 = 32;

/// Noise of the encoders, by that of their parameters, that does not end a standstill which only adds to what else
/// speaks against a joint. Chosen on a simulated leg that shares no code with this project.
const KEPT_NOISE: f64 = 2.0;

/// Follows one joint.
#[derive(Debug, Clone)]
pub struct Plausibility {
    parameters: PlausibilityParameters,
    trust: Trust,
    good: u32,
    bad: u32,
    torsion: Steps,
    motor: Steps,
    /// A standstill, and one that no gap ends: that only adds to what else speaks against the joint.
    standstills: [Option<Standstill>; 2],
    /// The last sample was that of the cycle before.
    in_a_row: bool,
    /// Samples that a standstill is not judged by, as velocities are still those of before a gap.
    unjudged: u32,
    /// The courses of torsion and motor-side angle before readings that jumped, and how many did.
    jumped: Option<([Course; 2], u32)>,
    /// An encoder has slipped, or trust was lost otherwise: what is measured from then on is wrong by
    /// an unknown angle.
    slipped: bool,
    /// Not a count of either encoder changes though the motor moves.
    blind: bool,
}

impl Plausibility {
    /// Plausibility of a joint that has not sent anything.
    #[must_use]
    pub fn new(parameters: PlausibilityParameters) -> Self {
        Self {
            parameters,
            trust: Trust::Settling,
            good: 0,
            bad: 0,
            torsion: Steps::default(),
            motor: Steps::default(),
            standstills: [None; 2],
            in_a_row: false,
            unjudged: 0,
            jumped: None,
            slipped: false,
            blind: false,
        }
    }

    /// Takes the sample of a cycle.
    pub fn update(&mut self, sample: Sample) -> Trust {
        let trusted = matches!(self.trust, Trust::Plausible | Trust::Suspect);
        let good = match sample {
            // Neither good nor bad: age is judged elsewhere.
            Sample::Missed => {
                self.forget();
                return self.trust;
            }
            Sample::Jump { again } => {
                // No frame is corrupted twice alike. A position drive that feels the step moves its joint meanwhile.
                self.slipped |= again && trusted;
                let courses = self.torsion.course.zip(self.motor.course);
                let jumped = match (self.jumped, courses) {
                    (Some((before, readings)), _) => Some((before, readings.saturating_add(1))),
                    (None, courses) => courses.map(|(torsion, motor)| ([torsion, motor], 1)),
                };
                self.forget();
                self.jumped = jumped;
                false
            }
            Sample::Angles { torsion, motor } => {
                // A joint that is not trusted may step back to what is right.
                let stepped = if trusted {
                    self.follow(torsion, motor)
                } else {
                    self.forget();
                    Step::None
                };
                self.slipped |= stepped == Step::Confirmed;
                if self.slipped {
                    self.trust = Trust::Implausible;
                    return self.trust;
                }
                // NaN is not within.
                stepped == Step::None && self.explains(torsion)
            }
        };
        let p = &self.parameters;
        let settled = count_in_a_row(&mut self.good, good) >= p.samples_to_trust;
        let doubted = count_in_a_row(&mut self.bad, !good) >= p.samples_to_doubt;
        // Readings that agree with each other again may still be another joint's.
        self.slipped |= doubted && trusted;
        self.trust = match self.trust {
            _ if self.slipped => Trust::Implausible,
            _ if settled => Trust::Plausible,
            _ if doubted => Trust::Implausible,
            Trust::Plausible | Trust::Suspect if good => Trust::Plausible,
            Trust::Plausible | Trust::Suspect => Trust::Suspect,
            other => other,
        };
        self.trust
    }

    /// Takes the motor's state by a sample: one that cannot stand still where it shows no motion counts like a slip
    /// ([`Standstill`]).
    pub fn watch_motor(&mut self, sample: MotorSample) {
        let judged = self.unjudged == 0;
        let resumed = self.unjudged == GAP_SAMPLES;
        self.unjudged = self.unjudged.saturating_sub(1);
        let in_a_row = self.in_a_row && judged;
        let [last, kept] = self.standstills;
        let (p, wide) = (&self.parameters, &self.parameters.with_noise(KEPT_NOISE));
        // Right after a gap a drive may have stopped, or turned its motor back, unseen.
        let (last, seen) = match last {
            last if judged => (last, sample),
            Some(last) if p.winds_alone() && !resumed => {
                (Some(last.without_velocity()), sample.without_velocity())
            }
            _ => (None, sample),
        };
        let last = Standstill::after(last, in_a_row, seen, p);
        let kept = Standstill::after(kept, in_a_row, sample, wide);
        (self.standstills, self.in_a_row) = ([Some(last), Some(kept)], true);
        let (alone, added) = (last.is_impossible(p), kept.is_impossible(wide));
        if !(alone || added && (sample.warned || self.slipped)) {
            return;
        }
        // For a joint distrusted for a step before, a standstill means more: no encoder is left to go by.
        self.blind |= self.slipped;
        if matches!(self.trust, Trust::Plausible | Trust::Suspect) {
            (self.slipped, self.blind) = (true, true);
            self.trust = Trust::Implausible;
        }
    }

    fn forget(&mut self) {
        (self.torsion, self.motor) = (Steps::default(), Steps::default());
        (self.jumped, self.in_a_row) = (None, false);
    }

    /// Whether torsion or motor-side angle left its course by a step.
    fn follow(&mut self, torsion: f64, motor: f64) -> Step {
        let p = &self.parameters;
        if let Some((before, readings)) = self.jumped.take() {
            let expected = before.map(|x| x.angle + x.rate * f64::from(readings + 1));
            let off = [torsion - expected[0], motor - expected[1]].map(f64::abs);
            if off[0] > p.step || off[1] > p.jump * f64::from(readings) {
                return Step::Confirmed;
            }
        }
        let of_torsion = Least {
            beside: p.beside,
            step: p.step,
            jitter: 0.0,
        };
        let of_motor = Least {
            beside: p.motor_step,
            step: p.motor_step,
            jitter: JITTER,
        };
        let torsion = self.torsion.follow(torsion, of_torsion);
        torsion.max(self.motor.follow(motor, of_motor))
    }

    /// Whether the gear can reach this torsion, rad.
    #[must_use]
    pub fn explains(&self, torsion: f64) -> bool {
        torsion.abs() <= self.parameters.torsion
    }

    /// An encoder is wrong, as something else than the torsion's course has shown.
    pub fn distrust(&mut self) {
        (self.slipped, self.trust) = (true, Trust::Implausible);
    }

    /// Begins anew, as after a start.
    pub fn restart(&mut self) {
        *self = Self::new(self.parameters);
    }

    /// The loop has not run for some cycles: the drive has brought the motor to its last set-point meanwhile, and the
    /// velocity of before says nothing of how it came to stand.
    pub fn note_gap(&mut self) {
        self.unjudged = GAP_SAMPLES;
    }

    /// The joint sends nothing. It may come back elsewhere: until it has proved itself again, filters
    /// hold the step, and with it a velocity that the joint does not have.
    pub fn note_silence(&mut self) {
        if self.trust != Trust::Implausible {
            self.restart();
        }
    }

    /// An encoder has slipped, or trust was lost, since the joint was restarted.
    #[must_use]
    pub fn has_slipped(&self) -> bool {
        self.slipped
    }

    /// Not a count of either encoder has changed though the motor must have moved: nothing shows where the joint is.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        self.blind
    }

    /// The trust after the last sample.
    #[must_use]
    pub fn trust(&self) -> Trust {
        self.trust
    }
}
