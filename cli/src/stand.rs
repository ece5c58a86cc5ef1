//! `torquectl stand`: a robot that stands on its feet and keeps its balance.

use crate::motion::{bar, catch_signals};
use crate::requests::{Failure, PATIENCE, connect, end};
use problem::Problem;
use serde_json::json;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::Commander;

const HELP: &str = "\
The robot stands in its present pose on the feet that bear it, its centre of mass over the middle
of their soles. It answers a push by its legs, within the soles, and takes no step. It needs a
floating base and sole_corners_m of the F/T sensor above each foot. The robot must be enabled; in
the end it holds. Where its feet no longer hold it, or leave the ground, the mode ends with event
303, and the robot holds. Ctrl-C ends it.

Examples:
  torquectl stand                        until Ctrl-C
  torquectl stand --seconds 30 --json
  torquectl stand --shift 20,0           its centre of mass 20 mm to the front

Exit codes:
  0  done; the robot holds
  1  torqued could not be reached, or did not follow: no foot bears the robot, for example
  2  bad input: arguments";

/// Let an enabled robot stand on its feet, and keep its balance
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct StandArguments {
    /// Centre of mass from the middle of the soles, to the front and to the left, mm
    #[arg(long, value_name = "FRONT,LEFT", value_parser = shift, default_value = "0,0", allow_hyphen_values = true)]
    shift: [f64; 2],
    /// Time until the end, s [default: until Ctrl-C]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    seconds: Option<f64>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Interval of references.
const INTERVAL: Duration = Duration::from_millis(4);

fn seconds(text: &str) -> Result<f64, Problem> {
    let seconds = text.parse().ok().filter(|x| (1e-3..1e6).contains(x));
    seconds.ok_or_else(|| Problem::new("not a time", "above 0 s, below 1e6 s"))
}

/// In m.
fn shift(text: &str) -> Result<[f64; 2], Problem> {
    let parse = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.abs() < 1e3);
    let parts = text.split_once(',');
    let both = parts.and_then(|(front, left)| Some([parse(front)?, parse(left)?]));
    let allowed = "two numbers in mm, below 1000, as 20,-10";
    let both = both.ok_or_else(|| Problem::new(format!("{text:?} is no shift"), allowed))?;
    Ok(both.map(|mm| 1e-3 * mm))
}

pub(crate) fn run(arguments: &StandArguments) -> ExitCode {
    end(go(arguments))
}

fn go(arguments: &StandArguments) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(arguments.robot.as_ref())?;
    let mut commander = Commander::connect(&mut client)?;
    commander.hold_until_ready(PATIENCE)?;
    let bar = bar();
    let length = arguments
        .seconds
        .map_or(0, |seconds| (1e3 * seconds) as u64);
    bar.set_length(length);
    let since = Instant::now();
    let gone = || since.elapsed().as_secs_f64();
    while !stop.load(Ordering::Relaxed) && arguments.seconds.is_none_or(|s| gone() < s) {
        commander.stand(arguments.shift)?;
        sleep(INTERVAL);
        bar.set_position(since.elapsed().as_millis() as u64);
        bar.set_message(match arguments.seconds {
            Some(seconds) => format!("{:.1} s left", seconds - gone()),
            None => "until Ctrl-C".to_owned(),
        });
    }
    bar.finish_and_clear();
    let stood = gone();
    commander.close()?;
    let robot = client.robot();
    Ok(if arguments.json {
        let object = json!({ "robot": robot, "stood_s": stood, "shift_m": arguments.shift });
        format!("{object}\n")
    } else {
        format!("stood for {stood:.1} s; the robot holds\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_is_two_numbers_in_mm() {
        assert_eq!(shift("20, -10").unwrap(), [0.02, -0.01]);
        for wrong in ["20", "a,b", "1,2,3", "1e4,0", "nan,0"] {
            let problem = shift(wrong).unwrap_err().to_string();
            assert!(problem.contains("two numbers in mm"), "{problem}");
        }
    }
}
