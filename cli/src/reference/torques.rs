//! Torques of a whole log, by centred filters and the whole-body estimator.

use crate::rows::Rows;
use crate::spool::{Column, Spool, each_row};
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
    pub(crate) t: Column,
    /// Time between rows, s.
    pub(crate) period: f64,
    /// Angles as the model counts them, by joint, rad.
    pub(crate) angles: Vec<Column>,
    /// Wrench that the part beyond each F/T sensor applies to the part before, by sensor and axis.
    pub(crate) ft: Vec<[Column; 6]>,
    /// Gyro and accelerometer, by axis.
    pub(crate) imu: Option<[Column; 6]>,
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
        let spool = Spool::new()?;
        let column = |values: &[f64]| Column::of(&spool, values);
        let angles = joints.iter().map(|joint| column(self.angle(joint)?));
        let ft = sensors.ft_sensors.iter().map(|sensor| {
            let sign = f64::from(sensor.sign);
            let axes = self.six(sensor.name.get_ref(), WRENCH)?;
            let signed = |axis: &[f64]| axis.iter().map(|x| sign * x).collect::<Vec<_>>();
            six(axes.map(|axis| column(&signed(axis))))
        });
        let imu = sensors.imu.as_ref();
        let imu = imu.map(|_| six(self.six("imu", IMU)?.map(column)));
        Ok(Signals {
            t: column(&self.t)?,
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

/// Six columns, or why one of them is not there.
fn six(columns: [Result<Column, Problem>; 6]) -> Result<[Column; 6], Problem> {
    let [a, b, c, d, e, f] = columns;
    Ok([a?, b?, c?, d?, e?, f?])
}

/// Torques and standard deviations of every joint.
pub(crate) struct Torques {
    tau: Vec<Column>,
    sigma: Vec<Column>,
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
        let other = pass(robot, log, 2 * half, None)?.tau;
        widen(&mut sigma, &tau, &other, half, REMOVED)?;
        // A signal that a long window has removed altogether shows beside a short one.
        let short = (0.5 * SHORT_S / log.period).round().max(2.0) as usize;
        if short < half {
            let other = pass(robot, log, short, None)?.tau;
            widen(&mut sigma, &tau, &other, half, 1.0)?;
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

    /// Torques and standard deviations of a joint, by row.
    ///
    /// # Errors
    /// A temporary file that cannot be read.
    pub(crate) fn of(&self, joint: usize) -> Result<[Vec<f64>; 2], Problem> {
        Ok([self.tau[joint].read()?, self.sigma[joint].read()?])
    }
}

/// Adds the local difference between two passes, times `part`, to sigma.
fn widen(
    sigma: &mut [Column],
    tau: &[Column],
    other: &[Column],
    half: usize,
    part: f64,
) -> Result<(), Problem> {
    for ((tau, other), sigma) in tau.iter().zip(other).zip(sigma) {
        let (tau, other) = (tau.read()?, other.read()?);
        let squares = tau.iter().zip(&other).map(|(a, b)| (a - b).powi(2));
        let local = smooth_mean(&squares.collect::<Vec<f64>>(), 2 * half);
        sigma.change(|sigma| {
            for (sigma, square) in sigma.iter_mut().zip(local) {
                *sigma = sigma.hypot(part * square.sqrt());
            }
            Ok(())
        })?;
    }
    Ok(())
}

/// What looks at each row's estimate.
type LookAt<'a> = &'a mut dyn FnMut(&WholeBody, &WholeBodyInput<'_>);

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
    tau: Vec<Column>,
    sigma: Vec<Column>,
}

/// Signals behind windows of `2 half + 1` samples.
struct Filtered {
    /// q, dq, ddq of each joint; the axes of each F/T sensor; those of the IMU, and the derivatives of its gyro's.
    columns: Vec<Column>,
    joints: usize,
    sensors: usize,
    /// Standard deviation of the accelerations, by joint.
    sigma_ddq: Vec<f64>,
}

impl Filtered {
    fn new(log: &Signals, half: usize) -> Result<Self, Problem> {
        let spool = Spool::new()?;
        let filtered = |signal: &[f64], derivative| {
            Column::of(&spool, &smooth(signal, derivative, half, log.period))
        };
        let gain = impulse(2, half, log.period);
        let (mut columns, mut sigma_ddq) = (Vec::new(), Vec::new());
        for angle in &log.angles {
            let angle = angle.read()?;
            for derivative in 0..3 {
                columns.push(filtered(&angle, derivative)?);
            }
            sigma_ddq.push(gain * noise(&angle, half, log.period));
        }
        for axis in log.ft.iter().flatten().chain(log.imu.iter().flatten()) {
            columns.push(filtered(&axis.read()?, 0)?);
        }
        for rate in log.imu.iter().flat_map(|axes| &axes[..3]) {
            columns.push(filtered(&rate.read()?, 1)?);
        }
        Ok(Self {
            columns,
            joints: log.angles.len(),
            sensors: log.ft.len(),
            sigma_ddq,
        })
    }

    /// Derivative `d` of all angles in a row of the columns.
    fn motion(&self, row: &[f64], d: usize) -> Vec<f64> {
        row[..3 * self.joints]
            .iter()
            .skip(d)
            .step_by(3)
            .copied()
            .collect()
    }

    fn wrenches(&self, row: &[f64]) -> Vec<Wrench> {
        let axes = &row[3 * self.joints..][..6 * self.sensors];
        let (wrenches, _) = axes.as_chunks::<6>();
        let wrench = |&[fx, fy, fz, tx, ty, tz]: &[f64; 6]| Wrench {
            force: [fx, fy, fz],
            torque: [tx, ty, tz],
        };
        wrenches.iter().map(wrench).collect()
    }

    fn imu(&self, row: &[f64]) -> ImuMotion {
        let axes = &row[3 * self.joints + 6 * self.sensors..];
        let three = |at: usize| {
            axes.get(at..at + 3)
                .map_or_else(Vector3::zeros, Vector3::from_column_slice)
        };
        ImuMotion {
            angular_velocity: three(0),
            proper_acceleration: three(3),
            angular_acceleration: three(6),
        }
    }
}

/// Torques and sigmas by the estimator, all signals through windows of `2 half + 1` samples.
///
/// `look` sees every row, residuals included.
fn pass(
    robot: &dyn Estimated,
    log: &Signals,
    half: usize,
    mut look: Option<LookAt<'_>>,
) -> Result<Pass, Problem> {
    let filtered = Filtered::new(log, half)?;
    let sensor = [0, 1].map(|derivative| impulse(derivative, half, log.period));
    let parameters = robot.parameters(&FilterGains {
        sensor,
        sigma_ddq: filtered.sigma_ddq.clone(),
    })?;
    let mut whole_body = WholeBody::new(robot.model(), &parameters).map_err(|e| e.problem())?;
    whole_body.choose(robot.contact_set());
    let spool = Spool::new()?;
    let n = log.angles.len();
    let empty = || (0..n).map(|_| Column::new(&spool)).collect();
    let (mut tau, mut sigma): (Vec<Column>, Vec<Column>) = (empty(), empty());
    let columns: Vec<&Column> = [&log.t].into_iter().chain(&filtered.columns).collect();
    each_row(&columns, |i, values| {
        let (t, row) = (values[0], &values[1..]);
        let [q, dq, ddq] = [0, 1, 2].map(|d| filtered.motion(row, d));
        let ft = filtered.wrenches(row);
        let input = WholeBodyInput {
            q: &q,
            dq: &dq,
            ddq: &ddq,
            ft: &ft,
            imu: filtered.imu(row),
        };
        let estimate = match look {
            Some(_) => whole_body.update(&input),
            None => whole_body.update_torques(&input),
        };
        if !estimate.valid {
            let reason = format!("at t = {t} s the contacts depend on one another");
            return Err(Problem::new(reason, "other contacts").at(log.file.as_str(), i + 2));
        }
        for k in 0..n {
            tau[k].push(estimate.tau[k])?;
            sigma[k].push(estimate.sigma[k])?;
        }
        if let Some(look) = &mut look {
            look(&whole_body, &input);
        }
        Ok(())
    })?;
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
