//! Tasks of a joint, and its errors in them.

use crate::joint::{Bench, DT};
use crate::robots::rms;
use crate::variant::Conditions;
use std::f64::consts::TAU;

/// Bias of the blocked joint's torque, share of rated.
const BIAS: f64 = 0.3;
/// Frequencies of the response, Hz.
const FREQUENCIES: [f64; 17] = [
    1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0, 14.0, 16.0, 18.0, 21.0, 25.0, 30.0, 36.0, 44.0, 55.0, 70.0,
];
/// Sines whose error is given, Hz.
pub(crate) const SINES: [f64; 4] = [1.0, 5.0, 10.0, 20.0];
/// Velocities of the hand, rad/s.
pub(crate) const VELOCITIES: [f64; 3] = [0.1, 0.5, 1.0];

/// A blocked joint.
pub(crate) struct Blocked {
    /// -3 dB with 2 % and 20 % of rated, Hz; none: the response begins below, or peaks by 3 dB.
    pub(crate) bandwidth: [Option<f64>; 2],
    /// Largest gain with 2 % and 20 %.
    pub(crate) peak: [f64; 2],
    /// Step of 20 %: rise from 10 to 90 %, ms, overshoot, %, time to within 2 % of rated, ms, error
    /// at the end, % of rated.
    pub(crate) step: [f64; 4],
    /// Root mean square of the error over that of a sine of 20 %, %.
    pub(crate) sines: [f64; 4],
    /// Torque of the step from 20 ms before, ms and % of the step.
    pub(crate) curve: Vec<(f64, f64)>,
}

/// A joint that a hand moves: mean torque against the motion, ripple, and the most within 0.5 s of a
/// reversal, % of rated.
pub(crate) struct Moved {
    pub(crate) mean: f64,
    pub(crate) ripple: f64,
    pub(crate) reversal: f64,
}

/// Judges a blocked joint.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn blocked(index: usize, conditions: &Conditions) -> Result<Blocked, String> {
    let mut bandwidths = [None; 2];
    let mut peaks = [0.0; 2];
    for (at, share) in [0.02, 0.2].into_iter().enumerate() {
        let mut bench = Bench::new(index, conditions)?;
        (bandwidths[at], peaks[at]) = response(&mut bench, share);
    }
    let (step, curve) = step(&mut Bench::new(index, conditions)?);
    let mut sines = [0.0; 4];
    for (error, frequency) in sines.iter_mut().zip(SINES) {
        *error = sine(&mut Bench::new(index, conditions)?, frequency);
    }
    Ok(Blocked {
        bandwidth: bandwidths,
        peak: peaks,
        step,
        sines,
        curve,
    })
}

fn response(bench: &mut Bench, share: f64) -> (Option<f64>, f64) {
    let (bias, amplitude) = (BIAS * bench.rated, share * bench.rated);
    while bench.time() < 1.5 {
        let t = bench.time();
        bench.step(bias * (t / 0.5).min(1.0));
    }
    let mut last: Option<(f64, f64)> = None;
    let (mut bandwidth, mut peak) = (None, 0.0_f64);
    for frequency in FREQUENCIES {
        let gain = gain_at(bench, bias, amplitude, frequency);
        peak = peak.max(gain);
        if bandwidth.is_none()
            && gain < 0.5_f64.sqrt()
            && let Some((before, gain_before)) = last
        {
            let share = (gain_before - 0.5_f64.sqrt()) / (gain_before - gain);
            bandwidth = Some(before * (frequency / before).powf(share));
        }
        if last.is_none() && gain < 0.5_f64.sqrt() {
            return (None, gain);
        }
        last = Some((frequency, gain));
    }
    (bandwidth.or(last.map(|(f, _)| f)), peak)
}

