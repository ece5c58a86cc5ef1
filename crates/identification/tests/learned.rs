//! Training of network and local Gaussian processes: on the plant's bench, and on data that must
//! not mislead them.

#[allow(dead_code, reason = "shared with an example")]
use crate::bench;

use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::local_gp::{LocalGp, LocalGpEstimator};
use estimators::network::NetworkEstimator;
use identification::evaluate::Score;
use identification::gaussian_process::{self, GpOptions};
use identification::log::LogRow;
use identification::network::{self, NetworkOptions};
use identification::record::Record;
use joint_file::{JointFile, TrainedLocalGp, TrainedNetwork};
use robot_state::{TorqueEstimate, torque_flags};

/// A spring of one stiffness: a base that leaves much to be learned.
#[derive(Clone)]
struct Spring {
    stiffness: f64,
}

impl JointTorqueEstimator for Spring {
    fn update(&mut self, s: &JointSample) -> TorqueEstimate {
        TorqueEstimate {
            tau: self.stiffness * (s.theta / 100.0 - s.q),
            sigma: 0.5,
            flags: torque_flags::VALID,
            ..TorqueEstimate::default()
        }
    }

    fn reset(&mut self) {}
}

const SPRING: Spring = Spring { stiffness: 7000.0 };

/// RMS of the error and of the error in units of sigma.
fn errors(
    joint: &JointFile,
    estimator: &mut dyn JointTorqueEstimator,
    rows: &[LogRow],
) -> (f64, f64) {
    let mut front_end = joint.front_end().unwrap();
    let mut score = Score::new(joint.sample_period());
    let (mut square, mut count) = (0.0, 0.0);
    estimator.reset();
    for row in rows {
        let e = estimator.update(&row.sample(&mut front_end));
        assert!(e.flags & torque_flags::VALID != 0 || row.t < 0.1);
        if row.t > 1.5 {
            score.add(e.tau, row.tau_sensor);
            square += ((e.tau - row.tau_sensor) / e.sigma).powi(2);
            count += 1.0;
        }
    }
    (score.figures().unwrap().rms, f64::sqrt(square / count))
}

fn quick_network() -> NetworkOptions {
    NetworkOptions {
        hidden: vec![8, 8],
        max_samples: 8000,
        epochs: 15,
        steps: 120,
        ..NetworkOptions::new(40.0)
    }
}

fn quick_gp() -> GpOptions {
    GpOptions {
        models: 8,
        points: 80,
        subsample: 250,
        ..GpOptions::new("spring", 16.0)
    }
}

fn scenario(name: &str) -> Vec<LogRow> {
    let found = bench::scenarios().into_iter().find(|s| s.0 == name);
    found.unwrap().1
}

#[test]
fn both_learn_the_residual_of_a_spring() {
    let joint = bench::joint();
    let record = Record::new(&joint, &bench::training(60.0, 0.5)).unwrap();
    let mut parts = Vec::new();
    let network = network::train(&record, &quick_network(), &mut |part, _| parts.push(part));
    let network = network.unwrap().parameters;
    assert!(parts.windows(2).all(|w| w[0] <= w[1]) && parts[0] < 0.1 && parts.len() > 50);
    let gp = gaussian_process::train(&record, &quick_gp(), &mut SPRING.clone(), &mut |_, _| ());
    let gp = gp.unwrap();
    assert!(
        gp.held_out_rms.1 < 0.8 * gp.held_out_rms.0,
        "{:?}",
        gp.held_out_rms
    );
    let gp = LocalGp::new(&gp.parameters).unwrap();
    for name in ["slow", "rest"] {
        let rows = scenario(name);
        let (bare, _) = errors(&joint, &mut SPRING.clone(), &rows);
        let mut corrected = LocalGpEstimator::new(Box::new(SPRING), gp.clone(), 40.0);
        let (corrected, gp_honest) = errors(&joint, &mut corrected, &rows);
        let mut network = NetworkEstimator::new(network.clone()).unwrap();
        let (learned, network_honest) = errors(&joint, &mut network, &rows);
        let shown = format!("{name}: spring {bare}, GP {corrected}, network {learned}");
        assert!(corrected < 0.8 * bare && learned < bare, "{shown}");
        // Sigma is neither far too small nor far too large.
        for honest in [gp_honest, network_honest] {
            assert!(
                (0.2..2.5).contains(&honest),
                "{shown}: error over sigma {honest}"
            );
        }
    }
}

#[test]
fn trained_in_motion_alone_their_sigma_at_rest_covers_their_error() {
    let joint = bench::joint();
    let record = Record::new(&joint, &bench::training(40.0, 1.0)).unwrap();
    let network = network::train(&record, &quick_network(), &mut |_, _| ()).unwrap();
    let gp = gaussian_process::train(&record, &quick_gp(), &mut SPRING.clone(), &mut |_, _| ());
    let gp = gp.unwrap();
    assert_eq!(gp.parameters.regimes.rest.gain, 0.0);
    assert!(gp.parameters.regimes.moving.gain > 0.5);
    let rows = scenario("rest");
    let (bare, _) = errors(&joint, &mut SPRING.clone(), &rows);
    let gp = LocalGp::new(&gp.parameters).unwrap();
    let mut corrected = LocalGpEstimator::new(Box::new(SPRING), gp.clone(), 40.0);
    let (corrected, honest) = errors(&joint, &mut corrected, &rows);
    assert!(corrected < 1.05 * bare, "GP {corrected}, spring {bare}");
    assert!(honest < 1.5, "error over sigma {honest}");
    let mut network = NetworkEstimator::new(network.parameters).unwrap();
    let (_, honest) = errors(&joint, &mut network, &rows);
    assert!(honest < 1.0, "error over sigma {honest}");
}

