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
mod joint;
mod publish;
mod reception;
mod reported;
mod sensors;
mod skipped;

use can_codec::Frames;
use estimators::joint::JointSample;
use problem::Problem;
use robot_config::Robot;
use robot_state::{CycleRecord, JointMeasured, MeasuredRecord, Settings, measured_flags};

use crate::events::Counts;
use crate::time::{Instants, Stamp};
use align::{AlignedBank, signals};
use filtered::{AXES, Filtered};
use ft_offset::FtInput;
use gear_torsion::GearTorsion;
use imu_check::ImuCheck;
use imus::Imus;
use joint::JointReader;
use reception::{Reception, Source};

/// A joint's sample with one of these is bridged.
pub(crate) const NOT_USED: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::JUMP
    | measured_flags::IMPLAUSIBLE;

/// Whether one joint's samples can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct JointReadiness {
    /// The joint's encoders agree, and have done so for long enough.
    pub(crate) plausible: bool,
    /// The joint has sent no usable sample for longer than allowed.
    pub(crate) stale: bool,
    /// The joint's encoders contradict each other.
    pub(crate) distrusted: bool,
    /// One of the joint's encoders has slipped.
    pub(crate) slipped: bool,
    /// Neither of its encoders shows any more where it is.
    pub(crate) blind: bool,
    /// Motor-side and link-side angle as they were read last, whether they are trusted or not, rad,
    /// link side.
    pub(crate) shown: [f64; 2],
}

/// Later steps that this cycle's measured values are good enough for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Readiness {
    /// Every joint has answered, and its filters are full.
    pub(crate) joints: bool,
    /// Every F/T sensor and IMU has, and their filters are full.
    pub(crate) sensors: bool,
    /// The loop has not run for longer than samples may be old: what was followed before is over.
    pub(crate) overslept: bool,
}

