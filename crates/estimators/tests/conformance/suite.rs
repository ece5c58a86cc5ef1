//! Checks that every implementation passes.

use estimators::joint::{JointSample, JointTorqueEstimator};
use robot_state::torque_flags::{DEGRADED, SATURATED, VALID};
use robot_state::{TorqueEstimate, measured_flags};
use test_support::{Random, allocations};

pub(crate) const LIMIT: f64 = 30.0;

/// A loaded back-and-forth motion, smooth, with the torsion such a load makes.
pub(crate) fn motion(i: usize) -> JointSample {
    let t = 1e-3 * i as f64;
    let (s, c) = (3.0 * t).sin_cos();
    let tau = 12.0 * (2.0 * t).sin();
    JointSample {
        q: s,
        theta: 100.0 * (s + tau / 9000.0),
        dq: 3.0 * c,
        omega: 300.0 * c,
        current: tau / 6.0 + 0.33 * c.signum(),
        feed_forward: Some(0.8 * tau),
        flags: 0,
    }
}

pub(crate) fn negated(s: JointSample) -> JointSample {
    JointSample {
        q: -s.q,
        theta: -s.theta,
        dq: -s.dq,
        omega: -s.omega,
        current: -s.current,
        feed_forward: s.feed_forward.map(|tau| -tau),
        flags: s.flags,
    }
}

pub(crate) fn assert_sound(e: &TorqueEstimate) {
    assert!(e.tau.abs() <= LIMIT, "{e:?}");
    assert!(
        e.sigma.is_finite() && e.sigma >= 0.0 && e.delay_s.is_finite(),
        "{e:?}"
    );
}

pub(crate) fn any_input_gives_finite_output(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
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
    let mut random = Random::new(7);
    for i in 0..20_000 {
        let mut next = || odd[random.below(odd.len())];
        let wild = JointSample {
            q: next(),
            theta: next(),
            dq: next(),
            omega: next(),
            current: next(),
            feed_forward: Some(next()),
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
pub(crate) fn too_much_load_saturates_and_never_wraps(
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
                feed_forward: Some(9000.0 * torsion),
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

pub(crate) fn recovers_after_a_gap(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
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

pub(crate) fn same_samples_give_the_same_output_without_allocation(
    new: &dyn Fn() -> Box<dyn JointTorqueEstimator>,
) {
    let (mut a, mut b) = (new(), new());
    let before = allocations();
    for i in 0..2000 {
        assert!(a.update(&motion(i)) == b.update(&motion(i)));
    }
    a.reset();
    assert_eq!(allocations(), before);
}

pub(crate) fn signs_are_symmetric(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>) {
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
pub(crate) fn is_continuous(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>, jump: f64) {
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

/// Figures of an implementation that the suite needs.
pub(crate) struct Expected {
    /// See `is_continuous`, N·m.
    pub(crate) jump: f64,
    /// See `too_much_load_saturates_and_never_wraps`.
    pub(crate) reaches_limit: bool,
}

pub(crate) fn conforms(new: &dyn Fn() -> Box<dyn JointTorqueEstimator>, expected: Expected) {
    any_input_gives_finite_output(new);
    too_much_load_saturates_and_never_wraps(new, expected.reaches_limit);
    recovers_after_a_gap(new);
    same_samples_give_the_same_output_without_allocation(new);
    signs_are_symmetric(new);
    is_continuous(new, expected.jump);
}

pub(crate) const LOADED: Expected = Expected {
    jump: 1.5,
    reaches_limit: true,
};
