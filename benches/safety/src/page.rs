//! The page of results.

use robot_state::Event;
use std::fmt::Write;

use crate::motion::Reference;
use crate::robots::Variant;
use crate::run::{Outcome, Verdict};
use crate::scenarios::{Bound, Start, all};

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

/// The page; `kept` is the part of the last page that was written by hand.
#[must_use]
pub fn page(results: &Results, last: &str) -> String {
    let mut text = HEAD.to_owned();
    summary(&mut text, results);
    let kept = last.find(KEPT_BEGIN).zip(last.find(KEPT_END));
    let kept = kept.and_then(|(begin, end)| last.get(begin..end + KEPT_END.len()));
    text += kept.unwrap_or(KEPT_DEFAULT);
    text += "\n\n";
    not_held(&mut text, results);
    without_fault(&mut text, results);
    tables(&mut text, results);
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
         below.\n\n| robot | begins in | speed, rad/s (% of limit) | torque in 5 ms, % | displacement, ° |\n\
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
        "| {first} | begins in | joint | first event | reaction | speed, rad/s (%) | torque in 5 ms, % | displacement, ° | compared with: %; torque, %; ° | |"
    );
    let columns = first.matches('|').count() + 1;
    let _ = writeln!(
        text,
        "|{} --- | --- | --- | --- | ---: | ---: | ---: | ---: | --- |",
        " --- |".repeat(columns)
    );
}

/// One run in a line.
#[must_use]
pub fn line(variant: &Variant, outcome: &Outcome) -> String {
    let mut text = format!("{} | {} |", outcome.scenario, variant.name());
    row(&mut text, outcome);
    text.trim_end().to_owned()
}

fn row(text: &mut String, o: &Outcome) {
    let first = match (o.detected_ms, Event::from_number(o.event)) {
        (Some(ms), Some(event)) => format!("{} {} after {ms} ms", o.event, event.name()),
        _ => "none".to_owned(),
    };
    let reaction = match (o.reacted_ms, Event::from_number(o.fault)) {
        (Some(ms), Some(event)) => format!(
            "fault {} ({}) after {ms} ms; {}",
            o.fault,
            format!("{:?}", event.reaction()).to_lowercase(),
            o.state
        ),
        (Some(ms), None) => format!("mode ended after {ms} ms; {}", o.state),
        _ => format!("goes on; {}", o.state),
    };
    let beside = o.beside.map_or(String::new(), |moved| {
        let degrees = moved.displacement.to_degrees();
        let [speed, step] = [moved.speed_share, moved.step_share].map(|share| 100.0 * share);
        format!("{speed:.1}; {step:.1}; {degrees:.2}")
    });
    let verdict = match o.verdict {
        Verdict::Holds => "holds",
        Verdict::Physics => "physics",
        Verdict::Fails => "**no**",
    };
    let back = match o.recovered {
        Some(false) => ", not enabled again",
        _ => "",
    };
    let _ = writeln!(
        text,
        " {} | {} | {first} | {reaction} | {:.3} ({:.1}) | {:.1} | {:.3} | {beside} | {verdict}{back} |",
        o.start,
        o.joint,
        o.moved.speed,
        100.0 * o.moved.speed_share,
        100.0 * o.moved.step_share,
        o.moved.displacement.to_degrees()
    );
}

/// For each scenario how many runs hold, and of those that hold and of those that the fault itself
/// moves the one that comes nearest to its bounds.
fn tables(text: &mut String, results: &Results) {
    let mut group = "";
    for scenario in all() {
        let its = || {
            results
                .outcomes
                .iter()
                .filter(|(_, o)| o.scenario == scenario.name)
        };
        let runs = its().count();
        if runs == 0 {
            continue;
        }
        if scenario.group != group {
            group = scenario.group;
            let _ = writeln!(text, "\n## {group}\n");
            row_head(text, "fault | hold | nearest to its bounds");
        }
        let step = match scenario.bound {
            Bound::MotionAndStep | Bound::Gap(_) | Bound::Approach => " (step)",
            Bound::Motion | Bound::Straying | Bound::Physics | Bound::Torque | Bound::Shown(_) => {
                ""
            }
        };
        let of = |verdict: Verdict| {
            let its = its().filter(|(_, o)| o.verdict == verdict);
            let nearness = |o: &Outcome| badness(o, scenario.bound);
            let worst = its
                .clone()
                .max_by(|(_, a), (_, b)| nearness(a).total_cmp(&nearness(b)));
            (its.count(), worst)
        };
        let (held, nearest) = of(Verdict::Holds);
        let mut name = format!("{}{step} | {held} of {runs}", scenario.name);
        for (variant, outcome) in [nearest, of(Verdict::Physics).1].into_iter().flatten() {
            let _ = write!(text, "| {name} | {} |", variant.name());
            row(text, outcome);
            name = " | ".to_owned();
        }
    }
}

