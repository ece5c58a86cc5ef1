//! Solving for a load: in rounds about the last solution, what is not determined at its prior, and judged
//! on parts that were held out.

use super::motion::{inertia, parameters};
use super::{ANGLES, BODY, Knowledge, Load, Sample};
use crate::blocks::{Blocks, Posterior, Prior};
use crate::drive::Value;
use dynamics::Inertia;
use nalgebra::{DMatrix, Matrix3, Vector3};
use problem::Problem;

/// Names of the inertial parameters in messages.
const NAMES: [&str; BODY] = [
    "mass",
    "centre of mass x",
    "centre of mass y",
    "centre of mass z",
    "inertia xx",
    "inertia xy",
    "inertia yy",
    "inertia xz",
    "inertia yz",
    "inertia zz",
];
/// A number is determined if its standard deviation is below this share of its prior's.
const DETERMINED: f64 = 0.5;
/// Factor on the width of the prior of what is determined: it shall not pull.
const RELAXED: f64 = 10.0;
/// Width of the prior of what is not, as a share.
const FIXED: f64 = 1e-6;
/// Rounds of solving about the last solution.
const ROUNDS: usize = 4;
/// A sample this many deviations of its channel off is of another load.
const FAR: f64 = 6.0;
/// Share of such samples from which the log is refused.
const MOST_FAR: f64 = 0.3;
/// Parts that are held out in turn.
const PARTS: usize = 4;
/// Standard deviation of a normal variable over the median of its absolute value.
const MEDIAN_TO_SIGMA: f64 = 1.4826;
/// The unknowns' places.
#[derive(Clone, Copy)]
struct Layout {
    channels: usize,
    sensor: bool,
}

impl Layout {
    fn count(self) -> usize {
        BODY + self.channels + if self.sensor { ANGLES } else { 0 }
    }

    fn offset(self, channel: usize) -> usize {
        BODY + channel
    }

    fn angle(self, axis: usize) -> usize {
        BODY + self.channels + axis
    }
}

/// A solution: changes of the inertial parameters, offsets, angles.
#[derive(Clone)]
struct Solution {
    x: Vec<f64>,
    posterior: Option<Posterior>,
    far: Vec<bool>,
}

/// A fit of one link's inertia.
pub(super) struct Fit<'a> {
    known: &'a Knowledge,
    samples: &'a [Sample],
    layout: Layout,
    /// Standard deviations before, by unknown.
    widths: Vec<f64>,
    seconds: f64,
}

fn widths(known: &Knowledge, layout: Layout) -> Vec<f64> {
    let mass = known.inertia.mass + known.mass_sigma;
    let moment = mass * known.centre_sigma;
    let second = mass * known.centre_sigma.powi(2) + 0.2 * known.inertia.central().trace().abs();
    let mut all = vec![known.mass_sigma];
    all.extend([moment; 3]);
    all.extend([second; 6]);
    all.extend(known.channels.iter().map(|c| c.offset_sigma));
    if layout.sensor {
        all.extend([known.angle_sigma; ANGLES]);
    }
    all
}

impl<'a> Fit<'a> {
    /// A fit to samples of a log, in their order, over so many seconds.
    pub(super) fn new(known: &'a Knowledge, samples: &'a [Sample], seconds: f64) -> Self {
        let layout = Layout {
            channels: known.channels.len(),
            sensor: known.sensor,
        };
        Self {
            known,
            samples,
            layout,
            widths: widths(known, layout),
            seconds,
        }
    }

    /// The load that the samples show.
    pub(super) fn run(&self) -> Result<Load, Problem> {
        let n = self.layout.count();
        let all: Vec<usize> = (0..self.samples.len()).collect();
        let none = || Problem::new("the equations have no solution", "a longer recording");
        let mut fixed = vec![false; n];
        loop {
            let solution = self.solve(&fixed, 1.0, &all).ok_or_else(none)?;
            let covariance = &solution.posterior.as_ref().ok_or_else(none)?.covariance;
            let share = |i: usize| covariance[(i, i)].max(0.0).sqrt() / self.widths[i];
            // Second moments first: a motion that shows them shows everything else.
            let open = (0..n).filter(|&i| !fixed[i] && share(i) > DETERMINED);
            let open: Vec<usize> = open.collect();
            let second = (open.iter().copied()).filter(|i| (4..BODY).contains(i));
            let worst = second
                .max_by(|a, b| share(*a).total_cmp(&share(*b)))
                .or_else(|| {
                    let all = open.iter().copied();
                    all.max_by(|a, b| share(*a).total_cmp(&share(*b)))
                });
            match worst {
                Some(worst) => fixed[worst] = true,
                None => break,
            }
        }
        let mut solution = self.solve(&fixed, RELAXED, &all).ok_or_else(none)?;
        let second = 4..BODY;
        if second.clone().any(|i| !fixed[i]) && !possible(&self.inertia(&solution.x)) {
            // Parameters that no body can have are not determined.
            second.for_each(|i| fixed[i] = true);
            solution = self.solve(&fixed, RELAXED, &all).ok_or_else(none)?;
        }
        let far = solution.far.iter().filter(|far| **far).count() as f64;
        let left_out = far / self.samples.len() as f64;
        if left_out > MOST_FAR {
            let reason = format!(
                "{:.0} % of the samples do not follow from one load and one offset",
                100.0 * left_out
            );
            let allowed =
                "a robot that nothing touches but what its contact set says, with one load";
            return Err(Problem::new(reason, allowed));
        }
        self.load(&solution, &fixed).ok_or_else(none)
    }

