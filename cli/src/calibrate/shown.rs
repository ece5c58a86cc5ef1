//! A calibration as text, JSON and page.

use super::fit::JointResult;
use super::store::{DriveEntry, Interval, JointEntry, Manifest, SensorEntry};
use crate::identify::found::digits;
use crate::report::{self, Section, escaped};
use crate::units::cell;
use problem::Problem;
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;
use terminal::TextTable;

/// A table: heading, rows.
struct Table {
    heading: &'static [&'static str],
    rows: Vec<Vec<String>>,
}

impl Table {
    fn text(&self) -> String {
        let heading = self.heading.iter().map(|x| (*x).to_owned()).collect();
        let rows = self.rows.iter().cloned();
        TextTable(std::iter::once(heading).chain(rows).collect()).to_string()
    }

    fn html(&self) -> String {
        let row = |cells: &[String], tag: &str| {
            let cells = cells.iter().map(|cell| format!("<{tag}>{cell}</{tag}>"));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let heading: Vec<String> = self.heading.iter().map(|x| escaped(x)).collect();
        let mut html = format!("<table>{}", row(&heading, "th"));
        for cells in &self.rows {
            let cells: Vec<String> = cells.iter().map(|cell| escaped(cell)).collect();
            html += &row(&cells, "td");
        }
        html + "</table>\n"
    }
}

/// Number and half of its 95 % interval.
pub(super) fn with_interval([value, width]: Interval) -> String {
    let decimals = match width {
        w if w > 0.0 => (1.0 - w.log10().floor()).clamp(0.0, 8.0) as usize,
        _ => 4,
    };
    format!("{value:.decimals$} ± {width:.decimals$}")
}

fn joints(manifest: &Manifest) -> Table {
    let calibrated = manifest.joints.iter().filter(|joint| joint.why.is_none());
    let rows = calibrated.map(|joint| {
        let (rms, largest) = (
            joint.held_out_rms.unwrap_or(0.0),
            joint.largest.unwrap_or(0.0),
        );
        vec![
            joint.name.clone(),
            cell(joint.kind(), format!("{largest:.2}"), "N·m"),
            cell(joint.kind(), format!("{rms:.3}"), "N·m"),
            format!("{:.2}", 100.0 * rms / largest.max(1e-9)),
            format!("{:.2}", joint.held_out_rms_of_sigma.unwrap_or(0.0)),
            joint.undetermined.join(", "),
        ]
    });
    Table {
        heading: &[
            "joint",
            "largest N·m",
            "held out RMS N·m",
            "%",
            "error / sigma",
            "undetermined",
        ],
        rows: rows.collect(),
    }
}

/// Values of an F/T sensor and of the mass beyond it.
fn sensors(manifest: &Manifest) -> Table {
    let calibrated = manifest
        .sensors
        .iter()
        .filter(|sensor| sensor.why.is_none());
    Table {
        heading: &["F/T sensor", "", "found", "unit"],
        rows: calibrated.flat_map(sensor_rows).collect(),
    }
}

fn sensor_rows(sensor: &SensorEntry) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    let mut row = |what: &str, found: String, unit: &str| {
        let name = if rows.is_empty() {
            sensor.name.clone()
        } else {
            String::new()
        };
        rows.push(vec![name, what.to_owned(), found, unit.to_owned()]);
    };
    let list = |all: &[Interval]| {
        let each = all.iter().map(|x| with_interval(*x));
        each.collect::<Vec<_>>().join(", ")
    };
    let link = format!("mass of {}", sensor.link);
    row(
        &link,
        sensor.mass.map_or_else(String::new, with_interval),
        "kg",
    );
    row("its centre", list(&sensor.centre), "m");
    row(
        "offset of the force",
        list(sensor.offset.get(..3).unwrap_or(&[])),
        "N",
    );
    row(
        "offset of the torque",
        list(sensor.offset.get(3..).unwrap_or(&[])),
        "N·m",
    );
    row("misalignment", list(&sensor.misalignment), "deg");
    for (what, rms, unit) in [
        ("RMS as it was, tared, held out", &sensor.rms_force, "N"),
        ("", &sensor.rms_torque, "N·m"),
    ] {
        let each = rms.iter().map(|x| digits(*x));
        row(what, each.collect::<Vec<_>>().join(", "), unit);
    }
    let poses = format!(
        "{:.0} deg, condition number {:.0}",
        sensor.turned.unwrap_or(0.0),
        sensor.condition.unwrap_or(f64::NAN)
    );
    row("gravity turned by", poses, "");
    if !sensor.undetermined.is_empty() {
        row("undetermined", sensor.undetermined.join(", "), "");
    }
    if !sensor.better {
        row(
            "kept",
            "the URDF's mass and centre predict the held-out parts as well".to_owned(),
            "",
        );
    }
    rows
}

