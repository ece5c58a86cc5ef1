//! Writes docs/results/safety.md and docs/results/safety.csv.

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use safety_bench::{
    Outcome, Pair, PairOutcome, Place, Prepared, Reference, Results, Scenario, Start, Variant,
    Verdict, all, csv, draw, page, places, reference, run, run_pair, run_sound,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use test_support::ResultsPage;

/// Put one fault at a time into simulated robots, and write what they then do
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The page
    #[arg(long, default_value = "docs/results/safety.md")]
    out: PathBuf,
    /// All runs as JSON, one line each, to this file
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only scenarios with this text in their names, of pairs those with it in either, "A + B" with both;
    /// prints the runs and writes no page
    #[arg(long)]
    only: Option<String>,
    /// Only this robot: leg, hrp2-like or humanoid; prints the runs and writes no page
    #[arg(long)]
    robot: Option<String>,
    /// Only this state at the beginning, e.g. hold or "inverse dynamics"
    #[arg(long)]
    start: Option<String>,
    /// Every robot in every state, also those that the page leaves out
    #[arg(long)]
    all: bool,
    /// So many runs with two faults at once, drawn by --seed; prints them and writes no page
    #[arg(long)]
    pairs: Option<usize>,
    /// So many simulated hours without a fault, with pauses, late answers and lost frames; prints false stops
    #[arg(long, conflicts_with = "pairs")]
    sound: Option<f64>,
    /// Write the counts of pairs, or single faults of some robots or states, as a page to this file
    #[arg(long, value_name = "FILE.md")]
    page: Option<PathBuf>,
    /// Seed of the pairs, or of sound motion
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; default: all cores
    #[arg(long)]
    threads: Option<usize>,
}

const EXAMPLES: &str = "\
Run it in the project's folder.

Examples:
  safety-bench                                     all faults, some 20 minutes on two cores
  safety-bench --json runs.jsonl                   and every single run
  safety-bench --robot leg --only \"link encoder\"   a minute
  safety-bench --robot humanoid --start stand --page docs/results/safety-stand.md
  safety-bench --pairs 10000 --seed 7              two faults at once, some 40 minutes
  safety-bench --sound 10 --seed 7                 ten hours in which nothing is broken

Exit codes:
  0  done; all runs hold, or --pairs
  1  some do not hold, or it could not run
";

struct Job<'a> {
    prepared: &'a Prepared,
    scenario: Scenario,
    place: Place,
}

/// Inputs of a run without a fault.
type Key = (Variant, Start, usize);

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match work(&arguments) {
        Ok(failed) => {
            println!("{failed} runs do not hold");
            // Pairs of faults beyond what a reaction could hold are known: the page lists them.
            ExitCode::from(u8::from(failed > 0 && arguments.pairs.is_none()))
        }
        Err(message) => {
            eprintln!("safety-bench: {message}");
            ExitCode::FAILURE
        }
    }
}

fn work(arguments: &Arguments) -> Result<usize, String> {
    let read = |path: &str| std::fs::read_to_string(path);
    let wanted = |variant: &Variant| {
        let robot = arguments.robot.as_deref();
        robot.is_none_or(|robot| robot == variant.robot)
    };
    let variants = Variant::ALL.into_iter().filter(wanted);
    let prepared = variants
        .map(|variant| Prepared::new(variant, &read).map_err(|e| e.to_string()))
        .collect::<Result<Vec<_>, _>>()?;
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, |threads| threads.get()));
    if let Some(count) = arguments.pairs {
        return work_on_pairs(&prepared, count, arguments, threads);
    }
    if let Some(hours) = arguments.sound {
        return work_on_sound(&prepared, hours, arguments, threads);
    }
    let mut jobs = Vec::new();
    for prepared in &prepared {
        let named = |s: &Scenario| (arguments.only.as_ref()).is_none_or(|n| s.name.contains(n));
        for scenario in all().into_iter().filter(named) {
            let its = places(prepared, &scenario, arguments.all);
            let begins = |p: &Place| {
                let start = arguments.start.as_deref();
                start.is_none_or(|start| start == p.start.name())
            };
            jobs.extend(its.into_iter().filter(begins).map(|place| Job {
                prepared,
                scenario,
                place,
            }));
        }
    }
    let (outcomes, references) = run_all(&jobs, threads)?;
    let failed = outcomes.iter().filter(|(_, o)| o.verdict == Verdict::Fails);
    let failed = failed.count();
    if let Some(path) = &arguments.json {
        write_json(path, &outcomes)?;
    }
    if arguments.only.is_some() || arguments.robot.is_some() || arguments.start.is_some() {
        for (variant, outcome) in &outcomes {
            println!("{}", safety_bench::line(variant, outcome));
        }
        let results = Results {
            outcomes,
            references,
        };
        if let Some(path) = &arguments.page {
            write_page(&part(&page(&results), arguments, path), &results, path)?;
        }
        return Ok(failed);
    }
    let results = Results {
        outcomes,
        references,
    };
    write_page(&page(&results), &results, &arguments.out)?;
    println!("{}", arguments.out.display());
    Ok(failed)
}

