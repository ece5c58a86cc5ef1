//! Motor identification of D 3: the command by which a drive produces a torque, from rows of command,
//! torque and velocity.
//!
//! In: rows at any rate, `b` being delta_q of a position drive or the motor current. Out: coefficients of
//!
//! ```text
//! b = k_tau tau + k_v dq + k_c sign(dq)          D6: K_tau, K_v, K_c;   D3 solved for i: 1/K1, K2/K1, K3/K1
//! ```
//! by least squares (D7), by a penalty that hardly ever over-estimates |b| (D8 by Newton, D9 as a quadratic
//! program), in two stages (D 3.3.1), and a model that is piecewise linear in tau (D 3.2.2). Unlike
//! [`crate::drive`] these models know no dead zone, no rotor and no delay: they are D's, to
//! compare and to use with D's law.

use nalgebra::{Matrix3, RowVector3, Vector3};
use problem::Problem;

/// One instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorRow {
    /// tau: joint torque, N·m.
    pub tau: f64,
    /// dq: joint velocity, by a centred filter (D 3.4.3), rad/s.
    pub dq: f64,
    /// delta_q, rad, or i, A.
    pub command: f64,
}

/// How the coefficients are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// D7.
    LeastSquares,
    /// D8, by Newton's method.
    Asymmetric,
    /// D9: the same as a quadratic program, on at most [`QP_ROWS`] rows.
    QuadraticProgram,
    /// D 3.3.1: k_tau at rest, then the others in motion, each by the penalty of D8.
    TwoStage,
}

/// Coefficients of the linear model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorFit {
    /// k_tau, k_v, k_c.
    pub x: [f64; 3],
    /// Their standard deviations, by leaving out blocks of rows (jackknife).
    pub sigma: [f64; 3],
    /// Root mean square of what is left of the command.
    pub rms: f64,
    /// Share of the rows whose |command| is over-estimated.
    pub over: f64,
    /// Rows.
    pub rows: usize,
}

/// A model that is piecewise linear in tau, for one sign of the velocity (D 3.2.1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piecewise {
    /// Slope and offset of the lines, from low torque to high.
    pub lines: [(f64, f64); 3],
    /// Torques at which they meet, N·m.
    pub breaks: [f64; 2],
    /// Whether the breaks came to rest.
    pub converged: bool,
    /// Root mean square of what is left of the command.
    pub rms: f64,
}

/// w of D8 (D 5.2).
pub const PENALTY: f64 = 100.0;
/// Most rows of the quadratic program (D 3.3: 10^3 are enough).
pub const QP_ROWS: usize = 1000;
/// Fewest rows of a fit.
const LEAST_ROWS: usize = 30;
/// Blocks of the jackknife.
const BLOCKS: usize = 12;
/// A row is at rest below this share of the joint's own speed, which it exceeds for a twentieth of the time.
const REST_SHARE: f64 = 0.05;
const SLOWEST: f64 = 0.95;
/// Iterations of the piecewise fit (D 3.2.2), and its first breaks as a share of the torque's range.
const ITERATIONS: usize = 10;
const FIRST_BREAKS: f64 = 0.05;
/// The middle line's slope is at least that of the outer ones, and at most so many times it: within a dead zone
/// the command changes without torque.
const STEEPEST: f64 = 100.0;

/// Fits the linear model.
///
/// # Errors
/// Too few rows, or rows that do not determine the coefficients.
pub fn fit(rows: &[MotorRow], method: Method) -> Result<MotorFit, Problem> {
    if rows.len() < LEAST_ROWS {
        let reason = format!("{} rows for the motor's model", rows.len());
        return Err(Problem::new(reason, format!("at least {LEAST_ROWS}")));
    }
    let lost = || {
        Problem::new(
            "the rows do not determine the motor's model",
            "rows with torque of both signs, at rest and in motion",
        )
    };
    let x = coefficients(rows, method).ok_or_else(lost)?;
    let size = rows.len().div_ceil(BLOCKS);
    let mut variance = Vector3::zeros();
    for block in 0..BLOCKS {
        let out = block * size..(block + 1) * size;
        let kept: Vec<MotorRow> = (rows.iter().enumerate())
            .filter(|(i, _)| !out.contains(i))
            .map(|(_, row)| *row)
            .collect();
        // A block without which the rest determines nothing: its own share is the whole.
        let moved = coefficients(&kept, method).map_or(x, |other| other - x);
        variance += moved.component_mul(&moved);
    }
    let factor = (BLOCKS - 1) as f64 / BLOCKS as f64;
    let left = |row: &MotorRow| (a(row) * x)[0] - row.command;
    let over = rows
        .iter()
        .filter(|row| left(row) * row.command.signum() > 0.0);
    Ok(MotorFit {
        x: x.into(),
        sigma: variance.map(|v| (factor * v).sqrt()).into(),
        rms: (rows.iter().map(|row| left(row).powi(2)).sum::<f64>() / rows.len() as f64).sqrt(),
        over: over.count() as f64 / rows.len() as f64,
        rows: rows.len(),
    })
}

