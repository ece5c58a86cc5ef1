//! The part of the page of results: both worlds side by side.

use crate::config::Bristles;
use crate::draw::Drawn;
use crate::run::{self, Judged};
use crate::tasks::{Extent, Figures};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use test_support::{ResultsPage, with_section};

/// Heading of the part.
const HEADING: &str = "## Drawn joints of another structure";
/// Text between heading and tables.
const INTRODUCTION: &str = include_str!("page.md");
/// Tasks of a joint.
const TASKS: usize = 9;
/// The worst joints that a row names.
const NAMED: usize = 3;

/// Figure of a joint, larger is worse, and how it is written.
type Of = fn(&Figures) -> f64;

/// A figure with its aim.
struct Aim {
    name: &'static str,
    /// The row of the page's table of aims that has it of the own plant.
    own: &'static str,
    unit: &'static str,
    of: Of,
    /// The bound, the share of joints that are to meet it, and whether larger figures are better.
    bound: f64,
    share: f64,
    is_least: bool,
}

const AIMS: [Aim; 5] = [
    Aim {
        name: "Blocked, -3 dB at 20 % of rated",
        own: "Blocked, -3 dB at 20 % of rated",
        unit: "Hz",
        of: |f| f.bandwidth[1],
        bound: 15.0,
        share: 0.8,
        is_least: true,
    },
    Aim {
        name: "Blocked, -3 dB at 2 % of rated",
        own: "Blocked, -3 dB at 2 % of rated",
        unit: "Hz",
        of: |f| f.bandwidth[0],
        bound: 10.0,
        share: 0.5,
        is_least: true,
    },
    Aim {
        name: "Blocked, overshoot of a step of 20 %",
        own: "Blocked, overshoot of a step of 20 %",
        unit: "%",
        of: |f| f.overshoot,
        bound: 10.0,
        share: 0.8,
        is_least: false,
    },
    Aim {
        name: "Reversal at 0.5 rad/s within 50 ms",
        own: "Reversal at 0.5 rad/s within 50 ms",
        unit: "% of rated",
        of: |f| f.reversal,
        bound: 60.0,
        share: 0.5,
        is_least: false,
    },
    Aim {
        name: "At rest for 20 s, torque from peak to peak",
        own: "",
        unit: "% of the limit",
        of: |f| f.rest.into_iter().fold(0.0, f64::max),
        bound: 1.5,
        share: 1.0,
        is_least: false,
    },
];

/// Runs all and writes the part into the page, and its rows beside it.
///
/// # Errors
/// A page that cannot be read or written, a run that fails.
pub(crate) fn write(path: &Path, joints: usize, threads: usize) -> Result<(), String> {
    let page = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let all = run::joints(joints, threads, Bristles::Known, Extent::ALL)?;
    let only_torque = Extent {
        torque_only: true,
        ..Extent::ALL
    };
    let unknown = run::joints(joints, threads, Bristles::NotGiven, only_torque)?;
    let text = part(&page, &all, &unknown);
    let part = ResultsPage::new(&text)?;
    for (name, rows) in &part.files {
        let beside = path.with_file_name(name);
        std::fs::write(&beside, rows).map_err(|e| format!("{}: {e}", beside.display()))?;
    }
    let whole = with_section(&page, HEADING, &part.text, "\n## Blocked joint\n");
    std::fs::write(path, whole).map_err(|e| format!("{}: {e}", path.display()))
}

fn part(page: &str, all: &[Judged], unknown: &[Judged]) -> String {
    let passed = judged(all);
    let mut text = format!("\n{HEADING}\n\n{INTRODUCTION}");
    text = text.replace("PASSED", &passed.len().to_string());
    text = text.replace("REFUSED", &(all.len() - passed.len()).to_string());
    let _ = write!(
        text,
        "\n| | own plant, 7 joints | own plant, parameters ±20 % | aim for drawn joints | meet it | median | worst |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for aim in &AIMS {
        aim.row(&mut text, page, &passed, "");
    }
    let unknown = judged(unknown);
    for aim in &AIMS[..4] {
        aim.row(&mut text, page, &unknown, ", `presliding_rad` not given");
    }
    faults(&mut text, &passed);
    events(&mut text, &passed);
    rows(&mut text, &passed);
    text
}

/// The joints that `check` lets run.
fn judged(all: &[Judged]) -> Vec<(&Drawn, &Figures)> {
    let passed = all.iter();
    passed
        .filter_map(|(drawn, figures)| Some((drawn, figures.as_ref()?)))
        .collect()
}

