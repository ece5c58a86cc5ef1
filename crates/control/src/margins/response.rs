//! Frequency responses and margins of a lifted loop.

use super::Margins;
use super::lifted::{Lifted, SUBSTEPS};
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, DVector, Schur};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Lowest frequency of interest, Hz. Chosen; no experiment recorded.
const LOWEST: f64 = 0.2;
/// Frequencies of a curve.
const POINTS: usize = 300;
/// Highest frequency of the open loop, over the rate of the samples: the drive's own loop is faster.
const HIGHEST: f64 = 2.0;
/// Highest frequency of a loop that is known at the samples alone, over their rate: Nyquist's.
const HIGHEST_SAMPLED: f64 = 0.5;
/// Frequency from which on `1 + L` is followed, Hz: there the poles at zero are all that counts.
const SLOWEST: f64 = 1e-3;
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
    pub(super) fn new(frequency: f64, value: Complex<f64>) -> Self {
        Self {
            frequency,
            re: value.re,
            im: value.im,
        }
    }

    /// Absolute value of the complex number.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.re.hypot(self.im)
    }

    /// Angle of the complex number, rad, from -pi to pi.
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
        // Balanced, as rounding splits the double eigenvalue the further the wider the range of the numbers: in N and m
        // forces are a million times as large as ways. Numbers of wide range may keep the iteration from an end.
        let mut balanced = closed.clone();
        balance_parlett_reinsch(&mut balanced);
        let schur = Schur::try_new(balanced, f64::EPSILON, MAX_ITERATIONS);
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
        let mut resolvent = Resolvent::new(&l.a);
        let frequencies: Vec<f64> = self.frequencies(HIGHEST).collect();
        let count = frequencies.len();
        let angle = |k: usize| TAU * frequencies[k] * l.sample_period;
        // Real parts of all frequencies, then imaginary parts: products of real matrices are much quicker.
        let sines = DMatrix::from_fn(SUBSTEPS, 2 * count, |step, k| {
            let angle = angle(k % count) * step as f64 / SUBSTEPS as f64;
            if k < count { angle.cos() } else { angle.sin() }
        });
        let mut states = resolvent.input(&l.b) * &sines;
        let mut state = vec![Complex::default(); states.nrows()];
        for k in 0..count {
            for (i, x) in state.iter_mut().enumerate() {
                *x = Complex::new(states[(i, k)], states[(i, count + k)]);
            }
            // A point of what is not finite is left out.
            resolvent.solve(angle(k), &mut state);
            for (i, x) in state.iter().enumerate() {
                (states[(i, k)], states[(i, count + k)]) = (x.re, x.im);
            }
        }
        let made = resolvent.output(&l.c) * states + &l.d * &sines;
        let mean = |k: usize| {
            let (re, im) = (made.column(k), made.column(count + k));
            let (cos, sin) = (sines.column(k), sines.column(count + k));
            // Mean of the output times the sine's conjugate: its complex amplitude.
            let sum = Complex::new(cos.dot(&re) + sin.dot(&im), cos.dot(&im) - sin.dot(&re));
            sum / SUBSTEPS as f64
        };
        (frequencies.iter().enumerate())
            .map(|(k, &frequency)| Point::new(frequency, -mean(k)))
            .filter(|point| point.re.is_finite() && point.im.is_finite())
            .collect()
    }

    /// The closed loop's response, from the desired torque to the torque of the gear.
    #[must_use]
    pub fn torque_response(&self) -> Vec<Point> {
        let l = &self.lifted;
        let mut resolvent = Resolvent::new(&l.closed);
        let input = resolvent.input(&l.from_desired);
        let output = resolvent.output(&l.torque);
        self.frequencies(0.49)
            .filter_map(|frequency| {
                let angle = TAU * frequency * l.sample_period;
                let mut x: Vec<_> = input.iter().map(|&x| Complex::from(x)).collect();
                let finite = resolvent.solve(angle, &mut x);
                let made = output.iter().zip(&x).map(|(c, x)| x * c).sum();
                finite.then(|| Point::new(frequency, made))
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
        if self.is_stable() {
            least_distances(&self.open_loop())
        } else {
            Margins::NONE
        }
    }

    /// Frequencies from the lowest one to a share of the sample rate.
    fn frequencies(&self, share: f64) -> impl Iterator<Item = f64> {
        frequencies(share / self.lifted.sample_period)
    }
}

/// Frequencies from the lowest one to `highest`, Hz, at equal ratios.
fn frequencies(highest: f64) -> impl Iterator<Item = f64> {
    frequencies_between(LOWEST, highest)
}

/// Frequencies from `lowest` to `highest`, Hz, at equal ratios.
fn frequencies_between(lowest: f64, highest: f64) -> impl Iterator<Item = f64> {
    let ratio = (highest / lowest).powf(1.0 / (POINTS - 1) as f64);
    (0..POINTS).map(move |k| lowest * ratio.powi(k as i32))
}

/// Response up to Nyquist's frequency of a loop that is known by its value at an angular frequency, rad/s.
pub(super) fn sampled(sample_period: f64, of: impl Fn(f64) -> Complex<f64>) -> Vec<Point> {
    frequencies(HIGHEST_SAMPLED / sample_period)
        .map(|frequency| Point::new(frequency, of(TAU * frequency)))
        .collect()
}

/// Margins of a loop by its open loop `L` at an angular frequency, rad/s, which has no pole right of the imaginary axis,
/// and so many `poles` at zero. It is stable if `1 + L` turns by a quarter for each of them, and ends at 1 (Nyquist).
pub(super) fn nyquist(
    poles: u8,
    sample_period: f64,
    open: impl Fn(f64) -> Complex<f64>,
) -> Margins {
    let mut phase = -FRAC_PI_2 * f64::from(poles);
    let slow = frequencies_between(SLOWEST, LOWEST);
    for frequency in slow.chain(frequencies(HIGHEST_SAMPLED / sample_period)) {
        let open = open(TAU * frequency);
        if !(open.re.is_finite() && open.im.is_finite()) {
            return Margins::NONE;
        }
        let angle = open.im.atan2(1.0 + open.re);
        phase += (angle - phase + PI).rem_euclid(TAU) - PI;
    }
    if phase.abs() < FRAC_PI_2 {
        least_distances(&sampled(sample_period, open))
    } else {
        Margins::NONE
    }
}

/// Responses, at one angular frequency, of what acts at the samples of a period.
pub(super) struct Delays {
    w: f64,
    period: f64,
}

impl Delays {
    pub(super) fn new(w: f64, period: f64) -> Self {
        Self { w, period }
    }

    /// A delay, s.
    pub(super) fn of(&self, time: f64) -> Complex<f64> {
        Complex::from_polar(1.0, -self.w * time)
    }

    /// A filter with these weights of the samples, oldest first: the newest is not delayed.
    pub(super) fn taps(&self, weights: &[f64]) -> Complex<f64> {
        let last = self.of(self.period);
        let zero = Complex::new(0.0, 0.0);
        (weights.iter()).fold(zero, |sum, &weight| sum * last + weight)
    }

    /// A sum over the samples, this times each.
    pub(super) fn sum(&self, times: f64) -> Complex<f64> {
        let one = Complex::new(1.0, 0.0);
        one * times / (one - self.of(self.period))
    }

    /// A command that is held for a period.
    pub(super) fn hold(&self) -> Complex<f64> {
        let half = 0.5 * self.w * self.period;
        self.of(0.5 * self.period) * (half.sin() / half)
    }
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

/// `(z 1 - A)^-1` for many z: A is balanced and made a Hessenberg matrix once.
struct Resolvent {
    /// States by those that are balanced.
    scale: DVector<f64>,
    basis: DMatrix<f64>,
    /// Row by row.
    hessenberg: Vec<f64>,
    /// Rows and columns that are eliminated, row by row.
    matrix: Vec<Complex<f64>>,
}

impl Resolvent {
    fn new(a: &DMatrix<f64>) -> Self {
        let mut balanced = a.clone();
        let scale = balance_parlett_reinsch(&mut balanced);
        let (basis, hessenberg) = balanced.hessenberg().unpack();
        let hessenberg = hessenberg.transpose().as_slice().to_vec();
        Self {
            scale,
            basis,
            matrix: vec![Complex::default(); hessenberg.len()],
            hessenberg,
        }
    }

    /// An input in the basis of the Hessenberg matrix.
    fn input(&self, input: &DMatrix<f64>) -> DMatrix<f64> {
        let mut balanced = input.clone();
        for (mut row, scale) in balanced.row_iter_mut().zip(&self.scale) {
            row /= *scale;
        }
        self.basis.tr_mul(&balanced)
    }

    /// An output of that basis.
    fn output(&self, output: &DMatrix<f64>) -> DMatrix<f64> {
        let mut balanced = output.clone();
        for (mut column, scale) in balanced.column_iter_mut().zip(&self.scale) {
            column *= *scale;
        }
        balanced * &self.basis
    }

    /// Solves for the state from an input at `z = e^(i angle)`: elimination of the one diagonal below the main one,
    /// with pivots. Returns whether the state is finite.
    fn solve(&mut self, angle: f64, x: &mut [Complex<f64>]) -> bool {
        let z = Complex::from_polar(1.0, angle);
        let n = x.len();
        for (m, h) in self.matrix.iter_mut().zip(&self.hessenberg) {
            *m = Complex::new(-h, 0.0);
        }
        for diagonal in self.matrix.iter_mut().step_by(n + 1) {
            *diagonal += z;
        }
        for k in 0..n.saturating_sub(1) {
            let (above, below) = self.matrix.split_at_mut((k + 1) * n);
            let (above, below) = (&mut above[k * n + k..], &mut below[k..n]);
            if below[0].norm_sqr() > above[0].norm_sqr() {
                above.swap_with_slice(below);
                x.swap(k, k + 1);
            }
            let factor = below[0] / above[0];
            for (below, above) in below.iter_mut().zip(above.iter()).skip(1) {
                *below -= factor * above;
            }
            let known = x[k];
            x[k + 1] -= factor * known;
        }
        for (k, row) in self.matrix.chunks_exact(n).enumerate().rev() {
            let known = row[k + 1..].iter().zip(&x[k + 1..]);
            let rest = known.fold(x[k], |rest, (m, x)| rest - m * x);
            x[k] = rest / row[k];
        }
        x.iter().all(|x| x.re.is_finite() && x.im.is_finite())
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
                if gain < 1.0 {
                    least.gain = least.gain.min(1.0 / gain)
                } else {
                    least.reduction = least.reduction.min(gain)
                }
            }
        }
    }
    least
}

pub(super) fn between(a: &Point, b: &Point, share: f64) -> Point {
    let at = |a: f64, b: f64| a + share * (b - a);
    Point {
        frequency: at(a.frequency, b.frequency),
        re: at(a.re, b.re),
        im: at(a.im, b.im),
    }
}
