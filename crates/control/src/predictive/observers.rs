//! Rotor observer and link observer: Kalman filters whose gains are computed once.

use super::parameters::LawParameters;
use nalgebra::{Matrix3, Vector3};

/// Motion of the rotor over a time with a constant torque, solved exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RotorStep {
    /// Length of the step, s.
    pub(super) time: f64,
    angle: [f64; 3],
    velocity: [f64; 3],
}

impl RotorStep {
    pub(super) fn new(p: &LawParameters, time: f64) -> Self {
        let j = p.rotor_inertia;
        // [theta, omega, torque]' with the spring of the drive.
        let rate = Matrix3::new(
            0.0,
            1.0,
            0.0,
            -p.drive_stiffness() / j,
            -p.rotor_damping() / j,
            1.0 / j,
            0.0,
            0.0,
            0.0,
        );
        let step = exponential(&(rate * time));
        let row = |i: usize| [step[(i, 0)], step[(i, 1)], step[(i, 2)]];
        Self {
            time,
            angle: row(0),
            velocity: row(1),
        }
    }

    /// Step from angle, velocity and constant torque to the next state, as a matrix.
    fn matrix(&self) -> Matrix3<f64> {
        let ([a, b, c], [d, e, f]) = (self.angle, self.velocity);
        Matrix3::new(a, b, c, d, e, f, 0.0, 0.0, 1.0)
    }
}

/// Exponential of a matrix by scaling, a series, and squaring.
fn exponential(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let halvings = 2 + matrix.norm().max(1.0).log2().ceil() as i32;
    let scaled = matrix * 0.5_f64.powi(halvings);
    let mut term = Matrix3::identity();
    let mut sum = Matrix3::identity();
    for k in 1..=16 {
        term = term * scaled / f64::from(k);
        sum += term;
    }
    for _ in 0..halvings {
        sum *= sum;
    }
    sum
}

/// How well an observer knows its state after a gap: its gains until the stationary ones hold again.
///
/// While the loop does not run a drive brakes its joint at a set-point that stands: the last state, the
/// acceleration of the link and the disturbance of the rotor, is not what it was, and with stationary gains the
/// velocities would be wrong for as long as the observer remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Uncertainty {
    step: Matrix3<f64>,
    walk: f64,
    /// Covariance after a sample, in units of a sample's variance: stationary, and now.
    stationary: Matrix3<f64>,
    covariance: Matrix3<f64>,
    /// Samples until it is stationary again.
    left: u32,
}

/// Samples after a gap from which on the stationary gains hold again.
const SETTLED: u32 = 60;
/// Variance by which the last state walks in a period of a gap, over that of any other period. It is far above one, so
/// that what was known of it is forgotten. Chosen; no experiment recorded.
const GAP_WALK: f64 = 1e7;

impl Uncertainty {
    fn new(step: Matrix3<f64>, walk: f64) -> Self {
        let (_, stationary) = kalman(&step, walk);
        Self {
            step,
            walk,
            stationary,
            covariance: stationary,
            left: 0,
        }
    }

    fn advance(&mut self, walk: f64) {
        self.covariance = self.step * self.covariance * self.step.transpose();
        self.covariance[(2, 2)] += walk;
    }

    /// A period of a gap.
    pub(super) fn sleep(&mut self) {
        self.advance(GAP_WALK * self.walk);
        self.left = SETTLED;
    }

    /// A gap was not long ago.
    pub(super) fn is_settling(&self) -> bool {
        self.left > 0
    }

    /// The gain of the next sample; none: the stationary one.
    pub(super) fn gain(&mut self) -> Option<[f64; 3]> {
        if self.left == 0 {
            return None;
        }
        self.advance(self.walk);
        let gain = take_sample(&mut self.covariance);
        self.left -= 1;
        if self.left == 0 {
            self.covariance = self.stationary;
        }
        Some(gain.into())
    }
}

/// theta, omega and the disturbance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rotor {
    pub(super) theta: f64,
    pub(super) omega: f64,
    pub(super) disturbance: f64,
    gain: [f64; 3],
}

impl Rotor {
    pub(super) fn new(p: &LawParameters) -> Self {
        let (step, walk) = Self::model(p);
        Self {
            theta: 0.0,
            omega: 0.0,
            disturbance: 0.0,
            gain: kalman(&step, walk).0,
        }
    }

