//! Whatever is asked and wherever the joint is: what leaves is finite and within the limits.

use control::{CurrentDrive, DriveModel, PositionDrive};
use proptest::prelude::*;
use robot_state::command_flags;
use supervisor::{Braking, Limiter, Limits, Motion};

const PERIOD: f64 = 1e-3;
const LIMITS: Limits = Limits {
    position_min: -1.0,
    position_max: 1.5,
    velocity: 4.0,
    deceleration: 20.0,
    torque: 100.0,
    torque_rate: f64::INFINITY,
    power: f64::INFINITY,
    lead: 0.05,
    rest: 0.02,
    gives_way: 0.0087,
    braking: Braking::BY_DRIVE,
};
/// D Table 1, hip pitch, on a gear of 27 kN·m/rad.
const POSITION_DRIVE: PositionDrive = PositionDrive {
    k_tau: 1.2e-4,
    k_tau_motor: 1.2e-4 - 1.0 / 27e3,
    k_v: 7e-3,
    k_c: 0.0,
    sign_smoothing: 0.02,
    dead_zone: 0.0,
    integral: 0.0,
};
const POSITION: DriveModel = DriveModel::Position(POSITION_DRIVE);
const CURRENT: DriveModel = DriveModel::Current(CurrentDrive {
    k_1: 10.0,
    k_2: 0.0,
    k_3: 0.0,
    sign_smoothing: 0.02,
    current_limit: 12.0,
});
/// A rotor of 0.2 kg·m² on the link side, braked within 8 ms, and a load up to `inertia`.
const fn braked(inertia: f64) -> Limits {
    let damping = 0.2 / 8e-3;
    Limits {
        braking: Braking {
            damping,
            time: 4.0 * inertia / damping,
            return_time: 0.032,
        },
        ..LIMITS
    }
}

/// Limits of joints whose drives take currents.
const BRAKED: Limits = braked(0.2);

fn still(q: f64) -> Motion {
    Motion {
        q,
        theta: q,
        dq: 0.0,
        weight: 0.0,
    }
}

fn any_command() -> impl Strategy<Value = f64> {
    prop_oneof![-2.0..2.0f64, -1e300..1e300f64, prop::num::f64::ANY]
}

proptest! {
    #[test]
    fn a_set_point_stays_finite_inside_and_slow(
        start in -1.0..1.5f64,
        asked in prop::collection::vec(any_command(), 1..200),
    ) {
        let mut limiter = Limiter::new(LIMITS, POSITION, PERIOD);
        limiter.start(&still(start), 0.0);
        let mut last = start;
        for asked in asked {
            let limited = limiter.limit(asked, &still(start));
            prop_assert!(limited.applied.is_finite());
            prop_assert!((LIMITS.position_min..=LIMITS.position_max).contains(&limited.applied));
            prop_assert!((limited.applied - last).abs() <= LIMITS.velocity * PERIOD * (1.0 + 1e-9));
            // The joint stands still: the lead is the torque.
            prop_assert!((limited.applied - start).abs() <= 1.2e-4 * LIMITS.torque * (1.0 + 1e-9));
            prop_assert_eq!(limited.flags == 0, limited.applied == asked);
            last = limited.applied;
        }
    }

    #[test]
    fn whatever_the_encoders_read_a_held_set_point_gives_way_little_and_slowly(
        start in -0.9..1.4f64,
        readings in prop::collection::vec((-10.0..10.0f64, -10.0..10.0f64, -4.0..4.0f64, any::<bool>()), 1..200),
    ) {
        let mut limiter = Limiter::new(LIMITS, POSITION, PERIOD);
        let hold = limiter.start(&still(start), 0.0);
        let mut last = hold;
        for (q, theta, dq, usable) in readings {
            let motion = Motion { q, theta, dq, weight: 0.0 };
            let applied = limiter.hold(hold, &motion, usable).applied;
            prop_assert!((applied - hold).abs() <= 0.5001_f64.to_radians());
            prop_assert!((applied - last).abs() <= 0.0301 * LIMITS.velocity * PERIOD);
            prop_assert!(usable || applied == last, "samples that cannot be used");
            last = applied;
        }
        for _ in 0..200 {
            last = limiter.hold(hold, &still(start), true).applied;
        }
        prop_assert!((last - hold).abs() < 1e-9, "and comes back");
    }

    #[test]
    fn one_encoder_alone_does_not_move_a_held_set_point(
        start in -0.9..1.4f64,
        wrong in -10.0..10.0f64,
        link in any::<bool>(),
    ) {
        let mut limiter = Limiter::new(LIMITS, POSITION, PERIOD);
        let hold = limiter.start(&still(start), 0.0);
        let motion = if link {
            Motion { q: start + wrong, ..still(start) }
        } else {
            Motion { theta: start + wrong, ..still(start) }
        };
        for _ in 0..100 {
            prop_assert_eq!(limiter.limit(hold, &motion).applied, hold);
        }
    }

    #[test]
    fn a_current_stays_finite_and_brakes_what_is_too_fast(
        asked in prop::collection::vec(any_command(), 1..200),
        q in -3.0..3.0f64,
        dq in -10.0..10.0f64,
    ) {
        let mut limiter = Limiter::new(BRAKED, CURRENT, PERIOD);
        limiter.start(&still(0.0), 0.0);
        for asked in asked {
            let limited = limiter.limit(asked, &Motion { q, theta: q, dq, weight: 0.0 });
            prop_assert!(limited.applied.abs() <= LIMITS.torque / 10.0);
            if dq.abs() > LIMITS.velocity {
                prop_assert!(limited.applied * dq <= 0.0, "{} A at {dq} rad/s", limited.applied);
            }
            if (q > LIMITS.position_max && dq >= 0.0) || (q < LIMITS.position_min && dq <= 0.0) {
                prop_assert!(limited.applied * q <= 0.0, "outwards: {} A at {q} rad", limited.applied);
            }
        }
    }
}

