//! Estimate: joint torques, contact wrenches and warnings, from the measured values.
//!
//! A joint has four torque estimates, each with a use of its own:
//!
//! | estimate         | from                                   | delay   | used by                  |
//! | ---------------- | -------------------------------------- | ------- | ------------------------ |
//! | `tau_encoder`    | torsion of the gear and current (Z)    | none    | feedback, if so configured; `tau_hat`; external torque; cross-check |
//! | `tau_whole_body` | F/T sensors, IMU, rigid-body model (D 2) | long filters | feedback, by default; cross-check |
//! | `tau_current`    | current less friction (D3)             | none    | cross-check              |
//! | `tau_hat`        | changes of `tau_encoder`, level of the torque from F/T sensors | none | clients |
//!
//! The first is fast and drifts with the deformation model; the second is accurate and late; the
//! third is coarse and independent of both; the fourth joins the first two. A joint without a link-side
//! encoder has no `tau_encoder`: there `tau_current` takes its place in `tau_hat` and external torque, and
//! the second alone is fed back.

mod current;
mod delay_compensation;
mod external_torque;
mod gravity_load;
mod level_fusion;
mod power;
mod usable;
mod whole_body;

use core::fmt;

use ::whole_body::WholeBody;
use dynamics::Motion;
use estimators::joint::{AnyEstimator, DRIVE_OFF, JointSample};
use problem::Problem;
use robot_config::{JointParameters, Robot};
use robot_state::{
    CycleRecord, Event, JointEstimated, Settings, TorqueEstimate, measured_flags, torque_flags,
};

use crate::events::{Counts, Subject};
use crate::measure::Measure;
use current::CurrentTorques;
use delay_compensation::DelayCompensation;
pub(crate) use delay_compensation::{FastTorque, KINEMATIC_SLOPE};
use external_torque::ExternalTorque;
use whole_body::WholeBodyStage;

pub(crate) use current::sign_smoothing;
pub(crate) use gravity_load::{GravityLoad, Loads};
pub(crate) use power::{Power, SETTLING_S};
pub(crate) use usable::{UNUSABLE, valid};

/// The estimators of all joints.
pub(crate) struct Estimate {
    /// Estimator of each joint; none for a joint without a link-side encoder.
    joints: Vec<Option<AnyEstimator>>,
    /// Further knowledge of each joint's torque from encoders.
    beside: Vec<Beside>,
    currents: CurrentTorques,
    power: Power,
    gravity_load: GravityLoad,
    /// Samples that are left of each joint's tare.
    taring: Vec<u32>,
    /// Whether the sources of each joint's torque disagreed in the cycle before.
    disagreed: Vec<bool>,
    whole_body: WholeBodyStage,
    delay_compensation: DelayCompensation,
    external_torque: Option<ExternalTorque>,
    /// The settings in use.
    settings: Settings,
}

/// Knowledge of an estimator about its torque, beside that torque.
#[derive(Debug, Clone, Copy, Default)]
struct Beside {
    /// The torque without its filters' delay, N·m; see [`estimators::joint::JointTorqueEstimator::undelayed`].
    undelayed: Option<f64>,
    /// Standard deviation by its past, N·m.
    past: f64,
}

/// Samples over which a joint is tared.
const TARE_SAMPLES: u32 = 50;

impl fmt::Debug for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Estimate")
            .field("joints", &self.joints.len())
            .field("whole_body", &self.whole_body)
            .finish_non_exhaustive()
    }
}

