//! The suite that every `JointTorqueEstimator` passes.

use estimators::compliance::{ComplianceEstimator, ComplianceParameters};
use estimators::current_based::{CurrentEstimator, CurrentParameters};
use estimators::deformation::{
    AngularFrequency, COEFFICIENTS, DeformationEstimator, DeformationParameters,
};
use estimators::encoder::{EncoderParameters, JointEncoders};
use estimators::features::FeatureSet;
use estimators::fusion::{Fusion, FusionParameters, SourceError};
use estimators::hysteresis::{
    GearParameters, HysteresisEstimator, HysteresisParameters, SlipElement,
};
use estimators::joint::{JointEstimatorParameters, JointSample, JointTorqueEstimator};
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::local_gp::{LocalGp, LocalGpEstimator, LocalGpParameters, LocalModel};
use estimators::network::{Layer, NetworkEstimator, NetworkParameters};
use estimators::regimes::{Regime, Regimes};
use estimators::savitzky_golay::{SavitzkyGolayBank, SavitzkyGolayParameters};
use estimators::set::EstimatorSet;
use estimators::tracking::TrackingParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use robot_state::torque_flags::{DEGRADED, SATURATED, VALID};
use robot_state::{TorqueEstimate, measured_flags};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Counts this thread's allocations.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: hands every request on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, which is the system's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const LIMIT: f64 = 30.0;

/// Z's test joint (Table II), with a kinematic error that is odd in q and theta, so that the sign
/// symmetry holds for it too.
fn test_joint(rule: FrictionRule, low_pass_pole: f64) -> JointEstimatorParameters {
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

/// A loaded back-and-forth motion, smooth, with the torsion such a load makes.
fn motion(i: usize) -> JointSample {
    let t = 1e-3 * i as f64;
    let (s, c) = (3.0 * t).sin_cos();
    let tau = 12.0 * (2.0 * t).sin();
    JointSample {
        q: s,
        theta: 100.0 * (s + tau / 9000.0),
        dq: 3.0 * c,
        omega: 300.0 * c,
        current: tau / 6.0 + 0.33 * c.signum(),
        flags: 0,
    }
}

fn negated(s: JointSample) -> JointSample {
    JointSample {
        q: -s.q,
        theta: -s.theta,
        dq: -s.dq,
        omega: -s.omega,
        current: -s.current,
        flags: s.flags,
    }
}

fn assert_sound(e: &TorqueEstimate) {
    assert!(e.tau.abs() <= LIMIT, "{e:?}");
    assert!(
        e.sigma.is_finite() && e.sigma >= 0.0 && e.delay_s.is_finite(),
        "{e:?}"
    );
}

fn any_input_gives_finite_output(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
    let odd = [
        0.0,
        -0.0,
        1e-300,
        1.0,
        -1e3,
        1e300,
        f64::MAX,
        f64::INFINITY,
        f64::NAN,
    ];
    let mut estimator = new();
    let mut state = 7usize;
    for i in 0..20_000 {
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            odd[(state >> 33) % odd.len()]
        };
        let wild = JointSample {
            q: next(),
            theta: next(),
            dq: next(),
            omega: next(),
            current: next(),
            flags: 0,
        };
        assert_sound(&estimator.update(&wild));
        if i % 7 == 0 {
            assert_sound(&estimator.update(&motion(i)));
        }
    }
}

/// `reaches`: whether the estimator follows the load up to the limit (a network knows no more
/// than its data).
fn too_much_load_saturates_and_never_wraps(
    new: &dyn Fn() -> Box<dyn JointTorqueEstimator>,
    reaches: bool,
) {
    for direction in [1.0, -1.0] {
        let mut last = 0.0;
        for step in 0..300 {
            // A load that grows far beyond the tangent's pole, each step held until settled.
            let torsion = direction * (1.02f64.powi(step) - 1.0) * 1e-3;
            let load = JointSample {
                theta: 100.0 * torsion,
                current: 9000.0 * torsion / 6.0,
                ..JointSample::default()
            };
            let mut estimator = new();
            let mut settled = TorqueEstimate::default();
            for _ in 0..500 {
                settled = estimator.update(&load);
                assert_sound(&settled);
            }
            let tau = direction * settled.tau;
            assert!(tau >= last - 0.01, "wraps: {last} then {tau}");
            last = tau;
            if step == 299 && reaches {
                assert!(settled.flags & SATURATED != 0 && (tau - LIMIT).abs() < 1e-6);
            }
        }
    }
}

