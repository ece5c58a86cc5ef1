//! Savitzky-Golay filters (D 2.1): a polynomial fitted by least squares to the last samples,
//! read with its derivatives at a chosen instant.
//!
//! The fit is linear in the samples, so it is a dot product with coefficients known beforehand.
//! A polynomial of the filter's order passes unchanged but for the delay, which is therefore
//! exact: every signal of one equation filtered with the same window is late by the same time.

use std::fmt;

/// How a signal is smoothed and differentiated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SavitzkyGolayParameters {
    /// Samples that the fit covers, at least 1; even numbers are fine.
    pub window: usize,
    /// Degree of the polynomial, below `window`.
    pub order: usize,
    /// Derivatives wanted beside the value: 0, 1 or 2.
    pub derivatives: usize,
    /// How many samples before the newest the polynomial is read, 0 to `window - 1`; may be
    /// fractional. The window's middle is `(window - 1)/2`.
    pub delay_samples: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
}

impl SavitzkyGolayParameters {
    /// A filter that is read in the middle of its window, where its noise is least.
    #[must_use]
    pub fn centred(window: usize, order: usize, derivatives: usize, sample_period: f64) -> Self {
        let delay_samples = 0.5 * (window.max(1) - 1) as f64;
        Self {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        }
    }

    fn check(&self) -> Result<(), SavitzkyGolayError> {
        let fail = |message: String| Err(SavitzkyGolayError(message));
        let Self {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        } = *self;
        if !(1..=MAX_WINDOW).contains(&window) {
            return fail(format!("window {window}; allowed: 1 to {MAX_WINDOW}"));
        }
        if order >= window {
            return fail(format!(
                "order {order}; allowed: below the window of {window}"
            ));
        }
        if derivatives > MAX_DERIVATIVE {
            return fail(format!("derivative {derivatives}; allowed: 0, 1 or 2"));
        }
        if !(0.0..=(window - 1) as f64).contains(&delay_samples) {
            let last = window - 1;
            return fail(format!(
                "evaluation {delay_samples} samples ago; allowed: 0 to {last}"
            ));
        }
        if !(sample_period > 0.0 && sample_period.is_finite()) {
            return fail(format!(
                "sample period {sample_period} s; allowed: finite, above 0"
            ));
        }
        Ok(())
    }
}

/// A filter that cannot be built; says what was given and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SavitzkyGolayError(String);

impl fmt::Display for SavitzkyGolayError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Savitzky-Golay filter: {}", self.0)
    }
}
impl std::error::Error for SavitzkyGolayError {}

const MAX_WINDOW: usize = 1 << 16;
const MAX_DERIVATIVE: usize = 2;
/// Channels that are summed at a time, so that all sums stay in registers.
const LANES: usize = 4;

/// Coefficients of the `derivative`-th derivative of the fit, oldest sample first, per sample^d.
///
/// `delay_samples` before the newest sample is where the polynomial is read.
/// The polynomials that are orthogonal on the samples give them without a matrix inverse:
/// `h_i = sum_j phi_j(t_i) phi_j^(d)(t)`.
#[must_use]
pub fn coefficients(
    window: usize,
    order: usize,
    derivative: usize,
    delay_samples: f64,
) -> Vec<f64> {
    let middle = 0.5 * (window as f64 - 1.0);
    // Time is scaled to -1..1, else high orders over long windows lose digits.
    let scale = middle.max(1.0);
    let nodes: Vec<f64> = (0..window).map(|i| (i as f64 - middle) / scale).collect();
    let read_at = (middle - delay_samples) / scale;
    let mut h = vec![0.0; window];
    let mut last = vec![0.0; window];
    let mut phi = vec![1.0 / (window as f64).sqrt(); window];
    // phi_j and its derivatives up to `derivative` at the instant of reading.
    let mut last_at = vec![0.0; derivative + 1];
    let mut phi_at = vec![0.0; derivative + 1];
    phi_at[0] = phi[0];
    let mut beta = 0.0;
    for j in 0..=order {
        for (h, phi) in h.iter_mut().zip(&phi) {
            *h += phi * phi_at[derivative];
        }
        if j == order {
            break;
        }
        // Stieltjes: gamma phi_{j+1} = (t - alpha) phi_j - beta phi_{j-1}.
        let alpha: f64 = nodes.iter().zip(&phi).map(|(t, p)| t * p * p).sum();
        let next: Vec<f64> = (0..window)
            .map(|i| (nodes[i] - alpha) * phi[i] - beta * last[i])
            .collect();
        let gamma = next.iter().map(|p| p * p).sum::<f64>().sqrt();
        let next_at: Vec<f64> = (0..=derivative)
            .map(|k| {
                let product = if k > 0 { k as f64 * phi_at[k - 1] } else { 0.0 };
                (product + (read_at - alpha) * phi_at[k] - beta * last_at[k]) / gamma
            })
            .collect();
        last = std::mem::replace(&mut phi, next.iter().map(|p| p / gamma).collect());
        last_at = std::mem::replace(&mut phi_at, next_at);
        beta = gamma;
    }
    let per_sample = scale.powi(-(derivative as i32));
    h.iter().map(|h| h * per_sample).collect()
}

