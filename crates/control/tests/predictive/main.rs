//! The predictive law on a joint of its own: continuous rotor, gear and drive, simulated at 20 us, which
//! share no code with the law.

mod integrating;
mod joint;

use control::margins::{JointLoop, NEEDED, choose_design};
use control::predictive::{
    Design, DriveLoop, FrictionModel, LawParameters, PredictiveLaw, TorqueTerms,
};
use joint::{BLOCKED, DT, Friction, Joint, feedforward, knee, run};

/// A blocked joint whose law foresees `foreseen`: overshoot, share of a step of 30 N·m, time to 90 %,
/// ms, and error half a second after the step, N·m.
fn step(friction: Friction, foreseen: FrictionModel) -> (f64, usize, f64) {
    let p = LawParameters {
        friction: foreseen,
        ..knee()
    };
    let mut law = PredictiveLaw::new(p);
    let mut joint = Joint::new(p, BLOCKED, 1);
    joint.friction = friction;
    let desired = |k: usize| if k < 100 { 0.0 } else { 30.0 };
    let torque = run(&mut law, &mut joint, desired, 600);
    let highest = torque.iter().copied().fold(0.0, f64::max);
    let rise = torque.iter().position(|t| *t > 27.0).unwrap() - 100;
    (highest / 30.0 - 1.0, rise, (torque[599] - 30.0).abs())
}

/// Friction of a quarter of the step, which turns round in it; the law foresees it rightly, a fifth
/// too much or too little, bristles of half or twice the stiffness, or not at all.
#[test]
fn a_step_settles_with_little_overshoot_and_without_error() {
    for stiffness in [60_000.0, 120_000.0] {
        for (level, limit_ms) in [(8.0, 15), (9.6, 15), (6.4, 18), (0.0, 26)] {
            let friction = Friction::Bristles(stiffness, 8.0);
            let foreseen = FrictionModel {
                level,
                stiffness: 68_400.0,
            };
            let (overshoot, rise, error) = step(friction, foreseen);
            let figures = format!("{stiffness}, {level}: {overshoot}, {rise} ms, {error} N·m");
            assert!(
                overshoot < 0.06 && rise < limit_ms && error < 0.01,
                "{figures}"
            );
        }
    }
}

/// A drive whose stiffness and damping are wrong by a fifth shows it by its current: after a second at
/// 4 Hz a step of 20 N·m is as good as that of the drive that is known.
#[test]
fn a_drive_that_is_not_as_configured_is_found() {
    let overshoot = |shares: [f64; 2], reports: bool| {
        let friction = FrictionModel {
            level: 8.0,
            stiffness: 68_400.0,
        };
        let truth = LawParameters { friction, ..knee() };
        let mut p = truth;
        if let DriveLoop::Position {
            stiffness, damping, ..
        } = &mut p.drive
        {
            (*stiffness, *damping) = (shares[0] * *stiffness, shares[1] * *damping);
        }
        let mut law = PredictiveLaw::new(p);
        let mut joint = Joint::new(truth, BLOCKED, 1);
        joint.friction = Friction::Bristles(60_000.0, 8.0);
        joint.reports = reports;
        let desired = |k: usize| match k {
            0..1500 => 30.0 * (k as f64 / 400.0).min(1.0) + 10.0 * (0.025 * k as f64).sin(),
            1500..2000 => 30.0,
            _ => 50.0,
        };
        let torque = run(&mut law, &mut joint, desired, 2600);
        let highest = torque[2000..].iter().copied().fold(0.0, f64::max);
        let rise = torque[2000..].iter().position(|t| *t > 48.0).unwrap();
        let found = law.drive_correction().map(|a| 1.0 + a);
        ((highest - 50.0) / 20.0, rise, found)
    };
    for shares in [[0.8, 1.0], [1.2, 1.0], [0.8, 1.2], [1.2, 0.8], [1.0, 1.0]] {
        let (over, rise, found) = overshoot(shares, true);
        let figures = format!("{shares:?}: {over:.3}, {rise} ms, {found:?}");
        assert!((found[0] * shares[0] - 1.0).abs() < 0.03, "{figures}");
        assert!(over < 0.06 && rise < 25, "{figures}");
    }
    // Its use: a drive that is weaker than thought leaves a step slow.
    let (_, rise, _) = overshoot([1.2, 1.0], true);
    let (_, unknown, found) = overshoot([1.2, 1.0], false);
    assert!(
        unknown > rise + 3 && found == [1.0; 2],
        "{unknown}, {rise} ms"
    );
}

