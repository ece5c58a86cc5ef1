//! One joint on its test bench: every effect has its expected size.

use crate::common::parameters;
use plant::parameters::DriveParameters;
use plant::{Command, DriveSheet, JointRig, KinematicError, RigLoad, RigSample, RigTiming};
use robot_state::JointKind;

const TIMING: RigTiming = RigTiming {
    period: 1e-3,
    substeps: 10,
};
/// The link of Z's test joint, its axis vertical: no weight to carry.
const LEVEL: RigLoad = RigLoad {
    inertia: 0.0873,
    mass: 0.0,
    arm: 0.0,
};

fn sheet() -> DriveSheet {
    DriveSheet {
        kind: JointKind::Revolute,
        gear_ratio: 100.0,
        torque_constant: 0.05,
        rotor_inertia: 1.14e-5,
        motor_counts_per_turn: 4096.0,
        link_counts_per_turn: 524_288.0,
        command: Command::Position,
        kinematic_error: KinematicError {
            link: vec![[2.6e-6, 7.52e-5]],
            link_frequency: 1.0,
            motor: vec![[-2.8e-5, 3.3e-5], [-5.7e-5, -1.6e-5]],
            motor_frequency: 1.0,
            ..KinematicError::default()
        },
    }
}

fn drive() -> DriveParameters {
    parameters("test-joint").drives["joint"].clone()
}

fn rig(drive: &DriveParameters, load: RigLoad, q: f64) -> JointRig {
    JointRig::new(&sheet(), drive, load, TIMING, q, 1)
}

fn last(rig: &mut JointRig, cycles: usize, external: f64) -> RigSample {
    (0..cycles).map(|_| rig.advance(external)).last().unwrap()
}

#[test]
fn a_loaded_joint_starts_without_a_shock_and_holds() {
    let load = RigLoad {
        inertia: 0.59,
        mass: 2.5,
        arm: 0.45,
    };
    let mut rig = rig(&drive(), load, 1.2);
    let tau = load.weight(1.2);
    for _ in 0..1000 {
        let s = rig.advance(0.0);
        assert!(s.truth.dq.abs() < 1e-3, "moves at {} rad/s", s.truth.dq);
        assert!((s.truth.tau - tau).abs() < 0.05, "{} {tau}", s.truth.tau);
    }
}

#[test]
fn tau_accelerates_the_link() {
    let mut rig = rig(&drive(), LEVEL, 0.0);
    for k in 0..2000 {
        let t = 1e-3 * f64::from(k);
        rig.command(0.3 * (3.0 * t).sin());
        let external = 2.0 * (7.0 * t).sin();
        let s = rig.advance(external);
        let off = LEVEL.inertia * s.truth.ddq - s.truth.tau - external;
        assert!(off.abs() < 1e-9, "off by {off}");
    }
}

#[test]
fn the_position_loop_follows_slowly_moving_set_points() {
    let mut rig = rig(&drive(), LEVEL, 0.0);
    let mut worst = 0.0_f64;
    for k in 0..4000 {
        let desired = 0.5 * (1e-3 * f64::from(k)).sin();
        rig.command(desired);
        worst = worst.max((rig.advance(0.0).truth.q - desired).abs());
    }
    // D6: K_v dq = 7 ms at 0.5 rad/s.
    assert!(worst < 5e-3, "{worst}");
}

#[test]
fn torsion_differs_between_loading_and_unloading() {
    let mut rig = rig(&drive(), LEVEL, 0.0);
    let torsion = |s: &RigSample| s.truth.theta / 100.0 - s.truth.q;
    // Slowly to +12, -12, +12 N·m on the held joint; note the torsion at zero torque.
    let mut at_zero = Vec::new();
    let mut before = 0.0;
    for k in 0..24_000 {
        let phase = std::f64::consts::TAU * f64::from(k) / 12_000.0;
        let s = rig.advance(-12.0 * phase.sin());
        if k > 3000 && before * s.truth.gear_torque < 0.0 {
            at_zero.push(torsion(&s));
        }
        before = s.truth.gear_torque;
    }
    let width = (at_zero[0] - at_zero[1]).abs() * drive().transmission.stiffness;
    let hysteresis = drive().transmission.hysteresis;
    assert!(
        (0.5 * hysteresis..8.0 * hysteresis).contains(&width),
        "loop {width} N·m wide, hysteresis {hysteresis}"
    );
}

