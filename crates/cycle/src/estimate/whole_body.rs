//! Whole body: torques, contact wrenches and residuals from F/T sensors and IMU (D 2).

use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{FilterGains, Robot, SignalFilters, whole_body_parameters};
use robot_state::{EstimatedRecord, TorqueEstimate, measured_flags, torque_flags, torque_source};
use whole_body::{ContactSwitch, ContactSwitchParameters, WholeBody};

use super::checked;
use super::usable::UNUSABLE;
use crate::events::Counts;
use crate::measure::Measure;

/// Cycles after which an estimator's covariances are computed anew.
const COVARIANCES_EVERY: u32 = 10;

/// The cycle, of [`COVARIANCES_EVERY`], in which an estimator's covariances are computed: never those
/// of two estimators in the same one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Place {
    WholeBody = 0,
    DelayCompensation = 3,
    Contacts = 6,
}

/// The whole-body estimator with standard deviations as they are behind these filters.
pub(crate) fn estimator(
    robot: &Robot,
    filters: SignalFilters,
    place: Place,
) -> Result<WholeBody, Problem> {
    let parameters = &robot.parameters;
    let sensors = FilterBank::new(1, filters.sensor)?;
    let ddq_gain = FilterBank::new(1, filters.encoder)?.noise_gain(2);
    let gains = FilterGains {
        sensor: [sensors.noise_gain(0), sensors.noise_gain(1)],
        // A count hides a uniform error whose variance is its square over 12.
        sigma_ddq: (parameters.joints.iter())
            .map(|j| ddq_gain * j.estimator.link_resolution / 12f64.sqrt())
            .collect(),
    };
    let Some(parameters) = whole_body_parameters(parameters, &robot.model, &gains) else {
        let reason = "the robot's floating base has neither an IMU nor a stand";
        return Err(Problem::new(reason, "[imu], or [fixed_base]"));
    };
    WholeBody::new(&robot.model, &parameters)
        .map(|estimator| estimator.with_covariances_every(COVARIANCES_EVERY, place as u32))
        .map_err(|error| error.problem().of("[whole_body]"))
}

/// The estimator behind the long filters, and the choice among contact sets.
#[derive(Debug)]
pub(crate) struct WholeBodyStage {
    estimator: WholeBody,
    contact_sets: ContactSwitch,
    /// Number of contacts of each contact set.
    contact_counts: Vec<usize>,
    torque_limits: Vec<f64>,
}

impl WholeBodyStage {
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let estimator = estimator(robot, parameters.filters.long, Place::WholeBody)?;
        Ok(Self {
            contact_sets: contact_switch(robot, &estimator),
            contact_counts: estimator.contact_counts(),
            torque_limits: parameters.joints.iter().map(|j| j.limits.torque).collect(),
            estimator,
        })
    }

    pub(crate) fn estimator(&self) -> &WholeBody {
        &self.estimator
    }

    /// Shares of the contact sets in the estimate, in config order.
    pub(crate) fn contact_set_shares(&self) -> &[f64] {
        self.contact_sets.weights()
    }

    /// Takes over `Settings::contact_set`.
    pub(crate) fn choose_contact_set(&mut self, setting: u32) {
        match setting.checked_sub(1) {
            Some(set) => _ = self.contact_sets.choose(set as usize),
            None => self.contact_sets.automatic(),
        }
    }

    /// `delay_s`: delay of the long filters.
    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        delay_s: f64,
        estimated: &mut EstimatedRecord,
        counts: &mut Counts,
    ) {
        let estimate = self.estimator.update(&measure.long().input());
        let flags = measure.flags();
        // A missing sensor falsifies the sum, and so all joints: its share in each is not known.
        let mut common = 0;
        if estimate.valid && flags & UNUSABLE == 0 {
            common |= torque_flags::VALID;
        }
        if flags & (measured_flags::MISSED | measured_flags::JUMP) != 0 {
            common |= torque_flags::DEGRADED;
        }
        let joints = estimated.joints.iter_mut().zip(&self.torque_limits);
        for (j, (joint, &limit)) in joints.enumerate() {
            let tau = estimate.tau[j];
            let saturated = if tau.abs() > limit {
                torque_flags::SATURATED
            } else {
                0
            };
            let whole_body = TorqueEstimate {
                tau: tau.max(-limit).min(limit),
                sigma: estimate.sigma[j].hypot(estimate.lasting_sigma[j]),
                delay_s,
                source: torque_source::WHOLE_BODY,
                flags: common | saturated,
            };
            joint.tau_whole_body = checked(whole_body, joint.tau_whole_body, counts);
        }
        self.publish_wrenches(estimated);
        self.contact_sets.update(&mut self.estimator);
        estimated.contact_set = self.contact_sets.target() as u32;
        estimated.contact_set_automatic = u32::from(self.contact_sets.is_automatic());
    }

    fn publish_wrenches(&self, estimated: &mut EstimatedRecord) {
        let estimate = self.estimator.estimate();
        // The last contact is the unknown wrench.
        let last = self.contact_counts[self.estimator.chosen()].saturating_sub(1);
        if let Some(unknown) = estimate.contacts.get(last) {
            estimated.unknown_wrench = unknown.wrench;
            estimated.unknown_wrench_sigma = unknown.sigma;
        }
        let mut parts = estimate.parts.iter();
        if let Some(root) = parts.next() {
            estimated.residual = root.residual;
            estimated.residual_sigma = root.residual_sigma;
        }
        for (s, (sensor, part)) in estimated.ft.iter_mut().zip(parts).enumerate() {
            sensor.contact_wrench = self.estimator.net_at_sensor(s);
            sensor.residual = part.residual;
            sensor.residual_sigma = part.residual_sigma;
        }
    }
}

/// The choice among contact sets, by clients and by the automatic rule.
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