fn write_page(text: &str, results: &Results, path: &Path) -> Result<(), String> {
    ResultsPage::new(text)?.write(path)?;
    write(&path.with_extension("csv"), &csv(results))
}

/// The page of some robots and states: how it is made, and names of files of its own.
fn part(text: &str, arguments: &Arguments, path: &Path) -> String {
    let asked = [
        ("only", &arguments.only),
        ("robot", &arguments.robot),
        ("start", &arguments.start),
    ];
    let asked = asked.iter().filter_map(|(key, value)| {
        let value = value.as_ref()?;
        Some(format!(" --{key} \"{value}\""))
    });
    let asked: String = asked.collect();
    let stem = path
        .file_stem()
        .map_or("safety".into(), |stem| stem.to_string_lossy());
    text.replace(
        "safety-bench`",
        &format!("safety-bench --{asked} --page FILE`"),
    )
    .replace("safety-at-rest.csv", &format!("{stem}-at-rest.csv"))
    .replace(
        "[safety.csv](safety.csv)",
        &format!("[{stem}.csv]({stem}.csv)"),
    )
    .replace(
        "# Safety: one fault at a time",
        "# Safety: one fault at a time, of some robots and states",
    )
}

/// Runs pairs of faults; prints the counts and the runs nearest to an injury, or beyond.
fn work_on_pairs(
    prepared: &[Prepared],
    count: usize,
    arguments: &Arguments,
    threads: usize,
) -> Result<usize, String> {
    const SHOWN: usize = 20;
    let mut pairs = draw(prepared, count, arguments.seed);
    if let Some(text) = &arguments.only {
        pairs.retain(|(_, pair)| {
            let named = |text| pair.scenarios.iter().any(|s| s.name.contains(text));
            text.split(" + ").all(named)
        });
        if pairs.is_empty() {
            return Err(format!("of {count} pairs none has {text:?} in its names"));
        }
    }
    let keys: BTreeMap<(usize, Start), &Pair> = pairs
        .iter()
        .map(|(robot, pair)| ((*robot, pair.places[0].start), pair))
        .collect();
    let keys: Vec<_> = keys.into_iter().collect();
    let references = parallel(&keys, threads, |((robot, _), pair)| {
        reference(&prepared[*robot], &pair.places[0], None)
    });
    let mut by_key = BTreeMap::new();
    for ((key, _), reference) in keys.iter().zip(references) {
        by_key.insert(*key, reference.map_err(|e| e.to_string())?);
    }
    let bar = progress(count);
    let outcomes = parallel(&pairs, threads, |(robot, pair)| {
        let reference = &by_key[&(*robot, pair.places[0].start)];
        let outcome = run_pair(&prepared[*robot], pair, reference).map_err(|e| e.to_string());
        bar.inc(1);
        outcome
    });
    bar.finish_and_clear();
    let mut outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;
    if let Some(path) = &arguments.json {
        let lines = outcomes
            .iter()
            .map(|o| serde_json::to_string(o).map(|line| line + "\n"));
        let text = lines
            .collect::<Result<String, _>>()
            .map_err(|e| e.to_string())?;
        write(path, &text)?;
    }
    let severity = |o: &PairOutcome| {
        (o.moved.displacement / 5_f64.to_radians()).max(o.moved.speed_share / 0.5)
    };
    outcomes.sort_by(|a, b| severity(b).total_cmp(&severity(a)));
    let beyond = outcomes.iter().filter(|o| o.is_beyond()).count();
    let injures = outcomes.iter().filter(|o| o.injures()).count();
    let mut ways: Vec<f64> = outcomes.iter().map(|o| o.moved.displacement).collect();
    ways.sort_by(f64::total_cmp);
    let at = |share: f64| ways[((ways.len() - 1) as f64 * share) as usize].to_degrees();
    let counts = format!(
        "{count} runs with two faults, seed {}: {beyond} beyond 1 degree, {injures} injure (5 degrees or 50 %); way: \
         median {:.3} degrees, {:.3} in 99 of 100",
        arguments.seed,
        at(0.5),
        at(0.99)
    );
    let rows = outcomes.iter().take(SHOWN).map(|o| {
        format!(
            "| {:.2} | {:.1} | {} | {}, {} | {} ({}) | {} | {} ({}) |\n",
            o.moved.displacement.to_degrees(),
            100.0 * o.moved.speed_share,
            o.fault,
            o.robot,
            o.start,
            o.faults[0],
            o.joints[0],
            o.delay,
            o.faults[1],
            o.joints[1]
        )
    });
    let rows: String = rows.collect();
    println!("{rows}{counts}");
    if let Some(path) = &arguments.page {
        let text = format!(
            "# Two faults at once\n\nMade by `cargo run --release -p safety-bench -- --pairs {count} --seed {} --page \
             FILE`. Two faults that should not move a robot by themselves, drawn by the seed: in the same cycle, up to \
             30 ms apart, or the first hidden for 0.1 to 0.4 s. A prismatic joint's 0.1 m count as a radian.\n\n\
             {counts}.\n\nThe {SHOWN} runs nearest to an injury, or beyond:\n\n\
             | degrees | % of the velocity limit | fault | robot, state | first (joint) | ms later | second (joint) |\n\
             | ---: | ---: | ---: | --- | --- | ---: | --- |\n{rows}",
            arguments.seed
        );
        write(path, &text)?;
    }
    Ok(injures)
}

