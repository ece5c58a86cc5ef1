//! A robot that waits for its operator: its drives are off, brakes carry it, and no current flows. That is
//! no disagreement of the sources, and no torque of zero.

use crate::common;

use common::{Bench, read};
use cycle::OperatorRequest;
use robot_state::{Event, JointEstimated, RobotState, torque_flags};

const HIP_PITCH: usize = 2;

/// The calibrated leg, stretched out forwards; its joint files with `zero_unknown` as given.
fn stretched(zero_unknown: bool) -> Bench {
    Bench::reading("leg", &|path| {
        let path = path.replace("config/leg/robot.toml", "config/leg/calibrated.toml");
        let text = read(&path)?;
        Ok(match path.rsplit('/').next() {
            Some("calibrated.toml") => text.replace("\"automatic\"", "\"operator\""),
            Some("sim.toml") => text.replace(
                "hip_pitch = -25, knee = 50, ankle_pitch = -25",
                "hip_pitch = -80, knee = 5, ankle_pitch = 0",
            ),
            Some("hip_pitch.toml") if zero_unknown => {
                text.replace("zero_unknown = false", "zero_unknown = true")
            }
            _ => text,
        })
    })
}

fn warned(bench: &Bench) -> Vec<Event> {
    let counts = &bench.cycle.record().events;
    let own = (204..=208).chain([Event::SourcesDisagree.number()]);
    own.filter_map(Event::from_number)
        .filter(|e| counts[e.index()] > 0)
        .collect()
}

fn joint(bench: &Bench, joint: usize) -> JointEstimated {
    bench.cycle.record().estimated.joints[joint]
}

#[test]
fn brakes_that_carry_the_robot_are_no_wrong_torque_constant() {
    let mut bench = Bench::reading("lift-gripper", &|path| {
        Ok(read(path)?.replace("\"automatic\"", "\"operator\""))
    });
    // Before the first push.
    bench.run(1800);
    let lift = joint(&bench, 0);
    assert!(lift.tau_whole_body.tau.abs() > 0.15 * bench.robot.parameters.joints[0].limits.torque);
    assert_eq!(warned(&bench), []);
    // Once the drives carry it, a wrong torque constant shows.
    bench.robot.parameters.joints[0]
        .estimator
        .wave_generator
        .torque_constant *= 2.0;
    bench.cycle = cycle::Cycle::new(&bench.robot).unwrap();
    bench.run(500);
    bench.ask(OperatorRequest::Enable);
    bench.run(4000);
    assert_eq!(warned(&bench), [Event::TorqueConstant]);
}

#[test]
fn the_fused_torque_is_that_of_the_torsion_while_the_drive_is_off() {
    let mut bench = stretched(false);
    bench.run(5000);
    for enabled in [false, true] {
        let hip = joint(&bench, HIP_PITCH);
        let (fused, truth) = (hip.tau_encoder, hip.tau_whole_body.tau);
        assert!(truth < -28.0, "{truth}");
        assert_eq!(fused.flags, torque_flags::VALID, "{enabled}");
        assert!(
            (fused.tau - truth).abs() < 2.0 * fused.sigma && fused.sigma < 1.0,
            "{enabled}: {fused:?}, {truth}"
        );
        assert_eq!(warned(&bench), [], "{enabled}");
        bench.ask(OperatorRequest::Enable);
        bench.run(3000);
    }
}

#[test]
fn an_unknown_zero_is_not_set_by_the_current_of_a_drive_that_is_off() {
    let mut bench = stretched(true);
    bench.run(5000);
    let hip = joint(&bench, HIP_PITCH);
    assert_eq!(
        hip.tau_encoder.flags & torque_flags::VALID,
        0,
        "nothing shows it yet: {hip:?}"
    );
    bench.ask(OperatorRequest::Enable);
    bench.run(3000);
    let record = bench.cycle.record();
    assert_eq!(
        (record.state, record.fault),
        (RobotState::Holding.number(), 0)
    );
    let hip = joint(&bench, HIP_PITCH);
    let (fused, truth) = (hip.tau_encoder, hip.tau_whole_body.tau);
    assert_eq!(fused.flags, torque_flags::VALID, "{hip:?}");
    assert!(
        (fused.tau - truth).abs() < 2.0 * fused.sigma && fused.sigma < 3.0,
        "{fused:?}, {truth}"
    );
    assert_eq!(warned(&bench), []);
}
