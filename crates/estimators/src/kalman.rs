//! Compliance model behind a Kalman filter, linear or unscented (U).
//!
//! ```text
//! state        x = [theta, omega, tau]                       CM-KF, CM-UKF
//!              x = [theta, omega, tau, dtau, d]              with the added states
//! process      theta' = theta + T omega
//!              omega' = omega + T/J (tau_m + d - B omega - tau_fm(omega) - tau/N)
//!              tau'   = tau (+ T dtau),   dtau' = dtau,   d' = d
//! measurement  z1 = theta,   z2 = torsion - err(q, theta) = torsion_fs(tau) + torsion_wg(tau/N)/N
//! ```
//! U prints the steps of its filter without their equations; these are a reconstruction. The kinematic error is taken at
//! the measured angles: it moves by less than the encoder's noise between those and the state's.
//! Added beyond U: the torque's rate against lag, a slow motor torque `d` for the current's offset
//! and the friction that the model lacks, and a gear with slipping springs and an output bearing:
//! their states follow from the torsion's past, so the gear's torque itself is what is measured,
//! `z2 = gear(torsion - err)`, and the bearing's friction is taken off what comes out.

use crate::compliance::JointEstimatorParameters;
use crate::hysteresis::{Gear, GearParameters};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::output::Output;
use crate::tracking::{Tracking, TrackingParameters};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// States of U's filter.
pub const STATES: usize = 3;
/// With the torque's rate and the slow motor torque.
pub const ADDED_STATES: usize = 5;

/// Noise of process and measurement, and the motor.
#[derive(Debug, Clone, PartialEq)]
pub struct KalmanParameters {
    /// Gear, compliance, kinematic error and motor friction.
    pub joint: JointEstimatorParameters,
    /// The gear with springs that slip and its output bearing, in place of Z's curves; none as U
    /// has it.
    pub gear: Option<GearParameters>,
    /// With a gear: how the torsion is followed; where it rests, the torque gains less variance
    /// than Q. Without sigma it always gains all of it.
    pub tracking: TrackingParameters,
    /// J_m: inertia of rotor and wave generator, motor side, kg·m².
    pub rotor_inertia: f64,
    /// Friction per torque carried, as gears that mesh have it, 1.
    pub meshing: f64,
    /// |omega| at which the sign of friction is smoothed, rad/s.
    pub sign_smoothing: f64,
    /// Q: variance that each state gains in a period, in the states' order and units squared.
    pub process: [f64; ADDED_STATES],
    /// R: variances of theta (rad²) and of the torsion (rad²).
    pub measurement: [f64; 2],
}

/// Transform that carries the distribution through the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transform {
    /// A constant stiffness K_fs0 and Jacobians.
    Linear,
    /// The unscented transform through the nonlinear model.
    Unscented,
}

/// A Kalman filter over `N` states: [`STATES`] or [`ADDED_STATES`].
#[derive(Debug, Clone)]
pub struct KalmanEstimator<const N: usize> {
    parameters: KalmanParameters,
    transform: Transform,
    gear: Option<Gear>,
    tracking: Tracking,
    /// Square of the gear's present stiffness over that of its linear part: a change of torsion is
    /// a larger change of torque where the gear is stiff.
    stiffness: f64,
    state: Option<State<N>>,
    /// Normalised square of the last innovation, and its mean over the last second or so.
    innovation: (f64, f64),
    /// Logarithm of the last innovation's likelihood, up to a constant.
    log_likelihood: f64,
    output: Output,
}

#[derive(Debug, Clone)]
struct State<const N: usize> {
    x: SVector<f64, N>,
    p: SMatrix<f64, N, N>,
}

/// Mean normalised innovation, in units of its expectation, above which the filter counts as inconsistent.
const INNOVATION_LIMIT: f64 = 10.0;

impl<const N: usize> KalmanEstimator<N> {
    /// A filter that has seen no sample.
    #[must_use]
    pub fn new(parameters: KalmanParameters, transform: Transform) -> Self {
        debug_assert!(N == STATES || N == ADDED_STATES, "{N} states");
        Self {
            gear: (parameters.gear.clone())
                .map(|gear| Gear::new(gear, parameters.joint.sample_period)),
            tracking: Tracking::new(parameters.tracking, parameters.joint.sample_period),
            output: Output::new(torque_source::ENCODER, parameters.joint.torque_limit, 0.0),
            stiffness: 1.0,
            state: None,
            innovation: (2.0, 2.0),
            log_likelihood: 0.0,
            transform,
            parameters,
        }
    }

