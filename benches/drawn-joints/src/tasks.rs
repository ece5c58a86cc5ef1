//! Tasks of a joint, and its figures in them.

use crate::config::Bristles;
use crate::draw::Drawn;
use crate::plant::Outside;
use crate::rig::{PERIOD, Rig};
use robot_config::Robot;
use robot_state::Event;
use std::f64::consts::TAU;

/// Frequencies of the response, Hz: those of the page of the own plant.
const FREQUENCIES: [f64; 17] = [
    1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0, 14.0, 16.0, 18.0, 21.0, 25.0, 30.0, 36.0, 44.0, 55.0, 70.0,
];
/// Bias of the blocked joint's torque, and its step, share of rated: as on that page.
const BIAS: f64 = 0.3;
const STEP: f64 = 0.2;
/// Where a joint begins, rad.
const START: f64 = 0.3;
/// For how long it holds before the first mode, s.
const HOLDS: f64 = 1.0;
/// Velocity with which a hand leads the link, and with which it meets walls and blocks, rad/s.
const LED: f64 = 0.5;
const MEETS: f64 = 0.4;
/// A wall of 75 N/mm at 0.4 m from the axis, N·m/rad, and the damping of one that lets a link bounce, share of critical.
const WALL: f64 = 75_000.0 * 0.4 * 0.4;
const WALL_DAMPING: f64 = 0.1;
/// A block is stiffer than the gear by this factor.
const BLOCK: f64 = 20.0;
/// Torque of the impact of the link alone that no velocity exceeds, share of the limit: harder ones overload the gear.
const IMPACT: f64 = 0.4;
/// Way to what the link meets, rad.
const AWAY: f64 = 0.1;
/// Torque of K_s at which a client notices it, share of rated, and accelerations with which it starts and brakes, rad/s².
const NOTICED: f64 = 0.3;
const STARTS: f64 = 4.0;
const BRAKES: f64 = 20.0;

/// Outcome of a task.
#[derive(Debug, Clone, Default)]
pub(crate) struct Figures {
    /// Blocked, -3 dB at 2 % and 20 % of rated, Hz, absolute and over the gain at 1 Hz.
    pub(crate) bandwidth: [f64; 2],
    pub(crate) relative: [f64; 2],
    /// Largest gain there.
    pub(crate) peak: [f64; 2],
    /// Step of 20 % of rated: overshoot, % of the step as it ends, and rise, ms.
    pub(crate) overshoot: f64,
    pub(crate) rise: f64,
    /// Greatest torque around a reversal of the hand, % of rated, and mean against its motion.
    pub(crate) reversal: f64,
    pub(crate) mean: f64,
    /// Torque at rest from peak to peak, % of the limit: on a spring in inverse dynamics, on a wall in torque, free.
    pub(crate) rest: [f64; 3],
    /// Tasks that ended with a fault: task, event and time, s.
    pub(crate) faults: Vec<(&'static str, Event, f64)>,
    /// Tasks whose mode ended without a fault.
    pub(crate) ended: Vec<&'static str>,
    /// Events of all tasks.
    pub(crate) events: Vec<(Event, u64)>,
}

/// How much is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent {
    /// Only the first of so many frequencies.
    pub(crate) every: usize,
    /// Time of rest, s.
    pub(crate) rests: f64,
    /// Only the blocked joint and the hand.
    pub(crate) torque_only: bool,
}

impl Extent {
    pub(crate) const ALL: Self = Self {
        every: 1,
        rests: 20.0,
        torque_only: false,
    };
}

