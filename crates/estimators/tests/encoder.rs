//! Encoders: unwrapping, jumps, gaps and skew.

use estimators::encoder::{EncoderParameters, JointEncoders};
use estimators::front_end::FrontEnd;
use proptest::prelude::*;
use robot_state::measured_flags::{JUMP, MISSED, NEVER};
use std::f64::consts::TAU;

const N: f64 = 100.0;

fn parameters() -> EncoderParameters {
    EncoderParameters {
        gear_ratio: N,
        sample_period: 1e-3,
        max_velocity: 6.0,
        max_velocity_change: 0.0,
        motor_wrap: TAU,
        link_wrap: TAU,
        skew: 0.0,
    }
}

fn wrapped(angle: f64) -> f64 {
    angle.rem_euclid(TAU)
}

proptest! {
    /// Whatever the start and the motion within the velocity limit, and whatever is missed,
    /// both angles are followed exactly, and the torsion never contains a whole turn.
    #[test]
    fn many_turns_are_followed(
        start in -3.0..3.0f64,
        torsion in -0.02..0.02f64,
        velocities in proptest::collection::vec(-5.9..5.9f64, 20),
        missed in proptest::collection::vec(0u8..6, 2000),
    ) {
        let mut encoders = JointEncoders::new(parameters());
        let mut q = start;
        for i in 0..2000 {
            q += 1e-3 * velocities[i / 100];
            let theta = N * (q + torsion);
            let motor = if missed[i] == 1 { f64::NAN } else { wrapped(theta) };
            let link = if missed[i] == 2 { f64::NAN } else { wrapped(q) };
            let angles = encoders.update(motor, link);
            if angles.flags == 0 {
                // The link's first turn is the one nearest to zero.
                let turns = ((angles.q - q) / TAU).round();
                prop_assert!((angles.q - q - turns * TAU).abs() < 1e-9);
                prop_assert!((angles.theta - theta - N * turns * TAU).abs() < 1e-8);
                prop_assert!((angles.torsion - torsion).abs() < 1e-9);
            } else {
                prop_assert!(angles.flags == MISSED || angles.flags & NEVER != 0);
            }
        }
    }
}

#[test]
fn slow_sampling_follows_turns_longer_than_half_a_wrap() {
    // 6 rad/s times 100 at 250 Hz: 2.4 rad a period; at 50 Hz 12 rad, nearly two turns.
    let mut encoders = JointEncoders::new(EncoderParameters {
        sample_period: 0.02,
        ..parameters()
    });
    for i in 0..500 {
        let q = -1.0 + 0.11 * f64::from(i);
        let angles = encoders.update(wrapped(N * q), wrapped(q));
        assert_eq!(angles.flags, 0);
        assert!(angles.torsion.abs() < 1e-9, "{i}: {}", angles.torsion);
    }
}

#[test]
fn a_jump_is_flagged_and_not_used() {
    let mut encoders = JointEncoders::new(parameters());
    for i in 0..100 {
        let q = 1e-3 * f64::from(i);
        let glitch = if i == 50 { 0.2 } else { 0.0 };
        let angles = encoders.update(wrapped(N * q), q + glitch);
        let expected = if i == 50 { JUMP } else { 0 };
        assert_eq!(angles.flags, expected, "{i}");
        assert!((angles.q - q).abs() < 1.1e-3 && angles.torsion.abs() < 1e-9);
    }
}

#[test]
fn a_motor_jump_leaves_the_turn_alone() {
    let mut encoders = JointEncoders::new(parameters());
    for i in 0..100 {
        let q = 1e-3 * f64::from(i);
        let glitch = if (40..44).contains(&i) { 2.5 } else { 0.0 };
        let angles = encoders.update(wrapped(N * q + glitch), q);
        if angles.flags == 0 {
            assert!((angles.theta - N * q).abs() < 1e-9);
        } else {
            assert_eq!(angles.flags, JUMP);
            assert!((40..44).contains(&i));
        }
        assert!(angles.torsion.abs() < 1e-9);
    }
}

#[test]
fn a_reading_that_stays_away_is_accepted_once_the_joint_could_be_there() {
    let mut encoders = JointEncoders::new(parameters());
    encoders.update(0.0, 0.0);
    let mut accepted = None;
    for i in 1..400 {
        let angles = encoders.update(wrapped(N * 1.2), 1.2);
        if angles.flags == 0 {
            accepted.get_or_insert(i);
            assert!((angles.q - 1.2).abs() < 1e-12 && angles.torsion.abs() < 1e-9);
        }
    }
    assert_eq!(accepted, Some(200), "1.2 rad at 6 rad/s take 200 ms");
}

#[test]
fn readings_that_jump_to_one_place_are_told_from_those_that_jump_about() {
    let mut encoders = JointEncoders::new(parameters());
    let readings = [0.0, 0.3, 0.0, 0.3, 0.303, -0.4, f64::NAN, -0.4, -0.401, 0.0];
    let stays = readings.map(|q| {
        encoders.update(0.0, q);
        encoders.stays_elsewhere()
    });
    let expected = [4, 8];
    for (i, stays) in stays.into_iter().enumerate() {
        assert_eq!(stays, expected.contains(&i), "{i}");
    }
}

