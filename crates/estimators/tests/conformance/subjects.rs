//! One of each implementation, with parameters that are odd in their inputs.

use crate::suite::LIMIT;
use estimators::compliance::JointEstimatorParameters;
use estimators::compliance::{ComplianceEstimator, ComplianceParameters};
use estimators::creep::CreepElement;
use estimators::current_based::{CurrentEstimator, CurrentParameters, NO_PRESLIDING};
use estimators::deformation::{
    AngularFrequency, COEFFICIENTS, DeformationEstimator, DeformationParameters,
};
use estimators::features::FeatureSet;
use estimators::feed_forward::{FeedForwardEstimator, FeedForwardParameters};
use estimators::hysteresis::{
    GearParameters, HysteresisEstimator, HysteresisParameters, SlipElement,
};
use estimators::kalman::{KalmanEstimator, KalmanParameters, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::local_gp::{LocalGp, LocalGpEstimator, LocalGpParameters, LocalModel};
use estimators::network::{Layer, NetworkEstimator, NetworkParameters};
use estimators::regimes::{Regime, Regimes};
use estimators::tracking::TrackingParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};

/// Z's test joint (Table II), with a kinematic error that is odd in q and theta, so that the sign
/// symmetry holds for it too.
pub(crate) fn test_joint(rule: FrictionRule, low_pass_pole: f64) -> JointEstimatorParameters {
    JointEstimatorParameters {
        gear_ratio: 100.0,
        torque_limit: LIMIT,
        sample_period: 1e-3,
        low_pass_pole,
        link_resolution: std::f64::consts::TAU / 524_288.0,
        motor_resolution: std::f64::consts::TAU / 4096.0,
        torsion_sigma: 1e-5,
        current_sigma: 0.02,
        compliance: ComplianceParameters {
            k_fs0: 8333.0,
            c_fs: 0.089,
            k_wg0: 1.33,
            c_wg: 83.5,
        },
        wave_generator: WaveGeneratorParameters {
            torque_constant: 0.06,
            friction: 0.02,
            viscous_friction: 1e-5,
            epsilon: 0.5,
            rule,
        },
        kinematic_error: KinematicErrorParameters {
            a0: 0.0,
            w_link: 1.0,
            link: vec![(0.0, -7.5e-5)],
            w_motor: 1.0,
            motor: vec![(0.0, -3.3e-5), (0.0, 1.6e-5)],
        },
    }
}
pub(crate) fn gear() -> GearParameters {
    GearParameters {
        linear: 8000.0,
        cubic: 1e8,
        wind_up: vec![(1e-4, -2000.0)],
        slipping: vec![
            SlipElement {
                limit: 5e-5,
                stiffness: 3000.0,
            },
            SlipElement {
                limit: 2e-4,
                stiffness: 1000.0,
            },
        ],
        creeping: vec![CreepElement {
            time: 0.5,
            stiffness: 200.0,
        }],
        damping: 0.2,
        bearing: vec![SlipElement {
            limit: 1e-4,
            stiffness: 800.0,
        }],
        bearing_viscous: 0.05,
    }
}

pub(crate) const TRACKING: TrackingParameters = TrackingParameters {
    poles: [0.4, 0.7, 0.95],
    sigma: 1e-5,
};

