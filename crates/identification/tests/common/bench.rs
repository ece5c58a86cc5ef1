//! Logs from the plant's test bench for one joint: Z's 16 N·m joint, as simulated for the robot of
//! `config/test-joint`, all its disturbances on.

use identification::log::LogRow;
use joint_file::{JointFile, no_files};
use plant::parameters::DriveParameters;
use plant::{Command, DriveSheet, JointRig, KinematicError, RigLoad, RigTiming, SimParameters};
use robot_state::JointKind;

const T: f64 = 1e-3;
const TIMING: RigTiming = RigTiming {
    period: T,
    substeps: 10,
};
/// The link's axis vertical: no weight to carry.
const LEVEL: RigLoad = RigLoad {
    inertia: 0.0873,
    mass: 0.0,
    arm: 0.0,
};
/// A pendulum of 11 N·m.
pub(crate) const PENDULUM: RigLoad = RigLoad {
    inertia: 0.59,
    mass: 2.5,
    arm: 0.45,
};

const JOINT: &str = r#"
[joint]
name = "bench"
gear_ratio = 100
torque_constant_Nm_per_A = 0.05
rotor_inertia_kg_m2 = 1.14e-5
rated_torque_Nm = 16
link_counts_per_turn = 524288
motor_counts_per_turn = 4096
sample_rate_hz = 1000
"#;

/// The joint as its data sheet has it.
pub(crate) fn joint() -> JointFile {
    JointFile::parse(JOINT, "bench.toml", &no_files).unwrap()
}

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
    let text = include_str!("../../../../config/test-joint/sim.toml");
    SimParameters::parse(text, "sim.toml").unwrap().drives["joint"].clone()
}

/// The joint with a load, at rest.
pub(crate) fn rig(load: RigLoad, seed: u64) -> JointRig {
    JointRig::new(&sheet(), &drive(), load, TIMING, 0.0, seed)
}

/// A log of the joint that follows `q(t)` while `external(t)` acts on the link; the first second
/// brings both in from rest.
fn log(
    load: RigLoad,
    seconds: f64,
    seed: u64,
    q: impl Fn(f64) -> f64,
    external: impl Fn(f64) -> f64,
) -> Vec<LogRow> {
    let mut rig = rig(load, seed);
    let count = (seconds / T) as usize;
    let row = |i: usize| {
        let t = T * i as f64;
        let begun = smooth(t);
        rig.command(begun * q(t));
        let s = rig.advance(begun * external(t));
        LogRow {
            t,
            theta: s.reading.theta,
            q: s.reading.q,
            current: s.reading.current,
            tau_sensor: s.truth.tau,
            feed_forward: f64::NAN,
        }
    };
    (0..count).map(row).collect()
}

pub(crate) fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The joint, always with the same errors of its own: those come from the seed.
pub(crate) const SEED: u64 = 1;

/// One unloaded turn each way, slow: a fast one would excite the gear by its own kinematic error.
pub(crate) fn turn() -> Vec<LogRow> {
    let q = |t: f64| 6.4 * (smooth((t - 1.5) / 45.0) - smooth((t - 47.5) / 45.0));
    log(LEVEL, 94.0, SEED, q, |_| 0.0)
}

/// Loaded motion from slow to fast for a part of the time, then rest at places under loads that
/// change slowly and at once.
pub(crate) fn training(seconds: f64, moving: f64) -> Vec<LogRow> {
    let end = moving * seconds;
    // 1 in motion, 0 at rest.
    let active = |t: f64| 1.0 - smooth((t - end) / 2.0);
    let pace = |t: f64| 0.5 - 0.5 * (t * 0.13).cos();
    let motion = |t: f64| {
        let p = 0.3 * t + 9.0 * (t - (t * 0.13).sin() / 0.13) * 0.13;
        0.9 * p.sin() + (0.3 * (1.7 * p + 1.0).sin() + 0.12 * (4.1 * p).sin()) * pace(t)
    };
    // Every 5 s another place.
    let place = |n: f64| 1.1 * (2.4 * n).sin();
    let rest = |t: f64| {
        let (n, part) = ((t / 5.0).floor(), (t / 5.0).fract());
        place(n) + (place(n + 1.0) - place(n)) * smooth((part - 0.8) / 0.2)
    };
    let moving_load = |t: f64| {
        4.0 * (0.9 * t).sin() + 3.0 * (0.23 * t + 1.0).sin() + 1.5 * (4.3 * t).sin() * pace(1.3 * t)
    };
    let resting_load = |t: f64| {
        let step = if (t / 1.7).floor() % 3.0 == 1.0 {
            4.0
        } else {
            0.0
        };
        5.0 * (1.1 * t).sin() * (0.07 * t).sin() + step
    };
    let mix = |t: f64, a: f64, b: f64| active(t) * a + (1.0 - active(t)) * b;
    log(
        PENDULUM,
        seconds,
        SEED,
        |t| mix(t, motion(t), rest(t)),
        |t| mix(t, moving_load(t), resting_load(t)),
    )
}

/// Scenarios as Z and G have them, other motion and load than the training's.
pub(crate) fn scenarios() -> Vec<(&'static str, Vec<LogRow>)> {
    let frequent = |t: f64| 0.25 * (7.0 * t).sin() + 0.1 * (11.0 * t).sin();
    vec![
        (
            "slow",
            log(PENDULUM, 30.0, SEED, |t| 1.2 * (0.42 * t).sin(), |_| 0.0),
        ),
        (
            "fast",
            log(PENDULUM, 20.0, SEED, |t| 1.1 * (2.3 * t).sin(), |_| 0.0),
        ),
        (
            "sudden",
            log(
                PENDULUM,
                12.0,
                SEED,
                |_| 0.6,
                |t| if (t / 3.0).fract() < 0.5 { -7.0 } else { 0.0 },
            ),
        ),
        (
            "frequent",
            log(
                PENDULUM,
                20.0,
                SEED,
                |t| 0.7 + frequent(t),
                |t| 2.0 * (3.1 * t).sin(),
            ),
        ),
        (
            "rest",
            log(PENDULUM, 15.0, SEED, |_| -0.8, |t| 3.0 * (0.5 * t).sin()),
        ),
    ]
}
