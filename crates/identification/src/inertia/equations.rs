//! Weighted least squares: moments of rows per block and joint, from which any blocks' normal
//! equations are had without seeing the rows again, and their solutions.

use super::consistent::{self, Factor, Prior};
use super::friction::{COULOMB, TERMS, Term};
use super::rows::{BLOCKS, JointRows, Rows};
use dynamics::PARAMETERS;
use nalgebra::{DMatrix, DVector};

/// Huber's bound, in standard deviations.
const HUBER: f64 = 2.5;
/// Ridge of the friction terms that every joint has, as a share of their own column's square.
const RIDGE: f64 = 1e-9;
/// Ridge of the others: terms that resemble one another shall not cancel each other.
const RIDGE_OF_OTHERS: f64 = 1e-3;
/// Standard deviation that an offset has before, as a share of the joint's RMS torque: where a joint
/// moves little, its weight and an offset look alike.
const OFFSET_SHARE: f64 = 0.05;

/// Deviation of a mass about the URDF's, as a share of it: a factor of three, beyond which a result contradicts the
/// URDF, is three deviations (ln 3 / 3). The divergence alone allows a factor of e as one, and torques that hardly
/// separate a mass from its neighbours' would move it as far.
const MASS_DEVIATION: f64 = 0.366;

/// Moments of one joint's rows in one block.
#[derive(Debug, Clone)]
struct Moments {
    gram: DMatrix<f64>,
    moment: DVector<f64>,
    square: f64,
    count: f64,
}

/// Moments of all blocks and joints.
#[derive(Debug, Clone)]
pub struct Grams {
    place: Vec<Vec<usize>>,
    unknowns: usize,
    /// `[block][joint]`.
    blocks: Vec<Vec<Moments>>,
}

/// Normal equations of some blocks.
#[derive(Debug, Clone)]
pub struct Normal {
    /// A: all unknowns.
    pub a: DMatrix<f64>,
    /// m.
    pub m: DVector<f64>,
    square: f64,
    /// Weighted rows.
    pub count: f64,
    /// Prior weight of each joint's offset.
    offset_weight: Vec<f64>,
}

/// Weights of rows and joints.
#[derive(Debug, Clone)]
pub struct Weights {
    /// sigma_j: standard deviation of a row's residual, N·m.
    pub sigma: Vec<f64>,
    /// `[joint][sample]`.
    rows: Vec<Vec<f64>>,
}

