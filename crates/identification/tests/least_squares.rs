//! Coefficients and standard deviations of least squares against the truth that made the data.

use identification::least_squares::Batch;
use test_support::Random;

const TRUTH: [f64; 4] = [2.0, -3e-4, 5e3, 0.7];

fn row(random: &mut Random) -> ([f64; 4], f64) {
    let a = [
        1.0,
        1e3 * random.symmetric(),
        1e-3 * random.symmetric(),
        random.symmetric(),
    ];
    let b = a.iter().zip(TRUTH).map(|(a, x)| a * x).sum();
    (a, b)
}

#[test]
fn batch_finds_the_coefficients_and_their_errors() {
    let (mut exact, mut noisy, mut random) = (Batch::new(4), Batch::new(4), Random::new(1));
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
            noisy.add(&a, b + random.symmetric());
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
    let (mut batch, mut random) = (Batch::new(4), Random::new(2));
    for _ in 0..500 {
        let (a, b) = row(&mut random);
        batch.add(&a, b);
    }
    let solution = batch.solve_bounded(0.0, |i| i == 1).unwrap();
    assert!(solution.x[1] == 0.0 && (solution.x[3] - 0.7).abs() < 0.1);
}