fn gain_at(bench: &mut Bench, bias: f64, amplitude: f64, frequency: f64) -> f64 {
    let settle = (0.3_f64.max(2.0 / frequency) / DT) as usize;
    let measured = ((0.6_f64.max(4.0 / frequency) * frequency).ceil() / frequency / DT).round();
    let start = bench.time();
    let (mut cos, mut sin) = (0.0, 0.0);
    for k in 0..settle + measured as usize {
        let phase = TAU * frequency * (bench.time() - start);
        let torque = bench.step(bias + amplitude * phase.sin());
        if k >= settle {
            cos += torque * phase.cos();
            sin += torque * phase.sin();
        }
    }
    2.0 * sin.hypot(cos) / measured / amplitude
}

/// Before the step a second of motion at 4 Hz, in which the gain of the torsion is learned.
fn step(bench: &mut Bench) -> ([f64; 4], Vec<(f64, f64)>) {
    let (bias, step) = (BIAS * bench.rated, 0.2 * bench.rated);
    let mut after = Vec::new();
    let mut curve = Vec::new();
    while bench.time() < 4.5 {
        let t = bench.time();
        let learning = 0.5 * step * (TAU * 4.0 * (t - 0.4)).sin();
        let desired = match t {
            t if t < 0.4 => bias * t / 0.4,
            t if t < 1.4 => bias + learning,
            t if t < 2.0 => bias,
            _ => bias + step,
        };
        let torque = bench.step(desired);
        if t >= 2.0 {
            after.push(torque);
        }
        if (1.98..2.12).contains(&t) {
            curve.push(((t - 2.0) * 1e3, 100.0 * (torque - bias) / step));
        }
    }
    let goal = bias + step;
    let at = |share: f64| {
        let reached = after
            .iter()
            .position(|t| (t - after[0]) / (goal - after[0]) >= share);
        reached.map_or(f64::NAN, |k| k as f64)
    };
    let highest = after.iter().copied().fold(f64::MIN, f64::max);
    let tail = &after[after.len() - 500..];
    let end = tail.iter().sum::<f64>() / tail.len() as f64;
    let settled = after
        .iter()
        .rposition(|t| (t - goal).abs() > 0.02 * bench.rated);
    (
        [
            at(0.9) - at(0.1),
            100.0 * ((highest - goal) / step).max(0.0),
            settled.map_or(0.0, |k| (k + 1) as f64),
            100.0 * (end - goal).abs() / bench.rated,
        ],
        curve,
    )
}

fn sine(bench: &mut Bench, frequency: f64) -> f64 {
    let (bias, amplitude) = (BIAS * bench.rated, 0.2 * bench.rated);
    let mut errors = Vec::new();
    while bench.time() < 5.0 {
        let t = bench.time();
        let swing = amplitude * (TAU * frequency * (t - 1.0).max(0.0)).sin();
        let desired = bias * (t / 0.4).min(1.0) + swing;
        let torque = bench.step(desired);
        if t > 2.0 {
            errors.push(torque - desired);
        }
    }
    100.0 * rms(&errors) / (amplitude / 2_f64.sqrt())
}

/// Judges a joint that a hand moves to and fro, reversing within 50 ms.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn moved(index: usize, conditions: &Conditions, velocity: f64) -> Result<Moved, String> {
    let mut bench = Bench::new(index, conditions)?;
    let (mut steady, mut reversal) = (Vec::new(), 0.0_f64);
    let mut dq: f64 = 0.0;
    while bench.time() < 6.0 {
        let t = bench.time();
        let goal = if t % 4.0 < 2.0 { velocity } else { -velocity };
        let most = 2.0 * velocity / 50.0;
        dq += (goal - dq).clamp(-most, most);
        bench.move_link(dq);
        let torque = bench.step(0.0);
        if t > 2.0 {
            match t % 2.0 > 0.5 {
                // The link is driven by the hand: against the motion the joint's torque is negative.
                true => steady.push(-torque * goal.signum()),
                false => reversal = reversal.max(torque.abs()),
            }
        }
    }
    let mean = steady.iter().sum::<f64>() / steady.len() as f64;
    let around: Vec<f64> = steady.iter().map(|t| t - mean).collect();
    let share = 100.0 / bench.rated;
    Ok(Moved {
        mean: share * mean,
        ripple: share * rms(&around),
        reversal: share * reversal,
    })
}
