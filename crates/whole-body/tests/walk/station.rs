//! Everything that looks at the walking humanoid, side by side, each in the joints' order.

use super::*;
use estimators::compliance::ComplianceEstimator;
use estimators::compliance::JointEstimatorParameters;
use estimators::current_based::{CurrentEstimator, CurrentParameters, NO_PRESLIDING};
use estimators::encoder::JointEncoders;
use estimators::joint::{JointSample, JointTorqueEstimator};
use whole_body::{
    CrossCheck, CrossCheckParameters, DelayCompensator, DelayCompensatorParameters, DelayedTorque,
    Sources, Tare, TareParameters, TareResult, WholeBody,
};

/// Faults of sensors, from a certain time on.
#[derive(Default, Clone)]
pub(crate) struct Fault {
    /// Joint and how far its link encoder has slipped, rad.
    pub(crate) slip: Option<(usize, f64)>,
    /// Joint and factor of its torque constant.
    pub(crate) constant: Option<(usize, f64)>,
    /// Sensor and drift of its reading.
    pub(crate) drift: Option<(usize, [f64; 6])>,
}

pub(crate) struct Station {
    pub(crate) walk: Walk,
    pub(crate) model: Model,
    pub(crate) parameters: WholeBodyParameters,
    pub(crate) front: Front,
    pub(crate) whole_body: WholeBody,
    pub(crate) compensator: Vec<DelayCompensator>,
    /// The same with the current's torque for that from encoders, as a robot without encoders on
    /// its links must.
    without_torsion: Vec<DelayCompensator>,
    pub(crate) check: CrossCheck,
    pub(crate) fault: Fault,
    encoders: Vec<JointEncoders>,
    compliance: Vec<ComplianceEstimator>,
    current: Vec<CurrentEstimator>,
    undelayed_current: Vec<CurrentEstimator>,
    gear_ratios: Vec<f64>,
    dq: FilterBank,
    pub(crate) fast: Vec<f64>,
    pub(crate) tau_now: Vec<f64>,
    pub(crate) sigma_now: Vec<f64>,
    pub(crate) current_now: Vec<f64>,
    sources: Vec<Sources>,
}

/// Standard deviation of a sample of the encoders' torque: counts and their noise by the stiffness.
fn fast_sigma(e: &JointEstimatorParameters) -> f64 {
    let (motor, link) = (e.motor_resolution / e.gear_ratio, e.link_resolution);
    e.compliance.k_fs0 * (0.4 * motor).hypot(0.6 * link)
}

fn joint_parts(config: &Robot) -> Vec<(JointEstimatorParameters, CurrentParameters)> {
    let joints = config.parameters.joints.iter();
    joints
        .map(|j| {
            let mut e = j.estimator.clone();
            // DelayCompensator does the smoothing.
            e.low_pass_pole = 0.0;
            let w = &e.wave_generator;
            let n = e.gear_ratio;
            let current = CurrentParameters {
                k_1: n * w.torque_constant,
                k_2: n * n * w.viscous_friction,
                k_3: n * w.friction,
                k_4: 0.0,
                inertia: n * n * j.rotor_inertia,
                offset: 0.0,
                sign_smoothing: 0.02,
                presliding: NO_PRESLIDING,
                gear_ratio: n,
                low_pass_pole: 0.9,
                sigma: 0.0,
                sample_period: PERIOD,
                torque_limit: 10.0 * e.torque_limit,
            };
            (e, current)
        })
        .collect()
}

