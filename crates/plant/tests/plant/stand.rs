//! The humanoid on its feet and in its harness, under its drives' own control.

use crate::common::{can_robot, parameters};
use plant::parameters::{HarnessParameters, PushParameters};
use plant::{SimParameters, SimRobot, Truth};

fn start(sim: &SimParameters) -> SimRobot {
    can_robot("humanoid", sim).unwrap().robot().clone()
}

fn run(robot: &mut SimRobot, seconds: f64) -> Truth {
    for _ in 0..(seconds * 1000.0) as usize {
        robot.advance();
    }
    robot.truth().clone()
}

fn tilt(truth: &Truth) -> f64 {
    2.0 * f64::hypot(truth.base_orientation[0], truth.base_orientation[1])
}

fn fastest(truth: &Truth) -> f64 {
    (truth.joints.iter()).fold(0.0_f64, |m, j| m.max(j.dq.abs()))
}

fn hanging() -> SimParameters {
    let mut sim = parameters("humanoid");
    (sim.start.on_ground, sim.start.base_position) = (false, [0.0, 0.0, 1.2]);
    sim.harness = Some(HarnessParameters {
        link: "chest_pitch_link".into(),
        stiffness: 50_000.0,
        damping: 2_000.0,
        angular_stiffness: 5_000.0,
        angular_damping: 200.0,
        slack: 0.0,
        angular_slack: 0.0,
    });
    sim
}

#[test]
fn the_humanoid_stands_still_from_the_start() {
    let mut robot = start(&parameters("humanoid"));
    let early = run(&mut robot, 0.05);
    assert!(
        fastest(&early) < 0.01,
        "starts with {} rad/s",
        fastest(&early)
    );
    let late = run(&mut robot, 3.0);
    assert!(tilt(&late) < 0.01, "tilted by {} rad", tilt(&late));
    let sunk = early.base_position[2] - late.base_position[2];
    assert!(sunk.abs() < 0.001, "sunk by {sunk} m");
    assert!(
        fastest(&late) < 1e-3,
        "still moves at {} rad/s",
        fastest(&late)
    );
    let weight = robot.mass() * plant::articulated::GRAVITY;
    let carried: f64 = late.external.iter().map(|e| e.wrench.force[2]).sum();
    assert!(
        (carried - weight).abs() < 0.01 * weight,
        "{carried} of {weight} N"
    );
}

#[test]
fn the_humanoid_hangs_in_its_harness() {
    let mut robot = start(&hanging());
    let late = run(&mut robot, 2.0);
    assert!(
        fastest(&late) < 1e-3,
        "still moves at {} rad/s",
        fastest(&late)
    );
    assert!(
        late.external[..2]
            .iter()
            .all(|foot| foot.wrench.force == [0.0; 3])
    );
    let force = late.external[2].wrench.force;
    let carried = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    let weight = robot.mass() * plant::articulated::GRAVITY;
    assert!(
        (carried - weight).abs() < 1e-3 * weight,
        "{carried} of {weight} N"
    );
}

#[test]
fn a_light_push_sways_the_humanoid_and_a_hard_one_throws_it() {
    let pushed = |newton: f64| {
        let mut sim = parameters("humanoid");
        sim.pushes.push(PushParameters {
            link: "chest_pitch_link".into(),
            start: 0.1,
            duration: 0.2,
            force: [newton, 0.0, 0.0],
            torque: [0.0; 3],
        });
        let mut robot = start(&sim);
        let most = (0..1500).fold(0.0_f64, |m, _| m.max(tilt(&run(&mut robot, 0.001))));
        (most, tilt(robot.truth()))
    };
    let (most, last) = pushed(40.0);
    assert!(most > 1e-4, "nothing happened");
    assert!(last < 0.01, "did not come back: {last}");
    let (most, _) = pushed(800.0);
    assert!(most > 0.3, "stood like a rock: {most}");
}

#[test]
fn a_start_without_support_is_refused() {
    let mut sim = parameters("humanoid");
    sim.start.joints.insert("chest_pitch".into(), 1.4);
    sim.start.joints.insert("left_hip_pitch".into(), -1.5);
    sim.start.joints.insert("right_hip_pitch".into(), -1.5);
    let error = can_robot("humanoid", &sim).unwrap_err().to_string();
    assert!(
        error.contains("start") && error.contains("carries"),
        "{error}"
    );
}