    /// Rotor observer's step over a period, and the variance by which the disturbance walks in it: the one that makes
    /// the filter as fast as the design asks.
    fn model(p: &LawParameters) -> (Matrix3<f64>, f64) {
        let dt = p.sample_period;
        let walk = p.design.rotor.powi(3) * p.rotor_inertia * dt;
        (RotorStep::new(p, dt).matrix(), walk * walk)
    }

    pub(super) fn uncertainty(p: &LawParameters) -> Uncertainty {
        let (step, walk) = Self::model(p);
        Uncertainty::new(step, walk)
    }

    pub(super) fn start(&mut self, theta: f64) {
        (self.theta, self.omega, self.disturbance) = (theta, 0.0, 0.0);
    }

    /// `torque`: all torques on the rotor besides its damping, the drive's spring on `theta` and the
    /// disturbance.
    pub(super) fn advance(&mut self, step: &RotorStep, torque: f64) {
        let input = torque + self.disturbance;
        let by = |row: &[f64; 3]| row[0] * self.theta + row[1] * self.omega + row[2] * input;
        (self.theta, self.omega) = (by(&step.angle), by(&step.velocity));
    }

    /// `gain`: another one than the stationary.
    pub(super) fn correct(&mut self, theta: f64, disturbance_limit: f64, gain: Option<[f64; 3]>) {
        let error = theta - self.theta;
        let [a, b, c] = gain.unwrap_or(self.gain);
        self.theta += a * error;
        self.omega += b * error;
        let disturbance = self.disturbance + c * error;
        self.disturbance = disturbance.max(-disturbance_limit).min(disturbance_limit);
    }

    pub(super) fn is_finite(&self) -> bool {
        self.theta.is_finite() && self.omega.is_finite() && self.disturbance.is_finite()
    }

    pub(super) fn state(&self) -> [f64; 3] {
        [self.theta, self.omega, self.disturbance]
    }

    pub(super) fn set_state(&mut self, [theta, omega, disturbance]: [f64; 3]) {
        (self.theta, self.omega, self.disturbance) = (theta, omega, disturbance);
    }
}

/// q, dq and ddq.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Link {
    state: [f64; 3],
    gain: [f64; 3],
    dt: f64,
}

impl Link {
    pub(super) fn new(p: &LawParameters) -> Self {
        Self::with_bandwidth(p.design.link, p.sample_period)
    }

    /// Bandwidth, rad/s, and time between samples, s.
    pub(super) fn with_bandwidth(bandwidth: f64, dt: f64) -> Self {
        let (step, walk) = Self::model(bandwidth, dt);
        Self {
            state: [0.0; 3],
            gain: kalman(&step, walk).0,
            dt,
        }
    }

    /// Link observer's step over a period, and the variance by which the acceleration walks in it.
    fn model(bandwidth: f64, dt: f64) -> (Matrix3<f64>, f64) {
        let walk = bandwidth.powi(3) * dt;
        let step = Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0);
        (step, walk * walk)
    }

    pub(super) fn uncertainty(p: &LawParameters) -> Uncertainty {
        let (step, walk) = Self::model(p.design.link, p.sample_period);
        Uncertainty::new(step, walk)
    }

    pub(super) fn start(&mut self, q: f64) {
        self.state = [q, 0.0, 0.0];
    }

    pub(super) fn advance(&mut self) {
        let ([q, dq, ddq], dt) = (self.state, self.dt);
        self.state = [q + dt * dq + 0.5 * dt * dt * ddq, dq + dt * ddq, ddq];
    }

    /// `gain`: another one than the stationary.
    pub(super) fn correct(&mut self, q: f64, gain: Option<[f64; 3]>) {
        let error = q - self.state[0];
        let gain = gain.unwrap_or(self.gain);
        for (state, gain) in self.state.iter_mut().zip(gain) {
            *state += gain * error;
        }
    }

    pub(super) fn velocity(&self) -> f64 {
        self.state[1]
    }

    pub(super) fn is_finite(&self) -> bool {
        self.state.iter().all(|x| x.is_finite())
    }

    pub(super) fn state(&self) -> [f64; 3] {
        self.state
    }

    pub(super) fn set_state(&mut self, state: [f64; 3]) {
        self.state = state;
    }
}

