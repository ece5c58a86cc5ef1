//! A real six-joint arm with two encoders a joint and an F/T sensor at the flange (NEURA LARA8).
//!
//! There is no torque sensor in the joints. The reference is the torque of the flange's wrench,
//! `-J^T S w`, plus the controller's feed-forward without its friction. The friction of joints 3 and 2 was
//! found by regression of the feed-forward on rigid-body terms, direction and speed of the target
//! (2026-11); that of the others is of the order that the data's description gives, and matters only where they
//! move. The encoders' zeros are unknown: torsion counts from the log's first sample.

use identification::log::LogRow;
use problem::Problem;
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

/// Joints of the arm.
pub const JOINTS: usize = 6;
const COUNTS: f64 = 16_777_216.0;
/// Gear ratios and directions of the encoder pairs.
pub(crate) const RATIOS: [f64; JOINTS] = [121.0, 121.0, 101.0, 101.0, 101.0, 101.0];
const DIRECTIONS: [f64; JOINTS] = [-1.0, -1.0, 1.0, -1.0, 1.0, -1.0];
/// Denavit-Hartenberg rows: a, alpha, d, offset of theta.
const DH: [[f64; 4]; JOINTS] = [
    [0.0, -FRAC_PI_2, 0.26, 0.0],
    [0.48, 0.0, 0.0, -FRAC_PI_2],
    [0.0, FRAC_PI_2, 0.0, FRAC_PI_2],
    [0.0, -FRAC_PI_2, 0.7, 0.0],
    [0.0, FRAC_PI_2, 0.0, 0.0],
    [0.0, 0.0, 0.1735, 0.0],
];
/// Friction in the feed-forward: Coulomb, N·m, and viscous, N·m·s/rad.
const FRICTION: [[f64; 2]; JOINTS] = [
    [13.0, 80.0],
    [14.0, 85.0],
    [6.5, 13.5],
    [9.5, 13.5],
    [2.5, 5.0],
    [1.6, 3.0],
];
/// Speed of the target over which the friction's direction changes, rad/s.
const SMOOTHING: f64 = 5e-3;
/// Rated torques of gears with these ratios and frictions, N·m (catalogue sizes 32, 25, 17).
const RATED: [f64; JOINTS] = [216.0, 216.0, 108.0, 108.0, 40.0, 40.0];
/// Their stiffnesses at rated torque by the same catalogue, N·m/rad.
const STIFFNESS: [f64; JOINTS] = [1.05e5, 1.05e5, 4.95e4, 4.95e4, 1.47e4, 1.47e4];
/// Rotor inertias, kg·m², of motors of that size.
const ROTORS: [f64; JOINTS] = [1.5e-4, 1.5e-4, 5e-5, 5e-5, 1.5e-5, 1.5e-5];
/// Time between samples after resampling, s: the controller's own, which the stamps scatter about.
pub const PERIOD_S: f64 = 4e-3;

/// One log of one joint at equal steps.
#[derive(Debug, Clone)]
pub struct JointLog {
    /// Rows; the current counts as joint torque (its torque constant is 1/N), the feed-forward is without
    /// friction.
    pub rows: Vec<LogRow>,
}

impl JointLog {
    /// A contiguous part of it.
    #[must_use]
    pub fn part(&self, from: usize, to: usize) -> Self {
        Self {
            rows: self.rows[from..to].to_vec(),
        }
    }

    /// The same without feed-forward.
    #[must_use]
    pub fn without_feed_forward(&self) -> Self {
        let without = |row: &LogRow| LogRow {
            feed_forward: f64::NAN,
            ..*row
        };
        Self {
            rows: self.rows.iter().map(without).collect(),
        }
    }
}

/// The arm's joint file, data sheet alone.
///
/// # Errors
/// Never, unless the format has changed.
pub fn joint_file(joint: usize) -> Result<joint_file::JointFile, Problem> {
    let ratio = RATIOS[joint];
    let text = format!(
        "[joint]\nname = \"lara8-{}\"\ngear_ratio = {ratio:.1}\ntorque_constant_Nm_per_A = {}\n\
         rotor_inertia_kg_m2 = {}\nrated_torque_Nm = {:.1}\nlink_counts_per_turn = {COUNTS:.1}\n\
         motor_counts_per_turn = {COUNTS:.1}\nsample_rate_hz = {:.1}\n\
         stiffness_Nm_per_rad = {:.1}\n",
        joint + 1,
        1.0 / ratio,
        ROTORS[joint],
        RATED[joint],
        1.0 / PERIOD_S,
        STIFFNESS[joint],
    );
    joint_file::JointFile::parse(&text, "lara8", &joint_file::no_files)
}

type Matrix = [[f64; 4]; 4];

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn link([a, alpha, d, offset]: [f64; 4], q: f64) -> Matrix {
    let ((s, c), (sa, ca)) = ((q + offset).sin_cos(), alpha.sin_cos());
    [
        [c, -s * ca, s * sa, a * c],
        [s, c * ca, -c * sa, a * s],
        [0.0, sa, ca, d],
        [0.0, 0.0, 0.0, 1.0],
    ]
}

