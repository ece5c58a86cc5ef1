//! Drives that are hot, in front of the cycle: what they tell is in the record, the torque limit falls, the robot stops.

use crate::common;

use common::{Bench, client_input, read};
use cycle::ClientInput;
use robot_state::{CycleRecord, Event, RobotState, reported_flags};

/// Torque limit of the test joint, torque of 3 A, and what carries its weight, N·m.
const LIMIT: f64 = 37.0;
const CONTINUOUS: f64 = 15.0;
const WEIGHT: f64 = 10.95;

const MESSAGE: &str = "
BO_ 258 TOLD: 7 DRIVES
 SG_ temperature : 0|8@1- (1,0) [-128|127] \"degC\" TORQUED
 SG_ supply : 8|16@1+ (1,0) [0|65535] \"mV\" TORQUED
 SG_ torque : 24|16@1- (0.01,0) [-327.68|327.67] \"Nm\" TORQUED
 SG_ error : 40|16@1+ (1,0) [0|65535] \"\" TORQUED

BO_ 497 ";
const SIGNALS: &str = "
temperature = { signal = \"TOLD.temperature\" }
voltage = { signal = \"TOLD.supply\" }
drive_torque = { signal = \"TOLD.torque\" }
drive_error = { signal = \"TOLD.error\" }
";
const TEMPERATURES: &str =
    "continuous_current_A = 3.0\ntime_constant_s = 60.0\nwarn_C = 60\nderate_C = 70\nstop_C = 90\n";

/// The test joint, whose drive reports of itself and may get so hot.
fn bench(thermal: &str) -> Bench {
    Bench::reading("test-joint", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("config/test-joint/robot.toml") {
            let thermal = format!("[drive.joint.thermal]\n{thermal}[drive.joint.motor]");
            text.replace("[drive.joint.motor]", &thermal) + SIGNALS
        } else if path.ends_with("drives.dbc") {
            text.replace("\nBO_ 497 ", MESSAGE)
        } else {
            text
        })
    })
}

fn count(record: &CycleRecord, event: Event) -> u64 {
    record.events[event.index()]
}

/// Follows a client, with a temperature, °C, and from 0.1 s on an external torque that grows for 0.4 s,
/// N·m. Greatest torque that the drive is asked for at rest.
fn follow(bench: &mut Bench, temperature: f64, load: f64, cycles: usize) -> f64 {
    let reference = bench.follow();
    let mut greatest = 0.0_f64;
    for cycle in 0..cycles {
        bench.plant.robot_mut().set_temperature(0, temperature);
        let part = (cycle as f64 / 400.0 - 0.25).clamp(0.0, 1.0);
        bench.plant.robot_mut().set_load(0, part * load);
        let mut reference = reference;
        reference.sequence += cycle as u64 + 1;
        let record = bench.step(&client_input(&reference));
        let (measured, commanded) = (&record.measured.joints[0], &record.commanded.joints[0]);
        // What the drive's position loop makes of its set-point; its damping comes besides.
        let lead = commanded.q_c - measured.theta / 100.0;
        if measured.dq.abs() < 0.05 {
            greatest = greatest.max(lead.abs() / (0.00024 - 1.0 / 8333.0));
        }
    }
    greatest
}

#[test]
fn what_a_drive_tells_is_in_the_record_until_it_falls_silent() {
    let mut bench = bench(TEMPERATURES);
    bench.plant.robot_mut().set_temperature(0, 41.0);
    bench.run(300);
    let joint = bench.cycle.record().measured.joints[0];
    let all = reported_flags::TEMPERATURE
        | reported_flags::VOLTAGE
        | reported_flags::TORQUE
        | reported_flags::ERROR;
    assert_eq!(joint.reported, all);
    assert_eq!(
        (joint.temperature, joint.voltage, joint.drive_error),
        (41.0, 48.0, 0)
    );
    // Its own torque is that of its current, which it measures with noise.
    let torque = joint.current * 5.0;
    assert!(
        (joint.tau_drive - torque).abs() < 1.0,
        "{} {torque}",
        joint.tau_drive
    );
    for _ in 0..1100 {
        bench.gather();
        bench.drop_answers(|frame| frame.id == 258);
        bench.compute(&ClientInput::default());
    }
    let record = bench.cycle.record();
    assert_eq!(record.measured.joints[0].reported, 0);
    assert_eq!(
        record.state,
        RobotState::Holding.number(),
        "nothing waits for it"
    );
    assert_eq!(count(record, Event::JointMissed), 0);
}

#[test]
fn a_hot_drive_makes_less_torque_and_an_overheated_one_stops_the_robot() {
    let cold = follow(&mut bench(TEMPERATURES), 40.0, 20.0, 1000);
    assert!(cold > 22.0, "{cold}: it bears the load");
    let mut warm = bench(TEMPERATURES);
    let hot = follow(&mut warm, 88.0, 20.0, 1000);
    let record = warm.cycle.record();
    let limit = LIMIT - 0.9 * (LIMIT - CONTINUOUS);
    let allowed = record.commanded.joints[0].torque_limit;
    assert!(
        (allowed - limit).abs() < 1.0,
        "{allowed} instead of {limit}"
    );
    // The looser of both encoders counts, and the gear is softer than its model.
    assert!(hot < 1.2 * limit, "{hot} beyond {limit}");
    assert_eq!(count(record, Event::DriveHot), 1, "it lasts");
    assert_eq!(count(record, Event::DriveOverheated), 0);
    let mut bench = bench(TEMPERATURES);
    follow(&mut bench, 91.0, 0.0, 500);
    let record = bench.cycle.record();
    assert_eq!(record.fault, Event::DriveOverheated.number());
    assert_eq!(record.state, RobotState::Fault.number());
    assert_eq!(count(record, Event::DriveOverheated), 1);
}

#[test]
fn without_a_temperature_the_current_makes_a_drive_hot() {
    let thermal = "continuous_current_A = 3.0\ntime_constant_s = 0.5\n";
    let mut borne = bench(thermal);
    follow(&mut borne, 120.0, 5.0, 2000);
    let record = borne.cycle.record();
    let load = record.estimated.joints[0].thermal_load;
    assert!((0.8..1.21).contains(&load), "{load}");
    let allowed = record.commanded.joints[0].torque_limit;
    assert!(
        (CONTINUOUS - 0.1..0.95 * LIMIT).contains(&allowed),
        "{allowed}"
    );
    assert_eq!((count(record, Event::DriveHot), record.fault), (1, 0));
    // What presses more heats on, as the drive's own damping does: the robot stops.
    let mut pressed = bench(thermal);
    follow(&mut pressed, 120.0, 20.0, 2000);
    assert_eq!(
        pressed.cycle.record().fault,
        Event::DriveOverheated.number()
    );
}

#[test]
fn a_joint_whose_drive_is_too_hot_does_not_fall_by_its_weight() {
    let thermal = TEMPERATURES.replace("= 3.0", "= 1.0");
    let reactions = "[safety.reactions]\ndrive_overheated = \"warn\"\n";
    let mut bench = bench(&format!("{thermal}{reactions}"));
    let before = bench.plant.truth().joints[0].q;
    follow(&mut bench, 95.0, 0.0, 1000);
    let record = bench.cycle.record();
    assert_eq!(record.fault, 0);
    let allowed = record.commanded.joints[0].torque_limit;
    assert!((allowed - 1.2 * WEIGHT).abs() < 1.0, "{allowed}");
    let moved = bench.plant.truth().joints[0].q - before;
    assert!(moved.abs() < 0.01, "{moved} rad");
}
