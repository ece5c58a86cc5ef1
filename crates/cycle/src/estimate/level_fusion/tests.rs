//! The level between those of F/T sensors and that of encoders, from made-up errors that last.

use robot_state::{TorqueEstimate, torque_flags};
use test_support::Random;

use super::{AGREEMENT, LevelFusion, Levels, OF_FAST_SIGMA};

const LIMIT: f64 = 100.0;

fn estimate(tau: f64, sigma: f64) -> TorqueEstimate {
    TorqueEstimate {
        tau,
        sigma,
        flags: torque_flags::VALID,
        ..TorqueEstimate::default()
    }
}

/// Torque, of which the truth is 20, and its sigma, where encoders and F/T sensors err by this, after so many samples.
fn level(errors: [f64; 2], fast_sigma: f64, lasting: f64, samples: u32) -> TorqueEstimate {
    let mut fusion = LevelFusion::new(1e-3, LIMIT);
    let [fast, delayed] = errors;
    let levels = Levels {
        difference: delayed - fast,
        now: delayed - fast,
        fast_sigma: [fast_sigma, 0.0],
        delayed_sigma: [0.01, lasting],
    };
    let mut now = TorqueEstimate::default();
    for _ in 0..samples {
        now = estimate(20.0 + delayed, 0.02);
        fusion.update(Some(levels), &mut now);
    }
    now
}

/// Errors of encoders, F/T sensors and fused torque, root mean squares, and of the latter over its sigma, of so many
/// draws whose difference stays within so many standard deviations.
fn drawn([fast_sigma, lasting]: [f64; 2], within: f64) -> [f64; 4] {
    let mut random = Random::new(3);
    // The published sigma of encoders covers a little more than their error.
    let published = fast_sigma / OF_FAST_SIGMA;
    let (mut squares, mut draws) = ([0.0; 4], 0.0);
    while draws < 4000.0 {
        let errors = [fast_sigma, lasting].map(|sigma| sigma * random.normal());
        if (errors[1] - errors[0]).abs() > within * fast_sigma.hypot(lasting) {
            continue;
        }
        // What lasts does not change after the first sample.
        let fused = level(errors, published, lasting, 1);
        let error = fused.tau - 20.0;
        for (sum, x) in (squares.iter_mut()).zip([errors[0], errors[1], error, error / fused.sigma])
        {
            *sum += x * x;
        }
        draws += 1.0;
    }
    squares.map(|sum| f64::sqrt(sum / draws))
}

/// Drawn with the standard deviations that are said, the fused level is better than either where both agree, and its
/// own standard deviation right.
#[test]
fn the_fused_level_is_better_than_either_source_where_they_agree() {
    for sigmas in [[0.3, 0.3], [0.1, 0.5], [0.5, 0.1], [1.0, 0.6]] {
        let [fast, delayed, fused, normed] = drawn(sigmas, AGREEMENT.sqrt());
        assert!(fused < 1.03 * fast.min(delayed), "{fast} {delayed} {fused}");
        let best = (sigmas[0].powi(-2) + sigmas[1].powi(-2)).powf(-0.5);
        assert!(fused < 1.1 * best, "{fused}, not {best}");
        assert!((0.8..1.2).contains(&normed), "{normed}");
    }
}

/// One draw in four hundred is further apart than three standard deviations, and looks like an encoder that fails:
/// the price of not following one is a fifth of the error where encoders are five times as good.
#[test]
fn what_looks_like_a_failure_costs_at_most_a_fifth() {
    for sigmas in [[0.3, 0.3], [0.1, 0.5], [0.5, 0.1], [1.0, 0.6]] {
        let [fast, delayed, fused, normed] = drawn(sigmas, f64::INFINITY);
        assert!(fused < 1.2 * fast.min(delayed), "{fast} {delayed} {fused}");
        assert!((0.8..1.2).contains(&normed), "{normed}");
    }
}

/// An encoder that errs by far more than is known of it, and an F/T sensor of the usual kind.
#[test]
fn an_encoder_that_is_wrong_does_not_count() {
    let fused = level([10.0, 0.1], 0.3, 0.3, 2000);
    assert!((fused.tau - 20.1).abs() < 0.01, "{fused:?}");
    // The sigma shows that something contradicts.
    assert!(fused.sigma > 3.0, "{fused:?}");
    // Both within their standard deviations: half of either.
    let fused = level([0.3, -0.3], 0.3 / 0.7, 0.3, 2000);
    assert!((fused.tau - 20.0).abs() < 0.02, "{fused:?}");
}

/// A source that is lost leads back to the level of the other one without a step, and nothing is not finite.
#[test]
fn losses_and_numbers_that_are_none_make_no_step() {
    let mut fusion = LevelFusion::new(1e-3, LIMIT);
    let levels = Levels {
        difference: 0.6,
        now: 0.6,
        fast_sigma: [0.3, 0.0],
        delayed_sigma: [0.0, 0.3],
    };
    let mut last = f64::NAN;
    let mut random = Random::new(5);
    for k in 0..20_000 {
        let mut now = estimate(20.3, 0.01);
        let given = match random.below(40) {
            0 => None,
            1 => Some(Levels {
                difference: f64::NAN,
                ..levels
            }),
            2 => Some(Levels {
                fast_sigma: [f64::INFINITY, 0.0],
                ..levels
            }),
            3 => Some(Levels {
                delayed_sigma: [f64::NAN, 0.3],
                ..levels
            }),
            _ => Some(levels),
        };
        fusion.update(given, &mut now);
        assert!(now.tau.is_finite() && now.sigma > 0.0, "{now:?}");
        assert!(
            k == 0 || (now.tau - last).abs() < 0.01,
            "{k}: {last} {now:?}"
        );
        last = now.tau;
    }
    for _ in 0..5000 {
        let mut now = estimate(20.3, 0.01);
        fusion.update(None, &mut now);
        last = now.tau;
    }
    assert!((last - 20.3).abs() < 1e-3, "{last}");
}

/// The level never leaves the limit, and is reported as limited.
#[test]
fn the_limit_holds() {
    let mut fusion = LevelFusion::new(1e-3, LIMIT);
    let mut now = estimate(99.9, 0.01);
    let levels = Levels {
        difference: -0.6,
        now: -0.6,
        fast_sigma: [0.3, 0.0],
        delayed_sigma: [0.0, 0.3],
    };
    fusion.update(Some(levels), &mut now);
    assert!(
        now.tau == LIMIT && now.flags & torque_flags::SATURATED != 0,
        "{now:?}"
    );
}
