//! Savitzky-Golay filters against polynomials they must reproduce; against SciPy: rt-tests/python.

use estimators::filter_bank::FilterBank;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use proptest::prelude::*;
use test_support::Random;

/// Coefficients of a polynomial, its value and first two derivatives at `t`.
fn polynomial(c: &[f64], t: f64) -> [f64; 3] {
    let mut out = [0.0; 3];
    for (k, c) in c.iter().enumerate() {
        let k = k as f64;
        out[0] += c * t.powf(k);
        out[1] += c * k * t.powf((k - 1.0).max(0.0));
        out[2] += c * k * (k - 1.0) * t.powf((k - 2.0).max(0.0));
    }
    out
}

proptest! {
    /// A polynomial of the filter's order comes out late by exactly the stated delay.
    #[test]
    fn polynomials_pass_with_the_exact_delay(
        window in 6usize..90,
        order in 0usize..6,
        delay in 0.0..1.0f64,
        c in proptest::collection::vec(-1.0..1.0f64, 6),
        channels in 1usize..10,
    ) {
        let order = order.min(window - 1);
        let parameters = SavitzkyGolayParameters {
            window, order, derivatives: 2,
            delay_samples: delay * (window - 1) as f64,
            sample_period: 0.01,
        };
        let mut bank = FilterBank::new(channels, parameters).unwrap();
        let c = &c[..=order];
        let time = |i: usize| 0.01 * i as f64 + 1.0;
        for i in 0..2 * window + 3 {
            let x = polynomial(c, time(i))[0];
            let row: Vec<f64> = (0..channels).map(|ch| x * (ch + 1) as f64).collect();
            bank.update(&row);
            if i + 1 >= window {
                let expected = polynomial(c, time(i) - bank.delay_s());
                for ch in 0..channels {
                    let gain = (ch + 1) as f64;
                    let outputs =
                        [bank.values(), bank.first_derivatives(), bank.second_derivatives()];
                    for (d, output) in outputs.iter().enumerate() {
                        let noise = 1e-13 * bank.noise_gain(d) * gain * 100.0;
                        prop_assert!((output[ch] - gain * expected[d]).abs() < 1e-11 + noise);
                    }
                }
            }
        }
    }
}

fn bank(channels: usize) -> FilterBank {
    FilterBank::new(channels, SavitzkyGolayParameters::centred(80, 2, 2, 1e-3)).unwrap()
}

#[test]
fn even_window_of_80_at_1_khz_is_39_5_ms_late() {
    assert_eq!(bank(1).delay_s(), 0.0395);
}

#[test]
fn first_sample_fills_the_window_and_derivatives_start_at_zero() {
    let mut bank = bank(2);
    bank.update(&[7.0, f64::NAN]);
    assert!((bank.values()[0] - 7.0).abs() < 1e-12 && bank.values()[1] == 0.0);
    assert!(bank.first_derivatives()[0].abs() < 1e-9);
    assert!(bank.second_derivatives()[0].abs() < 1e-6);
    assert!(bank.settling(0) && bank.settling(1));
    for _ in 0..79 {
        assert!(bank.settling(0));
        bank.update(&[7.0, 3.0]);
    }
    assert!(!bank.settling(0) && bank.settling(1));
    // While it settles, a joint in motion sees its velocity grow to the true one and not beyond.
    bank.reset();
    let velocities: Vec<f64> = (0..90)
        .map(|i| {
            bank.update(&[0.5 * 1e-3 * f64::from(i), 0.0]);
            bank.first_derivatives()[0]
        })
        .collect();
    assert!(
        velocities.iter().all(|v| (-0.1..0.6).contains(v)),
        "{velocities:?}"
    );
    assert!((velocities[85] - 0.5).abs() < 1e-9);
}

#[test]
fn a_missed_sample_of_a_parabola_changes_nothing() {
    let (mut whole, mut holed) = (bank(1), bank(1));
    for i in 0..400 {
        let t = f64::from(i) * 1e-3;
        let x = 1.0 + 2.0 * t - 3.0 * t * t;
        whole.update(&[x]);
        // An infinite and an absent sample are missed ones too.
        match i {
            200 => holed.update(&[f64::NAN]),
            201 => holed.update(&[f64::INFINITY]),
            202 => holed.update(&[]),
            _ => holed.update(&[x]),
        }
        assert!((whole.values()[0] - holed.values()[0]).abs() < 1e-10);
        assert!((whole.second_derivatives()[0] - holed.second_derivatives()[0]).abs() < 1e-6);
    }
    assert_eq!(holed.missed(0), 0);
}

#[test]
fn a_long_gap_ends_in_holding() {
    let mut bank = bank(1);
    for i in 0..200 {
        bank.update(&[(f64::from(i) * 0.1).sin()]);
    }
    for _ in 0..1000 {
        bank.update(&[f64::NAN]);
        assert!(bank.values()[0].abs() < 3.0, "extrapolation runs away");
    }
    assert!(bank.first_derivatives()[0].abs() < 1e-9);
    assert_eq!(bank.missed(0), 1000);
}

#[test]
fn noise_gain_is_the_gain_for_white_noise() {
    let bank = bank(1);
    let mut random = Random::new(1);
    let mut filter = bank.clone();
    let (mut in_square, mut out_square) = (0.0, 0.0);
    for i in 0..200_000 {
        let x = random.symmetric();
        filter.update(&[x]);
        if i > 100 {
            in_square += x * x;
            out_square += filter.first_derivatives()[0].powi(2);
        }
    }
    let gain = (out_square / in_square).sqrt();
    assert!((gain / bank.noise_gain(1) - 1.0).abs() < 0.05);
}

#[test]
fn a_filter_that_cannot_be_built_is_refused_with_the_allowed_values() {
    let good = SavitzkyGolayParameters::centred(10, 2, 2, 1e-3);
    let message = |p| FilterBank::new(1, p).unwrap_err().to_string();
    let bad = [
        (
            SavitzkyGolayParameters { window: 0, ..good },
            "window 0; allowed: 1 to",
        ),
        (
            SavitzkyGolayParameters { order: 10, ..good },
            "order 10; allowed: below the window",
        ),
        (
            SavitzkyGolayParameters {
                derivatives: 3,
                ..good
            },
            "derivative 3; allowed: 0, 1 or 2",
        ),
        (
            SavitzkyGolayParameters {
                delay_samples: 9.1,
                ..good
            },
            "9.1 samples ago; allowed: 0 to 9",
        ),
        (
            SavitzkyGolayParameters {
                sample_period: f64::NAN,
                ..good
            },
            "sample period NaN s",
        ),
    ];
    for (parameters, expected) in bad {
        let message = message(parameters);
        assert!(message.contains(expected), "{message}");
    }
}
