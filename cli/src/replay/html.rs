//! The comparison as an HTML page that needs nothing else: tables, and each joint's torques as
//! recorded and as computed again.

use super::{Comparison, verdict};
use crate::recorded::date;
use recording::{Header, TORQUES};
use std::fmt::Write;
use torqued_client::robot_state::CycleRecord;

/// Points of a curve: more are not seen.
const POINTS: usize = 600;
/// Width and height of a plot.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 160.0;

/// Extremes of one joint's tau_hat within one interval, recorded and computed again.
#[derive(Debug, Clone, Copy)]
struct Interval {
    old: [f64; 2],
    new: [f64; 2],
}

const EMPTY: Interval = Interval {
    old: [f64::INFINITY, f64::NEG_INFINITY],
    new: [f64::INFINITY, f64::NEG_INFINITY],
};

/// Curves of every joint's tau_hat, thinned out as they grow.
pub(super) struct Curves {
    joints: Vec<Vec<Interval>>,
    /// Cycles that one interval holds, and those in the last one.
    step: usize,
    filled: usize,
}

impl Curves {
    pub(super) fn new(header: &Header) -> Self {
        Self {
            joints: vec![Vec::new(); header.joints.len()],
            step: 1,
            filled: 0,
        }
    }

    pub(super) fn take(&mut self, recorded: &CycleRecord, replayed: &CycleRecord) {
        if self.filled == 0 {
            if self
                .joints
                .first()
                .is_some_and(|curve| curve.len() >= 2 * POINTS)
            {
                self.joints.iter_mut().for_each(halve);
                self.step *= 2;
            }
            self.joints.iter_mut().for_each(|curve| curve.push(EMPTY));
        }
        let torques = recorded
            .estimated
            .joints
            .iter()
            .zip(&replayed.estimated.joints);
        for (curve, (old, new)) in self.joints.iter_mut().zip(torques) {
            if let Some(interval) = curve.last_mut() {
                widen(&mut interval.old, old.tau_hat.tau);
                widen(&mut interval.new, new.tau_hat.tau);
            }
        }
        self.filled = (self.filled + 1) % self.step;
    }
}

fn widen(range: &mut [f64; 2], value: f64) {
    *range = [range[0].min(value), range[1].max(value)];
}

/// Two intervals become one.
fn halve(curve: &mut Vec<Interval>) {
    let pairs = curve.chunks(2).map(|pair| {
        pair.iter().fold(EMPTY, |mut sum, interval| {
            interval
                .old
                .iter()
                .for_each(|value| widen(&mut sum.old, *value));
            interval
                .new
                .iter()
                .for_each(|value| widen(&mut sum.new, *value));
            sum
        })
    });
    *curve = pairs.collect();
}

pub(super) fn page(comparison: &Comparison, curves: &Curves) -> String {
    let header = &comparison.header;
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <title>Replay of {robot}</title>\n<style>\n\
         body {{ font: 14px sans-serif; margin: 2em; max-width: 70em }}\n\
         td, th {{ padding: 0.1em 0.8em; text-align: right }}\n\
         td:first-child, th:first-child {{ text-align: left }}\n\
         svg {{ border: 1px solid #ccc }}\n</style></head><body>\n\
         <h1>Replay of {robot}</h1>\n<p>{cycles} cycles, {run_s:.3} s, computed in {took_s:.3} s. \
         Recorded by torqued {version}; first stamp at {begin}.</p>\n<pre>{verdict}</pre>\n",
        robot = escape(&header.robot),
        cycles = comparison.result.cycles,
        run_s = comparison.run_s(),
        took_s = comparison.took_s,
        version = escape(&header.version),
        begin = date(header, 0),
        verdict = escape(&verdict(comparison)),
    );
    out += "<h2>Difference of the torques, RMS / largest, N·m</h2>\n<table><tr><th>joint</th>";
    for torque in TORQUES {
        let _ = write!(out, "<th>{torque}</th>");
    }
    out += "</tr>\n";
    let joints = header.joints.iter().zip(&comparison.result.joints);
    for (j, (name, torques)) in joints.enumerate() {
        let _ = write!(out, "<tr><td>{}</td>", escape(name));
        let unit = |text: String| crate::units::cell(header.kind(j), text, "N·m");
        for torque in torques {
            let _ = match torque.cycles {
                0 => write!(out, "<td>-</td>"),
                _ => {
                    let both = format!("{:.3} / {:.3}", torque.rms(), torque.largest);
                    write!(out, "<td>{}</td>", unit(both))
                }
            };
        }
        out += "</tr>\n";
    }
    out +=
        "</table>\n<h2>tau_hat</h2>\n<p>Grey: recorded. Blue: computed again. Over the run.</p>\n";
    for (j, (name, curve)) in header.joints.iter().zip(&curves.joints).enumerate() {
        let unit = header.kind(j).units("N·m");
        let _ = writeln!(out, "<h3>{}</h3>\n{}", escape(name), plot(curve, &unit));
    }
    out += "</body></html>\n";
    out
}

fn plot(curve: &[Interval], unit: &str) -> String {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for value in curve
        .iter()
        .flat_map(|interval| interval.old.into_iter().chain(interval.new))
    {
        if value.is_finite() {
            widen(&mut range, value);
        }
    }
    let [low, high] = range;
    if low > high {
        return "<p>no torque</p>".to_owned();
    }
    let scale = HEIGHT / (high - low).max(1e-9);
    let step = WIDTH / curve.len().max(1) as f64;
    let mut paths = [String::new(), String::new()];
    for (i, interval) in curve.iter().enumerate() {
        for (path, [from, to]) in paths.iter_mut().zip([interval.old, interval.new]) {
            if from.is_finite() && to.is_finite() {
                let (x, y0, y1) = (i as f64 * step, (high - from) * scale, (high - to) * scale);
                let _ = write!(path, "M{x:.1} {y0:.1}V{:.1}", y1 - 1.0);
            }
        }
    }
    format!(
        "<p>{low:.2} to {high:.2} {unit}</p>\n<svg width=\"{WIDTH}\" height=\"{HEIGHT}\">\
         <path d=\"{}\" stroke=\"#999\" stroke-width=\"2\"/><path d=\"{}\" stroke=\"#06c\"/></svg>",
        paths[0], paths[1]
    )
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