/// Runs sound motion; prints each run that a fault, or the end of its mode, has cut short.
fn work_on_sound(
    prepared: &[Prepared],
    hours: f64,
    arguments: &Arguments,
    threads: usize,
) -> Result<usize, String> {
    let begins = |s: &Start| {
        arguments
            .start
            .as_deref()
            .is_none_or(|name| name == s.name())
    };
    let states: Vec<(&Prepared, Start)> = (prepared.iter())
        .flat_map(|robot| Start::LASTING.into_iter().map(move |start| (robot, start)))
        .filter(|(robot, start)| start.is_possible(robot) && begins(start))
        .collect();
    let count = (60.0 * hours).ceil() as usize;
    let jobs: Vec<_> = states.iter().cycle().take(count).zip(0..).collect();
    let bar = progress(count);
    let outcomes = parallel(&jobs, threads, |((robot, start), i)| {
        let outcome = run_sound(robot, *start, arguments.seed.wrapping_mul(100_003) + i);
        // Each at once: hours of runs may be cut off.
        if let Ok(o) = outcome.as_ref()
            && (o.fault != 0 || o.ended_by != 0)
        {
            bar.suspend(|| {
                println!(
                    "{}, {}, seed {}: after {:.1} s fault {}, event {}",
                    o.robot, o.start, o.seed, o.seconds, o.fault, o.ended_by
                );
            });
        }
        bar.inc(1);
        outcome.map_err(|e| e.to_string())
    });
    bar.finish_and_clear();
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;
    let seconds: f64 = outcomes.iter().map(|o| o.seconds).sum();
    let stops = outcomes.iter().filter(|o| o.fault != 0).count();
    let ends = outcomes.iter().filter(|o| o.fault == 0 && o.ended_by != 0);
    println!(
        "{:.2} hours of sound motion in {count} runs, seed {}: {stops} latched faults, {} ends of a mode",
        seconds / 3600.0,
        arguments.seed,
        ends.count()
    );
    Ok(stops)
}

fn progress(count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len} runs, {elapsed}, {eta} left");
    let bar = ProgressBar::new(count as u64);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

type Done = (Vec<(Variant, Outcome)>, Vec<(Variant, Start, Reference)>);

fn run_all(jobs: &[Job<'_>], threads: usize) -> Result<Done, String> {
    let bar = progress(jobs.len());
    let keys: BTreeMap<Key, &Job<'_>> = jobs.iter().map(|job| (key(job), job)).collect();
    let keys: Vec<_> = keys.into_iter().collect();
    let references = parallel(&keys, threads, |(_, job)| {
        reference(job.prepared, &job.place, job.scenario.setup)
    });
    let mut by_key = BTreeMap::new();
    for ((key, _), reference) in keys.iter().zip(references) {
        by_key.insert(*key, reference.map_err(|e| e.to_string())?);
    }
    let outcomes = parallel(jobs, threads, |job| {
        let outcome = run(job.prepared, &job.scenario, job.place, &by_key[&key(job)]);
        bar.inc(1);
        outcome
    });
    bar.finish_and_clear();
    let outcomes = jobs.iter().zip(outcomes).map(|(job, outcome)| {
        outcome
            .map(|outcome| (job.prepared.variant, outcome))
            .map_err(|e| format!("{}: {e}", job.scenario.name))
    });
    let references = by_key.into_iter().filter(|((_, _, setup), _)| *setup == 0);
    let references = references.map(|((variant, start, _), r)| (variant, start, r));
    Ok((outcomes.collect::<Result<_, _>>()?, references.collect()))
}

fn key(job: &Job<'_>) -> Key {
    (
        job.prepared.variant,
        job.place.start,
        job.scenario.setup.map_or(0, |setup| setup as usize),
    )
}

/// `work` on every item by several threads; the results in the items' order.
fn parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, R)>> = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(i) else {
                        break;
                    };
                    let result = work(item);
                    if let Ok(mut done) = done.lock() {
                        done.push((i, result));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

fn write_json(path: &Path, outcomes: &[(Variant, Outcome)]) -> Result<(), String> {
    let mut text = String::new();
    for (variant, outcome) in outcomes {
        let mut value = serde_json::to_value(outcome).map_err(|e| e.to_string())?;
        value["robot"] = variant.name().into();
        value["fault_group"] = outcome.group.into();
        value["scenario"] = outcome.scenario.into();
        text += &format!("{value}\n");
    }
    write(path, &text)
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    println!("{}", path.display());
    Ok(())
}
