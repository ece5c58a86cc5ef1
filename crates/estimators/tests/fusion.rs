//! Fusion: sources of similar variance share the torque, others have no weight; reported sigma and
//! gaps count.

use estimators::fusion::{
    FusedSource, Fusion, FusionParameters, MAX_VARIANCE_RATIO, REGIMES, SourceError,
};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::role::Role;
use estimators::set::{EstimatorSet, Source};
use proptest::prelude::*;
use robot_state::{TorqueEstimate, torque_flags};

fn fusion(errors: &[(f64, f64)]) -> Fusion {
    let errors: Vec<SourceError> = errors
        .iter()
        .map(|&(rms, reported)| SourceError {
            variance: rms * rms,
            reported,
        })
        .collect();
    let mut parameters = parameters(errors);
    for source in &mut parameters.sources {
        source.role = Role::Torsion;
    }
    Fusion::new(parameters)
}

fn estimate(tau: f64, sigma: f64) -> TorqueEstimate {
    TorqueEstimate {
        tau,
        sigma,
        flags: torque_flags::VALID,
        ..TorqueEstimate::default()
    }
}

#[test]
fn sources_of_equal_variance_share_and_a_poor_one_has_no_weight() {
    let mut fusion = fusion(&[(0.1, 0.1), (0.1, 0.1), (0.2, 0.1)]);
    let sources = [estimate(1.0, 0.1), estimate(2.0, 0.1), estimate(50.0, 0.1)];
    let fused = fusion.update(&JointSample::default(), &sources);
    assert!((fused.tau - 1.5).abs() < 1e-12 && (fused.sigma - 0.1).abs() < 1e-12);
}

#[test]
fn a_source_of_large_sigma_loses_its_weight_and_regains_it() {
    let mut fusion = fusion(&[(0.1, 0.1), (0.13, 0.1)]);
    let at = JointSample::default();
    let mut both = |sigma: f64| {
        let fused = fusion.update(&at, &[estimate(1.0, sigma), estimate(2.0, 0.1)]);
        (fused.tau, fused.sigma)
    };
    assert!(both(0.1).0 < 1.5);
    // Twice its usual sigma is four times its variance: beyond the other's.
    let (tau, sigma) = both(0.2);
    assert!((tau - 2.0).abs() < 1e-12 && (sigma - 0.13).abs() < 1e-12);
    assert!(both(0.1).0 < 1.5);
}

#[test]
fn without_a_valid_source_the_last_torque_is_held_and_marked() {
    let mut fusion = fusion(&[(0.1, 0.1)]);
    let at = JointSample::default();
    fusion.update(&at, &[estimate(3.0, 0.1)]);
    let invalid = TorqueEstimate {
        flags: 0,
        ..estimate(9.0, 0.1)
    };
    let held = fusion.update(&at, &[invalid]);
    assert!(held.tau == 3.0 && held.flags & torque_flags::VALID == 0);
}

fn clamped(tau: f64, sigma: f64) -> TorqueEstimate {
    TorqueEstimate {
        flags: torque_flags::VALID | torque_flags::SATURATED,
        ..estimate(tau, sigma)
    }
}

#[test]
fn a_torque_at_its_clamp_that_the_other_group_contradicts_takes_no_part() {
    let at = JointSample::default();
    // A torsion at the torque limit where the current is far below, with a sigma that would give it a third of the
    // weight.
    for (limit, sigma) in [(100.0, 0.1), (100.0, 0.5), (-100.0, 0.4), (100.0, 10.0)] {
        let mut fusion = two_groups();
        let (torsion, current) = (clamped(limit, sigma), estimate(-0.6 * limit, 0.3));
        for i in 0..3000 {
            let fused = fusion.update(&at, &[torsion, torsion, current]);
            assert!((fused.tau - current.tau).abs() < 1e-9, "{}", fused.tau);
            assert!((fused.sigma - 0.3).abs() < 1e-9, "{i}: {}", fused.sigma);
            assert_eq!(fused.flags & torque_flags::SATURATED, 0);
        }
        // It is seen nevertheless.
        assert!(fusion.disagrees(), "{limit} {sigma}");
    }
    // Nor the other way round.
    let torsion = estimate(3.0, 0.1);
    let fused = two_groups().update(&at, &[torsion, torsion, clamped(-100.0, 0.3)]);
    assert!((fused.tau - 3.0).abs() < 1e-12 && fused.flags & torque_flags::SATURATED == 0);
}

