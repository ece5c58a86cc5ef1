//! `torquectl info`: what happened in a recorded run, on one page.

mod summary;

use crate::output::finish_or_refuse;
use crate::recorded::{date, describe_ending, ms_between};
use crate::units::{cell, keys, rounded};
use problem::Problems;
use recording::{Happening, Span};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use summary::{JointSummary, RunSummary};
use terminal::TextTable;
use torqued_client::robot_state::Event;

const HELP: &str = "\
Examples:
  torquectl info run.mcap
  torquectl info run.mcap --json | jq .joints[0]

Exit codes:
  0  shown, also if the file ends too early: what is there is shown
  2  bad input: not a recorded run, of another version, without a whole cycle";

/// Lines of the time line that fit on a page; the rest is counted.
const PAGE: usize = 40;

/// Show what happened in a recorded run.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct InfoArguments {
    /// The recorded run
    run: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &InfoArguments) -> ExitCode {
    finish_or_refuse(info(arguments))
}

fn info(arguments: &InfoArguments) -> Result<String, Problems> {
    let summary = RunSummary::read(&arguments.run)?;
    Ok(if arguments.json {
        format!("{}\n", object(&summary))
    } else {
        text(&summary)
    })
}

fn text(run: &RunSummary) -> String {
    let header = &run.header;
    let seconds = ms_between(run.begin_ns, run.end_ns) * 1e-3;
    let mut out = format!(
        "{}: {}, {seconds:.3} s, {} cycles, recorded by torqued {}\n",
        header.robot,
        date(header, run.begin_ns),
        run.cycles,
        header.version,
    );
    let _ = writeln!(out, "{}", begins(run));
    if run.missing > 0 {
        let _ = writeln!(out, "MISSING: {} cycles, lost in recording", run.missing);
    }
    out += &describe_ending(&run.ending);
    let _ = writeln!(
        out,
        "frames: {:.1} received and {:.1} sent a cycle; late cycles {}, left out {}",
        run.received as f64 / run.cycles.max(1) as f64,
        run.sent as f64 / run.cycles.max(1) as f64,
        run.late,
        run.skipped,
    );
    let _ = writeln!(out, "\nwhat happened, s from the begin");
    out += &timeline(run).to_string();
    let hidden = notable(&run.spans).count().saturating_sub(PAGE);
    if hidden > 0 {
        let _ = writeln!(out, "  and {hidden} more: see --json");
    }
    let _ = writeln!(out, "\njoints");
    out += &joints(run).to_string();
    if !run.events.is_empty() {
        let _ = writeln!(out, "\nevents");
        out += &events(run).to_string();
    }
    let _ = writeln!(out, "\nconfiguration");
    for file in &header.files {
        let hash = file.hash();
        let _ = writeln!(
            out,
            "  {} {}",
            hash.get(..12).unwrap_or_default(),
            file.path
        );
    }
    out
}

/// Whether the run can be replayed bit by bit.
fn begins(run: &RunSummary) -> String {
    match run.first_cycle {
        1 => "begins with the daemon's first cycle: can be replayed bit by bit".to_owned(),
        cycle => {
            format!("begins with cycle {cycle}: a replay starts without what the loop knew by then")
        }
    }
}

/// Limits act all the time; they stand in the joints' table.
fn notable(spans: &[Span]) -> impl Iterator<Item = &Span> {
    spans
        .iter()
        .filter(|span| !matches!(span.what, Happening::Limited(_)))
}

fn timeline(run: &RunSummary) -> TextTable {
    let heading = ["s", "lasted ms", "times", "what"]
        .map(str::to_owned)
        .to_vec();
    let rows = notable(&run.spans).take(PAGE).map(|span| {
        let lasted = ms_between(span.begin_ns, span.end_ns);
        vec![
            format!("{:.3}", ms_between(run.begin_ns, span.begin_ns) * 1e-3),
            if lasted > 0.0 {
                format!("{lasted:.0}")
            } else {
                "-".to_owned()
            },
            span.times.to_string(),
            span.words(&run.header),
        ]
    });
    TextTable(std::iter::once(heading).chain(rows).collect())
}

