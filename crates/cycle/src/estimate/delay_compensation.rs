//! Delay compensation: the present torque of every joint.
//!
//! In: the torque from encoders, fast but drifting, and the torque from F/T sensors, accurate but
//! delayed by the short filters. Out: `tau_hat`. Of a joint without a link-side encoder the torque from
//! motor current stands for that from encoders: it drifts by its friction.

use estimators::compliance::JointEstimatorParameters;
use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{FastTorqueFeedback, JointCalibration, JointParameters, Robot, TorqueLaw};
use robot_state::{Event, JointEstimated, JointMeasured, TorqueEstimate, torque_flags};
use whole_body::{DelayCompensator, DelayCompensatorParameters, DelayedTorque, WholeBody};

use super::Beside;
use super::level_fusion::{LevelFusion, Levels};
use super::usable::{UNUSABLE, valid};
use super::whole_body::{Place, estimator};
use crate::events::Counts;
use crate::measure::Measure;

/// Change of torsion per angle by a strain-wave gear's kinematic error, 1, within a fraction of a degree:
/// a quarter of the slope of 0.003 degrees twice a turn of the wave generator of a gear of 1:100 (Z
/// Table I).
pub(crate) const KINEMATIC_SLOPE: f64 = 0.0025;

/// The delay compensation of all joints.
#[derive(Debug)]
pub(crate) struct DelayCompensation {
    /// From F/T sensors and IMU through short filters.
    whole_body: WholeBody,
    joints: Vec<Joint>,
    fast: Vec<FastTorque>,
}

/// The torque without delay.
#[derive(Debug, Clone, Copy)]
enum Fast {
    /// By the compliance before its low-pass, which would add delay.
    Compliance,
    /// By a joint file's estimators. The filter of the torsion, at rest a long one, holds back what only the torque
    /// that is fed back needs at once: late it would make a joint swing.
    Calibrated,
    /// By motor current.
    Current,
}

#[derive(Debug)]
struct Joint {
    fast: Fast,
    compensator: DelayCompensator,
    level: LevelFusion,
    torque_limit: f64,
    /// Part of the torque from encoders that F/T sensors and rigid-body model have shown, N·m: no change of the
    /// torque, so that the compensator does not see it.
    shown: f64,
    /// Error of it that they show now, N·m, and its standard deviation.
    shows: Option<(f64, f64)>,
}

/// Torques of one joint without delay, N·m; none where they are not known.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FastTorque {
    /// By torsion alone.
    pub(crate) torsion: Option<f64>,
    /// By torsion, on the level of F/T sensors and rigid-body model: for feedback, and to be judged.
    pub(crate) levelled: Option<f64>,
    pub(crate) levelled_freely: Option<f64>,
    /// `tau_hat` on the level of F/T sensors and rigid-body model alone: to be judged beside `torsion`, of whose errors
    /// the published one has a share.
    pub(crate) by_sensors: TorqueEstimate,
}

impl Joint {
    /// Moves the torque to the level of encoders and F/T sensors. `error`: the latter less the former of one instant,
    /// N·m; none without a torque by torsion. Standard deviations of both: of encoders that by their past besides, of
    /// F/T sensors that of errors that last.
    fn fuse(
        &mut self,
        error: Option<f64>,
        [fast_sigma, delayed_sigma]: [[f64; 2]; 2],
        estimate: &mut TorqueEstimate,
    ) {
        let [_, lasting] = delayed_sigma;
        let levels = error.map(|difference| Levels {
            difference,
            now: estimate.tau - self.compensator.fast() - self.shown,
            fast_sigma,
            delayed_sigma,
        });
        if levels.is_none() {
            estimate.sigma = estimate.sigma.hypot(lasting);
        }
        self.level.update(levels, estimate);
    }
}

impl FastTorque {
    /// The torque that the predictive law feeds back, N·m; none for other laws.
    pub(crate) fn fed_back(&self, law: TorqueLaw, estimated: &JointEstimated) -> Option<f64> {
        use FastTorqueFeedback::{DelayCompensated, Levelled, Torsion};
        let TorqueLaw::Predictive(feedback) = law else {
            return None;
        };
        match feedback {
            Torsion => self.torsion,
            // Until the level is known torsion alone.
            Levelled => self.levelled.or(self.torsion),
            DelayCompensated => {
                let valid = estimated.tau_hat.flags & torque_flags::VALID != 0;
                valid.then_some(estimated.tau_hat.tau).or(self.torsion)
            }
        }
    }
}

