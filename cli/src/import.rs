//! `torquectl import`: anyone's logs as the logs that fits, estimates and references take.

mod bag;
mod columns;
mod formats;
mod map;
mod resample;

use crate::output::{apart, finish_or_refuse, read_input};
use clap::Args;
use columns::Table;
use inspection::Severity;
use map::{Channel, Map};
use problem::{Problem, Problems};
use resample::{Column, Grid};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Convert logs (CSV, MCAP, rosbag2's SQLite) by a map of their columns, units, signs and ratios
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct ImportArguments {
    /// Which column is what, in which unit (TOML, see --help)
    map: PathBuf,
    /// The logs (CSV with a header, or MCAP or .db3 of ROS 2)
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Convert a log though a channel in it is not what it claims to be
    #[arg(long)]
    accept: bool,
    /// Folder for the converted logs; made if it is not there
    #[arg(short, long)]
    out: PathBuf,
}

const FORMAT: &str = r#"The map, where * marks required keys:
  sample_rate_hz* = 250            # the logs are resampled to it, without delay
  max_gap_ms = 20                  # rows in longer gaps are left out; by default five periods
  delimiter = ","                  # by default as the log's header shows
  [time]*                          # of CSV alone: messages of MCAP have stamps
  column* = "t_s"
  unit* = "s" | "ms" | "us" | "ns"
  plus = [{ column = "nanosec", unit = "ns" }]   # further columns that add to the stamp
  [[joint]]                        # any number
  name* = "knee"
  gear_ratio = 101                 # needed where theta is measured on the link side
  theta* = { column = "motor3", unit = "counts", counts_per_turn = 16777216, sign = -1 }
  q*     = { column = "link3", unit = "deg", wraps = true }
  i*     = { column = "current3", unit = "mA" }
  tau_sensor = { column = "fx", unit = "1", scale = -0.87, plus = [{ column = "ty", unit = "Nm" }] }
  tau_feedforward = { column = "ff3", unit = "Nm" }   # what controller or rigid-body model expects
  [joint.extra]
  angle = { column = "q3", unit = "rad" }
  [[ft_sensor]]
  name* = "flange"
  columns* = ["fx", "fy", "fz", "tx", "ty", "tz"]   # N and N·m
  signs = [1, 1, -1, 1, 1, -1]
  [imu]
  gyro* = ["wx", "wy", "wz"]
  accelerometer* = ["ax", "ay", "az"]
  gyro_unit = "rad/s" | "deg/s"
  accelerometer_unit = "m/s2" | "g"
Keys of a channel: column*, unit* (theta, q: rad, deg, turns, counts; i: A, mA; torques: Nm, mNm, kNm;
"1": as scale makes it), scale, sign (1 or -1), offset (SI, added last), counts_per_turn,
wraps = true (single turn: is unwrapped), delay_ms (late against its stamps), side = "link" (theta: times gear_ratio), plus = [channels],
time = { column = "t2", unit = "s" } (stamps other than those of [time]; of sensors and IMU too).
In CSV a column has the stamps of the rows in which it is not empty or nan, so that topics may have rows
of their own. Delimiters are comma, semicolon, tab, bar or spaces, numbers have decimal points or commas.

Columns of a recording (MCAP, .db3): TOPIC:JOINT.position, TOPIC:JOINT.velocity and TOPIC:JOINT.effort of a
JointState, TOPIC:fx to TOPIC:tz of a WrenchStamped, TOPIC:gx to gz and ax to az of an Imu (ROS 2, cdr);
each topic has stamps of its own.

Every channel is inspected: wraps are taken out, samples that no neighbour confirms and readings that were
kept are left out, each said with its row and time; an encoder that loses its zero is refused, unless --accept.

Writes OUT/LOG.JOINT.csv with t,theta,q,i[,tau_sensor][,tau_feedforward][,extra] for each log and joint, and OUT/LOG.csv
with JOINT.theta, JOINT.q, JOINT.i, SENSOR.fx to SENSOR.tz and imu.gx to imu.az for
`torquectl reference`. Signs: theta/N - q > 0 for positive torque.

Examples:
  torquectl import lara8.toml sweep.csv jog_joints.csv -o logs
  torquectl fit current --joint joint3.toml --log logs/sweep.joint3.csv -o joint3.toml
docs/importing.md has maps of published data."#;

pub(crate) fn run(arguments: &ImportArguments) -> ExitCode {
    finish_or_refuse(import(arguments))
}

fn import(arguments: &ImportArguments) -> Result<String, Problems> {
    let file = arguments.map.display().to_string();
    let map = Map::parse(&read_input(&arguments.map)?, &file)?;
    // Everything is read before anything is written.
    let mut files = Vec::new();
    for log in &arguments.logs {
        files.extend(convert(&map, log, arguments.accept)?);
    }
    let mut names: Vec<&String> = files.iter().map(|(name, _)| name).collect();
    names.sort();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        let reason = format!("two logs would be written to {}", twice[0]);
        return Err(Problem::new(reason, "logs of different names").into());
    }
    let unwritable = |e, path: &Path| Problem::unwritable(path.display(), &e);
    std::fs::create_dir_all(&arguments.out).map_err(|e| unwritable(e, &arguments.out))?;
    for (name, _) in &files {
        apart(&arguments.out.join(name), &arguments.logs)?;
    }
    let mut report = String::new();
    for (name, text) in &files {
        let path = arguments.out.join(name);
        terminal::write_file(&path, text)?;
        let _ = writeln!(
            report,
            "{}: {} rows",
            path.display(),
            text.lines().count() - 1
        );
    }
    Ok(report)
}

