//! Writes docs/results/drive-identification.md: drives of simulated robots, identified from what the loop
//! records of them.

mod page;
mod simulate;
mod variant;

use clap::Parser;
use identification::drive::recorded::motor_rows;
use identification::drive::{Drive, identify};
use identification::motor::{Method, MotorFit, fit};
use simulate::{Recorded, Truth};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;
use test_support::ResultsPage;
use variant::Variant;

/// Identify the drives of simulated robots, and write the page of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The folder of the page
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
    /// Threads
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// The leg as shipped alone, with this seed; nothing is written
    #[arg(long, value_name = "SEED")]
    glance: Option<u64>,
    /// With --glance: the leg with another drive, named as on the page
    #[arg(long, value_name = "NAME", requires = "glance")]
    other: Option<String>,
}

const EXAMPLES: &str = "\
Examples:
  cargo run --release -p drive-identification-bench               some minutes on two cores
  cargo run --release -p drive-identification-bench -- --glance 7  the leg, to the terminal";

/// Joints that move at the same time: of different limbs.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) robot: &'static str,
    pub(crate) joints: Vec<usize>,
    pub(crate) seed: u64,
    pub(crate) variant: Variant,
}

/// One joint of one case.
pub(crate) struct Outcome {
    pub(crate) case: Case,
    pub(crate) joint: String,
    pub(crate) truth: Truth,
    /// The reason why there is none: the loop's fault, or a refusal.
    pub(crate) drive: Result<Drive, String>,
    /// By least squares, asymmetric penalty, two stages.
    pub(crate) motor: Vec<Option<MotorFit>>,
}

/// Seeds of the shipped robots, and of the variants.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=5;
const VARIANT_SEED: u64 = 11;
/// Joints of the leg that move at a time.
const PAIRS: [[usize; 2]; 3] = [[0, 3], [1, 4], [2, 5]];
/// Joints of the limbs, of each of which two move at a time.
const HUMANOID_LIMBS: [&str; 5] = [
    "left_hip left_knee left_ankle",
    "right_hip right_knee right_ankle",
    "chest",
    "left_shoulder left_elbow left_wrist",
    "right_shoulder right_elbow right_wrist",
];

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let cases = match arguments.glance {
        Some(seed) => {
            let named = |v: &&Variant| Some(v.name()) == arguments.other.as_deref();
            let variant = Variant::OTHERS.iter().find(named).copied();
            leg(seed, variant.unwrap_or(Variant::Shipped))
        }
        None => cases(),
    };
    let path = arguments.out.join("drive-identification.md");
    let write = |outcomes: &[&Outcome]| match arguments.glance {
        Some(_) => Ok(()),
        // After every case: a run that is ended leaves a page of what it has seen.
        None => ResultsPage::new(&page::page(outcomes))?.write(&path),
    };
    match cases.and_then(|cases| run(&cases, arguments.threads, &write)) {
        Ok(outcomes) => {
            if arguments.glance.is_some() {
                print!("{}", page::lines(&outcomes));
            }
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("drive-identification-bench: {message}");
            ExitCode::FAILURE
        }
    }
}

fn leg(seed: u64, variant: Variant) -> Result<Vec<Case>, String> {
    let (robot, _) = simulate::load("leg")?;
    let joints = 0..robot.parameters.joints.len();
    let case = |j| Case {
        robot: "leg",
        joints: vec![j],
        seed,
        variant,
    };
    Ok(joints.map(case).collect())
}

fn cases() -> Result<Vec<Case>, String> {
    let (humanoid, _) = simulate::load("humanoid")?;
    let limbs = HUMANOID_LIMBS.map(|parts| {
        let joints = humanoid.parameters.joints.iter().enumerate();
        let of_limb = |name: &str| parts.split(' ').any(|part| name.starts_with(part));
        let of_limb = joints.filter(|(_, joint)| of_limb(&joint.name));
        of_limb.map(|(j, _)| j).collect::<Vec<_>>()
    });
    let most = limbs.iter().map(Vec::len).max().unwrap_or(0);
    let paired = |seed, variant| {
        PAIRS.map(|joints| Case {
            robot: "leg",
            joints: joints.to_vec(),
            seed,
            variant,
        })
    };
    let mut cases = Vec::new();
    SEEDS.for_each(|seed| cases.extend(paired(seed, Variant::Shipped)));
    for variant in Variant::OTHERS {
        cases.extend(paired(VARIANT_SEED, variant));
    }
    for seed in SEEDS {
        // Two of a limb: the first and the fourth, the second and the fifth, and so on.
        cases.extend((0..most.div_ceil(2)).map(|k| {
            Case {
                robot: "humanoid",
                joints: (limbs.iter())
                    .flat_map(|limb| [limb.get(k), limb.get(k + most.div_ceil(2))])
                    .flatten()
                    .copied()
                    .collect(),
                seed,
                variant: Variant::Shipped,
            }
        }));
    }
    Ok(cases)
}

fn run(
    cases: &[Case],
    threads: usize,
    write: &(dyn Fn(&[&Outcome]) -> Result<(), String> + Sync),
) -> Result<Vec<Outcome>, String> {
    let next = Mutex::new(0);
    let done = Mutex::new(Vec::<(usize, Result<Vec<Outcome>, String>)>::new());
    let take = || {
        let mut next = next.lock().ok()?;
        *next += 1;
        eprint!("\r{} of {} ", next, cases.len());
        cases.get(*next - 1).map(|case| (*next, case))
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let Some((index, case)) = take() {
                    let outcomes = judge(case);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, outcomes));
                        done.sort_by_key(|(index, _): &(usize, _)| *index);
                        let all = done.iter().filter_map(|(_, one)| one.as_ref().ok());
                        let all: Vec<&Outcome> = all.flatten().collect();
                        if let Err(e) = write(&all) {
                            eprintln!("the page cannot be written: {e}");
                        }
                    }
                }
            });
        }
    });
    eprintln!();
    let done = done.into_inner().map_err(|e| e.to_string())?;
    let all: Result<Vec<Vec<Outcome>>, String> = done.into_iter().map(|(_, one)| one).collect();
    Ok(all?.into_iter().flatten().collect())
}

fn judge(case: &Case) -> Result<Vec<Outcome>, String> {
    let recorded = simulate::run(case.robot, &case.joints, case.seed, case.variant)?;
    let outcome = |recorded: Recorded| {
        let Recorded {
            joint,
            known,
            log,
            truth,
            fault,
        } = recorded;
        let drive = match fault {
            0 => identify(&known, &log).map_err(|e| e.to_string()),
            fault => Err(format!("fault {fault}")),
        };
        let rows = motor_rows(&log, &known, 4000);
        let methods = [Method::LeastSquares, Method::Asymmetric, Method::TwoStage];
        Outcome {
            case: case.clone(),
            joint,
            truth,
            drive,
            motor: methods.map(|method| fit(&rows, method).ok()).to_vec(),
        }
    };
    Ok(recorded.into_iter().map(outcome).collect())
}
