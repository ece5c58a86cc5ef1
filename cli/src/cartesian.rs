//! `torquectl cartesian`: a frame of the robot led by springs and a desired force.

use crate::motion::{bar, catch_signals};
use crate::requests::{Failure, beyond_limits, command, connect, end};
use crate::units::rounded;
use control::DAMPING_RATIOS;
use problem::{Problem, listed};
use serde_json::json;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::Client;
use torqued_client::robot_state::{FrameCommanded, FrameReference, Mode, frame_flags};

const HELP: &str = "\
The frame is held where it is by springs along and about the axes of its base, led from there by --shift,
and presses with --force. All other joints hold. The robot must be enabled; in the end it holds.
An axis with a force has no spring: the force is measured and led there, as far as the robot knows it.
What it prints is the mean over the last half second. Ctrl-C ends it.

Examples:
  torquectl cartesian foot --stiffness 2000                        soft where it is, for 10 s
  torquectl cartesian foot --stiffness 2000 --shift 0,0,-20        20 mm down, within 2 s
  torquectl cartesian foot --force 0,0,-40 --seconds 5 --json      presses down with 40 N
  torquectl cartesian foot --stiffness 500,500,3000 --turning-stiffness 50 --damping-ratio 0.7

Exit codes:
  0  done; the robot holds
  1  it was stopped, torqued could not be reached, or did not follow
  2  bad input: arguments, or a frame that the robot does not have";

/// Lead a frame of an enabled robot by springs and forces, and show where it goes and what it feels.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct CartesianArguments {
    /// A frame of the configuration: the name of a table [[frame]]
    frame: String,
    /// Stiffness along x, y, z, N/m: three numbers, or one for all
    #[arg(long, value_name = "N/m", default_value = "1000", value_parser = numbers)]
    stiffness: Three,
    /// Stiffness about x, y, z, N·m/rad
    #[arg(long, value_name = "N·m/rad", default_value = "30", value_parser = numbers)]
    turning_stiffness: Three,
    /// Damping ratio of these springs
    #[arg(long, value_name = "RATIO", default_value_t = 1.0)]
    damping_ratio: f64,
    /// Way of the springs' ends, mm, by a smooth motion
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0", value_parser = numbers)]
    shift: Three,
    /// Force that the frame applies to what it touches, N
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0", value_parser = numbers)]
    force: Three,
    /// Time of the way, s
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0)]
    over: f64,
    /// Time until the end, s
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    seconds: f64,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Along x, y, z.
#[derive(Debug, Clone, Copy)]
struct Three([f64; 3]);

fn numbers(text: &str) -> Result<Three, Problem> {
    let parsed: Option<Vec<f64>> = (text.split(','))
        .map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    match parsed.as_deref() {
        Some(&[x]) => Ok(Three([x; 3])),
        Some(&[x, y, z]) => Ok(Three([x, y, z])),
        _ => Err(Problem::new(
            format!("{text:?} is not allowed"),
            "one number, or three with commas",
        )),
    }
}

/// Interval of references.
const INTERVAL: Duration = Duration::from_millis(4);
/// Time at the end over which pose and forces are averaged, s.
const AVERAGED_S: f64 = 0.5;

pub(crate) fn run(arguments: &CartesianArguments) -> ExitCode {
    end(go(arguments))
}

fn index(client: &Client, frame: &str) -> Result<usize, Failure> {
    let description = client.description();
    let names = description.frame_names.iter().map(|name| name.as_str());
    let names: Vec<&str> = names.take(description.frame_count as usize).collect();
    let found = names.iter().position(|name| *name == frame);
    found.ok_or_else(|| {
        let what = format!("robot {:?} has no frame {frame:?}", client.robot());
        let allowed = if names.is_empty() {
            "a table [[frame]] in its configuration".to_owned()
        } else {
            listed(names.iter().copied())
        };
        Failure::Argument(Problem::new(what, allowed))
    })
}