/// Friction without stiction is, near standstill, a damper of 8000 N·m·s/rad: what the observer has
/// not found yet of it acts like an inertia of some 60 kg·m², and the torque swings once in 0.25 s.
#[test]
fn a_creeping_rotor_swings_little() {
    let foreseen = FrictionModel {
        level: 8.0,
        stiffness: 68_400.0,
    };
    let (overshoot, rise, error) = step(Friction::Creep(8.0), foreseen);
    assert!(overshoot < 0.06 && rise < 15, "{overshoot} {rise}");
    // The aim, 0.5 % of the joint's rated 110 N·m is 0.55.
    assert!(error < 0.2, "{error} N·m");
}

/// How far a joint that was pushed still moves three to six seconds later, rad, held by stiffness and damping.
fn swing(inertia: f64, bristles: f64, foreseen: f64, [k_s, k_d]: [f64; 2]) -> f64 {
    let mut law = PredictiveLaw::new(LawParameters {
        friction: FrictionModel {
            level: foreseen,
            stiffness: 68_400.0,
        },
        ..knee()
    });
    let mut joint = Joint::new(knee(), inertia, 1);
    joint.friction = Friction::Bristles(bristles, 8.0);
    joint.dq = 0.3;
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    for k in 0..6000 {
        law.observe(&joint.sensed());
        let command = law.command(&TorqueTerms {
            position: -k_s * joint.q,
            velocity: -k_d * law.link_velocity(),
            ..TorqueTerms::default()
        });
        law.sent(command.command);
        joint.advance(command.command);
        if k > 3000 {
            (low, high) = (low.min(joint.q), high.max(joint.q));
        }
    }
    high - low
}

/// Whatever the true friction is like: bristles of half to twenty times the stiffness foreseen, of a level that is a
/// fifth more or less. Friction that is foreseen late, with the sign of a measured velocity, would drive it for ever,
/// by 0.06 degrees and 3 N·m.
#[test]
fn a_joint_that_stands_does_not_swing_whatever_its_friction_is_like() {
    for inertia in [0.5, 2.5, 8.0] {
        for bristles in [3e4, 1.2e5, 3e5, 1.2e6] {
            for foreseen in [0.0, 6.4, 8.0, 9.6] {
                for gains in [[2000.0, 60.0], [600.0, 80.0]] {
                    let swing = swing(inertia, bristles, foreseen, gains).to_degrees();
                    assert!(
                        swing < 0.02,
                        "{inertia} kg·m², {bristles} N·m/rad, {foreseen} N·m, {gains:?}: {swing} degrees"
                    );
                }
            }
        }
    }
}

/// A joint that moved at the end of a mode, was held, and begins another mode stands.
#[test]
fn a_mode_does_not_begin_with_the_velocity_of_the_last_one() {
    let mut law = PredictiveLaw::new(knee());
    let mut joint = Joint::new(knee(), 2.5, 1);
    let mut worst: f64 = 0.0;
    for k in 0..2000 {
        law.observe(&joint.sensed());
        let holds = (300..1500).contains(&k);
        if k == 1500 {
            assert!(law.hold_reference().abs() < 0.1);
        }
        let wanted = if k < 300 { 10.0 } else { 0.0 };
        let command = if holds {
            joint.theta
        } else {
            law.command(&feedforward(wanted)).command
        };
        law.sent(command);
        joint.advance(command);
        if k > 1500 {
            worst = worst.max(joint.torque().abs());
        }
    }
    assert!(worst < 0.1, "{worst} N·m");
}

/// The observer expects what the joint does, so nothing is left to be called a disturbance.
#[test]
fn without_friction_there_is_no_disturbance_whatever_is_asked() {
    for delay_cycles in [0, 1, 2] {
        let mut p = LawParameters {
            delay: delay_cycles as f64 * DT + 0.4e-3,
            ..knee()
        };
        p.design = choose_design(&JointLoop::nominal(p, 0.4e-3, 0.4), &NEEDED, f64::INFINITY);
        let mut law = PredictiveLaw::new(p);
        let mut joint = Joint::new(p, 0.4, delay_cycles);
        let mut worst: f64 = 0.0;
        for k in 0..1500 {
            law.observe(&joint.sensed());
            let t = k as f64 * DT;
            let wanted = 20.0 * (30.0 * t).sin() - 300.0 * joint.q - 8.0 * joint.dq;
            let command = law.command(&feedforward(wanted)).command;
            law.sent(command);
            joint.advance(command);
            if k > 100 {
                worst = worst.max(law.disturbance().abs());
            }
        }
        // The gear's torque between two samples is not their mean.
        assert!(worst < 1.0, "{delay_cycles} cycles: {worst} N·m");
    }
}

