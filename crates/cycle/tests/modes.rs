//! Passive mode, torque-feedback motion and low-gain tracking, in front of the simulated leg and test joint:
//! how they begin, what they do, and how they end.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, read};
use cycle::ClientInput;
use joint_file::{TrainedLocalGp, feed_forward_base};
use robot_state::{Event, Mode, Reference};

/// The leg's knee, and its hip pitch.
const KNEE: usize = 3;
const HIP: usize = 2;

/// A robot that was asked for a mode at its present pose for half a second, and the reference.
fn following(mut bench: Bench, mode: Mode, held_joints: u64) -> (Bench, Reference) {
    bench.run(600);
    let mut reference = bench.reference(mode.number(), 1);
    (reference.contact_wrench_given, reference.held_joints) = (0, held_joints);
    run(&mut bench, &mut reference, 500);
    (bench, reference)
}

/// Cycles without a fault; returns the greatest change of any joint's true torque within 5 ms, share of the
/// torque limit.
fn run(bench: &mut Bench, reference: &mut Reference, cycles: usize) -> f64 {
    let joints = bench.robot.parameters.joints.len();
    let mut torques = vec![Vec::new(); joints];
    for _ in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(reference));
        for (torques, truth) in torques.iter_mut().zip(&bench.plant.truth().joints) {
            torques.push(truth.tau);
        }
        let record = bench.cycle.record();
        assert_eq!(record.fault, 0, "{:?}", Event::from_number(record.fault));
    }
    let limits = bench
        .robot
        .parameters
        .joints
        .iter()
        .map(|j| j.limits.torque);
    let steps = torques.iter().zip(limits).map(|(torques, limit)| {
        let changes = torques.windows(6).map(|t| (t[5] - t[0]).abs() / limit);
        changes.fold(0.0, f64::max)
    });
    steps.fold(0.0, f64::max)
}

fn mode(bench: &Bench) -> Mode {
    Mode::from_number(bench.cycle.record().mode).unwrap()
}

fn angle(bench: &Bench, joint: usize) -> f64 {
    bench.plant.truth().joints[joint].q
}

fn count(bench: &Bench, event: Event) -> u64 {
    bench.cycle.record().events[event.index()]
}

/// All but the knee and the hip pitch.
const ALL_BUT_TWO: u64 = 0b11_0011;

/// A hand moves the joints that are let go with a few per cent of their torque, and no others; the mode begins and
/// ends without a step, and the robot holds where the hand has left it.
#[test]
fn passive_joints_follow_a_hand() {
    let (mut bench, mut reference) =
        following(Bench::new("leg"), Mode::InverseDynamics, ALL_BUT_TWO);
    let limit = bench.robot.parameters.joints[KNEE].limits.torque;
    let pose: Vec<f64> = (0..6).map(|j| angle(&bench, j)).collect();
    let hand = 0.03 * limit;
    bench.plant.robot_mut().set_load(KNEE, hand);
    run(&mut bench, &mut reference, 1000);
    assert!((angle(&bench, KNEE) - pose[KNEE]).abs() < 0.1f64.to_radians());
    bench.plant.robot_mut().set_load(KNEE, 0.0);
    run(&mut bench, &mut reference, 500);

    reference.mode = Mode::Passive.number();
    let entry = run(&mut bench, &mut reference, 1000);
    assert_eq!(mode(&bench), Mode::Passive);
    assert!(entry < 0.05, "{:.1} % within 5 ms", 100.0 * entry);
    let before = angle(&bench, KNEE);
    let drifted = (before - pose[KNEE]).abs();
    assert!(
        drifted < 1f64.to_radians(),
        "{:.2} deg",
        drifted.to_degrees()
    );
    bench.plant.robot_mut().set_load(KNEE, hand);
    let mut fastest = 0.0f64;
    for _ in 0..600 {
        run(&mut bench, &mut reference, 1);
        fastest = fastest.max(bench.plant.truth().joints[KNEE].dq.abs());
    }
    let moved = (angle(&bench, KNEE) - before).abs();
    assert!(moved > 5f64.to_radians(), "{:.2} deg", moved.to_degrees());
    let most = bench.robot.parameters.joints[KNEE].torque_velocity;
    assert!(fastest < 1.3 * most, "{fastest:.2} of {most:.2} rad/s");
    for j in [0, 1, 4, 5] {
        let moved = (angle(&bench, j) - pose[j]).abs();
        assert!(
            moved < 0.2f64.to_radians(),
            "{j}: {:.2} deg",
            moved.to_degrees()
        );
    }
    bench.plant.robot_mut().set_load(KNEE, 0.0);
    run(&mut bench, &mut reference, 300);

    // Held again: where it then is, and no elsewhere.
    reference.mode = Mode::Hold.number();
    let exit = run(&mut bench, &mut reference, 500);
    assert!(exit < 0.05, "{:.1} % within 5 ms", 100.0 * exit);
    let held = angle(&bench, KNEE);
    run(&mut bench, &mut reference, 1000);
    assert!((angle(&bench, KNEE) - held).abs() < 0.1f64.to_radians());
}