fn go(arguments: &CartesianArguments) -> Result<String, Failure> {
    for (what, seconds) in [("--over", arguments.over), ("--seconds", arguments.seconds)] {
        if !(seconds > 0.0 && seconds < 1e6) {
            let problem = Problem::new(format!("{what} {seconds}"), "above 0 s, below 1e6 s");
            return Err(Failure::Argument(problem));
        }
    }
    if !DAMPING_RATIOS.contains(&arguments.damping_ratio) {
        let what = format!("--damping-ratio {}", arguments.damping_ratio);
        let (least, most) = (DAMPING_RATIOS.start(), DAMPING_RATIOS.end());
        let problem = Problem::new(what, format!("{least} to {most}"));
        return Err(Failure::Argument(problem));
    }
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(arguments.robot.as_ref())?;
    let frame = index(&client, &arguments.frame)?;
    let mut commander = command(&mut client)?;
    commander.lead_frames(&mut client, &[frame])?;
    let start = commander.reference().frames[frame];
    let bar = bar();
    bar.set_length((1e3 * arguments.seconds) as u64);
    let begin = Instant::now();
    let mut sum = Mean::default();
    while !stop.load(Ordering::Relaxed) && begin.elapsed().as_secs_f64() < arguments.seconds {
        let t = begin.elapsed().as_secs_f64();
        let sent = commander.send(|reference| {
            reference.mode = Mode::Cartesian.number();
            reference.frames[frame] = at(&start, arguments, t);
        });
        sent.map_err(|error| beyond_limits(error, || cannot_be_led(&arguments.frame, t)))?;
        sleep(INTERVAL);
        if let Some(record) = client.latest()? {
            let shown = record.cycle.commanded.frames[frame];
            if t > arguments.seconds - AVERAGED_S && shown.flags & frame_flags::ACTIVE != 0 {
                sum.take(&shown);
            }
        }
        bar.set_position((1e3 * t) as u64);
        bar.set_message(format!("{:.1} s left", arguments.seconds - t));
    }
    bar.finish_and_clear();
    let stopped = stop.load(Ordering::Relaxed);
    commander.close()?;
    if stopped {
        return Err(Failure::Stopped("stopped; the robot holds".to_owned()));
    }
    Ok(sum.report(&start, arguments, client.robot()))
}

fn cannot_be_led(frame: &str, t: f64) -> Problem {
    Problem::new(
        format!("frame {frame:?} cannot be led so, refused after {t:.1} s"),
        "--stiffness, --turning-stiffness, --force and the velocity of --shift up to those of its table [[frame]] \
         (`torquectl check CONFIG`), and a --shift within the limb's reach",
    )
}

/// Reference of the frame after `t` seconds.
fn at(start: &FrameReference, arguments: &CartesianArguments, t: f64) -> FrameReference {
    let s = (t / arguments.over).min(1.0);
    // Of least jerk.
    let way = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    let rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / arguments.over;
    let mut frame = *start;
    for k in 0..3 {
        let shift = 1e-3 * arguments.shift.0[k];
        frame.position[k] += way * shift;
        frame.velocity[k] = rate * shift;
        // The environment's force on the frame is the opposite of the frame's.
        frame.force[k] = -arguments.force.0[k];
        if arguments.force.0[k] == 0.0 {
            frame.stiffness[k] = arguments.stiffness.0[k];
        } else {
            frame.force_axes |= 1 << k;
        }
        frame.stiffness[3 + k] = arguments.turning_stiffness.0[k];
    }
    frame.damping_ratio = arguments.damping_ratio;
    frame
}

/// Means at the end.
#[derive(Default)]
struct Mean {
    count: f64,
    position: [f64; 3],
    wrench: [f64; 6],
    felt: [f64; 6],
    flags: u32,
}

impl Mean {
    fn take(&mut self, frame: &FrameCommanded) {
        self.count += 1.0;
        let add = |sum: &mut [f64], x: &[f64]| {
            sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += x);
        };
        add(&mut self.position, &frame.position);
        add(&mut self.wrench, &frame.wrench);
        add(&mut self.felt, &frame.force_estimated);
        self.flags |= frame.flags;
    }

    fn report(
        &self,
        start: &FrameReference,
        arguments: &CartesianArguments,
        robot: &str,
    ) -> String {
        let mean = |x: f64| {
            if self.count > 0.0 {
                x / self.count
            } else {
                0.0
            }
        };
        let moved: [f64; 3] =
            std::array::from_fn(|k| 1e3 * (mean(self.position[k]) - start.position[k]));
        let (wrench, felt) = (self.wrench.map(mean), self.felt.map(mean));
        let limited = self.flags & (frame_flags::WRENCH_LIMITED | frame_flags::GAINS_LIMITED) != 0;
        let known = self.flags & frame_flags::FORCE_KNOWN != 0;
        if arguments.json {
            return format!(
                "{}\n",
                json!({
                    "robot": robot, "frame": arguments.frame, "moved_mm": moved,
                    "wrench": wrench, "felt": known.then_some(felt), "limited": limited,
                })
            );
        }
        let row = |x: &[f64]| {
            let numbers: Vec<String> = x.iter().map(|x| format!("{:8.2}", rounded(*x))).collect();
            numbers.join(" ")
        };
        let felt = if known {
            row(&felt)
        } else {
            "not known: no F/T sensor, and no external torques".to_owned()
        };
        let note = if limited {
            "springs or forces were limited: by [[frame]], or by the joints' stiffness\n"
        } else {
            ""
        };
        format!(
            "moved, mm            {}\nwrench, N and N·m    {}\nfelt, N and N·m      {felt}\n{note}",
            row(&moved),
            row(&wrench),
        )
    }
}