#[test]
fn the_contributions_add_up_to_the_command() {
    for drive in [
        DriveLoop::Position {
            stiffness: 28_900.0,
            damping: 189.0,
            dead_zone: 1e-4,
            integral: 0.0,
        },
        DriveLoop::Current {
            torque_constant: 12.0,
            viscous: 1.0,
        },
    ] {
        let p = LawParameters { drive, ..knee() };
        let mut law = PredictiveLaw::new(p);
        let mut joint = Joint::new(p, 2.0, 1);
        for k in 0..300 {
            law.observe(&joint.sensed());
            let t = f64::from(k) * DT;
            let parts = law.command(&TorqueTerms {
                feedforward: 40.0 * (20.0 * t).sin(),
                position: -200.0 * joint.q,
                velocity: -3.0 * joint.dq,
                force: if k > 100 { 250.0 } else { 0.0 },
            });
            let sum = parts.origin
                + parts.feedforward_torque
                + parts.feedforward_friction
                + parts.feedback_position
                + parts.feedback_velocity
                + parts.feedback_force
                + parts.feedback_torque;
            assert!((sum - parts.command).abs() < 1e-12 * (1.0 + sum.abs()));
            assert!(parts.desired.abs() <= 233.0 + 1e-9);
            law.sent(parts.command);
            joint.advance(parts.command);
        }
    }
}

/// A drive whose limit passes a third of the torque: the observer knows, and the torque follows at
/// once when the wish is within the limit again.
#[test]
fn a_limit_winds_nothing_up() {
    let step = |limit: f64| {
        let mut law = PredictiveLaw::new(knee());
        let mut joint = Joint::new(knee(), BLOCKED, 1);
        let mut torque = Vec::new();
        for k in 0..1400 {
            law.observe(&joint.sensed());
            let wanted = if k < 1000 { 60.0 } else { 5.0 };
            let asked = law.command(&feedforward(wanted)).command;
            let command = asked.clamp(-limit, limit);
            law.sent(command);
            joint.advance(command);
            torque.push(joint.torque());
        }
        torque
    };
    let (limited, free) = (step(1.0e-3), step(1.0));
    assert!(limited[900] < 25.0 && free[900] > 59.0);
    for (k, torque) in limited.iter().enumerate().skip(1060) {
        assert!((torque - 5.0).abs() < 1.5, "{k}: {torque}");
    }
}

/// At rest with a model that is right it is D's inverse of the drive (D10).
#[test]
fn at_rest_the_command_is_that_of_d() {
    let p = knee();
    let mut law = PredictiveLaw::new(p);
    let mut joint = Joint::new(p, BLOCKED, 1);
    let torque = run(&mut law, &mut joint, |_| 25.0, 2000);
    assert!((torque[1999] - 25.0).abs() < 1e-3);
    law.observe(&joint.sensed());
    let delta_q = law.command(&feedforward(25.0)).command - joint.q;
    let k_tau = 1.0 / 57_000.0 + 1.0 / 28_900.0;
    assert!((delta_q - k_tau * 25.0).abs() < 1e-3 * delta_q, "{delta_q}");
}

/// A mode begins at the torque that is there: the first commands go on from the last one.
#[test]
fn a_mode_begins_without_a_bump() {
    let p = knee();
    let mut law = PredictiveLaw::new(p);
    let mut joint = Joint::new(p, BLOCKED, 1);
    // The drive holds 30 N·m by itself.
    let held = 30.0 * (1.0 / 57_000.0 + 1.0 / 28_900.0);
    joint.command = held;
    joint.on_the_way.fill(held);
    joint.theta = 30.0 / 57_000.0;
    for _ in 0..500 {
        law.observe(&joint.sensed());
        law.sent(held);
        joint.advance(held);
    }
    assert!((law.hold_reference() - 30.0).abs() < 0.1);
    let torque = run(&mut law, &mut joint, |_| 30.0, 300);
    let worst = torque.iter().map(|t| (t - 30.0).abs()).fold(0.0, f64::max);
    assert!(worst < 0.2, "{worst} N·m");
}

/// Samples that are missing, and torques that are: the observers run on.
/// Root mean square of the torque, N·m, of which none is desired, while the knee's link swings by 0.4 rad at 1.4 Hz.
fn swing_error(foreseen: bool, help: f64) -> f64 {
    let mut law = PredictiveLaw::new(helped_by(help));
    let mut joint = Joint::new(knee(), BLOCKED, 1);
    let (w, mut sum, mut angle) = (8.8, 0.0, 0.0);
    for k in 0..3000 {
        let velocity = |k: f64| 0.2 * w * (w * k * DT).sin();
        // Half a period ahead: the mean over the period that follows.
        joint.dq = velocity(f64::from(k) + 0.5);
        law.observe(&joint.sensed());
        if foreseen {
            law.desire_motion([angle, velocity(f64::from(k))], 1.0);
        }
        let command = law.command(&feedforward(0.0)).command;
        law.sent(command);
        joint.advance(command);
        angle += DT * joint.dq;
        if k >= 1000 {
            sum += joint.torque().powi(2);
        }
    }
    (sum / 2000.0).sqrt()
}

