//! Times our dynamics beside Pinocchio's library and its generated code, in one process, batches
//! taking turns: usage `dynamics-bench FOLDER NAME=URDF...`, where FOLDER holds what run.sh built.

mod library;

use dynamics::{Base, Data, Instructions, Model, Random, UrdfOptions, aba, crba, rnea};
use library::{Generated, Library};
use std::hint::black_box;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

const STATES: usize = 128;
const ROUNDS: usize = 400;

struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
    /// q, v, a one after another.
    all: Vec<f64>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((folder, robots)) = arguments.split_first() else {
        eprintln!("usage: dynamics-bench FOLDER NAME=URDF...");
        return ExitCode::from(2);
    };
    pin_to_last_cpu();
    println!(
        "{:<16} {:>3}  {:<18} {:>9} {:>9} {:>9}  {:>7} {:>7}",
        "robot", "nv", "algorithm", "ours", "library", "generated", "/lib", "/gen"
    );
    for robot in robots {
        let Some((name, urdf)) = robot.split_once('=') else {
            eprintln!("{robot}: allowed: NAME=URDF");
            return ExitCode::from(2);
        };
        if let Err(message) = bench(Path::new(folder), name, urdf) {
            eprintln!("{name}: {message}");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// Timings do not wander between processors.
fn pin_to_last_cpu() {
    // SAFETY: plain system calls on a set that lives on this stack.
    unsafe {
        let cpus = libc::sysconf(libc::_SC_NPROCESSORS_ONLN).max(1) as usize;
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(cpus - 1, &mut set);
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set);
    }
}

/// Pinocchio takes mimic joints as independent: so do we here.
fn model(urdf: &str) -> Result<Model, String> {
    let text = std::fs::read_to_string(urdf).map_err(|e| format!("{urdf}: {e}"))?;
    let joints = text.split("<joint").skip(1);
    let name = |j: &str| Some(j.split_once("name=\"")?.1.split_once('"')?.0.to_owned());
    let options = UrdfOptions {
        base: Base::Floating,
        independent: joints.filter_map(name).collect(),
    };
    Model::from_urdf_with(&text, urdf, &options).map_err(|e| e.to_string())
}

fn states(model: &Model, data: &mut Data) -> Vec<State> {
    let mut random = Random::new(1);
    let mut state = || {
        let q = random.configuration(model);
        let v = random.vector(model.nv(), 2.0);
        let a = random.vector(model.nv(), 5.0);
        let tau = rnea(model, data, &q, &v, &a, None).to_vec();
        let all = [q.as_slice(), &v, &a].concat();
        State { q, v, a, tau, all }
    };
    (0..STATES).map(|_| state()).collect()
}

fn bench(folder: &Path, name: &str, urdf: &str) -> Result<(), String> {
    let model = model(urdf)?;
    let mut data = Data::new(&model);
    let states = states(&model, &mut data);
    let library = Library::new(
        &folder.join("liblibrary.so"),
        &folder.join(format!("{name}.txt")),
    )?;
    let generated = Generated::new(&folder.join(format!("{name}_rnea.so"))).ok();
    compare(&model, &mut data, &library, &states)?;

    let mut tau = vec![0.0; model.nv() + 16];
    let mut portable = Data::new(&model);
    portable.set_instructions(Instructions::Portable);
    let [mut d1, mut d2, mut d3] = [data.clone(), data.clone(), data.clone()];
    let mut candidates: Vec<(&str, Box<dyn FnMut(&State) + '_>)> = vec![
        (
            "rnea",
            Box::new(|s| {
                black_box(rnea(&model, &mut d1, &s.q, &s.v, &s.a, None));
            }),
        ),
        (
            "crba",
            Box::new(|s| {
                black_box(crba(&model, &mut d2, &s.q));
            }),
        ),
        (
            "aba",
            Box::new(|s| {
                black_box(aba(&model, &mut d3, &s.q, &s.v, &s.tau, None));
            }),
        ),
        (
            "portable",
            Box::new(|s| {
                black_box(rnea(&model, &mut portable, &s.q, &s.v, &s.a, None));
            }),
        ),
    ];
    for (k, algorithm) in library::ALGORITHMS.iter().enumerate() {
        let (library, last) = (&library, k >= 3);
        let label = if k == 0 { "rnea_library" } else { algorithm };
        candidates.push((
            label,
            Box::new(move |s| {
                black_box(library.run(k, &s.q, &s.v, if last { &s.tau } else { &s.a }));
            }),
        ));
    }
    if let Some(generated) = &generated {
        let tau = &mut tau;
        candidates.push((
            "generated",
            Box::new(move |s| {
                generated.run(&s.all, tau);
                black_box(&tau);
            }),
        ));
    }
    let times = take_turns(&mut candidates, &states);
    report(name, model.nv(), &times);
    Ok(())
}

/// Ours against the library's, so that what is timed is what is right.
fn compare(
    model: &Model,
    data: &mut Data,
    library: &Library,
    states: &[State],
) -> Result<(), String> {
    for s in states {
        let ours = rnea(model, data, &s.q, &s.v, &s.a, None);
        let theirs = library.run(0, &s.q, &s.v, &s.a);
        // SAFETY: rnea's result has nv numbers, and nothing has run since.
        let theirs = unsafe { std::slice::from_raw_parts(theirs, model.nv()) };
        let scale = theirs.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        if ours
            .iter()
            .zip(theirs)
            .any(|(x, y)| !((x - y).abs() <= 1e-10 * scale))
        {
            return Err("our torques differ from Pinocchio's".into());
        }
    }
    Ok(())
}

/// Median time of one call of each candidate, ns.
fn take_turns<'a>(
    candidates: &mut [(&'a str, Box<dyn FnMut(&State) + '_>)],
    states: &[State],
) -> Vec<(&'a str, f64)> {
    let mut times = vec![Vec::with_capacity(ROUNDS); candidates.len()];
    for _ in 0..ROUNDS {
        for ((_, run), times) in candidates.iter_mut().zip(&mut times) {
            let start = Instant::now();
            states.iter().for_each(&mut *run);
            times.push(start.elapsed().as_nanos() as f64 / states.len() as f64);
        }
    }
    let median = |mut t: Vec<f64>| {
        t.sort_by(f64::total_cmp);
        t[t.len() / 2]
    };
    candidates
        .iter()
        .map(|c| c.0)
        .zip(times.into_iter().map(median))
        .collect()
}

fn report(robot: &str, nv: usize, times: &[(&str, f64)]) {
    let time = |name: &str| times.iter().find(|t| t.0 == name).map(|t| t.1);
    let library = |name: &str| match name {
        "rnea" | "portable" => time("rnea_library"),
        // The better of Pinocchio's two conventions.
        other => Some(time(&format!("{other}_local"))?.min(time(&format!("{other}_world"))?)),
    };
    let cell = |x: Option<f64>, digits: usize| x.map_or("-".into(), |x| format!("{x:.digits$}"));
    for name in ["rnea", "portable", "crba", "aba"] {
        let (ours, theirs) = (time(name), library(name));
        let generated = time("generated").filter(|_| matches!(name, "rnea" | "portable"));
        let ratio = |other: Option<f64>| Some(ours? / other?);
        let label = if name == "portable" {
            "rnea, portable"
        } else {
            name
        };
        println!(
            "{robot:<16} {nv:>3}  {label:<18} {:>9} {:>9} {:>9}  {:>7} {:>7}",
            cell(ours, 0),
            cell(theirs, 0),
            cell(generated, 0),
            cell(ratio(theirs), 3),
            cell(ratio(generated), 3)
        );
    }
}
