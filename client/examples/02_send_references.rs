//! Moves the first joint 2 degrees to and fro by inverse dynamics for five seconds; then the robot
//! holds its position.
//!
//!     cargo run -p torqued-client --example 02_send_references -- leg

use std::error::Error;
use std::f64::consts::TAU;
use std::process::ExitCode;
use std::time::Duration;

use torqued_client::robot_state::Mode;
use torqued_client::{Client, Commander, Location};

const AMPLITUDE: f64 = 2.0 * TAU / 360.0;
const FREQUENCY_HZ: f64 = 0.5;
const SECONDS: f64 = 5.0;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let robot = match std::env::args().nth(1) {
        Some(robot) => robot,
        None => Location::find()?.only_robot()?,
    };
    let mut client = Client::connect(&robot)?;
    // It begins by holding the robot where it stands, and waits for an operator to enable it.
    let mut commander = Commander::connect(&mut client)?;
    commander.hold_until_ready(Duration::from_secs(10))?;
    // Records from before are skipped.
    client.latest()?;
    let start = client.next_record(Duration::from_secs(1))?.cycle;
    let (start_q, start_ns) = (start.measured.joints[0].q, start.stamp_ns);
    // Towards the middle of the joint's range, so that it never meets a limit.
    let robot = client.description();
    let middle = 0.5 * (robot.position_min[0] + robot.position_max[0]);
    let amplitude = AMPLITUDE.copysign(middle - start_q);
    for record in client.records(Duration::from_secs(1)) {
        // The daemon's cycles are the clock: one reference for each of its records.
        let record = record?;
        let t = record.cycle.stamp_ns.saturating_sub(start_ns) as f64 * 1e-9;
        if t > SECONDS {
            break;
        }
        // An error if it is not followed: a fault, an operator's stop, another commander.
        commander.send(|reference| {
            reference.mode = Mode::InverseDynamics.number();
            // 1 - cos: begins at rest, and smoothly.
            let (w, half) = (TAU * FREQUENCY_HZ, amplitude / 2.0);
            let first = &mut reference.joints[0];
            first.q_d = start_q + half * (1.0 - (w * t).cos());
            first.dq_d = half * w * (w * t).sin();
            first.ddq_d = half * w * w * (w * t).cos();
        })?;
    }
    commander.close()?;
    Ok(())
}
