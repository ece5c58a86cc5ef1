//! `--report FILE.html`: values, remarks and figures on one page without network.

use super::found::{Found, digits};
use crate::report::{STYLE, escaped};
use charts::{COLOURS, Figure, Line, Mark, Panel};
use identification::drive::DriveLog;
use problem::Problem;
use std::fmt::Write as _;
use torqued_client::robot_state::JointKind;

/// Points of a curve at most.
const POINTS: usize = 4000;

/// The page.
///
/// # Errors
/// Figures that cannot be drawn.
pub(super) fn html(found: &Found<'_>, log: &DriveLog) -> Result<String, Problem> {
    let title = escaped(&format!("{}: drive", found.joint.name));
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n<p>{:.1} s of {}</p>\n\
         <table><tr><th>parameter</th><th>unit</th><th>found</th><th>95 %</th><th>configured</th><th></th></tr>\n",
        found.drive.seconds,
        escaped(&found.files.join(", "))
    );
    for row in found.rows() {
        let [least, most] = row.value.interval();
        let bad = match row.remark() {
            "" => "",
            _ => " class=\"bad\"",
        };
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{}</td><td{bad}>{}</td><td>{} to {}</td><td>{}</td><td>{}</td></tr>",
            row.name,
            row.unit,
            digits(row.value.value),
            digits(least),
            digits(most),
            digits(row.value.configured),
            row.remark()
        );
    }
    html += "</table>\n<ul>\n";
    for line in found.lines().iter().filter(|line| !line.is_empty()) {
        let _ = writeln!(html, "<li>{}</li>", escaped(line));
    }
    html += "</ul>\n";
    html += &figure(found, log).svg()?;
    html += "</body></html>\n";
    Ok(html)
}

/// Motion, the drive's law, and what is left to friction.
fn figure(found: &Found<'_>, log: &DriveLog) -> Figure {
    let (known, drive, kind) = (found.known, found.drive, found.joint.kind);
    let constant = known.torque_constant * known.gear_ratio;
    let samples: usize = log.stretches.iter().map(|s| s.theta.len()).sum();
    let step = samples.div_ceil(POINTS).max(1);
    let most = |a: &(usize, &f64), b: &(usize, &f64)| a.1.total_cmp(b.1);
    let periods = drive
        .arrivals
        .iter()
        .enumerate()
        .max_by(most)
        .map_or(0, |(j, _)| j);
    let (mut motion, mut law, mut friction) = ([vec![], vec![]], vec![], vec![]);
    let mut t = 0.0;
    for s in &log.stretches {
        for k in (0..s.theta.len()).step_by(step) {
            let x = s.theta[k] / known.gear_ratio;
            let at = t + k as f64 * log.period;
            motion[0].push((at, kind.shown(s.q[k])));
            motion[1].push((at, constant * s.current[k]));
            if k >= periods.max(2) && k + 2 < s.theta.len() {
                let (u, n) = (s.sent[k - periods], known.gear_ratio);
                let velocity = (s.theta[k + 2] - s.theta[k - 2]) / (4.0 * log.period * n);
                let acceleration = (s.theta[k + 2] - 2.0 * s.theta[k] + s.theta[k - 2])
                    / (4.0 * log.period * log.period * n);
                let torque = constant * s.current[k];
                let damping = drive.damping.map_or(0.0, |d| d.value);
                let error = if known.takes_position {
                    1e3 * (u - x)
                } else {
                    u
                };
                law.push((error, torque + damping * velocity));
                friction.push((
                    velocity,
                    torque - drive.inertia.value * acceleration - s.torque[k],
                ));
            }
        }
        t += s.theta.len() as f64 * log.period;
    }
    let panel = |caption: &str, x_unit: &str, line: Line| Panel {
        caption: kind.units(caption).into_owned(),
        x_unit: x_unit.to_owned(),
        lines: vec![line],
        ..Panel::default()
    };
    let [angle, torque] = motion;
    let x_unit = match (known.takes_position, kind) {
        (true, JointKind::Revolute) => " mrad",
        (true, JointKind::Prismatic) => " mm",
        (false, _) => " A",
    };
    let rate = kind.units(" rad/s");
    Figure {
        title: String::new(),
        columns: 2,
        panel_size: (520, 260),
        panels: vec![
            panel(
                "position of the joint, degrees",
                " s",
                Line::new("angle", COLOURS[0], angle),
            ),
            panel(
                "torque of the current, N·m",
                " s",
                Line::new("torque", COLOURS[1], torque),
            ),
            panel(
                "torque of the current without damping, N·m, over the set-point's error",
                x_unit,
                Line::new("drive", COLOURS[2], law).with_mark(Mark::Dots),
            ),
            panel(
                "torque of the current less gear and inertia, N·m, over velocity",
                &rate,
                Line::new("friction", COLOURS[3], friction).with_mark(Mark::Dots),
            ),
        ],
    }
}
