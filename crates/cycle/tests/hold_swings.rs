//! A hold of a drive that takes currents, with gains that are far too high for its delay: it swings by itself, and
//! is a fault within its first swings; in the fault no current drives the joint.

use crate::common;

use common::motion::state;
use common::{Bench, client_input, current_drive, read_with_current_drive};
use cycle::ClientInput;
use robot_config::torque_loops::refused_loops;
use robot_state::{DriveState, Event, Mode, RobotState};

/// The test joint with a drive that takes currents, held with this frequency, critically damped, with so many times
/// these gains; the filters' windows
/// are the default ones, in samples.
fn held(rate_hz: f64, (hz, times): (f64, f64), brake: bool) -> Bench {
    let joint = &current_drive().robot.parameters.joints[0];
    let rotor = joint.rotor_inertia * joint.encoders.gear_ratio.powi(2);
    let inertia = rotor + joint.link_inertia;
    let frequency = std::f64::consts::TAU * hz;
    let k_s = times * inertia * frequency.powi(2);
    let k_d = times * 2.0 * frequency * inertia;
    Bench::reading("test-joint", &|path| {
        let text = read_with_current_drive(path)?;
        let profile = "profile = \"cia402\"";
        let braked = format!("{profile}\nbrake = \"while_off\"");
        let gains = "K_p = 2.0, K_s_Nm_per_rad = 1389.0, K_d_Nms_per_rad = 13.9";
        let mine = format!("K_p = 0.0, K_s_Nm_per_rad = {k_s}, K_d_Nms_per_rad = {k_d}");
        let text = text.replace("rate_hz = 1000.0", &format!("rate_hz = {rate_hz:.1}"));
        let text = if brake {
            text.replace(profile, &braked)
        } else {
            text
        };
        Ok(text.replace(gains, &mine))
    })
}

/// A client moves the joint by its torque, and goes.
fn let_go_in_motion(bench: &mut Bench) {
    let rate = 1.0 / bench.robot.parameters.timing.sample_period;
    bench.run((0.9 * rate) as usize);
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    bench.step(&client_input(&reference));
    (reference.mode, reference.joints[0].tau_d) = (Mode::Torque.number(), 12.0);
    for _ in 0..(2.0 * rate) as usize {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        if bench.plant.truth().joints[0].dq > 0.2 {
            return;
        }
    }
    panic!("{} rad/s", bench.plant.truth().joints[0].dq);
}

/// Torque per current, N·m/A.
fn torque_per_current(bench: &Bench) -> f64 {
    let joint = &bench.robot.parameters.joints[0];
    joint.encoders.gear_ratio * joint.estimator.wave_generator.torque_constant
}

#[test]
fn a_hold_that_swings_is_a_fault_in_its_first_swings_and_no_current_drives_its_joint_then() {
    for (rate, times, brake) in [
        (250.0, 10.0, true),
        (250.0, 10.0, false),
        (250.0, 30.0, false),
        (1000.0, 10.0, false),
    ] {
        let what = format!("{rate} Hz, {times} times, brake {brake}");
        let mut bench = held(rate, (3.0, times), brake);
        assert!(!refused_loops(&bench.robot, "robot.toml").is_empty());
        let_go_in_motion(&mut bench);
        let per_current = torque_per_current(&bench);
        let (mut found, mut work, mut turns) = (None, 0.0_f64, 0);
        let (mut before, mut reach) = (bench.plant.truth().joints[0], [f64::MAX, f64::MIN]);
        let cycles = (5.0 * rate) as usize;
        for k in 0..cycles {
            bench.step(&ClientInput::default());
            let truth = bench.plant.truth().joints[0];
            let record = bench.cycle.record();
            if record.fault != 0 && found.is_none() {
                // At 1 kHz the swing is so quick that the torsion which it makes is found first.
                let other = (rate == 1000.0).then(|| Event::EncoderImplausible.number());
                let swings = Event::HoldSwings.number();
                assert!(
                    record.fault == swings || Some(record.fault) == other,
                    "{what}"
                );
                found = Some(k as f64 / rate);
            }
            if found.is_none() && truth.dq * before.dq < 0.0 {
                turns += 1;
            }
            if found.is_some() {
                let torque = per_current * record.measured.joints[0].current;
                work += (torque * (truth.theta - before.theta) / 100.0).max(0.0);
                reach = [reach[0].min(truth.q), reach[1].max(truth.q)];
            }
            before = truth;
        }
        let found = found.unwrap_or_else(|| panic!("{what}: swings unseen, {turns} turns"));
        let way = (reach[1] - reach[0]).to_degrees();
        assert!(found < 1.5, "{what}: {found} s, {turns} turns");
        // With 210 the encoders are not trusted, and nothing but the weight's torque and friction holds it.
        let most = if rate == 1000.0 {
            (5.0, 1.5)
        } else {
            (1.0, 0.1)
        };
        assert!(
            way < most.0 && work < most.1,
            "{what}: {way:.2} deg, {work:.3} J"
        );
        let record = bench.cycle.record();
        let drive = DriveState::from_number(record.commanded.joints[0].drive_state);
        assert_eq!(drive == Some(DriveState::Off), brake, "{what}: {drive:?}");
        assert!(before.dq.abs() < 0.1, "{what}: {} rad/s", before.dq);
    }
}

#[test]
fn a_hold_with_margins_does_not_swing() {
    for (rate, hz) in [(250.0, 0.4), (1000.0, 1.5)] {
        let mut bench = held(rate, (hz, 1.0), false);
        let refused = refused_loops(&bench.robot, "robot.toml");
        assert!(refused.is_empty(), "{rate}: {refused:?}");
        let_go_in_motion(&mut bench);
        bench.run((4.0 * rate) as usize);
        assert_eq!(
            state(bench.cycle.record()),
            RobotState::Holding,
            "{rate}: {}",
            bench.cycle.record().fault
        );
    }
}
