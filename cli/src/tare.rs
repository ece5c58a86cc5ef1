//! `torquectl tare`: offsets of F/T sensors, found with the robot at rest.

use crate::requests::{Failure, ask, check_contacts, connect, end};
use jiff::Timestamp;
use problem::Problem;
use serde_json::{Value, json};
use std::process::ExitCode;
use terminal::TextTable;
use torqued_client::Client;
use torqued_client::robot_state::{Answer, TaredSensor, Wrench, request};

const AXES: [&str; 6] = ["fx N", "fy N", "fz N", "tx N·m", "ty N·m", "tz N·m"];

const HELP: &str = "\
The robot must run, hold its position and stand still. --contacts names its present contact set, a
[[contacts]] table of robot.toml. A tare determines offsets from the parts that nothing touches
(type \"none\"):
  in the air, held by its harness   every offset beyond the harness's part
  on one foot, nothing else         every offset
  on both feet, nothing else        the hands, and the sum of the feet
A component that cannot be determined in this pose is shown as \"unknown\" and keeps its offset.
New offsets take effect at once, without a step, and are kept after a restart.

--joint and --torque: the joint stands still under a torque that is known, e.g. 0 where it hangs free.
The zeros of its calibrated torsion and motor current follow; until torqued ends, as an encoder's zero
may be another one then.

Examples:
  torquectl tare --contacts in_the_air
  torquectl tare --robot humanoid --contacts in_the_air --json
  torquectl tare --joint elbow --torque 0
  torquectl tare --show
  torquectl tare --forget

Exit codes:
  0  done
  1  torqued refused and gave a reason (e.g. the robot moves), or could not be reached
  2  bad input: arguments, or a contact set that the robot does not have";

/// Tare the F/T sensors of a running robot that stands still, or show the last tare.
#[derive(clap::Args)]
#[command(after_help = HELP)]
#[group(skip)]
pub(crate) struct TareArguments {
    #[command(flatten)]
    what: What,
    /// Torque that the joint carries, N·m
    #[arg(
        long,
        value_name = "TAU",
        requires = "joint",
        allow_negative_numbers = true
    )]
    torque: Option<f64>,
    /// How well that is known, as a standard deviation, N·m [default: a fiftieth of TAU, and 0.1]
    #[arg(long, value_name = "SIGMA", requires = "joint")]
    sigma: Option<f64>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct What {
    /// Tare with this contact set
    #[arg(long, value_name = "NAME")]
    contacts: Option<String>,
    /// Show the present offsets and the date of the last tare
    #[arg(long)]
    show: bool,
    /// Discard the offsets of all tares; those of the configuration hold again
    #[arg(long)]
    forget: bool,
    /// Tare the calibrated gear of this joint instead, which carries a known torque
    #[arg(long, value_name = "NAME", requires = "torque")]
    joint: Option<String>,
}

pub(crate) fn run(arguments: &TareArguments) -> ExitCode {
    end(tare(arguments))
}

fn tare(arguments: &TareArguments) -> Result<String, Failure> {
    let client = connect(arguments.robot.as_ref())?;
    if let (Some(joint), Some(torque)) = (&arguments.what.joint, arguments.torque) {
        let sigma = arguments.sigma.unwrap_or((0.02 * torque).hypot(0.1));
        return tare_joint(&client, joint, torque, sigma, arguments.json);
    }
    let (answer, changed) = match &arguments.what.contacts {
        Some(name) => {
            check_contacts(&client, name, "")?;
            (ask(&client, request::TARE, name)?, true)
        }
        None if arguments.what.show => (client.last_tare()?, false),
        None => (client.forget_tare()?, true),
    };
    Ok(if arguments.json {
        format!("{}\n", as_json(&client, &answer))
    } else {
        format!("{}\n{}", answer.text, table(&client, &answer, changed))
    })
}

fn tare_joint(
    client: &Client,
    joint: &str,
    torque: f64,
    sigma: f64,
    json: bool,
) -> Result<String, Failure> {
    let description = client.description();
    let names = description.joint_names.iter().map(|name| name.as_str());
    let names: Vec<&str> = names.take(description.joint_count as usize).collect();
    let Some(place) = names.iter().position(|name| *name == joint) else {
        let what = format!("the robot has no joint {joint:?}");
        return Err(Failure::Argument(Problem::new(what, names.join(", "))));
    };
    let answer = client.tare_joint(place, torque, sigma)?;
    Ok(if json {
        let object = json!({
            "robot": client.robot(), "joint": joint, "torque_Nm": torque, "sigma_Nm": sigma,
        });
        let object = crate::units::keys(description.joint_kind(place), object);
        format!("{object}\n")
    } else {
        format!("{}\n", answer.text)
    })
}

fn sensors<'a>(
    client: &'a Client,
    answer: &'a Answer,
) -> impl Iterator<Item = (&'a str, &'a TaredSensor)> {
    let names = client.description().ft_names.iter().map(|n| n.as_str());
    names.zip(&answer.ft).take(answer.ft_count as usize)
}

fn table(client: &Client, answer: &Answer, changed: bool) -> TextTable {
    let mut heading = vec!["F/T sensor", "axis", "offset"];
    if changed {
        heading.push("before");
    }
    heading.push("±");
    let mut rows = vec![heading.into_iter().map(str::to_owned).collect()];
    let tared = answer.date_unix_s > 0.0;
    for (name, sensor) in sensors(client, answer) {
        let [offset, before, sigma] =
            [&sensor.offset, &sensor.before, &sensor.sigma].map(Wrench::to_array);
        for (k, axis) in AXES.iter().enumerate() {
            let number = |x: f64| {
                if k < 3 {
                    format!("{x:.2}")
                } else {
                    format!("{x:.3}")
                }
            };
            let first = if k == 0 { name } else { "" };
            let mut row = vec![first.to_owned(), (*axis).to_owned(), number(offset[k])];
            if changed {
                row.push(number(before[k]));
            }
            row.push(match (tared, sensor.known >> k & 1) {
                (false, _) => "-".to_owned(),
                (true, 0) => "unknown".to_owned(),
                (true, _) => number(sigma[k]),
            });
            rows.push(row);
        }
    }
    TextTable(rows)
}

fn as_json(client: &Client, answer: &Answer) -> Value {
    let date = (answer.date_unix_s > 0.0)
        .then(|| Timestamp::from_second(answer.date_unix_s as i64).ok())
        .flatten();
    let wrench = |w: &Wrench| json!({ "force_N": w.force, "torque_Nm": w.torque });
    let sensor = |(name, sensor): (&str, &TaredSensor)| {
        json!({
            "name": name,
            "offset": wrench(&sensor.offset),
            "before": wrench(&sensor.before),
            "sigma": wrench(&sensor.sigma),
            "known": (0..6).map(|k| sensor.known >> k & 1 == 1).collect::<Vec<_>>(),
        })
    };
    json!({
        "robot": client.robot(),
        "date": date.map(|date| date.to_string()),
        "contacts": date.map(|_| answer.contact_set.as_str()),
        "ft": sensors(client, answer).map(sensor).collect::<Vec<_>>(),
    })
}
