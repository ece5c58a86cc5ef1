//! Align: filtered signals brought to the instant of SYNC, from the known ages of their samples.
//!
//! Sample k of a signal x was taken at `t_k - delta_k`: SYNC of cycle k less the sample's age. To
//! a linear filter F_j (value, first, second derivative: j = 0, 1, 2) that is read at `t_r`, the
//! samples `y_k = x(t_k - delta_k)` of a parabola with derivatives a and b at `t_r` are, with
//! `tau_k = t_k - t_r`,
//!
//! ```text
//! F_j[y] = F_j[x] - a F_j[delta] - b F_j[tau delta - delta²/2]
//! ```
//!
//! for any kernel and any course of the ages. So the ages pass the same filter as the signal, as two
//! more channels, and the formula removes their effect from the signal's outputs. No single sample
//! is extrapolated, which would amplify noise. With `F_1[x] = a` and
//! `F_2[x] = b` (kernels that differentiate a parabola exactly) a and b follow from two equations.
//! The remaining error is of third order: for a constant age `delta³/6` of the third derivative in the
//! value, `delta²/2` in the first derivative, `delta` in the second. Filters whose value and
//! derivatives pass different bands (Savitzky-Golay) leave the share by which these differ.

use estimators::filter_bank::{FilterBank, FilterDesign};
use problem::Problem;
use robot_config::slots::{self, Source};
use robot_config::{Robot, Sampled, Sampling};

use crate::time::{SECONDS_PER_NS, Stamp};

/// Own periods after which the next sample of a source with a clock of its own is overdue: it may send none between two
/// cycles though it has missed none.
pub(crate) const OVERDUE: f64 = 2.0;
/// Value, first and second derivative.
pub(crate) type Outputs = [f64; 3];

/// One signal of a bank: its sampling, its source and its message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Signal {
    pub(crate) sampling: Sampling,
    pub(crate) source: Source,
    pub(crate) message: usize,
}

/// Signals of one message and source, whose ages vary alike.
#[derive(Debug, Clone, Copy)]
struct Varying {
    /// Index of one of these signals.
    signal: usize,
    message: usize,
    latency: f64,
    /// Largest possible time between SYNC and stamp, s.
    longest: f64,
    moments: usize,
}

impl Varying {
    /// delta: age of the sample at SYNC, s; negative if it was taken afterwards.
    fn age(&self, stamps: &[Option<u64>], sync: Stamp) -> f64 {
        let stamp = stamps.get(self.message).copied().flatten();
        stamp.map_or(f64::NAN, |stamp| {
            let sent = sync.0.wrapping_sub(stamp).cast_signed() as f64 * SECONDS_PER_NS;
            sent.clamp(-self.longest, self.longest) + self.latency
        })
    }
}

/// A filter's outputs for the ages of one source's samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moments {
    /// F_j[delta], s^(1-j).
    first: Outputs,
    /// F_j[tau delta - delta²/2], s^(2-j).
    second: Outputs,
}

impl Moments {
    /// For samples of one constant age, which need no filter.
    fn constant(age: f64) -> Self {
        Self {
            first: [age, 0.0, 0.0],
            second: [-0.5 * age * age, age, 0.0],
        }
    }

    /// The outputs of samples taken at SYNC, from those of samples of these ages.
    fn align(&self, [value, rate, curvature]: Outputs) -> Outputs {
        let ([f0, f1, f2], [s0, s1, s2]) = (self.first, self.second);
        let determinant = (1.0 - f1) * (1.0 - s2) - s1 * f2;
        if determinant.is_nan() || determinant < 0.5 {
            // Too few samples in the window to determine the derivatives.
            return [value, rate, curvature];
        }
        let a = (rate * (1.0 - s2) + s1 * curvature) / determinant;
        let b = (curvature * (1.0 - f1) + f2 * rate) / determinant;
        [value + a * f0 + b * s0, a, b]
    }
}

