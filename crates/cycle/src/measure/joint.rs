//! One joint: from its decoded signals to the sample of its estimators, its angles for the filters, and what its
//! encoders are worth.

use estimators::encoder::JointAngles;
use estimators::front_end::FrontEnd;
use estimators::joint::JointSample;
use problem::Problem;
use robot_config::{JointCalibration, JointParameters, slots};
use robot_state::{Event, JointCommanded, JointMeasured, command_flags, measured_flags};
use supervisor::{MotorSample, Plausibility, Sample, Trust};

use super::filtered::Course;
use super::reception::{Reading, Reception, Source};
use super::reported::Reported;
use super::{JointReadiness, NOT_USED};
use crate::events::{Counts, Subject};
use crate::time::Instants;

/// A joint's angles of one cycle as its filters take them, rad; NaN where they are to bridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FilterAngles {
    /// q for the equations of motion.
    pub(super) q: f64,
    /// q and theta/N for the velocities of control, which go on by changes of readings where only those are known.
    pub(super) control: [f64; 2],
}

/// Reads one joint from cycle to cycle.
#[derive(Debug)]
pub(super) struct JointReader {
    index: usize,
    source: Source,
    /// The drive sends the motor's velocity.
    sends_velocity: bool,
    reported: Reported,
    front_end: FrontEnd,
    plausibility: Plausibility,
    /// Link-side and motor-side angle of the filters of control.
    courses: [Course; 2],
    /// 1/N.
    link_per_motor: f64,
    /// Torque per current, link side, N·m/A.
    torque_per_current: f64,
    sample_period: f64,
    /// Time for which answers were missed, less half of that for which they came, s.
    lacking_s: f64,
    /// The drive has followed set-points since the last cycle.
    driven: bool,
    /// Encoders of another joint are known to stand still.
    warned: bool,
    /// The set-point of the last cycle, rad.
    target: f64,
    /// Torsion that the estimated torque explains, rad; none with a link-side encoder.
    torsion: Option<f64>,
    /// Motor-side and link-side angle as they were read last, trusted or not, rad, link side.
    shown: [f64; 2],
}

impl JointReader {
    /// The reader of joint `index`; `period` of the cycle, s. Errors: windows of velocity that cannot be built.
    pub(super) fn new(
        index: usize,
        joint: &JointParameters,
        reception: &Reception,
        period: f64,
    ) -> Result<Self, Problem> {
        let encoders = &joint.encoders;
        let (n, step) = (encoders.gear_ratio, encoders.max_velocity * period);
        let calibration = joint.calibration.as_ref();
        Ok(Self {
            index,
            source: source(index, joint, reception),
            sends_velocity: joint.has_velocity,
            reported: Reported::new(index, joint, reception),
            front_end: if joint.has_link_encoder {
                FrontEnd::new(
                    *encoders,
                    calibration.map(JointCalibration::velocity_window),
                )?
            } else {
                FrontEnd::of_motor(*encoders)
            },
            plausibility: Plausibility::new(joint.plausibility),
            courses: [step, step * n].map(Course::new),
            link_per_motor: 1.0 / n,
            torque_per_current: n * joint.estimator.wave_generator.torque_constant,
            sample_period: period,
            lacking_s: 0.0,
            driven: false,
            warned: false,
            target: f64::NAN,
            torsion: (!joint.has_link_encoder).then_some(0.0),
            shown: [0.0; 2],
        })
    }

    /// Takes the last cycle's command, whether an encoder is known to be wrong, and whether those of another joint are
    /// known to stand still.
    pub(super) fn learn(&mut self, command: &JointCommanded, distrusted: bool, warned: bool) {
        self.driven = command.flags & command_flags::ENGAGED != 0;
        self.warned = warned;
        // A joint that is distrusted is led by torque: its drive is not asked to turn anywhere.
        let led = matches!(self.plausibility.trust(), Trust::Plausible | Trust::Suspect);
        self.target = if led { command.q_c } else { f64::NAN };
        if distrusted {
            self.plausibility.distrust();
        }
    }

    /// Takes the torsion that the estimated torque explains, rad; nothing where a link-side encoder measures it.
    pub(super) fn explain(&mut self, torsion: f64) {
        if let Some(known) = &mut self.torsion
            && torsion.is_finite()
        {
            *known = torsion;
        }
    }