    /// The link's inertia with changes.
    fn inertia(&self, x: &[f64]) -> Inertia {
        let mut body = parameters(&self.known.inertia);
        body.iter_mut().zip(x).for_each(|(b, x)| *b += x);
        inertia(&body)
    }

    /// Solves on some samples, in rounds.
    fn solve(&self, fixed: &[bool], relaxed: f64, used: &[usize]) -> Option<Solution> {
        let (n, channels) = (self.layout.count(), self.layout.channels);
        let mut sigma: Vec<f64> = self.known.channels.iter().map(|c| c.sigma).collect();
        let mut solution = Solution {
            x: vec![0.0; n],
            posterior: None,
            far: vec![false; self.samples.len()],
        };
        for round in 0..ROUNDS {
            let blocks = self.blocks(&solution, &sigma, used, |s, c| s.measured[c]);
            let posterior = blocks.fit(&self.priors(&solution.x, fixed, relaxed))?;
            solution.x = posterior.x.iter().copied().collect();
            solution.posterior = Some(posterior);
            if round + 2 > ROUNDS {
                break;
            }
            let rests: Vec<Vec<f64>> = (0..channels)
                .map(|c| used.iter().map(|&i| self.rest(&solution.x, i, c)).collect())
                .collect();
            for (sigma, rests) in sigma.iter_mut().zip(&rests) {
                *sigma = spread(rests).max(1e-9);
            }
            for (k, &i) in used.iter().enumerate() {
                let far = (0..channels).any(|c| rests[c][k].abs() > FAR * sigma[c]);
                solution.far[i] = far;
            }
        }
        Some(solution)
    }

    /// Priors about the present solution: the centre of mass and the inertia about it stay where only the
    /// mass or the centre changes.
    fn priors(&self, x: &[f64], fixed: &[bool], relaxed: f64) -> Vec<Prior> {
        let known = &self.known.inertia;
        let now = self.inertia(x);
        let moment = known.center() * (now.mass - known.mass);
        let of_now = Inertia::from_central(now.mass, now.center(), known.central());
        let mut means = parameters(&of_now);
        let before = parameters(known);
        means.iter_mut().zip(before).for_each(|(m, b)| *m -= b);
        means[0] = 0.0;
        means[1..4].copy_from_slice(moment.as_slice());
        let mean = |i: usize| means.get(i).copied().unwrap_or(0.0);
        let width = |i: usize| self.widths[i] * if fixed[i] { FIXED } else { relaxed };
        (0..x.len())
            .map(|i| match i {
                0 => Prior::at_least(0.0, width(0), 1e-6 - known.mass),
                _ => Prior::new(mean(i), width(i)),
            })
            .collect()
    }

    fn blocks(
        &self,
        at: &Solution,
        sigma: &[f64],
        used: &[usize],
        value: impl Fn(&Sample, usize) -> f64,
    ) -> Blocks {
        let n = self.layout.count();
        let rate = self.samples.len() as f64 / self.seconds.max(1e-9);
        let count = Blocks::count(self.seconds);
        let alike = Blocks::alike(1.0 / rate) * self.layout.channels as f64;
        let mut blocks = Blocks::new(n, count, alike);
        let mut row = vec![0.0; n];
        for &i in used.iter().filter(|&&i| !at.far[i]) {
            let sample = &self.samples[i];
            let place = i as f64 / self.samples.len() as f64;
            for (c, sigma) in sigma.iter().enumerate() {
                self.row(sample, &at.x, c, &mut row);
                let modelled = sample.modelled[c];
                let b = value(sample, c) - modelled;
                let scaled: Vec<f64> = row.iter().map(|x| x / sigma).collect();
                blocks.add(place, &scaled, b / sigma);
            }
        }
        blocks
    }