    /// Square of the last innovation over its expected variance: about 2 if the model holds.
    #[must_use]
    pub fn normalized_innovation(&self) -> f64 {
        self.innovation.0
    }

    /// Logarithm of the last innovation's likelihood, up to a constant; the variances are tuned by it.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Whether the innovations are as small as their expected variance.
    #[must_use]
    pub fn consistent(&self) -> bool {
        self.innovation.1 < 2.0 * INNOVATION_LIMIT
    }

    /// The state, if there is one.
    #[must_use]
    pub fn state(&self) -> Option<&SVector<f64, N>> {
        self.state.as_ref().map(|s| &s.x)
    }

    fn start(&self, sample: &JointSample, torsion: f64) -> State<N> {
        let p = &self.parameters.joint;
        let mut x = SVector::zeros();
        (x[0], x[1]) = (sample.theta, sample.omega);
        x[2] = p.compliance.torque(torsion, p.torque_limit).tau;
        // Wide: rad², (rad/s)², and the square of a tenth of the limit for all torques.
        let tenth = (0.1 * p.torque_limit).powi(2);
        let spread = [1e-2, 1e2, tenth, 1e2 * tenth, tenth / p.gear_ratio.powi(2)];
        let p = SMatrix::from_fn(|i, j| if i == j { spread[i] } else { 0.0 });
        State { x, p }
    }

    /// The motion over one period.
    fn process(&self, x: &SVector<f64, N>, tau_m: f64) -> SVector<f64, N> {
        let KalmanParameters {
            joint,
            rotor_inertia,
            sign_smoothing,
            ..
        } = &self.parameters;
        let motor = &joint.wave_generator;
        let t = joint.sample_period;
        let (rate, slow) = if N == ADDED_STATES {
            (x[3], x[4])
        } else {
            (0.0, 0.0)
        };
        let level = motor.friction + self.parameters.meshing * x[2].abs() / joint.gear_ratio;
        let friction = motor.viscous_friction * x[1]
            + level * (x[1] / sign_smoothing.max(f64::MIN_POSITIVE)).tanh();
        let mut next = *x;
        //= U Process: theta' = theta + T omega
        //= U Process: omega' = omega + T/J (tau_m + d - B omega - tau_fm(omega) - tau/N)
        //= U Process: tau' = tau + T dtau
        next[0] += t * x[1];
        next[1] += t / rotor_inertia * (tau_m + slow - friction - x[2] / joint.gear_ratio);
        next[2] += t * rate;
        next
    }

    /// Expected measurement.
    fn measurement(&self, x: &SVector<f64, N>) -> Vector2<f64> {
        let p = &self.parameters.joint;
        let compliance = &p.compliance;
        if self.gear.is_some() {
            return Vector2::new(x[0], x[2]);
        }
        //= U Measurement: z_1 = theta, z_2 = torsion_fs(tau) + torsion_wg(tau/N)/N
        let torsion = match self.transform {
            Transform::Linear => x[2] / compliance.k_fs0,
            Transform::Unscented => {
                compliance.flexspline_torsion(x[2])
                    + compliance.wave_generator_torsion(x[2] / p.gear_ratio) / p.gear_ratio
            }
        };
        Vector2::new(x[0], torsion)
    }

    /// Jacobian of the process.
    fn process_jacobian(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let KalmanParameters {
            joint,
            rotor_inertia,
            sign_smoothing,
            ..
        } = &self.parameters;
        let t = joint.sample_period;
        let smoothing = sign_smoothing.max(f64::MIN_POSITIVE);
        let direction = (x[1] / smoothing).tanh();
        let slope = 1.0 - direction.powi(2);
        let meshing = self.parameters.meshing / joint.gear_ratio;
        let level = joint.wave_generator.friction + meshing * x[2].abs();
        let friction = joint.wave_generator.viscous_friction + level * slope / smoothing;
        let mut f = SMatrix::identity();
        f[(0, 1)] = t;
        f[(1, 1)] -= t / rotor_inertia * friction;
        // A zero torque has no sign: `signum` would give it one.
        let sign = if x[2] == 0.0 { 0.0 } else { x[2].signum() };
        let carried = 1.0 / joint.gear_ratio + meshing * direction * sign;
        f[(1, 2)] = -t / rotor_inertia * carried;
        if N == ADDED_STATES {
            f[(2, 3)] = t;
            f[(1, 4)] = t / rotor_inertia;
        }
        f
    }

