//! Tares the F/T sensors of a robot that hangs still in its harness, and prints their offsets.
//!
//!     cargo run -p torqued-client --example 03_tare -- leg in_the_air

use std::error::Error;
use std::process::ExitCode;

use torqued_client::robot_state::request;
use torqued_client::{Client, Location};

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
    let mut arguments = std::env::args().skip(1);
    let robot = match arguments.next() {
        Some(robot) => robot,
        None => Location::find()?.only_robot()?,
    };
    // The present contact set, one of the robot's configuration.
    let contacts = arguments.next().unwrap_or_else(|| "in_the_air".to_owned());

    let client = Client::connect(&robot)?;
    let answer = client.request(request::TARE, &contacts, |working| {
        eprintln!("{:3.0} %, keep the robot still", 100.0 * working.progress);
    })?;
    println!("{}", answer.text);
    let names = client.description().ft_names.iter();
    for (name, sensor) in names.zip(&answer.ft).take(answer.ft_count as usize) {
        let [fx, fy, fz] = sensor.offset.force;
        println!("  {name:24} {fx:8.2} {fy:8.2} {fz:8.2} N");
    }
    Ok(())
}
