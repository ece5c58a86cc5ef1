//! Weighted least squares over blocks of rows; smoothing, prior's weight and friction terms by
//! cross-validation on blocks of the training part alone.
//!
//! Rows of a joint weigh `1 / sigma_j^2`, rows with large residuals less (Huber), and rows at rest
//! less by what static friction hides. All of this enters moments per block and joint, from which
//! every candidate is solved and judged without seeing the rows again.

use super::consistent::Prior;
use super::equations::{Grams, Normal, Solved, Weights, consistent_solution, with_rigid};
use super::friction::{ALWAYS, Friction, ROTOR, TERMS, Term};
use super::rows::Rows;
use nalgebra::DVector;

/// Folds of the inner cross-validation.
const FOLDS: usize = 4;
/// Weights of the prior that are tried.
const LAMBDAS: [f64; 10] = [1e-4, 1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e7];
/// A term must lower the mean square of its joint's residual by this share.
const LEAST_IMPROVEMENT: f64 = 0.01;
/// Rounds of added terms.
const ROUNDS: usize = 4;
/// Groups of blocks that are held out in turn.
fn folds(train: &[usize]) -> Vec<(Vec<usize>, Vec<usize>)> {
    let group = |k: usize| train[k * train.len() / FOLDS..(k + 1) * train.len() / FOLDS].to_vec();
    let all = (0..FOLDS).map(|k| {
        let out = group(k);
        (
            train.iter().copied().filter(|b| !out.contains(b)).collect(),
            out,
        )
    });
    all.collect()
}

/// A choice of terms and weight of the prior, and its error on inner held-out blocks.
#[derive(Debug, Clone)]
pub struct Choice {
    /// Unknowns that are estimated.
    pub keep: Vec<bool>,
    /// lambda: weight of the prior.
    pub lambda: f64,
    /// Mean square of residuals over sigma, on inner held-out blocks.
    pub error: f64,
}

impl Choice {
    /// Leaves out terms whose coefficient would be negative and cannot be, one by one.
    fn without_negative(&mut self, rows: &Rows, normal: &Normal, prior: &Prior) -> Option<()> {
        loop {
            let x = consistent_solution(
                normal,
                prior,
                self.lambda,
                &self.keep,
                &with_rigid(normal, &prior.parameters, &self.keep)?,
            )?;
            let places = rows.rigid..rows.unknowns();
            let negative =
                |p: &usize| x[*p] < 0.0 && TERMS[(p - rows.rigid) % TERMS.len()].is_positive();
            match places.into_iter().find(negative) {
                Some(place) => self.keep[place] = false,
                None => return Some(()),
            }
        }
    }
}

/// The equations of every inner fold: training and held-out.
struct Inner {
    folds: Vec<(Normal, Normal)>,
}

impl Inner {
    fn new(grams: &Grams, train: &[usize], sigma: &[f64]) -> Self {
        let pair =
            |(a, b): (Vec<usize>, Vec<usize>)| (grams.normal(&a, sigma), grams.normal(&b, sigma));
        Self {
            folds: folds(train).into_iter().map(pair).collect(),
        }
    }

    /// Error of each fold, as a sum of squares.
    fn errors(&self, prior: &Prior, lambda: f64, keep: &[bool]) -> Option<Vec<f64>> {
        let fold = |(train, out): &(Normal, Normal)| {
            Some(out.residual(&Solved::new(train, prior, lambda, keep)?.x))
        };
        self.folds.iter().map(fold).collect()
    }

    fn rows(&self) -> f64 {
        self.folds
            .iter()
            .map(|(_, out)| out.count)
            .sum::<f64>()
            .max(1.0)
    }

    /// The prior's weight with the smallest error; of nearly equal ones the largest.
    fn lambda(&self, prior: &Prior, keep: &[bool]) -> Option<(f64, f64)> {
        let error = |l: &f64| {
            Some((
                *l,
                self.errors(prior, *l, keep)?.iter().sum::<f64>() / self.rows(),
            ))
        };
        let all: Vec<(f64, f64)> = LAMBDAS.iter().filter_map(error).collect();
        let least = all.iter().map(|(_, e)| *e).fold(f64::INFINITY, f64::min);
        all.into_iter()
            .rev()
            .find(|(_, e)| *e <= least * (1.0 + 0.2 * LEAST_IMPROVEMENT))
    }
}

