//! `torquectl estimate`: every configured estimator over a recorded log.

mod parts;

use crate::BAD_INPUT;
use crate::output::{apart, finish};
use crate::report::{self, Traces};
use crate::rows::warn_of_cut;
use clap::Args;
use estimators::joint::{JointSample, JointTorqueEstimator};
use identification::evaluate::{Figures, Score};
use identification::log::{LogReader, LogRow};
use joint_file::JointFile;
use parts::Parts;
use problem::{Problem, Problems};
use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use terminal::{NewFile, TextTable};

/// Run every estimator of a joint over a recorded log
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct EstimateArguments {
    /// The joint and its estimators (TOML; see docs/joint-file.md)
    #[arg(long)]
    joint: PathBuf,
    /// The log (CSV)
    #[arg(long)]
    log: PathBuf,
    /// Write every estimate of every sample to this CSV file
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write a page of figures: torque, hysteresis, residuals, calibration of sigma (HTML)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Tare on the log's first N samples, whose tau_sensor is the known torque: for a joint fitted without an
    /// unloaded turn. They are not judged
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    tare: Option<u64>,
    /// Estimate though the log is not what it claims to be; what is wrong with it is printed
    #[arg(long)]
    accept: bool,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

/// RMS of error over sigma beyond which estimates and reference contradict each other.
const MAX_OVER_SIGMA: f64 = 3.0;

/// Square of the correlation of estimate and reference from which one is the other but for a factor.
const ALIKE: f64 = 0.7;

/// RMS of the difference of the torques by torsion and by current over their sigmas from which it is printed, and
/// from which the log contradicts the joint. Sound logs have 1.
const DOUBTFUL: f64 = 3.0;
const CONTRADICTORY: f64 = 6.0;

/// Standard deviation of the torque that a tare knows, of the rated torque: the mean of some samples.
const TARE_SIGMA: f64 = 0.001;

const FORMAT: &str = "\
The log has columns t (s), theta (rad, motor side, unwrapped), q (rad, link side), i (A) and may have
tau_sensor and tau_feedforward (N·m), in any order; other columns are ignored. theta/N - q > 0 for positive torque.
The log is read and inspected in parts: its length does not matter. Wraps and whole turns of theta are
taken off, samples that no neighbour confirms bridged, rows with readings that were kept left out, each said.
A log that contradicts itself or the joint is refused, as are estimates that differ from tau_sensor by more
than three times their sigma (RMS); --accept takes both.
Without tau_sensor there are no errors to compute: only sigma and time are printed.

The file of --out has columns t, tau_sensor (empty if the log has none), and tau_NAME and sigma_NAME
(N·m) of every estimator.

Examples:
  torquectl estimate --joint fitted.toml --log run.csv
  torquectl estimate --joint fitted.toml --log run.csv --json --out estimates.csv
  torquectl estimate --joint fitted.toml --log run.csv --tare 50   # fitted without an unloaded turn
  torquectl estimate --joint fitted.toml --log run.csv --report run.html";

/// One source, or the fused torque, as the table shows it.
struct Row {
    name: String,
    score: Score,
    sigma_square: f64,
    /// Sum of the squares of error over sigma, and of how many samples.
    ratio_square: f64,
    compared: u64,
    /// Sums of the squares of the estimate and of the reference, and of their product.
    sums: [f64; 3],
    /// Time per sample, ns; that of the fused torque includes its sources.
    time_ns: f64,
}

impl Row {
    fn new(name: &str, score: &Score) -> Self {
        Self {
            name: name.to_owned(),
            score: score.clone(),
            sigma_square: 0.0,
            ratio_square: 0.0,
            compared: 0,
            sums: [0.0; 3],
            time_ns: 0.0,
        }
    }

    /// Change that makes a reference of the estimates: another sign or unit.
    fn cause(&self) -> String {
        let [own, other, product] = self.sums;
        let factor = product / own.max(1e-24);
        if product.powi(2) < ALIKE * own * other {
            return String::new();
        }
        match factor {
            f if f < 0.0 => ": `tau_sensor` has the opposite sign?".to_owned(),
            f if (300.0..3000.0).contains(&f) => ": `tau_sensor` is in mN·m?".to_owned(),
            f if (3e-4..3e-3).contains(&f) => ": `tau_sensor` is in kN·m?".to_owned(),
            f if (0.7..1.4).contains(&f) => String::new(),
            f => format!(
                ": `tau_sensor` is {f:.3} times the estimates: another unit, or side of the gear?"
            ),
        }
    }

    /// Refuses estimates that the log's reference contradicts.
    fn contradiction(&self, log: &Path, tared: u64) -> Result<(), Problem> {
        let ratio = (self.ratio_square / self.compared.max(1) as f64).sqrt();
        if ratio <= MAX_OVER_SIGMA {
            return Ok(());
        }
        let rms = self.score.figures().map_or(0.0, |f| f.rms);
        let reason = format!(
            "the {} torque differs from `tau_sensor` by {rms:.4} N·m RMS, {ratio:.1} times its own sigma{}",
            self.name,
            self.cause()
        );
        // Sticking friction at a log's start looks like the current's zero.
        let tare = if tared > 0 {
            ", and a --tare over more rows, better with motion both ways: friction hides the current's zero in few"
        } else {
            ""
        };
        let allowed = format!(
            "at most {MAX_OVER_SIGMA}: a log of the joint that was fitted, with a sound reference{tare}; --accept prints the figures"
        );
        Err(Problem::new(reason, allowed).at(log.display().to_string(), 0))
    }
}

/// Torques by torsion and by current, against each other.
struct Between {
    /// Places of both among the sources.
    places: Option<[usize; 2]>,
    square: f64,
    ratio_square: f64,
    count: u64,
}

impl Between {
    fn new(names: &[String]) -> Self {
        let place = |wanted: &str| names.iter().position(|name| name == wanted);
        Self {
            places: place("hysteresis")
                .zip(place("current"))
                .map(|(a, b)| [a, b]),
            square: 0.0,
            ratio_square: 0.0,
            count: 0,
        }
    }

    fn add(&mut self, estimates: &[robot_state::TorqueEstimate]) {
        let both = self
            .places
            .and_then(|[a, b]| estimates.get(a).zip(estimates.get(b)));
        let Some((torsion, current)) = both else {
            return;
        };
        let square = (torsion.tau - current.tau).powi(2);
        let variance = torsion.sigma.powi(2) + current.sigma.powi(2);
        self.square += square;
        self.ratio_square += square / variance.max(1e-24);
        self.count += 1;
    }

    /// Refuses a log in which both contradict each other; prints it where they hardly agree.
    fn judge(&self, log: &Path, accept: bool) -> Result<(), Problem> {
        let mean = |sum: f64| (sum / self.count.max(1) as f64).sqrt();
        let (rms, ratio) = (mean(self.square), mean(self.ratio_square));
        if ratio <= DOUBTFUL {
            return Ok(());
        }
        let reason = format!(
            "the torques by torsion and by current differ by {rms:.4} N·m RMS, {ratio:.1} times their sigmas: `i` in another unit, with another sign or time, limited, or rows in another order"
        );
        let log = log.display().to_string();
        if ratio > CONTRADICTORY && !accept {
            let allowed = format!(
                "at most {CONTRADICTORY}: a log of the joint that was fitted; --accept prints the figures"
            );
            return Err(Problem::new(reason, allowed).at(log, 0));
        }
        eprintln!("warning: {log}: {reason}");
        Ok(())
    }
}

pub(crate) fn run(arguments: &EstimateArguments) -> ExitCode {
    match evaluate(arguments) {
        Ok(text) => finish(&text),
        Err(problems) => {
            for problem in problems.0 {
                eprintln!("torquectl estimate: {problem}");
            }
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn evaluate(arguments: &EstimateArguments) -> Result<String, Problems> {
    for output in arguments.out.iter().chain(&arguments.report) {
        apart(output, &[arguments.joint.clone(), arguments.log.clone()])?;
    }
    let joint = read_joint(&arguments.joint)?;
    let mut log = open_log(&arguments.log)?;
    let of_joint = |problem: Problem| problem.or_at(&arguments.joint.display().to_string(), 0);
    let mut set = joint.estimators().map_err(of_joint)?;
    let mut front_end = joint.front_end().map_err(of_joint)?;
    let mut names: Vec<String> = set.names().to_vec();
    if set.fuses() {
        names.push("fused".to_owned());
    }
    let tared = arguments.tare.unwrap_or(0);
    if tared > 0 && !log.has_torque() {
        let reason = "--tare, but the log has no column `tau_sensor`";
        return Err(log
            .problem(reason, "a log whose first torques are known")
            .into());
    }
    let score = Score::new(joint.sample_period());
    let mut rows: Vec<Row> = names.iter().map(|name| Row::new(name, &score)).collect();
    let mut out = arguments
        .out
        .as_deref()
        .map(|path| Output::create(path, &names))
        .transpose()?;
    let (mut count, mut last) = (0u64, None::<f64>);
    let mut between = Between::new(&names);
    // A page needs the whole log; without one its length does not matter.
    let mut page =
        (arguments.report.as_deref()).map(|path| (path, Vec::new(), Traces::new(&joint, &names)));
    let mut timed = Vec::new();
    let mut parts = Parts::new(&joint, &arguments.log, arguments.accept);
    while let Some(row) = parts.next_row(&mut log)? {
        let before = last.replace(row.t);
        front_end.bridge(before, row.t);
        let sample = row.sample(&mut front_end);
        if timed.len() < TIMED {
            timed.push(sample);
        }
        let fused = set.update(&sample);
        count += 1;
        if count <= tared {
            set.tare_to(row.tau_sensor, TARE_SIGMA * joint.joint.rated_torque);
        }
        let estimates: Vec<_> = set
            .estimates()
            .iter()
            .chain(set.fuses().then_some(&fused))
            .copied()
            .collect();
        if count > tared {
            between.add(&estimates);
        }
        for (shown, estimate) in rows.iter_mut().zip(&estimates) {
            if row.tau_sensor.is_finite() && count > tared {
                shown.score.add(estimate.tau, row.tau_sensor);
                shown.ratio_square +=
                    ((estimate.tau - row.tau_sensor) / estimate.sigma.max(1e-12)).powi(2);
                shown.compared += 1;
                let (own, other) = (estimate.tau, row.tau_sensor);
                let products = [own * own, other * other, own * other];
                shown
                    .sums
                    .iter_mut()
                    .zip(products)
                    .for_each(|(sum, x)| *sum += x);
            }
            shown.sigma_square += estimate.sigma * estimate.sigma;
        }
        if let Some(out) = &mut out {
            out.write(&row, &estimates)?;
        }
        if let Some((_, rows, traces)) = &mut page {
            traces.add(&row, &sample, &estimates);
            rows.push(row);
        }
    }
    warn_of_cut(log.is_cut(), &arguments.log);
    if count == 0 {
        return Err(log.problem("the log has no rows", "at least one").into());
    }
    if count <= tared {
        let reason = format!("the log has {count} rows, and --tare is {tared}");
        return Err(log.problem(reason, format!("less than {count}")).into());
    }
    parts.finish()?;
    if let Some(row) = rows.last().filter(|_| set.fuses() && !arguments.accept) {
        row.contradiction(&arguments.log, tared)?;
    }
    between.judge(&arguments.log, arguments.accept)?;
    if let Some(out) = out {
        out.finish()?;
    }
    if let Some((path, rows, traces)) = &page {
        let [joint_file, log] = [&arguments.joint, &arguments.log].map(|p| p.display().to_string());
        let title = format!("{}: {log} by {joint_file}", joint.joint.name);
        let sections = [(format!("Log {log}"), report::inspection(&joint, rows))];
        report::write(path, &title, &sections, traces)?;
    }
    let sources = joint.sources().map_err(of_joint)?;
    for (row, mut source) in rows.iter_mut().zip(sources) {
        row.time_ns = time_ns(source.estimator.as_mut(), &timed);
    }
    if let (true, Some(row)) = (set.fuses(), rows.last_mut()) {
        set.reset();
        row.time_ns = time_ns(&mut set, &timed);
    }
    Ok(if arguments.json {
        json(&rows)
    } else {
        table(&rows, count)
    })
}

/// Samples at the log's begin that each estimator is timed on, by itself.
const TIMED: usize = 20_000;

fn time_ns(estimator: &mut dyn JointTorqueEstimator, samples: &[JointSample]) -> f64 {
    let start = Instant::now();
    for sample in samples {
        std::hint::black_box(estimator.update(std::hint::black_box(sample)));
    }
    start.elapsed().as_secs_f64() * 1e9 / samples.len().max(1) as f64
}

pub(crate) fn read_joint(path: &Path) -> Result<JointFile, Problem> {
    let name = path.display().to_string();
    let text = terminal::read_text(path).map_err(|e| Problem::unreadable(&name, &e))?;
    let joint = JointFile::parse(&text, &name, &|path| terminal::read_text(path))?;
    if joint.joint.radius.is_some() {
        let reason = "joint.radius_m: is for a prismatic joint";
        let allowed = "joints that turn; `torquectl calibrate` takes prismatic ones";
        return Err(Problem::new(reason, allowed).at(name, 0));
    }
    Ok(joint)
}

pub(crate) fn open_log(path: &Path) -> Result<LogReader<BufReader<File>>, Problem> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| Problem::unreadable(&name, &e))?;
    LogReader::new(BufReader::new(file), &name)
}

/// The CSV file of all estimates.
struct Output {
    file: NewFile,
    name: String,
}

impl Output {
    fn create(path: &Path, names: &[String]) -> Result<Self, Problem> {
        let name = path.display().to_string();
        let file = NewFile::create(path)?;
        let mut out = Self { file, name };
        let columns = names.iter().map(|n| format!(",tau_{n},sigma_{n}"));
        out.line(&format!("t,tau_sensor{}", columns.collect::<String>()))?;
        Ok(out)
    }

    fn write(
        &mut self,
        row: &LogRow,
        estimates: &[robot_state::TorqueEstimate],
    ) -> Result<(), Problem> {
        let sensor = if row.tau_sensor.is_finite() {
            row.tau_sensor.to_string()
        } else {
            String::new()
        };
        let values = estimates.iter().map(|e| format!(",{},{}", e.tau, e.sigma));
        self.line(&format!("{},{sensor}{}", row.t, values.collect::<String>()))
    }

    fn line(&mut self, line: &str) -> Result<(), Problem> {
        writeln!(self.file, "{line}").map_err(|e| Problem::unwritable(&self.name, &e))
    }

    fn finish(self) -> Result<(), Problem> {
        self.file
            .finish()
            .map_err(|e| Problem::unwritable(&self.name, &e))
    }
}

fn table(rows: &[Row], count: u64) -> String {
    let heading = [
        "estimator",
        "max N·m",
        "RMS N·m",
        "RMS %",
        "correlation",
        "delay ms",
        "sigma N·m",
        "time ns",
    ];
    let mut cells = vec![heading.map(str::to_owned).to_vec()];
    for row in rows {
        let sigma = (row.sigma_square / count as f64).sqrt();
        let figures = row.score.figures();
        let shown = |value: fn(&Figures) -> f64, digits: usize| {
            figures
                .as_ref()
                .map_or("-".to_owned(), |f| format!("{:.digits$}", value(f)))
        };
        cells.push(vec![
            row.name.clone(),
            shown(|f| f.max, 4),
            shown(|f| f.rms, 4),
            shown(|f| f.rms_percent, 2),
            shown(|f| f.correlation, 5),
            shown(|f| 1e3 * f.delay_s, 2),
            format!("{sigma:.4}"),
            format!("{:.0}", row.time_ns),
        ]);
    }
    format!(
        "{}{count} samples; RMS % is of the RMS torque, time per sample\n",
        TextTable(cells)
    )
}

fn json(rows: &[Row]) -> String {
    let figures = |row: &Row| {
        let mut object = serde_json::json!({"time_ns": row.time_ns});
        if let Some(f) = row.score.figures() {
            object["max"] = f.max.into();
            object["rms"] = f.rms.into();
            object["rms_percent"] = f.rms_percent.into();
            object["correlation"] = f.correlation.into();
            object["delay_s"] = f.delay_s.into();
        }
        object
    };
    let object: serde_json::Map<_, _> = rows
        .iter()
        .map(|row| (row.name.clone(), figures(row)))
        .collect();
    format!("{}\n", serde_json::Value::Object(object))
}