/// Gain of a Kalman filter for a sample of the first of three states with unit variance, and the covariance after it.
fn take_sample(covariance: &mut Matrix3<f64>) -> Vector3<f64> {
    let column: Vector3<f64> = covariance.column(0).into();
    let gain = column / (column[0] + 1.0);
    *covariance -= gain * column.transpose();
    // Rounding must not make it lopsided.
    *covariance = 0.5 * (*covariance + covariance.transpose());
    gain
}

/// Stationary gain of that filter, whose last state walks with variance `walk` a step, and covariance after a sample.
fn kalman(step: &Matrix3<f64>, walk: f64) -> ([f64; 3], Matrix3<f64>) {
    let mut covariance = Matrix3::from_diagonal(&Vector3::new(1e6, 1e10, 1e6 * walk));
    let mut gain = Vector3::zeros();
    for _ in 0..20_000 {
        covariance = step * covariance * step.transpose();
        covariance[(2, 2)] += walk;
        let next = take_sample(&mut covariance);
        let settled = (next - gain).component_div(&next).amax() < 1e-12;
        gain = next;
        if settled {
            break;
        }
    }
    (gain.into(), covariance)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The exact step against ten thousand small ones.
    #[test]
    fn a_step_of_the_rotor_is_the_sum_of_small_ones() {
        let p = LawParameters::example();
        let mut rotor = Rotor::new(&p);
        rotor.set_state([0.01, 0.3, 2.0]);
        let (mut theta, mut omega) = (0.01_f64, 0.3_f64);
        let step = RotorStep::new(&p, 1e-3);
        rotor.advance(&step, 5.0);
        let h = 1e-7;
        for _ in 0..10_000 {
            let a = (5.0 + 2.0 - 8000.0 * theta - 58.0 * omega) / 0.114;
            omega += h * a;
            theta += h * omega;
        }
        assert!(
            (rotor.theta - theta).abs() < 1e-7,
            "{} {theta}",
            rotor.theta
        );
        assert!(
            (rotor.omega - omega).abs() < 1e-4,
            "{} {omega}",
            rotor.omega
        );
    }

    /// A rotor that the model does not explain: the observer finds the torque that is missing, within
    /// a few of its time constants.
    #[test]
    fn the_observer_finds_a_constant_disturbance() {
        let p = LawParameters::example();
        let step = RotorStep::new(&p, 1e-3);
        let mut truth = Rotor::new(&p);
        let mut observer = Rotor::new(&p);
        truth.set_state([0.0, 0.0, 3.0]);
        for k in 0..100 {
            let torque = 2.0 * (0.1 * f64::from(k)).sin();
            truth.advance(&step, torque);
            observer.advance(&step, torque);
            observer.correct(truth.theta, 10.0, None);
        }
        assert!((observer.disturbance - 3.0).abs() < 0.01, "{observer:?}");
        assert!((observer.omega - truth.omega).abs() < 1e-4);
    }

    /// A joint that is braked while nobody looks: with the gains of a gap its velocity is known from the second
    /// sample on, with the stationary ones not before a hundred milliseconds later.
    #[test]
    fn after_a_gap_the_velocity_is_found_at_once() {
        let p = LawParameters::example();
        let mut uncertainty = Link::uncertainty(&p);
        let (mut link, mut slow) = (Link::new(&p), Link::new(&p));
        let dt = p.sample_period;
        let (mut q, mut dq) = (0.3, 0.35);
        for observer in [&mut link, &mut slow] {
            observer.set_state([q, dq, 0.0]);
        }
        for k in 0..24 {
            q += dt * dq - 0.5 * dt * dt * 25.0;
            dq -= 25.0 * dt;
            link.advance();
            slow.advance();
            if k < 10 {
                uncertainty.sleep();
                continue;
            }
            let gain = uncertainty.gain();
            // A hundredth of a milliradian of noise.
            let sample = q + if k % 2 == 0 { 1e-5 } else { -1e-5 };
            link.correct(sample, gain);
            slow.correct(sample, None);
            if k > 10 {
                let errors = [&link, &slow].map(|observer| (observer.velocity() - dq).abs());
                assert!(errors[0] < 0.08 && errors[0] < errors[1], "{k}: {errors:?}");
            }
        }
        for _ in 0..SETTLED {
            let _ = uncertainty.gain();
        }
        assert_eq!(uncertainty.gain(), None);
        assert_eq!(uncertainty, Link::uncertainty(&p));
    }
}
