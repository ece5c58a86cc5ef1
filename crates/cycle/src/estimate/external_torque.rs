//! External torque: joint torques of the environment apart from the declared contacts, and the
//! contacts that they show.
//!
//! Two routes, each with a threshold ([`whole_body::ContactDetector`]):
//!
//! | route | torque of the joint | model | late by | sees |
//! | --- | --- | --- | --- | --- |
//! | `tau_ext` | `tau_encoder`, long filters | momentum observer | 40 ms and 1/K | lasting pressure |
//! | `tau_ext_change` | torsion on the level of F/T sensors, within half a second | `M ddq + h - J^T f`, short filters | half their window | blows |
//!
//! The second forgets what lasts, and with it slow errors of gear and model. A joint without a link-side
//! encoder has `tau_ext` by motor current, with its friction, and shows no contact.

use dynamics::Force;
use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{ExternalTorqueSettings, JointParameters, Robot};
use robot_state::{EstimatedRecord, Event, JointMeasured, MeasuredRecord, measured_flags};
use supervisor::count_in_a_row;
use whole_body::{
    ContactDetector, ContactDetectorParameters, ContactForce, ContactThresholds, MomentumObserver,
    MomentumObserverParameters, WholeBody,
};

use super::FastTorque;
use super::usable::{UNUSABLE, valid};
use super::whole_body::{Place, estimator};
use crate::events::{Counts, Subject};
use crate::measure::{Measure, NOT_USED};

/// Time in which the level follows, s: a change of the torque counts for so long (docs/contact.md).
/// Chosen; no experiment recorded.
const LATELY_S: f64 = 0.5;
/// Samples that may be missing in a row: one is bridged well enough for a second derivative.
const BRIDGED: u32 = 1;

/// One external torque of the joint with the standard deviations of both torques that it is the
/// difference of, N·m.
type External = whole_body::ExternalTorque;

/// Detection of contacts for all joints.
#[derive(Debug)]
pub(crate) struct ExternalTorque {
    lasting: Lasting,
    change: Change,
    detectors: Vec<ContactDetector>,
    force: Option<ContactForce>,
    /// Standard deviations of tau_ext, N·m, model order.
    sigma: Vec<f64>,
    /// Joints beyond their upper threshold in the cycle before.
    upper: Vec<bool>,
}

impl ExternalTorque {
    pub(crate) fn new(robot: &Robot, settings: &ExternalTorqueSettings) -> Result<Self, Problem> {
        let joints = &robot.parameters.joints;
        let period = robot.parameters.timing.sample_period;
        let frame = settings.frame.as_ref();
        let frame = frame.and_then(|frame| robot.model.frame_index(frame));
        let detector = |joint| ContactDetector::new(detection(joint, settings, period));
        Ok(Self {
            lasting: Lasting::new(robot, settings)?,
            change: Change::new(robot, settings)?,
            detectors: joints.iter().map(detector).collect(),
            force: frame.map(|frame| ContactForce::new(&robot.model, frame)),
            sigma: vec![0.0; robot.model.joint_count()],
            upper: vec![false; joints.len()],
        })
    }

    /// `whole_body`: behind the long filters, with the shares of the contact sets.
    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        (whole_body, shares): (&WholeBody, &[f64]),
        fast: &[FastTorque],
        measured: &MeasuredRecord,
        estimated: &mut EstimatedRecord,
        counts: &mut Counts,
    ) {
        let known = (self.lasting).update(measure, whole_body, &measured.joints, estimated);
        (self.change).update(measure, shares, fast, measured, known);
        let mut worst: Option<(usize, f64)> = None;
        for (j, detector) in self.detectors.iter_mut().enumerate() {
            let joint = &mut estimated.joints[j];
            if !known {
                detector.reset();
                (joint.tau_ext, joint.tau_ext_change) = (0.0, 0.0);
                (joint.contact_ratio, joint.contact_flag) = (0.0, 0);
                self.upper[j] = false;
                continue;
            }
            // A change within half a second is none of the level, whose sigma counts in the published torque's.
            let sigma = (fast.get(j)).map_or(joint.tau_hat.sigma, |fast| fast.by_sensors.sigma);
            let change = self.change.of(j, sigma);
            let lasting = External {
                tau: joint.tau_ext,
                sigma: [joint.tau_encoder.sigma, joint.tau_whole_body.sigma],
            };
            let acceleration = self.change.acceleration(measure, j);
            let turned = self.change.torque_change(j);
            let motion = [measured.joints[j].dq, acceleration, turned];
            let encoder = valid(&joint.tau_encoder).map(|_| lasting);
            let state = detector.update(motion, [change, encoder]);
            joint.tau_ext_change = change.map_or(0.0, |change: External| change.tau);
            (joint.contact_ratio, joint.contact_flag) = (state.ratio, u32::from(state.contact));
            if state.upper {
                counts.lasting(Event::ExternalContact, Subject::Joint(j), !self.upper[j]);
                worst = worst
                    .filter(|(_, ratio)| *ratio >= state.ratio)
                    .or(Some((j, state.ratio)));
            }
            self.upper[j] = state.upper;
        }
        if let Some((worst, _)) = worst {
            // Subject of the reaction: the joint that shows it best.
            counts.lasting(Event::ExternalContact, Subject::Joint(worst), false);
        }
        self.publish_force(known, estimated);
    }

    fn publish_force(&mut self, known: bool, estimated: &mut EstimatedRecord) {
        for (&place, joint) in self.lasting.model_index.iter().zip(&estimated.joints) {
            let (a, b) = (joint.tau_encoder.sigma, joint.tau_whole_body.sigma);
            self.sigma[place] = (a * a + b * b).sqrt();
        }
        let lasting = &self.lasting;
        let force = (self.force.as_mut())
            .filter(|_| known)
            .and_then(|force| force.update(&lasting.q, lasting.observer.tau_ext(), &self.sigma));
        (estimated.contact_force, estimated.contact_force_sigma) =
            force.map_or_else(Default::default, |(f, sigma)| (f.into(), sigma.into()));
    }
}

