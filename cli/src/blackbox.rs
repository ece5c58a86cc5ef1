//! `torquectl blackbox`: the seconds around a fault, from the file that torqued has written.

mod analysis;
mod report;

use crate::output::{apart, finish_or_refuse};
use analysis::BlackBox;
use problem::{Problem, Problems};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::TextTable;
use torqued_client::StateDirectory;

const HELP: &str = "\
torqued keeps the last seconds of every run in memory and writes 2 s before each newly latched fault
and 0.5 s after it into STATE/ROBOT/blackbox, the newest 20 of them. STATE is $STATE_DIRECTORY, else
$XDG_STATE_HOME/torqued, else ~/.local/state/torqued, as for the daemon. A black box is a recorded
run: torquectl info, export and replay read it too, as do PlotJuggler and Foxglove. Of any other
recorded run the first fault is shown, or that there is none.

Examples:
  torquectl blackbox
  torquectl blackbox newest
  torquectl blackbox 2026-11-22T02-30-15.123Z_104_joint_stale.mcap
  torquectl blackbox newest --json | jq .first
  torquectl blackbox newest --csv timeline.csv

Exit codes:
  0  shown
  2  bad input: no such file, not a recorded run, of another version";

/// Show what led to a fault and what followed, or list the black boxes.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct BlackboxArguments {
    /// The black box: a path, its name in the list, or `newest`; without it they are listed
    file: Option<PathBuf>,
    /// Only black boxes of this robot
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Write the time line into this CSV file too
    #[arg(long, value_name = "FILE", requires = "file")]
    csv: Option<PathBuf>,
}

pub(crate) fn run(arguments: &BlackboxArguments) -> ExitCode {
    finish_or_refuse(match &arguments.file {
        Some(file) => show(file, arguments),
        None => list(arguments),
    })
}

/// A black box in a state directory.
struct Kept {
    robot: String,
    path: PathBuf,
    bytes: u64,
}

impl Kept {
    fn name(&self) -> String {
        let name = self.path.file_name();
        name.map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }
}

/// The black boxes that are kept, oldest first.
fn kept(robot: Option<&String>) -> Result<Vec<Kept>, Problem> {
    let mut kept = Vec::new();
    for (name, directory) in StateDirectory::all()? {
        if robot.is_some_and(|robot| *robot != name) {
            continue;
        }
        // A robot without faults has no such folder.
        let entries = std::fs::read_dir(directory.file("blackbox"));
        for entry in entries.into_iter().flatten().flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|ending| ending == "mcap") {
                let bytes = entry.metadata().map_or(0, |metadata| metadata.len());
                let robot = name.clone();
                kept.push(Kept { robot, path, bytes });
            }
        }
    }
    // Names begin with the date.
    kept.sort_by_key(Kept::name);
    Ok(kept)
}

fn list(arguments: &BlackboxArguments) -> Result<String, Problems> {
    let kept = kept(arguments.robot.as_ref())?;
    if arguments.json {
        let objects = kept.iter().map(|kept| {
            let path = kept.path.display().to_string();
            serde_json::json!({ "robot": kept.robot, "path": path, "bytes": kept.bytes })
        });
        return Ok(format!("{}\n", serde_json::Value::from_iter(objects)));
    }
    if kept.is_empty() {
        return Ok("no black box: no fault has been latched, or none could be kept\n".to_owned());
    }
    let heading = ["robot", "MB", "black box"].map(str::to_owned).to_vec();
    let rows = kept.iter().map(|kept| {
        let size = format!("{:.1}", kept.bytes as f64 * 1e-6);
        vec![kept.robot.clone(), size, kept.name()]
    });
    let table = TextTable(std::iter::once(heading).chain(rows).collect());
    Ok(format!("{table}next: torquectl blackbox newest\n"))
}

fn show(file: &Path, arguments: &BlackboxArguments) -> Result<String, Problems> {
    let path = if file.exists() {
        file.to_owned()
    } else {
        find(file, arguments.robot.as_ref())?
    };
    let black_box = BlackBox::read(&path)?;
    if let Some(csv) = &arguments.csv {
        apart(csv, std::slice::from_ref(&path))?;
        terminal::write_file(csv, &report::csv(&black_box))?;
    }
    Ok(if arguments.json {
        format!("{}\n", report::json(&black_box))
    } else {
        report::text(&black_box)
    })
}

/// The black box of that name in a state directory.
fn find(name: &Path, robot: Option<&String>) -> Result<PathBuf, Problem> {
    let mut kept = kept(robot)?;
    let newest = name.as_os_str() == "newest";
    let found = if newest {
        kept.pop()
    } else {
        kept.into_iter()
            .find(|kept| name.as_os_str() == kept.name().as_str())
    };
    found.map(|kept| kept.path).ok_or_else(|| {
        let problem = Problem::new(
            "no such black box",
            "a path, or a name that `torquectl blackbox` lists",
        );
        problem.at(name.display().to_string(), 0)
    })
}