fn joints(run: &RunSummary) -> TextTable {
    let heading = [
        "joint",
        "q deg from",
        "to",
        "max |dq| rad/s",
        "max |tau_hat| N·m",
        "mean sigma",
        "no sample %",
        "limited %",
    ];
    let rows = run
        .header
        .joints
        .iter()
        .zip(&run.joints)
        .enumerate()
        .map(|(j, (name, joint))| {
            let kind = run.header.kind(j);
            let per_cent =
                |cycles: u64| format!("{:.2}", 100.0 * cycles as f64 / run.cycles.max(1) as f64);
            vec![
                name.clone(),
                cell(
                    kind,
                    format!("{:.2}", rounded(kind.shown(joint.q_min))),
                    "deg",
                ),
                cell(
                    kind,
                    format!("{:.2}", rounded(kind.shown(joint.q_max))),
                    "deg",
                ),
                cell(kind, format!("{:.3}", joint.dq_max), "rad/s"),
                cell(kind, format!("{:.2}", joint.tau_max), "N·m"),
                cell(kind, format!("{:.2}", joint.mean_sigma()), "N·m"),
                per_cent(joint.missed),
                per_cent(joint.limited),
            ]
        });
    let heading = heading.map(str::to_owned).to_vec();
    TextTable(std::iter::once(heading).chain(rows).collect())
}

fn events(run: &RunSummary) -> TextTable {
    let heading = ["number", "times", "event", "joints"].map(str::to_owned);
    let heading = heading.to_vec();
    let rows = run.events.iter().map(|(event, times)| {
        vec![
            event.number().to_string(),
            times.to_string(),
            event.name().to_owned(),
            match run.joints_of(*event) {
                joints if joints.is_empty() => "-".to_owned(),
                joints if joints.len() == run.header.joints.len() => "all".to_owned(),
                joints => joints.join(", "),
            },
        ]
    });
    TextTable(std::iter::once(heading).chain(rows).collect())
}

fn object(run: &RunSummary) -> Value {
    let header = &run.header;
    let joint = |(j, (name, joint)): (usize, (&String, &JointSummary))| {
        let object = json!({
            "name": name,
            "q_min_rad": joint.q_min,
            "q_max_rad": joint.q_max,
            "dq_max_rad_per_s": joint.dq_max,
            "tau_hat_max_Nm": joint.tau_max,
            "sigma_mean_Nm": joint.mean_sigma(),
            "cycles_without_sample": joint.missed,
            "cycles_limited": joint.limited,
        });
        keys(header.kind(j), object)
    };
    let event = |(event, times): &(Event, u64)| {
        json!({
            "number": event.number(),
            "name": event.name(),
            "times": times,
            "joints": run.joints_of(*event),
        })
    };
    let span = |span: &Span| {
        json!({
            "s": ms_between(run.begin_ns, span.begin_ns) * 1e-3,
            "lasted_ms": ms_between(span.begin_ns, span.end_ns),
            "times": span.times,
            "cycle": span.cycle,
            "what": span.words(header),
        })
    };
    let file = |file: &recording::AttachedFile| json!({ "path": file.path, "sha256": file.hash() });
    json!({
        "robot": header.robot,
        "version": header.version,
        "date": date(header, run.begin_ns),
        "seconds": ms_between(run.begin_ns, run.end_ns) * 1e-3,
        "cycles": run.cycles,
        "first_cycle": run.first_cycle,
        "missing": run.missing,
        "late": run.late,
        "skipped": run.skipped,
        "frames_received": run.received,
        "frames_sent": run.sent,
        "ending": describe_ending(&run.ending).trim_end(),
        "joints": header.joints.iter().zip(&run.joints).enumerate().map(joint).collect::<Vec<_>>(),
        "events": run.events.iter().map(event).collect::<Vec<_>>(),
        "timeline": run.spans.iter().map(span).collect::<Vec<_>>(),
        "files": header.files.iter().map(file).collect::<Vec<_>>(),
    })
}
