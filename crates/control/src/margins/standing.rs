//! Margins of mode stand: how late, or how far off, the legs' torques may be before a robot sways on its feet.
//!
//! The robot's own dynamics make torques of the accelerations that [`crate::Balance`] asks for, so that none of its
//! tasks depends on another: each is a loop through one number. It is opened at the torque, which follows the desired
//! one by a response `T` that all joints of the legs are taken to share, as the slowest of them has it. A law
//! `k x + d v`, whose velocity is that of an observer of frequency `o`, which knows the acceleration asked for, is
//! `C = (k (s + o)³ + d s (3 o² s + o³)) / ((s + o)³ + d s (s + 3 o))`:
//!
//! - The centre of mass is a pendulum that falls by `w = sqrt(g / height)`: `L = T (w² + C) / (s² - w²)`, with
//!   `k = q w²` and `d = (1 + q) w`, `q w` its quicker pole.
//! - The base is an inertia: `L = T (C + b² / (s t)) / s²`, with `k = b²` and `d = 2 b`, `1 / t` of an integral.

use super::Margins;
use super::response::{Point, between, least_distances};
use crate::Sole;
use crate::balance::{FINDS, OBSERVES, QUICKER, TURNS_BACK};
use dynamics::{Base, Data, Model, center_of_mass, forward_kinematics, frame_placement};
use nalgebra::{Complex, Vector3};
use std::f64::consts::{PI, TAU};

/// Distances of a task of mode stand from instability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandingMargins {
    /// Delay of all torques beside their own that turns the loop unstable, s.
    pub delay: f64,
    /// Phase and gains; torques of `1 / reduction` to `gain` times the desired ones keep it stable.
    pub margins: Margins,
}

/// Frequency by which a robot falls on its feet, rad/s: the pendulum of its height with all joints at zero. None without
/// feet, or where the centre of mass is not above them.
#[must_use]
pub fn pendulum(model: &Model, feet: &[(usize, Sole)]) -> Option<f64> {
    let up = -model.gravity().try_normalize(0.0)?;
    if model.base() != Base::Floating || feet.is_empty() {
        return None;
    }
    let mut data = Data::new(model);
    let mut q = vec![0.0; model.nq()];
    q[6] = 1.0;
    forward_kinematics(model, &mut data, &q);
    let sole = |(frame, sole): &(usize, Sole)| {
        frame_placement(model, &data, *frame).act_point(sole.origin())
    };
    let soles: Vector3<f64> = feet.iter().map(sole).sum::<Vector3<f64>>() / feet.len() as f64;
    let height = up.dot(&(center_of_mass(model, &data) - soles));
    (height > 0.0).then(|| (model.gravity().norm() / height).sqrt())
}

/// Margins of the centre of mass over the feet and of the base's orientation, for a pendulum (rad/s, [`pendulum`]) and
/// the response of the legs' torques to the desired ones.
#[must_use]
pub fn standing(pendulum: f64, torque: &[Point]) -> [StandingMargins; 2] {
    let (w, b) = (pendulum, TURNS_BACK);
    let center = |s: Complex<f64>| {
        (observed(s, QUICKER * w * w, (1.0 + QUICKER) * w) + w * w) / (s * s - w * w)
    };
    let base =
        |s: Complex<f64>| (observed(s, b * b, 2.0 * b) + s.inv() * (b * b / FINDS)) / (s * s);
    let mut open = of(torque, center);
    // At rest the torque is the desired one.
    let still = center(Complex::default());
    open.insert(0, Point::new(0.0, Complex::new(still.re, 0.0)));
    [judged(&open), judged(&of(torque, base))]
}

/// `C`: the acceleration that a law with an observed velocity asks for against a way.
fn observed(s: Complex<f64>, k: f64, d: f64) -> Complex<f64> {
    let o = OBSERVES;
    let poles = (s + o) * (s + o) * (s + o);
    (poles * k + s * (s * (3.0 * o * o) + o * o * o) * d) / (poles + s * (s + 3.0 * o) * d)
}

fn of(torque: &[Point], law: impl Fn(Complex<f64>) -> Complex<f64>) -> Vec<Point> {
    let open = |point: &Point| {
        let s = Complex::new(0.0, TAU * point.frequency);
        Point::new(point.frequency, law(s) * Complex::new(point.re, point.im))
    };
    torque.iter().map(open).collect()
}