/// A joint that was let go is held again within the mode at a position near it, and not at another one.
#[test]
fn a_joint_is_held_again_near_where_it_is() {
    for (away, follows) in [(0.0, true), (0.5, false)] {
        let (mut bench, mut reference) = following(Bench::new("leg"), Mode::Passive, ALL_BUT_TWO);
        let mut motion = Motion::of(&bench);
        let here = bench.cycle.record().measured.joints;
        reference.joints[KNEE].q_d = here[KNEE].q + away;
        reference.joints[HIP].q_d = here[HIP].q;
        reference.held_joints = 0b11_1111;
        for _ in 0..300 {
            run(&mut bench, &mut reference, 1);
            motion.take(&bench);
        }
        motion.assert_small("held again");
        let expected = if follows { Mode::Passive } else { Mode::Hold };
        assert_eq!(mode(&bench), expected, "{away}");
        assert_eq!(count(&bench, Event::ReferenceJump) > 0, !follows);
    }
}

/// A client that takes the torques of F/T sensors and model over in mode torque, `settled` cycles after the start and
/// `before` cycles in the mode before.
fn taken_over(mode: Mode, [settled, before]: [usize; 2]) -> (Bench, Reference) {
    let mut bench = Bench::new("leg");
    bench.run(settled);
    let mut reference = bench.reference(mode.number(), 1);
    reference.contact_wrench_given = 0;
    run(&mut bench, &mut reference, before);
    let estimated = bench.cycle.record().estimated.joints;
    reference.mode = Mode::Torque.number();
    for (desired, joint) in reference.joints.iter_mut().zip(&estimated) {
        desired.tau_d = joint.tau_whole_body.tau;
    }
    (bench, reference)
}

/// The robot then stays where it is, whatever the mode before: as the knee begins to turn, the torque that is fed back
/// does not step with what its motor's friction is taken for. It did by 1 % of its limit, and the knee went on for 10
/// degrees.
#[test]
fn mode_torque_goes_on_from_other_modes_without_motion() {
    for (before, cycles) in [
        (Mode::Passive, [500, 350]),
        (Mode::Passive, [600, 250]),
        (Mode::TorqueFeedbackMotion, [600, 350]),
        (Mode::InverseDynamics, [600, 350]),
    ] {
        let (mut bench, mut reference) = taken_over(before, cycles);
        let mut motion = Motion::of(&bench);
        for _ in 0..1000 {
            run(&mut bench, &mut reference, 1);
            motion.take(&bench);
        }
        assert_eq!(mode(&bench), Mode::Torque);
        motion.assert_small(before.name());
    }
}

/// A short push that no sensor measures leaves a joint in mode torque where it has ended.
#[test]
fn a_joint_in_mode_torque_rests_after_a_push() {
    let (mut bench, mut reference) = taken_over(Mode::InverseDynamics, [600, 500]);
    run(&mut bench, &mut reference, 300);
    let mut motion = Motion::of(&bench);
    let limit = bench.robot.parameters.joints[KNEE].limits.torque;
    for (load, cycles) in [(0.01 * limit, 100), (0.0, 1100)] {
        bench.plant.robot_mut().set_load(KNEE, load);
        for _ in 0..cycles {
            run(&mut bench, &mut reference, 1);
            motion.take(&bench);
        }
    }
    motion.assert_small("after a push");
    assert!(bench.plant.truth().joints[KNEE].dq.abs() < 0.005);
}

