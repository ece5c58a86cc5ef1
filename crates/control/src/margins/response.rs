//! Frequency responses and margins of a lifted loop.

use super::Margins;
use super::lifted::{Lifted, SUBSTEPS};
use nalgebra::{Complex, DMatrix, DVector, Schur};
use std::f64::consts::{PI, TAU};

/// Lowest frequency of interest, Hz.
pub(super) const LOWEST: f64 = 0.2;
/// Frequencies of a curve.
const POINTS: usize = 300;
/// Highest frequency of the open loop, over the rate of the samples: the drive's own loop is faster.
const HIGHEST: f64 = 2.0;
/// Eigenvalues up to this count as stable: a free link stays where it is put, or moves on, and rounding
/// splits the double eigenvalue 1.
const STABLE: f64 = 1.0 + 3e-5;

/// Iterations of the eigenvalues: some two for each is usual.
const MAX_ITERATIONS: usize = 10_000;

/// A point of a frequency response.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Frequency, Hz.
    pub frequency: f64,
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Point {
    /// Its absolute value.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.re.hypot(self.im)
    }

    /// Its angle, rad, from -pi to pi.
    #[must_use]
    pub fn phase(&self) -> f64 {
        self.im.atan2(self.re)
    }
}

/// The loop of a joint with a load.
#[derive(Debug, Clone)]
pub struct ClosedLoop {
    lifted: Lifted,
}

impl ClosedLoop {
    pub(super) fn new(lifted: Lifted) -> Self {
        Self { lifted }
    }

    /// Whether the closed loop comes to rest.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        let closed = &self.lifted.closed;
        if closed.iter().any(|value| !value.is_finite()) {
            return false;
        }
        // Numbers of wide range may keep the iteration from an end.
        let schur = Schur::try_new(closed.clone(), f64::EPSILON, MAX_ITERATIONS);
        schur.is_some_and(|schur| {
            let eigenvalues = schur.complex_eigenvalues();
            eigenvalues.iter().all(|value| value.norm() <= STABLE)
        })
    }

    /// The open loop's response, from the torque on the rotor to minus the torque that the drive
    /// makes: -1 is the critical point.
    #[must_use]
    pub fn open_loop(&self) -> Vec<Point> {
        let l = &self.lifted;
        let resolvent = Resolvent::new(&l.a);
        let frequencies: Vec<f64> = self.frequencies(HIGHEST).collect();
        let count = frequencies.len();
        let angle = |k: usize| TAU * frequencies[k] * l.sample_period;
        // Real parts of all frequencies, then imaginary parts: products of real matrices are much quicker.
        let sines = DMatrix::from_fn(SUBSTEPS, 2 * count, |step, k| {
            let angle = angle(k % count) * step as f64 / SUBSTEPS as f64;
            if k < count { angle.cos() } else { angle.sin() }
        });
        let mut states = resolvent.input(&l.b) * &sines;
        for k in 0..count {
            let part = |i: usize| Complex::new(states[(i, k)], states[(i, count + k)]);
            let input = DVector::from_fn(states.nrows(), |i, _| part(i));
            let state = resolvent.solve(angle(k), input);
            for i in 0..states.nrows() {
                let value = state.as_ref().map(|state| state[i]);
                let value = value.unwrap_or(Complex::new(f64::NAN, f64::NAN));
                (states[(i, k)], states[(i, count + k)]) = (value.re, value.im);
            }
        }
        let made = resolvent.output(&l.c) * states + &l.d * &sines;
        let mean = |k: usize| {
            let (re, im) = (made.column(k), made.column(count + k));
            let (cos, sin) = (sines.column(k), sines.column(count + k));
            // Of the conjugate of the sine, times what is made.
            let sum = Complex::new(cos.dot(&re) + sin.dot(&im), cos.dot(&im) - sin.dot(&re));
            sum / SUBSTEPS as f64
        };
        (frequencies.iter().enumerate())
            .map(|(k, &frequency)| point(frequency, -mean(k)))
            .filter(|point| point.re.is_finite() && point.im.is_finite())
            .collect()
    }

    /// The closed loop's response, from the desired torque to the torque of the gear.
    #[must_use]
    pub fn torque_response(&self) -> Vec<Point> {
        let l = &self.lifted;
        let resolvent = Resolvent::new(&l.closed);
        let input = complex(&resolvent.input(&l.from_desired));
        let output = complex(&resolvent.output(&l.torque));
        self.frequencies(0.49)
            .filter_map(|frequency| {
                let angle = TAU * frequency * l.sample_period;
                let x = resolvent.solve(angle, input.column(0).into_owned())?;
                Some(point(frequency, (&output * &x).sum()))
            })
            .collect()
    }

    /// Frequency at which the torque response has fallen by 3 dB, Hz.
    #[must_use]
    pub fn bandwidth(&self) -> f64 {
        fallen_by_3_db(&self.torque_response())
    }

    /// Gain and phase margin.
    #[must_use]
    pub fn margins(&self) -> Margins {
        match self.is_stable() {
            true => least_distances(&self.open_loop()),
            false => Margins::NONE,
        }
    }

    /// From the lowest frequency to a share of the sample rate.
    fn frequencies(&self, share: f64) -> impl Iterator<Item = f64> {
        frequencies(share / self.lifted.sample_period)
    }
}

