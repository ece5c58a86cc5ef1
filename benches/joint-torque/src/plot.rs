//! True and estimated torque of every scenario, and the errors below.

use crate::judge::{FUSED, Outcome};
use charts::{COLOURS, Colour, Figure, Line, Panel};
use problem::Problem;
use std::path::Path;

const TRUTH: Colour = COLOURS[0];
const LINES: [(&str, Colour); 3] = [
    ("compliance", COLOURS[5]),
    ("network", COLOURS[4]),
    (FUSED, COLOURS[1]),
];
/// Longest stretch that is shown, s.
const SHOWN_S: f64 = 12.0;

/// Draws one picture of all outcomes.
///
/// # Errors
/// A file that cannot be written.
pub fn draw(path: &Path, title: &str, outcomes: &[Outcome]) -> Result<(), Problem> {
    let panels = outcomes.chunks(2).flat_map(|pair| {
        let torques = pair.iter().map(torques);
        torques.chain(pair.iter().map(errors)).collect::<Vec<_>>()
    });
    let figure = Figure {
        title: title.to_owned(),
        columns: 2,
        panel_size: (500, 130),
        panels: panels.collect(),
    };
    figure.write(path)
}

fn torques(outcome: &Outcome) -> Panel {
    let truth = shown(outcome).map(|(t, tau, _)| (*t, *tau)).collect();
    let mut lines = lines(outcome, |tau_hat, _| tau_hat);
    lines.insert(0, Line::new("true", TRUTH, truth));
    panel(format!("{}: torque, N·m", outcome.name), lines)
}

fn errors(outcome: &Outcome) -> Panel {
    let lines = lines(outcome, |tau_hat, tau| tau_hat - tau);
    panel("error, N·m".to_owned(), lines)
}

fn panel(caption: String, lines: Vec<Line>) -> Panel {
    Panel {
        caption,
        x_unit: "s".to_owned(),
        lines,
        ..Panel::default()
    }
}

fn lines(outcome: &Outcome, of: fn(f64, f64) -> f64) -> Vec<Line> {
    let line = |(name, colour): &(&str, Colour)| {
        let k = outcome.figures.iter().position(|(n, _)| n == name)?;
        let points = shown(outcome).map(|(t, tau, all)| (*t, of(all[k], *tau)));
        Some(Line::new(*name, *colour, points.collect()))
    };
    LINES.iter().filter_map(line).collect()
}

/// The stretch that is shown: around the largest change of torque.
fn shown(outcome: &Outcome) -> impl Iterator<Item = &(f64, f64, Vec<f64>)> {
    let trace = &outcome.trace;
    let steepest = trace
        .windows(2)
        .max_by(|a, b| {
            let change = |w: &[(f64, f64, Vec<f64>)]| (w[1].1 - w[0].1).abs();
            change(a).total_cmp(&change(b))
        })
        .map_or(0.0, |w| w[0].0);
    let first = trace.first().map_or(0.0, |row| row.0);
    let last = trace.last().map_or(0.0, |row| row.0);
    let from = (steepest - 0.5 * SHOWN_S).clamp(first, (last - SHOWN_S).max(first));
    trace
        .iter()
        .filter(move |row| row.0 >= from && row.0 <= from + SHOWN_S)
}