impl Aim {
    fn row(&self, text: &mut String, page: &str, all: &[(&Drawn, &Figures)], remark: &str) {
        let Self {
            name, unit, bound, ..
        } = self;
        let worse = |x: f64| if self.is_least { -x } else { x };
        let mut sorted: Vec<(f64, &str)> = (all.iter())
            .map(|(drawn, figures)| ((self.of)(figures), drawn.name.as_str()))
            .collect();
        sorted.sort_by(|a, b| worse(b.0).total_cmp(&worse(a.0)));
        let meets = sorted.iter().filter(|(x, _)| worse(*x) <= worse(*bound));
        let share = meets.count() as f64 / all.len().max(1) as f64;
        let median = sorted.get(sorted.len() / 2).map_or(f64::NAN, |it| it.0);
        let worst: Vec<String> = (sorted.iter().take(NAMED))
            .map(|(x, name)| format!("{} ({name})", number(*x)))
            .collect();
        let [own, wrong] = own_plant(page, self.own);
        let sign = if self.is_least { "at least" } else { "at most" };
        let of = match self.share {
            0.5 => "in the median".to_owned(),
            1.0 => "in all".to_owned(),
            share => format!("in {:.0} %", 100.0 * share),
        };
        let _ = writeln!(
            text,
            "| {name}{remark} | {own} | {wrong} | {sign} {bound} {unit} {of} | {:.0} % | {} | {} |",
            100.0 * share,
            number(median),
            worst.join(", ")
        );
    }
}

/// A figure; one of a task that was not ended has none.
fn number(x: f64) -> String {
    match x {
        x if !x.is_finite() => "ended".to_owned(),
        x if x.abs() < 1.0 => format!("{x:.2}"),
        x => format!("{x:.1}"),
    }
}

/// Measured, and with parameters off by up to 20 %, as the page has them of the own plant.
fn own_plant(page: &str, name: &str) -> [String; 2] {
    let row = page
        .lines()
        .find(|line| line.starts_with(&format!("| {name} |")));
    let cells: Vec<&str> = row.unwrap_or_default().split('|').map(str::trim).collect();
    [3, 5].map(|at| cells.get(at).map_or("-", |cell| cell).to_owned())
}

/// Tasks that ended before their time.
fn faults(text: &mut String, all: &[(&Drawn, &Figures)]) {
    let mut lines = String::new();
    let mut count = 0;
    for (drawn, figures) in all {
        for (task, event, _) in &figures.faults {
            let (number, name) = (event.number(), event.name());
            let _ = writeln!(lines, "| {} | {task} | {number} `{name}` |", drawn.name);
            count += 1;
        }
        for task in &figures.ended {
            let _ = writeln!(lines, "| {} | {task} | none: the mode ended |", drawn.name);
            count += 1;
        }
    }
    let tasks = TASKS * all.len();
    let _ = writeln!(
        text,
        "\n{count} of {tasks} tasks ended with a fault, or before their time; the aim is none."
    );
    if count > 0 {
        let _ = write!(
            text,
            "\n| joint | task | fault |\n| --- | --- | --- |\n{lines}"
        );
    }
}

/// Events by name, and how many joints had them.
fn events(text: &mut String, all: &[(&Drawn, &Figures)]) {
    let mut by_name: BTreeMap<u32, (&str, usize, u64)> = BTreeMap::new();
    for (event, count) in all.iter().flat_map(|(_, figures)| &figures.events) {
        let own = by_name
            .entry(event.number())
            .or_insert((event.name(), 0, 0));
        (own.1, own.2) = (own.1 + 1, own.2 + count);
    }
    let _ = write!(
        text,
        "\n| event | joints | times |\n| --- | ---: | ---: |\n"
    );
    for (number, (name, joints, times)) in by_name {
        let _ = writeln!(text, "| {number} `{name}` | {joints} | {times} |");
    }
}

fn rows(text: &mut String, all: &[(&Drawn, &Figures)]) {
    let _ = write!(
        text,
        "\n<!-- rows: torque-control-drawn.csv -->\n\n\
         | joint | structure | -3 dB at 2 %, Hz | -3 dB at 20 %, Hz | over the gain at 1 Hz: at 2 %, Hz | at 20 %, Hz \
         | peak at 2 % | peak at 20 % | rise, ms | overshoot, % | reversal, % of rated | hand, mean, % of rated \
         | rest on a spring, % of limit | rest on a wall, % of limit | rest, free, % of limit | faults | events |\n|{}\n",
        " --- |".repeat(17)
    );
    for (drawn, f) in all {
        let of_faults = f.faults.iter();
        let faults: Vec<String> = of_faults
            .map(|(task, event, time)| format!("{task}: {} at {time:.2} s", event.number()))
            .chain(f.ended.iter().map(|task| format!("{task}: ended")))
            .collect();
        let of_events = f.events.iter();
        let events: Vec<String> = of_events
            .map(|(event, count)| format!("{} {count}", event.number()))
            .collect();
        let figures = [
            f.bandwidth[0],
            f.bandwidth[1],
            f.relative[0],
            f.relative[1],
            f.peak[0],
            f.peak[1],
            f.rise,
            f.overshoot,
            f.reversal,
            f.mean,
            f.rest[0],
            f.rest[1],
            f.rest[2],
        ];
        let figures = figures.map(number).join(" | ");
        let _ = writeln!(
            text,
            "| {} | {} | {figures} | {} | {} |",
            drawn.name,
            drawn.structure,
            faults.join("; "),
            events.join("; ")
        );
    }
}
