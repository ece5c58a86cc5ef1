//! Filtered samples of any ages compared with filtered samples taken at SYNC, of known signals.

use super::{AlignedBank, Outputs, Signal};
use crate::time::{SECONDS_PER_NS, Stamp};
use estimators::filter_bank::FilterDesign;
use estimators::matched_filter::MatchedFilterParameters;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use proptest::prelude::*;
use robot_config::slots::Source;
use robot_config::{Sampled, Sampling};
use test_support::Random;

const PERIOD: f64 = 1e-3;
const PERIOD_NS: u64 = 1_000_000;
const START_NS: u64 = 7_000_000_000;

fn at_sync(latency: f64) -> Sampling {
    Sampling {
        sampled: Sampled::AtSync,
        latency,
    }
}

fn when_sent(period: f64, latency: f64) -> Sampling {
    Sampling {
        sampled: Sampled::WhenSent { period },
        latency,
    }
}

fn savitzky_golay(window: usize, order: usize) -> FilterDesign {
    SavitzkyGolayParameters::centred(window, order, 2, PERIOD).into()
}

fn matched(window: usize) -> FilterDesign {
    FilterDesign::from(MatchedFilterParameters {
        window,
        derivatives: 2,
        sample_period: PERIOD,
    })
}

/// Filters over 80 samples.
fn any_design() -> impl Strategy<Value = FilterDesign> {
    prop_oneof![
        Just(savitzky_golay(80, 1)),
        Just(savitzky_golay(80, 2)),
        Just(matched(80))
    ]
}

fn bank(sampling: Sampling, design: FilterDesign) -> AlignedBank {
    let signal = Signal {
        sampling,
        source: Source::Imu(0),
        message: 0,
    };
    AlignedBank::new(&[signal], design, PERIOD).unwrap()
}

/// The outputs after `cycles` of samples of `x`, the newest sent `ages(k)` before SYNC k and
/// `latency` old by then; no sample where the age is not finite.
fn filtered(
    mut bank: AlignedBank,
    cycles: u32,
    latency: f64,
    ages: impl Fn(u32) -> f64,
    x: impl Fn(f64) -> f64,
) -> Outputs {
    for k in 0..cycles {
        let sync = START_NS + u64::from(k) * PERIOD_NS;
        let age_ns = (ages(k) / SECONDS_PER_NS).round();
        let taken = f64::from(k) * PERIOD - age_ns * SECONDS_PER_NS - latency;
        let sample = if age_ns.is_finite() {
            x(taken)
        } else {
            f64::NAN
        };
        let stamp = sync.wrapping_add_signed(-(age_ns as i64));
        bank.update(&[sample], &[Some(stamp)], Stamp(sync));
    }
    bank.outputs(0)
}

/// Differences of value and derivatives, in shares of a wave of frequency `omega`.
fn differences(a: Outputs, b: Outputs, omega: f64) -> Outputs {
    std::array::from_fn(|j| (a[j] - b[j]).abs() / omega.powi(j as i32))
}

/// Deviation of a wave of frequency `omega` from a parabola over half a window: the share of the
/// age's effect that alignment leaves.
fn curved(omega: f64) -> f64 {
    (omega * 40.0 * PERIOD).powi(2) / 6.0
}

