//! A standing humanoid that presses with a hand on something fixed, in mode Cartesian.

use crate::common;

use common::{Bench, client_input, read};
use robot_state::{Event, FrameReference, Mode, Reference, Settings};

const HAND: &str = "[[frame]]\nname = \"hand\"\nlink = \"left_hand\"\nforce_limit_N = 120.0\n\
    torque_limit_Nm = 15.0\nstiffness_N_per_m = 2000.0\nstiffness_Nm_per_rad = 50.0\n\n[[ft_sensor]]";
/// Object that the hand is fixed to.
const OBJECT: &str = "[harness]\nlink = \"left_hand\"\nstiffness_N_per_m = 100000\n\
    damping_Ns_per_m = 333\nstiffness_Nm_per_rad = 833\ndamping_Nms_per_rad = 2.5\n\
    slack_m = 0\nslack_deg = 0\n";

/// The humanoid with more in its simulation, whose start on the ground is replaced.
fn humanoid(start: &str, more: &str) -> Bench {
    Bench::reading("humanoid", &|path| {
        let text = read(path)?;
        if path.ends_with("humanoid/robot.toml") {
            return Ok(text.replacen("[[ft_sensor]]", HAND, 1));
        }
        Ok(if path.ends_with("humanoid/sim.toml") {
            format!("{}\n{more}", text.replacen("on_ground = true", start, 1))
        } else {
            text
        })
    })
}

/// The hand is fixed where it is as the robot stands.
fn holding_on() -> Bench {
    let position = humanoid("on_ground = true", "").plant.truth().base_position;
    humanoid(&format!("base_position_m = {position:?}"), OBJECT)
}

/// Contact set in which both hands and feet may bear forces.
const HANDS_AND_FEET: u32 = 6;

fn run(bench: &mut Bench, reference: &mut Reference, cycles: usize) {
    let settings = Settings {
        sequence: 1,
        contact_set: HANDS_AND_FEET,
        ..Settings::default()
    };
    for _ in 0..cycles {
        reference.sequence += 1;
        let mut client = client_input(reference);
        client.settings = Some(&settings);
        bench.step(&client);
        let record = bench.cycle.record();
        assert_eq!(
            (record.fault, record.mode),
            (0, reference.mode),
            "{:?}",
            Event::from_number(record.commander.cause)
        );
    }
}

/// After a step of its force the robot comes to rest: friction that was foreseen by the sign of measured velocities
/// swung its ankles at 0.2 rad/s, and the hand's force by 150 N, for ever.
#[test]
fn a_hand_that_presses_does_not_set_the_robot_swaying() {
    let mut bench = holding_on();
    bench.run(1500);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    reference.contact_wrench_given = 0;
    reference.frames[0] = FrameReference {
        orientation: [1.0, 0.0, 0.0, 0.0],
        damping_ratio: 1.0,
        used: 1,
        ..FrameReference::default()
    };
    run(&mut bench, &mut reference, 20);
    let record = bench.cycle.record();
    let frame = &record.commanded.frames[0];
    (
        reference.frames[0].position,
        reference.frames[0].orientation,
    ) = (frame.position, frame.orientation);
    for (desired, joint) in reference.joints.iter_mut().zip(&record.measured.joints) {
        desired.q_d = joint.q;
    }
    reference.frames[0].stiffness = [0.0, 0.0, 0.0, 30.0, 30.0, 30.0];
    reference.frames[0].force_axes = 7;
    reference.mode = Mode::Cartesian.number();
    run(&mut bench, &mut reference, 1000);
    reference.frames[0].force[2] = 30.0;
    run(&mut bench, &mut reference, 6000);
    let mut fastest: f64 = 0.0;
    for _ in 0..1000 {
        run(&mut bench, &mut reference, 1);
        let joints = bench.plant.truth().joints.iter();
        fastest = joints.fold(fastest, |most, joint| most.max(joint.dq.abs()));
    }
    assert!(fastest < 0.02, "{fastest:.3} rad/s");
}
