use super::*;

const PARAMETERS: PlausibilityParameters = PlausibilityParameters {
    torsion: 0.003,
    step: 0.0005,
    beside: 0.0005,
    motor_step: 0.0008,
    jump: f64::INFINITY,
    samples_to_trust: 5,
    samples_to_doubt: 3,
    friction: 10.0,
    torque_margin: 4.0,
    stop_way: 0.02,
    holds_itself: false,
    torsion_shows: f64::INFINITY,
    still: [0.0; 2],
    hidden: 0.0,
    motor_shows: f64::INFINITY,
    asked: 0.0,
};

/// A sample whose motor stands.
fn wound(torsion: f64) -> Sample {
    Sample::Angles {
        torsion,
        motor: 0.7,
    }
}

fn after(samples: &[Sample]) -> Trust {
    let mut joint = Plausibility::new(PARAMETERS);
    samples
        .iter()
        .fold(Trust::Settling, |_, &sample| joint.update(sample))
}

/// A joint that has been trusted with a torsion that rises steadily.
fn trusted() -> (Plausibility, impl FnMut() -> f64) {
    let mut torsion = 0.0;
    let mut next = move || {
        torsion += 1e-5;
        torsion
    };
    let mut joint = Plausibility::new(PARAMETERS);
    for _ in 0..20 {
        joint.update(wound(next()));
    }
    assert_eq!(joint.trust(), Trust::Plausible);
    (joint, next)
}

#[test]
fn a_step_that_stays_is_an_encoders_and_an_impact_is_not() {
    let (mut slipped, mut next) = trusted();
    assert_eq!(slipped.update(wound(next() + 0.001)), Trust::Suspect);
    assert_eq!(slipped.update(wound(next() + 0.001)), Trust::Implausible);

    let (mut jumped, mut next) = trusted();
    assert_eq!(jumped.update(Sample::Jump { again: false }), Trust::Suspect);
    next();
    assert_eq!(jumped.update(wound(next() + 0.001)), Trust::Implausible);

    let (mut hit, mut next) = trusted();
    let mut pushed = 0.0;
    let course: Vec<Trust> = (0..4)
        .map(|_| {
            pushed += 0.0006;
            hit.update(wound(next() + pushed))
        })
        .collect();
    assert!(!course.contains(&Trust::Implausible), "{course:?}");

    let (mut glitch, mut next) = trusted();
    assert_eq!(glitch.update(wound(next() + 0.001)), Trust::Suspect);
    assert_eq!(glitch.update(wound(next())), Trust::Plausible);
}

/// A position drive whose encoder slips moves its joint until it is known: there is no waiting for as many samples as
/// corrupt frames would be.
#[test]
fn an_encoder_that_jumps_to_one_place_twice_has_slipped() {
    let (mut joint, _) = trusted();
    assert_eq!(joint.update(Sample::Jump { again: false }), Trust::Suspect);
    assert_eq!(joint.update(Sample::Jump { again: false }), Trust::Suspect);
    assert_eq!(
        joint.update(Sample::Jump { again: true }),
        Trust::Implausible
    );
    assert!(joint.has_slipped());
}

#[test]
fn encoders_that_step_as_one_have_jumped_and_a_rotor_that_is_hit_has_not() {
    let after = |motor: &dyn Fn(f64) -> f64| {
        let mut joint = Plausibility::new(PARAMETERS);
        let course: Vec<Trust> = (0..60)
            .map(|k| {
                joint.update(Sample::Angles {
                    torsion: 0.001,
                    motor: motor(f64::from(k)),
                })
            })
            .collect();
        course[20..].iter().position(|t| *t == Trust::Implausible)
    };
    let step = |k: f64| if k >= 30.0 { 0.003 } else { 0.0 };
    // A sample that is bridged, and the one that confirms it; at rest and in motion.
    assert_eq!(after(&step), Some(11));
    assert_eq!(after(&|k| 0.004 * k + step(k)), Some(11));
    // A torque of four times what makes 0.0002 rad a sample, and a brake that stops it again.
    let hit = |k: f64| 0.0004 * (k - 30.0).clamp(0.0, 8.0).powi(2);
    assert_eq!(after(&hit), None);
    // Instants of sampling that differ by a fifth of a period, and one sample that is wrong.
    assert_eq!(after(&|k| 0.004 * (k + 0.1 * (7.0 * k).sin())), None);
    assert_eq!(after(&|k| if k == 30.0 { 0.003 } else { 0.0 }), None);
}

