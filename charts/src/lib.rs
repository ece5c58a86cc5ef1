//! Panels of curves as SVG pictures: small files, since a curve has no more points than are seen.

mod curve;
mod draw;

pub use curve::Curve;

use problem::Problem;
use std::path::Path;

/// A colour: red, green, blue.
pub type Colour = (u8, u8, u8);

/// Colours that most people can distinguish, black first.
pub const COLOURS: [Colour; 6] = [
    (30, 30, 30),
    (30, 120, 200),
    (230, 120, 30),
    (40, 150, 70),
    (150, 110, 200),
    (200, 60, 60),
];

/// Mark of a line's points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mark {
    /// A line from point to point, in order of x.
    #[default]
    Line,
    /// A line from point to point in the order given, e.g. a hysteresis loop.
    Path,
    /// A dot at each point.
    Dots,
}

/// One curve of a panel.
#[derive(Debug, Clone)]
pub struct Line {
    /// Label in the legend; lines of equal label appear there once.
    pub label: String,
    /// Colour.
    pub colour: Colour,
    /// Points (x, y); those that are not finite are left out.
    pub points: Vec<(f64, f64)>,
    /// Line or dots.
    pub mark: Mark,
}

impl Line {
    /// A line from point to point, in order of x.
    #[must_use]
    pub fn new(label: impl Into<String>, colour: Colour, points: Vec<(f64, f64)>) -> Self {
        let (label, mark) = (label.into(), Mark::Line);
        Self {
            label,
            colour,
            points,
            mark,
        }
    }

    /// The same points with another mark.
    #[must_use]
    pub fn with_mark(self, mark: Mark) -> Self {
        Self { mark, ..self }
    }
}

/// One pair of axes with its curves, the last one on top.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// Caption, with the unit of y.
    pub caption: String,
    /// Unit of x, behind each number.
    pub x_unit: String,
    /// x on a logarithmic axis; points with x <= 0 are left out.
    pub x_logarithmic: bool,
    /// Ranges of x and y; by default, those of the points.
    pub x_range: Option<(f64, f64)>,
    /// Range of y.
    pub y_range: Option<(f64, f64)>,
    /// The curves.
    pub lines: Vec<Line>,
}

/// A picture: panels in a grid, row by row, below a title and a legend.
#[derive(Debug, Clone, Default)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Panels side by side.
    pub columns: usize,
    /// Width and height of a panel, pixels.
    pub panel_size: (u32, u32),
    /// The panels, row by row.
    pub panels: Vec<Panel>,
}

impl Figure {
    /// The picture as SVG text.
    ///
    /// # Errors
    /// The drawing library's, as for a panel that is too small for its labels.
    pub fn svg(&self) -> Result<String, Problem> {
        draw::svg(self).map_err(|e| Problem::new(format!("cannot be drawn: {e}"), ""))
    }

    /// Writes the picture as an SVG file.
    ///
    /// # Errors
    /// A picture that cannot be drawn or a file that cannot be written, with the path.
    pub fn write(&self, path: &Path) -> Result<(), Problem> {
        let named = |problem: Problem| problem.at(path.to_string_lossy(), 0);
        let svg = self.svg().map_err(named)?;
        terminal::write_file(path, &svg)
    }
}

#[cfg(test)]
mod tests {
    use super::{COLOURS, Figure, Line, Mark, Panel};

    fn figure(panel: Panel) -> Figure {
        Figure {
            title: "title".to_owned(),
            columns: 2,
            panel_size: (330, 190),
            panels: vec![panel],
        }
    }

    fn wave(mark: Mark) -> Line {
        let point = |i| (1e-2 * f64::from(i), (1e-3 * f64::from(i)).sin());
        Line::new("wave", COLOURS[1], (1..100_000).map(point).collect()).with_mark(mark)
    }

    #[test]
    fn curves_of_any_length_make_a_small_picture() {
        for mark in [Mark::Line, Mark::Path, Mark::Dots] {
            let lines = vec![wave(mark)];
            let svg = figure(Panel {
                lines,
                ..Panel::default()
            })
            .svg()
            .unwrap();
            assert!(
                svg.contains(">\nwave\n<") && svg.len() < 100_000,
                "{}",
                svg.len()
            );
        }
    }

    #[test]
    fn a_logarithmic_axis_has_decades_and_leaves_out_what_it_cannot_show() {
        let mut line = wave(Mark::Line);
        line.points.push((0.0, 7e5));
        line.points.push((1.0, f64::NAN));
        let panel = Panel {
            x_unit: "Hz".to_owned(),
            x_logarithmic: true,
            lines: vec![line],
            ..Panel::default()
        };
        let svg = figure(panel).svg().unwrap();
        for label in ["0.1 Hz", "1 Hz", "100 Hz"] {
            assert!(svg.contains(label), "{label}");
        }
        assert!(!svg.contains("00000\n") && !svg.contains("NaN"));
    }

    #[test]
    fn empty_and_constant_panels_are_drawn() {
        figure(Panel::default()).svg().unwrap();
        let lines = vec![Line::new("", COLOURS[0], vec![(0.0, 3.0), (1.0, 3.0)])];
        figure(Panel {
            lines,
            ..Panel::default()
        })
        .svg()
        .unwrap();
        assert!(Figure::default().svg().is_ok());
    }
}
