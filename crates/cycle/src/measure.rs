//! Measure: from frames to joint angles, currents, wrenches and motion, in SI units.
//!
//! In: the frames of one cycle. Out: [`MeasuredRecord`], one sample of each joint for the joint
//! estimators, and all signals of the equations of motion through filters of one delay: long ones
//! for feedback, short ones for the delay-compensated torque.

mod align;
mod filtered;
mod ft_offset;
mod gear_torsion;
mod imu_check;
mod imus;
mod publish;
mod reception;
mod reported;
mod sensors;
mod skipped;

use can_codec::Frames;
use estimators::encoder::JointAngles;
use estimators::front_end::FrontEnd;
use estimators::joint::JointSample;
use problem::Problem;
use robot_config::{JointCalibration, Robot, slots};
use robot_state::{
    CycleRecord, Event, JointMeasured, MeasuredRecord, Settings, command_flags, measured_flags,
};
use supervisor::{MotorSample, Plausibility, Sample, Trust};

use crate::events::{Counts, Subject};
use crate::time::{Instants, Stamp};
use align::{AlignedBank, signals};
use filtered::{AXES, Course, Filtered};
use ft_offset::FtInput;
use gear_torsion::GearTorsion;
use imu_check::ImuCheck;
use imus::Imus;
use reception::{Reception, Source};
use reported::Reported;

/// A joint's sample with one of these is bridged.
pub(crate) const NOT_USED: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::JUMP
    | measured_flags::IMPLAUSIBLE;

/// Whether one joint's samples can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct JointReadiness {
    /// Its encoders agree, and have done so for long enough.
    pub(crate) plausible: bool,
    /// It has sent no usable sample for longer than allowed.
    pub(crate) stale: bool,
    /// Its encoders contradict each other.
    pub(crate) distrusted: bool,
    /// One of its encoders has slipped.
    pub(crate) slipped: bool,
    /// Neither of its encoders shows any more where it is.
    pub(crate) blind: bool,
    /// Motor-side and link-side angle as they were read last, whether they are trusted or not, rad,
    /// link side.
    pub(crate) shown: [f64; 2],
}

/// Later steps that this cycle's measured values are good enough for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Readiness<'m> {
    pub(crate) joints: &'m [JointReadiness],
    /// Every joint has answered, and its filters are full.
    pub(crate) joints_ready: bool,
    /// Every F/T sensor and IMU has, and their filters are full.
    pub(crate) sensors_ready: bool,
    /// The loop has not run for longer than samples may be old: what was followed before is over.
    pub(crate) overslept: bool,
}

/// The joints and sensors of a robot, followed from cycle to cycle.
#[derive(Debug)]
pub(crate) struct Measure {
    reception: Reception,
    joints: Vec<Source>,
    sensors: Vec<Source>,
    ft_inputs: Vec<FtInput>,
    imu_sources: Vec<(Source, ImuCheck)>,
    imus: Imus,
    /// The first IMU seems sound and is not, since the last cycle.
    imu_doubted: bool,
    sample_period: f64,
    stale_after: f64,
    sends_velocity: Vec<bool>,
    reported: Vec<Reported>,
    /// Builds each joint's sample for its estimators from its readings.
    front_ends: Vec<FrontEnd>,
    /// For the torque from F/T sensors and IMU, contacts and feedback.
    long: Filtered,
    /// For the delay-compensated torque.
    short: Filtered,
    /// For the detection of contacts, if there is one.
    contact: Option<Filtered>,
    /// q of every joint, then theta of every joint: first derivative.
    control_filter: AlignedBank,
    angles: Vec<f64>,
    both_angles: Vec<f64>,
    courses: Vec<[Course; 2]>,
    axes: Vec<f64>,
    samples: Vec<JointSample>,
    plausibility: Vec<Plausibility>,
    /// 1/N, and torque per current, link side, N·m/A.
    motors: Vec<[f64; 2]>,
    /// Whether each joint's drive has followed set-points since the last cycle.
    driven: Vec<bool>,
    /// Torsion that the estimated torque explains, rad, of joints without a link-side encoder.
    torsions: Vec<Option<f64>>,
    gear_torsion: GearTorsion,
    joint_readiness: Vec<JointReadiness>,
    last_sync: Option<Stamp>,
    /// Periods before this cycle in which the loop did not run.
    skipped: u32,
    /// All flags of the joints, and of the sensors.
    joint_flags: u32,
    sensor_flags: u32,
}

