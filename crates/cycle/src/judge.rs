//! Judge: whether what was measured and estimated can be right.
//!
//! In: the records of a cycle, and the commands of the last one. Out: events, and the [`Soundness`] of every joint. A
//! check is a file behind [`Check`]; what it finds it says in a [`Verdict`]. Single samples are judged before, where
//! they are read ([`supervisor::Plausibility`]), as no filter may have them; how drives follow is judged where they
//! are commanded.

mod command_delay;
mod cross_check;
mod current_check;
mod drift_check;
mod hold_check;
mod level_check;
mod motor;
mod thermal_check;
mod torque_check;
mod torsion_check;

use core::fmt;

use problem::Problem;
use robot_config::{JointParameters, Robot};
use robot_state::{
    CommandedRecord, CycleRecord, EstimatedRecord, Event, JointCommanded, JointEstimated,
    JointMeasured, MAX_JOINTS, MeasuredRecord, Settings, command_flags, measured_flags,
    torque_flags,
};
use whole_body::WholeBody;

use crate::estimate::{Estimate, FastTorque, Power};
use crate::events::{Counts, Subject};
use crate::joint::{Gap, Trust};
use crate::measure::{JointReadiness, Measure, NOT_USED, Readiness};
use crate::mode::JointBits;

pub(crate) use command_delay::CommandDelay;
pub(crate) use hold_check::{HoldCheck, Unheld};

pub(crate) struct Evidence<'a> {
    pub(crate) measured: &'a MeasuredRecord,
    pub(crate) estimated: &'a EstimatedRecord,
    /// Commands of the last cycle.
    pub(crate) commanded: &'a CommandedRecord,
    /// Torques without delay, one for each joint.
    pub(crate) fast: &'a [FastTorque],
    pub(crate) power: &'a Power,
    pub(crate) whole_body: &'a WholeBody,
    /// The loop has not run for so long that nothing goes on.
    pub(crate) overslept: bool,
    /// Joints that nothing but a torque holds, since the last cycle.
    pub(crate) alone: JointBits,
    /// Sample period, s.
    pub(crate) dt: f64,
}

/// What checks look at of one joint.
pub(crate) struct JointEvidence<'a> {
    pub(crate) measured: &'a JointMeasured,
    pub(crate) estimated: &'a JointEstimated,
    pub(crate) commanded: &'a JointCommanded,
    pub(crate) fast: &'a FastTorque,
    /// See [`Evidence`].
    pub(crate) overslept: bool,
    pub(crate) alone: bool,
    pub(crate) dt: f64,
}

impl<'a> Evidence<'a> {
    /// The evidence of each joint, in config order.
    fn joints(&self) -> impl Iterator<Item = JointEvidence<'a>> {
        let records = self.measured.joints.iter().zip(&self.estimated.joints);
        let all = records.zip(&self.commanded.joints).zip(self.fast);
        let (overslept, alone, dt) = (self.overslept, self.alone, self.dt);
        all.enumerate().map(
            move |(j, (((measured, estimated), commanded), fast))| JointEvidence {
                measured,
                estimated,
                commanded,
                fast,
                overslept,
                alone: alone & bit(j) != 0,
                dt,
            },
        )
    }
}

impl JointEvidence<'_> {
    /// Set-points are sent to the joint: no brake carries its torque instead of the motor.
    fn is_engaged(&self) -> bool {
        self.commanded.flags & command_flags::ENGAGED != 0
    }

    /// The joint's angles show its torsion.
    fn shows_torsion(&self) -> bool {
        let unusable = NOT_USED | measured_flags::STALE | measured_flags::SETTLING;
        self.measured.flags & unusable == 0
    }

    /// The motor's current neither stands still nor at an end of its range.
    fn has_sound_current(&self) -> bool {
        self.measured.flags & (measured_flags::FLAT | measured_flags::SATURATED) == 0
    }
}

/// What a check has found in this cycle.
#[derive(Debug)]
pub(crate) struct Verdict<'a> {
    counts: &'a mut Counts,
    /// Joints of which an encoder is wrong, and whose torque from F/T sensors and IMU is: a bit each.
    distrusted: u64,
    contradicted: u64,
    /// Joints that must not be enabled.
    unfit: u64,
    /// Heat of each joint's drive.
    heat: &'a mut [Heat],
    warning: Option<(Event, Subject)>,
}

