//! Prints docs/results/whole-body.md: what the whole-body estimators reach on the humanoid plant.
//!
//!     cargo run --release -p whole-body --example results > docs/results/whole-body.md

#![allow(clippy::disallowed_macros, reason = "prints a page")]

#[allow(dead_code)] // tests use the rest
#[path = "../tests/walk/mod.rs"]
mod walk;

use walk::station::{Fault, Push, Station, Traces, deviation, error, in_the_air, lag};
use walk::{PERIOD, WINDOW, largest, simulation};
use whole_body::Cause;

/// A shorter window, samples.
const SHORT: usize = 30;
const SECONDS: f64 = 12.0;

fn main() {
    println!("# Whole-body torques on the humanoid plant\n");
    println!(
        "Printed by `cargo run --release -p whole-body --example results`. The humanoid of \
         `config/humanoid` hangs in a springy harness at its chest and steps on the spot, 2.4 s a \
         cycle; `crates/plant` simulates it with masses 1 % off, F/T bias up to 10 N and 1 N·m, \
         cross-talk, noise and bias of every sensor, hysteresis and friction in every gear. F/T \
         sensors are tared in the air; then come {SECONDS} s of stepping.\n"
    );
    torques();
    tares();
    faults();
}

fn stepping(seed: u64, window: usize) -> (Station, Traces, Traces) {
    let mut station = Station::new(&simulation(seed), window);
    station.run(1.5);
    station.tare(in_the_air());
    station.run(1.0);
    let rest = station.record(1.0);
    station.walk.stepping_since = Some(station.walk.time());
    station.run(3.0);
    let walk = station.record(SECONDS);
    (station, rest, walk)
}

fn torques() {
    println!("## Torques\n");
    println!(
        "RMS errors in per cent of the joint's largest torque on the way: `late` against the truth \
         at the estimate's own instant (half a window ago), with filters of 80 samples (D 5.1) and \
         of 30; `now` against the truth now: the late estimate, the encoders' alone, and the \
         predictive estimator that joins them. Delay: greatest cross-correlation with the truth. \
         Noise: standard deviation at rest.\n"
    );
    println!(
        "| joint | largest, N·m | late 80, % | late 30, % | late 80 now, % | encoders now, % | \
         predictive now, % | delay late, ms | delay predictive, ms | noise late 80, N·m | noise \
         predictive, N·m |"
    );
    println!("|{}", " --- |".repeat(11));
    let (station, rest, walk) = stepping(1, WINDOW);
    let (_, _, short) = stepping(1, SHORT);
    let half = |window: usize| 0.5 * (window - 1) as f64;
    for j in 0..station.joints() {
        let truth = &walk.truth[j];
        let most = largest(truth);
        let per_cent = |e: f64| 100.0 * e / most;
        println!(
            "| {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.1} | {:.1} | {:.4} | {:.4} |",
            station.walk.joints[j],
            most,
            per_cent(error(&walk.late[j], truth, half(WINDOW))),
            per_cent(error(&short.late[j], &short.truth[j], half(SHORT))),
            per_cent(error(&walk.late[j], truth, 0.0)),
            per_cent(error(&walk.fast[j], truth, 0.0)),
            per_cent(error(&walk.now[j], truth, 0.0)),
            1e3 * PERIOD * lag(&walk.late[j], truth),
            1e3 * PERIOD * lag(&walk.now[j], truth),
            deviation(&rest.late[j]),
            deviation(&rest.now[j]),
        );
    }
    println!();
}

fn tares() {
    println!("## Tare\n");
    println!(
        "RMS torque error (filters of 20 samples) over the joints of the legs, N·m, stepping after a \
         tare in the start's pose, in another (knees and elbows bent further, wrists turned), and \
         without.\n"
    );
    let run = |pose: Option<fn(&str) -> f64>| {
        let mut station = Station::new(&simulation(1), 20);
        station.run(1.0);
        if let Some(pose) = pose {
            station.walk.pose = pose;
            station.run(2.0);
            station.tare(in_the_air());
            station.walk.pose = |_| 0.0;
            station.run(1.0);
        } else {
            station.run(3.6);
        }
        station.walk.stepping_since = Some(station.walk.time());
        station.run(3.0);
        let t = station.record(5.0);
        let errors: Vec<f64> = (0..12)
            .map(|j| error(&t.late[j], &t.truth[j], 9.5))
            .collect();
        walk::rms(&errors)
    };
    let own = run(Some(|_| 0.0));
    let other = run(Some(walk::bent));
    println!("| tare | RMS error, N·m |\n| --- | --- |");
    println!("| same pose | {own:.3} |");
    println!("| another pose | {other:.3} ({:.2} times) |", other / own);
    println!("| none | {:.3} |\n", run(None));
}

fn faults() {
    println!("## Cross-check\n");
    println!("Filters of 80 samples; a fault comes in while the robot steps.\n");
    println!("| fault | first named | after, s |\n| --- | --- | --- |");
    let slip = |joint, by| Fault {
        slip: Some((joint, by)),
        ..Fault::default()
    };
    let constant = |joint, by| Fault {
        constant: Some((joint, by)),
        ..Fault::default()
    };
    let drift = |sensor, by| Fault {
        drift: Some((sensor, by)),
        ..Fault::default()
    };
    let cases: [(&str, Fault, Option<Push>); 7] = [
        (
            "left knee's encoder slips by 0.05 degrees",
            slip(3, 9e-4),
            None,
        ),
        (
            "right hip roll's encoder slips by 0.03 degrees",
            slip(7, -5e-4),
            None,
        ),
        (
            "left ankle's F/T sensor is off by 40 N and 6 N·m",
            drift(0, [20.0, -20.0, 30.0, 4.0, 5.0, 1.0]),
            None,
        ),
        (
            "left knee: half of the torque constant",
            constant(3, 0.5),
            None,
        ),
        ("left knee: sign of the current", constant(3, -1.0), None),
        (
            "a push of 150 N on the left shank",
            Fault::default(),
            Some(("left_knee_link", [150.0, 0.0, 0.0])),
        ),
        (
            "a push of 30 N on the right hand",
            Fault::default(),
            Some(("right_hand", [0.0, 30.0, 0.0])),
        ),
    ];
    for (what, fault, push) in cases {
        let (cause, after) = walk::station::first_cause(fault, push);
        println!("| {what} | {cause} | {after} |");
    }
    let mut station = Station::new(&simulation(1), WINDOW);
    station.run(1.5);
    station.tare(in_the_air());
    station.walk.stepping_since = Some(station.walk.time());
    let mut named: Vec<Cause> = Vec::new();
    let minutes: usize = std::env::args()
        .nth(1)
        .and_then(|m| m.parse().ok())
        .unwrap_or(10);
    for _ in 0..minutes * 60_000 {
        station.advance();
        for cause in station.check.found() {
            if !named.contains(cause) {
                named.push(*cause);
            }
        }
    }
    println!("\nWithout a fault, in {minutes} minutes of stepping: {named:?}.");
}
