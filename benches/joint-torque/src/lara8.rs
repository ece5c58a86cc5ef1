//! A real joint with two encoders: skew, stiffness and external torque (data/lara8_joint3).
//!
//! `torsion = tau/K + skew dq + c sign(dq) + constant` gives stiffness and skew; their intervals come
//! from leaving out half-second blocks one by one, as neighbouring samples are alike. The external
//! torque is an estimate of the joint torque from torsion, velocity and feed-forward, less the
//! feed-forward; fitted on every other half-second block and judged on the others, both ways.

use identification::least_squares::Batch;
use std::f64::consts::TAU;

const DATA: &str = include_str!("../data/lara8_joint3/sweep.csv");
const GEAR_RATIO: f64 = 101.0;
const COUNTS: f64 = 16_777_216.0;
/// Distance of the F/T sensor from the joint's axis, m.
const LEVER: f64 = 0.8735;
const BLOCK_S: f64 = 0.5;
/// |dq| over which the sign of friction is smoothed, rad/s.
const SMOOTHING: f64 = 0.02;

/// Figures of the real joint.
#[derive(Debug, Clone, Copy)]
pub struct Lara8 {
    /// Skew: delay of the motor-side encoder's sample, s, and half of its 95 % interval.
    pub skew: (f64, f64),
    /// K, N·m/rad, and half of its 95 % interval.
    pub stiffness: (f64, f64),
    /// RMS error of the external torque on each half, and on both, N·m.
    pub rms: [f64; 3],
    /// That of the motor current less feed-forward, N·m.
    pub current_rms: f64,
}

struct Row {
    t: f64,
    torsion: f64,
    dq: f64,
    current: f64,
    feed_forward: f64,
    external: f64,
}

fn rows() -> Result<Vec<Row>, String> {
    let mut rows = Vec::new();
    for (number, line) in DATA.lines().enumerate().skip(1) {
        let fields: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
        let fields = fields.map_err(|e| format!("sweep.csv:{}: {e}", number + 1))?;
        let &[t, motor, link, dq, current, feed_forward, fx, ty] = &fields[..] else {
            return Err(format!("sweep.csv:{}: 8 numbers are needed", number + 1));
        };
        rows.push(Row {
            t,
            torsion: (motor / GEAR_RATIO - link) * TAU / COUNTS,
            dq,
            current,
            feed_forward,
            external: -(LEVER * fx + ty),
        });
    }
    // The encoders' offsets are unknown: torsion counts from its mean.
    let mean = rows.iter().map(|r| r.torsion).sum::<f64>() / rows.len().max(1) as f64;
    rows.iter_mut().for_each(|r| r.torsion -= mean);
    Ok(rows)
}

fn block(row: &Row) -> usize {
    (row.t / BLOCK_S) as usize
}

fn direction(row: &Row) -> f64 {
    (row.dq / SMOOTHING).tanh()
}

/// Stiffness (N·m/rad) and skew (s) from all blocks but one.
fn gear(rows: &[Row], without: Option<usize>) -> Option<[f64; 2]> {
    let mut batch = Batch::new(4);
    for r in rows.iter().filter(|r| Some(block(r)) != without) {
        let tau = r.external + r.feed_forward;
        batch.add(&[tau, r.dq, direction(r), 1.0], r.torsion);
    }
    let solution = batch.solve(1e-12)?;
    Some([1.0 / solution.x[0], solution.x[1]])
}

/// Half of the 95 % interval by leaving out blocks one by one.
fn interval(rows: &[Row], all: [f64; 2]) -> [f64; 2] {
    let blocks = rows.last().map_or(0, block) + 1;
    let n = blocks as f64;
    let mut square = [0.0; 2];
    for without in 0..blocks {
        if let Some(one) = gear(rows, Some(without)) {
            for (s, (x, all)) in square.iter_mut().zip(one.into_iter().zip(all)) {
                *s += (x - all).powi(2);
            }
        }
    }
    square.map(|s| 1.96 * ((n - 1.0) / n * s).sqrt())
}

fn features(r: &Row) -> [f64; 7] {
    let x = r.torsion / 2.7e-3;
    [x, x * x, x * x * x, r.dq, r.feed_forward, direction(r), 1.0]
}

/// Fits to one half of the blocks and gives the sum of squares and the count on the other.
fn cross(rows: &[Row], judged: usize) -> Option<(f64, f64)> {
    let mut batch = Batch::new(7);
    for r in rows.iter().filter(|r| block(r) % 2 != judged) {
        batch.add(&features(r), r.external + r.feed_forward);
    }
    let solution = batch.solve(1e-5)?;
    let (mut square, mut count) = (0.0, 0.0);
    for r in rows.iter().filter(|r| block(r) % 2 == judged) {
        let tau: f64 = solution.x.iter().zip(features(r)).map(|(w, x)| w * x).sum();
        square += (tau - r.feed_forward - r.external).powi(2);
        count += 1.0;
    }
    Some((square, count))
}

/// Figures of the real joint from its data.
///
/// # Errors
/// Data that are not as they should be.
pub fn lara8() -> Result<Lara8, String> {
    let rows = rows()?;
    let failed = || "sweep.csv: the gear is not determined".to_owned();
    let all = gear(&rows, None).ok_or_else(failed)?;
    let half = interval(&rows, all);
    let [a, b] = [cross(&rows, 0), cross(&rows, 1)];
    let (a, b) = (a.ok_or_else(failed)?, b.ok_or_else(failed)?);
    let root = |square: f64, count: f64| (square / count).sqrt();
    let current: f64 = rows
        .iter()
        .map(|r| (r.current - r.feed_forward - r.external).powi(2))
        .sum();
    Ok(Lara8 {
        skew: (all[1], half[1]),
        stiffness: (all[0], half[0]),
        rms: [root(a.0, a.1), root(b.0, b.1), root(a.0 + b.0, a.1 + b.1)],
        current_rms: root(current, rows.len() as f64),
    })
}

#[cfg(test)]
mod tests {
    use super::lara8;

    #[test]
    fn the_real_joint_is_as_its_owners_found_it() {
        let joint = lara8().unwrap();
        assert!((joint.current_rms - 6.48).abs() < 0.005, "{joint:?}");
        assert!(joint.rms[2] < 2.0, "a plain regression has 2.0: {joint:?}");
        let (skew, half) = joint.skew;
        assert!(
            (skew.abs() - 2e-3).abs() < 0.5e-3 && half < 1e-3,
            "{joint:?}"
        );
        assert!((25e3..45e3).contains(&joint.stiffness.0), "{joint:?}");
    }
}
