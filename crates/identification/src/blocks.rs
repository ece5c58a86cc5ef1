//! Least squares with priors over contiguous blocks of a log.
//!
//! In: rows, each in the block of its time, and a prior of every coefficient. Out: coefficients, their
//! covariance, and the error on blocks that were held out. Rows of a log are not independent: how much
//! they weigh against the priors is what predicts held-out blocks best, and the covariance comes from
//! leaving out the blocks one by one (jackknife; B. Efron, The Jackknife, the Bootstrap and Other
//! Resampling Plans, SIAM 1982), to which what the priors alone determine is added. Coefficients that
//! the data do not determine stay at their prior with its width.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Knowledge about one coefficient before any data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Most likely value.
    pub mean: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// Least value.
    pub least: f64,
}

impl Prior {
    /// A coefficient of either sign.
    #[must_use]
    pub fn new(mean: f64, sigma: f64) -> Self {
        Self {
            mean,
            sigma,
            least: f64::NEG_INFINITY,
        }
    }

    /// A coefficient not below a value.
    #[must_use]
    pub fn at_least(mean: f64, sigma: f64, least: f64) -> Self {
        Self { mean, sigma, least }
    }
}

/// Normal equations of each block.
#[derive(Debug, Clone)]
pub struct Blocks {
    blocks: Vec<Normal>,
    /// Rows that are alike, at least.
    alike: f64,
}

#[derive(Debug, Clone)]
struct Normal {
    gram: DMatrix<f64>,
    moment: DVector<f64>,
    square: f64,
    rows: f64,
}

/// Coefficients after the data.
#[derive(Debug, Clone)]
pub struct Posterior {
    /// Coefficients.
    pub x: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Root mean square of the residual.
    pub rms: f64,
    /// The same on blocks that were held out.
    pub held_out: f64,
}

/// Multiples of the rows that are alike, tried.
const ROWS_PER_ONE: [f64; 6] = [1.0, 5.0, 25.0, 125.0, 625.0, 3125.0];
/// Contiguous parts that are held out in turn.
const FOLDS: usize = 6;

impl Normal {
    fn new(columns: usize) -> Self {
        Self {
            gram: DMatrix::zeros(columns, columns),
            moment: DVector::zeros(columns),
            square: 0.0,
            rows: 0.0,
        }
    }

    fn add(&mut self, other: &Self, sign: f64) {
        self.gram += sign * &other.gram;
        self.moment += sign * &other.moment;
        self.square += sign * other.square;
        self.rows += sign * other.rows;
    }

    /// Sum of squares of the residual.
    fn rest(&self, x: &DVector<f64>) -> f64 {
        (self.square - 2.0 * x.dot(&self.moment) + x.dot(&(&self.gram * x))).max(0.0)
    }
}

impl Blocks {
    /// No rows yet; of every `alike` rows in a stretch at most one counts.
    #[must_use]
    pub fn new(columns: usize, blocks: usize, alike: f64) -> Self {
        Self {
            blocks: vec![Normal::new(columns); blocks.max(2)],
            alike: alike.max(1.0),
        }
    }

    /// Rows of three tenths of a second: errors of friction and gear change no faster (a real arm's logs, 2026-11).
    #[must_use]
    pub fn alike(sample_period: f64) -> f64 {
        0.3 / sample_period
    }

    /// Blocks for a log of this length, s: of two seconds or more, as errors of a gear last that long.
    #[must_use]
    pub fn count(seconds: f64) -> usize {
        ((seconds / 2.0) as usize).clamp(5, 24)
    }

    /// Takes one row `a x = b` at a place in the log, 0 to below 1.
    pub fn add(&mut self, place: f64, a: &[f64], b: f64) {
        let last = self.blocks.len() - 1;
        let index = ((place * self.blocks.len() as f64) as usize).min(last);
        let block = &mut self.blocks[index];
        for (j, aj) in a.iter().enumerate().filter(|(_, aj)| **aj != 0.0) {
            for (i, ai) in a.iter().enumerate().take(j + 1) {
                block.gram[(i, j)] += ai * aj;
            }
            block.moment[j] += aj * b;
        }
        block.square += b * b;
        block.rows += 1.0;
    }

