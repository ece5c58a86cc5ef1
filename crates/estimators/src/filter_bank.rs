//! Smoothing and differentiating filters on many channels at once: precomputed finite impulse
//! responses that bridge missed samples.

use crate::fir::MAX_DERIVATIVE;
use crate::matched_filter::MatchedFilterParameters;
use crate::savitzky_golay::SavitzkyGolayParameters;
use problem::Problem;
use simd::{Instructions, Kernel, Lanes, Pack, WIDTH};

/// Kind of a bank's filters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FilterDesign {
    /// Least noise of each derivative by itself; value and derivatives pass different bands.
    SavitzkyGolay(SavitzkyGolayParameters),
    /// Value and derivatives through one and the same smoothing.
    Matched(MatchedFilterParameters),
}

impl FilterDesign {
    /// The same filter with `count` derivatives beside the value.
    #[must_use]
    pub fn with_derivatives(mut self, count: usize) -> Self {
        match &mut self {
            Self::SavitzkyGolay(p) => p.derivatives = count,
            Self::Matched(p) => p.derivatives = count,
        }
        self
    }
}

impl From<SavitzkyGolayParameters> for FilterDesign {
    fn from(p: SavitzkyGolayParameters) -> Self {
        Self::SavitzkyGolay(p)
    }
}

impl From<MatchedFilterParameters> for FilterDesign {
    fn from(p: MatchedFilterParameters) -> Self {
        Self::Matched(p)
    }
}

/// Packs of channels that are summed at a time: so many that sums do not wait for one another, so few
/// that those of value and two derivatives stay in sixteen registers.
const PACKS: usize = 4;
/// Their channels.
const CHANNELS: usize = PACKS * WIDTH;

/// The same filter on many channels at once.
///
/// A sample that is not finite counts as missed and is replaced by the extrapolation of a polynomial
/// fit; after an eighth of a window of missed samples, two at least, the last one is held.
/// Before a channel's first sample its outputs are zero; the first sample fills the whole
/// window, so that derivatives start at zero and nothing is extrapolated from a few noisy
/// samples. Until the window holds real samples only, the channel is [`Self::settling`].
#[derive(Debug, Clone)]
pub struct FilterBank {
    window: usize,
    /// Missed samples in a row that are extrapolated.
    bridged: usize,
    /// Derivatives beside the value.
    derivatives: usize,
    delay_s: f64,
    channels: usize,
    instructions: Instructions,
    /// Samples: for each block of channels a ring, one row per instant; row `newest` was written
    /// last.
    rings: Vec<[Pack; PACKS]>,
    newest: usize,
    /// Coefficients of value and derivatives, each twice in a row: a slice of `window` starting
    /// at the right place lies along the ring as it is stored, so nothing has to be moved.
    taps: Vec<[f64; MAX_DERIVATIVE + 1]>,
    /// Coefficients of the fit one sample ahead of the newest, for missed samples.
    ahead: Vec<f64>,
    /// Value, first and second derivative, a row of channels each.
    outputs: [Vec<f64>; MAX_DERIVATIVE + 1],
    state: Vec<ChannelState>,
    /// Every channel's window is full of real samples, and its last one was not missed: the next
    /// ones, if none is missed, change no state.
    settled: bool,
}

/// Samples that a channel has received.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct ChannelState {
    /// Real samples so far, at most the window.
    seen: usize,
    /// Samples missed in a row.
    missed: usize,
}

impl FilterBank {
    /// A bank of equal filters.
    ///
    /// # Errors
    /// A design that is not allowed.
    pub fn new(channels: usize, design: impl Into<FilterDesign>) -> Result<Self, Problem> {
        let kernels = match design.into() {
            FilterDesign::SavitzkyGolay(p) => p.kernels(),
            FilterDesign::Matched(p) => p.kernels(),
        }?;
        let window = kernels.ahead.len();
        let mut taps = vec![[0.0; MAX_DERIVATIVE + 1]; 2 * window];
        for (d, h) in kernels.taps.iter().enumerate() {
            for (i, tap) in taps.iter_mut().enumerate() {
                tap[d] = h[i % window];
            }
        }
        let blocks = channels.div_ceil(CHANNELS);
        Ok(Self {
            window,
            bridged: (window / 8).max(2),
            derivatives: kernels.taps.len() - 1,
            delay_s: kernels.delay_s,
            channels,
            instructions: Instructions::detect(),
            rings: vec![[Pack::ZERO; PACKS]; blocks * window],
            newest: window - 1,
            taps,
            ahead: kernels.ahead,
            outputs: std::array::from_fn(|_| vec![0.0; blocks * CHANNELS]),
            state: vec![ChannelState::default(); channels],
            settled: false,
        })
    }

    /// Takes one sample of each channel; a channel without one, or whose sample is not finite, is
    /// bridged.
    pub fn update(&mut self, samples: &[f64]) {
        let window = self.window;
        let next = if self.newest + 1 < window {
            self.newest + 1
        } else {
            0
        };
        match samples.get(..self.channels) {
            Some(samples) if self.settled && samples.iter().all(|x| x.is_finite()) => {
                self.take_all(next, samples);
            }
            _ => self.take_or_bridge(next, samples),
        }
        self.newest = next;
        self.fit();
    }

    /// One sample of every channel.
    fn take_all(&mut self, row: usize, samples: &[f64]) {
        let rings = self.rings.chunks_exact_mut(self.window);
        for (ring, samples) in rings.zip(samples.chunks(CHANNELS)) {
            let packs = ring.get_mut(row).into_iter().flatten();
            for (pack, samples) in packs.zip(samples.chunks(WIDTH)) {
                for (x, sample) in pack.0.iter_mut().zip(samples) {
                    *x = *sample;
                }
            }
        }
    }

