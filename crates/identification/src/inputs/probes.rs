//! Two linear probes of a log, one of the torsion and one of the current, with the reference shifted
//! in time: when it fits best, whether it drifts, bends or runs backwards.

use super::signals::Signals;
use crate::least_squares::{Batch, Solution};
use crate::record::smooth;
use joint_file::JointFile;

/// Window of the centred filters, s.
const WINDOW_S: f64 = 0.025;
/// Rows that probes look at, at most.
const MAX_ROWS: usize = 2_000;
/// Largest shift of the reference, s, and its steps in the first pass.
pub(super) const MAX_SHIFT_S: f64 = 0.16;
const SHIFT_STEPS: i64 = 32;
/// Speed over which the sign of friction is smoothed, parts of the largest.
const SMOOTHING: f64 = 0.02;
/// Play of the stops that make a hysteresis, parts of the largest torque, and of those that make a friction before it
/// slides, rad on the link side: a gear's motor side slides after some 1e-4 rad.
const HYSTERESIS: [f64; 2] = [0.04, 0.15];
const SLIDING: [f64; 2] = [2e-4, 1e-3];
const RIDGE: f64 = 1e-10;

/// Which side is explained by the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Torsion of the gear, by both encoders.
    Torsion,
    /// Current of the motor.
    Current,
}

/// Terms beyond the constant ones.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Terms {
    /// Reference that bends: its third power.
    pub(super) bent: bool,
    /// Zero that changes with time: line and parabola.
    pub(super) drift: bool,
    /// Memory of the way before: hysteresis of the gear, friction before it slides.
    pub(super) lasting: bool,
}

const LAG_TERMS: Terms = Terms {
    bent: false,
    drift: false,
    lasting: true,
};

/// Filtered signals, and the rows that count.
pub(super) struct Probes {
    u: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    /// K_t N i, N·m.
    motor: Vec<f64>,
    tau: Vec<f64>,
    dtau: Vec<f64>,
    torsion: Vec<f64>,
    theta: Vec<f64>,
    hysteresis: [Vec<f64>; 2],
    sliding: [Vec<f64>; 2],
    rows: Vec<usize>,
    period: f64,
    size: f64,
    speed: f64,
    loading: f64,
}

/// Equations of a probe.
pub(super) struct Design {
    /// Coefficients of each row.
    pub(super) rows: Vec<Vec<f64>>,
    /// Their sums.
    pub(super) values: Vec<f64>,
}

impl Design {
    /// Normal equations of some rows.
    pub(super) fn batch(&self, rows: core::ops::Range<usize>) -> Batch {
        let mut batch = Batch::new(self.rows[0].len());
        for k in rows {
            batch.add(&self.rows[k], self.values[k]);
        }
        batch
    }

    /// Residual of a row, with the torque's sign.
    pub(super) fn residual(&self, fit: &Solution, k: usize, sign: f64) -> f64 {
        let row = &self.rows[k];
        let sum: f64 = row.iter().zip(fit.x.iter()).map(|(a, x)| a * x).sum();
        self.values[k] - sum + (1.0 - sign) * row[TORQUE] * fit.x[TORQUE]
    }
}

/// Result of a probe.
pub(super) struct Probed {
    pub(super) fit: Solution,
    /// Residuals of the rows in their order.
    pub(super) residual: Vec<f64>,
}

/// Places of columns that both probes have in common: torque, and sign of friction or hysteresis.
pub(super) const TORQUE: usize = 0;
pub(super) const SIGN: usize = 1;
pub(super) const BENT: usize = 2;
pub(super) const DRIFT: usize = 3;
const COMMON: usize = 5;