    /// Derivatives of a channel's number by the unknowns.
    fn row(&self, sample: &Sample, x: &[f64], channel: usize, row: &mut [f64]) {
        row.fill(0.0);
        row[..BODY].copy_from_slice(&sample.columns[channel]);
        row[self.layout.offset(channel)] = 1.0;
        if self.layout.sensor {
            // R w = w + angle x w
            let first = channel / 3 * 3;
            let w: [f64; 3] = std::array::from_fn(|k| carried(sample, x, first + k));
            let [a, b] = [(channel + 1) % 3, (channel + 2) % 3];
            row[self.layout.angle(a)] = w[b];
            row[self.layout.angle(b)] = -w[a];
        }
    }

    /// Measured less what a solution predicts.
    fn rest(&self, x: &[f64], sample: usize, channel: usize) -> f64 {
        let sample = &self.samples[sample];
        let mut row = vec![0.0; x.len()];
        self.row(sample, x, channel, &mut row);
        let predicted: f64 = row.iter().zip(x).map(|(a, x)| a * x).sum();
        sample.measured[channel] - sample.modelled[channel] - predicted
    }

    fn load(&self, solution: &Solution, fixed: &[bool]) -> Option<Load> {
        let posterior = solution.posterior.as_ref()?;
        let all: Vec<usize> = (0..self.samples.len()).collect();
        // Effect of errors of one sign in all samples.
        let unit = vec![1.0; self.layout.channels];
        let sigma: Vec<f64> = (self.known.channels.iter().zip(&unit))
            .map(|(c, _)| c.sigma.max(1e-9))
            .collect();
        let blocks = self.blocks(solution, &sigma, &all, |s, c| s.modelled[c] + s.common[c]);
        let mut priors = self.priors(&solution.x, fixed, RELAXED);
        priors
            .iter_mut()
            .for_each(|p| *p = Prior::new(0.0, p.sigma));
        let common = blocks.fit(&priors)?.x;
        let covariance = &posterior.covariance + &common * common.transpose();
        let x = &solution.x;
        let known = &self.known.inertia;
        let found = self.inertia(x);
        let deviation = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let value = |i: usize, value: f64, configured: f64| Value {
            value,
            sigma: if fixed[i] {
                self.widths[i]
            } else {
                deviation(i)
            },
            configured,
            determined: !fixed[i],
        };
        let (centre, before) = (found.center(), known.center());
        let of_centre = |k: usize| {
            let (m, c) = (found.mass.max(1e-9), centre[k]);
            let (h, of_mass) = (1 + k, covariance[(0, 0)]);
            let variance =
                (covariance[(h, h)] - 2.0 * c * covariance[(0, h)] + c * c * of_mass) / (m * m);
            Value {
                sigma: if fixed[h] {
                    self.known.centre_sigma
                } else {
                    variance.max(0.0).sqrt()
                },
                ..value(h, c, before[k])
            }
        };
        let central = [known.central(), found.central()].map(|i| {
            let [.., xx, xy, yy, xz, yz, zz] =
                parameters(&Inertia::from_central(0.0, Vector3::zeros(), i));
            [xx, xy, yy, xz, yz, zz]
        });
        let names = NAMES.map(str::to_owned).into_iter();
        let offsets = self
            .known
            .channels
            .iter()
            .map(|c| format!("offset {}", c.name));
        let angles = ["x", "y", "z"].map(|axis| format!("misalignment about {axis}"));
        let names = names.chain(offsets).chain(angles).zip(fixed);
        let undetermined = names.filter(|(_, fixed)| **fixed).map(|(name, _)| name);
        let zero = Value {
            value: 0.0,
            sigma: 0.0,
            configured: 0.0,
            determined: false,
        };
        let far = solution.far.iter().filter(|far| **far).count();
        Some(Load {
            offset: (0..self.layout.channels)
                .map(|c| value(self.layout.offset(c), x[self.layout.offset(c)], 0.0))
                .collect(),
            mass: value(0, found.mass, known.mass),
            centre: std::array::from_fn(of_centre),
            central: std::array::from_fn(|k| value(4 + k, central[1][k], central[0][k])),
            angle: std::array::from_fn(|k| {
                if self.layout.sensor {
                    value(self.layout.angle(k), x[self.layout.angle(k)], 0.0)
                } else {
                    zero
                }
            }),
            inertia: found,
            undetermined: undetermined.collect(),
            condition: self.condition(solution, fixed, &sigma),
            turned: turned(self.samples),
            rms: self.judged(fixed)?,
            samples: self.samples.len() - far,
            left_out: far as f64 / self.samples.len() as f64,
        })
    }