#[test]
fn a_torque_at_its_clamp_that_is_borne_out_is_a_bound() {
    let at = JointSample::default();
    // The current is short of it by less than two standard deviations: the torque lies between both.
    let bound = clamped(100.0, 0.1);
    let fused = two_groups().update(&at, &[bound, bound, estimate(99.5, 0.3)]);
    assert!((99.9..100.0).contains(&fused.tau), "{}", fused.tau);
    assert!(fused.flags & torque_flags::SATURATED != 0);
    // A current beyond the bound: it does not hold the torque back.
    let mut beyond = parameters(vec![
        SourceError {
            variance: 0.01,
            reported: 0.1
        };
        3
    ]);
    beyond.torque_limit = 200.0;
    let fused = Fusion::new(beyond).update(&at, &[bound, bound, estimate(120.0, 0.1)]);
    assert!((fused.tau - 120.0).abs() < 1e-9, "{}", fused.tau);
    // Both stand at their clamp, or nothing else is there: the bound, marked.
    for current in [clamped(100.0, 0.3), TorqueEstimate::default()] {
        let fused = two_groups().update(&at, &[bound, bound, current]);
        let marks = torque_flags::SATURATED | torque_flags::VALID;
        assert!(fused.tau == 100.0 && fused.flags & marks == marks);
    }
}

#[test]
fn a_source_at_its_clamp_beside_a_gear_within_its_range_has_no_weight() {
    let at = JointSample::default();
    let current = estimate(4.0, 0.3);
    let fused = two_groups().update(&at, &[estimate(5.0, 0.1), clamped(100.0, 0.1), current]);
    assert!((fused.tau - 4.9).abs() < 1e-9, "{}", fused.tau);
    // A gear at its clamp concerns every source from the torsion.
    let fused = two_groups().update(&at, &[clamped(100.0, 0.1), estimate(90.0, 0.1), current]);
    assert!((fused.tau - 4.0).abs() < 1e-9, "{}", fused.tau);
}

proptest! {
    /// Between the least and the largest of the close ones, whatever they report, and never surer
    /// than the best.
    #[test]
    fn within_the_close_ones(
        sources in prop::collection::vec((0.01..1.0f64, -50.0..50.0f64), 1..8),
    ) {
        let errors: Vec<(f64, f64)> = sources.iter().map(|(rms, _)| (*rms, 1.0)).collect();
        let estimates: Vec<TorqueEstimate> =
            sources.iter().map(|(_, tau)| estimate(*tau, 1.0)).collect();
        let fused = fusion(&errors).update(&JointSample::default(), &estimates);
        let least = errors.iter().map(|e| e.0).fold(f64::MAX, f64::min);
        let close = sources.iter().filter(|s| s.0 * s.0 < MAX_VARIANCE_RATIO * least * least);
        let (low, high) = close.fold((f64::MAX, f64::MIN), |(low, high), s| {
            (low.min(s.1), high.max(s.1))
        });
        prop_assert!(fused.tau >= low - 1e-9 && fused.tau <= high + 1e-9);
        prop_assert!(fused.sigma >= least * (1.0 - 1e-9));
        prop_assert!(fused.sigma <= least * MAX_VARIANCE_RATIO.sqrt() * (1.0 + 1e-9));
    }
}

/// Torsion (two sources, sigma 0.1) and current (sigma 0.3), with the current as the independent source.
fn two_groups() -> Fusion {
    of_two_groups(false)
}

fn of_two_groups(zero_unknown: bool) -> Fusion {
    let errors = [0.1, 0.1, 0.3].map(|rms: f64| SourceError {
        variance: rms * rms,
        reported: rms,
    });
    let parameters = FusionParameters {
        zero_unknown,
        ..parameters(errors.to_vec())
    };
    Fusion::new(parameters)
}

/// Two sources from the torsion, the first of them the gear, and the current.
fn parameters(errors: Vec<SourceError>) -> FusionParameters {
    let roles = [Role::Gear, Role::Torsion, Role::Current];
    let sources = errors
        .iter()
        .zip(roles.into_iter().chain(std::iter::repeat(Role::Torsion)));
    FusionParameters {
        moving: 0.01,
        loading: [1e-3, 1e-2, 1e-1],
        sources: sources
            .map(|(error, role)| FusedSource {
                role,
                errors: [*error; REGIMES],
                fused: true,
            })
            .collect(),
        blend: 0.03,
        gear_ratio: 100.0,
        sample_period: 1e-3,
        torque_limit: 100.0,
        rated_torque: 40.0,
        rest_factor: 1.0,
        zero_unknown: false,
        correction: None,
    }
}

