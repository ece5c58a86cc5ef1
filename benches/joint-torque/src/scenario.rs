//! Runs of a joint on the bench: calibration and the papers' experiments.

use crate::joint::BenchJoint;
use plant::RigLoad;
use plant::random::Random;
use std::f64::consts::{PI, TAU};

/// A value over time.
pub type Course = Box<dyn Fn(f64) -> f64 + Send + Sync>;

/// One run on the bench.
pub struct Scenario {
    /// Its name in tables and files.
    pub name: &'static str,
    /// Description and source.
    pub about: &'static str,
    /// Length, s.
    pub seconds: f64,
    /// Estimates are judged from here on, s.
    pub judged_from: f64,
    /// Load on the joint.
    pub load: RigLoad,
    /// Set point of the drive, rad.
    pub q: Course,
    /// Torque from outside on the link, N·m.
    pub external: Course,
    /// Random numbers of its own.
    pub stream: u64,
}

/// Rises from 0 to 1 between 0 and 1, with no jerk at the ends.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (x * (6.0 * x - 15.0) + 10.0)
}

/// A hand that pushes irregularly: sinusoids between two frequencies, about `size` at most.
fn hand(seed: u64, low_hz: f64, high_hz: f64, size: f64) -> Course {
    const PARTS: usize = 9;
    let mut random = Random::new(seed, 5);
    let parts: Vec<[f64; 3]> = (0..PARTS)
        .map(|k| {
            let place = (k as f64 + random.unit()) / PARTS as f64;
            [
                low_hz * (high_hz / low_hz).powf(place),
                TAU * random.unit(),
                0.5 + random.unit(),
            ]
        })
        .collect();
    let all: f64 = parts.iter().map(|p| p[2] * p[2]).sum::<f64>().sqrt();
    Box::new(move |t| {
        let sum: f64 = parts
            .iter()
            .map(|[f, phase, a]| a * (TAU * f * t + phase).sin())
            .sum();
        size * smooth(t) * sum / all
    })
}

/// Steps between levels, each reached within `rise` seconds and kept until the next.
fn levels(list: Vec<f64>, every: f64, rise: f64) -> Course {
    Box::new(move |t| {
        let k = (t / every).floor().max(0.0) as usize;
        let at = |k: usize| list.get(k.min(list.len() - 1)).copied().unwrap_or(0.0);
        let before = if k == 0 { 0.0 } else { at(k - 1) };
        before + (at(k) - before) * smooth((t - k as f64 * every) / rise)
    })
}

fn still(q: f64) -> Course {
    Box::new(move |_| q)
}

fn none() -> Course {
    Box::new(|_| 0.0)
}

/// TURN: one unloaded output turn each way.
#[must_use]
pub fn turn(joint: &BenchJoint) -> Scenario {
    Scenario {
        name: "turn",
        about: "one unloaded output turn each way",
        seconds: 27.0,
        judged_from: 1.0,
        load: joint.bare(),
        q: Box::new(|t| {
            // A little more than a turn, at a constant speed over most of the way.
            let way = |x: f64| {
                let (ramp, x) = (0.05, x.clamp(0.0, 1.0));
                let rise = |y: f64| 0.5 * y * y / ramp;
                let whole = 1.0 - ramp;
                let run = match x {
                    x if x < ramp => rise(x),
                    x if x > 1.0 - ramp => whole - rise(1.0 - x),
                    x => x - 0.5 * ramp,
                };
                run / whole
            };
            2.1 * PI * (way((t - 0.5) / 12.5) - way((t - 13.5) / 12.5)) - 1.05 * PI
        }),
        external: none(),
        stream: 1,
    }
}

/// TRAIN: loaded motion and rest.
#[must_use]
pub fn train(joint: &BenchJoint) -> Scenario {
    let rated = joint.file.joint.rated_torque;
    let slow = hand(11, 0.03, 0.2, 0.55 * rated);
    let fast = hand(12, 0.4, 3.0, 0.33 * rated);
    let q_slow = hand(13, 0.03, 0.15, 0.9);
    let q_fast = hand(14, 0.3, 0.9, 0.28);
    let steps = levels(
        vec![
            0.0, 0.25, -0.3, 0.6, 0.0, -0.8, 0.9, -0.5, 0.15, -0.15, 0.75, 0.0,
        ],
        2.5,
        0.06,
    );
    Scenario {
        name: "train",
        about: "loaded motion and rest: slow loops and steps at rest, then slow and fast motion",
        seconds: 150.0,
        judged_from: 1.0,
        load: joint.pendulum(0.2),
        // 0-30 s: slow loops at rest; 30-60 s: steps at rest; then motion, slower and faster.
        q: Box::new(move |t| {
            let moving = smooth((t - 60.0) / 3.0);
            moving * (q_slow(t) + smooth((t - 100.0) / 2.0) * q_fast(t))
        }),
        external: Box::new(move |t| {
            let loops = rated
                * smooth(t / 4.0)
                * (0.95 * (TAU * t / 15.0).sin() * (0.35 + 0.65 * smooth((t - 12.0) / 15.0)));
            let at_rest = loops * (1.0 - smooth((t - 28.0) / 2.0))
                + rated * steps(t - 30.0) * smooth(t - 30.0) * (1.0 - smooth(t - 59.0));
            let moving = smooth((t - 60.0) / 3.0);
            at_rest + moving * (slow(t) + fast(t) * smooth((t - 80.0) / 2.0))
        }),
        stream: 2,
    }
}