/// A set-point driven at a wall at full speed never needs more than the deceleration.
#[test]
fn a_set_point_brakes_before_the_wall() {
    let mut limiter = Limiter::new(LIMITS, POSITION, PERIOD);
    limiter.start(&still(0.0), 0.0);
    let (mut last, mut speed) = (0.0, 0.0);
    let mut flags = 0;
    for _ in 0..2000 {
        // The joint follows its set-point at once.
        let limited = limiter.limit(
            9.0,
            &Motion {
                q: last,
                theta: last,
                dq: speed,
                weight: 0.0,
            },
        );
        let new_speed = (limited.applied - last) / PERIOD;
        assert!(
            speed - new_speed <= 1.1 * LIMITS.deceleration * PERIOD + 0.05,
            "{speed} to {new_speed}"
        );
        (last, speed) = (limited.applied, new_speed);
        flags |= limited.flags;
    }
    assert!((last - LIMITS.position_max).abs() < 1e-3, "{last}");
    assert!(
        flags & command_flags::POSITION_LIMITED != 0
            && flags & command_flags::VELOCITY_LIMITED != 0
    );
}

/// A free joint with a constant torque, as a client may ask for: it stays inside.
#[test]
fn a_current_drive_under_constant_torque_stays_inside_and_slow() {
    for inertia in [0.2f64, 0.5, 5.0] {
        let limits = Limits {
            deceleration: 0.5 * LIMITS.torque / inertia.max(1.0),
            ..braked(inertia)
        };
        let mut limiter = Limiter::new(limits, CURRENT, PERIOD);
        limiter.start(&still(0.0), 0.0);
        let (mut q, mut dq, mut in_flight) = (0.0, 0.0, 0.0);
        let mut fastest: f64 = 0.0;
        for _ in 0..5000 {
            let applied = limiter
                .limit(
                    3.0,
                    &Motion {
                        q,
                        theta: q,
                        dq,
                        weight: 0.0,
                    },
                )
                .applied;
            // One cycle of transport delay.
            dq += 10.0 * in_flight / inertia * PERIOD;
            q += dq * PERIOD;
            in_flight = applied;
            fastest = fastest.max(dq.abs());
        }
        assert!(
            q < LIMITS.position_max + 0.02,
            "{q} rad with {inertia} kg·m²"
        );
        assert!(
            fastest < 1.2 * LIMITS.velocity,
            "{fastest} rad/s with {inertia} kg·m²"
        );
        assert!(dq.abs() < 0.05, "{dq} rad/s with {inertia} kg·m²");
    }
}

/// Pushed further than its torque limit, a held joint yields; the torque stays at the limit.
#[test]
fn a_current_leads_a_joint_back_that_is_a_little_outside_and_no_other() {
    let current = |outside: f64, stops: bool| {
        let mut limiter = Limiter::new(BRAKED, CURRENT, PERIOD);
        let motion = still(BRAKED.position_min - outside);
        limiter.start(&motion, 0.0);
        let limited = if stops {
            limiter.stop(0.0, &motion)
        } else {
            limiter.limit(0.0, &motion)
        };
        limited.applied
    };
    // Damping times 5 % of the velocity limit at most, by a torque per current of 10.
    let most = BRAKED.braking.damping * 0.05 * BRAKED.velocity / 10.0;
    let (little, more) = (current(0.001, false), current(0.01, false));
    assert!(
        0.0 < little && little < more && more <= most,
        "{little} {more} {most}"
    );
    assert_eq!(current(1.0, false), 0.0, "an encoder that lies by a radian");
    assert_eq!(current(0.001, true), 0.0, "in a fault");
}

