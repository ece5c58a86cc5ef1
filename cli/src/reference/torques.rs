//! Torques of a whole log, by centred filters and the whole-body estimator.

use crate::rows::Rows;
use crate::whole_body::sensors_file::SensorsFile;
use dynamics::{ImuMotion, Model};
use identification::load::untouched::{Row, Verdict, judge};
use identification::record::{noise, smooth};
use inspection::{Channel, Defect, Quantity, Severity};
use nalgebra::Vector3;
use problem::{Problem, Problems, listed};
use robot_config::FilterGains;
use robot_state::Wrench;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use whole_body::{PartEstimate, WholeBody, WholeBodyInput, WholeBodyParameters};

/// A robot of which torques are computed.
pub(crate) trait Estimated {
    /// Its rigid bodies.
    fn model(&self) -> &Model;

    /// The estimator's parameters behind filters with these gains.
    ///
    /// # Errors
    /// Sensors or contacts from which the torques do not follow.
    fn parameters(&self, gains: &FilterGains) -> Result<WholeBodyParameters, Problem>;

    /// Index of the contact set among the parameters' hypotheses.
    fn contact_set(&self) -> usize;
}

/// Signals of the whole robot at a steady rate, without a gap.
pub(crate) struct Signals {
    /// t, s.
    pub(crate) t: Vec<f64>,
    /// Time between rows, s.
    pub(crate) period: f64,
    /// Angles as the model counts them, by joint, rad.
    pub(crate) angles: Vec<Vec<f64>>,
    /// Wrench that the part beyond each F/T sensor applies to the part before, by sensor and axis.
    pub(crate) ft: Vec<[Vec<f64>; 6]>,
    /// Gyro and accelerometer, by axis.
    pub(crate) imu: Option<[Vec<f64>; 6]>,
    /// Their name in messages.
    pub(crate) file: String,
}

/// A log of the whole robot.
pub(super) struct RobotLog {
    /// t, s.
    pub(super) t: Vec<f64>,
    columns: BTreeMap<String, Vec<f64>>,
    file: String,
    period: f64,
}

/// Axes of an F/T sensor and of the IMU, as columns name them.
const WRENCH: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];
const IMU: [&str; 6] = ["gx", "gy", "gz", "ax", "ay", "az"];
/// Largest deviation of a step from the period, parts.
const MAX_IRREGULARITY: f64 = 0.05;

impl RobotLog {
    /// Reads a log.
    ///
    /// # Errors
    /// As [`Rows::read`]; stamps that are not at a steady rate.
    pub(super) fn read(path: &Path, accept: bool) -> Result<Self, Problems> {
        let file = path.display().to_string();
        let rows = Rows::read(path, "t", |_| true)?;
        let period = (rows.t[rows.t.len() - 1] - rows.t[0]) / (rows.t.len() - 1) as f64;
        let odd = |w: &[f64]| ((w[1] - w[0]) / period - 1.0).abs() > MAX_IRREGULARITY;
        if let Some(i) = rows.t.windows(2).position(odd) {
            let reason = format!(
                "the step before t = {} s is not {period:.6} s",
                rows.t[i + 1]
            );
            let allowed = "stamps at a steady rate without gaps; `torquectl import` resamples";
            return Err(Problem::new(reason, allowed).at(file, i + 3).into());
        }
        let mut log = Self {
            t: rows.t,
            columns: rows.columns,
            file,
            period,
        };
        log.inspect(accept)?;
        Ok(log)
    }

    /// Takes out wraps and bridges bad samples, each said; a reading that was kept cannot be left out of a log at a
    /// steady rate.
    ///
    /// # Errors
    /// Channels that are not what they claim to be, unless that is accepted.
    fn inspect(&mut self, accept: bool) -> Result<(), Problems> {
        let mut problems = Vec::new();
        for (name, values) in &mut self.columns {
            let quantity = match name.rsplit('.').next() {
                Some("q" | "angle") => Quantity::Angle,
                Some("theta") => Quantity::Way,
                Some("i" | "tau_feedforward") => Quantity::Effort,
                Some(axis) if WRENCH.contains(&axis) || IMU.contains(&axis) => Quantity::Effort,
                _ => continue,
            };
            let channel = Channel {
                name,
                quantity,
                values,
            };
            let found = inspection::inspect(&self.t, channel);
            for finding in &found.findings {
                let held = finding.defect == Defect::Frozen;
                if (held || finding.severity == Severity::Refused) && !accept {
                    problems.push(finding.problem(&self.file, |row| row + 2));
                } else {
                    eprintln!("warning: {}: {finding}", self.file);
                }
            }
            *values = found.values;
        }
        if problems.is_empty() {
            return Ok(());
        }
        Err(Problems(problems))
    }