/// The drive's damping of 189 N·m·s/rad goes along with a velocity that is desired sooner than with a measured one.
#[test]
fn a_desired_velocity_is_not_braked() {
    let (measured, foreseen) = (swing_error(false, 0.0), swing_error(true, 0.0));
    assert!(foreseen < 0.6 * measured, "{measured} {foreseen} N·m");
    // Nor by the help for a hand.
    let helped = swing_error(true, Design::default().assist);
    assert!(helped < 1.01 * foreseen, "{helped} {foreseen} N·m");
}

/// The first desired velocity of a mode, and one that stays, change nothing; nor does one that no positions make.
#[test]
fn a_desired_velocity_that_does_not_change_leaves_the_command() {
    let command = |motions: [Option<[f64; 2]>; 2]| {
        let mut law = PredictiveLaw::new(knee());
        let mut joint = Joint::new(knee(), 0.4, 1);
        run(&mut law, &mut joint, |_| 3.0, 50);
        let _ = law.hold_reference();
        for motion in motions.into_iter().flatten() {
            law.desire_motion(motion, 1.0);
        }
        law.command(&feedforward(3.0)).command
    };
    let without = command([None; 2]);
    assert_eq!(command([Some([0.0, 1.5]), Some([0.0016, 1.5])]), without);
    assert_ne!(command([Some([0.0, 1.5]), Some([0.0017, 1.6])]), without);
    assert_eq!(command([Some([0.0, 0.0]), Some([0.0, 1.6])]), without);
}

/// Of the knee, without and with help for a hand: largest torque, N·m, while a hand turns the link round from 0.5 to
/// -0.5 rad/s within 50 ms.
#[test]
fn a_hand_that_turns_the_joint_round_is_helped() {
    let [alone, helped] = [0.0, Design::default().assist].map(|help| {
        let mut law = PredictiveLaw::new(helped_by(help));
        let mut joint = Joint::new(knee(), BLOCKED, 1);
        let mut largest = 0.0_f64;
        for k in 0..1000 {
            let turned = f64::from((k - 800).clamp(0, 50)) / 50.0;
            joint.dq = 0.5 - turned;
            run(&mut law, &mut joint, |_| 0.0, 1);
            if k >= 800 {
                largest = largest.max(joint.torque().abs());
            }
        }
        largest
    });
    assert!(helped < 0.6 * alone, "{alone} {helped} N·m");
}

/// Encoders that drift move a joint that nobody holds no further where the law helps hands: as one they show a joint
/// that drives its link, and the link's alone shows nothing in the motion of the rotor.
#[test]
fn encoders_that_drift_are_not_helped() {
    for (of_motor, rate) in [(1.0, 0.1), (0.0, 0.01), (0.0, -0.01)] {
        let [alone, helped] = [0.0, Design::default().assist].map(|help| {
            let mut law = PredictiveLaw::new(helped_by(help));
            let mut joint = Joint::new(knee(), 0.35, 1);
            for k in 0..80 {
                let error = rate * DT * f64::from(k);
                let mut sensed = joint.sensed();
                sensed.q += error;
                sensed.theta += of_motor * error;
                sensed.torque = Some(joint.p.gear.at(0.0) * (sensed.theta - sensed.q));
                law.observe(&sensed);
                let command = law.command(&feedforward(0.0)).command;
                law.sent(command);
                joint.advance(command);
            }
            joint.dq.abs()
        });
        assert!(helped < 1.1 * alone, "{of_motor}: {alone} {helped} rad/s");
    }
}

fn helped_by(help: f64) -> LawParameters {
    let design = Design {
        assist: help,
        ..Design::default()
    };
    LawParameters { design, ..knee() }
}

#[test]
fn missing_samples_do_no_harm() {
    let p = knee();
    let mut law = PredictiveLaw::new(p);
    let mut joint = Joint::new(p, BLOCKED, 1);
    let mut worst: f64 = 0.0;
    for k in 0..3000_usize {
        let mut sensed = joint.sensed();
        // One in seven cycles has no angles, one in five no torque.
        sensed.fresh = k % 7 != 3;
        if !sensed.fresh {
            (sensed.theta, sensed.q) = (f64::NAN, f64::NAN);
        }
        sensed.torque = sensed.torque.filter(|_| k % 5 != 2);
        law.observe(&sensed);
        let command = law.command(&feedforward(20.0)).command;
        law.sent(command);
        joint.advance(command);
        if k > 500 {
            worst = worst.max((joint.torque() - 20.0).abs());
        }
    }
    assert!(worst < 0.5, "{worst}");
}