/// A joint that is let go within the mode goes soft where it was held, whatever its reference then asks for.
#[test]
fn what_is_asked_of_a_joint_that_is_let_go_does_not_count() {
    let (mut bench, mut reference) = following(Bench::new("leg"), Mode::Passive, 0b11_1111);
    let before = angle(&bench, KNEE);
    reference.held_joints = 0b11_0111;
    reference.joints[KNEE].q_d = 1000.0;
    reference.joints[KNEE].dq_d = -50.0;
    let step = run(&mut bench, &mut reference, 700);
    assert_eq!(mode(&bench), Mode::Passive);
    assert!(step < 0.05, "{:.1} % within 5 ms", 100.0 * step);
    let moved = (angle(&bench, KNEE) - before).abs();
    assert!(moved < 1f64.to_radians(), "{:.2} deg", moved.to_degrees());
}

/// A joint whose limb presses against something with more than a tenth of its torque is not let go: it would
/// give way at once.
#[test]
fn a_joint_that_bears_is_not_let_go() {
    let pressed = "\n[[push]]\nlink = \"foot\"\nstart_s = 0.0\nduration_s = 3.0\nforce_N = [60.0, 0.0, 150.0]\n";
    let bench = Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("sim.toml") {
            format!("{text}{pressed}")
        } else {
            text
        })
    });
    let (mut bench, mut reference) = following(bench, Mode::InverseDynamics, 0);
    let mut motion = Motion::of(&bench);
    reference.mode = Mode::Passive.number();
    for _ in 0..500 {
        run(&mut bench, &mut reference, 1);
        motion.take(&bench);
    }
    assert_eq!(mode(&bench), Mode::Hold);
    assert!(count(&bench, Event::ReferenceRejected) > 0);
    motion.assert_small("a limb that bears");
}

/// A client that falls silent, or F/T sensors that do, end passive mode, and the robot holds.
#[test]
fn passive_mode_ends_with_its_client_and_its_sensors() {
    for silent in [true, false] {
        let (mut bench, mut reference) = following(Bench::new("leg"), Mode::Passive, ALL_BUT_TWO);
        let mut motion = Motion::of(&bench);
        for _ in 0..400 {
            reference.sequence += 1;
            bench.gather();
            if silent {
                bench.compute(&ClientInput::default());
            } else {
                // F/T sensors' frames are those without a joint's identifier.
                common::spoil_ft(&mut bench, |axes| axes[2] = 1e6);
                bench.compute(&client_input(&reference));
            }
            motion.take(&bench);
        }
        assert_eq!(mode(&bench), Mode::Hold, "silent client: {silent}");
        motion.assert_small("the end of passive mode");
    }
}

/// A payload that no model has: stiffness alone gives way to it, the carried torque fed back does not.
#[test]
fn torque_feedback_carries_an_unknown_load() {
    let sag = |mode: Mode| {
        let (mut bench, mut reference) = following(Bench::new("test-joint"), mode, 0);
        let limit = bench.robot.parameters.joints[0].limits.torque;
        let before = angle(&bench, 0);
        bench.plant.robot_mut().set_load(0, 0.1 * limit);
        let step = run(&mut bench, &mut reference, 3000);
        assert_eq!(self::mode(&bench), mode);
        ((angle(&bench, 0) - before).abs(), step)
    };
    let (by_stiffness, _) = sag(Mode::InverseDynamics);
    let (by_torque, _) = sag(Mode::TorqueFeedbackMotion);
    assert!(by_stiffness > 0.05f64.to_radians(), "{by_stiffness}");
    assert!(
        by_torque < 0.1 * by_stiffness,
        "{by_torque} of {by_stiffness} rad"
    );
    // Ten times softer than configured, with the same load, it neither swings nor drifts.
    let (mut bench, mut reference) =
        following(Bench::new("test-joint"), Mode::TorqueFeedbackMotion, 0);
    let p = &bench.robot.parameters.joints[0];
    let (gains, limit) = (p.gains, p.limits.torque);
    reference.gains_given = 1;
    reference.joints[0].stiffness = 0.1 * gains.k_s;
    reference.joints[0].damping = 0.2 * gains.k_d;
    let before = angle(&bench, 0);
    run(&mut bench, &mut reference, 1000);
    bench.plant.robot_mut().set_load(0, 0.1 * limit);
    run(&mut bench, &mut reference, 5000);
    let left = (angle(&bench, 0) - before).abs();
    assert!(left < 0.1 * by_stiffness, "{left} of {by_stiffness} rad");
    // From inverse dynamics and back.
    let (mut bench, mut reference) = following(Bench::new("leg"), Mode::InverseDynamics, 0);
    for mode in [
        Mode::TorqueFeedbackMotion,
        Mode::InverseDynamics,
        Mode::TorqueFeedbackMotion,
    ] {
        reference.mode = mode.number();
        let step = run(&mut bench, &mut reference, 1000);
        assert!(step < 0.05, "{mode:?}: {:.1} % within 5 ms", 100.0 * step);
        assert_eq!(self::mode(&bench), mode);
    }
}

