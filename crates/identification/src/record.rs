//! A log as the samples and filtered signals that fits compare.

use crate::log::LogRow;
use estimators::filter_bank::FilterBank;
use estimators::joint::JointSample;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use joint_file::JointFile;
use robot_state::measured_flags;

/// Errors of a reference torque as a whole, which no residual shows: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceErrors {
    /// Of its gain, 1.
    pub gain: f64,
    /// Of its zero, N·m.
    pub offset: f64,
}

impl ReferenceErrors {
    /// Those of a torque sensor of class 0.1 in a joint of this rated torque, N·m.
    #[must_use]
    pub fn of_a_sensor(rated_torque: f64) -> Self {
        Self {
            gain: 1e-3,
            offset: 5e-4 * rated_torque,
        }
    }
}

/// Samples of a log as the estimators take them, and the torque sensor's.
#[derive(Debug, Clone)]
pub struct Record {
    /// Samples as the front end makes them: skew removed.
    pub samples: Vec<JointSample>,
    /// tau_sensor, N·m; NaN where there is none.
    pub tau: Vec<f64>,
    /// dq and ddq by centred filters, without delay, rad/s and rad/s².
    pub motion: Vec<[f64; 2]>,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// First sample of each log: filters do not reach over a pause.
    begins: Vec<usize>,
}

/// Window of the centred filters, s: short against motion, long against noise.
const WINDOW_S: f64 = 0.025;

/// Time without a sample that separates two logs, s.
pub const PAUSE_S: f64 = 1.0;

/// Standard deviation of a normal variable over the median of its absolute value.
const MEDIAN_TO_SIGMA: f64 = 1.4826;
/// Samples from which a signal's noise is estimated, at most.
const MAX_NOISE_SAMPLES: usize = 20_000;

impl Record {
    /// Runs a log through the joint's front end.
    ///
    /// # Errors
    /// A joint file from which no front end can be built.
    pub fn new(joint: &JointFile, rows: &[LogRow]) -> Result<Self, problem::Problem> {
        let mut front_end = joint.front_end()?;
        let sample_period = joint.sample_period();
        let mut last = None;
        let mut samples = Vec::with_capacity(rows.len());
        let mut begins = Vec::new();
        for row in rows {
            if last.is_none_or(|last| row.t - last > PAUSE_S) {
                begins.push(samples.len());
                front_end.reset();
                last = None;
            }
            front_end.bridge(last.replace(row.t), row.t);
            samples.push(row.sample(&mut front_end));
        }
        let tau = rows.iter().map(|row| row.tau_sensor).collect();
        let mut record = Self {
            samples,
            tau,
            motion: Vec::new(),
            sample_period,
            gear_ratio: joint.joint.gear_ratio,
            begins,
        };
        // The motor-side angle has the finer resolution on the link side.
        let angle: Vec<f64> = record
            .samples
            .iter()
            .map(|s| s.theta / record.gear_ratio)
            .collect();
        let [first, second] = [1, 2].map(|d| record.smooth(&angle, d));
        record.motion = first.into_iter().zip(second).map(|(v, a)| [v, a]).collect();
        Ok(record)
    }

    /// A signal (or its derivative) through a centred filter, without delay.
    #[must_use]
    pub fn smooth(&self, signal: &[f64], derivative: usize) -> Vec<f64> {
        let half = ((0.5 * WINDOW_S / self.sample_period) as usize).max(2);
        self.each_log(signal, |log| {
            smooth(log, derivative, half, self.sample_period)
        })
    }

    /// A signal through `of`, each log by itself.
    #[must_use]
    pub fn each_log(&self, signal: &[f64], of: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
        // Long logs: no more memory than it takes.
        let mut all = Vec::with_capacity(signal.len());
        for log in self.logs() {
            all.extend_from_slice(&of(signal.get(log).unwrap_or_default()));
        }
        all
    }

    /// First sample of each log.
    #[must_use]
    pub fn log_begins(&self) -> &[usize] {
        &self.begins
    }