const KEPT_BEGIN: &str = "<!-- written by hand, kept -->";
const KEPT_END: &str = "<!-- end -->";
const KEPT_DEFAULT: &str = "<!-- written by hand, kept -->\n<!-- end -->";

const HEAD: &str = "\
# Safety: one fault at a time

Made by `cargo run --release -p safety-bench`, but for the part that is marked as written by hand. Everything here is simulated: the daemon's own cycle in front of `crates/plant`, whose disturbances are on; what leaves or kills the process is in [safety-processes.md](safety-processes.md).

One run: one fault, in one robot, from one cycle on. The robot is brought into a state (power-on; hold; mode torque with the torques that it carries; mode inverse dynamics at rest; the same in motion, 0.25 rad at 0.5 Hz, a prismatic joint at a tenth of its velocity limit; mode passive, all joints let go, of the humanoid those of the arms; mode torque-feedback motion at rest; mode low-gain tracking at rest, with a learned torque of 0.5 % of its limit at one joint; mode Cartesian at rest, its frame led by springs of 0.6 of their limits; *pressing*: the same without springs, the frame held by something of 600 kN/m on which it presses with 0.2 of its greatest force, fed back), the fault begins and lasts, and for one second the **true** motion of all joints is taken. In motion, what the robot does without the fault does not count: displacement is how far a joint leaves the range that it passes through without the fault, speed by how much it exceeds its greatest speed there. Then the fault ends, and an operator acknowledges and enables once.

Robots: the leg hangs from its hip; hrp2-like is that leg below a torso in a harness, with encoders on its motors alone, for which a link encoder's faults do not exist and both encoders that err as one are the only one; lift-gripper has two prismatic joints, one of which a second finger follows; of these 0.1 m counts as much as a radian, in faults and in what the tables show; the humanoid with position drives stands on the floor. Mode Cartesian is judged on the leg, which has a frame; faults of IMUs besides on a humanoid with three of them. Modes torque-feedback motion and low-gain tracking need two encoders and position drives. The project has no robot with current drives: theirs are made in memory (`benches/safety/src/robots.rs`), torque law without torque feedback, position feedback of 3 Hz, half of the motors' friction compensated; that humanoid hangs in its harness, as it has no balance controller. Drives have states by CiA 402 and brakes; the same runs with drives that are always on are in the summary and, where they do not hold, in the table of those.

**Bounds**: at most 1° and 10 % of the velocity limit; where *(step)* stands (missed replies, late cycles, clients that die, changes of mode), also at most 5 % of the torque limit within 5 ms. Where the fault itself moves the joint (gear, load, hand, power), the run is compared with one whose set-points stay as they were: *physics* means that the loop's reaction moves the robot by no more than 10 % beyond that. In mode torque a joint has to move when its load changes: the run is then compared with one of ideal sources of the commanded torques in the same plant, which have no velocity limit (nor has the plant end stops), and must move no further and no faster; a change to mode torque of a robot that stands without a balance controller likewise. Frames that are led, and joints that are let go or held softly, give way to loads as well, compared with ideal sources of the torques before; where what it presses on gives way it goes on, and its joints may move at the velocity limit of mode torque (25 % of theirs), 10 % beyond it at most. A client that asks for a force where nothing is to press on is given that motion: no displacement counts, but at most 10 % of the velocity limit and 5 % of the torque limit within 5 ms; counted as moved by the fault itself. Where the loop leaves out cycles, a position drive brakes at a set-point that stands: the torque step may then be at most 10 % beyond that of a run in which set-points stay for as long. What would spare it is a set-point with velocity, or interpolation in the drive. Drives that take currents go on with their last one where they hear nothing (bus cut, loop asleep): judged so as well. Where both encoders of a joint show the same motion that is none, nothing else knows better: a current drive may follow it, 10 % further at most and at 10 % of the velocity limit. The tables by groups of faults show of all runs that hold the one that comes nearest to its bounds, and the same of those of physics; every run that does not hold is in the first table.

";