    fn take_or_bridge(&mut self, row: usize, samples: &[f64]) {
        for channel in 0..self.channels {
            match samples.get(channel) {
                Some(&sample) if sample.is_finite() => self.take(channel, row, sample),
                _ => self.bridge(channel, row),
            }
        }
        let settled = |s: &ChannelState| s.seen == self.window && s.missed == 0;
        self.settled = self.state.iter().all(settled);
    }

    fn take(&mut self, channel: usize, row: usize, sample: f64) {
        let Some(state) = self.state.get_mut(channel) else {
            return;
        };
        state.missed = 0;
        let first = channel / CHANNELS * self.window;
        if state.seen == 0 {
            let ring = self.rings.get_mut(first..first + self.window);
            let rows = ring.unwrap_or(&mut []).iter_mut();
            rows.for_each(|x| *number(x, channel) = sample);
        } else if let Some(x) = self.rings.get_mut(first + row) {
            *number(x, channel) = sample;
        }
        if state.seen < self.window {
            state.seen += 1;
        }
    }

    fn bridge(&mut self, channel: usize, row: usize) {
        let window = self.window;
        let Some(state) = self.state.get_mut(channel) else {
            return;
        };
        state.missed = state.missed.saturating_add(1);
        let first = channel / CHANNELS * window;
        let Some(ring) = self.rings.get_mut(first..first + window) else {
            return;
        };
        let mut at = |row: usize| ring.get_mut(row).map_or(0.0, |x| *number(x, channel));
        let bridged = if state.missed > self.bridged {
            at(self.newest)
        } else {
            // The oldest sample stands in the row that is written next.
            let rows = (row..window).chain(0..row);
            rows.zip(&self.ahead).map(|(row, h)| h * at(row)).sum()
        };
        if let Some(x) = ring.get_mut(row) {
            *number(x, channel) = bridged;
        }
    }

    fn fit(&mut self) {
        let start = self.window - 1 - self.newest;
        let fit = Fit {
            derivatives: self.derivatives,
            taps: self.taps.get(start..start + self.window).unwrap_or(&[]),
            rings: &self.rings,
            outputs: &mut self.outputs,
        };
        simd::run(self.instructions, fit);
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.rings.fill([Pack::ZERO; PACKS]);
        self.newest = self.window - 1;
        self.outputs.iter_mut().for_each(|row| row.fill(0.0));
        self.state.fill(ChannelState::default());
        self.settled = false;
    }

    /// Filtered values, one per channel.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.outputs[0][..self.channels]
    }

    /// First derivatives, per s, one per channel; zero if not asked for.
    #[must_use]
    pub fn first_derivatives(&self) -> &[f64] {
        &self.outputs[1][..self.channels]
    }

    /// Second derivatives, per s², one per channel; zero if not asked for.
    #[must_use]
    pub fn second_derivatives(&self) -> &[f64] {
        &self.outputs[2][..self.channels]
    }

    /// Delay of the outputs behind the newest sample, s.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Whether the channel's window is not yet full of real samples.
    #[must_use]
    pub fn settling(&self, channel: usize) -> bool {
        self.state.get(channel).is_none_or(|s| s.seen < self.window)
    }

    /// Samples the channel has missed in a row.
    #[must_use]
    pub fn missed(&self, channel: usize) -> usize {
        self.state.get(channel).map_or(0, |s| s.missed)
    }

    /// Weights of the samples in the value, oldest first; they add up to one.
    #[must_use]
    pub fn kernel(&self) -> Vec<f64> {
        let taps = self.taps.iter().take(self.window);
        taps.map(|t| t[0]).collect()
    }

    /// Standard deviation of the output's `derivative` for white noise of 1 on the input.
    #[must_use]
    pub fn noise_gain(&self, derivative: usize) -> f64 {
        let taps = self.taps.iter().take(self.window);
        taps.map(|t| t.get(derivative).map_or(0.0, |h| h * h))
            .sum::<f64>()
            .sqrt()
    }
}

/// A channel's number in a row of its block.
fn number(row: &mut [Pack; PACKS], channel: usize) -> &mut f64 {
    &mut row[channel / WIDTH % PACKS].0[channel % WIDTH]
}

/// The outputs of all channels: products of taps and rings, summed over the window.
struct Fit<'a> {
    derivatives: usize,
    taps: &'a [[f64; MAX_DERIVATIVE + 1]],
    rings: &'a [[Pack; PACKS]],
    outputs: &'a mut [Vec<f64>; MAX_DERIVATIVE + 1],
}

impl Kernel for Fit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.derivatives {
            0 => self.sum::<L, 1>(),
            1 => self.sum::<L, 2>(),
            _ => self.sum::<L, 3>(),
        }
    }
}

impl Fit<'_> {
    /// The first `D` outputs.
    #[inline(always)]
    fn sum<L: Lanes, const D: usize>(self) {
        let rings = self.rings.chunks_exact(self.taps.len().max(1));
        for (block, ring) in rings.enumerate() {
            let mut sums = [[L::splat(0.0); PACKS]; D];
            for (tap, row) in self.taps.iter().zip(ring) {
                for (sums, tap) in sums.iter_mut().zip(tap) {
                    let tap = L::splat(*tap);
                    for (sum, samples) in sums.iter_mut().zip(row) {
                        *sum = tap.mul_add(L::load(samples), *sum);
                    }
                }
            }
            for (output, sums) in self.outputs.iter_mut().zip(sums) {
                let packs = output.chunks_exact_mut(WIDTH).skip(block * PACKS);
                for (output, sum) in packs.zip(sums) {
                    output.copy_from_slice(&sum.to_array());
                }
            }
        }
    }
}
