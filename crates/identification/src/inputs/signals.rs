//! Columns of a log, and statistics that the checks share.

use crate::log::LogRow;
use joint_file::JointFile;

/// Half the window of the difference that velocities come from, s.
const HALF_WINDOW_S: f64 = 0.02;

/// Columns of a log.
pub(super) struct Signals {
    /// t, s.
    pub(super) t: Vec<f64>,
    /// theta over the gear ratio, rad.
    pub(super) u: Vec<f64>,
    /// q, rad.
    pub(super) q: Vec<f64>,
    /// dq by a centred difference of q, rad/s.
    pub(super) dq: Vec<f64>,
    /// i, A.
    pub(super) current: Vec<f64>,
    /// tau_sensor, N·m; NaN where there is none.
    pub(super) tau: Vec<f64>,
    /// tau_feedforward, N·m; none where not every row has one.
    pub(super) feed_forward: Option<Vec<f64>>,
}

impl Signals {
    pub(super) fn new(joint: &JointFile, rows: &[LogRow]) -> Self {
        let column = |value: fn(&LogRow) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
        let (t, q) = (column(|r| r.t), column(|r| r.q));
        let half = ((HALF_WINDOW_S / joint.sample_period()).round() as usize).max(1);
        let last = rows.len() - 1;
        let difference = |i: usize| {
            let (a, b) = (i.saturating_sub(half), (i + half).min(last));
            (q[b] - q[a]) / (t[b] - t[a])
        };
        Self {
            dq: (0..rows.len()).map(difference).collect(),
            u: (rows.iter().map(|r| r.theta / joint.joint.gear_ratio)).collect(),
            current: column(|r| r.current),
            tau: column(|r| r.tau_sensor),
            feed_forward: Some(column(|r| r.feed_forward))
                .filter(|all| all.iter().all(|tau| tau.is_finite())),
            t,
            q,
        }
    }
}

/// Difference between the quantiles at 0.1 % and 99.9 %: spikes do not count.
pub(super) fn span(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| {
        let place = (part * sorted.len().saturating_sub(1) as f64).round() as usize;
        sorted.get(place).copied().unwrap_or(0.0)
    };
    at(0.999) - at(0.001)
}

/// Standard deviation.
pub(super) fn deviation(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Whether a column holds one number only.
pub(super) fn constant(values: &[f64]) -> bool {
    values.windows(2).all(|w| w[0] == w[1])
}