impl Estimate {
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let whole_body = WholeBodyStage::new(robot)?;
        Ok(Self {
            disagreed: vec![false; parameters.joints.len()],
            taring: vec![0; parameters.joints.len()],
            beside: vec![Beside::default(); parameters.joints.len()],
            joints: parameters
                .joints
                .iter()
                .map(JointParameters::torque_estimator)
                .collect::<Result<_, _>>()?,
            currents: CurrentTorques::new(robot),
            power: Power::new(robot),
            gravity_load: GravityLoad::new(robot),
            delay_compensation: DelayCompensation::new(robot)?,
            external_torque: (parameters.external_torque.as_ref())
                .map(|settings| ExternalTorque::new(robot, settings))
                .transpose()?,
            whole_body,
            settings: Settings::default(),
        })
    }

    /// Twist and proper acceleration of the root, delayed by the long filters.
    pub(crate) fn base_motion(&self) -> (Motion, Motion) {
        self.whole_body.estimator().base_motion()
    }

    /// Torques without delay, one for each joint.
    pub(crate) fn fast_torques(&self) -> &[FastTorque] {
        self.delay_compensation.fast()
    }

    /// What loads the robot, and the torques that carry its joints.
    pub(crate) fn gravity_load(&self) -> &GravityLoad {
        &self.gravity_load
    }

    /// Whether motors' currents show their joints' torques.
    pub(crate) fn power(&self) -> &Power {
        &self.power
    }

    /// The estimator of torques from F/T sensors and IMU.
    pub(crate) fn whole_body(&self) -> &WholeBody {
        self.whole_body.estimator()
    }

    /// `follows`: a client's mode is active. The commands of the record are those of the last cycle.
    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        (settings, follows): (Option<&Settings>, bool),
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        let (measured, estimated) = (&record.measured, &mut record.estimated);
        self.power.update(&record.commanded);
        if let Some(settings) = settings {
            self.apply(settings);
        }
        if follows {
            // The torque was known while the robot held.
            self.taring.fill(0);
        }
        self.update_encoder_torques(measure, &mut estimated.joints, counts);
        let samples = measure.samples();
        (self.currents).update(samples, &measured.joints, &mut estimated.joints);
        let delay_s = measured.filter_delay_s;
        (self.whole_body).update(measure, delay_s, estimated, counts);
        let shares = self.whole_body.contact_set_shares();
        let followed = follows.then_some(&measured.joints[..]);
        let joints = &mut estimated.joints[..];
        let torques = (joints, &self.beside[..]);
        (self.delay_compensation).update(measure, shares, followed, torques, counts);
        let whole_body = self.whole_body.estimator();
        if let Some(external_torque) = &mut self.external_torque {
            let fast = self.delay_compensation.fast();
            external_torque.update(
                measure,
                (whole_body, shares),
                fast,
                measured,
                estimated,
                counts,
            );
        }
        self.show_pasts(&estimated.joints);
        let (_, acceleration) = self.base_motion();
        self.gravity_load.update(&acceleration, measured, estimated);
    }

    /// Applies clients' choice of a contact set and tares of joints; the F/T sensors' offsets are used
    /// where samples are read, and by checks.
    fn apply(&mut self, settings: &Settings) {
        if settings.contact_set != self.settings.contact_set {
            self.whole_body.choose_contact_set(settings.contact_set);
        }
        let before = self.settings.joint_tares.iter();
        let tares = settings.joint_tares.iter().zip(before);
        for (left, (tare, before)) in self.taring.iter_mut().zip(tares) {
            if tare.count != before.count {
                *left = TARE_SAMPLES;
            }
        }
        self.settings = *settings;
    }

    /// Shows each calibrated joint the torque from F/T sensors and rigid-body model, brought to the present: of the
    /// gear's hysteresis at the start nothing else knows.
    fn show_pasts(&mut self, estimated: &[JointEstimated]) {
        for (j, (estimator, joint)) in self.joints.iter_mut().zip(estimated).enumerate() {
            if let (Some(estimator), Some((error, sigma))) =
                (estimator, self.delay_compensation.shows(j))
            {
                let change = estimator.show(joint.tau_encoder.tau + error, sigma);
                self.delay_compensation.shown(j, change);
            }
        }
    }

    fn update_encoder_torques(
        &mut self,
        measure: &Measure,
        joints: &mut [JointEstimated],
        counts: &mut Counts,
    ) {
        let samples = measure.samples().iter();
        let states = self.disagreed.iter_mut().zip(&mut self.beside);
        let estimators = self.joints.iter_mut().zip(states);
        for (index, ((estimator, sample), joint)) in estimators.zip(samples).zip(joints).enumerate()
        {
            let (estimator, (disagreed, beside)) = estimator;
            *beside = Beside::default();
            let Some(estimator) = estimator else {
                joint.tau_encoder = TorqueEstimate::default();
                continue;
            };
            joint.tau_encoder = if sample.flags & measured_flags::NEVER != 0 {
                TorqueEstimate::default()
            } else {
                let off = if self.power.shows_torque(index) {
                    0
                } else {
                    DRIVE_OFF
                };
                let torque = estimator.update(&JointSample {
                    flags: sample.flags | off,
                    ..*sample
                });
                *beside = Beside {
                    undelayed: estimator.undelayed(),
                    past: estimator.past(),
                };
                checked(torque, joint.tau_encoder, counts)
            };
            if let (Some(left @ 1..), Some(tare)) = (
                self.taring.get_mut(index),
                self.settings.joint_tares.get(index),
            ) {
                *left -= 1;
                estimator.tare_to(tare.torque, tare.sigma);
            }
            let disagrees = estimator.disagrees();
            if disagrees {
                counts.lasting(Event::SourcesDisagree, Subject::Joint(index), !*disagreed);
            }
            *disagreed = disagrees;
        }
    }
}

/// The estimate, or the last one marked as not valid if it is not finite. Counts both that and
/// saturation.
fn checked(estimate: TorqueEstimate, last: TorqueEstimate, counts: &mut Counts) -> TorqueEstimate {
    if !(estimate.tau.is_finite() && estimate.sigma.is_finite()) {
        counts.add(Event::EstimateNotFinite);
        return TorqueEstimate {
            flags: last.flags & !torque_flags::VALID,
            ..last
        };
    }
    let usable = torque_flags::SATURATED | torque_flags::VALID;
    if estimate.flags & usable == usable {
        counts.add(Event::TorqueSaturated);
    }
    estimate
}
