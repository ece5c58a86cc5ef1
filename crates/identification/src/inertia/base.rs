//! Base parameters: the combinations of inertial parameters that joint torques depend on (Gautier
//! 1991), what they are made of, and how well the logs determine them.

use super::consistent::Prior;
use super::equations::{Grams, Normal};
use super::robot::Robot;
use dynamics::{Data, PARAMETERS, Random, joint_torque_regressor};
use nalgebra::{DMatrix, DVector};

/// Random states from which dependence is found.
const STATES: usize = 60;
/// A column that others explain up to this share of its length depends on them.
const DEPENDENT: f64 = 1e-7;
/// A base parameter is determined where its interval is narrower than this share of the prior's.
const DETERMINED: f64 = 0.3;

/// The structure of a robot's base parameters.
#[derive(Debug, Clone)]
pub struct Base {
    /// Parameters that each begin a base parameter.
    pub independent: Vec<usize>,
    /// Parameters that only add to those.
    pub dependent: Vec<usize>,
    /// Parameters that no torque depends on.
    pub without_effect: Vec<usize>,
    /// Share of each dependent parameter in each base parameter: base = independent + K dependent.
    pub shares: DMatrix<f64>,
}

/// A base parameter as the logs determine it.
#[derive(Debug, Clone)]
pub struct BaseParameter {
    /// Its combination of link parameters: place and factor, its own first.
    pub parts: Vec<(usize, f64)>,
    /// The URDF's value.
    pub urdf: f64,
    /// The identified value.
    pub value: f64,
    /// Half of its 95 % interval by the jackknife over blocks.
    pub half_interval: f64,
    /// False where the logs hardly say more than the URDF.
    pub determined: bool,
}

impl Base {
    /// From regressors at random states: columns from the base of the robot outwards, each kept
    /// unless those kept before explain it (Gram and Schmidt, twice).
    #[must_use]
    pub fn new(robot: &Robot<'_>) -> Self {
        let w = random_regressor(robot);
        let columns = w.ncols();
        let lengths: Vec<f64> = w.column_iter().map(|c| c.norm()).collect();
        let most = lengths.iter().copied().fold(0.0, f64::max);
        let mut frame: Vec<DVector<f64>> = Vec::new();
        let (mut independent, mut dependent, mut without_effect) =
            (Vec::new(), Vec::new(), Vec::new());
        for k in order(columns) {
            if lengths[k] <= 1e-10 * most {
                without_effect.push(k);
                continue;
            }
            let mut rest = w.column(k) / lengths[k];
            for _ in 0..2 {
                for unit in &frame {
                    let part = unit.dot(&rest);
                    rest.axpy(-part, unit, 1.0);
                }
            }
            let norm = rest.norm();
            if norm > DEPENDENT {
                independent.push(k);
                frame.push(rest / norm);
            } else {
                dependent.push(k);
            }
        }
        let own = w.select_columns(&independent);
        let scale: Vec<f64> = independent.iter().map(|k| lengths[*k]).collect();
        let scaled = DMatrix::from_fn(own.nrows(), own.ncols(), |i, j| own[(i, j)] / scale[j]);
        let mut shares = DMatrix::zeros(independent.len(), dependent.len());
        if !dependent.is_empty() {
            let qr = scaled.qr();
            let right = qr.q().tr_mul(&w.select_columns(&dependent));
            if let Some(solved) = qr.r().solve_upper_triangular(&right) {
                shares = DMatrix::from_fn(solved.nrows(), solved.ncols(), |i, j| {
                    let share = solved[(i, j)] / scale[i];
                    if (solved[(i, j)] / lengths[dependent[j]]).abs() < 1e-7 {
                        0.0
                    } else {
                        share
                    }
                });
            }
        }
        Self {
            independent,
            dependent,
            without_effect,
            shares,
        }
    }

    /// Values of the base parameters of a solution.
    #[must_use]
    pub fn values(&self, x: &DVector<f64>) -> DVector<f64> {
        x.select_rows(&self.independent) + &self.shares * x.select_rows(&self.dependent)
    }

    /// Standard deviations of the base parameters by the prior alone, at weight 1.
    fn prior_deviations(&self, prior: &Prior) -> Vec<f64> {
        let inverse: Vec<_> = prior
            .curvature
            .iter()
            .map(|h| h.try_inverse().unwrap_or_default())
            .collect();
        let covariance = |a: usize, b: usize| {
            if a / PARAMETERS == b / PARAMETERS {
                inverse[a / PARAMETERS][(a % PARAMETERS, b % PARAMETERS)]
            } else {
                0.0
            }
        };
        let deviation = |row: usize| {
            let parts = self.parts(row);
            let all = parts.iter().flat_map(|a| parts.iter().map(move |b| (a, b)));
            all.map(|(a, b)| a.1 * b.1 * covariance(a.0, b.0))
                .sum::<f64>()
                .max(0.0)
                .sqrt()
        };
        (0..self.independent.len()).map(deviation).collect()
    }

    fn parts(&self, row: usize) -> Vec<(usize, f64)> {
        let own = std::iter::once((self.independent[row], 1.0));
        let others = self
            .dependent
            .iter()
            .enumerate()
            .map(|(j, k)| (*k, self.shares[(row, j)]));
        own.chain(others.filter(|(_, share)| *share != 0.0))
            .collect()
    }