fn recovers_after_a_gap(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
    let (mut whole, mut holed) = (new(), new());
    for i in 0..4000 {
        let sample = motion(i);
        let reference = whole.update(&sample);
        if (1000..1100).contains(&i) {
            let nothing = JointSample {
                q: f64::NAN,
                theta: f64::NAN,
                ..sample
            };
            let bridged = holed.update(&nothing);
            assert_sound(&bridged);
            assert_eq!(bridged.flags & VALID, 0);
        } else {
            let flags = if i == 2000 { measured_flags::MISSED } else { 0 };
            let estimate = holed.update(&JointSample { flags, ..sample });
            assert_eq!(estimate.flags & DEGRADED != 0, i == 2000);
            assert_eq!(estimate.flags & VALID, VALID);
            if i > 1500 {
                assert!((estimate.tau - reference.tau).abs() < 1e-3);
            }
        }
    }
    holed.reset();
    let mut fresh = new();
    for i in 0..100 {
        assert_eq!(
            holed.update(&motion(i)),
            fresh.update(&motion(i)),
            "reset forgets all"
        );
    }
    let never = JointSample {
        flags: measured_flags::NEVER,
        ..motion(0)
    };
    assert_eq!(new().update(&never).flags & VALID, 0);
}

fn same_samples_give_the_same_output_without_allocation(
    new: &dyn Fn() -> Box<dyn JointTorqueEstimator>,
) {
    let (mut a, mut b) = (new(), new());
    let before = ALLOCATIONS.with(Cell::get);
    for i in 0..2000 {
        assert!(a.update(&motion(i)) == b.update(&motion(i)));
    }
    a.reset();
    assert_eq!(ALLOCATIONS.with(Cell::get), before);
}

fn signs_are_symmetric(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
    let (mut a, mut b) = (new(), new());
    for i in 0..3000 {
        let (e, f) = (a.update(&motion(i)), b.update(&negated(motion(i))));
        assert!((e.tau + f.tau).abs() < 1e-9 && (e.sigma - f.sigma).abs() < 1e-9);
    }
}

/// Inputs that differ by little give torques that differ by little.
///
/// The cases of Z after 22 switch, and a switch may come a step earlier: `jump` bounds what one
/// of them can be worth.
fn is_continuous(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>, jump: f64) {
    let (mut a, mut b) = (new(), new());
    let mut apart = 0;
    for i in 0..3000 {
        let s = motion(i);
        let near = JointSample {
            theta: s.theta + 1e-7,
            q: s.q + 1e-9,
            ..s
        };
        let difference = (a.update(&s).tau - b.update(&near).tau).abs();
        assert!(difference < jump);
        apart += usize::from(difference > 1e-3);
    }
    assert!(apart < 100, "differs at {apart} of 3000 samples");
}

/// What the suite has to know of an implementation.
struct Expected {
    /// See `is_continuous`, N·m.
    jump: f64,
    /// See `too_much_load_saturates_and_never_wraps`.
    reaches_limit: bool,
}

fn conforms(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>, expected: Expected) {
    any_input_gives_finite_output(new);
    too_much_load_saturates_and_never_wraps(new, expected.reaches_limit);
    recovers_after_a_gap(new);
    same_samples_give_the_same_output_without_allocation(new);
    signs_are_symmetric(new);
    is_continuous(new, expected.jump);
}

const LOADED: Expected = Expected {
    jump: 1.5,
    reaches_limit: true,
};

fn gear() -> GearParameters {
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
        damping: 0.2,
        bearing: vec![SlipElement {
            limit: 1e-4,
            stiffness: 800.0,
        }],
        bearing_viscous: 0.05,
    }
}

const TRACKING: TrackingParameters = TrackingParameters {
    poles: [0.4, 0.7, 0.95],
    sigma: 1e-5,
};