impl Probes {
    pub(super) fn new(s: &Signals, joint: &JointFile) -> Option<Self> {
        let n = s.t.len();
        let period = (s.t[n - 1] - s.t[0]) / (n - 1) as f64;
        let median = median_step(&s.t).unwrap_or(period);
        let half = ((0.5 * WINDOW_S / median) as usize).max(2);
        let filtered = |x: &[f64], d| smooth(x, d, half, median);
        let j = &joint.joint;
        let error = joint.kinematic_error_parameters();
        let torsion: Vec<f64> =
            s.u.iter()
                .zip(&s.q)
                .map(|(u, q)| u - q - error.error(*q, u * j.gear_ratio))
                .collect();
        let motor: Vec<f64> = s
            .current
            .iter()
            .map(|i| j.gear_ratio * j.torque_constant * i)
            .collect();
        let margin = (MAX_SHIFT_S / median).ceil() as usize + 2 * half;
        // Rows near gaps have no neighbours that could be shifted onto them.
        let mut free = vec![true; n];
        for k in (1..n).filter(|&k| s.t[k] - s.t[k - 1] > 2.5 * median) {
            free[k.saturating_sub(margin)..(k + margin).min(n)].fill(false);
        }
        let step = n.div_ceil(MAX_ROWS).max(1);
        let rows: Vec<usize> = (margin..n.saturating_sub(margin))
            .step_by(step)
            .filter(|&k| free[k])
            .collect();
        if rows.len() < 200 {
            return None;
        }
        let tau = filtered(&s.tau, 0);
        let dtau = filtered(&s.tau, 1);
        let dq = filtered(&s.q, 1);
        let most = |x: &[f64]| {
            let mut sizes: Vec<f64> = rows.iter().map(|&k| x[k].abs()).collect();
            sizes.sort_by(f64::total_cmp);
            sizes[(sizes.len() - 1) * 99 / 100]
        };
        let (size, speed, loading) = (most(&tau), most(&dq), most(&dtau));
        let u = filtered(&s.u, 0);
        Some(Self {
            hysteresis: HYSTERESIS.map(|part| stops(&tau, part * size)),
            sliding: SLIDING.map(|way| stops(&u, way)),
            u,
            q: filtered(&s.q, 0),
            ddq: filtered(&s.q, 2),
            motor: filtered(&motor, 0),
            torsion: filtered(&torsion, 0),
            theta: s.u.iter().map(|u| u * j.gear_ratio).collect(),
            tau,
            dtau,
            dq,
            rows,
            period: median,
            size,
            speed,
            loading,
        })
    }

    /// Shift in rows nearest to a time, s.
    fn shift(&self, time: f64) -> i64 {
        (time / self.period).round() as i64
    }

    fn place(row: usize, shift: i64) -> usize {
        (row as i64 + shift).max(0) as usize
    }

    /// Rows of a probe where the reference is taken `late` seconds later: one that is late fits then.
    pub(super) fn design(&self, side: Side, late: f64, terms: Terms) -> Design {
        let shift = self.shift(late);
        let value = |k: usize| match side {
            Side::Torsion => self.torsion[k] - self.torsion[self.rows[0]],
            Side::Current => self.motor[k],
        };
        Design {
            rows: self
                .rows
                .iter()
                .map(|&k| self.row(side, k, shift, terms))
                .collect(),
            values: self.rows.iter().map(|&k| value(k)).collect(),
        }
    }

    /// A probe of a [`Design`].
    pub(super) fn probe(&self, side: Side, late: f64, terms: Terms) -> Option<Probed> {
        let design = self.design(side, late, terms);
        let all = 0..design.values.len();
        let fit = design.batch(all.clone()).solve(RIDGE)?;
        Some(Probed {
            residual: all.map(|k| design.residual(&fit, k, 1.0)).collect(),
            fit,
        })
    }

    fn row(&self, side: Side, k: usize, shift: i64, terms: Terms) -> Vec<f64> {
        let at = Self::place(k, shift);
        let tau = self.tau[at.min(self.tau.len() - 1)];
        let place = 2.0 * k as f64 / self.tau.len() as f64 - 1.0;
        let slip = (self.dq[k] / (SMOOTHING * self.speed).max(1e-6)).tanh();
        let [bent, drift, lasting] =
            [terms.bent, terms.drift, terms.lasting].map(|on| if on { 1.0 } else { 0.0 });
        let mut row = vec![
            tau,
            slip,
            bent * tau * (tau / self.size.max(1e-9)).powi(2),
            drift * place,
            drift * (place * place - 1.0 / 3.0),
            1.0,
            self.dq[k],
        ];
        match side {
            Side::Torsion => {
                let at = at.min(self.tau.len() - 1);
                row.extend(self.hysteresis.iter().map(|x| lasting * x[at]));
                let dtau = self.dtau[at];
                row.push((dtau / (0.1 * self.loading).max(1e-9)).tanh());
                for (angle, order) in [
                    (self.q[k], 1.0),
                    (self.q[k], 2.0),
                    (self.theta[k], 1.0),
                    (self.theta[k], 2.0),
                ] {
                    let (sin, cos) = (order * angle).sin_cos();
                    row.extend([cos, sin]);
                }
            }
            Side::Current => {
                row.extend([self.ddq[k], tau.abs() * slip]);
                row.extend(self.sliding.iter().map(|x| lasting * x[k]));
            }
        }
        debug_assert!(row.len() > COMMON);
        row
    }