#[test]
fn trust_needs_good_samples_in_a_row_and_doubt_bad_ones() {
    let (good, bad) = (wound(0.001), wound(-0.004));
    assert_eq!(after(&[good; 4]), Trust::Settling);
    assert_eq!(after(&[good; 5]), Trust::Plausible);
    assert_eq!(after(&[bad, good, good, good, good]), Trust::Settling);
    let mut samples = vec![good; 5];
    samples.extend([bad, Sample::Jump { again: false }]);
    assert_eq!(after(&samples), Trust::Suspect);
    samples.push(good);
    assert_eq!(after(&samples), Trust::Plausible);
    samples.extend([bad; 3]);
    assert_eq!(after(&samples), Trust::Implausible);
    samples.extend([good; 20]);
    assert_eq!(after(&samples), Trust::Implausible, "until it is restarted");
    // Before it was trusted, nothing depended on it.
    let mut samples = vec![bad; 5];
    assert_eq!(after(&samples), Trust::Implausible);
    samples.extend([good; 5]);
    assert_eq!(after(&samples), Trust::Plausible);
}

#[test]
fn a_motor_that_more_torque_than_friction_does_not_move_has_flat_encoders() {
    let after = |velocity: f64, torque: fn(f64) -> f64, theta: fn(f64) -> f64| {
        let mut joint = trusted().0;
        (0..20).position(|k| {
            joint.watch_motor(MotorSample {
                theta: theta(f64::from(k)),
                q: 0.5,
                velocity,
                torque: torque(f64::from(k)),
                target: 0.0,
                driven: true,
                warned: false,
            });
            joint.trust() == Trust::Implausible
        })
    };
    let flat = |_| 1.0;
    // 2.5 and half of 10 N·m, and 4 N·m; three samples, of which one counts twice with twice the torque.
    assert_eq!(after(0.0, |k| 10.0 * k, flat), Some(5));
    assert_eq!(after(0.2, |k| 10.0 * k, flat), Some(2));
    assert_eq!(after(0.2, |k| -10.0 * k, flat), Some(5));
    assert_eq!(after(0.0, |k| 10.0 * k.min(2.0), flat), None);
    assert_eq!(after(0.0, |k| 10.0 * k, |k| 1.0 + 1e-4 * k), None);
    // A motor that moves by 0.03 rad a sample does not stand from one to the next.
    let rest = |_| 0.0;
    assert_eq!(after(0.2, rest, |k| 0.03 * k.min(6.0)), Some(9));
    assert_eq!(after(0.2, rest, |k| 0.01 * k.min(6.0)), None);
}

/// A position drive holds its motor, but between two encoders the gear shows its torque: from 29 N·m, and the 20 N·m
/// that their noise hides.
#[test]
fn a_position_drive_whose_torque_winds_nothing_up_has_flat_encoders() {
    let found = |torsion_shows: f64, driven_from: usize, torque: f64, warned: bool| {
        let mut joint = Plausibility::new(PlausibilityParameters {
            holds_itself: true,
            torsion_shows,
            ..PARAMETERS
        });
        for _ in 0..20 {
            joint.update(wound(0.0));
        }
        (0..50).position(|k| {
            joint.watch_motor(MotorSample {
                theta: 1.0,
                q: 0.5,
                velocity: 0.0,
                torque: if k < 10 { 0.0 } else { torque },
                target: 0.0,
                driven: k >= driven_from,
                warned,
            });
            joint.trust() == Trust::Implausible
        })
    };
    let after = |shows: f64, from: usize, torque: f64| found(shows, from, torque, false);
    assert_eq!(after(20.0, 0, 50.0), Some(12));
    assert_eq!(after(20.0, 0, -200.0), Some(10));
    assert_eq!(after(20.0, 0, 48.0), None);
    assert_eq!(after(20.0, 100, 50.0), None, "a brake takes it over");
    assert_eq!(after(20.0, 8, 50.0), None, "a brake hands it over");
    assert_eq!(after(20.0, 2, 50.0), Some(12), "a brake has opened");
    assert_eq!(after(f64::INFINITY, 0, 50.0), None, "one encoder");
    // Once another joint's encoders are found to stand still, a friction of 10 N·m and the noise are enough.
    assert_eq!(found(20.0, 0, 31.0, true), Some(12));
    assert_eq!(found(20.0, 0, 29.0, true), None);
}

