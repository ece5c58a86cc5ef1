//! Course of a run of a joint of the family: motion of its set point, torque on its output.

use crate::random::Draw;
use std::f64::consts::{PI, TAU};

/// A value over time.
pub type Course = Box<dyn Fn(f64) -> f64>;

/// One run; torques in units of the rated one.
pub struct Run {
    /// Its name.
    pub name: &'static str,
    /// Length, s.
    pub seconds: f64,
    /// Judged from here on, s.
    pub from: f64,
    /// Torque of the load's weight when level, of the rated torque.
    pub weight: f64,
    /// Set point, rad link side.
    pub q: Course,
    /// Torque from outside.
    pub torque: Course,
    /// Stream of its random numbers.
    pub stream: u64,
}

/// Training runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Training {
    /// 120 s: loops and steps at rest, then slow and fast motion.
    Full,
    /// The same within 20 s.
    Seconds20,
    /// The same within 10 s.
    Seconds10,
    /// 60 s of slow loading and slow motion alone.
    Slow,
    /// `Full` with three times the noise; judged with it too.
    Noisy,
    /// `Full` with an eighth of the encoders' counts; judged with it too.
    Coarse,
    /// `Full` with two thirds of the load.
    TwoThirds,
    /// `Full`, judged at angles that its loaded motion has not reached (the unloaded turn has).
    Outside,
    /// 8 s of motion under loads of one sign, no unloaded turn, an encoder zero of each log's own.
    OneSign,
    /// The same of a joint that stands.
    Standing,
}

