//! Matched filters: value and derivatives pass through the same smoothing.

use estimators::filter_bank::FilterBank;
use estimators::matched_filter::MatchedFilterParameters;
use estimators::savitzky_golay::{SavitzkyGolayParameters, coefficients};
use std::f64::consts::TAU;

const PERIOD: f64 = 1e-3;

fn bank(window: usize) -> FilterBank {
    let p = MatchedFilterParameters {
        window,
        derivatives: 2,
        sample_period: PERIOD,
    };
    FilterBank::new(2, p).unwrap()
}

/// Amplitudes of value and derivatives, the latter divided by omega and omega squared, of a bank
/// that sees a sine and a cosine: real parts at the instant that the outputs are of.
fn response(mut bank: FilterBank, hertz: f64) -> [f64; 3] {
    let omega = TAU * hertz;
    let mut time = 0.0;
    for k in 0..400 {
        time = PERIOD * f64::from(k);
        bank.update(&[(omega * time).cos(), (omega * time).sin()]);
    }
    let phase = omega * (time - bank.delay_s());
    let along = |x: &[f64], turn: f64| {
        let (s, c) = (phase + turn).sin_cos();
        (x[0] * c + x[1] * s, x[1] * c - x[0] * s)
    };
    let quarter = 0.25 * TAU;
    let (value, late) = along(bank.values(), 0.0);
    let (first, late_1) = along(bank.first_derivatives(), quarter);
    let (second, late_2) = along(bank.second_derivatives(), 2.0 * quarter);
    // No signal is later than another.
    let scale = [1.0, omega, omega * omega];
    for (late, scale) in [late, late_1, late_2].iter().zip(scale) {
        assert!(late.abs() < 1e-9 * scale, "{hertz} Hz: {late}");
    }
    [value, first / omega, second / (omega * omega)]
}

#[test]
fn values_and_derivatives_have_one_frequency_response() {
    for window in [3, 8, 15, 16, 31, 80] {
        for hertz in [1.0, 5.0, 20.0, 50.0, 100.0] {
            let [value, first, second] = response(bank(window), hertz);
            let x = TAU * hertz * PERIOD;
            // The series' next terms.
            let bound = |term: f64| 1.2 * term * value.abs() + 1e-10;
            assert!(
                (second - value).abs() <= bound(x.powi(4) / 240.0),
                "{window} at {hertz} Hz: {second} for {value}"
            );
            assert!(
                (first - value).abs() <= bound(x * x / 12.0),
                "{window} at {hertz} Hz: {first} for {value}"
            );
        }
    }
}

/// The contrast: Savitzky-Golay filters of two orders fail the test above.
#[test]
fn savitzky_golay_filters_of_two_orders_do_not_match() {
    let p = SavitzkyGolayParameters::centred(80, 2, 2, PERIOD);
    let [_, _, angle] = response(FilterBank::new(2, p).unwrap(), 15.0);
    let p = SavitzkyGolayParameters::centred(80, 1, 0, PERIOD);
    let [force, ..] = response(
        FilterBank::new(
            2,
            SavitzkyGolayParameters {
                derivatives: 2,
                ..p
            },
        )
        .unwrap(),
        15.0,
    );
    assert!((angle - force).abs() > 0.2, "{angle} and {force}");
}

#[test]
fn parabolas_and_their_derivatives_pass() {
    let mut bank = bank(16);
    let at = |t: f64| 1.0 + 2.0 * t - 3.0 * t * t;
    let mut time = 0.0;
    for k in 0..40 {
        time = PERIOD * f64::from(k);
        bank.update(&[at(time), 5.0 * time - 1.0]);
    }
    let t = time - bank.delay_s();
    assert!((bank.values()[1] - (5.0 * t - 1.0)).abs() < 1e-12);
    assert!((bank.first_derivatives()[1] - 5.0).abs() < 1e-9);
    assert!((bank.first_derivatives()[0] - (2.0 - 6.0 * t)).abs() < 1e-9);
    assert!((bank.second_derivatives()[0] + 6.0).abs() < 1e-6);
    assert_eq!(bank.delay_s(), 7.5e-3);
}

#[test]
fn the_kernel_is_a_bell_and_the_second_derivative_the_quietest() {
    for window in [3, 4, 16, 33, 80] {
        let bank = bank(window);
        let kernel = bank.kernel();
        assert!((kernel.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(kernel.iter().all(|h| *h > 0.0));
        for (a, b) in kernel.iter().zip(kernel.iter().rev()) {
            assert!((a - b).abs() < 1e-14);
        }
        let least = coefficients(window, 2, 2, 0.5 * (window - 1) as f64);
        let gain = least.iter().map(|c| c * c).sum::<f64>().sqrt() / PERIOD.powi(2);
        assert!((bank.noise_gain(2) / gain - 1.0).abs() < 1e-12);
        let value = kernel.iter().map(|h| h * h).sum::<f64>().sqrt();
        assert!((bank.noise_gain(0) / value - 1.0).abs() < 1e-12);
    }
}

#[test]
fn missed_samples_are_bridged_and_counted() {
    let (mut whole, mut holed) = (bank(16), bank(16));
    for k in 0..100 {
        let t = PERIOD * f64::from(k);
        let x = 1.0 + 2.0 * t - 3.0 * t * t;
        whole.update(&[x, x]);
        let gap = k == 50 || k == 51;
        holed.update(&[if gap { f64::NAN } else { x }, x]);
        assert_eq!(holed.missed(0), if gap { k as usize - 49 } else { 0 });
        assert!((whole.values()[0] - holed.values()[0]).abs() < 1e-12);
        assert_eq!(holed.settling(0), k < 15);
    }
}

#[test]
fn a_filter_that_cannot_be_built_is_refused_with_the_allowed_values() {
    let good = MatchedFilterParameters {
        window: 16,
        derivatives: 2,
        sample_period: PERIOD,
    };
    let bad = [
        (
            MatchedFilterParameters { window: 2, ..good },
            "matched filter: window 2; allowed: 3 to",
        ),
        (
            MatchedFilterParameters {
                derivatives: 3,
                ..good
            },
            "derivative 3; allowed: 0, 1 or 2",
        ),
        (
            MatchedFilterParameters {
                sample_period: 0.0,
                ..good
            },
            "sample period 0 s",
        ),
    ];
    for (p, expected) in bad {
        let message = FilterBank::new(1, p).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}