/// Distances of a loop that is stable where its phase is above -180 degrees wherever its gain is 1, as of both tasks: the
/// centre of mass by the half turn with which it begins, the base as any loop of integrals.
fn judged(open: &[Point]) -> StandingMargins {
    let mut delay = f64::INFINITY;
    // Followed from the lowest frequency on, where it is between a turn and none.
    let mut phase = open.first().map_or(0.0, |first| first.phase());
    phase -= if phase > 0.0 { TAU } else { 0.0 };
    for pair in open.windows(2) {
        let [a, b] = pair else { continue };
        let turn = (b.phase() - a.phase() + PI).rem_euclid(TAU) - PI;
        if (a.gain() - 1.0) * (b.gain() - 1.0) <= 0.0 && a.gain() != b.gain() {
            let share = (1.0 - a.gain()) / (b.gain() - a.gain());
            let above = phase + share * turn + PI;
            if above <= 0.0 {
                return StandingMargins {
                    delay: 0.0,
                    margins: Margins::NONE,
                };
            }
            delay = delay.min(above / (TAU * between(a, b, share).frequency));
        }
        phase += turn;
    }
    StandingMargins {
        delay,
        margins: least_distances(open),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    const W: f64 = 3.6;

    /// A torque that follows by a low-pass, rad/s, a time later, s.
    fn response(bandwidth: f64, delay: f64) -> Vec<Point> {
        let frequencies = (0..600).map(|k| 0.05 * 1.015_f64.powi(k));
        let point = |frequency: f64| {
            let s = Complex::new(0.0, TAU * frequency);
            let value = (s / bandwidth + 1.0).inv() * (-s * delay).exp();
            Point::new(frequency, value)
        };
        frequencies.map(point).collect()
    }

    /// Where a pendulum or a base is after some seconds, in steps of 0.1 ms, of what it was at their beginning.
    fn left(task: usize, bandwidth: f64, delay: f64, gain: f64) -> f64 {
        let dt = 1e-4;
        let (mut x, mut v, mut made, mut found) = (1.0, 0.0, 0.0, 0.0);
        // State of the observer: place, velocity, lasting acceleration, acceleration that was asked for.
        let (mut seen, mut rate, mut lasts, mut wanted) = (1.0, 0.0, 0.0, 0.0);
        let mut late: VecDeque<f64> = vec![0.0; (delay / dt).round() as usize].into();
        let mut most = [0.0_f64; 2];
        let steps = 120_000;
        for k in 0..steps {
            let error = x - seen;
            let o = OBSERVES;
            seen += (rate + 3.0 * o * error) * dt;
            rate += (wanted + lasts + 3.0 * o * o * error) * dt;
            lasts += o * o * o * error * dt;
            let (b, w) = (TURNS_BACK, W);
            found += b * b / FINDS * x * dt;
            let asked = match task {
                0 => {
                    wanted = -QUICKER * w * w * x - (1.0 + QUICKER) * w * rate;
                    w * w * x - wanted
                }
                _ => {
                    wanted = -b * b * x - 2.0 * b * rate;
                    found - wanted
                }
            };
            late.push_back(gain * asked);
            made += bandwidth * dt * (late.pop_front().unwrap_or(asked) - made);
            let falls = if task == 0 { w * w * x } else { 0.0 };
            v += (falls - made) * dt;
            x += v * dt;
            let half = usize::from(k >= steps / 2);
            most[half] = most[half].max(f64::abs(x));
        }
        most[1] / most[0]
    }

    #[test]
    fn delays_and_gains_that_are_borne_are_those_of_the_loop_in_time() {
        for (bandwidth, own) in [(TAU * 20.0, 0.004), (TAU * 10.0, 0.002), (TAU * 40.0, 0.01)] {
            let margins = standing(W, &response(bandwidth, own));
            for (task, of_task) in margins.iter().enumerate() {
                let stable = |delay: f64, gain: f64| left(task, bandwidth, own + delay, gain) < 0.9;
                let (delay, m) = (of_task.delay, of_task.margins);
                assert!(
                    delay > 0.005 && m.gain > 1.5 && m.reduction > 1.5,
                    "{of_task:?}"
                );
                assert!(
                    stable(0.93 * delay, 1.0) && !stable(1.07 * delay, 1.0),
                    "{task} {of_task:?}"
                );
                assert!(
                    stable(0.0, 0.95 * m.gain) && !stable(0.0, 1.05 * m.gain),
                    "{task} {of_task:?}"
                );
                let less = 1.0 / m.reduction;
                assert!(stable(0.0, 1.15 * less), "{task} {of_task:?}");
                // Below it the pendulum falls; the base's integral takes it away slowly.
                assert!(
                    left(task, bandwidth, own, 0.7 * less) > 1.0,
                    "{task} {of_task:?}"
                );
            }
        }
    }

    #[test]
    fn torques_that_are_too_late_leave_no_margin() {
        let margins = standing(W, &response(TAU * 20.0, 0.2));
        assert!(
            margins.iter().all(|of_task| of_task.delay == 0.0),
            "{margins:?}"
        );
    }
}