impl Grams {
    /// Moments of rows so weighted.
    #[must_use]
    pub fn new(rows: &Rows, weights: &Weights) -> Self {
        let empty = |joint: &JointRows| {
            let n = joint.place.len();
            Moments {
                gram: DMatrix::zeros(n, n),
                moment: DVector::zeros(n),
                square: 0.0,
                count: 0.0,
            }
        };
        let block = || rows.of.iter().map(empty).collect::<Vec<_>>();
        let mut blocks: Vec<Vec<Moments>> = (0..BLOCKS).map(|_| block()).collect();
        for (joint, own) in rows.of.iter().enumerate() {
            let n = own.place.len();
            for (sample, &block) in rows.block.iter().enumerate() {
                let w = weights.rows[joint][sample];
                let (row, tau) = (own.row(sample), own.tau[sample]);
                let sums = &mut blocks[block][joint];
                let gram = sums.gram.as_mut_slice();
                for (j, &x) in row.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                    let column = &mut gram[n * j..n * j + j + 1];
                    column
                        .iter_mut()
                        .zip(row)
                        .for_each(|(sum, y)| *sum += w * x * y);
                    sums.moment[j] += w * x * tau;
                }
                sums.square += w * tau * tau;
                sums.count += w;
            }
        }
        for sums in blocks.iter_mut().flatten() {
            sums.gram.fill_lower_triangle_with_upper_triangle();
        }
        let place = rows.of.iter().map(|own| own.place.clone()).collect();
        Self {
            place,
            unknowns: rows.unknowns(),
            blocks,
        }
    }

    /// These moments, with those of one joint from others.
    #[must_use]
    pub fn with_joint(&self, joint: usize, other: &Self) -> Self {
        let mut out = self.clone();
        for (own, theirs) in out.blocks.iter_mut().zip(&other.blocks) {
            own[joint].clone_from(&theirs[joint]);
        }
        out
    }

    /// Normal equations of blocks, joints weighted by their sigma.
    #[must_use]
    pub fn normal(&self, blocks: &[usize], sigma: &[f64]) -> Normal {
        let n = self.unknowns;
        let (mut a, mut m, mut square) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
        let (mut count, mut offset_weight) = (0.0, Vec::new());
        for (joint, place) in self.place.iter().enumerate() {
            let w = sigma[joint].powi(-2);
            let of = |part: fn(&Moments) -> f64| -> f64 {
                blocks.iter().map(|b| part(&self.blocks[*b][joint])).sum()
            };
            let mean_square = of(|m| m.square) / of(|m| m.count).max(1.0);
            offset_weight.push((OFFSET_SHARE.powi(2) * mean_square).max(1e-18).recip());
            for sums in blocks.iter().map(|b| &self.blocks[*b][joint]) {
                for (j, &to) in place.iter().enumerate() {
                    for (i, &from) in place.iter().enumerate() {
                        a[(from, to)] += w * sums.gram[(i, j)];
                    }
                    m[to] += w * sums.moment[j];
                }
                square += w * sums.square;
                count += sums.count;
            }
        }
        Normal {
            a,
            m,
            square,
            count,
            offset_weight,
        }
    }

    /// Sum of squares of a joint's weighted residuals in blocks.
    #[must_use]
    pub fn residual(&self, joint: usize, blocks: &[usize], x: &DVector<f64>) -> f64 {
        let own = DVector::from_iterator(
            self.place[joint].len(),
            self.place[joint].iter().map(|p| x[*p]),
        );
        let of = |b: &usize| {
            let sums = &self.blocks[*b][joint];
            ((&sums.gram * &own).dot(&own) - 2.0 * sums.moment.dot(&own) + sums.square).max(0.0)
        };
        blocks.iter().map(of).sum()
    }

    /// Weighted rows of a joint in blocks.
    #[must_use]
    pub fn count(&self, joint: usize, blocks: &[usize]) -> f64 {
        blocks.iter().map(|b| self.blocks[*b][joint].count).sum()
    }
}

impl Normal {
    /// Prior weight of a friction's coefficient.
    fn ridge(&self, place: usize, rigid: usize) -> f64 {
        let (joint, term) = ((place - rigid) / TERMS.len(), (place - rigid) % TERMS.len());
        let share = match TERMS[term] {
            Term::Offset => return self.offset_weight[joint],
            Term::Coulomb | Term::Viscous | Term::Rotor => RIDGE,
            _ => RIDGE_OF_OTHERS,
        };
        share * self.a[(place, place)] + 1e-12
    }

    /// Sum of squares of all residuals, each over its sigma.
    #[must_use]
    pub fn residual(&self, x: &DVector<f64>) -> f64 {
        ((&self.a * x).dot(x) - 2.0 * self.m.dot(x) + self.square).max(0.0)
    }
}

/// Weight of a body's mass about the URDF's, beside the divergence, kg^-2; none where the URDF has no mass.
fn mass_weight(prior: &Prior, body: usize) -> f64 {
    if !prior.weighed[body] {
        return 0.0;
    }
    (MASS_DEVIATION * prior.parameters[PARAMETERS * body]).powi(-2)
}

/// A solution of normal equations for the unknowns kept, with the prior at a weight.
#[derive(Debug, Clone)]
pub struct Solved {
    /// x: all unknowns, those not kept zero.
    pub x: DVector<f64>,
    kept: Vec<usize>,
    factor: Factor,
}

