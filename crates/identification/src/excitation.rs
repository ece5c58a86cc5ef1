//! Ranges that a training log covers, and constants that it determines.
//!
//! Two linear probes, one of the torsion and one of the current, hold every constant that the fits
//! estimate, each with a prior: mean and width by catalogues of gears and drives. The log's
//! information on them is that of least squares, counted once per independent sample: residuals of
//! a wrong model are not noise, they last, and an interval that takes them for noise is many times
//! too narrow. A constant is determined by the log if its standard deviation given the log is
//! less than half its prior's.

use crate::record::Record;
use estimators::kinematic_error::KinematicErrorParameters;
use joint_file::JointFile;
use nalgebra::{DMatrix, DVector};

/// A constant that a log may determine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// 1/K: compliance of the gear, rad/(N·m).
    Compliance,
    /// Skew between the encoders, s.
    Skew,
    /// Current over torque, over that of the data sheet, 1.
    TorqueConstant,
    /// Friction of the motor side over the rated torque, 1.
    Friction,
    /// Viscous friction of the motor side, s/rad of rated torque.
    ViscousFriction,
    /// Friction that grows with the torque, 1.
    LoadFriction,
    /// Rotor inertia over the data sheet's, 1.
    Inertia,
}

impl Quantity {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Compliance => "stiffness",
            Self::Skew => "skew",
            Self::TorqueConstant => "torque constant",
            Self::Friction => "friction",
            Self::ViscousFriction => "viscous friction",
            Self::LoadFriction => "friction under load",
            Self::Inertia => "rotor inertia",
        }
    }
}

/// A value with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
}

/// One constant: before the log and with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Determination {
    /// The constant.
    pub quantity: Quantity,
    /// By catalogues.
    pub prior: Known,
    /// By catalogues and the log.
    pub posterior: Known,
    /// By the log, under a prior so wide that it hardly counts.
    pub measured: Known,
}

impl Determination {
    /// Whether the log determines it.
    #[must_use]
    pub fn determined(&self) -> bool {
        self.posterior.sigma < DETERMINED * self.prior.sigma
    }
}

/// Standard deviation with the log over that of the prior.
const DETERMINED: f64 = 0.5;

/// Ranges of a training log, and what it determines.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    /// tau_sensor: smallest and largest, N·m.
    pub torque: [f64; 2],
    /// q: smallest and largest, rad.
    pub angle: [f64; 2],
    /// Largest |dq|, rad/s.
    pub speed: f64,
    /// Largest |dtau|, N·m/s.
    pub loading_rate: f64,
    /// Share of the samples in motion, 1.
    pub moving: f64,
    /// Condition number of the torsion's probe, columns scaled to unit length.
    pub condition: f64,
    /// Standard deviation of the torsion that the probe leaves, rad.
    pub torsion_sigma: f64,
    /// Every constant.
    pub constants: Vec<Determination>,
}

/// Widening of the priors for the constants whose residual is the noise.
const WIDENING: f64 = 300.0;
/// Widening of the priors of what is not asked for, such as the kinematic error: over a small angle a sum of large ones
/// would be any torque. Twenty times is ten times an encoder mounted off centre.
const WIDENING_OF_OTHERS: f64 = 20.0;
/// Regularisation of scaled normal equations.
const RIDGE: f64 = 1e-12;
/// Samples used at most.
const MAX_SAMPLES: usize = 20_000;
/// Samples of the residual's autocorrelation at most.
const MAX_LAG_SAMPLES: usize = 2_000;
/// Angle covered below which a joint stands, rad: the output bearing's pre-sliding.
const STANDS: f64 = 0.01;
/// |dq| above which it moves, parts of the largest.
const MIN_RELATIVE_SPEED: f64 = 0.005;
/// |dq| over which the sign of friction is smoothed, parts of the largest.
const SMOOTHING: f64 = 0.02;

/// Stiffness by catalogues, rated torques per radian: harmonic drives of three makers have 300 to
/// 900.
pub const CATALOGUE_STIFFNESS: f64 = 500.0;
/// Relative width of the compliance about that.
const COMPLIANCE_WIDTH: f64 = 0.5;
/// Skew between two encoders read by one drive or over a bus, s.
pub const SKEW_WIDTH_S: f64 = 0.002;
/// Amplitudes of the kinematic error of q, 2 q, theta, 2 theta and 4 theta, rad, before any
/// unloaded turn; after one a tenth of them.
const HARMONICS: [(bool, f64, f64); 5] = [
    (true, 1.0, 5e-4),
    (true, 2.0, 2e-4),
    (false, 1.0, 1e-4),
    (false, 2.0, 1e-4),
    (false, 4.0, 3e-5),
];
const AFTER_TURN: f64 = 0.1;
/// Friction of the output bearing, parts of the rated torque.
const BEARING_WIDTH: f64 = 0.05;
/// Priors of the current's probe: mean and width, in the units of [`Quantity`].
const CURRENT_PRIORS: [(Quantity, f64, f64); 5] = [
    (Quantity::TorqueConstant, 1.0, 0.2),
    (Quantity::Friction, 0.15, 0.15),
    (Quantity::ViscousFriction, 0.1, 0.2),
    (Quantity::LoadFriction, 0.05, 0.07),
    (Quantity::Inertia, 1.0, 0.5),
];