/// Ages of the samples in one bank of filters.
#[derive(Debug)]
struct Alignment {
    signals: usize,
    /// Index in `moments` of each signal's source; none where samples are taken at SYNC.
    moments_of: Vec<Option<usize>>,
    moments: Vec<Moments>,
    varying: Vec<Varying>,
    /// T and time since the start, s.
    sample_period: f64,
    elapsed: f64,
}

impl Alignment {
    fn new(signals: &[Signal], sample_period: f64) -> Self {
        let mut this = Self {
            signals: signals.len(),
            moments_of: vec![None; signals.len()],
            moments: Vec::new(),
            varying: Vec::new(),
            sample_period,
            elapsed: 0.0,
        };
        for (i, signal) in signals.iter().enumerate() {
            if signal.sampling.is_at_sync() {
                continue;
            }
            let alike = signals[..i].iter().position(|other| other == signal);
            let known = alike.and_then(|other| this.moments_of[other]);
            let moments = known.unwrap_or(this.moments.len());
            this.moments_of[i] = Some(moments);
            if known.is_none() {
                this.moments
                    .push(Moments::constant(signal.sampling.latency));
                if let Sampled::WhenSent { period } = signal.sampling.sampled {
                    this.varying.push(Varying {
                        signal: i,
                        message: signal.message,
                        latency: signal.sampling.latency,
                        longest: OVERDUE * period,
                        moments,
                    });
                }
            }
        }
        this
    }

    /// Channels of the bank: one for each signal, and two for each source whose ages vary.
    fn channels(&self) -> usize {
        self.signals + 2 * self.varying.len()
    }

    /// Appends the ages to the signals' samples; a missing sample's age is missing too.
    fn put_ages(&mut self, samples: &mut [f64], stamps: &[Option<u64>], sync: Stamp) {
        self.elapsed += self.sample_period;
        let (signals, ages) = samples.split_at_mut(self.signals);
        for (varying, pair) in self.varying.iter().zip(ages.chunks_exact_mut(2)) {
            let delta = if signals[varying.signal].is_finite() {
                varying.age(stamps, sync)
            } else {
                f64::NAN
            };
            // tau counts from the start; `take` moves its origin to the instant of reading. The
            // product keeps ten significant digits for years of operation.
            pair[0] = delta;
            pair[1] = self.elapsed * delta - 0.5 * delta * delta;
        }
    }

    /// Takes the ages' outputs of the bank, which is read `delay` before its newest sample.
    fn take(&mut self, outputs: impl Fn(usize) -> Outputs, delay: f64) {
        let read = self.elapsed - delay;
        for (i, varying) in self.varying.iter().enumerate() {
            let channel = self.signals + 2 * i;
            let (first, from_start) = (outputs(channel), outputs(channel + 1));
            self.moments[varying.moments] = Moments {
                first,
                second: std::array::from_fn(|j| from_start[j] - read * first[j]),
            };
        }
    }

    /// A signal's filtered value and derivatives as if it had been sampled at SYNC.
    fn align(&self, signal: usize, outputs: Outputs) -> Outputs {
        match self.moments_of.get(signal).copied().flatten() {
            Some(moments) => self.moments[moments].align(outputs),
            None => outputs,
        }
    }
}

/// A bank of filters whose outputs are as if every signal had been sampled at SYNC.
#[derive(Debug)]
pub(crate) struct AlignedBank {
    bank: FilterBank,
    alignment: Alignment,
    /// The signals' samples, then their ages.
    samples: Vec<f64>,
}

impl AlignedBank {
    pub(crate) fn new(
        signals: &[Signal],
        design: impl Into<FilterDesign>,
        sample_period: f64,
    ) -> Result<Self, Problem> {
        let alignment = Alignment::new(signals, sample_period);
        Ok(Self {
            bank: FilterBank::new(alignment.channels(), design)?,
            samples: vec![f64::NAN; alignment.channels()],
            alignment,
        })
    }