proptest! {
    #[test]
    fn parabolas_are_aligned_exactly_for_any_ages(
        ages in prop::collection::vec(-0.5..2.0f64, 400),
        missing in prop::collection::vec(0..25u32, 400),
        [v, a, b] in prop::array::uniform3(-3.0..3.0f64),
        latency in -3e-3..3e-3f64,
        design in (40..90usize).prop_flat_map(|window| {
            prop_oneof![Just(savitzky_golay(window, 2)), Just(matched(window))]
        }),
    ) {
        let x = |t: f64| v + a * (t - 0.4) + 40.0 * b * (t - 0.4).powi(2);
        // Single samples are missing once the window is full.
        let gap = |k: u32| {
            let k = k as usize;
            k > 100 && missing[k] == 0 && missing[k - 1] != 0
        };
        let [sent, none] = [1.0, 0.0].map(|share| move |k: u32, age: f64| {
            if gap(k) { f64::NAN } else { share * age * PERIOD }
        });
        let run = |sampling, latency, ages: &dyn Fn(u32) -> f64| {
            filtered(bank(sampling, design), 400, latency, ages, x)
        };
        let aligned = run(when_sent(PERIOD, latency), latency, &|k| sent(k, ages[k as usize]));
        let synced = run(Sampling::AT_SYNC, 0.0, &|k| none(k, 0.0));
        let differences = differences(aligned, synced, 30.0);
        prop_assert!(differences.iter().all(|d| *d < 1e-8), "{aligned:?} {synced:?}");
    }

    #[test]
    fn a_constant_age_of_some_periods_changes_little(
        periods in -4.0..4.0f64, hz in 0.2..4.0f64, phase in 0.0..6.0f64, design in any_design(),
    ) {
        let (delta, omega) = (periods * PERIOD, std::f64::consts::TAU * hz);
        let x = |t: f64| (omega * t + phase).sin();
        let synced = filtered(bank(Sampling::AT_SYNC, design), 300, 0.0, |_| 0.0, x);
        for (sampling, latency, sent) in [
            (at_sync(delta), delta, 0.0),
            (when_sent(4.0 * PERIOD, 0.0), 0.0, delta),
            (when_sent(4.0 * PERIOD, 0.5 * delta), 0.5 * delta, 0.5 * delta),
        ] {
            let aligned = filtered(bank(sampling, design), 300, latency, |_| sent, x);
            let [value, rate, curvature] = differences(aligned, synced, omega);
            // Effect of the age without alignment, and the shares that alignment leaves.
            let late = omega * delta.abs() + 1e-9;
            prop_assert!(value < late * (late * late / 6.0 + curved(omega)));
            prop_assert!(rate < late * (late / 2.0 + curved(omega)));
            prop_assert!(curvature < 1.1 * late);
        }
    }

    #[test]
    fn a_sensor_with_its_own_clock_changes_little(
        ppm in prop_oneof![-5000.0..-20.0f64, 20.0..5000.0f64],
        start in 0.0..1.0f64,
        jitter in prop::collection::vec(0.0..0.2f64, 400),
        hz in 0.2..4.0f64,
        phase in 0.0..6.0f64,
        design in any_design(),
    ) {
        let omega = std::f64::consts::TAU * hz;
        let x = |t: f64| (omega * t + phase).sin();
        // The last sample sent before each SYNC: 0 to 1 period old, drifting, and sometimes the
        // same one twice.
        let own = PERIOD * (1.0 + 1e-6 * ppm);
        let age = |k: u32| {
            let sync = f64::from(k) * PERIOD;
            let n = (sync / own - start).floor();
            sync - (n + start) * own + jitter[k as usize] * PERIOD
        };
        let run = |sampling, age: &dyn Fn(u32) -> f64| {
            filtered(bank(sampling, design), 400, 0.0, age, x)
        };
        let synced = run(Sampling::AT_SYNC, &|_| 0.0);
        let [value, rate, curvature] =
            differences(run(when_sent(own, 0.0), &age), synced, omega);
        let [_, lost_rate, lost_curvature] =
            differences(run(Sampling::AT_SYNC, &age), synced, omega);
        let late = omega * PERIOD;
        prop_assert!(value < late * (late + curved(omega)), "{value}");
        // A jump of the age by a period tilts and bends the window's samples.
        let [tilted, bent] = [0.03, 2.0 / omega].map(|jump| jump.max(late));
        prop_assert!(rate < tilted * (late + curved(omega)), "{rate} of {lost_rate}");
        prop_assert!(curvature < 1.5 * late + bent * curved(omega), "{curvature} of {lost_curvature}");
    }
}

#[test]
fn alignment_adds_at_most_five_per_cent_noise() {
    let noise = |k: u64| Random::new(k).symmetric() / 2.0;
    let power = |sampling: Sampling, design: FilterDesign| {
        let mut bank = bank(sampling, design);
        let mut sums = [0.0; 3];
        for k in 0..20_000 {
            let sync = Stamp(START_NS + k * PERIOD_NS);
            let stamp = sync.0 - (noise(k + 1_000_000) * 9e5) as u64;
            bank.update(&[noise(k)], &[Some(stamp)], sync);
            if k > 100 {
                for (sum, y) in sums.iter_mut().zip(bank.outputs(0)) {
                    *sum += y * y;
                }
            }
        }
        sums.map(f64::sqrt)
    };
    for design in [savitzky_golay(80, 1), savitzky_golay(80, 2), matched(80)] {
        let synced = power(Sampling::AT_SYNC, design);
        for sampling in [at_sync(3e-3), when_sent(PERIOD, 2e-3)] {
            let aligned = power(sampling, design);
            for (a, s) in aligned.iter().zip(synced) {
                assert!(*a < 1.05 * s, "{aligned:?} of {synced:?}");
            }
        }
    }
}