impl Excitation {
    /// Ranges and probes of a record with a torque reference.
    #[must_use]
    pub fn new(record: &Record, joint: &JointFile) -> Self {
        let tau = record.smooth(&record.tau, 0);
        let dtau = record.smooth(&record.tau, 1);
        let q: Vec<f64> = record.samples.iter().map(|s| s.q).collect();
        // Of q alone: a load that changes moves the motor of a joint that stands.
        let [dq, ddq] = [1, 2].map(|d| record.smooth(&q, d));
        let rows: Vec<usize> = record.spread(MAX_SAMPLES).collect();
        let range = |x: &[f64]| {
            let each = rows.iter().map(|&i| x[i]);
            each.fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(x), b.max(x)])
        };
        let largest = |x: &[f64]| rows.iter().fold(0.0f64, |m, &i| m.max(x[i].abs()));
        let (angle, speed) = (range(&q), largest(&dq));
        let stands = angle[1] - angle[0] < STANDS;
        let moving: Vec<usize> = if stands {
            Vec::new()
        } else {
            let moves = |i: &usize| dq[*i].abs() > MIN_RELATIVE_SPEED * speed;
            rows.iter().copied().filter(moves).collect()
        };
        let signals = Motion {
            tau,
            dq,
            ddq,
            smoothing: (SMOOTHING * speed).max(1e-6),
            stands,
        };
        let torsion = torsion_probe(record, joint, &signals, &rows);
        let current = current_probe(record, joint, &signals, &moving);
        Self {
            torque: range(&signals.tau),
            angle,
            speed,
            loading_rate: largest(&dtau),
            moving: moving.len() as f64 / rows.len().max(1) as f64,
            condition: torsion.condition,
            torsion_sigma: torsion.sigma,
            constants: [torsion.constants, current.constants].concat(),
        }
    }

    /// One constant.
    #[must_use]
    pub fn constant(&self, quantity: Quantity) -> Option<&Determination> {
        self.constants.iter().find(|c| c.quantity == quantity)
    }

    /// Whether the log determines a constant.
    #[must_use]
    pub fn determines(&self, quantity: Quantity) -> bool {
        self.constant(quantity)
            .is_some_and(Determination::determined)
    }

    /// A constant that the log does not determine; none if it does.
    #[must_use]
    pub fn undetermined(&self, quantity: Quantity) -> Option<&Determination> {
        self.constant(quantity).filter(|c| !c.determined())
    }

    /// The log's own estimate of a constant, without the prior; none where the log does not bear
    /// on it.
    #[must_use]
    pub fn measured(&self, quantity: Quantity) -> Option<Known> {
        let constant = self.constant(quantity)?;
        let bears = constant.measured.sigma < 0.1 * WIDENING * constant.prior.sigma;
        bears.then_some(constant.measured)
    }

    /// Lines for a report.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let [torque, angle] = [self.torque, self.angle].map(|[a, b]| format!("{a:.3} to {b:.3}"));
        let mut lines = vec![
            format!(
                "torque {torque} N·m, loading up to {:.1} N·m/s; angle {angle} rad, speed up to \
                 {:.3} rad/s, in motion {:.0} % of the time",
                self.loading_rate,
                self.speed,
                100.0 * self.moving
            ),
            format!("condition number {:.0}", self.condition),
        ];
        for constant in self.constants.iter().filter(|c| !c.determined()) {
            lines.push(constant.sentence());
        }
        lines
    }
}