/// The unknowns that are always estimated.
#[must_use]
pub fn always(rows: &Rows, friction: &[Friction]) -> Vec<bool> {
    let mut keep = vec![false; rows.unknowns()];
    keep[..rows.rigid].fill(true);
    for (joint, friction) in friction.iter().enumerate() {
        for term in 0..if friction.moves { ALWAYS } else { 1 } {
            keep[rows.term(joint, term)] = true;
        }
        keep[rows.term(joint, ROTOR)] = friction.moves && friction.motor;
    }
    keep
}

/// Error of the terms that are always there, at the best weight of the prior.
#[must_use]
pub fn plain_error(
    grams: &Grams,
    train: &[usize],
    sigma: &[f64],
    prior: &Prior,
    keep: &[bool],
) -> f64 {
    let inner = Inner::new(grams, train, sigma);
    inner
        .lambda(prior, keep)
        .map_or(f64::INFINITY, |(_, error)| error)
}

/// Adds terms while inner held-out blocks show that they help, and chooses the prior's weight.
#[must_use]
pub fn choose(
    rows: &Rows,
    grams: &Grams,
    train: &[usize],
    sigma: &[f64],
    prior: &Prior,
    friction: &[Friction],
) -> Option<Choice> {
    let inner = Inner::new(grams, train, sigma);
    let mut keep = always(rows, friction);
    let (mut lambda, mut error) = inner.lambda(prior, &keep)?;
    for _ in 0..ROUNDS {
        let solved: Option<Vec<Solved>> = inner
            .folds
            .iter()
            .map(|(train, _)| Solved::new(train, prior, lambda, &keep))
            .collect();
        let solved = solved?;
        let before: Vec<f64> = solved
            .iter()
            .zip(&inner.folds)
            .map(|(s, (_, out))| out.residual(&s.x))
            .collect();
        let mut added = keep.clone();
        for (joint, _) in friction.iter().enumerate().filter(|(_, f)| f.moves) {
            if let Some(term) = best_term(
                rows, grams, train, &inner, &solved, &before, joint, &keep, sigma,
            ) {
                added[rows.term(joint, term)] = true;
            }
        }
        if added == keep {
            break;
        }
        let Some((weight, lower)) = inner.lambda(prior, &added).filter(|(_, e)| *e < error) else {
            break;
        };
        (keep, lambda, error) = (added, weight, lower);
    }
    Some(Choice {
        keep,
        lambda,
        error,
    })
}

/// The term of a joint that lowers the error most, if it is worth it.
#[expect(
    clippy::too_many_arguments,
    reason = "one step of `choose`, whose state it shares"
)]
fn best_term(
    rows: &Rows,
    grams: &Grams,
    train: &[usize],
    inner: &Inner,
    solved: &[Solved],
    before: &[f64],
    joint: usize,
    keep: &[bool],
    sigma: &[f64],
) -> Option<usize> {
    let held_out = folds(train).into_iter().zip(solved);
    let own = held_out
        .map(|((_, out), s)| grams.residual(joint, &out, &s.x))
        .sum::<f64>()
        * sigma[joint].powi(-2);
    let gain = |term: usize| {
        let place = rows.term(joint, term);
        let mut gains = Vec::new();
        for ((s, (train, out)), before) in solved.iter().zip(&inner.folds).zip(before) {
            let x = s.with(train, place, rows.rigid)?;
            if TERMS[term].is_positive() && x[place] <= 0.0 {
                return None;
            }
            gains.push(before - out.residual(&x));
        }
        let better = gains.iter().filter(|g| **g > 0.0).count();
        let sum: f64 = gains.iter().sum();
        (better + 1 >= FOLDS && sum > LEAST_IMPROVEMENT * own).then_some((term, sum))
    };
    let free = (ALWAYS..TERMS.len()).filter(|&term| !keep[rows.term(joint, term)]);
    free.filter_map(gain)
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(term, _)| term)
}

/// Result of a training part.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Which smoothing the training part chose.
    pub candidate: usize,
    /// Terms and weight of the prior.
    pub choice: Choice,
    /// Deviations and weights of the rows.
    pub weights: Weights,
    /// Solution whose bodies can exist.
    pub consistent: DVector<f64>,
    /// Solution by base parameters alone: no prior, no bodies' bounds.
    pub base: DVector<f64>,
    /// The URDF's parameters with friction fitted to the same rows.
    pub urdf: DVector<f64>,
    /// Standard deviation of the torque that a motion not seen leaves unexplained, per joint.
    pub sigma: Vec<f64>,
}

