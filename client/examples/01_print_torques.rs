//! Prints every joint's torque ten times a second, until the daemon ends.
//!
//!     cargo run -p torqued-client --example 01_print_torques -- leg

use std::error::Error;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use torqued_client::{Client, Location};

const PERIOD: Duration = Duration::from_millis(100);

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
    let description = *client.description();
    let joints = description.joint_count as usize;

    let mut lost = 0;
    let mut next_print = Instant::now();
    for record in client.records(Duration::from_secs(1)) {
        let record = record?;
        lost += record.lost;
        if Instant::now() < next_print {
            continue;
        }
        next_print = Instant::now() + PERIOD;
        println!("cycle {} ({lost} records lost)", record.cycle.sequence);
        let names = description.joint_names.iter();
        for (name, joint) in names.zip(&record.cycle.estimated.joints).take(joints) {
            println!(
                "  {name:24} encoder {:8.2} ± {:5.2} N·m, whole-body {:8.2} ± {:5.2} N·m",
                joint.tau_encoder.tau,
                joint.tau_encoder.sigma,
                joint.tau_whole_body.tau,
                joint.tau_whole_body.sigma,
            );
        }
    }
    Ok(())
}