fn a(row: &MotorRow) -> RowVector3<f64> {
    let sign = if row.dq == 0.0 { 0.0 } else { row.dq.signum() };
    RowVector3::new(row.tau, row.dq, sign)
}

fn coefficients(rows: &[MotorRow], method: Method) -> Option<Vector3<f64>> {
    let none = Vector3::zeros();
    match method {
        Method::LeastSquares => weighted(rows, [true; 3], none, |_| 1.0),
        Method::Asymmetric => asymmetric(rows, [true; 3], none),
        Method::QuadraticProgram => quadratic_program(&decimated(rows, QP_ROWS)),
        Method::TwoStage => {
            let (rest, motion) = by_motion(rows);
            // D 3.3.1: k_tau from samples of zero velocity, then k_v from the others with that k_tau
            let first = asymmetric(&rest, [true, false, false], none)?;
            asymmetric(&motion, [false, true, true], first)
        }
    }
}

/// Rows at rest, and in motion.
fn by_motion(rows: &[MotorRow]) -> (Vec<MotorRow>, Vec<MotorRow>) {
    let mut speeds: Vec<f64> = rows.iter().map(|row| row.dq.abs()).collect();
    speeds.sort_by(f64::total_cmp);
    let own = speeds[((speeds.len() - 1) as f64 * SLOWEST) as usize];
    rows.iter()
        .partition(|row| row.dq.abs() <= REST_SHARE * own)
}

/// Weighted least squares over some coefficients; the others stay.
fn weighted(
    rows: &[MotorRow],
    free: [bool; 3],
    fixed: Vector3<f64>,
    weight: impl Fn(&MotorRow) -> f64,
) -> Option<Vector3<f64>> {
    //= D7: min over x of |A x - b|²
    let (mut gram, mut moment) = (Matrix3::zeros(), Vector3::zeros());
    for row in rows {
        let (a, w) = (a(row), weight(row));
        let rest = row.command - (a * fixed)[0];
        gram += w * a.transpose() * a;
        moment += w * rest * a.transpose();
    }
    // In units of each column: they differ by orders of magnitude.
    let scale = Vector3::from_fn(|i, _| {
        if free[i] && gram[(i, i)] > 0.0 {
            1.0 / gram[(i, i)].sqrt()
        } else {
            0.0
        }
    });
    let mut scaled = Matrix3::from_fn(|i, j| scale[i] * scale[j] * gram[(i, j)]);
    for i in 0..3 {
        if free[i] && scale[i] == 0.0 {
            return None;
        }
        scaled[(i, i)] += if free[i] { 1e-12 } else { 1.0 };
    }
    let step = scaled.cholesky()?.solve(&moment.component_mul(&scale));
    Some(fixed + step.component_mul(&scale))
}

/// Over-estimation of |b| by a row: positive where there is one.
fn over(row: &MotorRow, x: &Vector3<f64>) -> f64 {
    let sign = if row.command < 0.0 { -1.0 } else { 1.0 };
    sign * ((a(row) * x)[0] - row.command)
}

fn penalty(rows: &[MotorRow], x: &Vector3<f64>) -> f64 {
    let phi = |row: &MotorRow| {
        let z = over(row, x);
        if z > 0.0 { PENALTY * z * z } else { z * z }
    };
    rows.iter().map(phi).sum()
}

/// Newton's method: within the set of rows that are over-estimated the penalty is a quadratic, so that one step
/// is a weighted least squares; a line search makes it go down from set to set.
fn asymmetric(rows: &[MotorRow], free: [bool; 3], fixed: Vector3<f64>) -> Option<Vector3<f64>> {
    //= D8: min over x of sum phi(A x - b), phi(z) = w z² if z > 0, else z²
    let mut x = weighted(rows, free, fixed, |_| 1.0)?;
    let mut value = penalty(rows, &x);
    for _ in 0..100 {
        let weight = |row: &MotorRow| if over(row, &x) > 0.0 { PENALTY } else { 1.0 };
        let step = weighted(rows, free, fixed, weight)? - x;
        let mut share = 1.0;
        let mut next = x + step;
        while penalty(rows, &next) > value && share > 1e-6 {
            share *= 0.5;
            next = x + share * step;
        }
        let gone = value - penalty(rows, &next);
        if gone <= 1e-14 * value {
            break;
        }
        (x, value) = (next, value - gone);
    }
    Some(x)
}