/// From the lowest frequency to this one, Hz, at equal ratios.
pub(super) fn frequencies(highest: f64) -> impl Iterator<Item = f64> {
    frequencies_between(LOWEST, highest)
}

/// From one frequency to another, Hz, at equal ratios.
pub(super) fn frequencies_between(lowest: f64, highest: f64) -> impl Iterator<Item = f64> {
    let ratio = (highest / lowest).powf(1.0 / (POINTS - 1) as f64);
    (0..POINTS).map(move |k| lowest * ratio.powi(k as i32))
}

/// Frequency at which a response has fallen by 3 dB, Hz; zero if it begins below.
pub(super) fn fallen_by_3_db(response: &[Point]) -> f64 {
    let fallen = response.windows(2).find(
        |pair| matches!(pair, [a, b] if a.gain() >= 0.5_f64.sqrt() && b.gain() < 0.5_f64.sqrt()),
    );
    match fallen {
        Some([a, b]) => {
            let share = (a.gain() - 0.5_f64.sqrt()) / (a.gain() - b.gain());
            a.frequency + share * (b.frequency - a.frequency)
        }
        _ if response.first().is_some_and(|p| p.gain() < 0.5_f64.sqrt()) => 0.0,
        _ => response.last().map_or(0.0, |p| p.frequency),
    }
}

/// `(z 1 - A)^-1` for many z: A is made a Hessenberg matrix once.
struct Resolvent {
    basis: DMatrix<f64>,
    hessenberg: DMatrix<f64>,
}

impl Resolvent {
    fn new(a: &DMatrix<f64>) -> Self {
        let (basis, hessenberg) = a.clone().hessenberg().unpack();
        Self { basis, hessenberg }
    }

    /// An input in the basis of the Hessenberg matrix.
    fn input(&self, input: &DMatrix<f64>) -> DMatrix<f64> {
        self.basis.tr_mul(input)
    }

    /// An output of that basis.
    fn output(&self, output: &DMatrix<f64>) -> DMatrix<f64> {
        output * &self.basis
    }

    /// The state at `z = e^(i angle)`: elimination of the one diagonal below the main one, with
    /// pivots.
    fn solve(&self, angle: f64, mut x: DVector<Complex<f64>>) -> Option<DVector<Complex<f64>>> {
        let z = Complex::from_polar(1.0, angle);
        let mut m = self.hessenberg.map(|h| Complex::new(-h, 0.0));
        let n = m.nrows();
        for i in 0..n {
            m[(i, i)] += z;
        }
        for k in 0..n.saturating_sub(1) {
            if m[(k + 1, k)].norm_sqr() > m[(k, k)].norm_sqr() {
                for j in k..n {
                    m.swap((k, j), (k + 1, j));
                }
                x.swap_rows(k, k + 1);
            }
            let factor = m[(k + 1, k)] / m[(k, k)];
            for j in k + 1..n {
                let above = m[(k, j)];
                m[(k + 1, j)] -= factor * above;
            }
            let above = x[k];
            x[k + 1] -= factor * above;
        }
        for k in (0..n).rev() {
            for j in k + 1..n {
                let known = x[j];
                x[k] -= m[(k, j)] * known;
            }
            x[k] /= m[(k, k)];
        }
        x.iter()
            .all(|x| x.re.is_finite() && x.im.is_finite())
            .then_some(x)
    }
}

/// Margins of a stable closed loop by its open loop's curve.
pub(super) fn least_distances(open: &[Point]) -> Margins {
    let mut least = Margins {
        phase: PI,
        gain: f64::INFINITY,
        reduction: f64::INFINITY,
    };
    for pair in open.windows(2) {
        let [a, b] = pair else { continue };
        if (a.gain() - 1.0) * (b.gain() - 1.0) <= 0.0 && a.gain() != b.gain() {
            let share = (1.0 - a.gain()) / (b.gain() - a.gain());
            least.phase = least.phase.min(PI - between(a, b, share).phase().abs());
        }
        if a.im * b.im <= 0.0 && a.im != b.im {
            let crossing = between(a, b, -a.im / (b.im - a.im));
            if crossing.re < 0.0 {
                let gain = -crossing.re;
                match gain < 1.0 {
                    true => least.gain = least.gain.min(1.0 / gain),
                    false => least.reduction = least.reduction.min(gain),
                }
            }
        }
    }
    least
}

fn between(a: &Point, b: &Point, share: f64) -> Point {
    let at = |a: f64, b: f64| a + share * (b - a);
    Point {
        frequency: at(a.frequency, b.frequency),
        re: at(a.re, b.re),
        im: at(a.im, b.im),
    }
}

fn point(frequency: f64, value: Complex<f64>) -> Point {
    Point {
        frequency,
        re: value.re,
        im: value.im,
    }
}

fn complex(matrix: &DMatrix<f64>) -> DMatrix<Complex<f64>> {
    matrix.map(|x| Complex::new(x, 0.0))
}
