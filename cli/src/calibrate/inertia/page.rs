//! `--report FILE.html`: torques, predictions and residuals of quarters that were held out, on one
//! page without network.

use super::report::{base_lines, friction_lines, remarks, summary};
use crate::report::{STYLE, escaped};
use charts::{COLOURS, Figure, Line, Mark, Panel};
use identification::inertia::judge::{Judged, Model};
use identification::inertia::{Calibration, Robot};
use problem::Problem;
use std::fmt::Write as _;
use std::path::Path;

/// Dots of a panel at most.
const MAX_DOTS: usize = 1500;

/// Writes the page.
///
/// # Errors
/// Figures that cannot be drawn, or a file that cannot be written.
pub(super) fn write(path: &Path, robot: &Robot<'_>, found: &Calibration) -> Result<(), Problem> {
    let title = format!("{}: inertial parameters and friction", robot.model.name());
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\
         <style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n",
        escaped(&title)
    );
    list(&mut html, "Logs", &summary(robot, found));
    html += &accuracy(robot, found);
    list(
        &mut html,
        "Remarks",
        &[remarks(robot, found), found.notes.clone()].concat(),
    );
    list(&mut html, "Friction", &friction_lines(robot, found)[1..]);
    list(&mut html, "Base parameters", &base_lines(robot, found));
    html += &links(robot, found);
    for (k, judged) in found.judged.iter().enumerate() {
        let _ = writeln!(html, "<h2>{}</h2>", escaped(robot.name(k)));
        html += &figure(judged, robot.unit(k)).svg()?;
    }
    html += "</body></html>\n";
    terminal::write_file(path, &html)
}

fn list(html: &mut String, heading: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let _ = write!(html, "<h2>{}</h2>\n<ul>\n", escaped(heading));
    for line in lines {
        let _ = writeln!(html, "<li>{}</li>", escaped(line.trim()));
    }
    *html += "</ul>\n";
}

fn accuracy(robot: &Robot<'_>, found: &Calibration) -> String {
    let mut html = "<h2>Held-out quarters</h2>\n<table><tr><th>joint</th><th>torque, RMS</th><th>URDF</th>\
        <th>plain least squares</th><th>base parameters</th><th>identified</th><th>95 %</th>\
        <th>of the largest torque</th><th>quarters</th><th>unfiltered</th><th>RMS over sigma</th></tr>\n"
        .to_owned();
    for (k, judged) in found.judged.iter().enumerate() {
        let (low, high) = judged.interval(Model::Identified);
        let identified = judged.residual(Model::Identified);
        let worse = identified > judged.residual(Model::Urdf);
        let quarters = judged
            .quarters(Model::Identified)
            .map(|q| format!("{q:.3}"))
            .join(" ");
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td{}>{identified:.3}</td>\
             <td>{low:.3} to {high:.3}</td><td>{:.2} %</td><td>{quarters}</td><td>{:.3}</td><td>{:.2}</td></tr>",
            escaped(robot.name(k)),
            judged.torque(),
            judged.residual(Model::Urdf),
            judged.residual(Model::Plain),
            judged.residual(Model::Base),
            if worse { " class=\"bad\"" } else { "" },
            100.0 * identified / judged.largest().max(1e-12),
            judged.raw_residual(Model::Identified),
            judged.sigma_check(),
        );
    }
    html + "</table>\n<p>RMS of the residual, N·m (N). Marked: worse than the URDF with friction fitted.</p>\n"
}

fn links(robot: &Robot<'_>, found: &Calibration) -> String {
    let mut html = "<h2>Bodies</h2>\n<table><tr><th>link with what is fixed to it</th><th>mass before, kg</th>\
        <th>after</th><th>centre before, m</th><th>after</th></tr>\n"
        .to_owned();
    for (body, after) in found.inertias.iter().enumerate() {
        let before = &robot.model.bodies()[body + 1].inertia;
        let centre = |i: &dynamics::Inertia| {
            let c = i.center();
            format!("{:.3} {:.3} {:.3}", c.x, c.y, c.z)
        };
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{:.3}</td><td>{:.3}</td><td>{}</td><td>{}</td></tr>",
            escaped(robot.link(body)),
            before.mass,
            after.mass,
            centre(before),
            centre(after)
        );
    }
    html + "</table>\n<p>Single masses are known only as far as torques determine them.</p>\n"
}

/// One joint: torque and predictions over time, residuals over time and torque.
fn figure(judged: &Judged, unit: &str) -> Figure {
    let moments = &judged.moments;
    // Logs one behind the other.
    let mut shift = 0.0;
    let mut times: Vec<f64> = Vec::with_capacity(moments.len());
    for (k, moment) in moments.iter().enumerate() {
        if k > 0 && moments[k - 1].at.0 != moment.at.0 {
            shift = times[k - 1] + 1.0 - moment.at.1;
        }
        times.push(moment.at.1 + shift);
    }
    let start = times.first().copied().unwrap_or(0.0);
    let over_time = |value: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        (0..moments.len())
            .map(|k| (times[k] - start, value(k)))
            .collect()
    };
    let predicted = |k: usize, model: Model| moments[k].predicted[model as usize];
    let residual = |k: usize, model: Model| moments[k].tau - predicted(k, model);
    let torque = vec![
        Line::new(
            "URDF with friction",
            COLOURS[2],
            over_time(&|k| predicted(k, Model::Urdf)),
        ),
        Line::new("measured", COLOURS[0], over_time(&|k| moments[k].tau)),
        Line::new(
            "identified",
            COLOURS[1],
            over_time(&|k| predicted(k, Model::Identified)),
        ),
    ];
    let residuals = vec![
        Line::new(
            "URDF with friction",
            COLOURS[2],
            over_time(&|k| residual(k, Model::Urdf)),
        ),
        Line::new(
            "identified",
            COLOURS[1],
            over_time(&|k| residual(k, Model::Identified)),
        ),
    ];
    let step = moments.len().div_ceil(MAX_DOTS).max(1);
    let dots = |model: Model| {
        (0..moments.len())
            .step_by(step)
            .map(|k| (moments[k].tau, residual(k, model)))
            .collect()
    };
    let over_torque = vec![
        Line::new("URDF with friction", COLOURS[2], dots(Model::Urdf)).with_mark(Mark::Dots),
        Line::new("identified", COLOURS[1], dots(Model::Identified)).with_mark(Mark::Dots),
    ];
    let panel = |caption: String, x_unit: &str, lines: Vec<Line>| Panel {
        caption,
        x_unit: x_unit.to_owned(),
        lines,
        ..Panel::default()
    };
    Figure {
        title: String::new(),
        columns: 1,
        panel_size: (1000, 200),
        panels: vec![
            panel(format!("torque, {unit}"), "s", torque),
            panel(format!("residual, {unit}"), "s", residuals),
            panel(format!("residual, {unit}, over torque"), unit, over_torque),
        ],
    }
}