fn drives(manifest: &Manifest) -> Table {
    let keys = manifest.drives.iter().flat_map(|drive| &drive.keys);
    Table {
        heading: &["key", "found", "configured", ""],
        rows: keys
            .map(|key| {
                let [value, width] = key.value;
                vec![
                    key.address.clone(),
                    format!("{} ± {}", digits(value), digits(width)),
                    digits(key.configured),
                    key.state.clone(),
                ]
            })
            .collect(),
    }
}

/// Why parts could not be calibrated.
fn failures(manifest: &Manifest) -> Vec<String> {
    let why = |name: &str, why: &Option<String>| {
        let why = why.as_ref()?;
        Some(format!("{name}: not calibrated: {why}"))
    };
    let joints = manifest.joints.iter();
    let joints = joints.filter_map(|joint| why(&joint.name, &joint.why));
    let sensors = manifest.sensors.iter();
    let sensors = sensors.filter_map(|s| Some(format!("not calibrated: {}", s.why.as_ref()?)));
    joints.chain(sensors).collect()
}

/// Kinds of drives that nothing is known of.
fn quiet(manifest: &Manifest) -> Option<String> {
    let quiet = |drive: &&DriveEntry| drive.keys.is_empty();
    let names = manifest
        .drives
        .iter()
        .filter(quiet)
        .map(|drive| drive.name.as_str());
    let names: Vec<&str> = names.collect();
    (!names.is_empty()).then(|| {
        format!(
            "drives as configured, since no recording has fast motion of them: {}",
            names.join(", ")
        )
    })
}

pub(super) fn text(manifest: &Manifest, out: &Path) -> String {
    let mut text = String::new();
    let (sensors, joints, drives) = (sensors(manifest), joints(manifest), drives(manifest));
    if !sensors.rows.is_empty() {
        text += &(sensors.text() + "\n");
    }
    if !joints.rows.is_empty() {
        text += &joints.text();
        text += "held out: the last quarter of each recording, by a fit to the rest; % of the largest torque\n";
    }
    if !drives.rows.is_empty() {
        text += &("\n".to_owned() + &drives.text());
    }
    for line in failures(manifest).into_iter().chain(quiet(manifest)) {
        let _ = writeln!(text, "{line}");
    }
    let _ = writeln!(text, "written: {}", out.display());
    text
}

pub(super) fn object(manifest: &Manifest, joints: &[JointResult], out: &Path) -> serde_json::Value {
    let joint = |(entry, result): (&JointEntry, &JointResult)| {
        let mut value = json!(entry);
        value["inputs"] = json!(result.inputs);
        let report = result.outcome.as_ref().map(|c| c.fitted.report.clone());
        value["report"] = json!(report.unwrap_or_default());
        value
    };
    let all: Vec<_> = manifest.joints.iter().zip(joints).map(joint).collect();
    json!({
        "robot": manifest.robot,
        "made": manifest.made,
        "runs": manifest.runs,
        "joints": all,
        "ft_sensors": manifest.sensors,
        "drives": manifest.drives,
        "settings": manifest.settings,
        "written": out.display().to_string(),
    })
}

/// One page of everything.
pub(super) fn write_page(
    path: &Path,
    manifest: &Manifest,
    results: &[JointResult],
) -> Result<(), Problem> {
    let title = format!("Calibration of {}, {}", manifest.robot, manifest.made);
    let runs = manifest.runs.iter();
    let runs =
        runs.map(|run| format!("{}: {:.1} s, SHA-256 {}", run.file, run.seconds, run.sha256));
    let mut body = report::lists(&[("Recordings".to_owned(), runs.collect())]);
    let mut part = |title: &str, note: &str, table: &Table| {
        if !table.rows.is_empty() {
            let _ = write!(body, "<h2>{title}</h2>\n<p>{note}</p>\n{}", table.html());
        }
    };
    let note = "With 95 % intervals. RMS: as it was configured, then on quarters that were held out with the \
                offset found alone, and with everything found.";
    part("F/T sensors", note, &sensors(manifest));
    let note = "Fused torque against its reference on the last quarter of each recording, by a fit to the rest.";
    part("Joints", note, &joints(manifest));
    let note = "With 95 % intervals. Only what differs from the configuration is set by a commit.";
    part("Drives", note, &drives(manifest));
    let mut rest = failures(manifest);
    rest.extend(quiet(manifest));
    rest.extend(
        manifest
            .drives
            .iter()
            .flat_map(|drive| drive.why.iter().map(|why| format!("drive {why}"))),
    );
    body += &report::lists(&[("Not calibrated".to_owned(), rest)]);
    for joint in results {
        let _ = writeln!(body, "<hr id=\"{}\">", escaped(&joint.name));
        let fits = joint.outcome.as_ref().map(|c| c.fitted.report.clone());
        let sections: [Section; 2] = [
            (format!("{}: recordings", joint.name), joint.inputs.clone()),
            (format!("{}: fits", joint.name), fits.unwrap_or_default()),
        ];
        body += &report::lists(&sections);
        if let Ok(calibrated) = &joint.outcome {
            body += &calibrated.html;
        }
    }
    terminal::write_file(path, &report::page(&title, &body))
}