fn detection(
    joint: &JointParameters,
    settings: &ExternalTorqueSettings,
    sample_period: f64,
) -> ContactDetectorParameters {
    let (limit, share) = (joint.limits.torque, settings.threshold);
    ContactDetectorParameters {
        sample_period,
        thresholds: ContactThresholds {
            sigmas: share.sigmas,
            at_rest: [limit * share.change, limit * share.lasting],
            per_velocity: limit * share.at_velocity_limit / joint.limits.velocity,
            per_acceleration: limit * share.at_acceleration_limit / joint.acceleration(),
            per_torque: share.of_torque_change,
        },
        upper_ratio: settings.upper_ratio,
        hold: settings.hold,
        release: settings.release,
    }
}

/// The momentum observer; its inputs all have the delay of the long filters.
#[derive(Debug)]
struct Lasting {
    observer: MomentumObserver,
    /// Delays the torque from encoders like the other inputs.
    filter: FilterBank,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    /// The joint's torque is that by motor current, as it has no link-side encoder.
    by_current: Vec<bool>,
    newest: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    tau: Vec<f64>,
    forces: Vec<Force>,
}

impl Lasting {
    fn new(robot: &Robot, settings: &ExternalTorqueSettings) -> Result<Self, Problem> {
        let p = &robot.parameters;
        let (n, joints) = (robot.model.joint_count(), p.joints.len());
        let parameters = MomentumObserverParameters {
            sample_period: p.timing.sample_period,
            gain: settings.gain,
        };
        Ok(Self {
            observer: MomentumObserver::new(&robot.model, parameters),
            filter: FilterBank::new(joints, p.filters.long.sensor)?,
            model_index: p.joints.iter().map(|j| j.model_index).collect(),
            by_current: p.joints.iter().map(|j| !j.has_link_encoder).collect(),
            newest: vec![f64::NAN; joints],
            q: vec![0.0; n],
            dq: vec![0.0; n],
            tau: vec![0.0; n],
            forces: vec![Force::zero(); robot.model.bodies().len()],
        })
    }

    /// Sets `tau_ext` of every joint; false where it does not follow from the signals.
    fn update(
        &mut self,
        measure: &Measure,
        whole_body: &WholeBody,
        measured: &[JointMeasured],
        estimated: &mut EstimatedRecord,
    ) -> bool {
        let sources = estimated.joints.iter().zip(&self.by_current);
        for (newest, (joint, by_current)) in self.newest.iter_mut().zip(sources) {
            *newest = if *by_current {
                joint.tau_current.tau
            } else {
                joint.tau_encoder.tau
            };
        }
        self.filter.update(&self.newest);
        for (j, (&place, joint)) in self.model_index.iter().zip(measured).enumerate() {
            self.q[place] = joint.q_hat;
            self.dq[place] = joint.dq_hat;
            self.tau[place] = self.filter.values()[j];
        }
        let settling = self.filter.settling(0) || measure.flags() & UNUSABLE != 0;
        if settling || !whole_body.estimate().valid {
            self.observer.reset();
            return false;
        }
        self.forces.fill(Force::zero());
        whole_body.add_contact_forces(&mut self.forces);
        let base = whole_body.base_motion();
        let forces = Some(self.forces.as_slice());
        let tau_ext = (self.observer).update(&self.q, &self.dq, &self.tau, base, forces);
        for (joint, &place) in estimated.joints.iter_mut().zip(&self.model_index) {
            joint.tau_ext = tau_ext[place];
        }
        true
    }
}

/// The torque of a joint in the last half second.
#[derive(Debug, Clone)]
struct Lately {
    /// The filtered torque on average, N·m.
    mean: f64,
    /// Cycles for which the torque has not been known, and those since, up to the window.
    missed: u32,
    seen: u32,
}