    /// Encoders that contradicted each other are to prove themselves anew.
    pub(super) fn restart_if_distrusted(&mut self) {
        if self.plausibility.trust() == Trust::Implausible {
            self.plausibility.restart();
            self.front_end.reset();
        }
    }

    /// The loop did not run for some cycles, each of which [`skip`](Self::skip) follows.
    pub(super) fn note_gap(&mut self) {
        self.plausibility.note_gap();
    }

    /// One cycle without a sample, as the loop did not run.
    pub(super) fn skip(&mut self) {
        self.front_end.update(f64::NAN, f64::NAN, f64::NAN);
        self.plausibility.update(Sample::Missed);
    }

    /// The drive sends the motor's velocity.
    pub(super) fn sends_velocity(&self) -> bool {
        self.sends_velocity
    }

    /// Samples bring velocities of the estimators' own.
    pub(super) fn has_velocities(&self) -> bool {
        self.front_end.has_velocities()
    }

    /// Whether the joint's samples can be relied on; `flags`: of its record.
    pub(super) fn readiness(&self, flags: u32) -> JointReadiness {
        let trust = self.plausibility.trust();
        JointReadiness {
            plausible: matches!(trust, Trust::Plausible | Trust::Suspect),
            stale: flags & measured_flags::STALE != 0,
            distrusted: trust == Trust::Implausible,
            slipped: self.plausibility.has_slipped(),
            blind: self.plausibility.is_blind(),
            shown: self.shown,
        }
    }

    /// Reads one cycle into the joint's record and, where it can be used, into its sample.
    pub(super) fn read(
        &mut self,
        reception: &Reception,
        at: Instants,
        measured: &mut JointMeasured,
        sample: &mut JointSample,
        counts: &mut Counts,
    ) -> FilterAngles {
        let mut reading = reception.reading(&mut self.source, at, counts);
        reading.flags |= self.lacking(reading.flags, reception.stale_after_s());
        let (new, mut angles) = self.angles(reception, &reading);
        let flags = reading.flags | angles.flags | self.implausible(&angles);
        let used = flags & NOT_USED == 0;
        if used {
            *sample = new;
        }
        if flags & NOT_USED & !measured_flags::IMPLAUSIBLE == 0 {
            self.plausibility.watch_motor(MotorSample {
                theta: angles.theta,
                q: angles.q,
                velocity: measured.omega * self.link_per_motor,
                torque: reception.slot(slots::current(self.index)) * self.torque_per_current,
                target: self.target,
                driven: self.driven,
                warned: self.warned,
            });
        }
        if let Some(torsion) = self.torsion {
            (angles.q, angles.torsion) = (angles.q - torsion, torsion);
        }
        self.note(flags, counts);
        let lost = self.is_lost(flags);
        self.record_angles(&angles, used, lost, measured);
        // A frame with an angle that cannot be right is not believed in anything else either.
        if reading.usable && (used || lost) {
            self.record_drive(reception, measured);
        }
        self.reported.read(reception, at.now, measured);
        (measured.age_s, measured.flags) = (reading.age_s, flags);
        // Encoders that contradict each other still show how fast they move.
        let moves = lost && reading.usable;
        self.filter_angles(&angles, used, lost, moves, measured)
    }

    /// The flag of a joint that is stale though it answers now and then: where more than a third of the answers is missed, it
    /// goes on by its last velocity most of the time, and would never stop by itself.
    fn lacking(&mut self, flags: u32, stale_after_s: f64) -> u32 {
        let missed = flags & (measured_flags::MISSED | measured_flags::NEVER);
        if missed != measured_flags::MISSED {
            self.lacking_s = (self.lacking_s - 0.5 * self.sample_period).max(0.0);
            return 0;
        }
        // Bounded, so that a joint that was silent for long is not stale for long after that.
        self.lacking_s = (self.lacking_s + self.sample_period).min(2.0 * stale_after_s);
        if self.lacking_s > stale_after_s {
            measured_flags::STALE
        } else {
            0
        }
    }

    /// The sample and the angles of what was received.
    fn angles(&mut self, reception: &Reception, reading: &Reading) -> (JointSample, JointAngles) {
        let slot = |slot: usize| {
            if reading.usable {
                reception.slot(slot)
            } else {
                f64::NAN
            }
        };
        let sample = self.front_end.update(
            slot(slots::motor_angle(self.index)),
            slot(slots::link_angle(self.index)),
            slot(slots::current(self.index)),
        );
        let angles = *self.front_end.angles();
        let [theta, q] = self.front_end.read();
        self.shown = [theta * self.link_per_motor, q];
        (sample, angles)
    }