fn hysteresis() -> HysteresisEstimator {
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

fn compliance() -> ComplianceEstimator {
    ComplianceEstimator::new(test_joint(FrictionRule::Physical, 0.95))
}

fn current_based() -> CurrentEstimator {
    CurrentEstimator::new(CurrentParameters {
        k_1: 6.0,
        k_2: 0.3,
        k_3: 2.0,
        k_4: 0.05,
        inertia: 0.114,
        offset: 0.0,
        sign_smoothing: 0.05,
        low_pass_pole: 0.9,
        sigma: 1.0,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

fn deformation(frequency: AngularFrequency) -> DeformationEstimator {
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

fn regimes() -> Regimes {
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
fn network() -> NetworkEstimator {
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
fn local_gp() -> LocalGpEstimator {
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
    LocalGpEstimator::new(Box::new(compliance()), &residual, LIMIT)
}

fn kalman<const N: usize>(
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

#[test]
fn compliance_physical() {
    conforms(&|| Box::new(compliance()), LOADED);
}

#[test]
fn compliance_published() {
    let p = test_joint(FrictionRule::Published, 0.95);
    conforms(&|| Box::new(ComplianceEstimator::new(p.clone())), LOADED);
}

#[test]
fn compliance_without_low_pass() {
    let p = test_joint(FrictionRule::Physical, 0.0);
    let expected = Expected {
        jump: 4.0,
        ..LOADED
    };
    conforms(&|| Box::new(ComplianceEstimator::new(p.clone())), expected);
}

#[test]
fn compliance_with_hysteresis() {
    conforms(&|| Box::new(hysteresis()), LOADED);
}

#[test]
fn current_based_torque() {
    conforms(&|| Box::new(current_based()), LOADED);
}

#[test]
fn deformation_model() {
    conforms(&|| Box::new(deformation(AngularFrequency::Spatial)), LOADED);
    let published = || deformation(AngularFrequency::Published);
    conforms(&|| Box::new(published()), LOADED);
}

#[test]
fn network_model() {
    conforms(
        &|| Box::new(network()),
        Expected {
            jump: 0.1,
            reaches_limit: false,
        },
    );
}

#[test]
fn local_gaussian_processes() {
    conforms(&|| Box::new(local_gp()), LOADED);
}

#[test]
fn kalman_filters() {
    // Their tau is a compromise with the motor's equation.
    let expected = || Expected {
        reaches_limit: false,
        ..LOADED
    };
    conforms(
        &|| Box::new(kalman::<STATES>(Transform::Linear, None)),
        expected(),
    );
    conforms(
        &|| Box::new(kalman::<STATES>(Transform::Unscented, None)),
        expected(),
    );
    conforms(
        &|| Box::new(kalman::<ADDED_STATES>(Transform::Unscented, Some(gear()))),
        expected(),
    );
}

#[test]
fn fused_sources() {
    let new = || {
        let sources: Vec<(String, Box<dyn JointTorqueEstimator + Send>)> = vec![
            ("compliance".into(), Box::new(compliance())),
            ("current".into(), Box::new(current_based())),
            (
                "kalman".into(),
                Box::new(kalman::<STATES>(Transform::Unscented, None)),
            ),
        ];
        let error = |variance: f64| SourceError {
            variance,
            reported: 0.5,
        };
        let regime = |r: usize| {
            vec![
                error(0.2),
                error(if r.is_multiple_of(2) { 4.0 } else { 0.3 }),
                error(0.2),
            ]
        };
        let fusion = Fusion::new(
            3,
            FusionParameters {
                moving: 0.01,
                loading: [1e-3, 3e-3, 1e-2],
                errors: std::array::from_fn(regime),
                blend: 0.02,
                gear_ratio: 100.0,
                sample_period: 1e-3,
                torque_limit: LIMIT,
            },
        );
        EstimatorSet::new(sources, Some(fusion))
    };
    // One of them never quite reaches the limit.
    conforms(
        &|| Box::new(new()),
        Expected {
            reaches_limit: false,
            ..LOADED
        },
    );
}

#[test]
fn nothing_around_the_estimators_allocates_either() {
    let parameters = SavitzkyGolayParameters::centred(80, 2, 2, 1e-3);
    let mut bank = SavitzkyGolayBank::new(30, parameters).unwrap();
    let mut encoders = JointEncoders::new(EncoderParameters {
        gear_ratio: 100.0,
        sample_period: 1e-3,
        max_velocity: 6.0,
        motor_wrap: std::f64::consts::TAU,
        link_wrap: f64::INFINITY,
        skew: 1e-3,
    });
    let before = ALLOCATIONS.with(Cell::get);
    for i in 0..200 {
        let missed = if i % 9 == 0 { f64::NAN } else { 0.1 };
        encoders.update(missed, missed);
        bank.update(&[missed; 30]);
    }
    bank.reset();
    encoders.reset();
    assert_eq!(ALLOCATIONS.with(Cell::get), before);
}