    fn predict(&self, s: &State<N>, tau_m: f64) -> Option<State<N>> {
        let (value, rate) = self.tracking.liveliness();
        let lively = [1.0, 1.0, value * self.stiffness, rate * self.stiffness, 1.0];
        let q = SMatrix::from_fn(|i, j| {
            if i == j {
                self.parameters.process[i] * lively[i]
            } else {
                0.0
            }
        });
        match self.transform {
            Transform::Linear => {
                //= U Step iv: x^- = f(x), P^- = F P F' + Q
                let f = self.process_jacobian(&s.x);
                let p = f * s.p * f.transpose() + q;
                Some(State {
                    x: self.process(&s.x, tau_m),
                    p,
                })
            }
            Transform::Unscented => {
                //= U Step iv: x^- = sum_k w f(chi_k),
                //=     P^- = sum_k w (f(chi_k) - x^-) (f(chi_k) - x^-)' + Q
                let around = Points::new(s)?;
                let (x, p) = around.through(|x| self.process(x, tau_m));
                Some(State { x, p: p + q })
            }
        }
    }

    fn correct(&mut self, s: &State<N>, z: &Vector2<f64>, r: &Vector2<f64>) -> Option<State<N>> {
        let (expected, covariance, cross) = match self.transform {
            Transform::Linear => {
                let mut h = SMatrix::<f64, 2, N>::zeros();
                h[(0, 0)] = 1.0;
                h[(1, 2)] = match self.gear {
                    Some(_) => 1.0,
                    None => 1.0 / self.parameters.joint.compliance.k_fs0,
                };
                (
                    self.measurement(&s.x),
                    h * s.p * h.transpose(),
                    s.p * h.transpose(),
                )
            }
            Transform::Unscented => Points::new(s)?.onto(|x| self.measurement(x)),
        };
        let innovation = z - expected;
        let covariance = covariance + Matrix2::from_diagonal(r);
        let inverse = covariance.try_inverse()?;
        //= U Step vii: K = P_xz P_zz^-1
        let gain: SMatrix<f64, N, 2> = cross * inverse;
        let squared = (innovation.transpose() * inverse * innovation)[(0, 0)];
        let second = (1.0 / self.parameters.joint.sample_period).max(1.0);
        self.innovation.0 = squared;
        self.log_likelihood = -0.5 * (squared + covariance.determinant().max(1e-300).ln());
        self.innovation.1 += (squared.min(1e6) - self.innovation.1) / second;
        //= U Step vii: x = x^- + K (z - z^-), P = P^- - K P_zz K'
        let p = s.p - gain * covariance * gain.transpose();
        // Rounding makes it asymmetric, and an asymmetric covariance soon loses definiteness.
        Some(State {
            x: s.x + gain * innovation,
            p: (p + p.transpose()) * 0.5,
        })
    }
}

/// Sigma points around a state.
struct Points<const N: usize> {
    centre: SVector<f64, N>,
    /// Columns to add and to take away.
    steps: SMatrix<f64, N, N>,
    weight: f64,
}

impl<const N: usize> Points<N> {
    fn new(s: &State<N>) -> Option<Self> {
        //= U Step ii: chi = x, x +- columns of chol(N P), w = 1/(2 N)
        // kappa = 0: no weight on the centre and none below zero, whatever the number of states,
        // so that covariances stay positive; with three states the points are at sqrt(3) sigma.
        let steps = s.p.cholesky()?.l() * (N as f64).sqrt();
        Some(Self {
            centre: s.x,
            steps,
            weight: 0.5 / N as f64,
        })
    }

    /// Image of every point less that of the centre, as theta is large and its spread small.
    fn images<const M: usize>(
        &self,
        origin: &SVector<f64, M>,
        model: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    ) -> [[SVector<f64, M>; N]; 2] {
        [1.0, -1.0].map(|side| {
            std::array::from_fn(|k| model(&(self.centre + self.steps.column(k) * side)) - origin)
        })
    }