    /// The signals that the torques of a robot with these joints and sensors follow from.
    ///
    /// # Errors
    /// Columns that are missing.
    pub(super) fn signals(
        &self,
        joints: &[String],
        sensors: &SensorsFile,
    ) -> Result<Signals, Problem> {
        let angles = joints.iter();
        let angles = angles.map(|joint| Ok::<_, Problem>(self.angle(joint)?.to_vec()));
        let ft = sensors.ft_sensors.iter().map(|sensor| {
            let sign = f64::from(sensor.sign);
            let axes = self.six(sensor.name.get_ref(), WRENCH)?;
            let signed = |axis: &[f64]| axis.iter().map(|x| sign * x).collect();
            Ok::<_, Problem>(axes.map(signed))
        });
        let imu = sensors.imu.as_ref();
        let imu = imu.map(|_| Ok::<_, Problem>(self.six("imu", IMU)?.map(<[f64]>::to_vec)));
        Ok(Signals {
            t: self.t.clone(),
            period: self.period,
            angles: angles.collect::<Result<_, _>>()?,
            ft: ft.collect::<Result<_, _>>()?,
            imu: imu.transpose()?,
            file: self.file.clone(),
        })
    }

    /// theta, q and i of a joint, where all are there.
    pub(super) fn drive(&self, joint: &str) -> Option<[&[f64]; 3]> {
        let column = |key| {
            self.columns
                .get(&format!("{joint}.{key}"))
                .map(Vec::as_slice)
        };
        Some([column("theta")?, column("q")?, column("i")?])
    }

    /// tau_feedforward of a joint, where it is there.
    pub(super) fn feed_forward(&self, joint: &str) -> Option<&[f64]> {
        let column = self.columns.get(&format!("{joint}.tau_feedforward"));
        column.map(Vec::as_slice)
    }

    /// The joint's angle as the URDF counts it.
    fn angle(&self, joint: &str) -> Result<&[f64], Problem> {
        match self.columns.get(&format!("{joint}.angle")) {
            Some(angle) => Ok(angle),
            None => self.column(&format!("{joint}.q")),
        }
    }

    fn column(&self, name: &str) -> Result<&[f64], Problem> {
        self.columns.get(name).map(Vec::as_slice).ok_or_else(|| {
            let names = listed(self.columns.keys().map(String::as_str));
            let reason = format!("column `{name}` is missing among {names}");
            let allowed = "a column for every moving joint and every sensor; `torquectl import` writes such logs";
            Problem::new(reason, allowed).at(self.file.as_str(), 1)
        })
    }

    fn six(&self, name: &str, axes: [&str; 6]) -> Result<[&[f64]; 6], Problem> {
        let mut all: [&[f64]; 6] = [&[]; 6];
        for (column, axis) in all.iter_mut().zip(axes) {
            *column = self.column(&format!("{name}.{axis}"))?;
        }
        Ok(all)
    }
}

/// Torques and standard deviations of every joint.
pub(crate) struct Torques {
    tau: Vec<Vec<f64>>,
    sigma: Vec<Vec<f64>>,
    rows: Range<usize>,
}

/// Part of the difference between two windows, one twice as long, that the shorter one may have
/// removed: an error that grows with the window's square leaves a third; a step all of it.
const REMOVED: f64 = 0.5;
/// A window that removes little of a robot's motion, s.
const SHORT_S: f64 = 0.02;