    /// The samples of each log.
    fn logs(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let ends = self.begins.iter().skip(1).copied();
        let ends = ends.chain([self.samples.len()]);
        self.begins.iter().zip(ends).map(|(begin, end)| *begin..end)
    }

    /// Standard deviation of a signal's noise, its difference from the centred filter's output.
    ///
    /// By the median: sudden loads are no noise, but would dominate a mean of squares.
    #[must_use]
    pub fn noise(&self, signal: &[f64]) -> f64 {
        let smooth = self.smooth(signal, 0);
        let mut rests: Vec<f64> = self
            .spread(MAX_NOISE_SAMPLES)
            .map(|i| (signal[i] - smooth[i]).abs())
            .collect();
        rests.sort_by(f64::total_cmp);
        MEDIAN_TO_SIGMA * rests.get(rests.len() / 2).copied().unwrap_or(0.0)
    }

    /// theta/N - q of every sample, rad.
    #[must_use]
    pub fn torsion(&self) -> Vec<f64> {
        self.samples
            .iter()
            .map(|s| s.theta / self.gear_ratio - s.q)
            .collect()
    }

    /// Motor current of every sample, A.
    #[must_use]
    pub fn current(&self) -> Vec<f64> {
        self.samples.iter().map(|s| s.current).collect()
    }

    /// Whether a sample may be fitted to: nothing was missed, and no filter is at its start or end.
    #[must_use]
    pub fn usable(&self, i: usize) -> bool {
        let edge = (2.0 * WINDOW_S / self.sample_period) as usize;
        let flags = self
            .samples
            .get(i)
            .map_or(measured_flags::NEVER, |s| s.flags);
        let log = self.begins.partition_point(|begin| *begin <= i);
        let begin = log.checked_sub(1).and_then(|log| self.begins.get(log));
        let end = self.begins.get(log).copied().unwrap_or(self.samples.len());
        flags == 0 && begin.is_some_and(|begin| i >= begin + edge) && i + edge < end
    }

    /// Samples that may be fitted to, at most about `most` of them, evenly spread.
    pub fn spread(&self, most: usize) -> impl Iterator<Item = usize> {
        let step = self.samples.len().div_ceil(most.max(1)).max(1);
        (0..self.samples.len())
            .step_by(step)
            .filter(|&i| self.usable(i))
    }
}

/// A signal (or its derivative) through a centred filter of `2 half + 1` samples: the parabola of
/// least squares about each sample (Savitzky and Golay), without delay.
#[must_use]
pub fn smooth(signal: &[f64], derivative: usize, half: usize, sample_period: f64) -> Vec<f64> {
    let parameters = SavitzkyGolayParameters::centred(2 * half + 1, 2, derivative, sample_period);
    let Ok(mut bank) = FilterBank::new(1, parameters) else {
        return signal.to_vec();
    };
    let mut out = Vec::with_capacity(signal.len());
    let last = signal.last().copied().unwrap_or(0.0);
    let padded = signal
        .iter()
        .copied()
        .chain(std::iter::repeat_n(last, half));
    for (i, x) in padded.enumerate() {
        bank.update(&[x]);
        if i >= half {
            out.push(match derivative {
                0 => bank.values()[0],
                1 => bank.first_derivatives()[0],
                _ => bank.second_derivatives()[0],
            });
        }
    }
    out
}

/// Standard deviation of a signal's noise: of its differences from the centred filter, by the
/// median, as steps are no noise.
#[must_use]
pub fn noise(signal: &[f64], half: usize, sample_period: f64) -> f64 {
    let smooth = smooth(signal, 0, half, sample_period);
    let mut rests: Vec<f64> = signal
        .iter()
        .zip(&smooth)
        .map(|(x, s)| (x - s).abs())
        .collect();
    rests.sort_by(f64::total_cmp);
    MEDIAN_TO_SIGMA * rests.get(rests.len() / 2).copied().unwrap_or(0.0)
}
