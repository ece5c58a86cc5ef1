//! `--report FILE.html`: how well each source knows the torque of a log, on one page without
//! network: torque against reference, hysteresis loop, residuals, and whether sigma covers them.

mod figures;

use estimators::joint::{JointSample, JointTorqueEstimator};
use identification::inputs::{LogKind, inspect};
use identification::log::LogRow;
use joint_file::JointFile;
use problem::Problem;
use robot_state::TorqueEstimate;
use std::fmt::Write as _;
use std::path::Path;

/// Text of a page beside the figures: headings with their lines.
pub(crate) type Section = (String, Vec<String>);

/// One sample of a log.
#[derive(Debug, Clone, Copy)]
struct Moment {
    t: f64,
    q: f64,
    dq: f64,
    torsion: f64,
    reference: f64,
}

/// A log's samples with every source's estimates.
#[derive(Debug, Clone, Default)]
pub(crate) struct Traces {
    names: Vec<String>,
    moments: Vec<Moment>,
    /// By source.
    estimates: Vec<Vec<(f64, f64)>>,
    gear_ratio: f64,
}

impl Traces {
    /// No samples yet; sources by name.
    pub(crate) fn new(joint: &JointFile, names: &[String]) -> Self {
        Self {
            names: names.to_vec(),
            estimates: vec![Vec::new(); names.len()],
            moments: Vec::new(),
            gear_ratio: joint.joint.gear_ratio,
        }
    }

    /// Takes one sample.
    pub(crate) fn add(&mut self, row: &LogRow, s: &JointSample, estimates: &[TorqueEstimate]) {
        self.moments.push(Moment {
            t: row.t,
            q: s.q,
            dq: s.dq,
            torsion: s.theta / self.gear_ratio - s.q,
            reference: row.tau_sensor,
        });
        for (trace, estimate) in self.estimates.iter_mut().zip(estimates) {
            trace.push((estimate.tau, estimate.sigma));
        }
    }

    /// The traces of a log whose rows are all there.
    ///
    /// # Errors
    /// Estimators that cannot be built.
    pub(crate) fn run(joint: &JointFile, rows: &[LogRow]) -> Result<Self, Problem> {
        let mut set = joint.estimators()?;
        let mut front_end = joint.front_end()?;
        let mut names = set.names().to_vec();
        if set.fuses() {
            names.push("fused".to_owned());
        }
        let mut traces = Self::new(joint, &names);
        // Of long logs no more than they take.
        traces.moments.reserve_exact(rows.len());
        let each = traces.estimates.iter_mut();
        each.for_each(|trace| trace.reserve_exact(rows.len()));
        let mut last = None;
        for row in rows {
            front_end.bridge(last.replace(row.t), row.t);
            let sample = row.sample(&mut front_end);
            let fused = set.update(&sample);
            let fused = set.fuses().then_some(&fused);
            let all: Vec<_> = set.estimates().iter().chain(fused).copied().collect();
            traces.add(row, &sample, &all);
        }
        Ok(traces)
    }

    /// Figures of the last source, fused where there is a fusion; none without a reference.
    pub(crate) fn fused(&self) -> Option<Figures> {
        Figures::new(self, self.names.len().checked_sub(1)?)
    }

    /// Samples with a reference.
    fn judged(&self, source: usize) -> impl Iterator<Item = (&Moment, f64, f64)> {
        let both = self.moments.iter().zip(&self.estimates[source]);
        let judged = both.filter(|(m, (tau, _))| m.reference.is_finite() && tau.is_finite());
        judged.map(|(m, (tau, sigma))| (m, *tau, *sigma))
    }
}

/// Figures of one source's errors.
pub(crate) struct Figures {
    pub(crate) rms: f64,
    max: f64,
    sigma: f64,
    /// Root mean square of error over sigma.
    pub(crate) normalised: f64,
    /// Share of the errors within 1.96 sigma.
    covered: f64,
}

impl Figures {
    fn new(traces: &Traces, source: usize) -> Option<Self> {
        let (mut n, mut square, mut max, mut sigmas, mut normalised, mut covered) =
            (0.0, 0.0, 0.0f64, 0.0, 0.0, 0.0);
        for (moment, tau, sigma) in traces.judged(source) {
            let error = tau - moment.reference;
            n += 1.0;
            square += error * error;
            max = max.max(error.abs());
            sigmas += sigma * sigma;
            normalised += (error / sigma.max(1e-12)).powi(2);
            covered += f64::from(u8::from(error.abs() <= 1.96 * sigma));
        }
        (n > 0.0).then(|| Self {
            rms: (square / n).sqrt(),
            max,
            sigma: (sigmas / n).sqrt(),
            normalised: (normalised / n).sqrt(),
            covered: covered / n,
        })
    }
}