#[test]
fn torsion_and_current_combine_with_minimum_variance() {
    let sources = [estimate(1.0, 0.1), estimate(1.0, 0.1), estimate(1.2, 0.3)];
    let fused = two_groups().update(&JointSample::default(), &sources);
    let expected = (0.09 * 1.0 + 0.01 * 1.2) / 0.1;
    assert!((fused.tau - expected).abs() < 1e-9, "{}", fused.tau);
    let sigma = f64::sqrt(0.01 * 0.09 / 0.1);
    assert!((fused.sigma - sigma).abs() < 1e-3, "{}", fused.sigma);
}

#[test]
fn sigma_covers_a_disagreement_and_the_reference_raises_every_torsion_source() {
    let at = JointSample::default();
    let mut fusion = two_groups();
    let apart = [estimate(1.0, 0.1), estimate(1.0, 0.1), estimate(9.0, 0.3)];
    let fused = fusion.update(&at, &apart);
    assert!(fused.sigma > 0.3 * 8.0 / 2.0 * 0.3, "{}", fused.sigma);
    for _ in 0..3000 {
        fusion.update(&at, &apart);
    }
    assert!(fusion.disagreement() > 50.0 && fusion.disagrees());
    let fused = fusion.update(&at, &apart);
    // Either group may be the wrong one: the sigma is of the order of the smaller error.
    assert!((fused.tau - 1.0).abs() < 2.0 * fused.sigma);
    // It is over soon after both agree again.
    let near = [estimate(1.0, 0.1), estimate(1.0, 0.1), estimate(1.2, 0.3)];
    for _ in 0..5000 {
        fusion.update(&at, &near);
    }
    assert!(!fusion.disagrees());
    // A short one is covered by the sigma and not reported.
    for _ in 0..500 {
        fusion.update(&at, &apart);
        assert!(!fusion.disagrees());
    }
    // The gear outside of its ranges: torsion loses its weight, also that of the other source.
    let mut fusion = two_groups();
    let outside = [estimate(5.0, 3.0), estimate(5.0, 0.1), estimate(2.0, 0.3)];
    let fused = fusion.update(&at, &outside);
    assert!((fused.tau - 2.0).abs() < 0.1, "{}", fused.tau);
}

/// The torque from a current whose offset may change.
struct FromCurrent;

impl JointTorqueEstimator for FromCurrent {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        estimate(sample.current, 0.1)
    }

    fn reset(&mut self) {}
}

#[test]
fn every_tare_zeroes_the_current_wholly() {
    let current = Source {
        name: "current".into(),
        role: Role::Current,
        estimator: Box::new(FromCurrent),
    };
    let mut set = EstimatorSet::new(vec![current], None);
    for current in [5.0, 9.0] {
        let sample = JointSample {
            current,
            ..JointSample::default()
        };
        for i in 0..150 {
            let tau = set.update(&sample).tau;
            if (50..100).contains(&i) {
                set.tare_to(2.0, 0.1);
            } else if i >= 100 {
                assert!((tau - 2.0).abs() < 1e-9, "{current}: {tau}");
            }
        }
    }
}

#[test]
fn at_rest_the_current_loses_weight_once_the_zero_of_the_torsion_is_known() {
    let at = JointSample::default();
    let sources = [estimate(1.0, 0.1), estimate(1.0, 0.1), estimate(2.0, 0.1)];
    let errors = [0.1, 0.1, 0.1].map(|sigma: f64| SourceError {
        variance: sigma * sigma,
        reported: sigma,
    });
    let fusion = |zero_unknown| {
        let parameters = FusionParameters {
            rest_factor: 4.0,
            zero_unknown,
            ..parameters(errors.to_vec())
        };
        Fusion::new(parameters)
    };
    let mut unknown = fusion(true);
    let share = |fusion: &mut Fusion| fusion.update(&at, &sources).tau - 1.0;
    assert!((share(&mut unknown) - 0.5).abs() < 1e-9);
    unknown.tare(0.1);
    assert!((share(&mut unknown) - 0.2).abs() < 1e-9);
    unknown.reset();
    assert!((share(&mut unknown) - 0.5).abs() < 1e-9);
    assert!((share(&mut fusion(false)) - 0.2).abs() < 1e-9);
}