/// The experiments of Z, G and S.
#[must_use]
pub fn experiments(joint: &BenchJoint) -> Vec<Scenario> {
    let rated = joint.file.joint.rated_torque;
    let frequent = {
        let mut random = Random::new(31, 6);
        let list = (0..60).map(|_| rated * 0.95 * random.symmetric()).collect();
        levels(list, 0.5, 0.08)
    };
    let stairs = {
        let up = [0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0];
        let down = up.iter().skip(1).map(|x| -x);
        levels(
            up.iter().copied().chain(down).map(|x| rated * x).collect(),
            2.0,
            0.4,
        )
    };
    let hung = 0.25 * rated;
    vec![
        Scenario {
            name: "slow",
            about: "sinusoidal motion of a weight on the link: load changes slowly (Z, G, S: 1)",
            seconds: 40.0,
            judged_from: 1.0,
            load: joint.pendulum(0.5),
            q: Box::new(|t| 1.2 * smooth(t / 2.0) * (TAU * 0.08 * t).sin()),
            external: none(),
            stream: 3,
        },
        Scenario {
            name: "fast",
            about: "load pushed irregularly by hand in both directions (Z, G, S: 2)",
            seconds: 30.0,
            judged_from: 1.0,
            load: joint.pendulum(0.2),
            q: still(0.3),
            external: hand(21, 0.4, 3.0, 0.32 * rated),
            stream: 4,
        },
        Scenario {
            name: "sudden",
            about: "weight on a wire, cut: position held, load released in 5 ms (Z, G, S: 3)",
            seconds: 12.0,
            judged_from: 1.0,
            load: joint.pendulum(0.4),
            q: still(0.9),
            external: Box::new(move |t| -hung * (1.0 - smooth((t - 6.0) / 0.005))),
            stream: 5,
        },
        Scenario {
            name: "frequent",
            about: "payload changes every half second up to the rated torque (G: 4)",
            seconds: 30.0,
            judged_from: 1.0,
            load: joint.pendulum(0.1),
            q: still(-0.4),
            external: frequent,
            stream: 6,
        },
        Scenario {
            name: "static",
            about: "steps up to the rated torque both ways, two seconds each (Z, S: 4)",
            seconds: 34.0,
            judged_from: 1.0,
            load: joint.pendulum(0.1),
            q: still(0.2),
            external: stairs,
            stream: 7,
        },
        Scenario {
            name: "rest",
            about: "a joint that has moved comes to rest under a constant load",
            seconds: 20.0,
            judged_from: 5.0,
            load: joint.pendulum(0.4),
            q: Box::new(|t| 0.8 * smooth(t / 3.0)),
            external: none(),
            stream: 8,
        },
    ]
}

/// U's two: the joint turns over 80 degrees under a sinusoidal torque.
#[must_use]
pub fn u_experiments(joint: &BenchJoint) -> Vec<Scenario> {
    // As parts of the 16 N·m joint's rated torque: 1.136 and 5.303 N·m at most.
    let rated = joint.file.joint.rated_torque;
    let part = |torque: f64| torque / 16.0 * rated;
    let sine = |hz: f64, size: f64| -> Course {
        Box::new(move |t| size * smooth(t / 2.0) * (TAU * hz * t).sin())
    };
    let over_80_degrees =
        |hz: f64| -> Course { Box::new(move |t| 0.7 * smooth(t / 3.0) * (TAU * hz * t).sin()) };
    vec![
        Scenario {
            name: "U fast small",
            about: "80 degrees of motion, sinusoidal torque of 1 Hz, at most 1.136 N·m (U 4.1)",
            seconds: 30.0,
            judged_from: 3.0,
            load: joint.bare(),
            q: over_80_degrees(0.15),
            external: sine(1.0, part(1.05)),
            stream: 9,
        },
        Scenario {
            name: "U slow large",
            about: "80 degrees of motion, sinusoidal torque of 0.1 Hz, at most 5.303 N·m (U 4.2)",
            seconds: 40.0,
            judged_from: 3.0,
            load: joint.bare(),
            q: over_80_degrees(0.05),
            external: sine(0.1, part(5.2)),
            stream: 10,
        },
    ]
}