impl Station {
    pub(crate) fn new(sim: &SimParameters, filters: Filters) -> Self {
        let config = config();
        let model = model(&config);
        let parameters = parameters(&config, filters);
        let whole_body = WholeBody::new(&model, &parameters).unwrap();
        let parts = joint_parts(&config);
        let limit = |k: f64| {
            parts
                .iter()
                .map(|(e, _)| k * e.torque_limit)
                .collect::<Vec<_>>()
        };
        let joined = |fast_sigma: f64, torque_limit: f64| {
            DelayCompensator::new(DelayCompensatorParameters {
                sample_period: PERIOD,
                kernel: filters.kernel(),
                fast_sigma,
                torque_limit,
                stands_within: 0.0087,
                gain: 1.0,
                error_per_angle: 600.0,
            })
        };
        let compensator = |(e, _): &(JointEstimatorParameters, CurrentParameters)| {
            joined(fast_sigma(e), e.torque_limit)
        };
        let without_torsion = |(e, _): &(JointEstimatorParameters, CurrentParameters)| {
            joined(1e-3 * e.torque_limit, e.torque_limit)
        };
        let check = CrossCheckParameters {
            sample_period: PERIOD,
            window: filters.window(),
            average: 0.25,
            hold: 0.4,
            encoder_threshold: limit(0.04),
            current_load: limit(0.12),
            current_ratio: [0.6, 1.5],
            residual_ratio: 8.0,
            residual_floor: [0.5, 0.05],
        };
        let n = parts.len();
        let unwrapped = |j: &robot_config::JointParameters| {
            let mut e = j.encoders;
            // The plant's readings do not wrap.
            (e.motor_wrap, e.link_wrap) = (f64::INFINITY, f64::INFINITY);
            JointEncoders::new(e)
        };
        Self {
            walk: Walk::new(&config, sim),
            front: Front::new(n, parameters.ft_sensors.len(), filters),
            compensator: parts.iter().map(compensator).collect(),
            without_torsion: parts.iter().map(without_torsion).collect(),
            check: CrossCheck::new(&whole_body, check),
            fault: Fault::default(),
            encoders: config.parameters.joints.iter().map(unwrapped).collect(),
            compliance: parts
                .iter()
                .map(|(e, _)| ComplianceEstimator::new(e.clone()))
                .collect(),
            current: parts
                .iter()
                .map(|(_, c)| CurrentEstimator::of_data_sheet(*c))
                .collect(),
            undelayed_current: (parts.iter())
                .map(|(_, c)| {
                    CurrentEstimator::of_data_sheet(CurrentParameters {
                        low_pass_pole: 0.5,
                        ..*c
                    })
                })
                .collect(),
            gear_ratios: parts.iter().map(|(e, _)| e.gear_ratio).collect(),
            dq: FilterBank::new(n, SavitzkyGolayParameters::centred(20, 2, 1, PERIOD)).unwrap(),
            fast: vec![0.0; n],
            tau_now: vec![0.0; n],
            sigma_now: vec![0.0; n],
            current_now: vec![0.0; n],
            sources: vec![Sources::default(); n],
            whole_body,
            model,
            parameters,
        }
    }

    pub(crate) fn joints(&self) -> usize {
        self.fast.len()
    }

    /// One period.
    pub(crate) fn advance(&mut self) {
        let mut readings = self.walk.advance().clone();
        if let Some((joint, slip)) = self.fault.slip {
            readings.joints[joint].q += slip;
        }
        if let Some((joint, factor)) = self.fault.constant {
            readings.joints[joint].current *= factor;
        }
        if let Some((sensor, drift)) = self.fault.drift {
            for k in 0..3 {
                readings.ft[sensor].force[k] += drift[k];
                readings.ft[sensor].torque[k] += drift[3 + k];
            }
        }
        let q: Vec<f64> = readings.joints.iter().map(|j| j.q).collect();
        self.dq.update(&q);
        let input = self.front.update(&readings);
        let delayed = self.whole_body.update(&input);
        for (j, reading) in readings.joints.iter().enumerate() {
            let angles = self.encoders[j].update(reading.theta, reading.q);
            let sample = JointSample {
                q: angles.aligned_q,
                theta: angles.aligned_theta,
                dq: self.dq.first_derivatives()[j],
                omega: reading.omega,
                current: reading.current,
                feed_forward: None,
                flags: angles.flags,
            };
            self.fast[j] = self.compliance[j].update(&sample).tau;
            let delayed = delayed.valid.then_some(DelayedTorque {
                tau: delayed.tau[j],
                sigma: delayed.sigma[j],
            });
            let now = self.compensator[j].update(Some(self.fast[j]), delayed);
            (self.tau_now[j], self.sigma_now[j]) = (now.tau, now.sigma);
            let current = self.current[j].update(&sample);
            let dq = reading.omega / self.gear_ratios[j];
            let undelayed = self.undelayed_current[j].update(&JointSample { dq, ..sample });
            let now = self.without_torsion[j].update(Some(undelayed.tau), delayed);
            self.current_now[j] = now.tau;
            self.sources[j] = Sources {
                encoder: Some(self.fast[j]),
                whole_body: delayed.map(|l| l.tau),
                current: Some(current.tau),
                current_sigma: current.sigma,
            };
        }
        self.check.update(&self.sources, &self.whole_body);
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / PERIOD).round() as usize {
            self.advance();
        }
    }

    /// Tares with the given contacts and takes the offsets over.
    pub(crate) fn tare(&mut self, contacts: Vec<ContactParameters>) -> Vec<TareResult> {
        let mut p = self.parameters.clone();
        p.hypotheses[0].contacts = contacts;
        let mut tare = Tare::new(&self.model, &p, TareParameters::default()).unwrap();
        for _ in 0..600 {
            let readings = self.walk.advance().clone();
            tare.add(&self.front.update(&readings)).unwrap();
        }
        let results = tare.finish().unwrap();
        for (c, result) in self.front.conditioning.iter_mut().zip(&results) {
            c.correct(&result.correction);
        }
        self.check.reset();
        results
    }
}