impl Verdict<'_> {
    /// An event lasts; `begins`: it did not in the last cycle.
    pub(crate) fn lasts(&mut self, event: Event, subject: Subject, begins: bool) {
        self.counts.lasting(event, subject, begins);
    }

    /// An encoder of the joint is wrong.
    pub(crate) fn distrust(&mut self, joint: usize) {
        self.distrusted |= bit(joint);
    }

    /// The joint's torque from F/T sensors and IMU is wrong.
    pub(crate) fn contradict(&mut self, joint: usize) {
        self.contradicted |= bit(joint);
    }

    /// The joint must not be enabled.
    pub(crate) fn forbid(&mut self, joint: usize) {
        self.unfit |= bit(joint);
    }

    /// How hot the joint's drive is.
    pub(crate) fn heats(&mut self, joint: usize, heat: Heat) {
        if let Some(own) = self.heat.get_mut(joint) {
            *own = heat;
        }
    }

    /// What is probably wrong, for clients.
    pub(crate) fn warn(&mut self, event: Event, subject: Subject) {
        self.warning = Some((event, subject));
    }
}

const _: () = assert!(MAX_JOINTS <= u64::BITS as usize, "a bit for each joint");

fn bit(joint: usize) -> u64 {
    1_u64.checked_shl(joint as u32).unwrap_or(0)
}

/// How hot a joint's drive is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Heat {
    /// Load by the drive's current, as a share of what the continuous one makes in the end.
    pub(crate) load: f64,
    /// Torque that it may make, as a share of the joint's limit.
    pub(crate) share: f64,
}

impl Heat {
    /// A drive that is cold, or not watched.
    const NONE: Self = Self {
        load: 0.0,
        share: 1.0,
    };
}

/// A check of records.
pub(crate) trait Check: fmt::Debug + Send {
    /// Judges a cycle.
    fn judge(&mut self, evidence: &Evidence<'_>, verdict: &mut Verdict<'_>);

    /// The F/T sensors' zeros are others from this cycle on.
    fn retare(&mut self) {}
}

/// A check of one joint by itself.
trait JointCheck: fmt::Debug + Send {
    /// Judges a cycle of joint `j`.
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>);

    /// The F/T sensors' zeros are others from this cycle on.
    fn retare(&mut self) {}
}

impl<C: JointCheck> Check for Vec<C> {
    fn judge(&mut self, evidence: &Evidence<'_>, verdict: &mut Verdict<'_>) {
        for ((j, own), joint) in self.iter_mut().enumerate().zip(evidence.joints()) {
            own.judge(j, &joint, verdict);
        }
    }

    fn retare(&mut self) {
        self.iter_mut().for_each(JointCheck::retare);
    }
}

/// The check of each joint that `of` makes.
fn of_each<C: JointCheck + 'static>(
    robot: &Robot,
    of: impl Fn(&JointParameters) -> C,
) -> Box<dyn Check> {
    let joints = robot.parameters.joints.iter();
    Box::new(joints.map(of).collect::<Vec<_>>())
}

/// What later stages may rely on in this cycle.
#[derive(Debug, Clone)]
pub(crate) struct Soundness {
    /// Soundness of each joint's samples.
    pub(crate) joints: Vec<JointReadiness>,
    pub(crate) ready: Readiness,
    skipped: u32,
    unfit: u64,
    heat: Vec<Heat>,
}

impl Soundness {
    /// Periods before this cycle in which the loop did not run.
    pub(crate) fn gap(&self) -> Gap {
        match (self.ready.overslept, self.skipped) {
            (true, skipped) => Gap::Overslept(skipped),
            (false, 0) => Gap::None,
            (false, skipped) => Gap::Bridged(skipped),
        }
    }

    /// Motor-side and link-side angle of a joint as they were read, rad, link side, whether they are trusted or not.
    pub(crate) fn shown(&self, joint: usize) -> [f64; 2] {
        self.joints
            .get(joint)
            .map_or([f64::NAN; 2], |joint| joint.shown)
    }

    /// Whether a joint's encoders can be relied on.
    pub(crate) fn trust(&self, joint: usize) -> Trust {
        if self.joints.get(joint).is_some_and(|joint| joint.distrusted) {
            Trust::Distrusted
        } else {
            Trust::Sound
        }
    }

    /// Torque that a joint's drive may make, as a share of the joint's limit.
    pub(crate) fn torque_share(&self, joint: usize) -> f64 {
        self.heat.get(joint).map_or(1.0, |heat| heat.share)
    }

    /// The joint's torsion does not fit what it bears: it must not be enabled.
    pub(crate) fn is_unfit(&self, joint: usize) -> bool {
        self.unfit & bit(joint) != 0
    }
}