impl Measure {
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let reception = Reception::new(robot);
        let n = parameters.joints.len();
        let axes = AXES * (parameters.ft_sensors.len() + parameters.imus.len());
        let period = parameters.timing.sample_period;
        let [_, control, _] = signals(robot);
        let joints = parameters.joints.iter().enumerate().map(|(j, joint)| {
            // The current first: it is monitored.
            let mut needed = vec![slots::current(j), slots::motor_angle(j)];
            if joint.has_link_encoder {
                needed.push(slots::link_angle(j));
            }
            if joint.has_velocity {
                needed.push(slots::velocity(j));
            }
            if joint.has_status {
                needed.push(slots::status(j));
            }
            let current = [joint.current_signal];
            reception.source(needed, joint.sampling, &current, false)
        });
        let sensors = parameters.ft_sensors.iter().enumerate().map(|(s, ft)| {
            let temperature = ft.has_temperature.then(|| slots::ft_temperature(s));
            let axes = (0..AXES).map(|axis| slots::ft(s, axis));
            let slots = axes.chain(temperature).collect();
            reception.source(slots, ft.sampling, &ft.signals, true)
        });
        Ok(Self {
            joints: joints.collect(),
            sensors: sensors.collect(),
            ft_inputs: parameters.ft_sensors.iter().map(FtInput::new).collect(),
            imu_sources: (parameters.imus.iter().enumerate())
                .map(|(i, imu)| {
                    let gyro = (0..3).map(|axis| slots::gyro(i, axis));
                    let axes = gyro.chain((0..3).map(|axis| slots::accelerometer(i, axis)));
                    let source = reception.source(axes.collect(), imu.sampling, &imu.signals, true);
                    (source, ImuCheck::new(imu.sampling.longest_gap(period)))
                })
                .collect(),
            imus: Imus::new(robot)?,
            imu_doubted: false,
            sample_period: period,
            stale_after: parameters.timing.stale_after,
            reported: (parameters.joints.iter().enumerate())
                .map(|(j, joint)| Reported::new(j, joint, &reception))
                .collect(),
            sends_velocity: parameters.joints.iter().map(|j| j.has_velocity).collect(),
            front_ends: (parameters.joints.iter())
                .map(|joint| {
                    let window = joint
                        .calibration
                        .as_ref()
                        .map(JointCalibration::velocity_window);
                    if joint.has_link_encoder {
                        FrontEnd::new(joint.encoders, window)
                    } else {
                        Ok(FrontEnd::of_motor(joint.encoders))
                    }
                })
                .collect::<Result<_, _>>()?,
            long: Filtered::new(robot, parameters.filters.long)?,
            short: Filtered::new(robot, parameters.filters.short)?,
            contact: (parameters.external_torque.as_ref())
                .map(|settings| Filtered::new(robot, settings.filters))
                .transpose()?,
            control_filter: AlignedBank::new(&control, parameters.filters.control, period)?,
            angles: vec![f64::NAN; n],
            both_angles: vec![f64::NAN; 2 * n],
            courses: filtered::courses(robot),
            axes: vec![f64::NAN; axes],
            samples: vec![JointSample::default(); n],
            plausibility: (parameters.joints.iter())
                .map(|joint| Plausibility::new(joint.plausibility))
                .collect(),
            driven: vec![false; parameters.joints.len()],
            motors: (parameters.joints.iter())
                .map(|joint| {
                    let n = joint.encoders.gear_ratio;
                    [1.0 / n, n * joint.estimator.wave_generator.torque_constant]
                })
                .collect(),
            torsions: (parameters.joints.iter())
                .map(|joint| (!joint.has_link_encoder).then_some(0.0))
                .collect(),
            gear_torsion: GearTorsion::new(robot),
            joint_readiness: vec![JointReadiness::default(); n],
            last_sync: None,
            skipped: 0,
            joint_flags: measured_flags::NEVER,
            sensor_flags: measured_flags::NEVER,
            reception,
        })
    }

    /// Takes what was learned in the last cycle: the joints of which an encoder is wrong, a bit each; whether an operator
    /// has acknowledged since, so that joints whose encoders contradicted each other are to prove themselves anew; and
    /// the torques, which explain the torsion of joints without a link-side encoder.
    pub(crate) fn learn(&mut self, distrusted: u64, acknowledged: bool, last: &CycleRecord) {
        for (driven, commanded) in self.driven.iter_mut().zip(&last.commanded.joints) {
            *driven = commanded.flags & command_flags::ENGAGED != 0;
        }
        for (j, plausibility) in self.plausibility.iter_mut().enumerate() {
            if distrusted >> j & 1 == 1 {
                plausibility.distrust();
            }
        }
        if acknowledged {
            self.restart_distrusted();
        }
        if self.last_sync.is_some() {
            let torsions = &mut self.torsions;
            let (measured, estimated) = (&last.measured.joints, &last.estimated.joints);
            (self.gear_torsion).update(measured, estimated, |j, torsion| {
                if let Some(Some(known)) = torsions.get_mut(j)
                    && torsion.is_finite()
                {
                    *known = torsion;
                }
            });
        }
    }

    /// Every joint's sample of this cycle, the input of the joint estimators.
    pub(crate) fn samples(&self) -> &[JointSample] {
        &self.samples
    }

    /// The signals through the long filters, delayed by `filter_delay_s` of the record.
    pub(crate) fn long(&self) -> &Filtered {
        &self.long
    }

    /// The signals through the short filters.
    pub(crate) fn short(&self) -> &Filtered {
        &self.short
    }

    /// Those of contact detection.
    pub(crate) fn contact(&self) -> Option<&Filtered> {
        self.contact.as_ref()
    }

    fn restart_distrusted(&mut self) {
        let joints = self.plausibility.iter_mut().zip(&mut self.front_ends);
        for (plausibility, front_end) in joints {
            if plausibility.trust() == Trust::Implausible {
                plausibility.restart();
                front_end.reset();
            }
        }
    }

    /// Later steps that this cycle's measured values are good enough for.
    pub(crate) fn readiness(&self) -> Readiness<'_> {
        let unready = measured_flags::NEVER | measured_flags::SETTLING;
        Readiness {
            joints: &self.joint_readiness,
            joints_ready: self.joint_flags & unready == 0,
            sensors_ready: self.sensor_flags & unready == 0,
            overslept: self.overslept(),
        }
    }

    /// Periods before this cycle in which the loop did not run; not more than are bridged.
    pub(crate) fn skipped(&self) -> u32 {
        self.skipped
    }

    /// All `measured_flags` of the signals that enter the equations of motion, in one word.
    pub(crate) fn flags(&self) -> u32 {
        self.joint_flags | self.sensor_flags
    }

    pub(crate) fn update(
        &mut self,
        at: Instants,
        rx: &Frames,
        settings: Option<&Settings>,
        holds: bool,
        measured: &mut MeasuredRecord,
        counts: &mut Counts,
    ) {
        self.reception.decode(rx, at.now, counts);
        self.bridge_skipped(at.sync, &mut measured.joints);
        self.read_joints(at, &mut measured.joints, counts);
        self.take_offsets(settings, holds);
        self.read_ft_sensors(at, &mut measured.ft, counts);
        self.read_imus(at, holds, measured, counts);
        let stamps = self.reception.stamps();
        (self.long).update(&self.angles, &self.axes, stamps, at.sync);
        (self.short).update(&self.angles, &self.axes, stamps, at.sync);
        if let Some(contact) = &mut self.contact {
            contact.update(&self.angles, &self.axes, stamps, at.sync);
        }
        (self.control_filter).update(&self.both_angles, stamps, at.sync);
        if self.imu_sources.len() > 1 {
            self.compare_imus(holds, measured, counts);
        }
        self.publish_joints(measured);
        self.publish_sensors(measured);
        self.judge(measured);
    }

    fn judge(&mut self, measured: &MeasuredRecord) {
        let joints = measured.joints.iter().take(self.joints.len());
        self.joint_flags = joints.fold(0, |all, joint| all | joint.flags);
        let sensors = measured.ft.iter().take(self.sensors.len());
        self.sensor_flags = sensors.fold(measured.imu.flags, |all, sensor| all | sensor.flags);
        let joints = self.joint_readiness.iter_mut().zip(&self.plausibility);
        for ((readiness, plausibility), measured) in joints.zip(&measured.joints) {
            *readiness = JointReadiness {
                plausible: matches!(plausibility.trust(), Trust::Plausible | Trust::Suspect),
                stale: measured.flags & measured_flags::STALE != 0,
                distrusted: plausibility.trust() == Trust::Implausible,
                slipped: plausibility.has_slipped(),
                blind: plausibility.is_blind(),
                shown: readiness.shown,
            };
        }
    }

    fn read_joints(&mut self, at: Instants, joints: &mut [JointMeasured], counts: &mut Counts) {
        let n = self.joints.len();
        for (j, measured) in joints.iter_mut().enumerate().take(n) {
            let reading = (self.reception).reading(&mut self.joints[j], at, counts);
            let slot = |slot: usize| {
                if reading.usable {
                    self.reception.slot(slot)
                } else {
                    f64::NAN
                }
            };
            let sample = self.front_ends[j].update(
                slot(slots::motor_angle(j)),
                slot(slots::link_angle(j)),
                slot(slots::current(j)),
            );
            let mut angles = *self.front_ends[j].angles();
            self.joint_readiness[j].shown = [angles.theta * self.motors[j][0], angles.q];
            let flags = reading.flags | angles.flags | self.implausible(j, &angles);
            let used = flags & NOT_USED == 0;
            if used {
                self.samples[j] = sample;
            }
            if flags & NOT_USED & !measured_flags::IMPLAUSIBLE == 0 {
                self.plausibility[j].watch_motor(MotorSample {
                    theta: angles.theta,
                    q: angles.q,
                    velocity: measured.omega * self.motors[j][0],
                    torque: self.reception.slot(slots::current(j)) * self.motors[j][1],
                    driven: self.driven[j],
                });
            }
            if let Some(torsion) = self.torsions[j] {
                (angles.q, angles.torsion) = (angles.q - torsion, torsion);
            }
            if flags & measured_flags::STALE != 0 {
                self.plausibility[j].note_silence();
            }
            if flags & measured_flags::MISSED != 0 {
                counts.add_of(Event::JointMissed, Subject::Joint(j));
            }
            if flags & measured_flags::JUMP != 0 {
                counts.add_of(Event::EncoderJump, Subject::Joint(j));
            }
            if used {
                measured.q = angles.q;
                measured.theta = angles.theta;
                measured.torsion = angles.torsion;
            } else if !self.is_lost(j, flags) {
                // Bridged at the last velocity: a lost reply must not step the torque.
                measured.q += measured.dq * self.sample_period;
                measured.theta += measured.omega * self.sample_period;
            }
            // A frame with an angle that cannot be right is not believed in anything else either.
            if reading.usable && (used || self.is_lost(j, flags)) {
                measured.current = self.reception.slot(slots::current(j));
                measured.status = self.reception.slot(slots::status(j)) as u32;
                if self.sends_velocity[j] {
                    measured.omega = self.reception.slot(slots::velocity(j));
                }
            }
            self.reported[j].read(&self.reception, at.now, measured);
            measured.age_s = reading.age_s;
            measured.flags = flags;
            let (q, theta) = match (used, self.is_lost(j, flags)) {
                (true, _) => (angles.q, angles.theta),
                // Filters that bridge for ever would extrapolate the last velocity for ever.
                (false, true) => (measured.q, measured.theta),
                (false, false) => (f64::NAN, f64::NAN),
            };
            self.angles[j] = q;
            // Encoders that contradict each other still show how fast they move.
            let moves = self.is_lost(j, flags) && reading.usable;
            let [link, motor] = &mut self.courses[j];
            self.both_angles[j] = link.follow(q, moves.then_some(angles.q));
            self.both_angles[n + j] = motor.follow(theta, moves.then_some(angles.theta));
        }
    }

    /// No sample of the joint has been used for so long that bridging ends: its angles stay where
    /// they are.
    fn is_lost(&self, joint: usize, flags: u32) -> bool {
        let distrusted = self.plausibility[joint].trust() == Trust::Implausible;
        flags & measured_flags::NEVER == 0 && (flags & measured_flags::STALE != 0 || distrusted)
    }

    /// The flag of a sample that its joint's encoders cannot both have measured.
    fn implausible(&mut self, joint: usize, angles: &JointAngles) -> u32 {
        let sample = if angles.flags & measured_flags::JUMP != 0 {
            Sample::Jump
        } else if angles.flags != 0 {
            Sample::Missed
        } else {
            Sample::Angles {
                torsion: angles.torsion,
                motor: angles.theta * self.motors[joint][0],
            }
        };
        let plausibility = &mut self.plausibility[joint];
        let good = match sample {
            Sample::Angles { torsion, .. } => plausibility.explains(torsion),
            Sample::Missed => true,
            Sample::Jump => false,
        };
        match plausibility.update(sample) {
            Trust::Plausible => 0,
            // Nothing depends on it yet; the filters fill.
            Trust::Settling if good => 0,
            Trust::Settling | Trust::Implausible => {
                if !good && !plausibility.has_slipped() {
                    // Wrong first readings, few or many, must not stand in the way of the right ones.
                    self.front_ends[joint].reset();
                }
                measured_flags::IMPLAUSIBLE
            }
            Trust::Suspect => measured_flags::IMPLAUSIBLE,
        }
    }
}