impl Determination {
    /// The sentence that names an undetermined constant and its prior.
    #[must_use]
    pub fn sentence(&self) -> String {
        let (p, name) = (self.prior, self.quantity.name());
        let prior = match self.quantity {
            Quantity::Compliance => format!(
                "{:.0} N·m/rad within a factor of {:.1}",
                1.0 / p.value,
                1.0 + p.sigma / p.value
            ),
            Quantity::Skew => format!("{:.1} ± {:.1} ms", 1e3 * p.value, 1e3 * p.sigma),
            Quantity::TorqueConstant | Quantity::Inertia => {
                format!("{} ± {} of the data sheet's", p.value, p.sigma)
            }
            Quantity::Friction => format!("{} ± {} of the rated torque", p.value, p.sigma),
            Quantity::ViscousFriction => {
                format!("{} ± {} of the rated torque per rad/s", p.value, p.sigma)
            }
            Quantity::LoadFriction => format!("{} ± {} of the torque", p.value, p.sigma),
        };
        format!("{name}: not determined by this log; prior {prior}")
    }
}

/// Signals of both probes, without delay.
struct Motion {
    tau: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    smoothing: f64,
    stands: bool,
}

/// torsion - error = tau/K + skew dq + bearing sign(dq) + constant + harmonics.
fn torsion_probe(record: &Record, joint: &JointFile, m: &Motion, rows: &[usize]) -> Probe {
    let error: KinematicErrorParameters = joint.kinematic_error_parameters();
    let known = if joint.kinematic_error.is_some() {
        AFTER_TURN
    } else {
        1.0
    };
    let compliance = 1.0 / (CATALOGUE_STIFFNESS * joint.joint.rated_torque);
    let bearing = BEARING_WIDTH / CATALOGUE_STIFFNESS;
    let mut priors = vec![
        Known {
            value: compliance,
            sigma: COMPLIANCE_WIDTH * compliance,
        },
        Known {
            value: 0.0,
            sigma: SKEW_WIDTH_S,
        },
        Known {
            value: 0.0,
            sigma: bearing,
        },
        Known {
            value: 0.0,
            sigma: 10.0,
        },
    ];
    for (_, _, amplitude) in HARMONICS {
        priors.extend(
            [Known {
                value: 0.0,
                sigma: known * amplitude,
            }; 2],
        );
    }
    let mut data = Vec::with_capacity(rows.len());
    // An absolute encoder's zero is anywhere: the constant's prior is about the first sample.
    let torsion = |i: usize| {
        let s = &record.samples[i];
        s.theta / record.gear_ratio - s.q - error.error(s.q, s.theta)
    };
    let first = rows.first().map_or(0.0, |&i| torsion(i));
    for &i in rows {
        let s = &record.samples[i];
        let dq = if m.stands { 0.0 } else { m.dq[i] };
        let mut row = vec![m.tau[i], dq, (dq / m.smoothing).tanh(), 1.0];
        for (link, order, _) in HARMONICS {
            let (sin, cos) = (order * if link { error.w_link * s.q } else { s.theta }).sin_cos();
            row.extend([cos, sin]);
        }
        data.push((row, torsion(i) - first));
    }
    let named = [Quantity::Compliance, Quantity::Skew];
    determinations(named.into_iter(), &priors, &data)
}

/// N K_t i = gain tau + (friction R + mesh |tau|) sign(dq) + viscous R dq + inertia J N² ddq + offset.
fn current_probe(record: &Record, joint: &JointFile, m: &Motion, moving: &[usize]) -> Probe {
    let j = &joint.joint;
    let (n, rated) = (j.gear_ratio, j.rated_torque);
    let current = record.smooth(&record.current(), 0);
    let mut data = Vec::with_capacity(moving.len());
    for &i in moving {
        let direction = (m.dq[i] / m.smoothing).tanh();
        let row = vec![
            m.tau[i],
            rated * direction,
            rated * m.dq[i],
            m.tau[i].abs() * direction,
            j.rotor_inertia * n * n * m.ddq[i],
            1.0,
        ];
        data.push((row, n * j.torque_constant * current[i]));
    }
    let mut priors = CURRENT_PRIORS
        .map(|(_, value, sigma)| Known { value, sigma })
        .to_vec();
    priors.push(Known {
        value: 0.0,
        sigma: 0.3 * rated,
    });
    let named = CURRENT_PRIORS.iter().map(|(quantity, ..)| *quantity);
    determinations(named, &priors, &data)
}

/// Result of a probe.
struct Probe {
    constants: Vec<Determination>,
    condition: f64,
    /// Standard deviation of the residual.
    sigma: f64,
}