/// Findings of an inspection of a log, as lines of a page: nothing is refused here.
pub(crate) fn inspection(joint: &JointFile, rows: &[LogRow]) -> Vec<String> {
    match inspect(joint, rows, LogKind::Training) {
        Ok(inspection) => inspection.lines(),
        Err(problems) => problems.0.iter().map(|p| format!("problem: {p}")).collect(),
    }
}

pub(crate) const STYLE: &str = "body{font:15px/1.45 sans-serif;margin:2em auto;max-width:1080px;padding:0 1em;\
color:#222}h1{font-size:1.5em}h2{font-size:1.2em;margin-top:2em}table{border-collapse:collapse}\
td,th{padding:.2em .8em;border-bottom:1px solid #ccc;text-align:right}\
td:first-child,th:first-child{text-align:left}.bad{background:#fdd}li{margin:.15em 0}\
svg{max-width:100%;height:auto}";

/// Writes the page.
///
/// # Errors
/// Figures that cannot be drawn, or a file that cannot be written.
pub(crate) fn write(
    path: &Path,
    title: &str,
    sections: &[Section],
    traces: &Traces,
) -> Result<(), Problem> {
    let html = page(title, &(lists(sections) + &body(traces)?));
    terminal::write_file(path, &html)
}

/// A page with this body.
pub(crate) fn page(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\
         <style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n{body}</body></html>\n",
        escaped(title)
    )
}

/// Headings with their lines.
pub(crate) fn lists(sections: &[Section]) -> String {
    let mut html = String::new();
    for (heading, lines) in sections.iter().filter(|(_, lines)| !lines.is_empty()) {
        let _ = write!(html, "<h2>{}</h2>\n<ul>\n", escaped(heading));
        for line in lines {
            let _ = writeln!(html, "<li>{}</li>", escaped(line));
        }
        html += "</ul>\n";
    }
    html
}

/// The sources' torques over a log: table and figures.
pub(crate) fn body(traces: &Traces) -> Result<String, Problem> {
    let mut html = table(traces);
    html += "<h2>Torque</h2>\n";
    html += &figures::torque(traces).svg()?;
    for (source, name) in traces.names.iter().enumerate().rev() {
        if traces.judged(source).next().is_none() {
            continue;
        }
        let _ = writeln!(html, "<h2>{}</h2>", escaped(name));
        html += &figures::source(traces, source).svg()?;
    }
    Ok(html)
}

/// Figures of the last source, fused where there is a fusion, on a log: [`table`] of it, and torque beside
/// the reference.
pub(crate) fn summary(traces: &Traces) -> Result<String, Problem> {
    Ok(table(traces) + &figures::torque(traces).svg()?)
}

/// RMS of error over sigma outside of which a cell is marked.
const CONSISTENT: std::ops::RangeInclusive<f64> = 0.5..=2.0;

fn table(traces: &Traces) -> String {
    let mut html = "<h2>Sources</h2>\n<table><tr><th>source</th><th>RMS error, N·m</th>\
        <th>largest, N·m</th><th>RMS sigma, N·m</th><th>RMS of error / sigma</th>\
        <th>within 1.96 sigma</th></tr>\n"
        .to_owned();
    for (source, name) in traces.names.iter().enumerate() {
        let _ = match Figures::new(traces, source) {
            None => writeln!(
                html,
                "<tr><td>{}</td><td>no reference</td></tr>",
                escaped(name)
            ),
            Some(f) => writeln!(
                html,
                "<tr><td>{}</td><td>{:.4}</td><td>{:.4}</td><td>{:.4}</td><td{}>{:.2}</td>\
                 <td>{:.1} %</td></tr>",
                escaped(name),
                f.rms,
                f.max,
                f.sigma,
                if CONSISTENT.contains(&f.normalised) {
                    ""
                } else {
                    " class=\"bad\""
                },
                f.normalised,
                100.0 * f.covered
            ),
        };
    }
    html + "</table>\n<p>RMS of error over sigma is 1 where sigma is right; marked outside of 0.5 to 2.</p>\n"
}

/// Text for HTML.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn names_cannot_close_a_tag() {
        assert_eq!(escaped("<b a=\"&\">"), "&lt;b a=&quot;&amp;&quot;&gt;");
    }
}
