//! The picture of a demo: true against estimated torque, a panel a joint.

use std::path::Path;

use charts::{COLOURS, Curve, Figure, Line, Panel};
use problem::Problem;

/// Torques of one joint over time, N·m over s (N of a prismatic joint); only where they are valid.
#[derive(Debug, Clone, Default)]
pub(super) struct Trace {
    /// The joint's name.
    pub(super) name: String,
    /// Unit of its torques.
    pub(super) unit: String,
    /// True torque, of the plant.
    pub(super) truth: Curve,
    /// Torque from encoders and current, from F/T sensors and IMU, delay-compensated torque.
    pub(super) estimates: [Curve; 3],
}

impl Trace {
    fn panel(&self) -> Panel {
        let [black, blue, orange, green, ..] = COLOURS;
        let [encoder, whole_body, compensated] = &self.estimates;
        let line = |label, colour, curve: &Curve| Line::new(label, colour, curve.points().to_vec());
        Panel {
            caption: format!("{}, {}", self.name, self.unit),
            x_unit: "s".to_owned(),
            // The truth last, so that it is drawn on top.
            lines: vec![
                line("encoders + current", orange, encoder),
                line("F/T + IMU", blue, whole_body),
                line("delay-compensated", green, compensated),
                line("true", black, &self.truth),
            ],
            ..Panel::default()
        }
    }
}

/// Draws the traces, as many columns as make the picture about as wide as high.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw(path: &Path, title: &str, traces: &[&Trace]) -> Result<(), Problem> {
    let figure = Figure {
        title: title.to_owned(),
        columns: if traces.len() <= 6 { 2 } else { 5 },
        panel_size: (330, 190),
        panels: traces.iter().map(|trace| trace.panel()).collect(),
    };
    figure.write(path)
}
