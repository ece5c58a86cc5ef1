//! True and estimated torque of every scenario, and the errors below.

use crate::judge::{FUSED, Outcome};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::error::Error;
use std::path::Path;
use torqued::demo::curve::decimated;

const TRUTH: RGBColor = RGBColor(30, 30, 30);
const LINES: [(&str, RGBColor); 3] = [
    ("compliance", RGBColor(200, 60, 60)),
    ("network", RGBColor(150, 110, 200)),
    (FUSED, RGBColor(30, 120, 200)),
];
/// Longest stretch that is shown, s.
const SHOWN_S: f64 = 12.0;

/// Draws one picture of all outcomes.
///
/// # Errors
/// A file that cannot be written.
pub fn draw(path: &Path, title: &str, outcomes: &[Outcome]) -> Result<(), Box<dyn Error>> {
    let size = (1000, 60 + 260 * outcomes.len().div_ceil(2) as u32);
    let mut picture = String::new();
    paint(
        SVGBackend::with_string(&mut picture, size).into_drawing_area(),
        title,
        outcomes,
    )?;
    // Both are what every viewer assumes.
    for assumed in [" opacity=\"1\"", " stroke-width=\"1\""] {
        picture = picture.replace(assumed, "");
    }
    std::fs::write(path, picture)?;
    Ok(())
}

fn paint<B: DrawingBackend>(
    root: DrawingArea<B, Shift>,
    title: &str,
    outcomes: &[Outcome],
) -> Result<(), Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    root.fill(&WHITE)?;
    let (head, body) = root.split_vertically(60);
    let text = |size: i32| ("sans-serif", size).into_text_style(&head);
    head.draw_text(title, &text(18), (12, 8))?;
    let legend = [("true", TRUTH)].into_iter().chain(LINES);
    for (k, (name, colour)) in legend.enumerate() {
        let x = 12 + 130 * k as i32;
        let line = vec![(x, 45), (x + 22, 45)];
        head.draw(&PathElement::new(line, colour.stroke_width(2)))?;
        head.draw_text(name, &text(13), (x + 28, 38))?;
    }
    let panels = body.split_evenly((outcomes.len().div_ceil(2), 2));
    for (panel, outcome) in panels.iter().zip(outcomes) {
        let (upper, lower) = panel.split_vertically(165);
        let lines = |of: fn(f64, f64) -> f64| -> Vec<(Vec<(f64, f64)>, RGBColor)> {
            let line = |(name, colour): &(&str, RGBColor)| {
                let k = outcome.figures.iter().position(|(n, _)| n == name)?;
                let points = shown(outcome).map(|(t, tau, all)| (*t, of(all[k], *tau)));
                Some((points.collect(), *colour))
            };
            LINES.iter().filter_map(line).collect()
        };
        let mut torques = lines(|tau_hat, _| tau_hat);
        let truth = shown(outcome).map(|(t, tau, _)| (*t, *tau));
        torques.insert(0, (truth.collect(), TRUTH));
        chart(&upper, &format!("{}: torque, N·m", outcome.name), &torques)?;
        chart(&lower, "error, N·m", &lines(|tau_hat, tau| tau_hat - tau))?;
    }
    root.present()?;
    Ok(())
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

fn chart<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    caption: &str,
    lines: &[(Vec<(f64, f64)>, RGBColor)],
) -> Result<(), Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    let points = || lines.iter().flat_map(|(points, _)| points);
    let range = |of: fn(&(f64, f64)) -> f64| {
        points()
            .map(of)
            .fold((f64::MAX, f64::MIN), |(low, high), x| {
                (low.min(x), high.max(x))
            })
    };
    let ((left, right), (low, high)) = (range(|p| p.0), range(|p| p.1));
    let margin = 0.06 * (high - low).max(1e-3);
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 13))
        .margin(4)
        .margin_right(12)
        .x_label_area_size(18)
        .y_label_area_size(44)
        .build_cartesian_2d(left..right, low - margin..high + margin)?;
    chart
        .configure_mesh()
        .x_labels(6)
        .y_labels(4)
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .x_label_formatter(&|t| format!("{t:.0} s"))
        .draw()?;
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let scale = [
        f64::from(width) / (right - left).max(f64::MIN_POSITIVE),
        f64::from(height) / (high - low + 2.0 * margin),
    ];
    for (points, colour) in lines {
        chart.draw_series(LineSeries::new(
            decimated(points, scale),
            colour.stroke_width(1),
        ))?;
    }
    Ok(())
}