/// Weight of the prior where only base parameters shall count: it decides what torques do not.
const NO_PRIOR: f64 = 1e-7;

impl Fit {
    /// Fits to the `train` blocks of the candidates' rows, the middle one first.
    ///
    /// None where the equations have no finite solution.
    #[must_use]
    pub fn new(
        candidates: &mut [Rows],
        middle: usize,
        train: &[usize],
        prior: &Prior,
        friction: &[Friction],
    ) -> Option<Self> {
        let first = &candidates[middle];
        let keep = always(first, friction);
        let mut weights = Weights::even(first);
        let mut load = DVector::zeros(first.unknowns());
        for _ in 0..3 {
            let normal = Grams::new(first, &weights).normal(train, &weights.sigma);
            load = Solved::new(&normal, prior, 1e-2, &keep)?.x;
            weights = Weights::of(first, &load, train, &weights);
        }
        let mut best: Option<(usize, f64, Grams)> = None;
        for (index, rows) in candidates.iter_mut().enumerate() {
            rows.set_load(&load);
            let grams = Grams::new(rows, &weights);
            let error = plain_error(&grams, train, &weights.sigma, prior, &keep);
            if best.as_ref().is_none_or(|(_, least, _)| error < *least) {
                best = Some((index, error, grams));
            }
        }
        let (candidate, _, mut grams) = best?;
        let rows = &candidates[candidate];
        let mut choice = choose(rows, &grams, train, &weights.sigma, prior, friction)?;
        for _ in 0..2 {
            let solved = Solved::new(
                &grams.normal(train, &weights.sigma),
                prior,
                choice.lambda,
                &choice.keep,
            )?;
            weights = Weights::of(rows, &solved.x, train, &weights);
            grams = Grams::new(rows, &weights);
        }
        let inner = Inner::new(&grams, train, &weights.sigma);
        (choice.lambda, choice.error) = inner.lambda(prior, &choice.keep)?;
        choice.without_negative(rows, &grams.normal(train, &weights.sigma), prior)?;
        let normal = grams.normal(train, &weights.sigma);
        let base = Solved::new(&normal, prior, NO_PRIOR, &choice.keep)?.x;
        let urdf = with_rigid(&normal, &prior.parameters, &choice.keep)?;
        let consistent = consistent_solution(&normal, prior, choice.lambda, &choice.keep, &urdf)?;
        let sigma = inner_deviation(&grams_even(rows), &grams, train, &weights, prior, &choice)?;
        Some(Self {
            candidate,
            choice,
            weights,
            consistent,
            base,
            urdf,
            sigma,
        })
    }

    /// Terms of a joint that were chosen, with their coefficients in a solution.
    #[must_use]
    pub fn terms(&self, rows: &Rows, joint: usize, x: &DVector<f64>) -> Vec<(Term, f64)> {
        let all = TERMS.iter().enumerate();
        let kept = all.filter(|(k, _)| self.choice.keep[rows.term(joint, *k)]);
        kept.map(|(k, term)| (*term, x[rows.term(joint, k)]))
            .collect()
    }

    /// The solution by base parameters alone, of other blocks.
    #[must_use]
    pub fn base_of(&self, normal: &Normal, prior: &Prior) -> Option<DVector<f64>> {
        Some(Solved::new(normal, prior, NO_PRIOR, &self.choice.keep)?.x)
    }
}

fn grams_even(rows: &Rows) -> Grams {
    Grams::new(rows, &Weights::ones(rows))
}

/// RMS residual of each joint on inner held-out blocks, every row counted alike.
fn inner_deviation(
    even: &Grams,
    grams: &Grams,
    train: &[usize],
    weights: &Weights,
    prior: &Prior,
    choice: &Choice,
) -> Option<Vec<f64>> {
    let mut squares = vec![0.0; weights.sigma.len()];
    for (train, out) in folds(train) {
        let x = Solved::new(
            &grams.normal(&train, &weights.sigma),
            prior,
            choice.lambda,
            &choice.keep,
        )?
        .x;
        (0..squares.len()).for_each(|joint| squares[joint] += even.residual(joint, &out, &x));
    }
    let each = squares.iter().enumerate();
    Some(
        each.map(|(joint, s)| (s / even.count(joint, train).max(1.0)).sqrt())
            .collect(),
    )
}