pub(crate) fn hysteresis() -> HysteresisEstimator {
    HysteresisEstimator::new(HysteresisParameters {
        gear: gear(),
        kinematic_error: test_joint(FrictionRule::Physical, 0.0).kinematic_error,
        gear_ratio: 100.0,
        tracking: TRACKING,
        torsion_sigma: 1e-5,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

pub(crate) fn compliance() -> ComplianceEstimator {
    ComplianceEstimator::new(test_joint(FrictionRule::Physical, 0.95))
}

/// The same with friction that builds up along the rotor's way.
pub(crate) fn current_with_presliding() -> CurrentEstimator {
    CurrentEstimator::new(CurrentParameters {
        presliding: [(1e-4, 0.4), (5e-4, 0.3), (3e-3, 0.3)],
        ..current_parameters()
    })
}

pub(crate) fn current_based() -> CurrentEstimator {
    CurrentEstimator::new(current_parameters())
}

fn current_parameters() -> CurrentParameters {
    CurrentParameters {
        k_1: 6.0,
        k_2: 0.3,
        k_3: 2.0,
        k_4: 0.05,
        inertia: 0.114,
        offset: 0.0,
        sign_smoothing: 0.05,
        presliding: NO_PRESLIDING,
        gear_ratio: 100.0,
        low_pass_pole: 0.9,
        sigma: 1.0,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    }
}

pub(crate) fn feed_forward() -> FeedForwardEstimator {
    FeedForwardEstimator::new(FeedForwardParameters {
        gain: 1.2,
        offset: 0.0,
        viscous: 0.3,
        coulomb: 0.5,
        sign_smoothing: 0.05,
        sigma: 1.0,
        torque_limit: LIMIT,
    })
}

pub(crate) fn deformation(frequency: AngularFrequency) -> DeformationEstimator {
    let mut coefficients = [0.0; COEFFICIENTS];
    coefficients[..5].copy_from_slice(&[1.2e-4, 1.0e-4, 0.8e-4, 1.0e-4, 0.8e-4]);
    // Odd terms only, so that signs are symmetric.
    coefficients[6] = 1e-4;
    coefficients[8] = 1e-5;
    if frequency == AngularFrequency::Spatial {
        // A velocity times an angle has no sign to be odd in.
        coefficients[13] = -7.5e-5;
        coefficients[19] = 2e-5;
    }
    DeformationEstimator::new(DeformationParameters {
        rated_torque: 16.0,
        coefficients,
        frequency,
        current_limit: 5.0,
        gear_ratio: 100.0,
        low_pass_pole: 0.95,
        torsion_sigma: 1e-5,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

pub(crate) fn regimes() -> Regimes {
    let regime = |gain, sigma| Regime { gain, sigma };
    Regimes {
        speed: 0.05,
        time_constant: 0.05,
        sample_period: 1e-3,
        rest: regime(0.5, 0.5),
        moving: regime(1.0, 0.2),
    }
}

/// Pairs of units that mirror each other make an odd network.
pub(crate) fn network() -> NetworkEstimator {
    let rows = [
        [2.0, 0.5, -0.1],
        [0.7, 1.0, 0.2],
        [0.1, 0.2, 1.5],
        [1.0, 1.0, 0.0],
    ];
    let mut first = Layer {
        weights: Vec::new(),
        bias: Vec::new(),
    };
    let mut last = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        for sign in [1.0, -1.0] {
            first.weights.push(row.iter().map(|w| sign * w).collect());
            first.bias.push(0.2);
            last.push(sign * [0.8, 0.5, 0.1, 0.3][i]);
        }
    }
    NetworkEstimator::new(NetworkParameters {
        features: FeatureSet::Load,
        inputs: vec![(0.0, 2e-3), (0.0, 4.0), (0.0, 3.0)],
        torque: (0.0, 8.0),
        layers: vec![
            first,
            Layer {
                weights: vec![last],
                bias: vec![0.0],
            },
        ],
        current_filter: [0.05, 0.25, 0.01],
        gear_ratio: 100.0,
        regimes: regimes(),
        low_pass_pole: 0.5,
        torque_limit: LIMIT,
    })
    .unwrap()
}

/// Two models that mirror each other.
pub(crate) fn local_gp() -> LocalGpEstimator {
    let model = |sign: f64| LocalModel {
        centre: vec![sign, 0.0, 0.0],
        points: [[1.0, 0.2, 0.0], [0.5, -0.3, 0.4], [1.5, 0.1, -1.0]]
            .iter()
            .flatten()
            .map(|x| sign * x)
            .collect(),
        residuals: [0.3, -0.1, 0.2].map(|a| sign * a).to_vec(),
        noise: vec![0.01; 3],
    };
    let residual = LocalGp::new(&LocalGpParameters {
        features: FeatureSet::Load,
        inputs: vec![(0.0, 1e-3), (0.0, 2.0), (0.0, 1.0)],
        signal_variance: 0.5,
        noise_variance: 0.01,
        models: vec![model(1.0), model(-1.0)],
        directions: 2,
        tolerance: 1e-6,
        regimes: regimes(),
        gear_ratio: 100.0,
    })
    .unwrap();
    LocalGpEstimator::new(Box::new(compliance()), residual, LIMIT)
}

pub(crate) fn kalman<const N: usize>(
    transform: Transform,
    gear: Option<GearParameters>,
) -> KalmanEstimator<N> {
    let parameters = KalmanParameters {
        joint: test_joint(FrictionRule::Physical, 0.0),
        gear,
        tracking: TRACKING,
        meshing: 0.03,
        rotor_inertia: 1.14e-5,
        sign_smoothing: 1.0,
        process: [1e-8, 1.0, 0.05, 100.0, 1e-9],
        measurement: [1e-6, 1e-10],
    };
    KalmanEstimator::new(parameters, transform)
}