/// Judges a joint in every task.
///
/// # Errors
/// A robot that the cycle cannot run.
pub(crate) fn judge(drawn: &Drawn, robot: &Robot, extent: Extent) -> Result<Figures, String> {
    let mut figures = Figures::default();
    for (at, share) in [0.02, 0.2].into_iter().enumerate() {
        let name = ["blocked, 2 %", "blocked, 20 %"][at];
        let mut rig = begin(drawn, robot, Outside::Blocked)?;
        let [absolute, relative, peak] =
            response(&mut rig, drawn.catalogue.rated, share, extent.every);
        let failed = end(&rig, name, &mut figures);
        let it = |hz: f64| if failed { 0.0 } else { hz };
        figures.bandwidth[at] = it(absolute);
        figures.relative[at] = it(relative);
        figures.peak[at] = peak;
    }
    let mut rig = begin(drawn, robot, Outside::Blocked)?;
    let [rise, overshoot] = step(&mut rig, drawn.catalogue.rated);
    let failed = end(&rig, "step", &mut figures);
    (figures.rise, figures.overshoot) = failing(failed, (rise, overshoot));
    let mut rig = begin(drawn, robot, Outside::Led(0.0))?;
    let [reversal, mean] = hand(&mut rig, drawn.catalogue.rated);
    let failed = end(&rig, "hand", &mut figures);
    (figures.reversal, figures.mean) = failing(failed, (reversal, mean));
    if extent.torque_only {
        return Ok(figures);
    }
    for (name, stiffness) in [("wall", WALL), ("block", BLOCK * drawn.gear.stiffness)] {
        let mut rig = begin(drawn, robot, Outside::Free)?;
        meets(&mut rig, drawn, stiffness);
        end(&rig, name, &mut figures);
    }
    for at in 0..3 {
        let name = ["rest on a spring", "rest on a wall", "rest, free"][at];
        let swing = rest(drawn, robot, at, extent.rests, &mut figures, name)?;
        figures.rest[at] = swing;
    }
    Ok(figures)
}

fn failing(failed: bool, of: (f64, f64)) -> (f64, f64) {
    if failed {
        (f64::INFINITY, f64::INFINITY)
    } else {
        of
    }
}

fn begin(drawn: &Drawn, robot: &Robot, outside: Outside) -> Result<Rig, String> {
    let mut rig = Rig::new(robot, drawn.at_rest(START, outside))?;
    rig.hold(HOLDS);
    Ok(rig)
}

/// Notes how a task has ended; true if it did so before its time.
fn end(rig: &Rig, task: &'static str, figures: &mut Figures) -> bool {
    if let Some((event, time)) = rig.fault() {
        figures.faults.push((task, event, time));
    } else if rig.has_ended() {
        figures.ended.push(task);
    }
    for (event, count) in rig.events() {
        match figures.events.iter_mut().find(|(own, _)| *own == event) {
            Some((_, own)) => *own += count,
            None => figures.events.push((event, count)),
        }
    }
    rig.has_ended()
}

/// Cycles in this time, s.
fn cycles(seconds: f64) -> usize {
    (seconds / PERIOD).round() as usize
}

/// -3 dB absolute and over the gain at 1 Hz, Hz, and the largest gain.
fn response(rig: &mut Rig, rated: f64, share: f64, every: usize) -> [f64; 3] {
    let (bias, amplitude) = (BIAS * rated, share * rated);
    for k in 0..cycles(1.5) {
        rig.torque(bias * (k as f64 * PERIOD / 0.5).min(1.0));
    }
    let frequencies = FREQUENCIES.into_iter().step_by(every);
    let gains: Vec<(f64, f64)> = frequencies
        .map(|frequency| (frequency, gain_at(rig, bias, amplitude, frequency)))
        .collect();
    let first = gains.first().map_or(1.0, |gain| gain.1);
    let peak = gains.iter().fold(0.0_f64, |most, gain| most.max(gain.1));
    let half_power = 0.5_f64.sqrt();
    [
        falls_below(&gains, half_power),
        falls_below(&gains, half_power * first),
        peak,
    ]
}

/// Frequency at which the gain first falls below a level, Hz; zero if it begins there.
fn falls_below(gains: &[(f64, f64)], level: f64) -> f64 {
    let Some(at) = gains.iter().position(|(_, gain)| *gain < level) else {
        return gains.last().map_or(0.0, |gain| gain.0);
    };
    if at == 0 {
        return 0.0;
    }
    let ((before, high), (after, low)) = (gains[at - 1], gains[at]);
    before * (after / before).powf((high - level) / (high - low))
}