/// Median step of a column over the longest gap from which its stamps are in another unit than the map has.
const SPARSE: f64 = 1.5;

/// Mean step of a column, s, below which its stamps are in another unit than the map has: no log has 50,000 rows a
/// second.
const DENSE: f64 = 2e-5;

/// The converted files of one log: names and texts.
fn convert(map: &Map, log: &Path, accept: bool) -> Result<Vec<(String, String)>, Problems> {
    let table = Table::read(log, map)?;
    let file = log.display().to_string();
    let stem = log
        .file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let mut problems = Vec::new();
    let mut columns: Vec<(String, Column)> = Vec::new();
    let mut take = |name: String, column: Result<Column, Problem>| match column {
        Ok(mut column) => {
            let count = column.t.len();
            for finding in column.inspect(&name) {
                if finding.severity == Severity::Refused && !accept {
                    problems.push(finding.problem(&file, |row| table.line(row, count)));
                } else {
                    eprintln!("warning: {file}: {finding}");
                }
            }
            columns.push((name, column));
        }
        Err(problem) => problems.push(problem),
    };
    for joint in &map.joints {
        for (key, channel) in joint.channels() {
            let column = column(&table, map, channel, joint.gear_ratio, &key);
            take(format!("{}.{key}", joint.name), column);
        }
    }
    for axis in map.sensor_columns() {
        let column = table.column(axis.column, axis.time, map);
        take(axis.name, column.map(|c| c.scaled(axis.factor)));
    }
    if !problems.is_empty() {
        return Err(Problems(problems));
    }
    for (name, column) in &columns {
        if let Some(time) = column
            .duration()
            .filter(|time| *time < DENSE * (column.t.len() - 1) as f64)
        {
            let reason = format!(
                "{name} has {} values within {time:.6} s: unit of its stamps?",
                column.t.len()
            );
            return Err(Problem::new(reason, "stamps in the map's unit")
                .at(file, 0)
                .into());
        }
    }
    let grid = Grid::new(map, columns.iter().map(|(_, c)| c), &file)?;
    for (name, column) in &columns {
        let (step, most) = (column.step(), map.max_gap());
        if step > SPARSE * most {
            let reason = format!(
                "{name} has a value each {step:.6} s, where `max_gap_ms` is {:.3}: unit of its stamps?",
                1e3 * most
            );
            let allowed = format!(
                "stamps in the map's unit, `sample_rate_hz` ({}) near the log's rate, or a longer `max_gap_ms`",
                map.sample_rate
            );
            return Err(Problem::new(reason, allowed).at(file, 0).into());
        }
    }
    let resampled: Vec<(String, Vec<f64>)> = (columns.into_iter())
        .map(|(name, column)| (name, grid.resample(&column)))
        .collect();
    let mut files = vec![(format!("{stem}.csv"), text(&grid, &resampled, ""))];
    for joint in &map.joints {
        let prefix = format!("{}.", joint.name);
        files.push((
            format!("{stem}.{}.csv", joint.name),
            text(&grid, &resampled, &prefix),
        ));
    }
    for (name, text) in &files {
        let (kept, all) = (text.lines().count() - 1, grid.stamps().count());
        if 2 * kept < all {
            eprintln!(
                "warning: {name}: {kept} of {all} rows are kept, others lie in gaps longer than max_gap_ms"
            );
        }
    }
    Ok(files)
}

/// One channel in SI units, its own stamps.
fn column(
    table: &Table,
    map: &Map,
    channel: &Channel,
    gear_ratio: Option<f64>,
    key: &str,
) -> Result<Column, Problem> {
    let of_map = |p: Problem| p.or_at(&map.file, channel.line(map));
    let factor = channel.factor(gear_ratio, key).map_err(of_map)?;
    let mut source = table.column(&channel.column, channel.time.as_ref(), map)?;
    if channel.wraps {
        let unwrapped = source.unwrap(channel.turn().map_err(of_map)?, map.max_gap());
        unwrapped.map_err(|t| {
            let reason =
                format!("{key}: wraps = true, but turns before t = {t} s cannot be counted");
            of_map(Problem::new(
                reason,
                "at most 0.4 turns between samples, and in gaps",
            ))
        })?;
    }
    let mut whole = source.scaled(factor);
    whole.t.iter_mut().for_each(|t| *t -= channel.delay());
    whole.values.iter_mut().for_each(|x| *x += channel.offset);
    for part in &channel.plus {
        let part = column(table, map, part, gear_ratio, key)?;
        if part.t != whole.t {
            let reason = format!("{key}: `plus` adds a column with other stamps");
            return Err(of_map(Problem::new(reason, "columns of one message")));
        }
        (whole.values.iter_mut().zip(&part.values)).for_each(|(x, y)| *x += y);
    }
    Ok(whole)
}

/// CSV of the columns whose names begin with a prefix, rows complete only.
fn text(grid: &Grid, columns: &[(String, Vec<f64>)], prefix: &str) -> String {
    let chosen: Vec<(&str, &Vec<f64>)> = (columns.iter())
        .filter_map(|(name, values)| Some((name.strip_prefix(prefix)?, values)))
        .collect();
    let mut text = "t".to_owned();
    chosen.iter().for_each(|(name, _)| text.extend([",", name]));
    text.push('\n');
    for (k, t) in grid.stamps().enumerate() {
        if chosen.iter().all(|(_, values)| values[k].is_finite()) {
            let _ = write!(text, "{t}");
            for (_, values) in &chosen {
                let _ = write!(text, ",{}", values[k]);
            }
            text.push('\n');
        }
    }
    text
}