    /// Every base parameter with its interval. `solutions`: of all blocks, then without one block
    /// each.
    #[must_use]
    pub fn parameters(&self, prior: &Prior, solutions: &[DVector<f64>]) -> Vec<BaseParameter> {
        let values: Vec<DVector<f64>> = solutions.iter().map(|x| self.values(x)).collect();
        let urdf = self.values(&prior.parameters);
        let deviations = self.prior_deviations(prior);
        let (whole, without) = (&values[0], &values[1..]);
        let n = without.len().max(2) as f64;
        let one = |row: usize| {
            let mean = without.iter().map(|v| v[row]).sum::<f64>() / n;
            let square = without.iter().map(|v| (v[row] - mean).powi(2)).sum::<f64>();
            let half_interval = 2.13 * ((n - 1.0) / n * square).sqrt();
            BaseParameter {
                parts: self.parts(row),
                urdf: urdf[row],
                value: whole[row],
                half_interval,
                determined: half_interval < 2.0 * DETERMINED * deviations[row],
            }
        };
        (0..self.independent.len()).map(one).collect()
    }

    /// Ratio of the largest to the smallest singular value of the base regressor, columns scaled
    /// to unit length and friction taken out.
    #[must_use]
    pub fn condition(&self, normal: &Normal, keep: &[bool]) -> f64 {
        let rigid = self.independent.len() + self.dependent.len() + self.without_effect.len();
        let friction: Vec<usize> = (rigid..keep.len()).filter(|&i| keep[i]).collect();
        let mut gram = normal
            .a
            .select_rows(&self.independent)
            .select_columns(&self.independent);
        let cross = normal
            .a
            .select_rows(&friction)
            .select_columns(&self.independent);
        let mut own = normal.a.select_rows(&friction).select_columns(&friction);
        (0..friction.len()).for_each(|i| own[(i, i)] = own[(i, i)] * (1.0 + 1e-9) + 1e-12);
        if let Some(factor) = own.cholesky() {
            gram -= cross.tr_mul(&factor.solve(&cross));
        }
        let scale = gram.diagonal().map(|d| d.max(1e-300).sqrt());
        let scaled = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| {
            gram[(i, j)] / (scale[i] * scale[j])
        });
        let values = scaled.symmetric_eigenvalues();
        (values.max() / values.min().max(1e-16)).sqrt()
    }
}

/// The order in which columns are kept: bodies outwards, in each what is felt first.
fn order(columns: usize) -> impl Iterator<Item = usize> {
    const WITHIN: [usize; PARAMETERS] = [4, 5, 7, 8, 9, 6, 1, 2, 3, 0];
    (0..columns / PARAMETERS).flat_map(|body| WITHIN.map(|k| PARAMETERS * body + k))
}

fn random_regressor(robot: &Robot<'_>) -> DMatrix<f64> {
    let n = robot.model.joint_count();
    let columns = PARAMETERS * robot.bodies;
    let states = STATES.max(3 * columns / robot.measured.len().max(1));
    let mut random = Random::new(7);
    let (mut data, mut one) = (Data::new(robot.model), DMatrix::zeros(n, columns));
    let mut all = DMatrix::zeros(states * robot.measured.len(), columns);
    for state in 0..states {
        let (mut q, mut dq, mut ddq) = (robot.rest.clone(), vec![0.0; n], vec![0.0; n]);
        for &joint in &robot.measured {
            q[joint] = random.uniform(-3.0, 3.0);
            dq[joint] = random.uniform(-2.0, 2.0);
            ddq[joint] = random.uniform(-5.0, 5.0);
        }
        joint_torque_regressor(robot.model, &mut data, &q, &dq, &ddq, &mut one);
        for (k, &joint) in robot.measured.iter().enumerate() {
            all.row_mut(state * robot.measured.len() + k)
                .copy_from(&one.row(joint));
        }
    }
    all
}

/// A parameter in words: `mass of forearm`.
#[must_use]
pub fn words(robot: &Robot<'_>, place: usize) -> String {
    const NAMES: [&str; PARAMETERS] = [
        "mass",
        "mass times centre x",
        "mass times centre y",
        "mass times centre z",
        "inertia xx",
        "inertia xy",
        "inertia yy",
        "inertia xz",
        "inertia yz",
        "inertia zz",
    ];
    format!(
        "{} of {}",
        NAMES[place % PARAMETERS],
        robot.link(place / PARAMETERS)
    )
}

/// Unit of a parameter.
#[must_use]
pub fn unit(place: usize) -> &'static str {
    match place % PARAMETERS {
        0 => "kg",
        1..=3 => "kg·m",
        _ => "kg·m²",
    }
}

/// Moments of all blocks, and of all but one each.
#[must_use]
pub fn parts_of(grams: &Grams, blocks: usize, sigma: &[f64]) -> Vec<Normal> {
    let all: Vec<usize> = (0..blocks).collect();
    let without = |out: usize| {
        all.iter()
            .copied()
            .filter(|b| *b != out)
            .collect::<Vec<_>>()
    };
    let mut normals = vec![grams.normal(&all, sigma)];
    normals.extend((0..blocks).map(|out| grams.normal(&without(out), sigma)));
    normals
}