/// D9 by a barrier method: `y_p` and `y_n` of each row are eliminated, so that a step solves three equations.
fn quadratic_program(rows: &[MotorRow]) -> Option<Vector3<f64>> {
    //= D9: min w |y_p|² + |y_n|²  s. t.  y_p >= A x - b, y_n >= b - A x, y_p, y_n >= 0
    let start = weighted(rows, [true; 3], Vector3::zeros(), |_| 1.0)?;
    let unit = (rows.iter().map(|row| row.command.powi(2)).sum::<f64>() / rows.len() as f64).sqrt();
    // Columns and right side in units of their own size.
    let mut scale = Vector3::zeros();
    for row in rows {
        scale += a(row).transpose().component_mul(&a(row).transpose());
    }
    let scale = scale.map(|s: f64| (s / rows.len() as f64).sqrt());
    if scale.min() <= 0.0 || unit <= 0.0 {
        return None;
    }
    let signed = |row: &MotorRow| {
        let sign = if row.command < 0.0 { -1.0 } else { 1.0 };
        let a = a(row).transpose().component_div(&scale);
        (sign * a, sign * row.command / unit)
    };
    let data: Vec<(Vector3<f64>, f64)> = rows.iter().map(signed).collect();
    let mut x = start.component_mul(&scale) / unit;
    let z = |x: &Vector3<f64>, (a, b): &(Vector3<f64>, f64)| a.dot(x) - b;
    let mut y: Vec<[f64; 2]> = (data.iter())
        .map(|row| [z(&x, row).max(0.0) + 0.1, (-z(&x, row)).max(0.0) + 0.1])
        .collect();
    let mut sharpness = 1.0;
    while sharpness < 1e11 {
        for _ in 0..50 {
            let (step_x, step_y, decrement) = newton(&data, &x, &y, sharpness)?;
            // The step stays within the constraints, and goes down.
            let value = |x: &Vector3<f64>, y: &[[f64; 2]]| barrier(&data, x, y, sharpness);
            let before = value(&x, &y);
            let mut share = 1.0;
            let (mut next_x, mut next_y);
            loop {
                next_x = x + share * step_x;
                next_y = y.clone();
                for (y, step) in next_y.iter_mut().zip(&step_y) {
                    y[0] += share * step[0];
                    y[1] += share * step[1];
                }
                let after = value(&next_x, &next_y);
                if after <= before - 0.1 * share * decrement || share < 1e-10 {
                    break;
                }
                share *= 0.5;
            }
            (x, y) = (next_x, next_y);
            if decrement < 1e-9 * data.len() as f64 {
                break;
            }
        }
        sharpness *= 10.0;
    }
    Some(x.component_div(&scale) * unit)
}

/// The barrier's value; infinite outside of the constraints.
fn barrier(data: &[(Vector3<f64>, f64)], x: &Vector3<f64>, y: &[[f64; 2]], sharpness: f64) -> f64 {
    let of = |((a, b), [p, n]): (&(Vector3<f64>, f64), &[f64; 2])| {
        let z = a.dot(x) - b;
        let inside = [p - z, n + z, *p, *n];
        if inside.iter().all(|s| *s > 0.0) {
            sharpness * (PENALTY * p * p + n * n) - inside.iter().map(|s| s.ln()).sum::<f64>()
        } else {
            f64::INFINITY
        }
    };
    data.iter().zip(y).map(of).sum()
}

/// Newton's step of the barrier in x and every row's y, and the decrement.
#[allow(clippy::type_complexity, reason = "one use, just above")]
fn newton(
    data: &[(Vector3<f64>, f64)],
    x: &Vector3<f64>,
    y: &[[f64; 2]],
    sharpness: f64,
) -> Option<(Vector3<f64>, Vec<[f64; 2]>, f64)> {
    let (mut gram, mut moment) = (Matrix3::zeros(), Vector3::zeros());
    let mut parts = Vec::with_capacity(data.len());
    for ((a, b), [p, n]) in data.iter().zip(y) {
        let z = a.dot(x) - b;
        let (s, t) = (1.0 / (p - z), 1.0 / (n + z));
        // Gradient and Hessian in p, n and z.
        let g = [
            2.0 * sharpness * PENALTY * p - s - 1.0 / p,
            2.0 * sharpness * n - t - 1.0 / n,
            s - t,
        ];
        let h = [
            2.0 * sharpness * PENALTY + s * s + 1.0 / (p * p),
            2.0 * sharpness + t * t + 1.0 / (n * n),
        ];
        let (cp, cn) = (-s * s, t * t);
        let zz = s * s + t * t - cp * cp / h[0] - cn * cn / h[1];
        let gz = g[2] - cp * g[0] / h[0] - cn * g[1] / h[1];
        gram += zz * a * a.transpose();
        moment += gz * a;
        parts.push((g, h, [cp, cn]));
    }
    let step = gram.cholesky()?.solve(&-moment);
    let mut decrement = 0.0;
    let of_row = |((a, _), (g, h, c)): (&(Vector3<f64>, f64), &([f64; 3], [f64; 2], [f64; 2]))| {
        let dz = a.dot(&step);
        let dy = [0, 1].map(|i| -(g[i] + c[i] * dz) / h[i]);
        decrement -= g[0] * dy[0] + g[1] * dy[1] + g[2] * dz;
        dy
    };
    let steps = data.iter().zip(&parts).map(of_row).collect();
    Some((step, steps, decrement))
}