/// The robot in the air, held at its chest.
pub(crate) fn in_the_air() -> Vec<ContactParameters> {
    vec![
        contact(CHEST, ContactKind::FullWrench),
        contact("left_foot", ContactKind::Nothing),
        contact("right_foot", ContactKind::Nothing),
        contact("left_hand", ContactKind::Nothing),
        contact("right_hand", ContactKind::Nothing),
    ]
}

/// Traces of truth and estimates, joint by joint.
pub(crate) struct Traces {
    pub(crate) truth: Vec<Vec<f64>>,
    pub(crate) delayed: Vec<Vec<f64>>,
    pub(crate) now: Vec<Vec<f64>>,
    pub(crate) fast: Vec<Vec<f64>>,
    /// Of `now`.
    pub(crate) sigma: Vec<Vec<f64>>,
    /// Without torsion.
    pub(crate) current: Vec<Vec<f64>>,
}

impl Station {
    pub(crate) fn record(&mut self, seconds: f64) -> Traces {
        let empty = || vec![Vec::new(); self.joints()];
        let mut t = Traces {
            truth: empty(),
            delayed: empty(),
            now: empty(),
            fast: empty(),
            sigma: empty(),
            current: empty(),
        };
        for _ in 0..(seconds / PERIOD).round() as usize {
            self.advance();
            for j in 0..self.joints() {
                t.truth[j].push(self.walk.truth().joints[j].tau);
                t.delayed[j].push(self.whole_body.estimate().tau[j]);
                t.now[j].push(self.tau_now[j]);
                t.fast[j].push(self.fast[j]);
                t.sigma[j].push(self.sigma_now[j]);
                t.current[j].push(self.current_now[j]);
            }
        }
        t
    }
}

/// RMS of an estimate's error against the truth `delay` samples ago (which may be between two).
pub(crate) fn error(estimate: &[f64], truth: &[f64], delay: f64) -> f64 {
    let (whole, part) = (delay.floor() as usize, delay.fract());
    let at = |k: usize| (1.0 - part) * truth[k - whole] + part * truth[k - whole - 1];
    let from = whole + 1;
    let errors: Vec<f64> = (from..truth.len()).map(|k| estimate[k] - at(k)).collect();
    rms(&errors)
}

/// Delay of an estimate, samples: where its correlation with the truth is greatest.
pub(crate) fn lag(estimate: &[f64], truth: &[f64]) -> f64 {
    const FURTHEST: i64 = 100;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let n = truth.len() as i64;
    let correlation = |k: i64| {
        let range = FURTHEST..n - FURTHEST;
        let e: Vec<f64> = range.clone().map(|i| estimate[i as usize]).collect();
        let t: Vec<f64> = range.map(|i| truth[(i - k) as usize]).collect();
        let (me, mt) = (mean(&e), mean(&t));
        let pairs = e.iter().zip(&t);
        let both: f64 = pairs.map(|(a, b)| (a - me) * (b - mt)).sum();
        let power = |x: &[f64], m: f64| x.iter().map(|a| (a - m).powi(2)).sum::<f64>();
        both / (power(&e, me) * power(&t, mt)).sqrt()
    };
    let best = (-20..=60).map(|k| (correlation(k), k));
    let (_, k) = best.fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a });
    let [a, b, c] = [k - 1, k, k + 1].map(correlation);
    k as f64 + 0.5 * (a - c) / (a - 2.0 * b + c)
}

/// Standard deviation.
pub(crate) fn deviation(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    rms(&x.iter().map(|x| x - mean).collect::<Vec<_>>())
}

/// A link and the force that pushes it, N, in the world's axes.
pub(crate) type Push = (&'static str, [f64; 3]);

/// The first cause that is named after a fault, and when; the fault (or a push on a link) comes in
/// five seconds after stepping has begun.
pub(crate) fn first_cause(seed: u64, fault: Fault, push: Option<Push>) -> (String, String) {
    let mut sim = simulation(seed);
    let starts = 1.5 + 0.6 + 5.0;
    if let Some((link, force)) = push {
        sim.pushes.push(plant::parameters::PushParameters {
            link: link.into(),
            start: starts,
            // A half-wave: it must rise before it can be seen.
            duration: 3.0,
            force,
            torque: [0.0; 3],
        });
    }
    let mut station = Station::new(&sim, OURS);
    station.run(1.5);
    station.tare(in_the_air());
    station.walk.stepping_since = Some(station.walk.time());
    station.run(5.0);
    if let Some(cause) = station.check.found().first() {
        return (format!("{cause:?}"), "before the fault".into());
    }
    station.fault = fault;
    for k in 1..=4000 {
        station.advance();
        if let Some(cause) = station.check.found().first() {
            return (
                format!("{cause:?}"),
                format!("{:.2}", PERIOD * f64::from(k)),
            );
        }
    }
    ("nothing".into(), "-".into())
}
