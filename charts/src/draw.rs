//! Drawing of a figure by plotters.

use crate::curve::decimated;
use crate::{Figure, Line, Mark, Panel};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::error::Error;
use std::ops::Range;

/// Height of title and legend, pixels.
const HEAD: u32 = 50;
/// Width of a character of the legend, pixels, by rule of thumb.
const CHARACTER: usize = 8;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The figure as SVG text.
pub(crate) fn svg(figure: &Figure) -> Result<String, Box<dyn Error>> {
    let columns = figure.columns.clamp(1, figure.panels.len().max(1));
    let rows = figure.panels.len().div_ceil(columns).max(1);
    let (width, height) = figure.panel_size;
    let size = (width * columns as u32, HEAD + height * rows as u32);
    let mut picture = String::new();
    {
        let root = SVGBackend::with_string(&mut picture, size).into_drawing_area();
        root.fill(&WHITE)?;
        let (head, body) = root.split_vertically(HEAD);
        draw_head(&head, figure)?;
        for (area, panel) in body
            .split_evenly((rows, columns))
            .iter()
            .zip(&figure.panels)
        {
            draw_panel(area, panel)?;
        }
        root.present()?;
    }
    // Both are what every viewer assumes.
    for assumed in [" opacity=\"1\"", " stroke-width=\"1\""] {
        picture = picture.replace(assumed, "");
    }
    Ok(picture)
}

fn draw_head(head: &Area, figure: &Figure) -> Result<(), Box<dyn Error>> {
    let text = |size: i32| ("sans-serif", size).into_text_style(head);
    head.draw_text(&figure.title, &text(17), (12, 6))?;
    let mut shown: Vec<&str> = Vec::new();
    let mut x = 12;
    for line in figure.panels.iter().flat_map(|panel| &panel.lines) {
        if line.label.is_empty() || shown.contains(&line.label.as_str()) {
            continue;
        }
        let stroke = colour(line).stroke_width(2);
        head.draw(&PathElement::new(vec![(x, 37), (x + 22, 37)], stroke))?;
        head.draw_text(&line.label, &text(13), (x + 27, 30))?;
        x += 45 + (CHARACTER * line.label.chars().count()) as i32;
        shown.push(&line.label);
    }
    Ok(())
}

fn draw_panel(area: &Area, panel: &Panel) -> Result<(), Box<dyn Error>> {
    let finite =
        |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite() && (!panel.x_logarithmic || p.0 > 0.0);
    let points = || panel.lines.iter().flat_map(|l| &l.points).filter(finite);
    let (left, right) = panel
        .x_range
        .unwrap_or_else(|| widened(extent(points().map(|p| p.0)), 0.0));
    let (low, high) = panel
        .y_range
        .unwrap_or_else(|| widened(extent(points().map(|p| p.1)), 0.07));
    let x = XAxis {
        range: if panel.x_logarithmic {
            left.log10()..right.log10()
        } else {
            left..right
        },
        logarithmic: panel.x_logarithmic,
    };
    draw_axes(area, panel, &x, low..high)
}

fn draw_axes(area: &Area, panel: &Panel, x: &XAxis, y: Range<f64>) -> Result<(), Box<dyn Error>> {
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.caption, ("sans-serif", 13))
        .margin(4)
        .margin_right(12)
        .x_label_area_size(20)
        .y_label_area_size(46)
        .build_cartesian_2d(x.clone(), y.clone())?;
    chart
        .configure_mesh()
        .x_labels(6)
        .y_labels(5)
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .x_label_formatter(&|at| format!("{} {}", x.label(*at), panel.x_unit))
        .draw()?;
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let scale = [
        f64::from(width) / (x.range.end - x.range.start).max(f64::MIN_POSITIVE),
        f64::from(height) / (y.end - y.start).max(f64::MIN_POSITIVE),
    ];
    for line in &panel.lines {
        let points = line.points.iter().map(|p| (x.place(p.0), p.1));
        let inside = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
        let points: Vec<(f64, f64)> = points.filter(inside).collect();
        let style = colour(line).stroke_width(1);
        match line.mark {
            Mark::Line => {
                chart.draw_series(LineSeries::new(decimated(&points, scale), style))?;
            }
            Mark::Path => {
                let path = crate::curve::simplified(&points, scale);
                chart.draw_series(LineSeries::new(path, style))?;
            }
            Mark::Dots => {
                let dots = crate::curve::apart(&points, scale);
                let dot = |p: (f64, f64)| Circle::new(p, 1, colour(line).filled());
                chart.draw_series(dots.into_iter().map(dot))?;
            }
        }
    }
    Ok(())
}

fn colour(line: &Line) -> RGBColor {
    let (red, green, blue) = line.colour;
    RGBColor(red, green, blue)
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::MAX, f64::MIN), |(low, high), x| {
        (low.min(x), high.max(x))
    })
}

/// The extent with a margin on both sides, and never empty.
fn widened((low, high): (f64, f64), share: f64) -> (f64, f64) {
    if low > high {
        return (0.0, 1.0);
    }
    let margin = share * (high - low);
    let least = 1e-9 * low.abs().max(high.abs()).max(1e-3);
    (low - margin.max(least), high + margin.max(least))
}

/// The axis of x; where it is logarithmic, its coordinate is the decimal exponent.
#[derive(Clone)]
struct XAxis {
    range: Range<f64>,
    logarithmic: bool,
}

impl XAxis {
    /// The coordinate of an x.
    fn place(&self, x: f64) -> f64 {
        if self.logarithmic { x.log10() } else { x }
    }

    /// The number that is shown at a coordinate.
    fn label(&self, at: f64) -> String {
        if self.logarithmic {
            return format!("{}", 10f64.powf(at) as f32);
        }
        // Sums of steps show rounding errors otherwise, as 0.30000000000000004.
        format!("{}", (at * 1e9).round() / 1e9)
    }
}

impl Ranged for XAxis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range.clone()).map(value, limit)
    }

    /// Logarithmic: 1, 2 and 5 of each decade; over more than three decades their beginnings alone.
    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let Range { start, end } = self.range;
        if !self.logarithmic {
            return RangedCoordf64::from(start..end).key_points(hint);
        }
        let steps: &[f64] = if end - start > 3.0 {
            &[1.0]
        } else {
            &[1.0, 2.0, 5.0]
        };
        (start.floor() as i32..=end.ceil() as i32)
            .flat_map(|decade| steps.iter().map(move |s| f64::from(decade) + s.log10()))
            .filter(|at| (start..=end).contains(at))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}