    fn condition(&self, solution: &Solution, fixed: &[bool], sigma: &[f64]) -> f64 {
        let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i]).collect();
        let mut gram = DMatrix::<f64>::zeros(free.len(), free.len());
        let mut row = vec![0.0; fixed.len()];
        for sample in self.samples {
            for (c, sigma) in sigma.iter().enumerate() {
                self.row(sample, &solution.x, c, &mut row);
                let own = |a: usize| row[free[a]] * self.widths[free[a]] / sigma;
                for a in 0..free.len() {
                    for b in 0..=a {
                        gram[(a, b)] += own(a) * own(b);
                    }
                }
            }
        }
        gram.fill_upper_triangle_with_lower_triangle();
        let eigen = gram.symmetric_eigenvalues();
        (eigen.max() / eigen.min().max(1e-300)).sqrt()
    }

    /// RMS by unit: as configured, with offsets alone, with everything; the latter two on parts that were
    /// held out.
    fn judged(&self, fixed: &[bool]) -> Option<Vec<(&'static str, [f64; 3])>> {
        let n = self.samples.len();
        let mut tared: Vec<bool> = vec![true; fixed.len()];
        let offsets = BODY..BODY + self.layout.channels;
        tared[offsets].fill(false);
        let mut units: Vec<&'static str> = self.known.channels.iter().map(|c| c.unit).collect();
        units.dedup();
        let mut squares = vec![([0.0; 3], 0.0); units.len()];
        for part in 0..PARTS {
            let held = part * n / PARTS..(part + 1) * n / PARTS;
            let kept: Vec<usize> = (0..n).filter(|i| !held.contains(i)).collect();
            let each = [&tared[..], fixed].map(|fixed| self.solve(fixed, RELAXED, &kept));
            let [Some(offsets), Some(found)] = each else {
                return None;
            };
            for i in held {
                for (c, channel) in self.known.channels.iter().enumerate() {
                    let sample = &self.samples[i];
                    let rests = [
                        sample.measured[c] - sample.modelled[c],
                        self.rest(&offsets.x, i, c),
                        self.rest(&found.x, i, c),
                    ];
                    let at = units.iter().position(|u| *u == channel.unit)?;
                    let (sums, count) = &mut squares[at];
                    sums.iter_mut()
                        .zip(rests)
                        .for_each(|(sum, r)| *sum += r * r);
                    *count += 1.0;
                }
            }
        }
        let rms = squares
            .into_iter()
            .map(|(sums, n)| sums.map(|sum| (sum / f64::max(n, 1.0)).sqrt()));
        Some(units.into_iter().zip(rms).collect())
    }
}

/// Modelled number of a channel with the changes of a solution.
fn carried(sample: &Sample, x: &[f64], channel: usize) -> f64 {
    let columns = sample.columns[channel].iter();
    sample.modelled[channel] + columns.zip(x).map(|(a, x)| a * x).sum::<f64>()
}

/// Standard deviation by the median: what touches the robot for a while is no noise.
fn spread(rests: &[f64]) -> f64 {
    let mut all: Vec<f64> = rests.iter().map(|x| x.abs()).collect();
    let middle = all.len() / 2;
    if all.is_empty() {
        0.0
    } else {
        MEDIAN_TO_SIGMA * *all.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}

/// Whether a body can have this inertia.
fn possible(i: &Inertia) -> bool {
    let central: Matrix3<f64> = i.central();
    let moments = central.symmetric_eigenvalues();
    i.mass > 0.0 && moments.min() > 0.0 && moments.sum() > 2.0 * moments.max()
}

/// Largest angle between directions of gravity, of two passes, each from the furthest of the one before.
fn turned(samples: &[Sample]) -> f64 {
    let directions = samples.iter().map(|s| s.up).filter(|up| up.norm() > 1.0);
    let directions: Vec<Vector3<f64>> = directions.collect();
    let mut from = directions.first().copied().unwrap_or_default();
    let mut widest = 0.0f64;
    for _ in 0..2 {
        let furthest = directions.iter().max_by(|a, b| {
            let angle = |d: &&Vector3<f64>| d.angle(&from);
            angle(a).total_cmp(&angle(b))
        });
        if let Some(d) = furthest {
            widest = widest.max(d.angle(&from));
            from = *d;
        }
    }
    widest
}
