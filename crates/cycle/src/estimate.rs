//! Estimate: every joint's torque, twice, and the contact wrenches.

use dynamics::Motion;
use estimators::compliance::ComplianceEstimator;
use estimators::joint::AnyEstimator;
use robot_config::{JointParameters, Robot};
use robot_state::{
    CycleRecord, Event, Settings, TorqueEstimate, measured_flags, torque_flags, torque_source,
};

use core::fmt;
use whole_body::{ContactSwitch, ContactSwitchParameters, WholeBody};

mod cross_check;
mod delay_compensation;
mod external_torque;
mod usable;

use crate::error::CycleError;
use crate::events::Counts;
use crate::measure::{Measure, whole_body};
use cross_check::Watch;
use delay_compensation::Predict;
use external_torque::External;
use usable::all_flags;

/// The estimators of all joints.
pub(crate) struct Estimate {
    joints: Vec<AnyEstimator>,
    whole_body: WholeBody,
    contacts: ContactSwitch,
    /// How many contacts each set has.
    contact_counts: Vec<usize>,
    predict: Predict,
    external: Option<External>,
    watch: Option<Watch>,
    /// The settings that were taken over last.
    settings: Settings,
    torque_limits: Vec<f64>,
}

impl fmt::Debug for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Estimate")
            .field("joints", &self.joints.len())
            .field("whole_body", &self.whole_body)
            .finish_non_exhaustive()
    }
}

/// All of a calibrated joint's estimators, fused; Z's compliance where there is no calibration.
fn joint_estimator(joint: &JointParameters) -> Result<AnyEstimator, CycleError> {
    Ok(match &joint.calibration {
        Some(file) => Box::new(file.estimators().map_err(CycleError::Calibration)?),
        None => Box::new(ComplianceEstimator::new(joint.estimator.clone())),
    })
}

impl Estimate {
    pub(crate) fn new(robot: &Robot) -> Result<Self, CycleError> {
        let parameters = &robot.parameters;
        let whole_body = whole_body(robot, parameters.filters.long)?;
        Ok(Self {
            watch: (parameters.cross_check.as_ref())
                .map(|settings| Watch::new(robot, &whole_body, settings)),
            joints: parameters
                .joints
                .iter()
                .map(joint_estimator)
                .collect::<Result<_, _>>()?,
            contacts: contact_switch(robot, &whole_body),
            contact_counts: whole_body.contact_counts(),
            predict: Predict::new(robot)?,
            external: (parameters.external_torque.as_ref())
                .map(|settings| External::new(robot, settings))
                .transpose()?,
            settings: Settings::default(),
            whole_body,
            torque_limits: parameters.joints.iter().map(|j| j.limits.torque).collect(),
        })
    }

    /// Twist and proper acceleration of the root, late by the filters' delay.
    pub(crate) fn base_motion(&self) -> (Motion, Motion) {
        self.whole_body.base_motion()
    }

    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        settings: Option<&Settings>,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        if let Some(settings) = settings {
            self.take_over(settings);
        }
        for (j, estimator) in self.joints.iter_mut().enumerate() {
            let sample = &measure.samples()[j];
            let joint = &mut record.joints[j];
            joint.tau_encoder = if sample.flags & measured_flags::NEVER != 0 {
                TorqueEstimate::default()
            } else {
                checked(estimator.update(sample), joint.tau_encoder, counts)
            };
        }
        self.update_whole_body(measure, record, counts);
        (self.predict).update(measure, self.contacts.weights(), record, counts);
        if let Some(external) = &mut self.external {
            external.update(&self.whole_body, record, counts);
        }
        if let Some(watch) = &mut self.watch {
            watch.update(measure.samples(), &self.whole_body, record, counts);
        }
    }

    /// Clients' choice of contacts; offsets are for those who condition.
    fn take_over(&mut self, settings: &Settings) {
        if settings.contacts != self.settings.contacts {
            match settings.contacts.checked_sub(1) {
                Some(set) => _ = self.contacts.choose(set as usize),
                None => self.contacts.automatic(),
            }
        }
        if settings.ft_offset != self.settings.ft_offset
            && let Some(watch) = &mut self.watch
        {
            watch.reset();
        }
        self.settings = *settings;
    }

    fn update_whole_body(
        &mut self,
        measure: &Measure,
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        let n = self.joints.len();
        let estimate = self.whole_body.update(&measure.slow().input());
        let flags = all_flags(record);
        // One silent sensor spoils the sum for all joints: whose share it is cannot be told.
        let unusable = measured_flags::NEVER | measured_flags::SETTLING | measured_flags::STALE;
        let degraded = flags & (measured_flags::MISSED | measured_flags::JUMP) != 0;
        let mut common = 0;
        if estimate.valid && flags & unusable == 0 {
            common |= torque_flags::VALID;
        }
        if degraded {
            common |= torque_flags::DEGRADED;
        }
        for j in 0..n {
            let limit = self.torque_limits[j];
            let tau = estimate.tau[j];
            let saturated = tau.abs() > limit;
            let whole_body = TorqueEstimate {
                tau: tau.max(-limit).min(limit),
                sigma: estimate.sigma[j],
                delay_s: record.filter_delay_s,
                source: torque_source::WHOLE_BODY,
                flags: common
                    | if saturated {
                        torque_flags::SATURATED
                    } else {
                        0
                    },
            };
            let joint = &mut record.joints[j];
            joint.tau_whole_body = checked(whole_body, joint.tau_whole_body, counts);
        }
        self.tell_contacts(record);
        self.contacts.update(&mut self.whole_body);
        record.contacts = self.contacts.target() as u32;
        record.contacts_automatic = u32::from(self.contacts.is_automatic());
    }

    fn tell_contacts(&self, record: &mut CycleRecord) {
        let estimate = self.whole_body.estimate();
        // The last contact is the unknown wrench.
        let last = self.contact_counts[self.whole_body.chosen()].saturating_sub(1);
        if let Some(unknown) = estimate.contacts.get(last) {
            record.unknown_wrench = unknown.wrench;
            record.unknown_wrench_sigma = unknown.sigma;
        }
        let mut parts = estimate.parts.iter();
        if let Some(root) = parts.next() {
            record.residual = root.residual;
            record.residual_sigma = root.residual_sigma;
        }
        let sensors = record.ft.iter_mut().zip(parts).enumerate();
        for (s, (sensor, part)) in sensors {
            sensor.contact = self.whole_body.net_at_sensor(s);
            sensor.residual = part.residual;
            sensor.residual_sigma = part.residual_sigma;
        }
    }
}

/// Who chooses among the sets of contacts, and how they give way to one another.
fn contact_switch(robot: &Robot, whole_body: &WholeBody) -> ContactSwitch {
    let p = &robot.parameters;
    let settings = &p.whole_body;
    let parameters = ContactSwitchParameters {
        sample_period: p.timing.sample_period,
        blend: settings.blend,
        rule: settings.load_rule.clone(),
        loaded: settings.contacts.iter().map(|c| c.loaded.clone()).collect(),
    };
    ContactSwitch::new(
        whole_body.hypotheses().len(),
        p.ft_sensors.len(),
        parameters,
    )
}

/// The estimate, or the last one marked as not valid if it is not finite. Counts what is odd.
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