fn gain_at(rig: &mut Rig, bias: f64, amplitude: f64, frequency: f64) -> f64 {
    let settle = cycles(0.3_f64.max(2.0 / frequency));
    let measured = cycles((0.6_f64.max(4.0 / frequency) * frequency).ceil() / frequency);
    let (mut cos, mut sin) = (0.0, 0.0);
    for k in 0..settle + measured {
        let phase = TAU * frequency * k as f64 * PERIOD;
        let torque = rig.torque(bias + amplitude * phase.sin());
        if k >= settle {
            cos += torque * phase.cos();
            sin += torque * phase.sin();
        }
    }
    2.0 * sin.hypot(cos) / measured as f64 / amplitude
}

/// Rise, ms, and overshoot, %, both of the step that comes out: what the gear is other than configured is another figure.
fn step(rig: &mut Rig, rated: f64) -> [f64; 2] {
    let (bias, step) = (BIAS * rated, STEP * rated);
    let (mut before, mut after) = (Vec::new(), Vec::new());
    for k in 0..cycles(4.5) {
        let t = k as f64 * PERIOD;
        let learning = 0.5 * step * (TAU * 4.0 * (t - 0.4)).sin();
        let torque = rig.torque(match t {
            t if t < 0.4 => bias * t / 0.4,
            t if t < 1.4 => bias + learning,
            t if t < 2.0 => bias,
            _ => bias + step,
        });
        match t {
            t if t >= 2.0 => after.push(torque),
            t if t > 1.9 => before.push(torque),
            _ => {}
        }
    }
    let mean = |torques: &[f64]| torques.iter().sum::<f64>() / torques.len() as f64;
    let (from, to) = (mean(&before), mean(&after[after.len() - 500..]));
    let at = |share: f64| {
        let reached = after.iter().position(|t| (t - from) / (to - from) >= share);
        reached.map_or(f64::INFINITY, |k| k as f64)
    };
    let highest = after.iter().copied().fold(f64::MIN, f64::max);
    [
        at(0.9) - at(0.1),
        100.0 * ((highest - to) / (to - from)).max(0.0),
    ]
}

/// Greatest torque within 0.5 s of a reversal, and mean torque against the hand besides, % of rated.
fn hand(rig: &mut Rig, rated: f64) -> [f64; 2] {
    let (mut steady, mut reversal, mut dq) = (Vec::new(), 0.0_f64, 0.0_f64);
    let bias = cycles(0.5);
    for _ in 0..bias {
        rig.torque(0.0);
    }
    for k in 0..cycles(6.0) {
        let t = k as f64 * PERIOD;
        let goal = if t % 4.0 < 2.0 { LED } else { -LED };
        let most = 2.0 * LED / 50.0;
        dq += (goal - dq).clamp(-most, most);
        rig.joint.outside = Outside::Led(dq);
        let torque = rig.torque(0.0);
        if t >= 2.0 {
            match t % 2.0 > 0.5 {
                true => steady.push(-torque * goal.signum()),
                false => reversal = reversal.max(torque.abs()),
            }
        }
    }
    let mean = steady.iter().sum::<f64>() / steady.len() as f64;
    [100.0 * reversal / rated, 100.0 * mean / rated]
}

/// The joint moves, meets something that nobody knew of, goes on into it until the client notices, stays and comes back,
/// twice.
fn meets(rig: &mut Rig, drawn: &Drawn, stiffness: f64) {
    let damping = 2.0 * WALL_DAMPING * (stiffness * drawn.mechanism.link).sqrt();
    let gear = drawn.gear.stiffness;
    let series = gear * stiffness / (gear + stiffness);
    let most = IMPACT * drawn.catalogue.limit / (series * drawn.mechanism.link).sqrt();
    let speed = MEETS.min(most);
    for _ in 0..cycles(0.5) {
        rig.follow(0.0);
    }
    let from = rig.desired();
    rig.joint.outside = Outside::Spring {
        at: rig.joint.link().0 + AWAY,
        stiffness,
        damping,
        one_sided: true,
    };
    let notices = NOTICED * drawn.catalogue.rated;
    for _ in 0..2 {
        let mut velocity = 0.0_f64;
        let mut left = cycles(4.0);
        while left > 0 && rig.stiffness() * (rig.desired() - rig.joint.link().0) < notices {
            velocity = (velocity + STARTS * PERIOD).min(speed);
            rig.follow(velocity);
            left -= 1;
        }
        while velocity > 0.0 {
            velocity = (velocity - BRAKES * PERIOD).max(0.0);
            rig.follow(velocity);
        }
        for _ in 0..cycles(2.0) {
            rig.follow(0.0);
        }
        goes_back(rig, from, speed);
        for _ in 0..cycles(0.5) {
            rig.follow(0.0);
        }
    }
}

