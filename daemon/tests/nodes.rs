//! Robots whose drives are nodes, simulated: from power-on to holding, and what happens when a supply fails.

use crate::common;
use cycle::ClientInput;
use plant::parameters::PowerLossParameters;
use robot_config::Robot;
use robot_state::{RobotState, SharedRecord};
use std::sync::atomic::AtomicBool;
use test_support::{read_project_file, with_canopen_nodes};
use torqued::bring_up::bring_up;
use torqued::bus::LockStep;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::control_loop::ControlLoop;
use torqued::real_time::Pace;

/// The robot's loop in lock-step, its drives set up.
struct Rig {
    pace: VirtualDeadline,
    control_loop: ControlLoop<LockStep<plant::CanRobot>>,
}

impl Rig {
    fn new(name: &str, losses: Vec<PowerLossParameters>) -> Self {
        Self::of(name, common::robot(name), losses)
    }

    /// A robot of the project with CANopen nodes in place of the drives of its DBC file, two on a bus.
    fn with_nodes(name: &str) -> Self {
        let config = format!("config/{name}/robot.toml");
        let read = |path: &str| {
            let text = read_project_file(path)?;
            let changed = path == config;
            Ok(if changed {
                with_canopen_nodes(&text, 2)
            } else {
                text
            })
        };
        let robot = robot_config::load(&config, &read).expect("a robot");
        Self::of(name, robot, Vec::new())
    }

    fn of(name: &str, robot: Robot, losses: Vec<PowerLossParameters>) -> Self {
        let mut sim = common::sim(name);
        sim.power_losses = losses;
        let clock = VirtualClock::new();
        clock.advance_to(1_000_000_000);
        let mut bus = LockStep::new(common::plant(&robot, &sim), &clock);
        bring_up(&robot, &mut bus, &AtomicBool::new(false)).expect("set up");
        bus.translate(&robot.nodes.actuators).expect("families");
        Self {
            pace: VirtualDeadline::new(&clock, 1_000_000),
            control_loop: ControlLoop::new(&robot, bus).expect("a loop"),
        }
    }

    fn cycle(&mut self) -> &SharedRecord {
        let wake = self.pace.wait();
        self.control_loop.run_cycle(&wake, &ClientInput::default())
    }

    /// Cycles until the robot is in that state.
    fn until(&mut self, state: RobotState, longest: usize) -> usize {
        for cycle in 0..longest {
            if self.cycle().cycle.state == state.number() {
                return cycle;
            }
        }
        let last = self.cycle().cycle;
        panic!("state {}, fault {}", last.state, last.fault);
    }
}

#[test]
fn from_power_on_to_holding() {
    for name in ["canopen-joint", "damiao-joint"] {
        let mut rig = Rig::new(name, Vec::new());
        let before = rig.cycle().cycle.measured.joints[0].q;
        rig.until(RobotState::Holding, 5000);
        for _ in 0..1000 {
            rig.cycle();
        }
        let record = rig.cycle().cycle;
        assert_eq!(record.fault, 0, "{name}");
        let q = record.measured.joints[0].q;
        assert!((q - before).abs() < 5e-3, "{name}: {before} {q}");
        let robot = rig.control_loop.bus().peer();
        assert_eq!(robot.unknown_frames(), 0, "{name}");
    }
}

/// Prismatic joints, joints without a link-side encoder, and thirty drives on fifteen buses beside those of sensors.
#[test]
fn robots_of_dbc_files_hold_with_nodes_too() {
    for name in ["lift-gripper", "hrp2-like", "humanoid"] {
        let mut rig = Rig::with_nodes(name);
        rig.until(RobotState::Holding, 5000);
        for _ in 0..200 {
            rig.cycle();
        }
        let record = rig.cycle().cycle;
        assert_eq!(
            (record.fault, record.state),
            (0, RobotState::Holding.number()),
            "{name}"
        );
    }
}

#[test]
fn a_drive_whose_supply_fails_stops_the_robot() {
    for name in ["canopen-joint", "damiao-joint"] {
        let loss = PowerLossParameters {
            joint: "joint".to_owned(),
            start: 2.5,
            duration: 0.3,
        };
        let mut rig = Rig::new(name, vec![loss]);
        rig.until(RobotState::Holding, 2400);
        rig.until(RobotState::Fault, 3000);
    }
}

/// The drive goes to zero, and its own following error ends nothing.
#[test]
fn a_drive_that_runs_away_and_hears_no_control_words_is_reset() {
    let mut rig = Rig::new("canopen-joint", Vec::new());
    rig.until(RobotState::Holding, 5000);
    let robot = rig.control_loop.bus_mut().peer_mut();
    let started = robot.truth().joints[0].q;
    let faults = robot.robot_mut().drive_faults(0).expect("a drive");
    (faults.deaf, faults.set_point.offset) = (true, 0.5);
    rig.until(RobotState::Fault, 100);
    let way = |rig: &Rig| {
        let robot = rig.control_loop.bus().peer();
        (robot.truth().joints[0].q - started).abs().to_degrees()
    };
    for _ in 0..1000 {
        rig.cycle();
    }
    let after_a_second = way(&rig);
    assert!(
        after_a_second < 10.0,
        "{after_a_second:.1} deg of the 29 to where it goes"
    );
    for _ in 0..300 {
        rig.cycle();
    }
    let goes_on = (way(&rig) - after_a_second).abs();
    assert!(goes_on < 0.1, "{goes_on:.2} deg");
}