impl Torques {
    /// Torques of a log with centred filters of a window, s.
    ///
    /// # Errors
    /// A window that does not fit the log; contacts that cannot be determined.
    pub(crate) fn new(robot: &dyn Estimated, log: &Signals, window: f64) -> Result<Self, Problem> {
        let half = (0.5 * window / log.period).round();
        let (most, count) = (log.t.len() / 6, log.t.len());
        if !(2.0..=most as f64).contains(&half) {
            let reason = format!("a window of {:.1} ms on {count} rows", 1e3 * window);
            let (low, high) = (4e3 * log.period, 2e3 * log.period * most as f64);
            let allowed = format!("{low:.1} to {high:.1} ms");
            return Err(Problem::new(reason, allowed).at(log.file.as_str(), 0));
        }
        let half = half as usize;
        let Pass { tau, mut sigma } = pass(robot, log, half, None)?;
        widen(
            &mut sigma,
            &tau,
            &pass(robot, log, 2 * half, None)?.tau,
            half,
            REMOVED,
        );
        // A signal that a long window has removed altogether shows beside a short one.
        let short = (0.5 * SHORT_S / log.period).round().max(2.0) as usize;
        if short < half {
            widen(
                &mut sigma,
                &tau,
                &pass(robot, log, short, None)?.tau,
                half,
                1.0,
            );
        }
        Ok(Self {
            tau,
            sigma,
            rows: 2 * half..count - 2 * half,
        })
    }

    /// Rows with a full window.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// Torque and standard deviation of a joint at a row.
    pub(crate) fn at(&self, joint: usize, row: usize) -> (f64, f64) {
        (self.tau[joint][row], self.sigma[joint][row])
    }

    /// Smallest and largest torque of a joint, and its RMS sigma.
    pub(crate) fn range(&self, joint: usize) -> (f64, f64, f64) {
        let (mut low, mut high, mut square) = (f64::MAX, f64::MIN, 0.0);
        for i in self.rows() {
            let (tau, sigma) = self.at(joint, i);
            (low, high, square) = (low.min(tau), high.max(tau), square + sigma * sigma);
        }
        (low, high, (square / self.rows.len().max(1) as f64).sqrt())
    }
}

/// Adds the local difference between two passes, times `part`, to sigma.
fn widen(sigma: &mut [Vec<f64>], tau: &[Vec<f64>], other: &[Vec<f64>], half: usize, part: f64) {
    for ((tau, other), sigma) in tau.iter().zip(other).zip(sigma) {
        let squares = tau.iter().zip(other).map(|(a, b)| (a - b).powi(2));
        let local = smooth_mean(&squares.collect::<Vec<f64>>(), 2 * half);
        for (sigma, square) in sigma.iter_mut().zip(local) {
            *sigma = sigma.hypot(part * square.sqrt());
        }
    }
}

/// What looks at each row's estimate.
type EachRow<'a> = &'a mut dyn FnMut(&WholeBody, &WholeBodyInput<'_>);

/// F/T sensors beyond which nothing touches the robot, against the model: indices and verdicts.
///
/// # Errors
/// As [`Torques::new`].
pub(crate) fn untouched(
    robot: &dyn Estimated,
    log: &Signals,
    window: f64,
) -> Result<Vec<(usize, Verdict)>, Problem> {
    let half = ((0.5 * window / log.period).round() as usize).max(2);
    let inside = half..log.t.len().saturating_sub(half);
    let mut rows = vec![Vec::new(); log.ft.len()];
    let mut at = 0;
    let mut take = |whole_body: &WholeBody, input: &WholeBodyInput<'_>| {
        let whole_row = inside.contains(&at);
        at += 1;
        for (s, (rows, read)) in rows
            .iter_mut()
            .zip(input.ft)
            .enumerate()
            .filter(|_| whole_row)
        {
            let Some(part) = whole_body.estimate().parts.get(1 + s) else {
                continue;
            };
            if part.unknowns == 0 {
                rows.push(row(read, part, whole_body, s));
            }
        }
    };
    pass(robot, log, half, Some(&mut take))?;
    let judged = rows.iter().enumerate().filter(|(_, rows)| !rows.is_empty());
    Ok(judged
        .map(|(s, rows)| (s, judge(rows, log.period)))
        .collect())
}

/// Share of the expected wrench by which the model's masses may be off where nothing states it.
const MODEL_SIGMA: f64 = 0.02;

/// One sensor's row: what it reads, and what the part beyond makes.
fn row(read: &Wrench, part: &PartEstimate, whole_body: &WholeBody, sensor: usize) -> Row {
    let pair = |w: &Wrench| [Vector3::from(w.force), Vector3::from(w.torque)];
    let (measured, net) = (pair(read), pair(&whole_body.net_at_sensor(sensor)));
    let expected = [0, 1].map(|k| measured[k] - net[k]);
    let sigma = pair(&part.residual_sigma);
    Row {
        measured,
        expected,
        sigma: [0, 1].map(|k| sigma[k].norm().hypot(MODEL_SIGMA * expected[k].norm())),
        axes: whole_body.sensor_axes(sensor),
    }
}