/// Joint torques of the flange's wrench as the sensor reads it: force, torque.
fn external(q: &[f64; JOINTS], reading: [f64; 6]) -> [f64; JOINTS] {
    let unit: Matrix =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let mut frames = vec![unit];
    for (row, q) in DH.iter().zip(q) {
        let next = multiply(frames.last().unwrap_or(&unit), &link(*row, *q));
        frames.push(next);
    }
    let flange = frames.last().copied().unwrap_or(unit);
    // The sensor's z axes read reversed.
    let [fx, fy, fz, tx, ty, tz] = reading;
    let to_base = |v: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| (0..3).map(|k| flange[i][k] * v[k]).sum())
    };
    let (force, torque) = (to_base([fx, fy, -fz]), to_base([tx, ty, -tz]));
    std::array::from_fn(|j| {
        let frame = &frames[j];
        let axis: [f64; 3] = std::array::from_fn(|i| frame[i][2]);
        let arm: [f64; 3] = std::array::from_fn(|i| flange[i][3] - frame[i][3]);
        let moment = cross(arm, force);
        -(0..3)
            .map(|i| axis[i] * (moment[i] + torque[i]))
            .sum::<f64>()
    })
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

/// Reads a log of the arm, one [`JointLog`] a joint.
///
/// # Errors
/// A file that cannot be read, lacks a column, or has fields that are not numbers.
pub fn read(path: &Path) -> Result<Vec<JointLog>, Problem> {
    let name = path.display().to_string();
    let refuse = |line: usize, why: String| Problem::new(why, "").at(name.as_str(), line);
    let text = std::fs::read_to_string(path).map_err(|e| refuse(0, e.to_string()))?;
    let mut lines = text.lines();
    let header: HashMap<&str, usize> = (lines.next().unwrap_or("").split(','))
        .enumerate()
        .map(|(i, column)| (column, i))
        .collect();
    let mut table = Vec::new();
    for (i, line) in lines.enumerate() {
        let row: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
        table.push(row.map_err(|e| refuse(i + 2, e.to_string()))?);
    }
    let column = |name: &str| -> Result<Vec<f64>, Problem> {
        let place = header
            .get(name)
            .ok_or_else(|| refuse(1, format!("column `{name}` is missing")))?;
        Ok(table.iter().map(|row| row[*place]).collect())
    };
    let each = |before: &str, after: &str| -> Result<Vec<Vec<f64>>, Problem> {
        (1..=JOINTS)
            .map(|j| column(&format!("{before}{j}{after}")))
            .collect()
    };
    let t = column("t_s")?;
    let q = each("q", "_rad")?;
    let (motor, link) = (each("motor", "_counts")?, each("link", "_counts")?);
    let (current, forward) = (each("current", "_as_Nm")?, each("feedforward", "_Nm")?);
    let target = each("dq_target", "_rad_per_s")?;
    let wrench = ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"].map(column);
    let wrench: Vec<Vec<f64>> = wrench.into_iter().collect::<Result<_, _>>()?;
    let outside: Vec<[f64; JOINTS]> = (0..t.len())
        .map(|i| {
            external(
                &std::array::from_fn(|j| q[j][i]),
                std::array::from_fn(|k| wrench[k][i]),
            )
        })
        .collect();
    Ok((0..JOINTS)
        .map(|j| {
            let ratio = RATIOS[j];
            let angle = |counts: f64| DIRECTIONS[j] * counts * TAU / COUNTS;
            let mut turned = 0.0;
            let mut last = angle(link[j][0]);
            let links: Vec<f64> = link[j]
                .iter()
                .map(|&counts| {
                    let now = angle(counts);
                    turned -= ((now - last) / TAU).round() * TAU;
                    last = now;
                    now + turned
                })
                .collect();
            let zero = angle(motor[j][0]) / ratio - links[0];
            let rows: Vec<LogRow> = (0..t.len())
                .map(|i| {
                    let [coulomb, viscous] = FRICTION[j];
                    let v = target[j][i];
                    let friction = coulomb * (v / SMOOTHING).tanh() + viscous * v;
                    let model = forward[j][i] - friction;
                    LogRow {
                        t: t[i],
                        theta: angle(motor[j][i]) - ratio * zero,
                        q: links[i],
                        current: current[j][i],
                        tau_sensor: outside[i][j] + model,
                        feed_forward: model,
                    }
                })
                .collect();
            resampled(&rows)
        })
        .collect())
}

/// Equal steps by straight lines between the samples: the stamps lie 0.3 to 15 ms apart.
fn resampled(rows: &[LogRow]) -> JointLog {
    let (first, last) = (rows[0].t, rows[rows.len() - 1].t);
    let count = ((last - first) / PERIOD_S) as usize;
    let (mut out, mut i) = (Vec::new(), 0);
    for k in 0..count {
        let t = first + k as f64 * PERIOD_S;
        while i + 2 < rows.len() && rows[i + 1].t < t {
            i += 1;
        }
        let (a, b) = (&rows[i], &rows[i + 1]);
        let part = (t - a.t) / (b.t - a.t);
        let mix = |a: f64, b: f64| a + part * (b - a);
        out.push(LogRow {
            t: (k + 1) as f64 * PERIOD_S,
            theta: mix(a.theta, b.theta),
            q: mix(a.q, b.q),
            current: mix(a.current, b.current),
            tau_sensor: mix(a.tau_sensor, b.tau_sensor),
            feed_forward: mix(a.feed_forward, b.feed_forward),
        });
    }
    JointLog { rows: out }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joint_3_of_the_stretched_arm_has_the_lever_of_the_data_s_description() {
        // All joints at zero: -(0.8735 m Fx + Ty).
        let torque = external(&[0.0; 6], [2.0, 0.0, 0.0, 0.0, 0.5, 0.0]);
        assert!((torque[2] + 0.8735 * 2.0 + 0.5).abs() < 1e-9, "{torque:?}");
    }
}
