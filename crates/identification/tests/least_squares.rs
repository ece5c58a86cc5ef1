//! Batch and recursive least squares against each other and against their own promises.

use identification::least_squares::{Batch, Recursive};

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

const TRUTH: [f64; 4] = [2.0, -3e-4, 5e3, 0.7];

fn row(random: &mut Random) -> ([f64; 4], f64) {
    let a = [
        1.0,
        1e3 * random.next(),
        1e-3 * random.next(),
        random.next(),
    ];
    let b = a.iter().zip(TRUTH).map(|(a, x)| a * x).sum();
    (a, b)
}

#[test]
fn batch_finds_the_coefficients_and_their_errors() {
    let (mut exact, mut noisy, mut random) = (Batch::new(4), Batch::new(4), Random(1));
    let mut spread = [0.0; 4];
    for _ in 0..2000 {
        let (a, b) = row(&mut random);
        exact.add(&a, b);
    }
    let solution = exact.solve(0.0).unwrap();
    for (x, truth) in solution.x.iter().zip(TRUTH) {
        assert!((x - truth).abs() < 1e-9 * truth.abs());
    }
    // Uniform noise within plus or minus 1 has a standard deviation of 1/sqrt(3).
    let mut sigma = [0.0; 4];
    for _ in 0..200 {
        noisy = Batch::new(4);
        for _ in 0..400 {
            let (a, b) = row(&mut random);
            noisy.add(&a, b + random.next());
        }
        let solution = noisy.solve(0.0).unwrap();
        for i in 0..4 {
            spread[i] += (solution.x[i] - TRUTH[i]).powi(2) / 200.0;
            sigma[i] += solution.sigma[i].powi(2) / 200.0;
        }
    }
    for (spread, sigma) in spread.iter().zip(sigma) {
        assert!((0.7..1.4).contains(&(spread / sigma)), "{spread} {sigma}");
    }
    let rms = noisy.solve(0.0).unwrap().rms;
    assert!((rms - 1.0 / 3f64.sqrt()).abs() < 0.05, "{rms}");
    assert!(Batch::new(3).solve(0.0).is_none());
}

#[test]
fn bounded_coefficients_are_not_negative() {
    let (mut batch, mut random) = (Batch::new(4), Random(2));
    for _ in 0..500 {
        let (a, b) = row(&mut random);
        batch.add(&a, b);
    }
    let solution = batch.solve_bounded(0.0, |i| i == 1).unwrap();
    assert!(solution.x[1] == 0.0 && (solution.x[3] - 0.7).abs() < 0.1);
}

#[test]
fn recursive_agrees_with_batch() {
    let (mut batch, mut random) = (Batch::new(4), Random(3));
    let mut recursive = Recursive::new(&[0.0; 4], &[1e6, 1e6, 1e9, 1e6], 1.0);
    for i in 0..5000 {
        let (a, b) = row(&mut random);
        let b = b + 0.1 * random.next();
        batch.add(&a, b);
        recursive.update(&a, b);
        if i == 10 {
            recursive.update(&a, f64::NAN);
        }
    }
    let solution = batch.solve(0.0).unwrap();
    let covariance = recursive.covariance();
    for i in 0..4 {
        let (x, y) = (solution.x[i], recursive.coefficients()[i]);
        assert!((x - y).abs() < 1e-7 * x.abs(), "{x} {y}");
        // P is for rows with an error of 1; the batch scales by the error that it found.
        let sigma = covariance[(i, i)].sqrt() * solution.rms;
        assert!((sigma / solution.sigma[i] - 1.0).abs() < 1e-2);
    }
}

/// The 10^7 updates, on columns that are badly scaled and nearly dependent, with
/// forgetting: coefficients follow and the covariance stays positive definite.
#[test]
fn ten_million_updates_stay_sound() {
    let mut random = Random(4);
    let mut recursive = Recursive::new(&[0.0; 3], &[1e3, 1e3, 1e3], 0.9999);
    let mut drift = 0.0;
    for i in 0..10_000_000u32 {
        let a = random.next();
        // The third column is excited for one part in ten only.
        let c = if i / 100_000 % 10 == 0 {
            random.next()
        } else {
            0.0
        };
        let row = [a, a + 1e-5 * random.next(), c];
        drift = f64::from(i) * 1e-8;
        recursive.update(&row, drift * a + 0.5 * row[2]);
    }
    let covariance = recursive.covariance();
    assert!(covariance.clone().cholesky().is_some(), "{covariance}");
    assert!((covariance.transpose() - &covariance).norm() == 0.0);
    let x = recursive.coefficients();
    assert!(
        (x[0] + x[1] - drift).abs() < 2e-3 && (x[2] - 0.5).abs() < 1e-3,
        "{x:?}"
    );
}