/// While the loop paused, the drive has stopped the motor at its last set-point; the velocity is still that of
/// before.
#[test]
fn a_motor_that_came_to_stand_in_a_pause_is_judged_once_that_is_over() {
    let mut joint = trusted().0;
    joint.note_gap();
    let found = (0..100).position(|k| {
        joint.watch_motor(MotorSample {
            theta: 1.0,
            q: 0.5,
            velocity: 0.2,
            torque: 10.0 * f64::from(k),
            target: 0.0,
            driven: true,
            warned: false,
        });
        joint.trust() == Trust::Implausible
    });
    let after = GAP_SAMPLES as usize;
    assert!(
        found.is_some_and(|k| (after..after + 8).contains(&k)),
        "{found:?}"
    );
}

/// Right after a pause a position drive is judged by what winds its gear up. It may have come to rest meanwhile, so that
/// friction takes 30 N·m, not 25: beyond 54 N·m it is found, without a pause beyond 49.
#[test]
fn encoders_that_freeze_right_after_a_pause_are_found_at_once() {
    let found = |paused: bool, torque: f64| {
        let mut joint = Plausibility::new(PlausibilityParameters {
            holds_itself: true,
            torsion_shows: 20.0,
            ..PARAMETERS
        });
        for _ in 0..20 {
            joint.update(wound(0.0));
        }
        if paused {
            joint.note_gap();
        }
        (0..20).position(|k| {
            joint.watch_motor(MotorSample {
                theta: 1.0,
                q: 0.5,
                velocity: if paused { 0.3 } else { 0.0 },
                torque: if k < 10 { 0.0 } else { torque },
                target: 0.0,
                driven: true,
                warned: false,
            });
            joint.trust() == Trust::Implausible
        })
    };
    assert_eq!(found(true, -60.0), Some(12));
    assert_eq!(found(true, -52.0), None);
    assert_eq!(found(false, -52.0), Some(12));
}

/// An encoder freezes while the joint still moves, so that the last reading of before is 2.4 counts off. Noise must not
/// begin the standstill anew: the torque of a drive that then holds no longer changes.
#[test]
fn noise_does_not_begin_a_standstill_anew_and_a_slow_motion_does() {
    let count = 6e-6;
    let found = |q: &dyn Fn(usize) -> f64| {
        let mut joint = Plausibility::new(PlausibilityParameters {
            holds_itself: true,
            torsion_shows: 20.0,
            still: [3.5 * count; 2],
            samples_to_doubt: 20,
            ..PARAMETERS
        });
        for _ in 0..20 {
            joint.update(wound(0.0));
        }
        (0..300).position(|k| {
            joint.watch_motor(MotorSample {
                theta: 1.0,
                q: count * q(k),
                velocity: 0.0,
                torque: 10.0 * k.min(10) as f64,
                target: 0.0,
                driven: true,
                warned: false,
            });
            joint.trust() == Trust::Implausible
        })
    };
    let frozen = |k: usize| match k {
        0 => -2.4,
        10 | 11 => 1.2,
        _ => [0.5, 0.0, -0.5][k % 3],
    };
    let frozen = found(&frozen);
    assert!(frozen.is_some_and(|k| k < 30), "{frozen:?}");
    assert_eq!(found(&|k| 0.8 * k as f64), None);
}

/// An actuator with one encoder is asked to turn, 0.01 rad a sample. A wall in front of its link lets its motor wind the
/// gear up; a hand changes its torque, and no set-point.
#[test]
fn a_single_encoder_that_shows_nothing_of_what_is_asked_for_is_flat() {
    let count = 4e-4;
    let found = |asked: f64, theta: &dyn Fn(f64) -> f64, warned: bool| {
        let mut joint = Plausibility::new(PlausibilityParameters {
            holds_itself: true,
            still: [3.5 * count; 2],
            hidden: 1.0,
            motor_shows: 6.0,
            asked: 5.0 * 3.5 * count,
            friction: 0.6,
            torque_margin: 1.5,
            ..PARAMETERS
        });
        for _ in 0..20 {
            joint.update(wound(0.0));
        }
        (0..100).position(|k| {
            let time = f64::from(k);
            let theta = (theta(time) / count).round() * count;
            joint.watch_motor(MotorSample {
                theta,
                q: theta,
                velocity: 0.0,
                // By the way left and a spring of 100 N·m/rad.
                torque: 100.0 * (0.01 * time - theta),
                target: asked * time,
                driven: true,
                warned,
            });
            joint.trust() == Trust::Implausible
        })
    };
    let flat = |_: f64| 0.0;
    let alone = found(0.01, &flat, false).expect("it is found");
    let warned = found(0.01, &flat, true).expect("it is found");
    assert!(warned < alone && alone < 30, "{warned} {alone}");
    assert_eq!(found(0.0, &flat, false), None, "a hand");
    assert_eq!(found(-0.01, &flat, false), None, "against what is asked");
    assert_eq!(found(0.01, &|k| 0.008 * k, false), None, "a wall");
}

