//! A filter that tracks a signal's value and rate, short where the signal moves and long where it
//! rests: g-h filters of different memory as interacting multiple models (IMM).

/// Models side by side.
pub const MODELS: usize = 3;
/// Probability that a model holds for one more sample.
const MODEL_PERSISTENCE: f64 = 0.97;

/// Filters that track a signal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrackingParameters {
    /// Poles of each model, 0 (passes on each sample) to below 1.
    pub poles: [f64; MODELS],
    /// Standard deviation of the signal's noise, in its unit; 0: the first model alone.
    pub sigma: f64,
}

/// Each model is `x^ = x + T dx;  x = x^ + g (z - x^);  dx += h/T (z - x^)` with `g = 1 - p²`,
/// `h = (1 - p)²`: both poles at `p` (fading memory). A ramp passes without delay, unlike through
/// any low-pass. The models' probabilities follow from the likelihoods of their innovations,
/// of variance `sigma²/p²` if the model is right (`g = 1 - sigma²/S` for the optimal gain).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracking {
    models: [Model; MODELS],
    sample_period: f64,
    /// State and probability of each model; none before the first sample.
    states: Option<[State; MODELS]>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Model {
    g: f64,
    h: f64,
    /// 1 / (2 S), and -ln(S) / 2.
    weight: f64,
    log_spread: f64,
    /// ln of `g²/(1-g)` and of `h²/(1-g)`.
    log_walk: (f64, f64),
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct State {
    x: f64,
    dx: f64,
    probability: f64,
}

impl Tracking {
    /// A filter that has seen no sample; poles beyond 0 to below 1 are clamped; `sample_period`
    /// in s.
    #[must_use]
    pub fn new(parameters: TrackingParameters, sample_period: f64) -> Self {
        let TrackingParameters { poles, sigma } = parameters;
        let model = |pole: f64| {
            debug_assert!((0.0..1.0).contains(&pole), "pole {pole}");
            let p = pole.clamp(0.0, 1.0 - 1e-6);
            // A filter of pole 0 expects innovations of any size: bounded at a pole of 0.1.
            let variance = sigma * sigma / (p * p).max(0.01);
            let (g, h) = (1.0 - p * p, (1.0 - p) * (1.0 - p));
            let walk = |gain: f64| (gain * gain / (1.0 - g).max(1e-6)).ln();
            Model {
                g,
                h,
                log_walk: (walk(g), walk(h)),
                weight: if variance > 0.0 { 0.5 / variance } else { 0.0 },
                log_spread: if variance > 0.0 {
                    -0.5 * variance.ln()
                } else {
                    0.0
                },
            }
        };
        let first = if sigma > 0.0 {
            poles
        } else {
            [poles[0]; MODELS]
        };
        Self {
            models: first.map(model),
            sample_period,
            states: None,
        }
    }

    /// Takes one sample and gives the value and its rate, per s. The first sample is passed on as
    /// it is, a sample that is not finite changes nothing.
    pub fn update(&mut self, z: f64) -> (f64, f64) {
        if !z.is_finite() {
            return self.states.map_or((0.0, 0.0), mean);
        }
        let start = State {
            x: z,
            dx: 0.0,
            probability: 1.0 / MODELS as f64,
        };
        let before = self.states.unwrap_or([start; MODELS]);
        let t = self.sample_period;
        let mut likelihoods = [0.0; MODELS];
        let mut after = before;
        for (j, (state, model)) in after.iter_mut().zip(&self.models).enumerate() {
            let mixed = mix(&before, j);
            let predicted = mixed.x + t * mixed.dx;
            let innovation = z - predicted;
            likelihoods[j] = model.log_spread - model.weight * innovation * innovation;
            *state = State {
                x: predicted + model.g * innovation,
                dx: mixed.dx + model.h / t * innovation,
                probability: mixed.probability,
            };
        }
        // Relative to the likeliest, so that one of them is always left.
        let most = likelihoods.iter().copied().fold(f64::MIN, f64::max);
        let mut sum = 0.0;
        for (state, likelihood) in after.iter_mut().zip(likelihoods) {
            state.probability *= (likelihood - most).exp();
            sum += state.probability;
        }
        after.iter_mut().for_each(|s| s.probability /= sum);
        self.states = Some(after);
        mean(after)
    }

    /// Variances of the random walks of value and rate for which the present mix of models is
    /// optimal, over those of the first model (with gains g, h those
    /// are `g²/(1-g)` and `h²/(1-g)` times sigma²); geometric mean over the models, as they lie
    /// powers of ten apart.
    #[must_use]
    pub fn liveliness(&self) -> (f64, f64) {
        let Some(states) = &self.states else {
            return (1.0, 1.0);
        };
        let weighted = states
            .iter()
            .zip(&self.models)
            .fold((0.0, 0.0), |sum, (s, m)| {
                (
                    sum.0 + s.probability * m.log_walk.0,
                    sum.1 + s.probability * m.log_walk.1,
                )
            });
        let first = self.models[0].log_walk;
        ((weighted.0 - first.0).exp(), (weighted.1 - first.1).exp())
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.states = None;
    }
}

/// Initial state and probability of model `j`: a mix of all models, any of which may have held.
fn mix(states: &[State; MODELS], j: usize) -> State {
    let change = (1.0 - MODEL_PERSISTENCE) / (MODELS - 1) as f64;
    let mut mixed = State::default();
    for (i, state) in states.iter().enumerate() {
        let p = state.probability * if i == j { MODEL_PERSISTENCE } else { change };
        mixed.x += p * state.x;
        mixed.dx += p * state.dx;
        mixed.probability += p;
    }
    mixed.x /= mixed.probability;
    mixed.dx /= mixed.probability;
    mixed
}

fn mean(states: [State; MODELS]) -> (f64, f64) {
    states.iter().fold((0.0, 0.0), |(x, dx), s| {
        (x + s.probability * s.x, dx + s.probability * s.dx)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    const PARAMETERS: TrackingParameters = TrackingParameters {
        poles: [0.5, 0.8, 0.97],
        sigma: 1.0,
    };

    #[test]
    fn a_ramp_comes_through_without_lag_and_with_its_rate() {
        let alone = TrackingParameters {
            poles: [0.8; MODELS],
            sigma: 0.0,
        };
        for parameters in [alone, PARAMETERS] {
            let mut filter = Tracking::new(parameters, 1e-3);
            let mut last = (0.0, 0.0);
            for i in 0..2000 {
                last = filter.update(2.0 * f64::from(i) * 1e-3);
            }
            assert!((last.0 - 2.0 * 1.999).abs() < 1e-9 && (last.1 - 2.0).abs() < 1e-9);
        }
    }

    #[test]
    fn one_model_reduces_noise_by_what_theory_says() {
        let p = 0.8;
        let alone = TrackingParameters {
            poles: [p; MODELS],
            sigma: 0.0,
        };
        let mut filter = Tracking::new(alone, 1e-3);
        filter.update(0.0);
        let mut sum = filter.update(1.0).0.powi(2);
        for _ in 0..500 {
            sum += filter.update(0.0).0.powi(2);
        }
        // Variance ratio of the critically damped g-h filter.
        let theory = (1.0 - p) * (1.0 + 4.0 * p + 5.0 * p * p) / (1.0 + p).powi(3);
        assert!((sum - theory).abs() < 1e-12, "{sum} {theory}");
    }

    #[test]
    fn quiet_at_rest_and_quick_at_a_step() {
        let mut filter = Tracking::new(PARAMETERS, 1e-3);
        let mut random = Random::new(1);
        let (mut sum, mut count) = (0.0, 0.0);
        for i in 0..4000 {
            let x = filter.update(random.normal()).0;
            if i > 500 {
                sum += x * x;
                count += 1.0;
            }
        }
        let sigma = f64::sqrt(sum / count);
        assert!(sigma < 0.35, "the short model alone leaves 0.8: {sigma}");
        for _ in 0..6 {
            filter.update(30.0 + random.normal());
        }
        let (x, _) = filter.update(30.0 + random.normal());
        assert!((x - 30.0).abs() < 5.0, "{x}");
    }
}
