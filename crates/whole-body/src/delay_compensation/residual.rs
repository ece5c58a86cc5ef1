//! The residual `r = l - g h*e` of the delayed torque, predicted over the filters' delay.

/// Predictors: the newest value; averages of it over three times; straight lines through the last
/// half window, extrapolated by half of the filters' delay and by all of it.
const PREDICTORS: usize = 6;
/// Averaging times of the three averages, s.
const AVERAGING_TIMES: [f64; 3] = [0.015, 0.05, 0.2];
/// Averaging time of the predictors' squared errors, s.
const ERROR_AVERAGING_TIME: f64 = 0.5;

/// Delayed torque `l`, and fast torque through the same filter, `h*e`. The residual is formed only
/// when it is needed, so that a change of the gain does not act on stored values.
type Pair = [f64; 2];
/// The predictors' pairs: all delayed torques, then all fast ones, as the processor takes them side by
/// side.
type Pairs = [[f64; PREDICTORS]; 2];

/// The predicted residual for one gain.
#[derive(Debug, Clone, Default)]
pub(super) struct Prediction {
    /// Residual, N·m.
    pub(super) value: f64,
    /// Its mean square error, (N·m)².
    pub(super) variance: f64,
    /// Mean square error of each predictor.
    errors: [f64; PREDICTORS],
}

/// Several predictors side by side, each weighted by the errors of its predictions of three quarters
/// of a window ago: younger ones share noise with the value against which they are judged.
#[derive(Debug, Clone)]
pub(super) struct ResidualPredictor {
    /// With the gain, and with gain 0: without the fast source.
    pub(super) with: Prediction,
    pub(super) without: Prediction,
    /// Way by which a line is extrapolated over the filters' delay, over its length.
    ahead: f64,
    /// Share of a new sample in each average, and in the squared errors.
    shares: [f64; 3],
    error_share: f64,
    /// Rings of the last inputs and predictions.
    inputs: Vec<Pair>,
    newest: usize,
    predictions: Vec<Pairs>,
    oldest: usize,
    means: [Pair; 3],
    /// Number of predictions since the start, and of those that have been judged.
    made: usize,
    judged: f64,
}

impl ResidualPredictor {
    pub(super) fn new(window: usize, dt: f64) -> Self {
        let delay = 0.5 * (window.max(1) - 1) as f64;
        Self {
            with: Prediction::default(),
            without: Prediction::default(),
            ahead: delay / (window / 2).max(1) as f64,
            shares: AVERAGING_TIMES.map(|time| (dt / time).min(1.0)),
            error_share: dt / ERROR_AVERAGING_TIME,
            inputs: vec![[0.0; 2]; window / 2 + 1],
            newest: 0,
            predictions: vec![[[0.0; PREDICTORS]; 2]; (3 * window / 4).max(1)],
            oldest: 0,
            means: [[0.0; 2]; 3],
            made: 0,
            judged: 0.0,
        }
    }

    /// Sets all past values to the present ones; the predictors' errors are kept.
    pub(super) fn restart(&mut self, pair: Pair, gain: f64) {
        self.inputs.fill(pair);
        self.means = [pair; 3];
        self.made = 0;
        self.with.value = residual(pair, gain);
        self.without.value = residual(pair, 0.0);
    }

    pub(super) fn update(&mut self, pair: Pair, gain: f64) {
        if self.made >= self.predictions.len() {
            self.judged += 1.0;
            let share = self.error_share.max(1.0 / self.judged).min(1.0);
            let predictions = &self.predictions[self.oldest];
            self.with.judge(predictions, pair, gain, share);
            self.without.judge(predictions, pair, 0.0, share);
        }
        self.newest = next(self.newest, self.inputs.len());
        self.inputs[self.newest] = pair;
        let first = self.inputs[next(self.newest, self.inputs.len())];
        for (mean, share) in self.means.iter_mut().zip(self.shares) {
            *mean = [0, 1].map(|k| mean[k] + share * (pair[k] - mean[k]));
        }
        let [a, b, c] = self.means;
        let predictions = [0, 1].map(|k| {
            let line = |times: f64| pair[k] + times * self.ahead * (pair[k] - first[k]);
            [pair[k], a[k], b[k], c[k], line(0.5), line(1.0)]
        });
        self.predictions[self.oldest] = predictions;
        self.oldest = next(self.oldest, self.predictions.len());
        self.made = self.made.saturating_add(1);
        self.with.combine(&predictions, gain);
        self.without.combine(&predictions, 0.0);
    }
}

impl Prediction {
    /// Compares past predictions with the present residual.
    fn judge(&mut self, predictions: &Pairs, pair: Pair, gain: f64, share: f64) {
        let observed = residual(pair, gain);
        let residuals = residuals(predictions, gain);
        for (error, predicted) in self.errors.iter_mut().zip(residuals) {
            *error += share * ((observed - predicted).powi(2) - *error);
        }
    }

    /// Mean of the predictors, weighted by the inverse cubes of their mean square errors.
    fn combine(&mut self, predictions: &Pairs, gain: f64) {
        // Bounded, as the quotient of two zeros is to be one; without a branch, to be taken side by side.
        let errors = self.errors.map(|error| {
            if error > f64::MIN_POSITIVE {
                error
            } else {
                f64::MIN_POSITIVE
            }
        });
        let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
        let weights = errors.map(|error| (best / error).powi(3));
        let sum: f64 = weights.iter().sum();
        let weighted = weights.iter().zip(residuals(predictions, gain));
        self.value = weighted.map(|(w, residual)| w * residual).sum::<f64>() / sum;
        let errors = weights.iter().zip(&self.errors);
        self.variance = errors.map(|(w, error)| w * error).sum::<f64>() / sum;
    }
}

/// The next place in a ring; a division would take longer.
fn next(place: usize, length: usize) -> usize {
    match place + 1 {
        next if next < length => next,
        _ => 0,
    }
}

fn residual([delayed, fast]: Pair, gain: f64) -> f64 {
    delayed - gain * fast
}

fn residuals([delayed, fast]: &Pairs, gain: f64) -> [f64; PREDICTORS] {
    std::array::from_fn(|i| residual([delayed[i], fast[i]], gain))
}
