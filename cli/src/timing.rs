//! `torquectl timing`: where the time of a running robot's cycles goes, and what made cycles late.

use crate::NO_DAEMON;
use problem::Problem;
use serde_json::Value;
use std::fmt::Write;
use std::io::ErrorKind;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;
use terminal::TextTable;
use torqued_client::{Location, TimingFile, running_daemons};

/// The daemon writes its times anew that often.
const INTERVAL: Duration = Duration::from_secs(1);
/// Late cycles that the page shows one by one.
const SHOWN: usize = 10;

const EXAMPLES: &str = "\
Examples:
  torquectl timing
  torquectl timing --watch
  torquectl timing --json | jq '.late_by_cause'

Times since the daemon's start, anew each second. A late cycle is one that ended after the next should have begun.
It is laid to the phase that took the most time beyond its usual one: to a stage of the computation, to a bus and
the joint that did not answer or answered last, or to the system.

Exit codes:
  0  done
  1  no daemon runs";

/// Show where the time of a running robot's cycles goes, and what made cycles late.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct TimingArguments {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Show it anew each second, until the daemon ends
    #[arg(long)]
    watch: bool,
    /// Print JSON instead of text, one object per line: with histograms
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &TimingArguments) -> ExitCode {
    match show(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::from(NO_DAEMON)
        }
    }
}

fn show(arguments: &TimingArguments) -> Result<(), Problem> {
    let mut shown = false;
    loop {
        let times = match times(arguments.robot.as_deref()) {
            Ok(times) => times,
            // The daemon that was watched has ended.
            Err(_) if shown => return Ok(()),
            Err(why) => return Err(why),
        };
        let text = if arguments.json {
            format!("{times}\n")
        } else {
            page(&times)
        };
        terminal::print(&text).map_err(|e| Problem::unwritable("standard output", &e))?;
        shown = true;
        if !arguments.watch {
            return Ok(());
        }
        sleep(INTERVAL);
    }
}

/// Times of the robot of that name, or of the only one.
///
/// # Errors
/// No such daemon runs, or several do and none is named.
pub(crate) fn times(robot: Option<&str>) -> Result<Value, Problem> {
    let place = Location::default_path();
    let allowed = "a robot whose torqued runs: `torqued run CONFIG`";
    let refused = |e: std::io::Error| {
        Problem::new(format!("{} cannot be read: {e}", place.display()), allowed)
    };
    let running = match running_daemons(&place) {
        Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
        found => found.map_err(refused)?,
    };
    let names: Vec<&str> = running.iter().map(|daemon| daemon.robot.as_str()).collect();
    let name = match (robot, names.as_slice()) {
        (Some(robot), names) if names.contains(&robot) => robot,
        (Some(robot), _) => {
            return Err(Problem::new(
                format!("no torqued of robot `{robot}` runs"),
                allowed,
            ));
        }
        (None, [only]) => only,
        (None, []) => return Err(Problem::new("no torqued runs", allowed)),
        (None, names) => {
            return Err(Problem::new(
                "several robots run",
                format!("--robot with one of {}", names.join(", ")),
            ));
        }
    };
    let wait = "a daemon of this version";
    let text = TimingFile::read(&place, name)
        .map_err(|e| Problem::new(format!("no times of `{name}`: {e}"), wait))?;
    let mut times: Value = serde_json::from_str(&text)
        .map_err(|e| Problem::new(format!("times of `{name}`: {e}"), "JSON"))?;
    times["robot"] = name.into();
    Ok(times)
}

fn page(times: &Value) -> String {
    let number = |value: &Value| {
        value
            .as_f64()
            .map_or_else(|| "-".to_owned(), |number| format!("{number:.1}"))
    };
    let heading = ["phase", "p50 us", "p99 us", "p99.9 us", "max us"]
        .map(str::to_owned)
        .to_vec();
    let mut rows = vec![heading];
    for phase in times["phases"].as_array().into_iter().flatten() {
        let mut row = vec![phase["name"].as_str().unwrap_or_default().to_owned()];
        row.extend(
            ["p50_us", "p99_us", "p999_us", "max_us"].map(|quantile| number(&phase[quantile])),
        );
        rows.push(row);
    }
    let name = times["robot"].as_str().unwrap_or_default();
    let mut page = format!(
        "{name}: {} cycles, {} late, {} left out\n{}",
        times["cycles"],
        times["late_cycles"],
        times["skipped_cycles"],
        TextTable(rows)
    );
    let causes = times["late_by_cause"].as_object();
    if let Some(causes) = causes.filter(|causes| !causes.is_empty()) {
        page.push_str("late cycles by cause\n");
        let mut causes: Vec<_> = causes.iter().collect();
        causes.sort_by_key(|(_, count)| std::cmp::Reverse(count.as_u64()));
        for (cause, count) in causes {
            let _ = writeln!(page, "  {count:>6}  {cause}");
        }
        page.push_str("the last of them\n");
        let last = times["last_late_cycles"].as_array();
        for late in last.into_iter().flatten().rev().take(SHOWN) {
            let [cycle, phase, cause] = [&late["cycle"], &late["phase"], &late["cause"]];
            let [phase, cause] = [phase, cause].map(|text| text.as_str().unwrap_or_default());
            let _ = writeln!(
                page,
                "  cycle {cycle}: {phase} took {} us; {cause}",
                number(&late["phase_us"])
            );
        }
    }
    page
}

#[cfg(test)]
mod tests {
    use super::page;
    use serde_json::json;

    #[test]
    fn the_page_names_phases_and_causes() {
        let times = json!({
            "robot": "leg", "cycles": 1000, "late_cycles": 2, "skipped_cycles": 1,
            "phases": [{ "name": "gather", "p50_us": 400.04, "p99_us": 410.0, "p999_us": 411.0, "max_us": 900.0 }],
            "late_by_cause": { "bus: joint knee on bus a answered last": 2 },
            "last_late_cycles": [
                { "cycle": 7, "phase": "gather", "phase_us": 900.0, "cause": "bus: joint knee on bus a answered last" },
            ],
        });
        let text = page(&times);
        for part in [
            "leg: 1000 cycles, 2 late, 1 left out",
            "400.0",
            "joint knee on bus a",
            "cycle 7: gather took 900.0 us",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