/// The same Savitzky-Golay filter on many channels at once.
///
/// A sample that is not finite counts as missed: the fit's own extrapolation stands in for it,
/// and after an eighth of a window of them the last one is held.
/// Before a channel's first sample its outputs are zero; the first sample fills the whole
/// window, so that derivatives start at zero and nothing is extrapolated from a few noisy
/// samples. Until the window holds real samples only, the channel is [`Self::settling`].
#[derive(Debug, Clone)]
pub struct SavitzkyGolayBank {
    parameters: SavitzkyGolayParameters,
    channels: usize,
    /// Channels rounded up to whole blocks.
    stride: usize,
    /// Samples, one row of channels per instant, a ring: row `newest` was written last.
    ring: Vec<f64>,
    newest: usize,
    /// Coefficients of value and derivatives, each twice in a row: a slice of `window` starting
    /// at the right place lies along the ring as it is stored, so nothing has to be moved.
    taps: Vec<[f64; MAX_DERIVATIVE + 1]>,
    /// Coefficients of the fit one sample ahead of the newest, for missed samples.
    ahead: Vec<f64>,
    /// Value, first and second derivative, a row of channels each.
    outputs: [Vec<f64>; MAX_DERIVATIVE + 1],
    state: Vec<ChannelState>,
}

/// What a channel has seen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct ChannelState {
    /// Real samples so far, at most the window.
    seen: usize,
    /// Samples missed in a row.
    missed: usize,
}

impl SavitzkyGolayBank {
    /// A bank of equal filters.
    ///
    /// # Errors
    /// A window, order, derivative, evaluation point or sample period that is not allowed.
    pub fn new(
        channels: usize,
        parameters: SavitzkyGolayParameters,
    ) -> Result<Self, SavitzkyGolayError> {
        parameters.check()?;
        let SavitzkyGolayParameters {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        } = parameters;
        let mut taps = vec![[0.0; MAX_DERIVATIVE + 1]; 2 * window];
        let mut rate = 1.0;
        for d in 0..=derivatives {
            let h = coefficients(window, order, d, delay_samples);
            for (i, tap) in taps.iter_mut().enumerate() {
                tap[d] = h[i % window] * rate;
            }
            rate /= sample_period;
        }
        let stride = channels.div_ceil(LANES) * LANES;
        Ok(Self {
            parameters,
            channels,
            stride,
            ring: vec![0.0; stride * window],
            newest: window - 1,
            taps,
            ahead: coefficients(window, order, 0, -1.0),
            outputs: std::array::from_fn(|_| vec![0.0; stride]),
            state: vec![ChannelState::default(); channels],
        })
    }

    /// Takes one sample of each channel; a channel without one, or whose sample is not finite, is
    /// bridged.
    pub fn update(&mut self, samples: &[f64]) {
        let window = self.parameters.window;
        let next = if self.newest + 1 < window {
            self.newest + 1
        } else {
            0
        };
        for channel in 0..self.channels {
            match samples.get(channel) {
                Some(&sample) if sample.is_finite() => self.take(channel, next, sample),
                _ => self.bridge(channel, next),
            }
        }
        self.newest = next;
        self.fit();
    }