impl DelayCompensation {
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let p = &robot.parameters;
        let kernel = FilterBank::new(1, p.filters.short.sensor)?.kernel();
        let joint = |joint: &JointParameters| Joint {
            fast: match (joint.has_link_encoder, &joint.calibration) {
                (false, _) => Fast::Current,
                (true, Some(_)) => Fast::Calibrated,
                (true, None) => Fast::Compliance,
            },
            compensator: DelayCompensator::new(DelayCompensatorParameters {
                sample_period: p.timing.sample_period,
                kernel: kernel.clone(),
                fast_sigma: if joint.has_link_encoder {
                    resolution(&joint.estimator)
                } else {
                    by_current(joint)
                },
                torque_limit: joint.limits.torque,
                stands_within: joint.limits.gives_way,
                gain: (joint.calibration.as_ref()).map_or(1.0, JointCalibration::torsion_gain),
                error_per_angle: KINEMATIC_SLOPE * joint.estimator.compliance.k_fs0,
            }),
            level: LevelFusion::new(p.timing.sample_period, joint.limits.torque),
            torque_limit: joint.limits.torque,
            shown: 0.0,
            shows: None,
        };
        Ok(Self {
            whole_body: estimator(robot, p.filters.short, Place::DelayCompensation)?,
            joints: p.joints.iter().map(joint).collect(),
            fast: vec![FastTorque::default(); p.joints.len()],
        })
    }

    /// Torques without delay, one for each joint.
    pub(crate) fn fast(&self) -> &[FastTorque] {
        &self.fast
    }

    /// Error of a joint's torque from encoders by that from F/T sensors and rigid-body model: the error of
    /// the latter, N·m, and the former's standard deviation.
    pub(crate) fn shows(&self, joint: usize) -> Option<(f64, f64)> {
        self.joints.get(joint)?.shows
    }

    /// A joint's torque from encoders has followed by so much, N·m.
    pub(crate) fn shown(&mut self, joint: usize, change: f64) {
        if let Some(joint) = self.joints.get_mut(joint)
            && change.is_finite()
        {
            joint.shown += change;
        }
    }

    /// `contact_set_shares`: shares of the contact sets, in config order; `measured`: the joints, while
    /// a client's mode is active; `beside`: what else is known of torques from encoders.
    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        contact_set_shares: &[f64],
        measured: Option<&[JointMeasured]>,
        (joints, beside): (&mut [JointEstimated], &[Beside]),
        counts: &mut Counts,
    ) {
        self.whole_body.blend(contact_set_shares);
        let delayed = self.whole_body.update_torques(&measure.short().input());
        // Short filters have settled when the long ones, which the flags are about, have.
        let usable = delayed.valid && measure.flags() & UNUSABLE == 0;
        for (j, (own, joint)) in self.joints.iter_mut().zip(joints).enumerate() {
            let torque = |estimate| valid(estimate).map(|estimate| estimate.tau);
            let Beside { undelayed, past } = beside.get(j).copied().unwrap_or_default();
            let encoder = torque(&joint.tau_encoder);
            let (fast, held_back, by_torsion) = match own.fast {
                Fast::Compliance => (undelayed, 0.0, true),
                Fast::Calibrated => {
                    let held_back = undelayed.zip(encoder).map(|(newest, tau)| newest - tau);
                    (
                        encoder.map(|tau| tau - own.shown),
                        held_back.unwrap_or(0.0),
                        true,
                    )
                }
                Fast::Current => (torque(&joint.tau_current), 0.0, false),
            };
            let (tau, sigma) = (delayed.tau[j], delayed.sigma[j]);
            let within_limit = usable && tau.abs() <= own.torque_limit;
            let lasting = delayed.lasting_sigma[j];
            let delayed = within_limit.then_some(DelayedTorque { tau, sigma });
            let angle = measured
                .and_then(|joints| joints.get(j))
                .map(|joint| joint.q);
            own.compensator.follow(angle);
            joint.tau_hat = own.compensator.update(fast, delayed);
            let by_sensors = joint.tau_hat;
            let error = own.compensator.difference().map(|error| error - own.shown);
            let sigmas = [[joint.tau_encoder.sigma, past], [sigma, lasting]];
            own.fuse(error.filter(|_| by_torsion), sigmas, &mut joint.tau_hat);
            own.shows = match own.fast {
                Fast::Calibrated => error.map(|error| (error, sigma.hypot(lasting))),
                Fast::Compliance | Fast::Current => None,
            };
            if let Some(torque) = self.fast.get_mut(j) {
                let compensator = by_torsion.then_some(&own.compensator);
                *torque = FastTorque {
                    torsion: fast.filter(|_| by_torsion),
                    levelled: compensator.and_then(|own| own.levelled(held_back)),
                    levelled_freely: compensator.and_then(DelayCompensator::levelled_freely),
                    by_sensors,
                };
            }
            if joint.tau_hat.flags & torque_flags::SATURATED != 0 {
                counts.add(Event::TorqueSaturated);
            }
        }
    }
}

/// Standard deviation of the compliance's torque due to the encoders' counts: a count hides a uniform
/// error whose variance is its square over 12.
fn resolution(e: &JointEstimatorParameters) -> f64 {
    let counts = (e.motor_resolution / e.gear_ratio).hypot(e.link_resolution);
    e.compliance.k_fs0 * counts / 12f64.sqrt()
}

/// Standard deviation of the torque by motor current: its noise, and its count.
fn by_current(joint: &JointParameters) -> f64 {
    let e = &joint.estimator;
    let count = joint.current_signal.resolution / 12f64.sqrt();
    e.gear_ratio * e.wave_generator.torque_constant * e.current_sigma.hypot(count)
}