#[derive(Debug)]
pub(crate) struct Judge {
    checks: Vec<Box<dyn Check>>,
    soundness: Soundness,
    /// Joints of which a check has found in this cycle that an encoder is wrong.
    distrusted: u64,
    settings: Settings,
    sample_period: f64,
}

impl Judge {
    /// # Errors
    /// A filter that cannot be used.
    pub(crate) fn new(robot: &Robot, estimate: &Estimate) -> Result<Self, Problem> {
        let whole_body = estimate.whole_body();
        let checks = [
            // First: what other checks warn of is more urgent.
            thermal_check::make(robot),
            Some(current_check::make(robot)),
            cross_check::make(robot, whole_body),
            Some(torque_check::make(robot)?),
            Some(torsion_check::make(robot)),
            Some(level_check::make(robot)),
            Some(drift_check::make(robot)),
        ];
        Ok(Self {
            checks: checks.into_iter().flatten().collect(),
            soundness: Soundness {
                joints: vec![JointReadiness::default(); robot.parameters.joints.len()],
                ready: Readiness::default(),
                skipped: 0,
                unfit: 0,
                heat: vec![Heat::NONE; robot.parameters.joints.len()],
            },
            distrusted: 0,
            settings: Settings::default(),
            sample_period: robot.parameters.timing.sample_period,
        })
    }

    /// What later stages may rely on in this cycle.
    pub(crate) fn soundness(&self) -> &Soundness {
        &self.soundness
    }

    /// Joints of which an encoder is wrong by the checks of this cycle, a bit each.
    pub(crate) fn distrusted(&self) -> u64 {
        self.distrusted
    }

    /// Judges a cycle. Torques that are contradicted are not valid any more in the record.
    pub(crate) fn update(
        &mut self,
        (measure, estimate, alone): (&Measure, &Estimate, JointBits),
        settings: Option<&Settings>,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        let estimated = &mut record.estimated;
        self.note_tare(settings);
        (estimated.warning, estimated.warning_subject) = (0, 0);
        let readiness = measure.readiness();
        let (mut distrusted, mut unfit) = (0, 0);
        for check in &mut self.checks {
            let mut verdict = Verdict {
                counts: &mut *counts,
                distrusted: 0,
                contradicted: 0,
                unfit: 0,
                heat: &mut self.soundness.heat,
                warning: None,
            };
            let evidence = Evidence {
                measured: &record.measured,
                estimated,
                commanded: &record.commanded,
                fast: estimate.fast_torques(),
                power: estimate.power(),
                whole_body: estimate.whole_body(),
                overslept: readiness.overslept,
                alone,
                dt: self.sample_period,
            };
            check.judge(&evidence, &mut verdict);
            (distrusted, unfit) = (distrusted | verdict.distrusted, unfit | verdict.unfit);
            let (contradicted, warning) = (verdict.contradicted, verdict.warning);
            publish(contradicted, warning, estimated);
        }
        for (joint, heat) in estimated.joints.iter_mut().zip(&self.soundness.heat) {
            joint.thermal_load = heat.load;
        }
        self.distrusted = distrusted;
        let joints = &mut self.soundness.joints;
        joints.copy_from_slice(measure.joint_readiness());
        for (j, joint) in joints.iter_mut().enumerate() {
            if distrusted & bit(j) != 0 {
                (joint.plausible, joint.distrusted, joint.slipped) = (false, true, true);
            }
        }
        self.soundness.ready = readiness;
        self.soundness.skipped = measure.skipped();
        self.soundness.unfit = unfit;
    }

    /// After a tare the F/T sensors read otherwise.
    fn note_tare(&mut self, settings: Option<&Settings>) {
        let Some(settings) = settings else {
            return;
        };
        if settings.ft_offset != self.settings.ft_offset {
            self.settings.ft_offset = settings.ft_offset;
            self.checks.iter_mut().for_each(|check| check.retare());
        }
    }
}

/// Writes what a check has found into the record.
fn publish(contradicted: u64, warning: Option<(Event, Subject)>, estimated: &mut EstimatedRecord) {
    let joints = estimated.joints.iter_mut().enumerate();
    for (_, joint) in joints.filter(|(j, _)| contradicted & bit(*j) != 0) {
        joint.tau_whole_body.flags &= !torque_flags::VALID;
    }
    if let Some((event, subject)) = warning {
        (estimated.warning, estimated.warning_subject) = (event.number(), subject.index());
    }
}
