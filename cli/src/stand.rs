//! `torquectl stand`: a robot that stands on its feet and keeps its balance.

use crate::motion::{bar, catch_signals};
use crate::requests::{Failure, PATIENCE, command, connect, end};
use control::Stepping;
use problem::{Problem, Problems};
use robot_config::Robot;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::{Client, Commander};

const HELP: &str = "\
The robot stands in its present pose on the feet that bear it, its centre of mass over the middle
of their soles. It answers a push by its legs, within the soles, and takes no step of its own. It
needs a floating base and sole_corners_m of the F/T sensor above each foot. The robot must be
enabled; in the end it holds. Where its feet no longer hold it, or leave the ground, the mode ends
with event 303, and the robot holds. Ctrl-C ends it.

With --step it lifts its feet in turn and puts them down where they were. Do that in a harness
alone: a simulated humanoid whose joints stick has fallen after some steps.

Examples:
  torquectl stand                        until Ctrl-C
  torquectl stand --seconds 30 --json
  torquectl stand --shift 20,0           its centre of mass 20 mm to the front
  torquectl stand --step 30 --config config/humanoid/robot.toml

Exit codes:
  0  done; the robot holds
  1  torqued could not be reached, or did not follow: no foot bears the robot, for example
  2  bad input: arguments, or the configuration";

/// Let an enabled robot stand on its feet, and keep its balance
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct StandArguments {
    /// Centre of mass from the middle of the soles, to the front and to the left, mm
    #[arg(long, value_name = "FRONT,LEFT", value_parser = shift, default_value = "0,0", allow_hyphen_values = true)]
    shift: [f64; 2],
    /// Steps in place: how far each foot rises, mm
    #[arg(long, value_name = "MM", value_parser = rise, requires = "config", conflicts_with = "shift")]
    step: Option<f64>,
    /// The robot's configuration, for --step
    #[arg(long, value_name = "FILE", requires = "step")]
    config: Option<PathBuf>,
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
fn rise(text: &str) -> Result<f64, Problem> {
    let rise = text
        .parse()
        .ok()
        .filter(|mm: &f64| (1.0..=200.0).contains(mm));
    let rise = rise.map(|mm| 1e-3 * mm);
    rise.ok_or_else(|| Problem::new("not a height", "1 to 200 mm"))
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
    let read = |path: &str| terminal::read_text(path);
    let config = arguments.config.as_ref();
    let robot = config.map(|config| robot_config::load(&config.display().to_string(), &read));
    match robot.transpose() {
        Ok(robot) => end(go(arguments, robot.as_ref())),
        Err(Problems(problems)) => {
            for problem in problems {
                eprintln!("{problem}");
            }
            ExitCode::from(crate::BAD_INPUT)
        }
    }
}

fn go(arguments: &StandArguments, robot: Option<&Robot>) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(arguments.robot.as_ref())?;
    let mut commander = command(&mut client)?;
    let mut steps = of_steps(arguments, robot, &mut client)?;
    let bar = bar();
    let length = arguments
        .seconds
        .map_or(0, |seconds| (1e3 * seconds) as u64);
    bar.set_length(length);
    let since = Instant::now();
    let gone = || since.elapsed().as_secs_f64();
    while !stop.load(Ordering::Relaxed) && arguments.seconds.is_none_or(|s| gone() < s) {
        match &mut steps {
            None => commander.stand(arguments.shift)?,
            Some(steps) => steps.send(&mut client, &mut commander)?,
        }
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
    let count = steps.map(|steps| steps.stepping.steps());
    Ok(if arguments.json {
        let object =
            json!({ "robot": robot, "stood_s": stood, "shift_m": arguments.shift, "steps": count });
        format!("{object}\n")
    } else {
        let made = count.map_or(String::new(), |count| format!(", {count} steps"));
        format!("stood for {stood:.1} s{made}; the robot holds\n")
    })
}

/// Steps in place, and the feet on which the robot stood in the newest record.
struct Steps {
    stepping: Stepping,
    stands_on: u64,
    last: Instant,
}

/// The steps that are asked for, from the pose in which the robot stands.
fn of_steps(
    arguments: &StandArguments,
    robot: Option<&Robot>,
    client: &mut Client,
) -> Result<Option<Steps>, Failure> {
    let (Some(rise), Some(robot)) = (arguments.step, robot) else {
        return Ok(None);
    };
    let record = client.next_record(PATIENCE)?;
    let joints = record.cycle.measured.joints.iter();
    let pose: Vec<f64> = (joints.take(record.cycle.joint_count as usize))
        .map(|joint| joint.q)
        .collect();
    drop(record);
    if pose.len() != robot.parameters.joints.len() {
        let what = format!("the robot has {} joints", pose.len());
        let allowed = "the configuration that torqued runs";
        return Err(Failure::Argument(
            Problem::new(what, allowed).of("--config"),
        ));
    }
    let stepping = robot.stepping(&pose, rise).ok_or_else(|| {
        let what = "no two feet can be lifted so far from this pose";
        let allowed = "less, or knees that are bent; sole_corners_m of two feet";
        Failure::Argument(Problem::new(what, allowed).of("--step"))
    })?;
    let (stands_on, last) = (0, Instant::now());
    Ok(Some(Steps {
        stepping,
        stands_on,
        last,
    }))
}

impl Steps {
    /// Sends the next reference.
    fn send(&mut self, client: &mut Client, commander: &mut Commander) -> Result<(), Failure> {
        if let Some(record) = client.latest()? {
            self.stands_on = record.cycle.commanded.stands_on;
        }
        let elapsed = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        let mut comes = true;
        commander.send(|reference| {
            (reference.trajectory, reference.center_of_mass_offset) = (0, [0.0; 2]);
            comes = self.stepping.update(self.stands_on, reference, elapsed);
        })?;
        if comes {
            return Ok(());
        }
        Err(Failure::Stopped(format!(
            "a foot was not free, or did not find the ground, within some seconds; {} steps",
            self.stepping.steps()
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rise_is_in_mm() {
        assert_eq!(rise("30").unwrap(), 0.03);
        for wrong in ["0", "-3", "300", "a", "nan"] {
            assert!(rise(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_shift_is_two_numbers_in_mm() {
        assert_eq!(shift("20, -10").unwrap(), [0.02, -0.01]);
        for wrong in ["20", "a,b", "1,2,3", "1e4,0", "nan,0"] {
            let problem = shift(wrong).unwrap_err().to_string();
            assert!(problem.contains("two numbers in mm"), "{problem}");
        }
    }
}
