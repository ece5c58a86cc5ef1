//! The picture of a demo: true against estimated torque, a panel a joint.

use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;

/// A colour each: truth, encoders, F/T, now.
const TRUTH: RGBColor = RGBColor(30, 30, 30);
const ENCODER: RGBColor = RGBColor(230, 120, 30);
const WHOLE_BODY: RGBColor = RGBColor(40, 110, 200);
const NOW: RGBColor = RGBColor(40, 150, 70);

/// Torque over time of one joint, all at the same instants.
#[derive(Debug, Clone, Default)]
pub(super) struct Trace {
    /// The joint's name.
    pub(super) name: String,
    /// Time, s.
    pub(super) t: Vec<f64>,
    /// The plant's torque, N·m.
    pub(super) truth: Vec<f64>,
    /// Torque from encoders and current, N·m; NaN where not valid.
    pub(super) encoder: Vec<f64>,
    /// Torque from F/T sensors and IMU, N·m; NaN where not valid.
    pub(super) whole_body: Vec<f64>,
    /// Torque now, N·m; NaN where not valid.
    pub(super) now: Vec<f64>,
}

impl Trace {
    fn lines(&self) -> [(&[f64], RGBColor, &'static str); 4] {
        [
            (&self.encoder, ENCODER, "encoders + current"),
            (&self.whole_body, WHOLE_BODY, "F/T + IMU"),
            (&self.now, NOW, "now"),
            (&self.truth, TRUTH, "true"),
        ]
    }

    fn torque_range(&self) -> Range<f64> {
        let values = self.lines();
        let finite = values
            .iter()
            .flat_map(|line| line.0)
            .filter(|x| x.is_finite());
        let (low, high) = finite.fold((f64::MAX, f64::MIN), |(low, high), &x| {
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
/// A sentence that names the file, if it cannot be written.
pub(super) fn draw(path: &Path, title: &str, traces: &[Trace]) -> Result<(), String> {
    draw_panels(path, title, traces).map_err(|e| format!("{}: cannot draw: {e}", path.display()))
}

fn draw_panels(
    path: &Path,
    title: &str,
    traces: &[Trace],
) -> Result<(), Box<dyn std::error::Error>> {
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
) -> Result<(), Box<dyn std::error::Error>>
where
    B::ErrorType: 'static,
{
    let time = trace.t.first().copied().unwrap_or(0.0)..trace.t.last().copied().unwrap_or(1.0);
    let mut chart = ChartBuilder::on(panel)
        .caption(format!("{}, N·m", trace.name), ("sans-serif", 13))
        .margin(4)
        .margin_right(10)
        .x_label_area_size(20)
        .y_label_area_size(38)
        .build_cartesian_2d(time, trace.torque_range())?;
    chart
        .configure_mesh()
        .x_labels(5)
        .y_labels(5)
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .x_label_formatter(&|t| format!("{t:.0} s"))
        .draw()?;
    for (values, colour, _) in trace.lines() {
        let points = trace.t.iter().copied().zip(values.iter().copied());
        chart.draw_series(LineSeries::new(
            points.filter(|point| point.1.is_finite()),
            colour.stroke_width(1),
        ))?;
    }
    Ok(())
}
