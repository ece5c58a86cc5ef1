//! Errors of every estimator over one run, beside the sigma that it reported.

use estimators::joint::JointTorqueEstimator;
use identification::log::LogRow;
use joint_file::JointFile;
use problem::Problem;
use robot_state::{TorqueEstimate, torque_flags};

/// One estimator over one run.
#[derive(Debug, Clone)]
pub struct Line {
    /// The estimator; `fused` is the last.
    pub name: String,
    /// Root mean square error, N·m.
    pub rms: f64,
    /// Root mean square of error over sigma; ideally 1.
    pub ratio: f64,
}

/// All estimators over one run.
#[derive(Debug, Clone)]
pub struct Score {
    /// Lines, `fused` last.
    pub lines: Vec<Line>,
    /// RMS of the true torque, N·m.
    pub torque: f64,
}

/// Standard deviation of the torque that is known in a tare, of the rated torque: the mean of some samples of the very
/// torque that judges.
pub const TARE_SIGMA: f64 = 0.001;

#[derive(Default, Clone)]
struct Sums {
    square: f64,
    relative: f64,
    count: f64,
}

impl Sums {
    fn add(&mut self, e: &TorqueEstimate, tau: f64) {
        let error = e.tau - tau;
        let sigma = e.sigma.max(1e-9);
        self.square += error * error;
        self.relative += (error / sigma).powi(2);
        self.count += 1.0;
    }
}

impl Score {
    /// Runs the estimators over rows with true torques, judging from `from` seconds on. The fused
    /// torque is judged at every row, valid or not: a user takes it at every row.
    ///
    /// # Errors
    /// Estimators that cannot be built.
    pub fn of(file: &JointFile, rows: &[(LogRow, f64)], from: f64) -> Result<Self, Problem> {
        Self::after(file, rows, from, 0)
    }

    /// The same after a tare at the true torque on so many samples, which are not judged.
    ///
    /// # Errors
    /// Estimators that cannot be built.
    pub fn after(
        file: &JointFile,
        rows: &[(LogRow, f64)],
        from: f64,
        tared: usize,
    ) -> Result<Self, Problem> {
        let mut set = file.estimators()?;
        let mut front_end = file.front_end()?;
        let mut names = set.names().to_vec();
        names.push("fused".to_owned());
        let mut sums = vec![Sums::default(); names.len()];
        let (mut last, mut square, mut count) = (None, 0.0, 0.0);
        for (i, (row, tau)) in rows.iter().enumerate() {
            front_end.bridge(last.replace(row.t), row.t);
            let sample = row.sample(&mut front_end);
            let fused = set.update(&sample);
            if i < tared {
                set.tare_to(*tau, TARE_SIGMA * file.joint.rated_torque);
                continue;
            }
            if row.t < from || !tau.is_finite() {
                continue;
            }
            square += tau * tau;
            count += 1.0;
            for (sum, e) in sums.iter_mut().zip(set.estimates().iter().chain([&fused])) {
                sum.add(e, *tau);
            }
            debug_assert!(fused.flags & torque_flags::VALID != 0 || fused.tau.is_finite());
        }
        let root = |sum: f64, count: f64| (sum / f64::max(count, 1.0)).sqrt();
        let lines = names.into_iter().zip(&sums).map(|(name, s)| Line {
            name,
            rms: root(s.square, s.count),
            ratio: root(s.relative, s.count),
        });
        Ok(Self {
            lines: lines.collect(),
            torque: root(square, count),
        })
    }

    /// The fused torque's line.
    #[must_use]
    pub fn fused(&self) -> Option<&Line> {
        self.lines.last()
    }

    /// The line of the source with the least error, in hindsight.
    #[must_use]
    pub fn best(&self) -> Option<&Line> {
        let sources = self.lines.iter().filter(|l| l.name != "fused");
        sources.min_by(|a, b| a.rms.total_cmp(&b.rms))
    }
}
