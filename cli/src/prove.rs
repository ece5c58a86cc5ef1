//! `torquectl prove`: the first motion of each joint, a twentieth of a degree, compared with what it should show.

mod judge;
mod proof;

use crate::motion::{bar, catch_signals};
use crate::requests::{Failure, PATIENCE, command, connect, end};
use crate::words;
use judge::{Asked, Outcome, SHOWN, Seen, carried, judge, runs_away};
use problem::{Problem, Problems, listed};
pub(crate) use proof::outdated;
use proof::{Proof, Proven};
use robot_config::{JointParameters, Robot};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use terminal::TextTable;
use torqued_client::robot_state::{
    MAX_JOINTS, MeasuredRecord, RobotState, measured_flags, torque_flags,
};
use torqued_client::{Client, Commander, Error};

const HELP: &str = "\
One joint after the other goes 0.05 degrees (0.005 mm of a prismatic joint) away and back; where friction or a dead
zone swallows that, 0.2. Both encoders must show it: its direction, its size, and no other joint's motion. Where the
joint carries enough, the motor's current must show the model's torque. The first joint that shows something else
ends it, and the robot is asked to hold.

What was proven is kept in proven.toml beside CONFIG, with a hash of the joint's and its drive's tables:
`torquectl check` names joints whose tables have changed since. The robot must be enabled, hands off, and nothing
else may command it.

Examples:
  torquectl prove config/leg/robot.toml             all joints
  torquectl prove config/leg/robot.toml knee        one
  torquectl prove config/leg/robot.toml --json

Exit codes:
  0  every joint is proven
  1  a joint is not: which and why is printed; or torqued could not be reached, or did not follow
  2  bad input: configuration, or a joint that the robot does not have";

