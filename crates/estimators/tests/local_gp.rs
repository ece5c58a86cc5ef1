//! Local Gaussian processes: what is left out stays within the tolerance, the factor follows its
//! points, and the loop neither waits nor frees while another thread learns.

use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::local_gp::{
    Factor, Learned, LocalGp, LocalGpEstimator, LocalGpParameters, LocalGpUpdater, LocalModel,
};
use estimators::regimes::{Regime, Regimes};
use proptest::prelude::*;
use robot_state::{TorqueEstimate, torque_flags};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // Threads that end have no counter any more.
    let _ = CALLS.try_with(|calls| calls.set(calls.get() + 1));
}

// SAFETY: as `System`; what is counted lives in the thread and allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

struct Random(u64);

impl Random {
    /// Between -1 and 1.
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

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
    let mut random = Random(seed);
    let model = |_| {
        let centre: Vec<f64> = (0..3).map(|_| spread * random.next()).collect();
        let points: Vec<f64> = (0..points)
            .flat_map(|_| [0, 1, 2].map(|c| centre[c] + 1.5 * random.next()))
            .collect();
        LocalModel {
            residuals: points
                .chunks_exact(3)
                .map(|x| truth(x) + noise.sqrt() * random.next())
                .collect(),
            noise: (0..points.len() / 3)
                .map(|_| noise * (1.1 + random.next()))
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
    fn what_is_left_out_stays_within_the_tolerance(
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
        let mut random = Random(seed ^ 1);
        for _ in 0..200 {
            let mut x = [0.0; MAX_FEATURES];
            x[..3].fill_with(|| 1.3 * (spread + 1.0) * random.next());
            let (exact, quick) = (exact.predict(&x), quick.predict(&x));
            prop_assert!((exact.mean - quick.mean).abs() <= tolerance);
            // A mixture's spread of means moves with the means.
            let spread = 4.0 * tolerance * (1.0 + exact.mean.abs());
            prop_assert!(quick.variance >= exact.variance - spread - 1e-6);
        }
    }

    #[test]
    fn a_factor_follows_its_points(seed in any::<u64>(), size in 1usize..60) {
        let mut random = Random(seed);
        // Rows whose products make a positive definite matrix, hardly better conditioned than 1e6.
        let mut rows: Vec<Vec<f64>> = Vec::new();
        let mut factor = Factor::default();
        let entry = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        for step in 0..600 {
            if rows.len() == size && step % 3 != 0 || rows.len() > size {
                let out = ((random.next() + 1.0) * 0.5 * rows.len() as f64) as usize % rows.len();
                rows.remove(out);
                factor.remove(out);
            } else {
                let row: Vec<f64> = (0..80).map(|_| random.next()).collect();
                let beside: Vec<f64> = rows.iter().map(|r| entry(r, &row)).collect();
                prop_assert!(factor.push(&beside, entry(&row, &row) + 1e-4));
                rows.push(row);
            }
        }
        let mut batch = Factor::default();
        for (i, row) in rows.iter().enumerate() {
            let beside: Vec<f64> = rows[..i].iter().map(|r| entry(r, row)).collect();
            prop_assert!(batch.push(&beside, entry(row, row) + 1e-4));
        }
        for i in 0..rows.len() {
            for (a, b) in factor.row(i).iter().zip(batch.row(i)) {
                prop_assert!((a - b).abs() < 1e-10, "{a} {b}");
            }
        }
    }
}

#[test]
fn what_cannot_be_factored_changes_nothing() {
    let mut factor = Factor::default();
    assert!(factor.push(&[], 4.0) && factor.push(&[2.0], 5.0));
    let before = factor.clone();
    assert!(!factor.push(&[2.0, 5.0], 5.0), "a copy of the last row");
    assert!(!factor.push(&[f64::NAN, 0.0], 5.0));
    assert_eq!(factor, before);
    assert_eq!(
        (factor.row(0), factor.row(1)),
        (&[2.0][..], &[1.0, 2.0][..])
    );
    let mut x = [8.0, 14.0];
    factor.solve(&mut x);
    assert_eq!(x, [0.75, 2.5]);
}

#[test]
fn learning_on_is_the_same_as_learning_at_once() {
    let start = LocalGpParameters {
        models: Vec::new(),
        ..parameters(3, 0, 0, 1.0, 1e-3)
    };
    let (mut updater, mut output) = LocalGpUpdater::new(start, 60, 0.3).unwrap();
    let mut random = Random(5);
    let mut learned = [0; 5];
    for i in 0..4000 {
        let mut x = [0.0; MAX_FEATURES];
        x[..3].fill_with(|| 2.0 * random.next());
        if i % 100 == 0 {
            x[0] = f64::NAN;
        }
        let residual = truth(&x) + 0.03 * random.next();
        learned[match updater.learn(&x, residual) {
            Learned::Merged => 0,
            Learned::Appended => 1,
            Learned::Replaced => 2,
            Learned::Founded => 3,
            Learned::Dropped => 4,
        }] += 1;
    }
    assert!(learned.iter().all(|count| *count > 10), "{learned:?}");
    updater.publish();
    // Thousands of rank-one updates later, the factor is that of the points as they are.
    let p = updater.parameters().clone();
    for (factor, model) in updater.factors().zip(&p.models) {
        assert!(model.residuals.len() <= 60 && factor.size() == model.residuals.len());
        let points: Vec<&[f64]> = model.points.chunks_exact(3).collect();
        for i in 0..points.len() {
            for j in 0..=i {
                let product: f64 = (factor.row(i).iter().zip(factor.row(j)))
                    .map(|(a, b)| a * b)
                    .sum();
                let square: f64 = (points[i].iter().zip(points[j]))
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum();
                let own = if i == j { model.noise[i] } else { 0.0 };
                let entry = p.signal_variance * (-0.5 * square).exp() + own;
                assert!((product - entry).abs() < 1e-10);
            }
        }
    }
    let batch = LocalGp::new(&p).unwrap();
    let mut square = 0.0;
    for _ in 0..500 {
        let mut x = [0.0; MAX_FEATURES];
        x[..3].fill_with(|| 1.8 * random.next());
        let (a, b) = (output.read().predict(&x), batch.predict(&x));
        assert!((a.mean - b.mean).abs() < 2.0 * p.tolerance);
        square += (a.mean - truth(&x)).powi(2) / 500.0;
    }
    assert!(
        square.sqrt() < 0.05,
        "knows the function to {}",
        square.sqrt()
    );
}

/// No torque at all: the residual alone shows.
struct Nothing;

impl JointTorqueEstimator for Nothing {
    fn update(&mut self, _: &JointSample) -> TorqueEstimate {
        TorqueEstimate {
            flags: torque_flags::VALID,
            ..TorqueEstimate::default()
        }
    }

    fn reset(&mut self) {}
}

#[test]
fn the_loop_neither_allocates_nor_frees_while_another_thread_learns() {
    let start = LocalGpParameters {
        inputs: vec![(0.0, 1e-3), (0.0, 1.0), (0.0, 1.0)],
        models: Vec::new(),
        ..parameters(7, 0, 0, 1.0, 1e-3)
    };
    let (mut updater, output) = LocalGpUpdater::new(start, 40, 0.5).unwrap();
    let mut estimator = LocalGpEstimator::learning(Box::new(Nothing), output, 40.0);
    let done = AtomicBool::new(false);
    let rounds = AtomicUsize::new(0);
    let sample = |x: f64| JointSample {
        theta: 0.1 * x,
        current: 0.5 * x,
        dq: 0.3,
        ..JointSample::default()
    };
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut random = Random(9);
            for _ in 0..60 {
                for _ in 0..50 {
                    let mut x = [0.0; MAX_FEATURES];
                    let at = random.next();
                    x[..3].copy_from_slice(&[1e-3 * at, 0.5 * at, 0.3]);
                    updater.learn(&x, 0.5 * at);
                }
                updater.publish();
                // The loop's turn, on a machine with one processor too.
                let seen = rounds.load(Ordering::Acquire);
                while rounds.load(Ordering::Acquire) == seen {
                    std::thread::yield_now();
                }
            }
            done.store(true, Ordering::Release);
        });
        let before = CALLS.with(Cell::get);
        let mut changes = 0;
        let mut last = 0.0;
        while !done.load(Ordering::Acquire) {
            let estimate = estimator.update(&sample(0.8));
            changes += usize::from(estimate.tau != last);
            last = estimate.tau;
            rounds.fetch_add(1, Ordering::Release);
        }
        assert_eq!(CALLS.with(Cell::get), before, "calls of the allocator");
        assert!(changes > 20, "models arrived while the loop ran: {changes}");
    });
    let learned = estimator.update(&sample(0.8)).tau;
    assert!((learned - 0.4).abs() < 0.02, "{learned}");
}
