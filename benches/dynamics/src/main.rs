//! Times our dynamics beside Pinocchio's library and its generated code, in one process, batches
//! taking turns: usage `dynamics-bench FOLDER NAME=BASE=URDF...`, where FOLDER holds the libraries
//! built by run.sh, and BASE is fixed or floating.

mod library;

use dynamics::{Base, Data, Instructions, Model, Random, UrdfOptions, aba, crba, rnea};
use library::{Algorithm, Generated, Library};
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
        eprintln!("usage: dynamics-bench FOLDER NAME=BASE=URDF...");
        return ExitCode::from(2);
    };
    pin_to_last_cpu();
    println!(
        "medians of {ROUNDS} rounds over {STATES} random states, ns; ratios of medians, of minima"
    );
    println!(
        "robot             nv  algorithm         ours  library  generated    /lib   /gen    /lib   /gen"
    );
    for robot in robots {
        let parts: Vec<&str> = robot.splitn(3, '=').collect();
        let [name, base @ ("fixed" | "floating"), urdf] = parts[..] else {
            eprintln!("{robot}: allowed: NAME=fixed=URDF, NAME=floating=URDF");
            return ExitCode::from(2);
        };
        let base = match base {
            "fixed" => Base::Fixed,
            _ => Base::Floating,
        };
        if let Err(message) = bench(Path::new(folder), name, base, urdf) {
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
fn model(base: Base, urdf: &str) -> Result<Model, String> {
    let text = std::fs::read_to_string(urdf).map_err(|e| format!("{urdf}: {e}"))?;
    let joints = text.split("<joint").skip(1);
    let name = |j: &str| Some(j.split_once("name=\"")?.1.split_once('"')?.0.to_owned());
    let options = UrdfOptions {
        base,
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

/// The timed algorithms.
struct Candidate<'a> {
    name: &'static str,
    run: Box<dyn FnMut(&State) + 'a>,
    /// ns per call, one of each round.
    times: Vec<f64>,
}

impl<'a> Candidate<'a> {
    fn new(name: &'static str, run: impl FnMut(&State) + 'a) -> Self {
        Self {
            name,
            run: Box::new(run),
            times: Vec::with_capacity(ROUNDS),
        }
    }
    /// Median and minimum.
    fn typical(&self) -> [f64; 2] {
        let mut times = self.times.clone();
        times.sort_by(f64::total_cmp);
        [times[times.len() / 2], times[0]]
    }
}

fn bench(folder: &Path, name: &str, base: Base, urdf: &str) -> Result<(), String> {
    let model = model(base, urdf)?;
    let mut data = Data::new(&model);
    let states = states(&model, &mut data);
    let robot = folder.join(format!("{name}.txt"));
    let library = Library::new(&folder.join("liblibrary.so"), &robot)?;
    let generated = |compiler| Generated::new(&folder.join(format!("{name}_rnea_{compiler}.so")));
    let generated = [generated("clang")?, generated("clang19")?];
    compare(&model, &mut data, &library, &generated, &states)?;

    let model = &model;
    let mut portable = data.clone();
    portable.set_instructions(Instructions::Portable);
    let [mut d1, mut d2, mut d3] = [data.clone(), data.clone(), data];
    let [mut tau, mut tau19] = [(); 2].map(|()| vec![0.0; model.nv()]);
    let mut candidates = vec![
        Candidate::new("rnea", |s| {
            black_box(rnea(model, &mut d1, &s.q, &s.v, &s.a, None));
        }),
        Candidate::new("crba", |s| {
            black_box(crba(model, &mut d2, &s.q));
        }),
        Candidate::new("aba", |s| {
            black_box(aba(model, &mut d3, &s.q, &s.v, &s.tau, None));
        }),
        Candidate::new("rnea_portable", |s| {
            black_box(rnea(model, &mut portable, &s.q, &s.v, &s.a, None));
        }),
        Candidate::new("rnea_generated", |s| {
            generated[0].run(&s.all, &mut tau);
            black_box(&tau);
        }),
        Candidate::new("rnea_generated_19", |s| {
            generated[1].run(&s.all, &mut tau19);
            black_box(&tau19);
        }),
    ];
    for algorithm in library::ALGORITHMS {
        let library = &library;
        candidates.push(Candidate::new(algorithm.symbol(), move |s| {
            black_box(library.run(algorithm, &s.q, &s.v, s.last(algorithm)));
        }));
    }
    take_turns(&mut candidates, &states);
    report(name, model.nv(), &candidates);
    Ok(())
}

impl State {
    /// The last argument of one of the library's algorithms.
    fn last(&self, algorithm: Algorithm) -> &[f64] {
        match algorithm {
            Algorithm::AbaLocal | Algorithm::AbaWorld => &self.tau,
            _ => &self.a,
        }
    }
}

/// Ours against theirs: only right results are timed.
fn compare(
    model: &Model,
    data: &mut Data,
    library: &Library,
    generated: &[Generated],
    states: &[State],
) -> Result<(), String> {
    let nv = model.nv();
    let mut tau = vec![0.0; nv];
    for s in states {
        for generated in generated {
            generated.run(&s.all, &mut tau);
            same("generated rnea", &tau, &s.tau)?;
        }
        for algorithm in library::ALGORITHMS {
            let theirs = library.run(algorithm, &s.q, &s.v, s.last(algorithm));
            let numbers = match algorithm {
                Algorithm::Rnea | Algorithm::AbaLocal | Algorithm::AbaWorld => nv,
                Algorithm::CrbaLocal | Algorithm::CrbaWorld => nv * nv,
            };
            // SAFETY: the result has that many numbers, and nothing has run since.
            let theirs = unsafe { std::slice::from_raw_parts(theirs, numbers) };
            let name = algorithm.symbol();
            match algorithm {
                Algorithm::Rnea => same(name, &s.tau, theirs)?,
                // Where M is badly conditioned accelerations differ; torques that they explain do not.
                Algorithm::AbaLocal | Algorithm::AbaWorld => {
                    let ours = aba(model, data, &s.q, &s.v, &s.tau, None).to_vec();
                    for a in [ours.as_slice(), theirs] {
                        same(name, rnea(model, data, &s.q, &s.v, a, None), &s.tau)?;
                    }
                }
                // Pinocchio fills the upper triangle.
                Algorithm::CrbaLocal | Algorithm::CrbaWorld => {
                    let m = crba(model, data, &s.q);
                    for c in 0..nv {
                        let column = c * nv..=c * nv + c;
                        same(name, &m.as_slice()[column.clone()], &theirs[column])?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// Fails where two vectors differ by more than 1e-10 of the largest component (or of 1).
fn same(what: &str, ours: &[f64], theirs: &[f64]) -> Result<(), String> {
    let scale = theirs.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    let near = |(x, y): (&f64, &f64)| (x - y).abs() <= 1e-10 * scale;
    if ours.iter().zip(theirs).all(near) {
        return Ok(());
    }
    Err(format!("{what}: our result differs from Pinocchio's"))
}

/// Every candidate runs all states, then again, so that load on this machine slows all of them.
fn take_turns(candidates: &mut [Candidate], states: &[State]) {
    for _ in 0..ROUNDS {
        for candidate in &mut *candidates {
            let start = Instant::now();
            states.iter().for_each(&mut candidate.run);
            let time = start.elapsed().as_nanos() as f64 / states.len() as f64;
            candidate.times.push(time);
        }
    }
}

fn report(robot: &str, nv: usize, candidates: &[Candidate]) {
    let time = |name: &str| {
        let found = candidates.iter().find(|c| c.name == name);
        found.map(Candidate::typical)
    };
    let symbol = |algorithm: Algorithm| time(algorithm.symbol());
    let faster = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].min(b[1])];
    // The better of Pinocchio's two conventions.
    let better = |a, b| Some(faster(symbol(a)?, symbol(b)?));
    // The faster of two compilers.
    let generated = time("rnea_generated").zip(time("rnea_generated_19"));
    let generated = generated.map(|(a, b)| faster(a, b));
    let rows = [
        ("rnea", "RNEA", symbol(Algorithm::Rnea), generated),
        (
            "rnea_portable",
            "RNEA, portable",
            symbol(Algorithm::Rnea),
            generated,
        ),
        (
            "crba",
            "CRBA",
            better(Algorithm::CrbaLocal, Algorithm::CrbaWorld),
            None,
        ),
        (
            "aba",
            "ABA",
            better(Algorithm::AbaLocal, Algorithm::AbaWorld),
            None,
        ),
    ];
    let cell = |x: Option<f64>, digits: usize| x.map_or("-".into(), |x| format!("{x:.digits$}"));
    for (name, shown, library, generated) in rows {
        let ours = time(name);
        let ratio = |other: Option<[f64; 2]>| Some(ours?[0] / other?[0]);
        let median = |times: Option<[f64; 2]>| cell(times.map(|t| t[0]), 0);
        println!(
            "| {robot} | {nv} | {shown} | {} | {} | {} | {} | {} |",
            median(ours),
            median(library),
            median(generated),
            cell(ratio(library), 3),
            cell(ratio(generated), 3)
        );
    }
}
