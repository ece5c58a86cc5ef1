//! The picture of a demo: true against estimated torque, a panel a joint.

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;
use problem::Problem;

use super::curve::{Curve, decimated};

/// A colour for each torque.
const TRUTH: RGBColor = RGBColor(30, 30, 30);
const ENCODER: RGBColor = RGBColor(230, 120, 30);
const WHOLE_BODY: RGBColor = RGBColor(40, 110, 200);
const COMPENSATED: RGBColor = RGBColor(40, 150, 70);

/// Torques of one joint over time, N·m over s; only where they are valid.
#[derive(Debug, Clone, Default)]
pub(super) struct Trace {
    /// The joint's name.
    pub(super) name: String,
    /// True torque, of the plant.
    pub(super) truth: Curve,
    /// Torque from encoders and current, from F/T sensors and IMU, delay-compensated torque.
    pub(super) estimates: [Curve; 3],
}

/// A curve's points, colour and name.
type Line<'a> = (&'a [(f64, f64)], RGBColor, &'static str);

impl Trace {
    /// The truth last, so that it is drawn on top.
    fn lines(&self) -> [Line<'_>; 4] {
        let [encoder, whole_body, compensated] = &self.estimates;
        [
            (encoder.points(), ENCODER, "encoders + current"),
            (whole_body.points(), WHOLE_BODY, "F/T + IMU"),
            (compensated.points(), COMPENSATED, "delay-compensated"),
            (self.truth.points(), TRUTH, "true"),
        ]
    }

    fn torque_range(&self) -> Range<f64> {
        let lines = self.lines();
        let values = lines.iter().flat_map(|line| line.0).map(|point| point.1);
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        if low > high {
            return -1.0..1.0;
        }
        let margin = 0.08 * (high - low).max(0.5);
        low - margin..high + margin
    }
}

/// Draws the traces, as many columns as make the picture about as wide as high.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw(path: &Path, title: &str, traces: &[&Trace]) -> Result<(), Problem> {
    let problem = |e: Box<dyn Error>| {
        Problem::new(format!("cannot be drawn: {e}"), "").at(path.to_string_lossy(), 0)
    };
    draw_panels(path, title, traces).map_err(problem)
}

fn draw_panels(path: &Path, title: &str, traces: &[&Trace]) -> Result<(), Box<dyn Error>> {
    let columns = if traces.len() <= 6 { 2 } else { 5 }.min(traces.len().max(1));
    let rows = traces.len().div_ceil(columns).max(1);
    let size = (330 * columns as u32, 44 + 190 * rows as u32);
    let root = SVGBackend::new(path, size).into_drawing_area();
    root.fill(&WHITE)?;
    let (head, body) = root.split_vertically(44);
    head.draw_text(title, &("sans-serif", 17).into_text_style(&head), (12, 6))?;
    if let Some(first) = traces.first() {
        for (i, (_, colour, label)) in first.lines().iter().enumerate() {
            let x = 12 + 150 * i as i32;
            head.draw(&PathElement::new(
                vec![(x, 33), (x + 22, 33)],
                colour.stroke_width(2),
            ))?;
            head.draw_text(
                label,
                &("sans-serif", 13).into_text_style(&head),
                (x + 27, 26),
            )?;
        }
    }
    for (panel, trace) in body.split_evenly((rows, columns)).iter().zip(traces) {
        draw_panel(panel, trace)?;
    }
    root.present()?;
    Ok(())
}

fn draw_panel<B: DrawingBackend>(
    panel: &DrawingArea<B, plotters::coord::Shift>,
    trace: &Trace,
) -> Result<(), Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    let truth = trace.truth.points();
    let end = |point: Option<&(f64, f64)>, other| point.map_or(other, |(t, _)| *t);
    let (first, last) = (end(truth.first(), 0.0), end(truth.last(), 1.0));
    let torque = trace.torque_range();
    let mut chart = ChartBuilder::on(panel)
        .caption(format!("{}, N·m", trace.name), ("sans-serif", 13))
        .margin(4)
        .margin_right(10)
        .x_label_area_size(20)
        .y_label_area_size(38)
        .build_cartesian_2d(first..last, torque.clone())?;
    chart
        .configure_mesh()
        .x_labels(5)
        .y_labels(5)
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .x_label_formatter(&|t| format!("{t:.0} s"))
        .draw()?;
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let scale = [
        f64::from(width) / (last - first).max(f64::MIN_POSITIVE),
        f64::from(height) / (torque.end - torque.start),
    ];
    for (points, colour, _) in trace.lines() {
        chart.draw_series(LineSeries::new(
            decimated(points, scale),
            colour.stroke_width(1),
        ))?;
    }
    Ok(())
}