    /// Rows that count as independent, by the autocorrelation of a residual.
    pub(super) fn independent(residual: &[f64]) -> f64 {
        residual.len() as f64 / crate::excitation::correlation(residual)
    }

    /// Torque that the reference's shift by `late` seconds changes, RMS over the reference's deviation.
    pub(super) fn effect(&self, late: f64) -> f64 {
        let shift = self.shift(late);
        let n = self.tau.len() - 1;
        let change = self
            .rows
            .iter()
            .map(|&k| (self.tau[k] - self.tau[Self::place(k, shift).min(n)]).powi(2));
        (change.sum::<f64>() / self.rows.len() as f64).sqrt() / self.deviation().max(1e-12)
    }

    /// Standard deviation of the reference on the rows.
    pub(super) fn deviation(&self) -> f64 {
        let n = self.rows.len() as f64;
        let mean = self.rows.iter().map(|&k| self.tau[k]).sum::<f64>() / n;
        (self
            .rows
            .iter()
            .map(|&k| (self.tau[k] - mean).powi(2))
            .sum::<f64>()
            / n)
            .sqrt()
    }

    /// The lag of the reference against a side: best time, its 2 sigma interval, s, and how much less likely
    /// no lag is, as the logarithm of the likelihoods' ratio.
    pub(super) fn lag(&self, side: Side) -> Option<Lag> {
        let cost = |late: f64| {
            let probed = self.probe(side, late, LAG_TERMS)?;
            let square = probed.residual.iter().map(|r| r * r).sum::<f64>();
            Some((square, probed))
        };
        let coarse = MAX_SHIFT_S / SHIFT_STEPS as f64;
        let mut costs = Vec::new();
        for k in -SHIFT_STEPS..=SHIFT_STEPS {
            costs.push((coarse * k as f64, cost(coarse * k as f64)?.0));
        }
        let &(best, _) = costs.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        for k in -4..=4 {
            let late = best + 0.25 * coarse * f64::from(k);
            if late.abs() <= MAX_SHIFT_S {
                costs.push((late, cost(late)?.0));
            }
        }
        let &(best, least) = costs.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let rows = Self::independent(&cost(best)?.1.residual);
        let unlikely = |square: f64| 0.5 * rows * (square / least.max(1e-300)).ln();
        let within = costs
            .iter()
            .filter(|(_, c)| unlikely(*c) < 2.0)
            .map(|(late, _)| *late);
        let (low, high) = within.fold((best, best), |(a, b), x| (a.min(x), b.max(x)));
        let none = cost(0.0)?.0;
        Some(Lag {
            late: best,
            interval: (low, high),
            unlikely_without: unlikely(none),
        })
    }

    /// Rows that are looked at.
    pub(super) fn rows(&self) -> &[usize] {
        &self.rows
    }

    pub(super) fn size(&self) -> f64 {
        self.size
    }

    /// u, q, theta, torsion, K_t N i, tau, dq, filtered.
    pub(super) fn signals(&self) -> [&[f64]; 7] {
        [
            &self.u,
            &self.q,
            &self.theta,
            &self.torsion,
            &self.motor,
            &self.tau,
            &self.dq,
        ]
    }
}

/// Time by which the reference is late against another channel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lag {
    /// s; below zero it is early.
    pub(super) late: f64,
    /// 2 sigma, s.
    pub(super) interval: (f64, f64),
    /// Logarithm of the ratio of likelihoods, without the lag.
    pub(super) unlikely_without: f64,
}

/// A spring that slides beyond a play, -1 to 1: what it takes up of a way (Maxwell-slip; Prandtl's stop operator).
fn stops(way: &[f64], play: f64) -> Vec<f64> {
    let play = play.max(1e-12);
    let (mut taken, mut before) = (0.0f64, way.first().copied().unwrap_or(0.0));
    let step = |x: &f64| {
        taken = (taken + (x - before) / play).clamp(-1.0, 1.0);
        before = *x;
        taken
    };
    way.iter().map(step).collect()
}

fn median_step(t: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied()
}