impl Solved {
    /// Solves `(A + lambda H) x = m + lambda H phi0`, H the divergence's curvature and the masses' own weight. None
    /// where that is not finite.
    #[must_use]
    pub fn new(normal: &Normal, prior: &Prior, lambda: f64, keep: &[bool]) -> Option<Self> {
        let kept: Vec<usize> = (0..keep.len()).filter(|&i| keep[i]).collect();
        let rigid = prior.parameters.len();
        let (mut a, mut m) = (
            normal.a.select_rows(&kept).select_columns(&kept),
            normal.m.select_rows(&kept),
        );
        for (i, &place) in kept.iter().enumerate() {
            if place >= rigid {
                a[(i, i)] += normal.ridge(place, rigid);
                continue;
            }
            let (body, k) = (place / PARAMETERS, place % PARAMETERS);
            for (j, &other) in kept.iter().enumerate() {
                if other / PARAMETERS == body && other < rigid {
                    let h = lambda * prior.curvature[body][(k, other % PARAMETERS)];
                    a[(i, j)] += h;
                    m[i] += h * prior.parameters[other];
                }
            }
            if k == 0 {
                let (weight, mass) = (lambda * mass_weight(prior, body), prior.parameters[place]);
                a[(i, i)] += weight;
                m[i] += weight * mass;
            }
        }
        let factor = Factor::new(&a)?;
        let y = factor.solve(&m);
        let mut x = DVector::zeros(keep.len());
        kept.iter()
            .zip(&y)
            .for_each(|(&place, value)| x[place] = *value);
        x.iter()
            .all(|v| v.is_finite())
            .then_some(Self { x, kept, factor })
    }

    /// The solution with one more unknown (block elimination).
    #[must_use]
    pub fn with(&self, normal: &Normal, place: usize, rigid: usize) -> Option<DVector<f64>> {
        let column = normal.a.column(place);
        let b = DVector::from_iterator(self.kept.len(), self.kept.iter().map(|p| column[*p]));
        let z = self.factor.solve(&b);
        let own = column[place] + normal.ridge(place, rigid);
        let pivot = own - b.dot(&z);
        if pivot <= 1e-9 * own {
            return None;
        }
        let at = |x: &DVector<f64>| {
            self.kept
                .iter()
                .zip(&b)
                .map(|(p, b)| x[*p] * b)
                .sum::<f64>()
        };
        let gamma = (normal.m[place] - at(&self.x)) / pivot;
        let mut x = self.x.clone();
        self.kept
            .iter()
            .zip(&z)
            .for_each(|(p, z)| x[*p] -= gamma * z);
        x[place] = gamma;
        Some(x)
    }

    /// Parameters of some places that differ in `late` blocks, and by how much that lowers the squares. None where the
    /// blocks do not separate them.
    #[must_use]
    pub fn change(&self, late: &Normal, places: &[usize]) -> Option<(DVector<f64>, f64)> {
        let cross = late.a.select_rows(&self.kept).select_columns(places);
        let own = late.a.select_rows(places).select_columns(places);
        let mut through = cross.clone();
        for k in 0..places.len() {
            let solved = self.factor.solve(&cross.column(k).into_owned());
            through.set_column(k, &solved);
        }
        let rest = &own - cross.tr_mul(&through);
        let known = self.x.select_rows(&self.kept);
        let gradient = late.m.select_rows(places) - cross.tr_mul(&known);
        let change = Factor::new(&rest)?.solve(&gradient);
        let gain = gradient.dot(&change);
        gain.is_finite().then_some((change, gain))
    }
}

impl Weights {
    /// Every row and joint alike.
    #[must_use]
    pub fn ones(rows: &Rows) -> Self {
        Self {
            sigma: vec![1.0; rows.joints],
            rows: rows.of.iter().map(|own| vec![1.0; own.tau.len()]).collect(),
        }
    }

    /// Every row alike; sigma is the torque's own deviation.
    #[must_use]
    pub fn even(rows: &Rows) -> Self {
        let deviation = |own: &JointRows| {
            let n = own.tau.len().max(1) as f64;
            let mean = own.tau.iter().sum::<f64>() / n;
            (own.tau.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n)
                .sqrt()
                .max(1e-9)
        };
        Self {
            sigma: rows.of.iter().map(deviation).collect(),
            rows: rows.of.iter().map(|own| vec![1.0; own.tau.len()]).collect(),
        }
    }

