//! The page of results.

use robot_state::Event;
use std::collections::BTreeSet;
use std::fmt::Write;

use crate::motion::Reference;
use crate::robots::Variant;
use crate::run::{Outcome, Verdict};
use crate::scenarios::{Bound, Scenario, Start, all};

/// Everything that the page shows.
#[derive(Debug, Default)]
pub struct Results {
    /// Outcomes of each robot, in the order of the scenarios.
    pub outcomes: Vec<(Variant, Outcome)>,
    /// Runs of each robot without a fault.
    pub references: Vec<(Variant, Start, Reference)>,
}

/// How near to its bounds an outcome comes: 1 at the bound.
fn badness(outcome: &Outcome, bound: Bound) -> f64 {
    let moved = &outcome.moved;
    let step = match bound {
        Bound::MotionAndStep | Bound::Gap(_) | Bound::Approach => moved.step_share / 0.05,
        Bound::Motion | Bound::Straying | Bound::Physics | Bound::Torque | Bound::Shown(_) => 0.0,
    };
    let verdict = match outcome.verdict {
        Verdict::Holds => 0.0,
        Verdict::Physics => 1e3,
        Verdict::Fails => 1e6,
    };
    verdict
        + step
            .max(moved.displacement.to_degrees())
            .max(moved.speed_share / 0.1)
}

/// The page.
#[must_use]
pub fn page(results: &Results) -> String {
    let mut text = HEAD.to_owned();
    summary(&mut text, results);
    not_held(&mut text, results);
    nearest(&mut text, results);
    groups(&mut text, results);
    without_fault(&mut text, results);
    text
}

fn summary(text: &mut String, results: &Results) {
    text.push_str("| robot | runs | hold | moved by the fault itself, no more | do not hold | slowest first event of those that move |\n| --- | ---: | ---: | ---: | ---: | ---: |\n");
    for variant in Variant::ALL {
        let of = |verdict: Verdict| {
            let its = results.outcomes.iter().filter(|(v, _)| *v == variant);
            its.filter(|(_, o)| o.verdict == verdict).count()
        };
        let its = results.outcomes.iter().filter(|(v, _)| *v == variant);
        let runs = its.clone().count();
        if runs == 0 {
            continue;
        }
        let moving = its.filter(|(_, o)| o.verdict == Verdict::Fails);
        let slowest = moving.filter_map(|(_, o)| o.detected_ms).max();
        let slowest = slowest.map_or("–".to_owned(), |ms| format!("{ms} ms"));
        let _ = writeln!(
            text,
            "| {} | {runs} | {} | {} | {} | {slowest} |",
            variant.name(),
            of(Verdict::Holds),
            of(Verdict::Physics),
            of(Verdict::Fails)
        );
    }
    let tried = results
        .outcomes
        .iter()
        .filter(|(_, o)| o.recovered.is_some());
    let back = tried.clone().filter(|(_, o)| o.recovered == Some(true));
    let _ = writeln!(
        text,
        "\nWith the fault gone, one acknowledgement and one enabling led to holding in {} of {} runs.\n",
        back.count(),
        tried.count()
    );
}

fn not_held(text: &mut String, results: &Results) {
    let failed: Vec<_> = (results.outcomes.iter())
        .filter(|(_, o)| o.verdict == Verdict::Fails)
        .collect();
    text.push_str("## Every run that does not hold\n\n");
    if failed.is_empty() {
        text.push_str("None.\n\n");
        return;
    }
    row_head(text, "fault | robot");
    for (variant, outcome) in failed {
        let _ = write!(text, "| {} | {} |", outcome.scenario, variant.name());
        row(text, outcome);
    }
    text.push('\n');
}

