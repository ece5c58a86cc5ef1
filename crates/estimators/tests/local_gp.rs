//! Local Gaussian processes: models, points and digits are left out within the tolerance.

use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::local_gp::{LocalGp, LocalGpParameters, LocalModel};
use estimators::regimes::{Regime, Regimes};
use proptest::prelude::*;
use test_support::Random;

fn regimes() -> Regimes {
    let regime = Regime {
        gain: 1.0,
        sigma: 0.1,
    };
    Regimes {
        speed: 0.05,
        time_constant: 0.05,
        sample_period: 1e-3,
        rest: regime,
        moving: regime,
    }
}

/// A smooth function of the inputs.
fn truth(x: &[f64]) -> f64 {
    0.4 * (x[0] + 0.3).sin() + 0.2 * (1.3 * x[1]).cos() * x[2]
}

/// Models scattered over a cube of half width `spread` kernel widths.
fn parameters(
    seed: u64,
    models: usize,
    points: usize,
    spread: f64,
    noise: f64,
) -> LocalGpParameters {
    let mut random = Random::new(seed);
    let model = |_| {
        let centre: Vec<f64> = (0..3).map(|_| spread * random.symmetric()).collect();
        let points: Vec<f64> = (0..points)
            .flat_map(|_| [0, 1, 2].map(|c| centre[c] + 1.5 * random.symmetric()))
            .collect();
        LocalModel {
            residuals: points
                .chunks_exact(3)
                .map(|x| truth(x) + noise.sqrt() * random.symmetric())
                .collect(),
            noise: (0..points.len() / 3)
                .map(|_| noise * (1.1 + random.symmetric()))
                .collect(),
            centre,
            points,
        }
    };
    LocalGpParameters {
        features: FeatureSet::Load,
        inputs: vec![(0.0, 1.0); 3],
        signal_variance: 0.3,
        noise_variance: noise,
        models: (0..models).map(model).collect(),
        directions: 8,
        tolerance: 1e-3,
        regimes: regimes(),
        gear_ratio: 100.0,
    }
}

fn with_tolerance(parameters: &LocalGpParameters, tolerance: f64, directions: usize) -> LocalGp {
    LocalGp::new(&LocalGpParameters {
        tolerance,
        directions,
        ..parameters.clone()
    })
    .unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn the_error_of_leaving_models_and_points_out_is_within_the_tolerance(
        seed in any::<u64>(),
        models in 1usize..25,
        points in 1usize..80,
        spread in 0.0..12.0f64,
        noise in -8.0..-0.5f64,
        tolerance in -5.0..-1.0f64,
    ) {
        let parameters = parameters(seed, models, points, spread, 10f64.powf(noise));
        let tolerance = 10f64.powf(tolerance);
        let exact = with_tolerance(&parameters, 0.0, usize::MAX);
        let quick = with_tolerance(&parameters, tolerance, 8);
        let mut random = Random::new(seed ^ 1);
        for _ in 0..200 {
            let mut x = [0.0; MAX_FEATURES];
            x[..3].fill_with(|| 1.3 * (spread + 1.0) * random.symmetric());
            let (exact, quick) = (exact.predict(&x), quick.predict(&x));
            prop_assert!((exact.mean - quick.mean).abs() <= tolerance);
            // A mixture's spread of means moves with the means.
            let spread = 4.0 * tolerance * (1.0 + exact.mean.abs());
            prop_assert!(quick.variance >= exact.variance - spread - 1e-6);
        }
    }
}