/// The joints and sensors of a robot, followed from cycle to cycle.
#[derive(Debug)]
pub(crate) struct Measure {
    reception: Reception,
    joints: Vec<JointReader>,
    sensors: Vec<Source>,
    ft_inputs: Vec<FtInput>,
    imu_sources: Vec<(Source, ImuCheck)>,
    imus: Imus,
    /// The first IMU seems sound and is not, since the last cycle.
    imu_doubted: bool,
    sample_period: f64,
    stale_after: f64,
    /// Long filters: for the torque from F/T sensors and IMU, contacts and feedback.
    long: Filtered,
    /// Short filters: for the delay-compensated torque.
    short: Filtered,
    /// Filters for the detection of contacts, if there is one.
    contact: Option<Filtered>,
    /// q of every joint, then theta of every joint: first derivative.
    control_filter: AlignedBank,
    angles: Vec<f64>,
    both_angles: Vec<f64>,
    axes: Vec<f64>,
    samples: Vec<JointSample>,
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
        Ok(Self {
            joints: (parameters.joints.iter().enumerate())
                .map(|(j, joint)| JointReader::new(j, joint, &reception, period))
                .collect::<Result<_, _>>()?,
            sensors: sensors::of_ft_sensors(parameters, &reception),
            ft_inputs: parameters.ft_sensors.iter().map(FtInput::new).collect(),
            imu_sources: sensors::of_imus(parameters, &reception),
            imus: Imus::new(robot)?,
            imu_doubted: false,
            sample_period: period,
            stale_after: parameters.timing.stale_after,
            long: Filtered::new(robot, parameters.filters.long)?,
            short: Filtered::new(robot, parameters.filters.short)?,
            contact: (parameters.external_torque.as_ref())
                .map(|settings| Filtered::new(robot, settings.filters))
                .transpose()?,
            control_filter: AlignedBank::new(&control, parameters.filters.control, period)?,
            angles: vec![f64::NAN; n],
            both_angles: vec![f64::NAN; 2 * n],
            axes: vec![f64::NAN; axes],
            samples: vec![JointSample::default(); n],
            gear_torsion: GearTorsion::new(robot),
            joint_readiness: vec![JointReadiness::default(); n],
            last_sync: None,
            skipped: 0,
            joint_flags: measured_flags::NEVER,
            sensor_flags: measured_flags::NEVER,
            reception,
        })
    }

    /// Takes what was learned in the last cycle: the joints of which an encoder is wrong, a bit each; whether an
    /// operator has acknowledged since, so that joints whose encoders contradicted each other are to prove themselves
    /// anew; and the torques, which explain the torsion of joints without a link-side encoder.
    pub(crate) fn learn(&mut self, distrusted: u64, acknowledged: bool, last: &CycleRecord) {
        let commanded = &last.commanded.joints;
        let blind = (self.joint_readiness.iter())
            .filter(|joint| joint.blind)
            .count();
        for (j, (joint, commanded)) in self.joints.iter_mut().zip(commanded).enumerate() {
            let itself = self.joint_readiness.get(j).is_some_and(|own| own.blind);
            let warned = blind > usize::from(itself);
            joint.learn(commanded, distrusted >> j & 1 == 1, warned);
            if acknowledged {
                joint.restart_if_distrusted();
            }
        }
        if self.last_sync.is_some() {
            let joints = &mut self.joints;
            let (measured, estimated) = (&last.measured.joints, &last.estimated.joints);
            (self.gear_torsion).update(measured, estimated, |j, torsion| {
                if let Some(joint) = joints.get_mut(j) {
                    joint.explain(torsion);
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

    /// Filters of the contact detection.
    pub(crate) fn contact(&self) -> Option<&Filtered> {
        self.contact.as_ref()
    }

    /// Later steps that this cycle's measured values are good enough for.
    pub(crate) fn readiness(&self) -> Readiness {
        let unready = measured_flags::NEVER | measured_flags::SETTLING;
        Readiness {
            joints: self.joint_flags & unready == 0,
            sensors: self.sensor_flags & unready == 0,
            overslept: self.overslept(),
        }
    }

    /// Whether each joint's samples can be relied on.
    pub(crate) fn joint_readiness(&self) -> &[JointReadiness] {
        &self.joint_readiness
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
        self.filter(at.sync);
        if self.imu_sources.len() > 1 {
            self.compare_imus(holds, measured, counts);
        }
        self.publish_joints(measured);
        self.publish_sensors(measured);
        self.judge(measured);
    }

    /// Takes the samples of a cycle into all filters.
    fn filter(&mut self, sync: Stamp) {
        let stamps = self.reception.stamps();
        let banks = [&mut self.long, &mut self.short].into_iter();
        for bank in banks.chain(&mut self.contact) {
            bank.update(&self.angles, &self.axes, stamps, sync);
        }
        (self.control_filter).update(&self.both_angles, stamps, sync);
    }

    fn judge(&mut self, measured: &MeasuredRecord) {
        let joints = measured.joints.iter().take(self.joints.len());
        self.joint_flags = joints.fold(0, |all, joint| all | joint.flags);
        let sensors = measured.ft.iter().take(self.sensors.len());
        self.sensor_flags = sensors.fold(measured.imu.flags, |all, sensor| all | sensor.flags);
        let readers = self.joints.iter().zip(&measured.joints);
        for (readiness, (reader, measured)) in self.joint_readiness.iter_mut().zip(readers) {
            *readiness = reader.readiness(measured.flags);
        }
    }

    fn read_joints(&mut self, at: Instants, joints: &mut [JointMeasured], counts: &mut Counts) {
        let n = self.joints.len();
        let joints = joints.iter_mut().zip(&mut self.samples);
        for (j, (reader, (measured, sample))) in self.joints.iter_mut().zip(joints).enumerate() {
            let angles = reader.read(&self.reception, at, measured, sample, counts);
            self.angles[j] = angles.q;
            [self.both_angles[j], self.both_angles[n + j]] = angles.control;
        }
    }
}