fn without_fault(text: &mut String, results: &Results) {
    text.push_str(
        "## The same robots without a fault\n\nWhat a second at rest shows: part of every figure \
         below.\n\n<!-- rows: safety-at-rest.csv, 3 greatest of displacement, ° -->\n\n| robot | begins in | speed, rad/s (% of limit) | torque in 5 ms, % | displacement, ° |\n\
         | --- | --- | ---: | ---: | ---: |\n",
    );
    for (variant, start, reference) in &results.references {
        if *start == Start::Motion {
            continue;
        }
        let moved = &reference.moved;
        let _ = writeln!(
            text,
            "| {} | {} | {:.3} ({:.1}) | {:.1} | {:.3} |",
            variant.name(),
            start.name(),
            moved.speed,
            100.0 * moved.speed_share,
            100.0 * moved.step_share,
            moved.displacement.to_degrees()
        );
    }
    text.push('\n');
}

fn row_head(text: &mut String, first: &str) {
    let _ = writeln!(
        text,
        "| {first} | begins in | joint | first event | reaction | speed, rad/s (%) | torque in 5 ms, % | displacement, ° |"
    );
    let columns = first.matches('|').count() + 1;
    let _ = writeln!(
        text,
        "|{} --- | --- | --- | --- | ---: | ---: | ---: |",
        " --- |".repeat(columns)
    );
}

/// One run in a line.
#[must_use]
pub fn line(variant: &Variant, outcome: &Outcome) -> String {
    let mut text = format!("{} | {} |", outcome.scenario, variant.name());
    row(&mut text, outcome);
    let verdict = match outcome.verdict {
        Verdict::Holds => "holds",
        Verdict::Physics => "physics",
        Verdict::Fails => "**no**",
    };
    let back = match outcome.recovered {
        Some(false) => ", not enabled again",
        _ => "",
    };
    format!(
        "{} {} | {verdict}{back} |",
        text.trim_end(),
        compared(outcome)
    )
}

/// Speed share, torque step (per cent) and displacement (degrees) of the run that it is compared with.
fn compared(outcome: &Outcome) -> String {
    outcome.beside.map_or(String::new(), |moved| {
        let degrees = moved.displacement.to_degrees();
        let [speed, step] = [moved.speed_share, moved.step_share].map(|share| 100.0 * share);
        format!("{speed:.1}; {step:.1}; {degrees:.2}")
    })
}

/// What the loop did, and the state in the end.
fn reaction(o: &Outcome) -> String {
    match (o.reacted_ms, Event::from_number(o.fault)) {
        (Some(ms), Some(event)) => format!(
            "fault {} ({}) after {ms} ms; {}",
            o.fault,
            format!("{:?}", event.reaction()).to_lowercase(),
            o.state
        ),
        (Some(ms), None) => format!("mode ended after {ms} ms; {}", o.state),
        _ => format!("goes on; {}", o.state),
    }
}

fn row(text: &mut String, o: &Outcome) {
    let first = match (o.detected_ms, Event::from_number(o.event)) {
        (Some(ms), Some(event)) => format!("{} {} after {ms} ms", o.event, event.name()),
        _ => "none".to_owned(),
    };
    let _ = writeln!(
        text,
        " {} | {} | {first} | {} | {:.3} ({:.1}) | {:.1} | {:.3} |",
        o.start,
        o.joint,
        reaction(o),
        o.moved.speed,
        100.0 * o.moved.speed_share,
        100.0 * o.moved.step_share,
        o.moved.displacement.to_degrees()
    );
}

/// Runs that are listed as the nearest to their bounds.
const LISTED: usize = 20;

/// The faults that come nearest to their bounds, each by its nearest run, of those that hold.
fn nearest(text: &mut String, results: &Results) {
    let mut held: Vec<(f64, &(Variant, Outcome))> = (results.outcomes.iter())
        .filter(|(_, o)| o.verdict == Verdict::Holds)
        .filter_map(|run| Some((badness(&run.1, scenario(&run.1)?.bound), run)))
        .collect();
    held.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let mut seen = BTreeSet::new();
    held.retain(|(_, (_, outcome))| seen.insert(outcome.scenario));
    let _ = writeln!(
        text,
        "## The {LISTED} faults that come nearest to their bounds\n\nOf each fault the nearest run.\n"
    );
    row_head(text, "fault | robot");
    for (_, (variant, outcome)) in held.into_iter().take(LISTED) {
        let _ = write!(text, "| {} | {} |", outcome.scenario, variant.name());
        row(text, outcome);
    }
    text.push('\n');
}

