//! Motor identification of D 3: coefficients that are known, and independent routes to the same ones.

use identification::motor::{Method, MotorFit, MotorRow, fit, piecewise};
use test_support::Random;

const TRUE: [f64; 3] = [2e-4, 7e-3, 3e-4];

/// Rows of the linear model: torque at rest in part, velocity in part, with noise.
fn rows(seed: u64, noise: f64) -> Vec<MotorRow> {
    let mut random = Random::new(seed);
    let row = |k: usize| {
        let dq = if k.is_multiple_of(3) {
            1e-3 * random.normal()
        } else {
            0.5 * random.normal()
        };
        let tau = 30.0 * random.normal();
        let command =
            TRUE[0] * tau + TRUE[1] * dq + TRUE[2] * dq.signum() + noise * random.normal();
        MotorRow { tau, dq, command }
    };
    (0..3000).map(row).collect()
}

fn off(fit: &MotorFit) -> [f64; 3] {
    [0, 1, 2].map(|i| fit.x[i] / TRUE[i] - 1.0)
}

#[test]
fn every_method_finds_exact_coefficients() {
    let rows = rows(1, 0.0);
    for method in [
        Method::LeastSquares,
        Method::Asymmetric,
        Method::QuadraticProgram,
    ] {
        let found = fit(&rows, method).unwrap();
        assert!(
            off(&found).iter().all(|e| e.abs() < 1e-4),
            "{method:?} {found:?}"
        );
    }
    // In two stages friction at rest counts as torque's, and the penalty shrinks what it disturbs.
    let staged = fit(&rows, Method::TwoStage).unwrap();
    assert!(
        off(&staged)[0].abs() < 0.15 && off(&staged)[1].abs() < 0.15,
        "{staged:?}"
    );
}

#[test]
fn newton_and_quadratic_program_agree_and_hardly_over_estimate() {
    for seed in 2..6 {
        // As many rows as the program takes, so that both see the same ones.
        let rows: Vec<MotorRow> = rows(seed, 2e-3).into_iter().take(1000).collect();
        let newton = fit(&rows, Method::Asymmetric).unwrap();
        let program = fit(&rows, Method::QuadraticProgram).unwrap();
        for i in 0..3 {
            let scale = newton.sigma[i].max(1e-3 * newton.x[i].abs());
            assert!(
                (newton.x[i] - program.x[i]).abs() < 1e-3 * scale,
                "{newton:?}\n{program:?}"
            );
        }
        let plain = fit(&rows, Method::LeastSquares).unwrap();
        assert!(
            newton.over < 0.2 && plain.over > 0.3,
            "{} {}",
            newton.over,
            plain.over
        );
    }
}

#[test]
fn intervals_of_least_squares_hold() {
    let inside = (10..60).filter(|seed| {
        let found = fit(&rows(*seed, 1e-3), Method::LeastSquares).unwrap();
        (found.x[0] - TRUE[0]).abs() < 1.96 * found.sigma[0]
    });
    assert!((42..=50).contains(&inside.count()));
}

#[test]
fn a_dead_zone_becomes_the_steep_middle_line() {
    let mut random = Random::new(3);
    let command = |tau: f64, side: f64| {
        // 2 mrad within 4 N·m, then 0.1 mrad for each N·m; shifted by the velocity's sign.
        let zone = (tau / 4.0).clamp(-0.5, 0.5) * 2e-3;
        zone + 1e-4 * (tau - tau.clamp(-2.0, 2.0)) + side * 2e-4
    };
    let row = |_| {
        let (tau, dq) = (20.0 * random.normal(), 0.1 * random.normal());
        let command = command(tau, dq.signum()) + 0.05 * dq + 2e-5 * random.normal();
        MotorRow { tau, dq, command }
    };
    let rows: Vec<MotorRow> = (0..6000).map(row).collect();
    for (model, side) in piecewise(&rows, 0.05).unwrap().iter().zip([1.0, -1.0]) {
        let [(low, _), (middle, offset), (high, _)] = model.lines;
        assert!(model.converged, "{model:?}");
        assert!(
            (low / 1e-4 - 1.0).abs() < 0.05 && (high / 1e-4 - 1.0).abs() < 0.05,
            "{model:?}"
        );
        assert!((middle / 5e-4 - 1.0).abs() < 0.15, "{model:?}");
        assert!((offset - side * 2e-4).abs() < 1e-4, "{model:?}");
        assert!((model.breaks[0] + 2.0).abs() < 0.5 && (model.breaks[1] - 2.0).abs() < 0.5);
    }
}

#[test]
fn rows_that_determine_nothing_are_refused() {
    let few = fit(&rows(1, 0.0)[..10], Method::LeastSquares).unwrap_err();
    assert!(few.to_string().contains("at least 30"), "{few}");
    let still: Vec<MotorRow> = (rows(1, 0.0).iter())
        .map(|row| MotorRow { dq: 0.0, ..*row })
        .collect();
    assert!(fit(&still, Method::LeastSquares).is_err());
    assert!(piecewise(&still, 0.0).is_err());
}