    /// The coefficients with a given number of rows that count as one, the variance of a row found from
    /// the rest: for rows whose errors are known to last that long. None without rows.
    #[must_use]
    pub fn fit_at(&self, priors: &[Prior], rows_per_one: f64) -> Option<Posterior> {
        let mut blocks = self.blocks.clone();
        for block in &mut blocks {
            block.gram.fill_lower_triangle_with_upper_triangle();
        }
        let mut all = Normal::new(priors.len());
        blocks.iter().for_each(|block| all.add(block, 1.0));
        if all.rows < 1.0 {
            return None;
        }
        let floor = 1e-8 * all.square / all.rows + 1e-300;
        let mut weight = 1.0 / ((floor + 0.01 * all.square / all.rows) * rows_per_one);
        let mut x = solve(&all, priors, weight)?;
        for _ in 0..3 {
            weight = 1.0 / ((floor + all.rest(&x) / all.rows) * rows_per_one);
            x = solve(&all, priors, weight)?;
        }
        let covariance = covariance(&blocks, &all, priors, weight, &x)?;
        let rms = (all.rest(&x) / all.rows).sqrt();
        Some(Posterior {
            rms,
            held_out: rms,
            covariance,
            x,
        })
    }

    /// The coefficients; none without rows.
    #[must_use]
    pub fn fit(&self, priors: &[Prior]) -> Option<Posterior> {
        let mut blocks = self.blocks.clone();
        for block in &mut blocks {
            block.gram.fill_lower_triangle_with_upper_triangle();
        }
        let mut all = Normal::new(priors.len());
        blocks.iter().for_each(|block| all.add(block, 1.0));
        if all.rows < 1.0 {
            return None;
        }
        // A floor keeps data without any noise from outweighing every prior.
        let floor = 1e-8 * all.square / all.rows + 1e-300;
        let mut variance = floor + 0.01 * all.square / all.rows;
        let mut best = (f64::INFINITY, self.alike);
        for _ in 0..2 {
            let tried = ROWS_PER_ONE.map(|factor| {
                let kappa = factor * self.alike;
                let weight = 1.0 / (variance * kappa);
                (
                    held_out(&blocks, &all, priors, weight).unwrap_or(f64::INFINITY),
                    kappa,
                )
            });
            best = tried
                .into_iter()
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or(best);
            let x = solve(&all, priors, 1.0 / (variance * best.1))?;
            variance = floor + all.rest(&x) / all.rows;
        }
        let weight = 1.0 / (variance * best.1);
        let x = solve(&all, priors, weight)?;
        let covariance = covariance(&blocks, &all, priors, weight, &x)?;
        Some(Posterior {
            rms: (all.rest(&x) / all.rows).sqrt(),
            // Rows that all lie in one block cannot be held out.
            held_out: if best.0.is_finite() {
                best.0.sqrt()
            } else {
                (all.rest(&x) / all.rows).sqrt()
            },
            covariance,
            x,
        })
    }
}

/// Mean square error on the folds, each predicted by the others.
fn held_out(blocks: &[Normal], all: &Normal, priors: &[Prior], weight: f64) -> Option<f64> {
    let size = blocks.len().div_ceil(FOLDS);
    let (mut square, mut rows) = (0.0, 0.0);
    for fold in blocks.chunks(size) {
        let mut out = Normal::new(priors.len());
        fold.iter().for_each(|block| out.add(block, 1.0));
        let mut kept = all.clone();
        kept.add(&out, -1.0);
        if kept.rows < 1.0 || out.rows < 1.0 {
            continue;
        }
        square += out.rest(&solve(&kept, priors, weight)?);
        rows += out.rows;
    }
    (rows > 0.0).then(|| square / rows)
}

/// Matrix and factor of the normal equations in units of the priors' widths.
fn scaled(data: &Normal, priors: &[Prior], weight: f64) -> DMatrix<f64> {
    DMatrix::from_fn(priors.len(), priors.len(), |i, j| {
        let own = f64::from(u8::from(i == j));
        weight * priors[i].sigma * priors[j].sigma * data.gram[(i, j)] + own
    })
}

/// Most probable coefficients not below their least values: those that come out below are set there one by
/// one, the furthest (in units of its prior's width) first.
fn solve(data: &Normal, priors: &[Prior], weight: f64) -> Option<DVector<f64>> {
    let n = priors.len();
    let h = scaled(data, priors, weight);
    let means = DVector::from_fn(n, |i, _| priors[i].mean);
    let rest = &data.moment - &data.gram * &means;
    let right = DVector::from_fn(n, |i, _| weight * priors[i].sigma * rest[i]);
    let bound = |i: usize| (priors[i].least - priors[i].mean) / priors[i].sigma;
    let mut y = DVector::zeros(n);
    let mut fixed = vec![false; n];
    loop {
        let free: Vec<usize> = (0..n).filter(|&i| !fixed[i]).collect();
        let matrix = DMatrix::from_fn(free.len(), free.len(), |a, b| h[(free[a], free[b])]);
        let vector = DVector::from_fn(free.len(), |a, _| {
            let known = (0..n).filter(|&i| fixed[i]);
            right[free[a]] - known.map(|i| h[(free[a], i)] * y[i]).sum::<f64>()
        });
        let solution = Cholesky::new(matrix)?.solve(&vector);
        for (a, &i) in free.iter().enumerate() {
            y[i] = solution[a];
        }
        let worst = free
            .iter()
            .filter(|&&i| y[i] < bound(i) - 1e-12)
            .min_by(|&&a, &&b| (y[a] - bound(a)).total_cmp(&(y[b] - bound(b))));
        match worst {
            Some(&i) => {
                fixed[i] = true;
                y[i] = bound(i);
            }
            None => break,
        }
    }
    Some(DVector::from_fn(n, |i, _| {
        priors[i].mean + priors[i].sigma * y[i]
    }))
}