/// Torque of joints less that of the model, both behind short filters.
#[derive(Debug)]
struct Change {
    whole_body: WholeBody,
    /// Delays the torque like the other inputs.
    filter: FilterBank,
    window: u32,
    newest: Vec<f64>,
    joints: Vec<Lately>,
    /// Share of a cycle in the averages of the last half second.
    forgetting: f64,
    /// Cycles without a sample of any joint or sensor, and those since.
    gaps: Gaps,
}

impl Change {
    fn new(robot: &Robot, settings: &ExternalTorqueSettings) -> Result<Self, Problem> {
        let joints = robot.parameters.joints.len();
        let filter = FilterBank::new(joints, settings.filters.sensor)?;
        Ok(Self {
            whole_body: estimator(robot, settings.filters, Place::Contacts)?,
            window: filter.kernel().len() as u32,
            filter,
            newest: vec![f64::NAN; joints],
            joints: vec![
                Lately {
                    mean: 0.0,
                    missed: u32::MAX,
                    seen: 0,
                };
                joints
            ],
            forgetting: (robot.parameters.timing.sample_period / LATELY_S).min(1.0),
            gaps: Gaps {
                joints: vec![0; joints],
                sensors: vec![0; robot.parameters.ft_sensors.len() + 1],
                left: 0,
            },
        })
    }

    fn update(
        &mut self,
        measure: &Measure,
        shares: &[f64],
        fast: &[FastTorque],
        measured: &MeasuredRecord,
        known: bool,
    ) {
        for ((newest, own), fast) in self.newest.iter_mut().zip(&mut self.joints).zip(fast) {
            // Without the level the error of a gear at rest would look like a change.
            *newest = fast.levelled_freely.unwrap_or(f64::NAN);
            let missed = count_in_a_row(&mut own.missed, !newest.is_finite());
            own.seen = if missed > BRIDGED {
                0
            } else {
                (own.seen + 1).min(self.window)
            };
        }
        self.filter.update(&self.newest);
        for (own, torque) in self.joints.iter_mut().zip(self.filter.values()) {
            own.mean = if own.seen < self.window {
                *torque
            } else {
                own.mean + self.forgetting * (torque - own.mean)
            };
        }
        self.gaps.update(measure, measured, self.window);
        if let Some(signals) = measure.contact() {
            self.whole_body.blend(shares);
            self.whole_body.update_torques(&signals.input());
        }
        if !known {
            self.joints.iter_mut().for_each(|own| own.seen = 0);
        }
    }

    /// The change of the external torque of a joint; none while it is not known.
    fn of(&self, joint: usize, sigma: f64) -> Option<External> {
        let model = self.whole_body.estimate();
        let full = self.joints.get(joint)?.seen >= self.window;
        if !(full && model.valid && self.gaps.left == 0) {
            return None;
        }
        Some(External {
            tau: model.tau.get(joint)? - self.filter.values().get(joint)?,
            sigma: [sigma, *model.sigma.get(joint)?],
        })
    }

    /// How far the torque of a joint is from where it was lately, N·m.
    fn torque_change(&self, joint: usize) -> f64 {
        let torques = self.filter.values().get(joint).zip(self.joints.get(joint));
        torques.map_or(0.0, |(torque, lately)| torque - lately.mean)
    }

    /// |ddq| of a joint, rad/s².
    fn acceleration(&self, measure: &Measure, joint: usize) -> f64 {
        let signals = measure.contact().map(|signals| signals.input());
        let ddq = signals.and_then(|signals| signals.ddq.get(joint).copied());
        ddq.filter(|_| self.gaps.left == 0).unwrap_or(0.0)
    }
}

/// Samples missing in a row, of any signal: what bridges them has no true second derivative.
#[derive(Debug)]
struct Gaps {
    joints: Vec<u32>,
    /// The F/T sensors, then the IMU.
    sensors: Vec<u32>,
    /// Cycles until the filters hold nothing of the last gap.
    left: u32,
}

impl Gaps {
    fn update(&mut self, measure: &Measure, measured: &MeasuredRecord, window: u32) {
        self.left = self.left.saturating_sub(1);
        let mut gap = measure.skipped() > 0;
        let mut count = |missed: &mut u32, lost: bool| {
            gap |= count_in_a_row(missed, lost) > BRIDGED;
        };
        for (missed, joint) in self.joints.iter_mut().zip(&measured.joints) {
            count(missed, joint.flags & NOT_USED != 0);
        }
        let not_used = measured_flags::MISSED | measured_flags::FLAT | measured_flags::SATURATED;
        if let Some((imu, sensors)) = self.sensors.split_last_mut() {
            for (missed, ft) in sensors.iter_mut().zip(&measured.ft) {
                count(missed, ft.flags & not_used != 0);
            }
            count(imu, measured.imu.flags & not_used != 0);
        }
        if gap {
            self.left = window;
        }
    }
}