/// Torques and standard deviations by joint and row.
struct Pass {
    tau: Vec<Vec<f64>>,
    sigma: Vec<Vec<f64>>,
}

/// Torques and sigmas by the estimator, all signals through windows of `2 half + 1` samples.
///
/// `each_row` sees every row, residuals included.
fn pass(
    robot: &dyn Estimated,
    log: &Signals,
    half: usize,
    mut each_row: Option<EachRow<'_>>,
) -> Result<Pass, Problem> {
    let filtered = |signal: &[f64], derivative| smooth(signal, derivative, half, log.period);
    let gain = impulse(2, half, log.period);
    let mut motion = Vec::new();
    let mut sigma_ddq = Vec::new();
    for angle in &log.angles {
        motion.push([0, 1, 2].map(|d| filtered(angle, d)));
        sigma_ddq.push(gain * noise(angle, half, log.period));
    }
    let ft = log.ft.iter();
    let ft: Vec<[Vec<f64>; 6]> = ft
        .map(|axes| axes.each_ref().map(|axis| filtered(axis, 0)))
        .collect();
    let imu = log.imu.as_ref().map(|axes| {
        let rates = [0, 1, 2].map(|i| filtered(&axes[i], 1));
        (axes.each_ref().map(|axis| filtered(axis, 0)), rates)
    });
    let sensor = [0, 1].map(|derivative| impulse(derivative, half, log.period));
    let parameters = robot.parameters(&FilterGains { sensor, sigma_ddq })?;
    let mut whole_body = WholeBody::new(robot.model(), &parameters).map_err(|e| e.problem())?;
    whole_body.choose(robot.contact_set());
    let n = log.angles.len();
    let (mut tau, mut sigma) = (vec![Vec::new(); n], vec![Vec::new(); n]);
    for i in 0..log.t.len() {
        let each = |d: usize| motion.iter().map(|m| m[d][i]).collect::<Vec<f64>>();
        let (q, dq, ddq) = (each(0), each(1), each(2));
        let reading = |axes: &[Vec<f64>; 6]| Wrench {
            force: [0, 1, 2].map(|k| axes[k][i]),
            torque: [3, 4, 5].map(|k| axes[k][i]),
        };
        let ft: Vec<Wrench> = ft.iter().map(reading).collect();
        let three = |axes: &[Vec<f64>]| Vector3::new(axes[0][i], axes[1][i], axes[2][i]);
        let imu = match &imu {
            Some((axes, rates)) => ImuMotion {
                angular_velocity: three(&axes[..3]),
                angular_acceleration: three(rates),
                proper_acceleration: three(&axes[3..]),
            },
            None => ImuMotion {
                angular_velocity: Vector3::zeros(),
                angular_acceleration: Vector3::zeros(),
                proper_acceleration: Vector3::zeros(),
            },
        };
        let input = WholeBodyInput {
            q: &q,
            dq: &dq,
            ddq: &ddq,
            ft: &ft,
            imu,
        };
        let estimate = match each_row {
            Some(_) => whole_body.update(&input),
            None => whole_body.update_torques(&input),
        };
        if !estimate.valid {
            let reason = format!("at t = {} s the contacts depend on one another", log.t[i]);
            return Err(Problem::new(reason, "other contacts").at(log.file.as_str(), i + 2));
        }
        for k in 0..n {
            tau[k].push(estimate.tau[k]);
            sigma[k].push(estimate.sigma[k]);
        }
        if let Some(each_row) = &mut each_row {
            each_row(&whole_body, &input);
        }
    }
    Ok(Pass { tau, sigma })
}

/// Standard deviation of a derivative for white noise of 1.
fn impulse(derivative: usize, half: usize, period: f64) -> f64 {
    let mut signal = vec![0.0; 6 * half + 1];
    signal[3 * half] = 1.0;
    let response = smooth(&signal, derivative, half, period);
    response.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Mean over `2 half + 1` samples about each.
fn smooth_mean(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    let mut sum = 0.0;
    for x in values {
        sum += x;
        sums.push(sum);
    }
    let mean = |i: usize| {
        let (a, b) = (i.saturating_sub(half), (i + half + 1).min(values.len()));
        (sums[b] - sums[a]).max(0.0) / (b - a) as f64
    };
    (0..values.len()).map(mean).collect()
}