/// Without a link-side encoder, or with the law of D, there is no torque whose feedback was judged.
#[test]
fn torque_feedback_motion_needs_the_torque_without_delay() {
    for bench in [Bench::new("hrp2-like"), common::current_drive()] {
        let possible = bench.robot.parameters.name.clone();
        let mut bench = bench;
        bench.run(600);
        let bits = bench.cycle.record().possible_modes;
        assert_eq!(
            bits >> Mode::TorqueFeedbackMotion.number() & 1,
            0,
            "{possible}"
        );
        assert_eq!(bits >> Mode::LowGainTracking.number() & 1, 0, "{possible}");
    }
}

/// A feed-forward of 4 N·m about the pose in which the test joint stands.
fn learned(path: &str) -> std::io::Result<String> {
    if path.ends_with("learned.toml") {
        return Ok(feed_forward("joint", 4.0));
    }
    let text = read(path)?;
    Ok(if path.ends_with("test-joint/robot.toml") {
        text.replace(
            "torque_limit_Nm = 37.0",
            "torque_limit_Nm = 37.0\nfeed_forward = \"learned.toml\"",
        )
    } else {
        text
    })
}

fn feed_forward(joint: &str, torque: f64) -> String {
    use estimators::features::FeatureSet;
    use estimators::local_gp::{LocalGpParameters, LocalModel};
    use estimators::regimes::{Regime, Regimes};
    let regime = Regime {
        gain: 1.0,
        sigma: 1.0,
    };
    let mut point = vec![0.0; 9];
    point[0] = 0.0;
    TrainedLocalGp {
        base: feed_forward_base(joint),
        parameters: LocalGpParameters {
            features: FeatureSet::Motion,
            inputs: vec![(0.0, 0.2); 9],
            signal_variance: 16.0,
            noise_variance: 1e-4,
            models: vec![LocalModel {
                centre: point.clone(),
                points: point,
                residuals: vec![torque],
                noise: vec![1e-4],
            }],
            directions: 1,
            tolerance: 0.0,
            regimes: Regimes {
                speed: 1.0,
                time_constant: 1.0,
                sample_period: 1e-3,
                rest: regime,
                moving: regime,
            },
            gear_ratio: 1.0,
        },
        held_out_rms: (4.0, 0.1),
    }
    .to_text()
    .unwrap()
}