    /// Takes one sample of each signal, not finite where there is none, and the stamp of each
    /// message's last frame.
    pub(crate) fn update(&mut self, signals: &[f64], stamps: &[Option<u64>], sync: Stamp) {
        for (sample, signal) in self.samples.iter_mut().zip(signals) {
            *sample = *signal;
        }
        self.alignment.put_ages(&mut self.samples, stamps, sync);
        self.bank.update(&self.samples);
        let bank = &self.bank;
        self.alignment
            .take(|channel| outputs(bank, channel), bank.delay_s());
    }

    /// Forgets every sample.
    pub(crate) fn reset(&mut self) {
        self.bank.reset();
    }

    /// A signal's filtered value and derivatives.
    pub(crate) fn outputs(&self, signal: usize) -> Outputs {
        self.alignment.align(signal, outputs(&self.bank, signal))
    }

    /// Values, first and second derivatives of the first signals, as many as there is room for.
    pub(crate) fn all_outputs(&self, [values, rates, curvatures]: [&mut [f64]; 3]) {
        let bank = &self.bank;
        if self.alignment.moments.is_empty() {
            // All samples are of SYNC, as on most robots.
            copy(bank.values(), values);
            copy(bank.first_derivatives(), rates);
            copy(bank.second_derivatives(), curvatures);
            return;
        }
        let rows = values.iter_mut().zip(rates).zip(curvatures);
        for (signal, ((value, rate), curvature)) in rows.enumerate() {
            [*value, *rate, *curvature] = self.outputs(signal);
        }
    }

    /// Delay of the outputs against SYNC, s.
    pub(crate) fn delay_s(&self) -> f64 {
        self.bank.delay_s()
    }

    /// Whether the signal's window is not yet full of real samples.
    pub(crate) fn settling(&self, signal: usize) -> bool {
        self.bank.settling(signal)
    }
}

fn copy(from: &[f64], to: &mut [f64]) {
    let count = from.len().min(to.len());
    to[..count].copy_from_slice(&from[..count]);
}

/// A channel's value and derivatives, before alignment.
fn outputs(bank: &FilterBank, channel: usize) -> Outputs {
    [
        bank.values()[channel],
        bank.first_derivatives()[channel],
        bank.second_derivatives()[channel],
    ]
}

/// The signals of the encoders' filter, of the control filter, and of the sensors' filter.
pub(crate) fn signals(robot: &Robot) -> [Vec<Signal>; 3] {
    let p = &robot.parameters;
    let signal = |sampling: Sampling, slot: usize| {
        let mut messages = 0..robot.receive.message_count();
        let message = messages.find(|&m| robot.receive.slots(m).any(|s| s == slot));
        Signal {
            sampling,
            source: slots::source(slot),
            message: message.unwrap_or(usize::MAX),
        }
    };
    let joints = || p.joints.iter().enumerate();
    let links = || {
        joints().map(|(j, joint)| {
            if joint.has_link_encoder {
                signal(joint.sampling, slots::link_angle(j))
            } else {
                signal(joint.sampling, slots::motor_angle(j))
            }
        })
    };
    let motors = joints().map(|(j, joint)| {
        let mut sampling = joint.sampling;
        sampling.latency -= joint.encoders.skew;
        signal(sampling, slots::motor_angle(j))
    });
    let fts = p.ft_sensors.iter().enumerate();
    let fts = fts.flat_map(|(s, ft)| (0..6).map(move |axis| (ft.sampling, slots::ft(s, axis))));
    let imus = p.imus.iter().enumerate();
    let imus = imus.flat_map(|(i, imu)| {
        let gyro = (0..3).map(move |axis| slots::gyro(i, axis));
        let axes = gyro.chain((0..3).map(move |axis| slots::accelerometer(i, axis)));
        axes.map(|slot| (imu.sampling, slot))
    });
    let sensors = fts.chain(imus);
    [
        links().collect(),
        links().chain(motors).collect(),
        sensors
            .map(|(sampling, slot)| signal(sampling, slot))
            .collect(),
    ]
}

#[cfg(test)]
mod tests;