#[test]
fn a_base_that_lags_teaches_no_residual() {
    let joint = bench::joint();
    // The torque is exactly that of the spring, which the base reports 2.5 ms late with that delay.
    let mut rows = bench::training(40.0, 0.8);
    let mut front_end = joint.front_end().unwrap();
    for row in &mut rows {
        let sample = row.sample(&mut front_end);
        row.tau_sensor = SPRING.clone().update(&sample).tau;
    }
    struct Late(estimators::low_pass::LowPass);
    impl JointTorqueEstimator for Late {
        fn update(&mut self, s: &JointSample) -> TorqueEstimate {
            let mut estimate = SPRING.clone().update(s);
            estimate.tau = self.0.update(estimate.tau);
            estimate.delay_s = 1e-3 * self.0.delay_samples();
            estimate
        }

        fn reset(&mut self) {
            self.0.reset();
        }
    }
    let record = Record::new(&joint, &rows).unwrap();
    let mut late = Late(estimators::low_pass::LowPass::new(0.6667));
    let gp = gaussian_process::train(&record, &quick_gp(), &mut late, &mut |_, _| ()).unwrap();
    let learned: f64 = gp
        .parameters
        .models
        .iter()
        .flat_map(|m| &m.residuals)
        .map(|y| y * y)
        .sum();
    let count = gp
        .parameters
        .models
        .iter()
        .map(|m| m.residuals.len())
        .sum::<usize>();
    let learned = (learned / count as f64).sqrt();
    // Left in, the lag would be some tenths of a newton metre.
    assert!(learned < 0.03, "{learned}");
}

#[test]
fn the_same_seed_gives_the_same_network_and_files_hold_everything() {
    let joint = bench::joint();
    let record = Record::new(&joint, &bench::training(15.0, 0.7)).unwrap();
    let options = NetworkOptions {
        epochs: 3,
        steps: 5,
        ..quick_network()
    };
    let train =
        |options: &NetworkOptions| network::train(&record, options, &mut |_, _| ()).unwrap();
    let trained = train(&options);
    assert_eq!(trained, train(&options));
    assert_ne!(trained, train(&NetworkOptions { seed: 2, ..options }));
    let text = trained.to_text().unwrap();
    assert_eq!(
        TrainedNetwork::from_text(&text, "network.toml").unwrap(),
        trained
    );
    let refused = |text: &str| {
        TrainedNetwork::from_text(text, "network.toml")
            .unwrap_err()
            .to_string()
    };
    for (from, to, expected) in [
        (
            "features = \"phase\"",
            "features = \"moon\"",
            "network.toml:1: features = \"moon\"; allowed: phase",
        ),
        (
            "low_pass_pole = 0.0",
            "low_pass_pole = 1.0",
            "low_pass_pole = 1; allowed: a number from 0 to below 1",
        ),
        (
            "gear_ratio = 100.0",
            "gear_ratio = nan",
            "gear_ratio = NaN; allowed",
        ),
        ("gear_ratio", "gear", "unknown field `gear`"),
        (
            "rest_gain = 1.0",
            "rest_gain = 2.0",
            "regimes.rest_gain = 2; allowed: a number from 0 to 1",
        ),
        (
            "bias = [",
            "bias = [0.5, ",
            "network.toml: network: layer 0 has 8 rows of weights and 9 biases",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let message = refused(&text.replacen(from, to, 1));
        assert!(message.contains(expected), "{message}");
    }

    let gp = gaussian_process::train(&record, &quick_gp(), &mut SPRING.clone(), &mut |_, _| ());
    let gp = gp.unwrap();
    let text = gp.to_text().unwrap();
    assert_eq!(TrainedLocalGp::from_text(&text, "gp.toml").unwrap(), gp);
    let refused = |text: &str| {
        TrainedLocalGp::from_text(text, "gp.toml")
            .unwrap_err()
            .to_string()
    };
    for (from, to, expected) in [
        (
            "centre = [",
            "centre = [0.1, ",
            "gp.toml: local Gaussian processes: model 0 has 10",
        ),
        ("directions = 12", "directions = -1", "gp.toml:6: "),
        ("noise_Nm2 = [", "noise_Nm2 = [nan, ", "noise_Nm2[0] = NaN"),
    ] {
        assert!(text.contains(from), "{from}");
        let message = refused(&text.replacen(from, to, 1));
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn logs_that_do_not_suffice_are_refused() {
    let joint = bench::joint();
    let mut rows = bench::training(15.0, 0.7);
    let message = |rows: &[LogRow]| {
        let record = Record::new(&joint, rows).unwrap();
        let network = network::train(&record, &quick_network(), &mut |_, _| ()).unwrap_err();
        let gp = gaussian_process::train(&record, &quick_gp(), &mut SPRING.clone(), &mut |_, _| ());
        [network.to_string(), gp.unwrap_err().to_string()]
    };
    for message in message(&rows[..900]) {
        assert!(message.contains("allowed: at least"), "{message}");
    }
    rows.iter_mut().for_each(|row| row.tau_sensor = f64::NAN);
    for message in message(&rows) {
        assert!(message.contains("0 samples to train on"), "{message}");
    }
    let record = Record::new(&joint, &rows).unwrap();
    let hidden = NetworkOptions {
        hidden: vec![],
        ..quick_network()
    };
    let message = network::train(&record, &hidden, &mut |_, _| ())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("hidden layers []; allowed: 1 to 8"),
        "{message}"
    );
    let models = GpOptions {
        models: 65,
        ..quick_gp()
    };
    let message = gaussian_process::train(&record, &models, &mut SPRING.clone(), &mut |_, _| ());
    assert!(
        message
            .unwrap_err()
            .to_string()
            .contains("65 models; allowed: 1 to 64")
    );
}