/// Prove wiring and directions of each joint by its first small motion
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ProveArguments {
    /// The configuration that torqued runs
    #[arg(value_name = "CONFIG")]
    config: PathBuf,
    /// Joints [default: all]
    #[arg(value_name = "JOINT")]
    joints: Vec<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Ways that are asked for one after the other until the joint has moved, rad; of prismatic joints a tenth in m. The
/// first is less than the wind-up of a gear at its torque limit, the second more than the dead zones of drives.
const WAYS: [f64; 2] = [0.05 * PER_DEGREE, 0.2 * PER_DEGREE];
const PER_DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Records whose mean is where a joint stands: noise of a count is a tenth of one then.
const MEAN: usize = 100;

pub(crate) fn run(arguments: &ProveArguments) -> ExitCode {
    let name = arguments.config.display().to_string();
    let robot = match robot_config::load(&name, &|path| terminal::read_text(path)) {
        Ok(robot) => robot,
        Err(Problems(problems)) => {
            for problem in problems {
                eprintln!("{problem}");
            }
            return ExitCode::from(crate::BAD_INPUT);
        }
    };
    end(go(arguments, &robot))
}

/// Where joints stand, and what they carry.
struct Standing {
    /// theta/N and q, rad or m.
    angles: Vec<[f64; 2]>,
    /// Torques by motor current and by F/T sensors and model, N·m; none where one of them is not valid.
    torques: Vec<Option<[f64; 2]>>,
    /// Sum of both standard deviations, N·m.
    sigmas: Vec<f64>,
}

fn go(arguments: &ProveArguments, robot: &Robot) -> Result<String, Failure> {
    let joints = &robot.parameters.joints;
    let chosen = chosen(&arguments.joints, joints).map_err(Failure::Argument)?;
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(Some(&robot.parameters.name))?;
    same_joints(&client, joints).map_err(Failure::Argument)?;
    let mut commander = command(&mut client)?;
    let mut proof = Proof::read(&arguments.config).map_err(Failure::Argument)?;
    let bar = bar();
    bar.set_length(chosen.len() as u64);
    let mut rows = Vec::new();
    let mut ended = Ok(());
    for &j in &chosen {
        bar.set_message(joints[j].name.clone());
        match prove(j, joints, &mut client, &mut commander, &stop) {
            Ok(Ok(proven)) => {
                proof.take(robot, j, &proven);
                rows.push((j, proven));
            }
            Ok(Err(why)) => {
                let reason = format!("joint `{}` {why}", joints[j].name);
                ended = Err(Failure::Stopped(reason));
            }
            Err(e) => ended = Err(e),
        }
        bar.inc(1);
        if ended.is_err() {
            break;
        }
    }
    bar.finish_and_clear();
    // What was proven before stays so.
    proof.write().map_err(Failure::Argument)?;
    ended?;
    commander.close()?;
    holds(&mut client)?;
    Ok(if arguments.json {
        let joints = rows
            .iter()
            .map(|(j, proven)| (joints[*j].name.clone(), proven.json()));
        format!(
            "{:#}\n",
            json!({ "joints": joints.collect::<serde_json::Map<_, _>>() })
        )
    } else {
        table(joints, &rows)
    })
}

/// Waits until the record shows that the robot holds.
fn holds(client: &mut Client) -> Result<(), Failure> {
    let until = Instant::now() + PATIENCE;
    loop {
        let state = client.next_record(PATIENCE)?.cycle.state;
        if state == RobotState::Holding.number() {
            return Ok(());
        }
        if Instant::now() > until {
            let reason = format!(
                "proven, but the robot is {}, not holding",
                words::state(state)
            );
            return Err(Failure::Stopped(reason));
        }
    }
}

/// Joints by their names, or all of them.
fn chosen(names: &[String], joints: &[JointParameters]) -> Result<Vec<usize>, Problem> {
    if names.is_empty() {
        return Ok((0..joints.len()).collect());
    }
    let place = |name: &String| {
        let found = joints.iter().position(|joint| joint.name == *name);
        found.ok_or_else(|| {
            let known = listed(joints.iter().map(|joint| joint.name.as_str()));
            Problem::new(format!("the robot has no joint {name:?}"), known)
        })
    };
    names.iter().map(place).collect()
}

/// The daemon runs a robot with these joints.
fn same_joints(client: &Client, joints: &[JointParameters]) -> Result<(), Problem> {
    let description = client.description();
    let names = description
        .joint_names
        .iter()
        .take(description.joint_count as usize);
    let same = names.len() == joints.len()
        && names
            .zip(joints)
            .all(|(name, joint)| name.as_str() == joint.name);
    if same {
        return Ok(());
    }
    let reason = "the daemon runs a robot with other joints";
    Err(Problem::new(
        reason,
        "the configuration that it was started with",
    ))
}

/// Moves one joint a little and back; why it is not proven, in words that follow its name.
fn prove(
    j: usize,
    joints: &[JointParameters],
    client: &mut Client,
    commander: &mut Commander,
    stop: &AtomicBool,
) -> Result<Result<Proven, String>, Failure> {
    let joint = &joints[j];
    let mut why = String::new();
    for way in WAYS {
        let before = standing(client, joints)?;
        // A current against the weight needs no motion to be seen; friction that carries some of it is sound.
        if let Err(words) = carried(before.torques[j], before.sigmas[j], -SHOWN) {
            return Ok(Err(words));
        }
        let q = before.angles[j][1];
        // Away from the nearer limit.
        let middle = 0.5 * (joint.limits.position_min + joint.limits.position_max);
        let step = joint.kind.threshold(way) * if q > middle { -1.0 } else { 1.0 };
        let asked = Asked::new(joint, step);
        let mut astray = None;
        let arrived = go_by(j, step, commander, |_| {
            if let Ok(Some(record)) = client.latest() {
                let now = angles(joints, &record.cycle.measured);
                let moved = [0, 1].map(|side| now[j][side] - before.angles[j][side]);
                astray = astray.take().or_else(|| runs_away(&asked, moved));
            }
            astray.is_none() && !stop.load(Ordering::Relaxed)
        });
        let arrived = match arrived {
            Err(error @ Error::NotFollowed { .. }) => {
                return Ok(Err(not_followed(&error, j, client, joints)));
            }
            other => other?,
        };
        if let Some(words) = astray {
            return Ok(Err(words));
        }
        if !arrived {
            return Err(Failure::Stopped("stopped on its way".to_owned()));
        }
        let after = standing(client, joints)?;
        let seen = Seen::new(j, joints, (&before.angles, &after.angles))
            .carrying(after.torques[j], after.sigmas[j]);
        let proven = match judge(&asked, &seen) {
            // It stays where it is: back would be another motion of what is wrong.
            Outcome::Wrong(words) => return Ok(Err(words)),
            Outcome::TooLittle(words) => Err(words),
            Outcome::Proven(proven) => Ok(proven),
        };
        go_by(j, -step, commander, |_| !stop.load(Ordering::Relaxed))?;
        match proven {
            Ok(proven) => return Ok(Ok(proven)),
            Err(words) => why = words,
        }
    }
    Ok(Err(why))
}

/// Why a joint whose motion the daemon has ended is not proven: what its current shows where it then stands, or the
/// daemon's own reason.
fn not_followed(
    error: &Error,
    j: usize,
    client: &mut Client,
    joints: &[JointParameters],
) -> String {
    let shown = standing(client, joints).ok();
    let shown = shown.and_then(|after| carried(after.torques[j], after.sigmas[j], SHOWN).err());
    shown.unwrap_or_else(|| format!("was asked to move: {error}"))
}

/// Moves one joint by a way, from where its set-point stands.
fn go_by(
    j: usize,
    way: f64,
    commander: &mut Commander,
    going: impl FnMut(Duration) -> bool,
) -> Result<bool, Error> {
    let change = |reference: &mut torqued_client::robot_state::Reference| {
        reference.joints[j].q_d += way;
    };
    commander.go_to(change, going)
}

/// theta/N and q of every joint.
fn angles(joints: &[JointParameters], measured: &MeasuredRecord) -> Vec<[f64; 2]> {
    let measured = joints.iter().zip(&measured.joints);
    let angles = measured.map(|(joint, m)| [m.theta / joint.encoders.gear_ratio, m.q]);
    angles.collect()
}

/// Means over the next records.
fn standing(client: &mut Client, joints: &[JointParameters]) -> Result<Standing, Failure> {
    let n = joints.len().min(MAX_JOINTS);
    let mut sums = vec![[0.0; 2]; n];
    let mut torques = vec![Some([0.0; 2]); n];
    let mut sigmas = vec![0.0; n];
    client.latest()?;
    for _ in 0..MEAN {
        let record = client.next_record(PATIENCE)?;
        for (j, now) in angles(joints, &record.cycle.measured)
            .into_iter()
            .enumerate()
        {
            let unusable = measured_flags::NEVER | measured_flags::STALE;
            if record.cycle.measured.joints[j].flags & unusable != 0 {
                let reason = format!("joint `{}` sends no samples", joints[j].name);
                return Err(Failure::Stopped(reason));
            }
            for (sum, now) in sums[j].iter_mut().zip(now) {
                *sum += now / MEAN as f64;
            }
            let estimated = &record.cycle.estimated.joints[j];
            let both = [&estimated.tau_current, &estimated.tau_whole_body];
            let valid = both.iter().all(|e| e.flags & torque_flags::VALID != 0);
            sigmas[j] += both.iter().map(|e| e.sigma).sum::<f64>() / MEAN as f64;
            torques[j] = torques[j].filter(|_| valid).map(|mut sum| {
                for (sum, estimate) in sum.iter_mut().zip(both) {
                    *sum += estimate.tau / MEAN as f64;
                }
                sum
            });
        }
    }
    Ok(Standing {
        angles: sums,
        torques,
        sigmas,
    })
}

fn table(joints: &[JointParameters], proven: &[(usize, Proven)]) -> String {
    let heading = ["joint", "asked deg", "motor deg", "link deg", "current"];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    for (j, proven) in proven {
        let kind = joints[*j].kind;
        let shown = |x: f64| crate::units::cell(kind, format!("{:.4}", kind.shown(x)), "deg");
        rows.push(vec![
            joints[*j].name.clone(),
            shown(proven.asked),
            shown(proven.motor),
            proven.link.map_or_else(|| "-".to_owned(), shown),
            proven.current.to_owned(),
        ]);
    }
    let mut text = TextTable(rows).to_string();
    let _ = writeln!(text, "\nproven; the robot holds");
    text
}