    /// Silence, lost samples and jumps become events.
    fn note(&mut self, flags: u32, counts: &mut Counts) {
        if flags & measured_flags::STALE != 0 {
            self.plausibility.note_silence();
        }
        if flags & measured_flags::MISSED != 0 {
            counts.add_of(Event::JointMissed, Subject::Joint(self.index));
        }
        if flags & measured_flags::JUMP != 0 {
            counts.add_of(Event::EncoderJump, Subject::Joint(self.index));
        }
    }

    fn record_angles(
        &self,
        angles: &JointAngles,
        used: bool,
        lost: bool,
        measured: &mut JointMeasured,
    ) {
        if used {
            measured.q = angles.q;
            measured.theta = angles.theta;
            measured.torsion = angles.torsion;
        } else if !lost {
            // Bridged at the last velocity: a lost reply must not step the torque.
            measured.q += measured.dq * self.sample_period;
            measured.theta += measured.omega * self.sample_period;
        }
    }

    fn record_drive(&self, reception: &Reception, measured: &mut JointMeasured) {
        measured.current = reception.slot(slots::current(self.index));
        measured.status = reception.slot(slots::status(self.index)) as u32;
        if self.sends_velocity {
            measured.omega = reception.slot(slots::velocity(self.index));
        }
    }

    fn filter_angles(
        &mut self,
        angles: &JointAngles,
        used: bool,
        lost: bool,
        moves: bool,
        measured: &JointMeasured,
    ) -> FilterAngles {
        let (q, theta) = match (used, lost) {
            (true, _) => (angles.q, angles.theta),
            // Filters that bridge for ever would extrapolate the last velocity for ever.
            (false, true) => (measured.q, measured.theta),
            (false, false) => (f64::NAN, f64::NAN),
        };
        let [link, motor] = &mut self.courses;
        FilterAngles {
            q,
            control: [
                link.follow(q, moves.then_some(angles.q)),
                motor.follow(theta, moves.then_some(angles.theta)),
            ],
        }
    }

    /// No sample of the joint has been used for so long that bridging ends: its angles stay where
    /// they are.
    fn is_lost(&self, flags: u32) -> bool {
        let distrusted = self.plausibility.trust() == Trust::Implausible;
        flags & measured_flags::NEVER == 0 && (flags & measured_flags::STALE != 0 || distrusted)
    }

    /// The flag of a sample that the joint's encoders cannot both have measured.
    fn implausible(&mut self, angles: &JointAngles) -> u32 {
        let sample = if angles.flags & measured_flags::JUMP != 0 {
            Sample::Jump {
                again: self.front_end.stays_elsewhere(),
            }
        } else if angles.flags != 0 {
            Sample::Missed
        } else {
            Sample::Angles {
                torsion: angles.torsion,
                motor: angles.theta * self.link_per_motor,
            }
        };
        let good = match sample {
            Sample::Angles { torsion, .. } => self.plausibility.explains(torsion),
            Sample::Missed => true,
            Sample::Jump { .. } => false,
        };
        match self.plausibility.update(sample) {
            Trust::Plausible => 0,
            // Nothing depends on it yet; the filters fill.
            Trust::Settling if good => 0,
            Trust::Settling | Trust::Implausible => {
                if !good && !self.plausibility.has_slipped() {
                    // Wrong first readings, few or many, must not stand in the way of the right ones.
                    self.front_end.reset();
                }
                measured_flags::IMPLAUSIBLE
            }
            Trust::Suspect => measured_flags::IMPLAUSIBLE,
        }
    }
}

/// The messages and signals of a joint's sample. The current comes first: it is monitored.
fn source(index: usize, joint: &JointParameters, reception: &Reception) -> Source {
    let mut needed = vec![slots::current(index), slots::motor_angle(index)];
    if joint.has_link_encoder {
        needed.push(slots::link_angle(index));
    }
    if joint.has_velocity {
        needed.push(slots::velocity(index));
    }
    if joint.has_status {
        needed.push(slots::status(index));
    }
    reception.source(needed, joint.sampling, &[joint.current_signal], false)
}