impl Training {
    /// All of them, with their names.
    pub const ALL: [(Self, &'static str); 8] = [
        (Self::Full, "full"),
        (Self::Seconds20, "20 s"),
        (Self::Seconds10, "10 s"),
        (Self::Slow, "slow"),
        (Self::Noisy, "noise x3"),
        (Self::Coarse, "counts/8"),
        (Self::TwoThirds, "two thirds"),
        (Self::Outside, "outside"),
    ];
    /// Those without an unloaded turn, as logs of robots in use are: each judged run is tared at its start.
    pub const UNTURNED: [(Self, &'static str); 2] =
        [(Self::OneSign, "one sign"), (Self::Standing, "standing")];

    /// Whether it is one of [`Self::UNTURNED`].
    #[must_use]
    pub fn is_unturned(self) -> bool {
        matches!(self, Self::OneSign | Self::Standing)
    }
}

/// From 0 to 1 between 0 and 1, smooth at both ends.
fn ease(x: f64) -> f64 {
    0.5 - 0.5 * (PI * x.clamp(0.0, 1.0)).cos()
}

/// Sinusoids with periods between two bounds, of RMS `size / 2`, starting from nothing.
fn wander(draw: &mut Draw, low_hz: f64, high_hz: f64, size: f64) -> Course {
    let parts: Vec<[f64; 2]> = (0..8)
        .map(|_| [draw.scale(low_hz, high_hz), draw.within(0.0, TAU)])
        .collect();
    Box::new(move |t| {
        let sum: f64 = parts.iter().map(|[f, p]| (TAU * f * t + p).sin()).sum();
        size * ease(t) * sum / 4.0
    })
}

/// Levels of equal length, each reached within `rise` s.
fn levels(list: Vec<f64>, every: f64, rise: f64) -> Course {
    Box::new(move |t| {
        let k = (t / every).max(0.0) as usize;
        let at = |k: Option<usize>| k.map_or(0.0, |k| list.get(k).copied().unwrap_or(0.0));
        let before = at(k.checked_sub(1));
        before + (at(Some(k)) - before) * ease((t - k as f64 * every) / rise)
    })
}

/// One unloaded output turn each way.
#[must_use]
pub fn turn() -> Run {
    Run {
        name: "turn",
        seconds: 26.0,
        from: 0.0,
        weight: 0.0,
        q: Box::new(|t| {
            // Ramps of a fifth of a second at the ends.
            let way = |x: f64| {
                let x = x.clamp(0.0, 12.0);
                let ramp = |y: f64| 2.5 * y * y;
                let run = match x {
                    x if x < 0.2 => ramp(x),
                    x if x > 11.8 => 11.8 - ramp(12.0 - x),
                    x => x - 0.1,
                };
                run / 11.8
            };
            2.08 * PI * (way(t - 0.5) - way(t - 13.3)) - 1.04 * PI
        }),
        torque: Box::new(|_| 0.0),
        stream: 11,
    }
}

/// Loads of one sign: `sign` times 0.1 to 0.9 of the rated torque; the joint turns to and fro or stands.
fn one_sign(draw: &mut Draw, name: &'static str, sign: f64, moves: bool, stream: u64) -> Run {
    let load = wander(draw, 0.1, 0.8, 0.35);
    let way = wander(draw, 0.1, 0.5, 0.7);
    let place = draw.within(-1.0, 1.0);
    let level = draw.within(0.35, 0.55);
    Run {
        name,
        seconds: 8.0,
        from: 0.0,
        weight: 0.0,
        q: Box::new(move |t| place + if moves { way(t - 0.2) } else { 0.0 }),
        // The load is there from the first sample on, as gravity is.
        torque: Box::new(move |t| sign * (level + load(t - 0.2).clamp(-0.35, 0.45))),
        stream,
    }
}

/// Runs that are judged after the trainings without an unloaded turn, beside [`scenarios`]: loads of the other
/// sign, in motion and at rest.
#[must_use]
pub fn other_sign(number: u64) -> Vec<Run> {
    let mut draw = Draw::new(number, 9);
    let sign = training_sign(number);
    vec![
        one_sign(&mut draw, "other sign, moving", -sign, true, 6),
        one_sign(&mut draw, "other sign, standing", -sign, false, 7),
    ]
}

fn training_sign(number: u64) -> f64 {
    if number.is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// A training run of a joint.
#[must_use]
pub fn training(kind: Training, number: u64) -> Run {
    if kind.is_unturned() {
        let moves = kind == Training::OneSign;
        let mut draw = Draw::new(number, 10);
        return one_sign(&mut draw, "training", training_sign(number), moves, 12);
    }
    let mut draw = Draw::new(number, 7);
    let (seconds, size): (f64, f64) = match kind {
        Training::Seconds10 => (10.0, 1.0),
        Training::Seconds20 => (20.0, 1.0),
        Training::Slow => (60.0, 1.0),
        Training::TwoThirds => (120.0, 2.0 / 3.0),
        _ => (120.0, 1.0),
    };
    let slow_only = kind == Training::Slow;
    // Parts: loops at rest, steps at rest, motion.
    let (loops, steps) = if slow_only {
        (0.5 * seconds, 0.5 * seconds)
    } else {
        (0.2 * seconds, 0.4 * seconds)
    };
    let period = loops / if seconds < 30.0 { 1.5 } else { 2.5 };
    let quick = (30.0 / seconds).clamp(1.0, 3.0);
    let list = (0..40).map(|_| draw.within(-0.95, 0.95)).collect();
    let step = levels(list, (0.08 * (steps - loops)).max(0.4), 0.05);
    let slow = wander(&mut draw, 0.03 * quick, 0.2 * quick, 0.9);
    let fast = wander(&mut draw, 0.4, 4.0, 0.55);
    let q_slow = wander(&mut draw, 0.03 * quick, 0.15 * quick, 1.3);
    let q_fast = wander(&mut draw, 0.3, 1.0, 0.4);
    let late = steps + 0.5 * (seconds - steps);
    let fading = 0.3;
    // A run without fast motion has neither steps nor fast loads.
    let at_rest = if slow_only { 0.0 } else { 1.0 };
    let quickly = move |t: f64| at_rest * ease(t - 0.5 * (late + steps));
    Run {
        name: "training",
        seconds,
        from: 0.0,
        weight: 0.2 * size,
        q: Box::new(move |t| {
            let fast = at_rest * ease((t - late) / 2.0);
            ease((t - steps) / 2.0) * (q_slow(t) + fast * q_fast(t))
        }),
        torque: Box::new(move |t| {
            let at_loops = 0.95
                * ease(2.0 * t / loops)
                * (TAU * t / period).sin()
                * (1.0 - ease((t - loops + fading) / fading));
            let at_steps = step(t - loops)
                * (1.0 - ease((t - steps + fading) / fading))
                * ease((t - loops) / 0.01);
            let moving = ease((t - steps) / 1.0) * (slow(t) + quickly(t) * fast(t));
            size * (at_loops + at_rest * at_steps + moving)
        }),
        stream: 12,
    }
}

/// The scenarios that are judged.
#[must_use]
pub fn scenarios(number: u64) -> Vec<Run> {
    let mut draw = Draw::new(number, 8);
    let place = draw.within(-1.0, 1.0);
    around(draw, place, (0.0, 1.2))
}

/// Loads of the scenarios outside, of those within: an error of the kinematic error shows in small torques.
const SMALL: f64 = 0.4;

/// The scenarios of [`Training::Outside`]: up to 0.6 rad beyond the angles of its loaded motion.
#[must_use]
pub fn outside(number: u64) -> Vec<Run> {
    let training = training(Training::Outside, number);
    let angles = (0..(20.0 * training.seconds) as usize).map(|k| (training.q)(0.05 * k as f64));
    let (low, high) = angles.fold((0.0f64, 0.0f64), |(low, high), q| (low.min(q), high.max(q)));
    let mut draw = Draw::new(number, 13);
    let beyond = draw.within(0.2, 0.6);
    let place = if draw.within(-1.0, 1.0) > 0.0 {
        high + beyond
    } else {
        low - beyond
    };
    let mut runs = around(draw, place, (place, 0.2));
    for run in &mut runs {
        let torque = std::mem::replace(&mut run.torque, Box::new(|_| 0.0));
        run.torque = Box::new(move |t| SMALL * torque(t));
        run.weight *= SMALL;
    }
    runs
}

/// The scenarios at rest at `place`, and one that turns to and fro about a middle.
fn around(mut draw: Draw, place: f64, (middle, way): (f64, f64)) -> Vec<Run> {
    let still = move || -> Course { Box::new(move |_| place) };
    let stairs: Vec<f64> = [0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0]
        .into_iter()
        .flat_map(|x| [x])
        .chain([-0.25, -0.5, -0.75, -1.0, -0.75, -0.5, -0.25, 0.0])
        .collect();
    let frequent = (0..60).map(|_| draw.within(-0.95, 0.95)).collect();
    let run = |name, seconds, weight, q, torque, stream| Run {
        name,
        seconds,
        from: 1.0,
        weight,
        q,
        torque,
        stream,
    };
    vec![
        run(
            "slow",
            26.0,
            0.5,
            Box::new(move |t| middle + way * ease(t / 3.0) * (TAU * 0.08 * t).sin()),
            Box::new(|_| 0.0),
            1,
        ),
        run(
            "fast",
            20.0,
            0.2,
            still(),
            wander(&mut draw, 0.4, 3.0, 0.6),
            2,
        ),
        run(
            "sudden",
            10.0,
            0.3,
            still(),
            Box::new(|t| 0.3 * ease(t) * (1.0 - ease((t - 5.0) / 0.005))),
            3,
        ),
        run(
            "frequent",
            20.0,
            0.1,
            still(),
            levels(frequent, 0.5, 0.08),
            4,
        ),
        run("static", 32.0, 0.1, still(), levels(stairs, 2.0, 0.3), 5),
    ]
}