#[test]
fn a_held_joint_yields_at_its_torque_limit() {
    let mut limiter = Limiter::new(LIMITS, POSITION, PERIOD);
    let hold = limiter.start(&still(0.0), 0.0);
    let mut pushed = 0.0;
    for _ in 0..200 {
        pushed -= 0.0005;
        let gear = LIMITS.torque / 27e3; // wound up against the push
        let motion = Motion {
            q: pushed,
            theta: pushed + gear,
            dq: -0.0,
            weight: 0.0,
        };
        let applied = limiter.limit(hold, &motion).applied;
        let torque = (applied - motion.q) / 1.2e-4;
        assert!(torque <= LIMITS.torque * (1.0 + 1e-6), "{torque} N·m");
    }
}

#[test]
fn torque_rate_and_power_are_limited_where_they_are_set() {
    let limits = Limits {
        torque_rate: 1000.0,
        power: 40.0,
        ..LIMITS
    };
    let mut limiter = Limiter::new(limits, CURRENT, PERIOD);
    limiter.start(&still(0.0), 0.0);
    let first = limiter.limit(5.0, &still(0.0));
    assert!(
        (first.applied - 0.1).abs() < 1e-12 && first.flags == command_flags::TORQUE_RATE_LIMITED
    );
    for _ in 0..100 {
        limiter.limit(5.0, &still(0.0));
    }
    let fast = limiter.limit(
        5.0,
        &Motion {
            dq: 2.0,
            ..still(0.0)
        },
    );
    assert!((fast.applied - 2.0).abs() < 1e-9, "{fast:?}");
    assert!(fast.flags & command_flags::POWER_LIMITED != 0);
}

#[test]
fn a_torque_rate_that_trims_noise_is_marked_until_it_lasts_or_takes_much() {
    let limits = Limits {
        torque_rate: 1000.0,
        ..LIMITS
    };
    let (rate, trimmed) = (
        command_flags::TORQUE_RATE_LIMITED,
        command_flags::TORQUE_RATE_LIMITED | command_flags::RATE_TRIMMED,
    );
    for (actuation, per_torque) in [(CURRENT, 0.1), (POSITION, 1.2e-4 - 1.0 / 27e3)] {
        // The rest of a torque that is asked for, N·m, at 1 N·m a cycle.
        let flags = |torques: &[f64]| -> Vec<u32> {
            let mut limiter = Limiter::new(limits, actuation, PERIOD);
            limiter.start(&still(0.0), 0.0);
            let asked = torques.iter().map(|torque| torque * per_torque);
            asked
                .map(|asked| limiter.limit(asked, &still(0.0)).flags)
                .collect()
        };
        // 5 N·m are 5 % of the limit.
        assert_eq!(flags(&[0.9, 2.5, 1.5]), [0, trimmed, 0]);
        assert_eq!(flags(&[4.0, 0.0, 7.0]), [trimmed, 0, rate]);
        let lasting = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let expected = [trimmed, trimmed, trimmed, trimmed, rate, rate];
        assert_eq!(flags(&lasting), expected, "{actuation:?}");
        // Noise, however long: quick torques to and fro.
        let noise: Vec<f64> = (0..40).map(|k| [3.0, -3.0][k % 2]).collect();
        let noted = flags(&noise).iter().filter(|&&flags| flags == rate).count();
        assert_eq!(noted, 0, "{actuation:?}");
        // A swing that lasts to each side.
        let swing: Vec<f64> = (0..40)
            .map(|k| [5.0, 5.0, 6.0, 7.0, 8.0, 9.0][k % 6])
            .collect();
        let swing: Vec<f64> = (swing.iter().enumerate())
            .map(|(k, torque)| if (k / 6) % 2 == 0 { *torque } else { -torque })
            .collect();
        assert!(flags(&swing).contains(&rate), "{actuation:?}");
    }
}

#[test]
fn a_torque_rate_by_a_wrong_motor_velocity_leads_no_further_than_the_torque_limit() {
    let limits = Limits {
        torque_rate: 1e4,
        ..LIMITS
    };
    for motor_velocity in [-1e3, -3.0, 3.0, 1e3] {
        let mut limiter = Limiter::new(limits, POSITION, PERIOD);
        limiter.start(&still(0.2), 0.0);
        limiter.judge_by(Some(motor_velocity));
        let sent = limiter.limit(0.2, &still(0.2));
        assert!(sent.flags & command_flags::TORQUE_RATE_LIMITED != 0);
        let lead = POSITION_DRIVE.k_tau * limits.torque;
        assert!((sent.applied - 0.2).abs() <= lead + 1e-12, "{sent:?}");
    }
}