fn scenario(outcome: &Outcome) -> Option<Scenario> {
    all()
        .into_iter()
        .find(|scenario| scenario.name == outcome.scenario)
}

/// Counts, medians and worst of each group of faults.
fn groups(text: &mut String, results: &Results) {
    text.push_str(
        "## By kind of fault\n\nDisplacement and speed of the runs that hold: median and worst. Speeds are shares of the \
         velocity limit.\n\n| kind | faults | runs | hold | physics | displacement, ° | speed, % |\n\
         | --- | ---: | ---: | ---: | ---: | ---: | ---: |\n",
    );
    let mut names: Vec<&str> = Vec::new();
    for scenario in all() {
        if !names.contains(&scenario.group) {
            names.push(scenario.group);
        }
    }
    for group in names {
        let scenarios: Vec<_> = (all().into_iter())
            .filter(|scenario| scenario.group == group)
            .map(|scenario| scenario.name)
            .collect();
        let its: Vec<&Outcome> = (results.outcomes.iter())
            .map(|(_, outcome)| outcome)
            .filter(|outcome| scenarios.contains(&outcome.scenario))
            .collect();
        if its.is_empty() {
            continue;
        }
        let of = |verdict: Verdict| its.iter().filter(move |o| o.verdict == verdict);
        let both = |value: fn(&Outcome) -> f64| {
            let mut values: Vec<f64> = of(Verdict::Holds).map(|o| value(o)).collect();
            values.sort_by(f64::total_cmp);
            let median = values.get(values.len() / 2).copied().unwrap_or(f64::NAN);
            let worst = values.last().copied().unwrap_or(f64::NAN);
            format!("{median:.3}, {worst:.3}")
        };
        let _ = writeln!(
            text,
            "| {group} | {} | {} | {} | {} | {} | {} |",
            scenarios.len(),
            its.len(),
            of(Verdict::Holds).count(),
            of(Verdict::Physics).count(),
            both(|o| o.moved.displacement.to_degrees()),
            both(|o| 100.0 * o.moved.speed_share)
        );
    }
    text.push('\n');
}

/// A row for each fault and verdict: how many runs there are, and the one that comes nearest to its bounds.
#[must_use]
pub fn csv(results: &Results) -> String {
    let mut text = "group,fault,runs,verdict,nearest_robot,begins_in,joint,first_event,after_ms,speed_rad_per_s,\
                    speed_percent,torque_in_5ms_percent,displacement_deg,reaction,compared_with\n"
        .to_owned();
    for scenario in all() {
        for (verdict, name) in [
            (Verdict::Holds, "holds"),
            (Verdict::Physics, "physics"),
            (Verdict::Fails, "no"),
        ] {
            let its = || {
                (results.outcomes.iter())
                    .filter(|(_, o)| o.scenario == scenario.name && o.verdict == verdict)
            };
            let nearness = |o: &Outcome| badness(o, scenario.bound);
            let worst = its().max_by(|(_, a), (_, b)| nearness(a).total_cmp(&nearness(b)));
            let Some((variant, o)) = worst else {
                continue;
            };
            let event = Event::from_number(o.event).map_or("none", |event| event.name());
            let after = o.detected_ms.map_or(String::new(), |ms| ms.to_string());
            let _ = writeln!(
                text,
                "{},\"{}\",{},{name},\"{}\",{},{},{event},{after},{:.4},{:.2},{:.2},{:.4},{},{}",
                scenario.group.replace(',', ";"),
                scenario.name,
                its().count(),
                variant.name(),
                o.start,
                o.joint,
                o.moved.speed,
                100.0 * o.moved.speed_share,
                100.0 * o.moved.step_share,
                o.moved.displacement.to_degrees(),
                reaction(o),
                compared(o)
            );
        }
    }
    text
}

const HEAD: &str = include_str!("page.md");