/// The desired angle goes back to where it was.
fn goes_back(rig: &mut Rig, to: f64, speed: f64) {
    let mut velocity = 0.0_f64;
    while rig.desired() - to > 1e-6 {
        let left = rig.desired() - to;
        let brakes = (2.0 * STARTS * left).sqrt().max(STARTS * PERIOD);
        let most = (velocity + STARTS * PERIOD).min(speed).min(brakes);
        velocity = most.min(left / PERIOD);
        rig.follow(-velocity);
    }
    rig.follow(0.0);
}

/// Torque from peak to peak in the last quarter of a rest, % of the limit.
fn rest(
    drawn: &Drawn,
    robot: &Robot,
    at: usize,
    seconds: f64,
    figures: &mut Figures,
    name: &'static str,
) -> Result<f64, String> {
    let (stiffness, one_sided) = match at {
        0 => (drawn.gear.stiffness / 3.0, false),
        _ => (WALL, true),
    };
    let damping = 2.0 * WALL_DAMPING * (stiffness * drawn.mechanism.link).sqrt();
    let spring = Outside::Spring {
        at: START,
        stiffness,
        damping,
        one_sided,
    };
    let mut rig = begin(drawn, robot, if at == 2 { Outside::Free } else { spring })?;
    // A press into the wall, or a pose that lies a little beyond the spring.
    let press = 0.2 * drawn.catalogue.rated;
    let load = press - drawn.mechanism.weight * START.cos();
    let way = if at == 0 {
        press / rig.stiffness()
    } else {
        0.0
    };
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    let last = cycles(seconds);
    for k in 0..last {
        let begins = (k as f64 * PERIOD / 0.5).min(1.0);
        let torque = match at {
            1 => rig.torque(load * begins),
            _ if k < 500 => rig.follow(way / 0.5),
            _ => rig.follow(0.0),
        };
        if k >= last - last / 4 {
            (low, high) = (low.min(torque), high.max(torque));
        }
    }
    let failed = end(&rig, name, figures);
    let swing = 100.0 * (high - low) / drawn.catalogue.limit;
    Ok(if failed { f64::INFINITY } else { swing })
}

/// A joint by its seed, as it is judged; none: `torquectl check` refuses it.
///
/// # Errors
/// Files, or a robot that the cycle cannot run.
pub(crate) fn joint(
    drawn: &Drawn,
    bristles: Bristles,
    extent: Extent,
) -> Result<Option<Figures>, String> {
    let robot = crate::config::robot(drawn, bristles)?;
    robot.map(|robot| judge(drawn, &robot, extent)).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Catalogue;

    /// A small version of the bench: two joints, on which no aim is missed, at fewer frequencies and for a shorter rest.
    #[test]
    fn two_drawn_joints_meet_the_aims() {
        let catalogue = Catalogue::all().unwrap();
        let extent = Extent {
            every: 4,
            rests: 4.0,
            torque_only: false,
        };
        for seed in [10, 38] {
            let drawn = Drawn::new(&catalogue[seed % catalogue.len()], seed as u64);
            let figures = joint(&drawn, Bristles::Known, extent).unwrap();
            let Some(f) = figures else {
                panic!("{}: refused", drawn.name);
            };
            let name = &drawn.name;
            assert!(f.faults.is_empty() && f.ended.is_empty(), "{name}: {f:?}");
            assert!(
                f.bandwidth[0] > 10.0 && f.bandwidth[1] > 15.0,
                "{name}: {f:?}"
            );
            assert!(f.overshoot < 10.0 && f.reversal < 60.0, "{name}: {f:?}");
            assert!(f.rest.iter().all(|swing| *swing < 1.5), "{name}: {f:?}");
            // A torque that never changes by a count is that of a joint that is not simulated.
            assert!(f.rest.iter().all(|swing| *swing > 0.0), "{name}: {f:?}");
        }
    }
}