/// At most so many rows, evenly spread.
fn decimated(rows: &[MotorRow], most: usize) -> Vec<MotorRow> {
    rows.iter()
        .step_by(rows.len().div_ceil(most).max(1))
        .copied()
        .collect()
}

/// Fits the piecewise model for each sign of the velocity: forwards, backwards. `k_v dq` is taken off first:
/// D's rows were at rest.
///
/// # Errors
/// Too few rows of one sign.
pub fn piecewise(rows: &[MotorRow], k_v: f64) -> Result<[Piecewise; 2], Problem> {
    let of = |sign: f64, name: &str| {
        let rows: Vec<(f64, f64)> = (rows.iter())
            .filter(|row| row.dq * sign > 0.0)
            .map(|row| (row.tau, row.command - k_v * row.dq))
            .collect();
        if rows.len() < LEAST_ROWS {
            let reason = format!("{} rows with {name} velocity", rows.len());
            return Err(Problem::new(reason, format!("at least {LEAST_ROWS}")));
        }
        Ok(alternating(&rows))
    };
    Ok([of(1.0, "positive")?, of(-1.0, "negative")?])
}

/// D 3.2.2: lines for given breaks, breaks where the lines meet, in turn.
fn alternating(rows: &[(f64, f64)]) -> Piecewise {
    let torques = || rows.iter().map(|(tau, _)| *tau);
    let (least, most) = torques().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), t| {
        (l.min(t), m.max(t))
    });
    let mut breaks = [-FIRST_BREAKS, FIRST_BREAKS].map(|share| share * (most - least));
    let whole = line(rows.iter()).unwrap_or((0.0, 0.0));
    let mut lines = [whole; 3];
    let mut converged = false;
    for _ in 0..ITERATIONS {
        let part = |lower: f64, upper: f64| {
            let within = move |(tau, _): &&(f64, f64)| (lower..upper).contains(tau);
            line(rows.iter().filter(within))
        };
        lines[0] = part(f64::NEG_INFINITY, breaks[0]).unwrap_or(whole);
        lines[2] = part(breaks[1], f64::INFINITY).unwrap_or(whole);
        let outer = 0.5 * (lines[0].0 + lines[2].0).abs();
        let within: Vec<(f64, f64)> = (rows.iter())
            .filter(|(tau, _)| (breaks[0]..breaks[1]).contains(tau))
            .copied()
            .collect();
        let (slope, _) = line(within.iter()).unwrap_or(whole);
        let slope = slope.clamp(outer, STEEPEST * outer);
        let middle = within.iter().map(|(tau, b)| b - slope * tau).sum::<f64>();
        lines[1] = if within.is_empty() {
            whole
        } else {
            (slope, middle / within.len() as f64)
        };
        let meet = |a: (f64, f64), b: (f64, f64)| (b.1 - a.1) / (a.0 - b.0);
        let next = [meet(lines[0], lines[1]), meet(lines[1], lines[2])];
        // Lines that do not meet in order within the data, with rows between them, leave the breaks.
        if !(next.iter().all(|b| (least..=most).contains(b)) && next[0] < next[1]) {
            break;
        }
        converged =
            (next[0] - breaks[0]).abs() + (next[1] - breaks[1]).abs() < 1e-3 * (most - least);
        breaks = next;
        if converged {
            break;
        }
    }
    let at = |tau: f64| {
        let (slope, offset) = match tau {
            t if t < breaks[0] => lines[0],
            t if t < breaks[1] => lines[1],
            _ => lines[2],
        };
        slope * tau + offset
    };
    let square: f64 = rows.iter().map(|(tau, b)| (at(*tau) - b).powi(2)).sum();
    Piecewise {
        lines,
        breaks,
        converged,
        rms: (square / rows.len() as f64).sqrt(),
    }
}

/// Slope and offset of the line through points.
fn line<'a>(points: impl Iterator<Item = &'a (f64, f64)>) -> Option<(f64, f64)> {
    let (mut n, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (tau, b) in points {
        (n, x, y) = (n + 1.0, x + tau, y + b);
        (xx, xy) = (xx + tau * tau, xy + tau * b);
    }
    let spread = n * xx - x * x;
    (n >= 5.0 && spread > 1e-12 * n * xx).then(|| {
        let slope = (n * xy - x * y) / spread;
        (slope, (y - slope * x) / n)
    })
}
