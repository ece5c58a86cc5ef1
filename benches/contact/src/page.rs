//! The page of results.

use crate::Arguments;
use crate::robots::{Changes, Doing, Study};
use crate::runs::{Collision, Quiet, Step, collision, quiet, state, steps};
use safety_bench::Drives;
use std::fmt::Write as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use test_support::ResultsPage;

const SEEDS: [u64; 3] = [1, 2, 3];
/// Share of the rated torque that is to be flagged.
const SHARE: f64 = 0.2;
/// Time in which it is to be, ms.
const IN_TIME: usize = 10;

/// The leg is quick to simulate: its time without contact over that of the humanoid.
const LEG_SHARE: f64 = 2.5;

/// Errors of the loop's model, beside the usual ones.
const WRONG: [(&str, f64, f64); 3] = [
    ("as configured", 0.0, 0.0),
    ("parameters ±20 %", 0.2, 0.0),
    ("unknown payload of 2 kg", 0.0, 2.0),
];

type Robot = (&'static str, Drives);
const ROBOTS: [Robot; 4] = [
    ("leg", Drives::Position),
    ("leg", Drives::Current),
    ("humanoid", Drives::Position),
    ("humanoid", Drives::Current),
];

fn name((robot, drives): Robot) -> String {
    let drives = match drives {
        Drives::Position => "position",
        Drives::Current => "current",
    };
    format!("{robot}, {drives}")
}

/// Runs what is asked for, and writes the page or prints the part.
///
/// # Errors
/// A run that fails, a file that cannot be written.
pub(crate) fn work(arguments: &Arguments) -> Result<(), String> {
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let robots: Vec<Robot> = (ROBOTS.into_iter())
        .filter(|(robot, _)| arguments.robot.as_deref().is_none_or(|r| r == *robot))
        .collect();
    let wants = |part: &str| arguments.only.as_deref().is_none_or(|only| only == part);
    let mut page = String::from(HEAD);
    let seeds: Vec<String> = seeds(arguments).iter().map(u64::to_string).collect();
    let _ = writeln!(
        page,
        "\nThis page: seeds {}; of each seed and motion {} s of the humanoid and {} s of the leg, a fifth of it where the model is wrong, in hold and in quick motion.",
        seeds.join(", "),
        arguments.seconds,
        LEG_SHARE * arguments.seconds
    );
    if wants("steps") {
        eprintln!("steps");
        page += &step_tables(&robots, arguments, threads)?;
    }
    if wants("quiet") {
        eprintln!("without contact");
        page += &quiet_table(&robots, arguments, threads);
    }
    if wants("collisions") {
        eprintln!("collisions");
        page += &collision_table(&robots, arguments, threads)?;
    }
    page += NOTES;
    if arguments.only.is_some() {
        print!("{page}");
        return Ok(());
    }
    ResultsPage::new(&page)?.write(&arguments.out)?;
    println!("{}", arguments.out.display());
    Ok(())
}

/// `run` on every item by several threads, with progress; in the items' order.
fn parallel<T: Sync, R: Send>(items: &[T], threads: usize, run: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let Some((i, item)) = {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    items.get(i).map(|item| (i, item))
                } {
                    let result = run(item);
                    if let Ok(mut done) = done.lock() {
                        done.push((i, result));
                        eprintln!("  {} of {}", done.len(), items.len());
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Motions that a robot is capable of: one with current drives hangs, and is not in the demo's motion.
fn doings((robot, drives): Robot, arguments: &Arguments) -> Vec<Doing> {
    let mut doings = vec![Doing::Hold, Doing::Stand, Doing::Quick];
    if drives == Drives::Position {
        doings.push(Doing::Demo);
        if robot == "humanoid" {
            doings.push(Doing::Step);
        }
    }
    doings.retain(|doing| doing.name().contains(&arguments.state));
    doings
}

fn seeds(arguments: &Arguments) -> Vec<u64> {
    arguments
        .seed
        .map_or_else(|| SEEDS.to_vec(), |seed| vec![seed])
}

fn changes(doing: Doing, seed: u64, (_, error, payload): (&str, f64, f64)) -> Changes {
    Changes {
        seed,
        error,
        payload,
        harness: doing == Doing::Step,
        ..Changes::default()
    }
}

fn step_tables(robots: &[Robot], arguments: &Arguments, threads: usize) -> Result<String, String> {
    let mut jobs = Vec::new();
    for &robot in robots {
        for doing in doings(robot, arguments) {
            let seeds = seeds(arguments).into_iter();
            jobs.extend(seeds.map(|seed| (robot, doing, seed)));
        }
    }
    let results = parallel(
        &jobs,
        threads,
        |&(robot, doing, seed)| -> Result<_, String> {
            let study = Study::new(robot.0, robot.1, &changes(doing, seed, WRONG[0]))?;
            let steps = steps(&study, doing, SHARE)?;
            let late = steps
                .iter()
                .filter(|s| s.any.is_none_or(|ms| ms > IN_TIME))
                .count();
            eprintln!(
                "  {}, {}, seed {seed}: {late} of {} late",
                name(robot),
                doing.name(),
                steps.len()
            );
            let names = study.prepared.robot.parameters.joints.iter();
            Ok((steps, names.map(|j| j.name.clone()).collect::<Vec<_>>()))
        },
    );
    let results = results.into_iter().collect::<Result<Vec<_>, String>>()?;
    let mut text = String::from(STEPS);
    let mut missed = Vec::new();
    let mut done: Vec<(Robot, Doing)> = Vec::new();
    for (robot, doing, _) in &jobs {
        if done.contains(&(*robot, *doing)) {
            continue;
        }
        done.push((*robot, *doing));
        let of = jobs.iter().zip(&results);
        let of = of.filter(|((r, d, _), _)| (r, d) == (robot, doing));
        let mut all: Vec<Step> = Vec::new();
        for ((_, _, seed), (steps, names)) in of {
            for step in steps.iter().filter(|s| s.any.is_none_or(|ms| ms > IN_TIME)) {
                let ms = step
                    .any
                    .map_or("not within 60".into(), |ms| format!("{ms}"));
                missed.push(format!(
                    "| {} | {} | {seed} | {} | {ms} |\n",
                    name(*robot),
                    doing.name(),
                    names[step.joint],
                ));
            }
            all.extend_from_slice(steps);
        }
        let in_time = |of: &dyn Fn(&Step) -> Option<usize>| {
            let within = all.iter().filter(|s| of(s).is_some_and(|ms| ms <= IN_TIME));
            format!("{} of {}", within.count(), all.len())
        };
        let mut times: Vec<usize> = all.iter().filter_map(|step| step.any).collect();
        times.sort_unstable();
        let at = |share: f64| {
            let i = (share * times.len().saturating_sub(1) as f64) as usize;
            times.get(i).map_or("-".into(), usize::to_string)
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} |",
            name(*robot),
            doing.name(),
            in_time(&|s| s.any),
            in_time(&|s| s.own),
            at(0.5),
            at(1.0),
        );
    }
    if !missed.is_empty() {
        text += "\nLater than 10 ms:\n\n<!-- rows: contact-late.csv -->\n\n| robot, drives | state | seed | joint | flagged after, ms |\n| --- | --- | --- | --- | --- |\n";
        text += &missed.concat();
    }
    Ok(text)
}

fn quiet_table(robots: &[Robot], arguments: &Arguments, threads: usize) -> String {
    let mut jobs = Vec::new();
    for wrong in WRONG {
        for &robot in robots {
            for doing in doings(robot, arguments) {
                if wrong.0 != WRONG[0].0 && robot.1 == Drives::Current {
                    continue;
                }
                let seeds = seeds(arguments).into_iter();
                jobs.extend(seeds.map(|seed| (robot, doing, seed, wrong)));
            }
        }
    }
    let results = parallel(
        &jobs,
        threads,
        |&(robot, doing, seed, wrong)| -> Result<Quiet, String> {
            let study = Study::new(robot.0, robot.1, &changes(doing, seed, wrong))?;
            // Runs that are no condition of the aim get less time.
            let share = match (wrong.0 == WRONG[0].0, doing) {
                (true, Doing::Demo | Doing::Step | Doing::Stand) => 1.0,
                _ => 0.2,
            };
            let of_robot = if robot.0 == "leg" { LEG_SHARE } else { 1.0 };
            let quiet = quiet(&study, doing, share * of_robot * arguments.seconds);
            eprintln!(
                "  {}, {}, {}, seed {seed}: {quiet:?}",
                wrong.0,
                name(robot),
                doing.name()
            );
            quiet
        },
    );
    let mut text = String::from(QUIET);
    for wrong in WRONG {
        for &robot in robots {
            for doing in doings(robot, arguments) {
                let of = jobs
                    .iter()
                    .zip(&results)
                    .filter(|((r, d, _, w), _)| (r, d) == (&robot, &doing) && w.0 == wrong.0);
                let (of, failed): (Vec<_>, Vec<_>) = of
                    .map(|(_, quiet)| quiet.as_ref())
                    .partition(|quiet| quiet.is_ok());
                for message in failed.into_iter().filter_map(Result::err) {
                    eprintln!("{}: {message}", name(robot));
                    let row = [wrong.0, &name(robot), doing.name(), message];
                    let _ = writeln!(text, "| {} | | | | | | | |", row.join(" | "));
                }
                let of: Vec<&Quiet> = of.into_iter().flatten().collect();
                let Some(worst) = of.iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio)) else {
                    continue;
                };
                let sum = |f: &dyn Fn(&Quiet) -> f64| of.iter().map(|q| f(q)).sum::<f64>();
                let most = |f: &dyn Fn(&Quiet) -> f64| of.iter().map(|q| f(q)).fold(0.0, f64::max);
                let _ = writeln!(
                    text,
                    "| {} | {} | {} | {:.0} | {} | {} | {:.2} ({}, {:.1} s) | {:.1} | {:.1} | {} |",
                    wrong.0,
                    name(robot),
                    doing.name(),
                    sum(&|q| q.seconds),
                    sum(&|q| q.flags as f64),
                    sum(&|q| q.events as f64),
                    worst.ratio,
                    worst.joint,
                    worst.at,
                    100.0 * most(&|q| q.change),
                    100.0 * most(&|q| q.lasting),
                    of.iter().map(|q| q.fault).max().unwrap_or(0),
                );
            }
        }
    }
    text
}

fn collision_table(
    robots: &[Robot],
    arguments: &Arguments,
    threads: usize,
) -> Result<String, String> {
    let reactions = ["warn", "stop", "comply", "retract"];
    let seeds = seeds(arguments);
    let mut jobs = Vec::new();
    for &robot in robots {
        for reaction in reactions {
            jobs.extend(seeds.iter().map(|&seed| (robot, reaction, seed)));
        }
    }
    let results = parallel(&jobs, threads, |&(robot, reaction, seed)| {
        collision(robot, reaction, seed, 0.25)
    });
    let results = results.into_iter().collect::<Result<Vec<_>, String>>()?;
    let mut text = String::from(COLLISIONS);
    let chunk = seeds.len().max(1);
    for (of, jobs) in results.chunks(chunk).zip(jobs.chunks(chunk)) {
        let Some(&(robot, reaction, _)) = jobs.first() else {
            continue;
        };
        let range = |f: &dyn Fn(&Collision) -> f64| {
            let least = of.iter().map(f).fold(f64::INFINITY, f64::min);
            let most = of.iter().map(f).fold(0.0, f64::max);
            if least.round() == most.round() {
                format!("{most:.0}")
            } else {
                format!("{least:.0} to {most:.0}")
            }
        };
        let time = |f: &dyn Fn(&Collision) -> Option<usize>| {
            let most = of.iter().map(f).collect::<Option<Vec<_>>>();
            let most = most.and_then(|times| times.into_iter().max());
            most.map_or("-".into(), |ms| ms.to_string())
        };
        let first = of.first().copied().unwrap_or_default();
        let _ = writeln!(
            text,
            "| {} | {} | {:.2} | {} | {} | {} | {} | {} | {:.1} | {} {} |",
            name(robot),
            if reaction == "warn" { "none" } else { reaction },
            of.iter().map(|c| c.speed).fold(0.0, f64::max),
            time(&|c| c.flag_ms),
            time(&|c| c.event_ms),
            range(&|c| c.peak),
            range(&|c| c.peak_ms),
            range(&|c| c.after),
            of.iter().map(|c| c.depth).fold(0.0, f64::max),
            state(first.state),
            if first.fault == 0 {
                String::new()
            } else {
                first.fault.to_string()
            },
        );
    }
    Ok(text)
}

const HEAD: &str = "\
# Contact detection: results

Written by `cargo run --release -p contact-bench`; how it works: [contact.md](../contact.md). Every disturbance of
`sim.toml` is on; seeds draw other masses, sensors and noise. All [thresholds](../configuration.md#external_torque) are
the defaults.
";

const STEPS: &str = "
## Steps of 20 % of rated torque

20 % of the gear's rated torque (10 % of the joint's limit), put at once between the links of one joint after the
other. Times count to the record with the flag. `own`: the flag of that joint itself.

<!-- rows: contact-steps.csv, 4 greatest of worst, ms -->

| robot, drives | state | flagged within 10 ms | own | median, ms | worst, ms |
| --- | --- | --- | --- | --- | --- |
";

const QUIET: &str = "
## Without contact

Motion with the declared contacts alone. `worst ratio`: greatest external torque over its lower threshold; 1 would set
a flag. `change`, `lasting`: greatest `tau_ext_change` and `tau_ext`, % of rated torque.

<!-- rows: contact-quiet.csv, 3 greatest of worst ratio (joint, time) -->

| model | robot, drives | state | s | flags | events 209 | worst ratio (joint, time) | change | lasting | fault |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
";

const COLLISIONS: &str = "
## Collisions

The leg's thigh, or the upper arm of the humanoid in its harness, comes down on a surface of 75 N/mm at 0.25 m/s, by
inverse dynamics; the client goes on pressing. Times from the first touch, the greatest of all seeds; forces least to
greatest.

<!-- rows: contact-collisions.csv, first 4 -->

| robot, drives | reaction | m/s | flag, ms | event 209, ms | peak, N | at, ms | after 1 s, N | depth, mm | state, fault |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
";

const NOTES: &str = "
## Weak spots

- The humanoid's chest pitch has an unknown wrench on the link beyond it, so its torque follows from the feet upwards,
  with the noise of all legs' accelerations at levers of a metre. Its threshold is as high, and `tau_ext_change` finds
  no blow there.
- On a robot that walks let 209 only warn: a foot that is put down brings ankles and knees within a few per cent of a
  flag.
- Contacts beyond an F/T sensor are declared ones, and are not looked for here.
";