/// The learned torque counts where it was learned, fades away from there, and a load of that size is carried
/// by it with a fraction of the stiffness.
#[test]
fn low_gains_are_helped_by_what_was_learned() {
    let (mut bench, mut reference) = following(
        Bench::reading("test-joint", &learned),
        Mode::LowGainTracking,
        0,
    );
    assert_eq!(mode(&bench), Mode::LowGainTracking);
    let p = &bench.robot.parameters;
    let (k_s, low) = (p.joints[0].gains.k_s, p.modes.low_stiffness);
    run(&mut bench, &mut reference, 2000);
    // Nothing hangs there: the torque moves the joint against the soft spring, and fades on the way.
    let q_d = reference.joints[0].q_d;
    let moved = angle(&bench, 0) - q_d;
    let expected = 4.0 * (-0.5 * (q_d / 0.2f64).powi(2)).exp() / (low * k_s);
    assert!(
        (moved - expected).abs() < 0.2 * expected,
        "{moved} {expected} rad"
    );
    // The load that was learned: the joint is back.
    bench.plant.robot_mut().set_load(0, -low * k_s * moved);
    run(&mut bench, &mut reference, 3000);
    let left = (angle(&bench, 0) - q_d).abs();
    assert!(left < 0.1 * moved, "{left} of {moved} rad");
}

/// The file of another joint, or of an estimator, is refused, with what is allowed.
#[test]
fn feed_forwards_of_others_are_refused() {
    let refused = |read: &dyn Fn(&str) -> std::io::Result<String>, what: &str| {
        let refused = robot_config::load("config/test-joint/robot.toml", read).unwrap_err();
        let text = refused.to_string();
        assert!(
            text.contains(what) && text.contains("torquectl learn"),
            "{text}"
        );
    };
    let of_another = |path: &str| {
        if path.ends_with("learned.toml") {
            Ok(feed_forward("knee", 1.0))
        } else {
            learned(path)
        }
    };
    let missing = |path: &str| {
        if path.ends_with("learned.toml") {
            Err(std::io::ErrorKind::NotFound.into())
        } else {
            learned(path)
        }
    };
    refused(&of_another, "inverse dynamics of knee");
    refused(&missing, "learned.toml");
}

/// Joints whose torque carries their weight have nothing that brings them back: the humanoid's arms, let go, stay
/// where they are.
#[test]
fn joints_that_are_let_go_stay_where_nobody_pushes_them() {
    let mut bench = Bench::new("humanoid");
    bench.run(600);
    let mut reference = bench.reference(Mode::Passive.number(), 1);
    let joints = bench.robot.parameters.joints.clone();
    let arm = |name: &str| {
        let parts = ["shoulder", "elbow", "wrist"];
        parts.iter().any(|part| name.contains(part))
    };
    let held = joints.iter().enumerate().filter(|(_, j)| !arm(&j.name));
    (reference.contact_wrench_given, reference.held_joints) =
        (0, held.fold(0, |bits, (j, _)| bits | 1 << j));
    run(&mut bench, &mut reference, 350);
    let before: Vec<f64> = (0..joints.len()).map(|j| angle(&bench, j)).collect();
    run(&mut bench, &mut reference, 1000);
    assert_eq!(mode(&bench), Mode::Passive);
    for (j, joint) in joints.iter().enumerate() {
        let moved = (angle(&bench, j) - before[j]).abs().to_degrees();
        assert!(moved < 0.1, "{}: {moved} deg", joint.name);
    }
}

/// Against a soft spring an F/T sensor that errs moves no joint that stands.
#[test]
fn low_gains_do_not_follow_an_ft_sensor_that_errs() {
    let learned = |path: &str| match path {
        path if path.ends_with("learned.toml") => Ok(feed_forward("knee", 1.0)),
        path if path.ends_with("leg/robot.toml") => Ok(read(path)?.replace(
            "name = \"knee\"",
            "name = \"knee\"\nfeed_forward = \"learned.toml\"",
        )),
        path => read(path),
    };
    let (mut bench, mut reference) =
        following(Bench::reading("leg", &learned), Mode::LowGainTracking, 0);
    assert_eq!(mode(&bench), Mode::LowGainTracking);
    let before: Vec<f64> = (0..6).map(|j| angle(&bench, j)).collect();
    for _ in 0..1000 {
        reference.sequence += 1;
        bench.gather();
        common::spoil_ft(&mut bench, |axes| {
            (axes[2], axes[4]) = (axes[2] + 50.0, axes[4] + 5.0);
        });
        bench.compute(&client_input(&reference));
    }
    for (j, before) in before.iter().enumerate() {
        let moved = (angle(&bench, j) - before).abs().to_degrees();
        assert!(moved < 0.5, "{j}: {moved} deg");
    }
}