#[test]
fn the_kinematic_error_shows_when_the_unloaded_joint_turns() {
    let mut rig = rig(&drive(), LEVEL, 0.0);
    // One turn after a short run-up; the first harmonic of the torsion over q.
    let (mut a, mut b, mut n) = (0.0, 0.0, 0);
    for k in 0..12_000 {
        let desired = std::f64::consts::TAU * (f64::from(k) - 2000.0) / 10_000.0;
        rig.command(desired);
        let s = rig.advance(0.0).truth;
        if k >= 2000 {
            let torsion = s.theta / 100.0 - s.q;
            a += 2.0 * torsion * s.q.cos();
            b += 2.0 * torsion * s.q.sin();
            n += 1;
        }
    }
    let (a, b) = (a / f64::from(n), b / f64::from(n));
    assert!((a - 2.6e-6).abs() < 1e-5, "{a}");
    assert!((b - 7.52e-5).abs() < 1e-5, "{b}");
}

#[test]
fn stiction_holds_the_motor_and_lets_go() {
    let mut quiet = drive();
    // No control: friction alone holds the motor.
    (quiet.controller.k_4, quiet.controller.k_5) = (0.0, 0.0);
    let breakaway = 100.0 * quiet.friction.coulomb;
    let moved = |external: f64| {
        let mut rig = rig(&quiet, LEVEL, 0.0);
        for k in 0..500 {
            rig.advance(external * f64::from(k) / 500.0);
        }
        let early = rig.advance(external).truth.theta;
        last(&mut rig, 2000, external).truth.theta - early
    };
    assert!(
        moved(0.5 * breakaway).abs() < 1e-4,
        "{}",
        moved(0.5 * breakaway)
    );
    assert!(moved(2.0 * breakaway) > 1.0);
}

#[test]
fn the_dead_zone_swallows_small_errors() {
    let mut drive = drive();
    drive.controller.dead_zone = 1e-3;
    (drive.sensors.current_noise, drive.sensors.current_offset) = (0.0, 0.0);
    let mut rig = rig(&drive, LEVEL, 0.0);
    rig.command(8e-4);
    let s = last(&mut rig, 200, 0.0);
    assert!(
        s.truth.q.abs() < 1e-5 && s.truth.current.abs() < 1e-3,
        "{s:?}"
    );
    rig.command(5e-3);
    let s = last(&mut rig, 500, 0.0);
    assert!(s.truth.q > 2e-3, "{s:?}");
}

#[test]
fn an_encoder_that_leads_reads_an_earlier_motor_angle() {
    let mut drive = drive();
    drive.sensors.motor_lead = 2e-3;
    let mut rig = rig(&drive, LEVEL, 0.0);
    for k in 0..1500 {
        rig.command(1e-3 * f64::from(k));
        rig.advance(0.0);
    }
    rig.command(1.5);
    let s = rig.advance(0.0);
    let behind = s.truth.theta - s.reading.theta;
    assert!((behind - 2e-3 * s.truth.omega).abs() < 0.02, "{behind}");
}

#[test]
fn current_commands_drive_with_their_torque() {
    let mut drive = drive();
    (drive.sensors.current_offset, drive.sensors.current_gain) = (0.0, 0.0);
    drive.sensors.torque_constant = 0.0;
    let mut sheet = sheet();
    sheet.command = Command::Current;
    let mut rig = JointRig::new(&sheet, &drive, LEVEL, TIMING, 0.0, 1);
    rig.command(2.0);
    // A wall: the link is held by a stiff outside spring, so the joint's torque is
    // N K_t i = 10 N·m less the friction.
    let mut s = rig.advance(0.0);
    for _ in 0..3000 {
        let wall = -20_000.0 * s.truth.q - 100.0 * s.truth.dq;
        s = rig.advance(wall);
    }
    let lost = 10.0 - s.truth.tau;
    let friction = 100.0 * drive.friction.coulomb * drive.friction.static_ratio + 0.1 * 10.0;
    assert!(lost.abs() < friction, "{lost}");
}