/// A probe whose first columns are the named constants.
fn determinations(
    named: impl Iterator<Item = Quantity>,
    priors: &[Known],
    data: &[(Vec<f64>, f64)],
) -> Probe {
    let equations = Equations::new(data, priors.len());
    let square = data.iter().map(|(_, b)| b * b).sum::<f64>() / data.len().max(1) as f64;
    // Noise is what the best constants leave, also where those contradict the priors.
    let named: Vec<Quantity> = named.collect();
    let wide: Vec<Known> = (priors.iter().enumerate())
        .map(|(i, prior)| {
            let widening = if i < named.len() {
                WIDENING
            } else {
                WIDENING_OF_OTHERS
            };
            Known {
                sigma: widening * prior.sigma,
                ..*prior
            }
        })
        .collect();
    let free = equations.solve(1.0 / square.max(1e-30), &wide);
    let residual = |(row, b): &(Vec<f64>, f64)| {
        b - row.iter().zip(&free).map(|(a, k)| a * k.value).sum::<f64>()
    };
    let residuals: Vec<f64> = data.iter().map(residual).collect();
    let variance = residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len().max(1) as f64;
    let weight = 1.0 / (variance * correlation(&residuals)).max(1e-30);
    let [posterior, measured] = [priors, &wide].map(|priors| equations.solve(weight, priors));
    let constants = named
        .into_iter()
        .enumerate()
        .map(|(i, quantity)| Determination {
            quantity,
            prior: priors[i],
            posterior: posterior[i],
            measured: measured[i],
        });
    Probe {
        constants: constants.collect(),
        condition: condition(&equations.gram),
        sigma: variance.sqrt(),
    }
}

/// Normal equations of all rows.
struct Equations {
    gram: DMatrix<f64>,
    moment: DVector<f64>,
}

impl Equations {
    fn new(data: &[(Vec<f64>, f64)], columns: usize) -> Self {
        let mut gram = DMatrix::<f64>::zeros(columns, columns);
        let mut moment = DVector::<f64>::zeros(columns);
        for (row, b) in data {
            let row = DVector::from_column_slice(row);
            gram.ger(1.0, &row, &row, 1.0);
            moment.axpy(*b, &row, 1.0);
        }
        Self { gram, moment }
    }

    /// Every coefficient, each row weighted by `per_row`, under priors.
    fn solve(&self, per_row: f64, priors: &[Known]) -> Vec<Known> {
        let n = priors.len();
        let (mut h, mut g) = (&self.gram * per_row, &self.moment * per_row);
        for (i, prior) in priors.iter().enumerate() {
            let weight = prior.sigma.powi(-2);
            h[(i, i)] += weight;
            g[i] += weight * prior.value;
        }
        // Scaled, as priors' weights span many decades.
        let scale: Vec<f64> = (0..n).map(|i| h[(i, i)].sqrt()).collect();
        let own = |i, j| if i == j { RIDGE } else { 0.0 };
        let scaled = DMatrix::from_fn(n, n, |i, j| h[(i, j)] / (scale[i] * scale[j]) + own(i, j));
        let Some(factor) = scaled.cholesky() else {
            return priors.to_vec();
        };
        let right = DVector::from_fn(n, |i, _| g[i] / scale[i]);
        let (x, inverse) = (factor.solve(&right), factor.inverse());
        let known = |i: usize| Known {
            value: x[i] / scale[i],
            sigma: inverse[(i, i)].sqrt() / scale[i],
        };
        (0..n).map(known).collect()
    }
}

/// Integrated autocorrelation: residuals that count as one independent sample (initial positive
/// sequence, Geyer 1992).
pub(crate) fn correlation(residuals: &[f64]) -> f64 {
    let step = residuals.len().div_ceil(MAX_LAG_SAMPLES).max(1);
    let r: Vec<f64> = residuals.iter().copied().step_by(step).collect();
    let at = |lag: usize| r.iter().zip(&r[lag..]).map(|(a, b)| a * b).sum::<f64>();
    let whole = at(0);
    if whole <= 0.0 {
        return 1.0;
    }
    let mut sum = 1.0;
    for pair in 0..r.len() / 4 {
        let two = at(2 * pair + 1) + at(2 * pair + 2);
        if two <= 0.0 {
            break;
        }
        sum += 2.0 * two / whole;
    }
    step as f64 * sum.max(1.0)
}

/// Ratio of the largest to the smallest singular value of the columns, scaled to unit length.
fn condition(gram: &DMatrix<f64>) -> f64 {
    let used: Vec<usize> = (0..gram.nrows()).filter(|&i| gram[(i, i)] > 0.0).collect();
    let scaled = DMatrix::from_fn(used.len(), used.len(), |a, b| {
        let (i, j) = (used[a], used[b]);
        gram[(i, j)] / (gram[(i, i)] * gram[(j, j)]).sqrt()
    });
    if used.is_empty() {
        return f64::INFINITY;
    }
    let values = scaled.symmetric_eigenvalues();
    (values.max() / values.min().max(1e-16)).sqrt()
}