#[test]
fn the_way_of_the_motor_tells_motion_from_rest_not_the_velocity_of_the_link() {
    let errors = [0.1, 0.1, 0.1].map(|sigma: f64| SourceError {
        variance: sigma * sigma,
        reported: sigma,
    });
    let sources = [estimate(1.0, 0.1), estimate(1.0, 0.1), estimate(2.0, 0.1)];
    // Share of the current after a second in which the motor turns at a rate (rad/s), or swings by an angle (rad).
    let share = |rate: f64, swing: f64, dq: f64| {
        let mut fusion = Fusion::new(FusionParameters {
            rest_factor: 4.0,
            ..parameters(errors.to_vec())
        });
        let mut tau = 0.0;
        for i in 0..1000 {
            let t = 1e-3 * f64::from(i);
            let sample = JointSample {
                theta: 7.0 + rate * t + swing * (10.0 * t).sin(),
                dq,
                ..JointSample::default()
            };
            tau = fusion.update(&sample, &sources).tau;
        }
        tau - 1.0
    };
    assert!((share(0.0, 0.0, 0.0) - 0.2).abs() < 1e-9);
    // A link that swings on its gear: faster than the fit called motion, but the motor hardly turns.
    assert!((share(0.0, 0.05, 0.5) - 0.2).abs() < 2e-3);
    for rate in [5.0, -5.0] {
        assert!((share(rate, 0.0, 0.5 * rate.signum()) - 0.5).abs() < 1e-6);
    }
    assert!((0.21..0.5).contains(&share(2.0, 0.0, 0.02)));
}

#[test]
fn a_joint_that_has_hardly_changed_since_its_tare_is_hardly_wrong() {
    let at = JointSample::default();
    let mut fusion = of_two_groups(true);
    let both = |tau: f64| [estimate(tau, 3.0), estimate(tau, 3.0), estimate(tau, 3.0)];
    let before = fusion.update(&at, &both(10.0));
    fusion.tare(0.1);
    let after = fusion.update(&at, &both(10.0));
    assert!(before.sigma > 2.0 && after.sigma < 0.15, "{}", after.sigma);
    let further = fusion.update(&at, &both(11.0));
    assert!((0.5..0.6).contains(&further.sigma), "{}", further.sigma);
    // Far from there it is what both sources say, and after a reset nothing is known.
    let far = fusion.update(&at, &both(30.0)).sigma;
    assert!((0.8 * before.sigma..=before.sigma).contains(&far), "{far}");
    fusion.reset();
    assert!((fusion.update(&at, &both(10.0)).sigma - before.sigma).abs() < 1e-9);
}

#[test]
fn after_a_tare_agreement_lowers_the_sigma_not_the_torque_and_a_disagreement_raises_it() {
    let at = JointSample::default();
    let both = |tau: f64, apart: f64| {
        let torsion = estimate(tau, 0.1);
        [torsion, torsion, estimate(tau + apart, 0.3)]
    };
    let [mut tared, mut never, mut turned] = [true, true, false].map(of_two_groups);
    // At a torque that is known so badly that only agreement shows anything.
    tared.tare(1.0);
    turned.tare(1.0);
    let first = tared.update(&at, &both(0.0, 0.02));
    assert!((first.sigma - never.update(&at, &both(0.0, 0.02)).sigma).abs() < 1e-9);
    // At one torque nothing is shown; over many the current (of the larger variance) shows to be ten times better.
    // sqrt((0.892 * 0.01 and 0.1 * 0.09 combined) / (0.01 and 0.09 combined)) = 0.706.
    for (levels, least, most) in [(1, 0.999, 1.001), (60, 0.69, 0.72)] {
        let mut last = [0.0; 2];
        for i in 0..1000 * levels {
            let tau = if i / 1000 % 2 == 0 { 0.0 } else { 10.0 };
            let all = [&mut tared, &mut never, &mut turned];
            let [a, b, c] = all.map(|f| f.update(&at, &both(tau, 0.02)));
            assert!((a.tau - b.tau).abs() < 1e-9);
            // An unloaded turn has shown the zero: agreement after a tare lowers nothing.
            assert!(c.sigma > 0.999 * b.sigma, "{} {}", c.sigma, b.sigma);
            last = [a.sigma, b.sigma];
        }
        let ratio = last[0] / last[1];
        assert!((least..most).contains(&ratio), "{levels}: {ratio}");
    }
    let fused = tared.update(&at, &both(0.0, 8.0));
    assert!(
        (fused.tau - 0.0).abs() < 2.0 * fused.sigma,
        "{}",
        fused.sigma
    );
}