/// Spread of the coefficients as blocks are left out, and of what the priors determine.
fn covariance(
    blocks: &[Normal],
    all: &Normal,
    priors: &[Prior],
    weight: f64,
    x: &DVector<f64>,
) -> Option<DMatrix<f64>> {
    let n = priors.len();
    let inverse = Cholesky::new(scaled(all, priors, weight))?.inverse();
    let prior = &inverse * &inverse;
    let mut sum = DMatrix::from_fn(n, n, |i, j| {
        priors[i].sigma * prior[(i, j)] * priors[j].sigma
    });
    let used = blocks.iter().filter(|b| b.rows > 0.0).count() as f64;
    // Few blocks: Student's distribution, whose variance is (n - 1)/(n - 3), in place of the normal one.
    let few = (used - 1.0) / (used - 3.0).max(1.0);
    for block in blocks.iter().filter(|b| b.rows > 0.0) {
        let mut kept = all.clone();
        kept.add(block, -1.0);
        if kept.rows >= 1.0 {
            let moved = solve(&kept, priors, weight)? - x;
            sum += few * (used - 1.0) / used * &moved * moved.transpose();
        }
    }
    Some(sum)
}

/// A covariance as its principal directions, in units of each coefficient's own spread: the strongest, at
/// most `most`, and each at least a thousandth of the strongest.
#[must_use]
pub fn directions(covariance: &DMatrix<f64>, most: usize) -> Vec<Vec<f64>> {
    let n = covariance.nrows();
    let spread: Vec<f64> = (0..n).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
    let unit = |i: usize| if spread[i] > 0.0 { spread[i] } else { 1.0 };
    let relative = DMatrix::from_fn(n, n, |i, j| covariance[(i, j)] / (unit(i) * unit(j)));
    let eigen = relative.symmetric_eigen();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let strongest = order.first().map_or(0.0, |&i| eigen.eigenvalues[i]);
    order
        .into_iter()
        .take(most)
        .filter(|&k| eigen.eigenvalues[k] > 1e-3 * strongest)
        .map(|k| {
            let root = eigen.eigenvalues[k].sqrt();
            (0..n)
                .map(|i| spread[i] * root * eigen.eigenvectors[(i, k)])
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    /// y = 2 a + 0 b with errors that are constant over each of 40 stretches.
    fn blocks(seed: u64) -> Blocks {
        let mut random = Random::new(seed);
        let mut blocks = Blocks::new(2, 20, 1.0);
        for stretch in 0..40 {
            let (error, a) = (0.3 * random.normal(), random.normal());
            for k in 0..100 {
                let place = (f64::from(stretch) + f64::from(k) / 100.0) / 40.0;
                blocks.add(place, &[a, 0.0], 2.0 * a + error + 0.01 * random.normal());
            }
        }
        blocks
    }

    #[test]
    fn intervals_hold_though_rows_depend_on_one_another() {
        let priors = [Prior::new(0.0, 10.0), Prior::new(0.7, 0.2)];
        let mut covered = 0;
        for seed in 0..200 {
            let fit = blocks(seed).fit(&priors).unwrap();
            let sigma = fit.covariance[(0, 0)].sqrt();
            covered += u32::from((fit.x[0] - 2.0).abs() < 1.96 * sigma);
            // Parameters that no row shows stay at their prior.
            assert!((fit.x[1] - 0.7).abs() < 1e-9);
            assert!((fit.covariance[(1, 1)].sqrt() - 0.2).abs() < 1e-9);
        }
        assert!((180..=198).contains(&covered), "{covered} of 200");
    }

    #[test]
    fn coefficients_stay_above_their_bounds_and_directions_give_the_covariance_back() {
        let priors = [Prior::at_least(3.0, 1.0, 2.5), Prior::new(0.0, 1.0)];
        let fit = blocks(1).fit(&priors).unwrap();
        assert!((fit.x[0] - 2.5).abs() < 1e-9, "{}", fit.x);
        let list = directions(&fit.covariance, 2);
        for i in 0..2 {
            let sum: f64 = list.iter().map(|d| d[i] * d[i]).sum();
            assert!((sum / fit.covariance[(i, i)] - 1.0).abs() < 2e-3);
        }
    }
}