    fn through(
        &self,
        model: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
    ) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let origin = model(&self.centre);
        let images = self.images(&origin, model);
        let mut mean = SVector::zeros();
        images
            .iter()
            .flatten()
            .for_each(|image| mean += image * self.weight);
        let mut covariance = SMatrix::zeros();
        for image in images.iter().flatten() {
            let d = image - mean;
            covariance += d * d.transpose() * self.weight;
        }
        (origin + mean, covariance)
    }

    fn onto(
        &self,
        model: impl Fn(&SVector<f64, N>) -> Vector2<f64>,
    ) -> (Vector2<f64>, Matrix2<f64>, SMatrix<f64, N, 2>) {
        let origin = model(&self.centre);
        let images = self.images(&origin, model);
        let mut mean = Vector2::zeros();
        images
            .iter()
            .flatten()
            .for_each(|image| mean += image * self.weight);
        let (mut covariance, mut cross) = (Matrix2::zeros(), SMatrix::zeros());
        for (side, images) in [1.0, -1.0].into_iter().zip(&images) {
            for (step, image) in self.steps.column_iter().zip(images) {
                //= U Step vi: P_zz = sum_k w (z_k - z^-) (z_k - z^-)' + R,
                //=     P_xz = sum_k w (chi_k - x^-) (z_k - z^-)'
                let d = image - mean;
                covariance += d * d.transpose() * self.weight;
                cross += step * (d.transpose() * (side * self.weight));
            }
        }
        (origin + mean, covariance, cross)
    }
}

impl<const N: usize> JointTorqueEstimator for KalmanEstimator<N> {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        // An angle of 1e9 turns has no digits left for torsion.
        let bounded = sample.theta.abs() < 1e10 && sample.omega.abs() < 1e10;
        if !(Output::usable(sample) && bounded && sample.current.abs() < 1e10) {
            self.state = None;
            if let Some(gear) = &mut self.gear {
                gear.miss();
            }
            return self.output.held();
        }
        let p = &self.parameters.joint;
        let torsion = sample.theta / p.gear_ratio
            - sample.q
            - p.kinematic_error.error(sample.q, sample.theta);
        let limit = p.compliance.flexspline_torsion(p.torque_limit);
        let bounded = torsion.clamp(-2.0 * limit, 2.0 * limit);
        let [theta_variance, torsion_variance] = self.parameters.measurement;
        let (measured, variance) = match &mut self.gear {
            Some(gear) => {
                // Noise would move the springs to and fro: they follow the tracked torsion, and the
                // rest of the measured one counts by the stiffness there.
                let (followed, rate) = self.tracking.update(bounded);
                let followed = followed.clamp(-2.0 * limit, 2.0 * limit);
                let carried = gear.update(followed) + gear.parameters().damping * rate;
                let stiffness = gear.stiffness(followed);
                let tau = carried + stiffness * (bounded - followed);
                let tau = tau.clamp(-p.torque_limit, p.torque_limit);
                let linear = gear.parameters().linear.max(f64::MIN_POSITIVE);
                self.stiffness = (stiffness / linear).powi(2).clamp(1e-2, 1e2);
                (tau, torsion_variance * stiffness * stiffness)
            }
            None => (bounded, torsion_variance),
        };
        let r = Vector2::new(theta_variance, variance);
        let z = Vector2::new(sample.theta, measured);
        // No gear carries more than twice the limit: a larger current is a fault, not a torque.
        let bound = 2.0 * p.torque_limit / p.gear_ratio + p.wave_generator.friction;
        let tau_m = (p.wave_generator.torque_constant * sample.current).clamp(-bound, bound);
        let predicted = match &self.state {
            Some(s) => self.predict(s, tau_m),
            None => Some(self.start(sample, bounded)),
        };
        let corrected = predicted.and_then(|s| self.correct(&s, &z, &r));
        self.state = corrected.filter(|s| s.x.iter().chain(s.p.iter()).all(|x| x.is_finite()));
        let Some(s) = &self.state else {
            return self.output.held();
        };
        let saturated = torsion.abs() >= limit;
        let bearing = (self.gear.as_mut()).map_or(0.0, |gear| gear.bearing(sample.q, sample.dq));
        let (tau, variance) = (s.x[2] - bearing, s.p[(2, 2)].max(0.0));
        // Innovations beyond their expectation show that the covariance is too small.
        let inflation = (self.innovation.1 / 2.0).max(1.0).sqrt();
        let mut estimate = self.output.give(sample, tau, variance.sqrt() * inflation);
        if saturated {
            estimate.flags |= torque_flags::SATURATED;
        }
        estimate
    }

    fn reset(&mut self) {
        if let Some(gear) = &mut self.gear {
            gear.reset();
        }
        self.tracking.reset();
        self.stiffness = 1.0;
        self.state = None;
        self.innovation = (2.0, 2.0);
        self.output.reset();
    }
}