    fn take(&mut self, channel: usize, row: usize, sample: f64) {
        let (stride, window) = (self.stride, self.parameters.window);
        let Some(state) = self.state.get_mut(channel) else {
            return;
        };
        if state.seen == 0 {
            self.ring
                .iter_mut()
                .skip(channel)
                .step_by(stride)
                .for_each(|x| *x = sample);
        } else if let Some(x) = self.ring.get_mut(row * stride + channel) {
            *x = sample;
        }
        state.seen = (state.seen + 1).min(window);
        state.missed = 0;
    }

    fn bridge(&mut self, channel: usize, row: usize) {
        let (stride, window) = (self.stride, self.parameters.window);
        let Some(state) = self.state.get_mut(channel) else {
            return;
        };
        state.missed = state.missed.saturating_add(1);
        let column = |row: usize| {
            self.ring
                .get(row * stride + channel)
                .copied()
                .unwrap_or(0.0)
        };
        let bridged = if state.missed > window / 8 {
            column(self.newest)
        } else {
            // The oldest sample stands in the row that is written next.
            (0..window)
                .zip(&self.ahead)
                .map(|(i, h)| {
                    h * column(if row + i < window {
                        row + i
                    } else {
                        row + i - window
                    })
                })
                .sum()
        };
        if let Some(x) = self.ring.get_mut(row * stride + channel) {
            *x = bridged;
        }
    }

    fn fit(&mut self) {
        let (window, stride) = (self.parameters.window, self.stride);
        let start = window - 1 - self.newest;
        let taps = self.taps.get(start..start + window).unwrap_or(&[]);
        let [values, firsts, seconds] = &mut self.outputs;
        let blocks = values
            .chunks_exact_mut(LANES)
            .zip(firsts.chunks_exact_mut(LANES))
            .zip(seconds.chunks_exact_mut(LANES));
        for (block, ((value, first), second)) in blocks.enumerate() {
            let sums = match self.parameters.derivatives {
                0 => dot::<1>(taps, &self.ring, stride, block),
                1 => dot::<2>(taps, &self.ring, stride, block),
                _ => dot::<3>(taps, &self.ring, stride, block),
            };
            value.copy_from_slice(&sums[0]);
            first.copy_from_slice(&sums[1]);
            second.copy_from_slice(&sums[2]);
        }
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.ring.fill(0.0);
        self.newest = self.parameters.window - 1;
        self.outputs.iter_mut().for_each(|row| row.fill(0.0));
        self.state.fill(ChannelState::default());
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

    /// How late the outputs are against the newest sample, s.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.parameters.delay_samples * self.parameters.sample_period
    }

    /// Whether the channel's window is not yet full of real samples.
    #[must_use]
    pub fn settling(&self, channel: usize) -> bool {
        self.state
            .get(channel)
            .is_none_or(|s| s.seen < self.parameters.window)
    }

    /// Samples the channel has missed in a row.
    #[must_use]
    pub fn missed(&self, channel: usize) -> usize {
        self.state.get(channel).map_or(0, |s| s.missed)
    }

    /// Standard deviation of the output's `derivative` for white noise of 1 on the input.
    #[must_use]
    pub fn noise_gain(&self, derivative: usize) -> f64 {
        let taps = self.taps.iter().take(self.parameters.window);
        taps.map(|t| t.get(derivative).map_or(0.0, |h| h * h))
            .sum::<f64>()
            .sqrt()
    }
}

/// The first `D` outputs of one block of channels.
fn dot<const D: usize>(
    taps: &[[f64; MAX_DERIVATIVE + 1]],
    ring: &[f64],
    stride: usize,
    block: usize,
) -> [[f64; LANES]; MAX_DERIVATIVE + 1] {
    let mut sums = [[0.0; LANES]; MAX_DERIVATIVE + 1];
    for (tap, row) in taps.iter().zip(ring.chunks_exact(stride)) {
        let Some(row) = row[block * LANES..].first_chunk::<LANES>() else {
            break;
        };
        for (sum, tap) in sums.iter_mut().zip(tap).take(D) {
            for (sum, x) in sum.iter_mut().zip(row) {
                *sum += tap * x;
            }
        }
    }
    sums
}