#[test]
fn motion_during_a_gap_is_caught_up() {
    let mut encoders = JointEncoders::new(parameters());
    encoders.update(0.0, 0.0);
    for _ in 0..200 {
        assert_eq!(encoders.update(f64::NAN, f64::NAN).flags, MISSED);
    }
    // 0.7 rad further is eleven turns of the motor.
    let angles = encoders.update(wrapped(70.0), 0.7);
    assert_eq!(angles.flags, 0);
    assert!((angles.theta - 70.0).abs() < 1e-9 && angles.torsion.abs() < 1e-9);
}

#[test]
fn motor_without_a_turn_waits_for_the_link() {
    let mut encoders = JointEncoders::new(parameters());
    assert_ne!(encoders.update(1.0, f64::NAN).flags & NEVER, 0);
    let angles = encoders.update(wrapped(250.0), 2.5);
    assert_eq!(angles.flags, 0);
    assert!((angles.theta - 250.0).abs() < 1e-9);
}

#[test]
fn encoders_that_do_not_wrap_are_taken_as_they_are() {
    let unbounded = EncoderParameters {
        motor_wrap: f64::INFINITY,
        link_wrap: f64::INFINITY,
        ..parameters()
    };
    let angles = JointEncoders::new(unbounded).update(1e4, 99.0);
    assert_eq!((angles.theta, angles.q, angles.flags), (1e4, 99.0, 0));
}

#[test]
fn skew_is_removed_from_the_torsion() {
    for skew in [-2.3e-3, -1e-3, 0.4e-3, 2e-3, 15e-3] {
        let mut encoders = JointEncoders::new(EncoderParameters {
            skew,
            ..parameters()
        });
        let path = |t: f64| 0.5 + 1.5 * t;
        for i in 0..100 {
            let t = 1e-3 * f64::from(i);
            let angles = encoders.update(wrapped(N * path(t + skew)), path(t));
            if i > 20 {
                assert!(
                    angles.torsion.abs() < 1e-10,
                    "skew {skew}: {}",
                    angles.torsion
                );
                let late = (path(t) - angles.aligned_q) / 1.5;
                assert!((late - (-skew).max(0.0)).abs() < 1e-9);
            }
        }
    }
}

/// Flags of the samples while both encoders go along `path` (rad), sample by sample.
fn flags_along(path: impl Fn(f64) -> f64) -> Vec<u32> {
    let mut encoders = JointEncoders::new(EncoderParameters {
        max_velocity_change: 1.0,
        ..parameters()
    });
    let sample = |k: u32| {
        let q = path(f64::from(k));
        encoders.update(wrapped(N * q), wrapped(q)).flags
    };
    (0..60).map(sample).skip(1).collect()
}

#[test]
fn a_joint_that_is_turned_faster_than_its_drive_can_is_followed() {
    // 12 rad/s, twice what the drive can, at most 0.9 rad/s more within a sample.
    let hit = |k: f64| {
        let x = (k - 20.0).clamp(0.0, 14.0);
        let after = (k - 34.0).max(0.0);
        1e-3 * (0.45 * x * x + 12.0 * after)
    };
    assert!(flags_along(hit).iter().all(|&flags| flags == 0));
}

#[test]
fn encoders_that_slip_as_one_jump_at_rest_and_in_motion() {
    for velocity in [0.0, 3.0, 5.9, -5.9] {
        for slip in [0.013, 0.05, -0.013] {
            let path = |k: f64| 1e-3 * velocity * k + if k >= 30.0 { slip } else { 0.0 };
            let flags = flags_along(path);
            assert_eq!(flags[28], 0, "{velocity} rad/s, {slip} rad");
            assert_eq!(flags[29], JUMP, "{velocity} rad/s, {slip} rad");
            // A deviation from its course is no motion, until the joint could have got there.
            for (k, &flags) in (1..).zip(&flags[29..]) {
                let way = velocity * k as f64 + 1e3 * slip;
                if way.abs() > 6.0 * k as f64 {
                    assert_eq!(flags, JUMP, "{velocity} rad/s, {slip} rad, {k}")
                } else {
                    break;
                }
            }
        }
    }
}

#[test]
fn reset_forgets_the_turn() {
    let mut encoders = JointEncoders::new(parameters());
    encoders.update(0.0, 0.0);
    encoders.reset();
    assert!((encoders.update(wrapped(150.0), 1.5).theta - 150.0).abs() < 1e-9);
}

#[test]
fn a_gap_in_a_log_is_missed_samples() {
    let parameters = EncoderParameters {
        motor_wrap: f64::INFINITY,
        ..parameters()
    };
    // Long enough to go on over four samples.
    let window = Some(32);
    let mut bridged = FrontEnd::new(parameters, window).unwrap();
    let mut explicit = FrontEnd::new(parameters, window).unwrap();
    let n = parameters.gear_ratio;
    let mut last = None;
    for k in (0..100).filter(|k| !(50..54).contains(k)) {
        let (t, q) = (f64::from(k) * parameters.sample_period, 1e-3 * f64::from(k));
        if k == 54 {
            for _ in 0..4 {
                explicit.update(f64::NAN, f64::NAN, f64::NAN);
            }
        }
        bridged.bridge(last.replace(t), t);
        let sample = bridged.update(n * q, q, 0.1);
        assert_eq!(sample, explicit.update(n * q, q, 0.1));
        assert!(
            k < 32 || (sample.dq - 1.0).abs() < 1e-9,
            "{k}: {}",
            sample.dq
        );
    }
}
