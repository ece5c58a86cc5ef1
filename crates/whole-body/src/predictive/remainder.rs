//! What the fast source does not explain, brought from the filters' instant to now.

/// The newest value; averages of it over three times; straight lines through the last half window,
/// followed half of the filters' delay and all of it.
const WAYS: usize = 6;
/// Times of the averages, s.
const AVERAGES: [f64; 3] = [0.015, 0.05, 0.2];
/// Time over which errors are averaged, s.
const MEMORY: f64 = 0.5;

/// Late and fast torque through the same filter; what is left is the former less the gain times
/// the latter. Kept apart, so that a new gain does not shake what is kept of the past.
type Pair = [f64; 2];

/// What is left of the late torque for one gain.
#[derive(Debug, Clone, Default)]
pub(super) struct Left {
    /// Now, and how wrong it has been on average, squared.
    pub(super) value: f64,
    pub(super) variance: f64,
    /// Mean squares of each way's errors.
    errors: [f64; WAYS],
}

/// Several predictions side by side, each weighted by how well those it made three quarters of a
/// window ago have come true: sooner, they would share their noise with what they are judged by.
#[derive(Debug, Clone)]
pub(super) struct Remainder {
    /// With the gain, and without the fast source.
    pub(super) with: Left,
    pub(super) without: Left,
    /// The filters' delay, samples.
    delay: f64,
    dt: f64,
    /// The last inputs and predictions, rings.
    inputs: Vec<Pair>,
    newest: usize,
    predictions: Vec<[Pair; WAYS]>,
    oldest: usize,
    means: [Pair; 3],
    /// Predictions since the start, and how many have been judged.
    made: usize,
    judged: f64,
}

impl Remainder {
    pub(super) fn new(window: usize, dt: f64) -> Self {
        Self {
            with: Left::default(),
            without: Left::default(),
            delay: 0.5 * (window.max(1) - 1) as f64,
            dt,
            inputs: vec![[0.0; 2]; window / 2 + 1],
            newest: 0,
            predictions: vec![[[0.0; 2]; WAYS]; (3 * window / 4).max(1)],
            oldest: 0,
            means: [[0.0; 2]; 3],
            made: 0,
            judged: 0.0,
        }
    }

    /// As if both had always been as they are; how well each way predicts is kept.
    pub(super) fn restart(&mut self, pair: Pair, gain: f64) {
        self.inputs.fill(pair);
        self.means = [pair; 3];
        self.made = 0;
        self.with.value = left(pair, gain);
        self.without.value = left(pair, 0.0);
    }

    pub(super) fn update(&mut self, pair: Pair, gain: f64) {
        if self.made >= self.predictions.len() {
            self.judged += 1.0;
            let share = (self.dt / MEMORY).max(1.0 / self.judged).min(1.0);
            let ways = &self.predictions[self.oldest];
            self.with.judge(ways, pair, gain, share);
            self.without.judge(ways, pair, 0.0, share);
        }
        let before = self.inputs.len() - 1;
        self.newest = (self.newest + 1) % self.inputs.len();
        self.inputs[self.newest] = pair;
        let first = self.inputs[(self.newest + 1) % self.inputs.len()];
        let ahead = self.delay / before.max(1) as f64;
        for (mean, time) in self.means.iter_mut().zip(AVERAGES) {
            let share = (self.dt / time).min(1.0);
            *mean = [0, 1].map(|k| mean[k] + share * (pair[k] - mean[k]));
        }
        let [a, b, c] = self.means;
        let line = |times: f64| [0, 1].map(|k| pair[k] + times * ahead * (pair[k] - first[k]));
        let ways = [pair, a, b, c, line(0.5), line(1.0)];
        self.predictions[self.oldest] = ways;
        self.oldest = (self.oldest + 1) % self.predictions.len();
        self.made = self.made.saturating_add(1);
        self.with.choose(&ways, gain);
        self.without.choose(&ways, 0.0);
    }
}

impl Left {
    /// Compares predictions with what has come.
    fn judge(&mut self, ways: &[Pair; WAYS], pair: Pair, gain: f64, share: f64) {
        let come = left(pair, gain);
        for (error, way) in self.errors.iter_mut().zip(ways) {
            *error += share * ((come - left(*way, gain)).powi(2) - *error);
        }
    }

    fn choose(&mut self, ways: &[Pair; WAYS], gain: f64) {
        let best = self.errors.iter().copied().fold(f64::INFINITY, f64::min);
        let weights = self.errors.map(|error| match error > best {
            true => (best / error).powi(3),
            false => 1.0,
        });
        let sum: f64 = weights.iter().sum();
        let told = weights.iter().zip(ways);
        self.value = told.map(|(w, way)| w * left(*way, gain)).sum::<f64>() / sum;
        let errors = weights.iter().zip(&self.errors);
        self.variance = errors.map(|(w, error)| w * error).sum::<f64>() / sum;
    }
}

fn left([late, fast]: Pair, gain: f64) -> f64 {
    late - gain * fast
}