/// The loop pauses while the torque of a frozen joint rises, at 60 N·m; afterwards its drive holds with 100 N·m. What
/// came since the pause is too little by itself. Torque of before and noise of a few counts are not forgotten once
/// something else speaks against the joint.
#[test]
fn a_standstill_begun_before_a_pause_shows_once_something_else_speaks_against_the_joint() {
    let count = 6e-6;
    let found = |against: &dyn Fn(&mut Plausibility, usize) -> bool, frozen: bool| {
        let mut joint = Plausibility::new(PlausibilityParameters {
            holds_itself: true,
            torsion_shows: 20.0,
            still: [3.5 * count; 2],
            ..PARAMETERS
        });
        for _ in 0..20 {
            joint.update(wound(0.0));
        }
        let moved = |k: usize| if frozen { 0 } else { k };
        (0..300).position(|k| {
            if k == 6 {
                joint.note_gap();
            }
            let warned = against(&mut joint, k);
            let noise = if k % 20 == 0 { 4.5 } else { 0.0 };
            joint.watch_motor(MotorSample {
                theta: 1.0,
                q: count * (noise + moved(k) as f64),
                velocity: 0.0,
                torque: 10.0 * k.min(10) as f64,
                target: 0.0,
                driven: true,
                warned,
            });
            joint.is_blind()
        })
    };
    let another_joint = |_: &mut Plausibility, k: usize| k >= 100;
    let another_witness = |joint: &mut Plausibility, k: usize| {
        if k >= 100 {
            joint.distrust();
        }
        false
    };
    assert_eq!(found(&|_, _| false, true), None);
    assert_eq!(found(&another_joint, true), Some(100));
    assert_eq!(found(&another_witness, true), Some(100));
    assert_eq!(found(&another_joint, false), None);
    assert_eq!(found(&another_witness, false), None);
}

#[test]
fn a_missed_sample_changes_nothing_and_nan_is_bad() {
    let mut joint = Plausibility::new(PARAMETERS);
    for _ in 0..10 {
        assert_eq!(joint.update(Sample::Missed), Trust::Settling);
    }
    for _ in 0..5 {
        joint.update(wound(0.0));
    }
    assert_eq!(joint.update(Sample::Missed), Trust::Plausible);
    assert_eq!(joint.update(wound(f64::NAN)), Trust::Suspect);
}

/// The only encoder of a joint has counts of 16 bits over 25 rad, as actuators do. A torque of 5 N·m sinks to
/// as much on the other side while the joint turns round, or its encoder stops where it would.
#[test]
fn a_joint_that_turns_round_stands_for_a_moment_and_one_that_stops_stands_for_ever() {
    let (period, inertia, count) = (2e-3, 0.35, 25.0 / 65535.0);
    let parameters = PlausibilityParameters {
        friction: 0.6,
        torque_margin: 1.5,
        stop_way: f64::INFINITY,
        motor_step: f64::INFINITY,
        samples_to_doubt: 8,
        holds_itself: true,
        still: [3.5 * count; 2],
        hidden: 3.5 * count * inertia / (period * period),
        ..PARAMETERS
    };
    let found = |stops: bool| {
        let mut joint = Plausibility::new(parameters);
        let acceleration = 5.0 / inertia;
        let (turn, ramp) = (20.0, 0.02);
        (0..60).find(|&k| {
            let t = (f64::from(k) - turn) * period;
            let at = |t: f64| {
                let t = if stops { t.min(0.0) } else { t };
                acceleration * t * t * (0.5 - t / (6.0 * ramp))
            };
            let theta = (at(t) / count).round() * count;
            let t_before = if stops { t.min(0.0) } else { t } - 8.0 * period;
            let velocity = acceleration * t_before * (1.0 - t_before / (2.0 * ramp));
            joint.update(wound(0.0));
            joint.watch_motor(MotorSample {
                theta,
                q: theta,
                velocity,
                torque: inertia * acceleration * (1.0 - t / ramp),
                target: 0.0,
                driven: true,
                warned: false,
            });
            joint.trust() == Trust::Implausible
        })
    };
    assert_eq!(found(false), None);
    let stopped = found(true).expect("it is found");
    assert!((20..60).contains(&stopped), "{stopped}");
}