    /// Weights by the residuals of a solution; sigma by those in the `train` blocks.
    #[must_use]
    pub fn of(rows: &Rows, x: &DVector<f64>, train: &[usize], before: &Self) -> Self {
        let mut weights = before.clone();
        for (joint, own) in rows.of.iter().enumerate() {
            let n = own.place.len() - TERMS.len();
            let coulomb = x[rows.term(joint, COULOMB)];
            let residuals: Vec<f64> = (0..own.tau.len())
                .map(|k| own.tau[k] - own.torque(k, x))
                .collect();
            let mut inside: Vec<f64> = residuals
                .iter()
                .zip(&rows.block)
                .filter(|(_, b)| train.contains(b))
                .map(|(r, _)| r.abs())
                .collect();
            inside.sort_by(f64::total_cmp);
            // Median absolute deviation of a normal variable.
            let robust = 1.4826 * inside.get(inside.len() / 2).copied().unwrap_or(0.0);
            let bound = HUBER * robust.max(1e-9);
            for (k, r) in residuals.iter().enumerate() {
                let sign = own.row(k)[n + COULOMB];
                let hidden = coulomb * coulomb / 3.0 * (1.0 - sign * sign).max(0.0);
                let rest = if coulomb == 0.0 {
                    1.0
                } else {
                    robust.powi(2) / (robust.powi(2) + hidden)
                };
                weights.rows[joint][k] = rest.max(1e-3) * (bound / r.abs().max(bound));
            }
            let (mut square, mut sum) = (0.0, 0.0);
            for (k, r) in residuals
                .iter()
                .enumerate()
                .filter(|(k, _)| train.contains(&rows.block[*k]))
            {
                let w = weights.rows[joint][k];
                (square, sum) = (square + w * r * r, sum + w);
            }
            weights.sigma[joint] = (square / f64::max(sum, 1.0))
                .sqrt()
                .max(1e-4 * before.sigma[joint])
                .max(1e-9);
        }
        weights
    }
}

/// Friction fitted under given rigid parameters.
#[must_use]
pub fn with_rigid(normal: &Normal, rigid: &DVector<f64>, keep: &[bool]) -> Option<DVector<f64>> {
    let n = rigid.len();
    let mut x = DVector::zeros(keep.len());
    x.rows_mut(0, n).copy_from(rigid);
    let kept: Vec<usize> = (n..keep.len()).filter(|&i| keep[i]).collect();
    let mut a = normal.a.select_rows(&kept).select_columns(&kept);
    (0..kept.len()).for_each(|i| a[(i, i)] += normal.ridge(kept[i], n));
    let m = (&normal.m - &normal.a * &x).select_rows(&kept);
    let y = Factor::new(&a)?.solve(&m);
    kept.iter()
        .zip(&y)
        .for_each(|(&place, value)| x[place] = *value);
    Some(x)
}

/// The solution whose bodies can exist, from friction fitted to the prior's.
#[must_use]
pub fn consistent_solution(
    normal: &Normal,
    prior: &Prior,
    lambda: f64,
    keep: &[bool],
    start: &DVector<f64>,
) -> Option<DVector<f64>> {
    let kept: Vec<usize> = (0..keep.len()).filter(|&i| keep[i]).collect();
    let rigid = prior.parameters.len();
    let mut a = normal.a.select_rows(&kept).select_columns(&kept);
    (rigid..kept.len()).for_each(|i| a[(i, i)] += normal.ridge(kept[i], rigid));
    let mut moment = normal.m.select_rows(&kept);
    for body in 0..rigid / PARAMETERS {
        let (weight, at) = (lambda * mass_weight(prior, body), PARAMETERS * body);
        a[(at, at)] += weight;
        moment[at] += weight * prior.parameters[at];
    }
    let y = consistent::fit(&a, &moment, prior, lambda, start.select_rows(&kept))?;
    let mut x = DVector::zeros(keep.len());
    kept.iter()
        .zip(&y)
        .for_each(|(&place, value)| x[place] = *value);
    Some(x)
}
