//! The gear's constants from loaded motion beside a torque sensor: Z's compliance with the skew,
//! and the elastic curve with slipping springs.

mod past;
mod tracking;

pub use past::{known as past_known, typical_stiffness};
pub use tracking::{Errors, tracking};

use crate::blocks::{Blocks, Posterior, Prior, directions};
use crate::least_squares::{Batch, Solution};
use crate::record::{Record, ReferenceErrors};
use estimators::compliance::ComplianceParameters;
use estimators::creep::{Creep, CreepElement};
use estimators::hysteresis::{
    ENCODER_PARAMETERS, Gear, GearParameters, Hysteresis, SlipElement, harmonics,
};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::wave_generator::{WaveGenerator, WaveGeneratorParameters};
use problem::Problem;

/// Samples used at most by fits that look at each sample by itself.
const MAX_SAMPLES: usize = 20_000;

/// Z's constants and the skew.
#[derive(Debug, Clone, PartialEq)]
pub struct ComplianceFit {
    /// Z Table II.
    pub parameters: ComplianceParameters,
    /// Residual skew between the encoders, s, and its standard deviation.
    pub skew: (f64, f64),
    /// K_fs0's standard deviation, N·m/rad.
    pub stiffness_sigma: f64,
    /// Root mean square of the residual torsion, rad.
    pub rms: f64,
}

/// A gear with slipping springs.
#[derive(Debug, Clone, PartialEq)]
pub struct GearFit {
    /// The gear.
    pub parameters: GearParameters,
    /// Stiffness of the linear part and its standard deviation, N·m/rad.
    pub stiffness: (f64, f64),
    /// Skew between the encoders that the samples still have, s, and its standard deviation: the
    /// part of the torsion that grows with dq, apart from the friction in the torque.
    pub skew: (f64, f64),
    /// Zero of the torsion, rad, and its standard deviation.
    pub zero: (f64, f64),
    /// Amplitudes of the harmonics that the samples still have, in the order of
    /// [`estimators::hysteresis::harmonics`], rad.
    pub waves: [f64; ENCODER_PARAMETERS - 2],
    /// Directions of the covariance of [`GearParameters::uncertain`] parameters.
    pub uncertainty: Vec<Vec<f64>>,
    /// Root mean square of the residual torque, N·m.
    pub rms: f64,
    /// The same on contiguous blocks that were held out.
    pub held_out: f64,
}

/// Knowledge of a gear before its logs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearKnowledge {
    /// Rated torque, N·m.
    pub rated_torque: f64,
    /// Stiffness by the catalogue, N·m/rad; without one that of a usual gear of its rated torque.
    pub stiffness: Option<f64>,
    /// Whether an unloaded turn has determined kinematic error and zero.
    pub turned: bool,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Skew, zero and harmonics by earlier passes, which the samples no longer have: the priors are about
    /// the sum.
    pub found: [f64; ENCODER_PARAMETERS],
    /// Errors of the reference that no log shows.
    pub reference: ReferenceErrors,
}

/// Torsion of a usual harmonic drive at its rated torque, rad (Z Table I: 1.9e-3; catalogues: 1.3e-3 to
/// 2.4e-3).
const RATED_TORSION: f64 = 1.8e-3;
/// Width of the prior of the skew, s.
const SKEW_WIDTH_S: f64 = 2e-3;
/// Standard deviation of the skew that no log shows, by lags of the gear that pass for it, s.
const LAG_S: f64 = 5e-6;
/// Directions of the covariance that the loop evaluates.
const DIRECTIONS: usize = 12;

/// Torsion less kinematic error, smoothed; torque, smoothed.
fn signals(record: &Record, error: &KinematicErrorParameters) -> Result<[Vec<f64>; 2], Problem> {
    if !record.tau.iter().all(|tau| tau.is_finite()) {
        return Err(Problem::new(
            "training log: column `tau_sensor` is needed",
            "",
        ));
    }
    // The error goes before smoothing: fast motion would smear its harmonics.
    let torsion = torsion(record, error);
    Ok([record.smooth(&torsion, 0), record.smooth(&record.tau, 0)])
}

/// theta/N - q less the kinematic error of every sample, rad.
fn torsion(record: &Record, error: &KinematicErrorParameters) -> Vec<f64> {
    let torsion = record
        .samples
        .iter()
        .map(|s| s.theta / record.gear_ratio - s.q - error.error(s.q, s.theta));
    torsion.collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// Fits `torsion - err = torsion_fs(tau) + torsion_wg(tau_wg)/N + skew dq + c sign(dq) + constant`
/// (Z8); the sign's part is the output bearing's friction, which the skew would absorb otherwise.
///
/// Linear in 1/K_fs0, 1/K_wg0, skew, c and constant once C_fs and C_wg are chosen: these are
/// searched on a grid.
///
/// # Errors
/// A log without torque sensor or without load.
pub fn compliance(
    record: &Record,
    error: &KinematicErrorParameters,
    motor: WaveGeneratorParameters,
) -> Result<ComplianceFit, Problem> {
    let [torsion, tau] = signals(record, error)?;
    let tau_max = largest(&tau);
    let mut wave_generator = WaveGenerator::new(motor);
    let n = record.gear_ratio;
    let current = record.smooth(&record.current(), 0);
    let tau_wg: Vec<f64> = (0..tau.len())
        .map(|i| {
            wave_generator
                .update(current[i], n * record.motion[i][0], tau[i] / n)
                .tau_wg
        })
        .collect();
    let tau_wg_max = largest(&tau_wg).max(1e-9);
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let slow = (0.02 * fastest).max(1e-6);
    let rows: Vec<usize> = record.spread(MAX_SAMPLES).collect();
    let shape = |k_fs0, c_fs, k_wg0, c_wg| ComplianceParameters {
        k_fs0,
        c_fs,
        k_wg0,
        c_wg,
    };
    let attempt = |c_fs: f64, c_wg: f64| -> Option<(Solution, f64, f64)> {
        let unit = shape(1.0, c_fs, 1.0, c_wg);
        let mut batch = Batch::new(5);
        for &i in &rows {
            let wave_generator = unit.wave_generator_torsion(tau_wg[i]) / n;
            let row = [
                unit.flexspline_torsion(tau[i]),
                wave_generator,
                record.motion[i][0],
                (record.motion[i][0] / slow).tanh(),
                1.0,
            ];
            batch.add(&row, torsion[i]);
        }
        Some((batch.solve_bounded(1e-12, |i| i < 2)?, c_fs, c_wg))
    };
    let grid = (0..=16).flat_map(|a| [3.0, 6.0, 12.0, 24.0].map(|b| (0.15 * f64::from(a), b)));
    let best = grid
        .filter_map(|(a, b)| attempt(a / tau_max, b / tau_wg_max))
        .min_by(|a, b| a.0.rms.total_cmp(&b.0.rms))
        .filter(|(solution, ..)| solution.x[0] > 0.0);
    let Some((solution, c_fs, c_wg)) = best else {
        return Err(Problem::new(
            format!(
                "training log: torsion does not grow with the torque (largest torque {tau_max:.3} N·m)"
            ),
            "loaded motion, and `theta/N - q > 0` for positive torque",
        ));
    };
    let k_fs0 = 1.0 / solution.x[0];
    // A wave generator without a stiffness in the data counts as rigid.
    let k_wg0 = if solution.x[1] > 0.0 {
        1.0 / solution.x[1]
    } else {
        1e9
    };
    Ok(ComplianceFit {
        parameters: shape(k_fs0, c_fs, k_wg0, c_wg),
        skew: (solution.x[2], solution.sigma[2]),
        stiffness_sigma: k_fs0 * k_fs0 * solution.sigma[0],
        rms: solution.rms,
    })
}

/// Widths of the wind-up, parts of the largest torsion.
const WIND_UP: [f64; 3] = [0.02, 0.07, 0.25];
/// Stretches at which springs slip, parts of the largest torsion.
const SLIP: [f64; 8] = [0.004, 0.008, 0.016, 0.032, 0.064, 0.128, 0.25, 0.5];
/// Times in which the gear creeps, s.
const CREEP_S: [f64; 3] = [0.3, 1.0, 4.0];
/// Stiffness behind each damper before any data and its width, of the gear's.
const CREEP: [f64; 2] = [0.004, 0.01];

/// Stretches at which the output bearing's springs slip, rad.
const BEARING_SLIP: [f64; 4] = [3e-5, 1e-4, 4e-4, 2e-3];

/// Standard deviation of a spring's first stretch, of its limit: anywhere up to it, either way.
const PAST: f64 = 0.58;
/// Logs whose past is looked for, at most: each has coefficients of its own.
const MAX_PASTS: usize = 8;

/// Fits elastic curve, slipping springs, damping and the output bearing's friction, and what encoders and
/// kinematic error still add to the torsion: linear in every stiffness once widths and slips are
/// chosen, which lie on a geometric grid. Every coefficient has a prior of the gear's size; stiffness
/// and springs are positive. At the start of each log the springs have an unknown stretch, which one
/// coefficient for the gear's and one for the bearing's give; it counts as long as the motion has not passed
/// through more than before.
///
/// # Errors
/// A log without torque sensor or without load.
pub fn hysteresis(
    record: &Record,
    error: &KinematicErrorParameters,
    known: &GearKnowledge,
) -> Result<GearFit, Problem> {
    let [torsion, tau] = signals(record, error)?;
    let q = |record: &Record| record.samples.iter().map(|s| s.q).collect::<Vec<f64>>();
    let stiffness = known
        .stiffness
        .unwrap_or(known.rated_torque / RATED_TORSION);
    let mut data = GearData {
        q: record.smooth(&q(record), 0),
        w_link: error.w_link,
        rate: record.smooth(&torsion, 1),
        x_max: 0.0,
        torsion,
        tau,
        known: *known,
        stiffness,
        encoders: [0.0; ENCODER_PARAMETERS],
        springs: None,
    };
    if !known.turned {
        // Without a turn the zero is anywhere: a start from the prior's stiffness.
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        data.encoders[1] = mean(&data.torsion) - mean(&data.tau) / stiffness;
    }
    // Skew, zero and harmonics move the torsion, friction the torque: only the changing stiffness
    // distinguishes them, and it is known after a first fit.
    let mut rough = GearParameters {
        linear: 0.8 * stiffness,
        ..GearParameters::default()
    };
    for _ in 0..2 {
        let fit = data.fit(record, &rough)?;
        data.encoders = data.moved(&fit);
        rough = fit.parameters;
    }
    let mut fit = data.fit(record, &rough)?;
    let [skew, zero, waves @ ..] = data.moved(&fit);
    (fit.skew.0, fit.zero.0, fit.waves) = (skew, zero, waves);
    Ok(fit)
}

/// Signals of the gear's fit.
struct GearData {
    q: Vec<f64>,
    /// w_l, per rad of q.
    w_link: f64,
    torsion: Vec<f64>,
    rate: Vec<f64>,
    tau: Vec<f64>,
    x_max: f64,
    known: GearKnowledge,
    stiffness: f64,
    /// Skew, zero and harmonics that are taken off the torsion so far.
    encoders: [f64; ENCODER_PARAMETERS],
    /// Stiffness of the springs by the pass before, N·m/rad; none before the first.
    springs: Option<[f64; SPRINGS]>,
}

// Columns of the gear's fit.
const FIRST_SPRING: usize = 2 + WIND_UP.len();
const FIRST_BEARING: usize = FIRST_SPRING + SLIP.len();
const FIRST_CREEP: usize = FIRST_BEARING + BEARING_SLIP.len();
const VISCOUS: usize = FIRST_CREEP + CREEP_S.len();
const DAMPING: usize = VISCOUS + 1;
const SKEW: usize = VISCOUS + 2;
const SPRINGS: usize = SLIP.len() + BEARING_SLIP.len();
const COLUMNS: usize = SKEW + ENCODER_PARAMETERS;

impl GearData {
    /// Encoder parameters after a fit of their increments.
    fn moved(&self, fit: &GearFit) -> [f64; ENCODER_PARAMETERS] {
        let step = [fit.skew.0, fit.zero.0].into_iter().chain(fit.waves);
        let mut moved = self.encoders;
        moved.iter_mut().zip(step).for_each(|(x, step)| *x += step);
        moved
    }

    /// Torsion of a sample without what is known of the encoders.
    fn corrected(&self, record: &Record, i: usize, waves: &[f64]) -> f64 {
        let [skew, zero, amplitudes @ ..] = &self.encoders;
        let wave: f64 = amplitudes.iter().zip(waves).map(|(a, w)| a * w).sum();
        self.torsion[i] - skew * record.motion[i][0] - zero - wave
    }

    fn priors(&self) -> Vec<Prior> {
        let (k, rated) = (self.stiffness, self.known.rated_torque);
        let torsion = rated / k;
        let width = if self.known.stiffness.is_some() {
            0.25
        } else {
            0.4
        };
        let mut priors = vec![
            Prior::at_least(0.8 * k, width * k, 0.2 * k),
            Prior::new(0.05 * k / torsion.powi(2), 0.3 * k / torsion.powi(2)),
        ];
        priors.extend(WIND_UP.map(|_| Prior::new(0.0, 0.25 * k)));
        let spring = |slip: f64, mean: f64, sigma: f64| {
            Prior::at_least(mean * rated / slip, sigma * rated / slip, 0.0)
        };
        priors.extend(SLIP.map(|part| spring(part * self.x_max, 0.001, 0.004)));
        priors.extend(BEARING_SLIP.map(|slip| spring(slip, 0.0, 0.003)));
        let [creep, width] = CREEP.map(|part| part * k);
        priors.extend(CREEP_S.map(|_| Prior::at_least(creep, width, 0.0)));
        priors.push(Prior::at_least(0.0, 0.01 * rated, 0.0));
        priors.push(Prior::new(0.0, 2e-3 * k));
        let mut all = self.encoders;
        all.iter_mut()
            .zip(self.known.found)
            .for_each(|(x, found)| *x += found);
        let [skew, zero, waves @ ..] = &all;
        priors.push(Prior::new(-skew, SKEW_WIDTH_S));
        let zero_width = if self.known.turned { 0.02 } else { 2.0 };
        priors.push(if self.known.turned {
            Prior::new(-zero, zero_width * torsion)
        } else {
            Prior::new(0.0, zero_width * torsion)
        });
        let widths = if self.known.turned {
            [2e-5, 1e-5, 1e-5, 1e-5, 5e-6]
        } else {
            [2e-4, 1e-4, 5e-5, 5e-5, 1e-5]
        };
        let pairs = widths.into_iter().flat_map(|w| [w, w]);
        priors.extend(waves.iter().zip(pairs).map(|(a, w)| Prior::new(-a, w)));
        priors
    }

    /// One pass; `rough` is the gear whose stiffness turns torsion into torque.
    fn fit(&mut self, record: &Record, rough: &GearParameters) -> Result<GearFit, Problem> {
        let waves = |i: usize| harmonics(self.w_link * self.q[i], record.samples[i].theta);
        let torsion: Vec<f64> = (0..self.torsion.len())
            .map(|i| self.corrected(record, i, &waves(i)))
            .collect();
        self.x_max = largest(&torsion).max(0.05 * self.known.rated_torque / self.stiffness);
        let unit = |limit| SlipElement {
            limit,
            stiffness: 1.0,
        };
        let elements: Vec<SlipElement> = SLIP.iter().map(|part| unit(part * self.x_max)).collect();
        let mut springs = Hysteresis::new(&elements);
        let mut bearing = Hysteresis::new(&BEARING_SLIP.map(unit));
        let unit = |time| CreepElement {
            time,
            stiffness: 1.0,
        };
        let mut creep = Creep::new(&CREEP_S.map(unit), self.known.sample_period);
        let mut gear = Gear::new(rough.clone(), self.known.sample_period);
        let seconds = self.tau.len() as f64 * self.known.sample_period;
        let alike = Blocks::alike(self.known.sample_period);
        let mut priors = self.priors();
        let assumed = (self.springs).unwrap_or_else(|| {
            std::array::from_fn(|k| priors[FIRST_SPRING + k].mean + priors[FIRST_SPRING + k].sigma)
        });
        let pasts = record.log_begins().len().min(MAX_PASTS);
        priors.resize(COLUMNS + 2 * pasts, Prior::new(0.0, PAST));
        let mut blocks = Blocks::new(priors.len(), Blocks::count(seconds), alike);
        let mut row = vec![0.0; priors.len()];
        let (mut log, mut rows, mut slopes) = (0, 0.0f64, 0.0);
        for (i, (&x, &tau)) in torsion.iter().zip(&self.tau).enumerate() {
            if record.log_begins().binary_search(&i).is_ok() {
                log += usize::from(i > 0);
                springs.reset();
                creep.reset();
                bearing.reset();
                gear.reset();
            }
            springs.update(x);
            creep.update(x);
            bearing.update(self.q[i]);
            gear.update(x);
            if !record.usable(i) {
                continue;
            }
            let dq = record.motion[i][0];
            (row[0], row[1]) = (x, x * x * x);
            for (column, part) in row[2..].iter_mut().zip(WIND_UP) {
                let w = part * self.x_max;
                *column = w * (x / w).tanh();
            }
            row[COLUMNS..].fill(0.0);
            let intervals = springs.intervals().chain(bearing.intervals());
            for (k, ([middle, half], stiffness)) in intervals.zip(assumed).enumerate() {
                let sign = if k < SLIP.len() { 1.0 } else { -1.0 };
                row[FIRST_SPRING + k] = sign * middle;
                // The springs of either kind are off the same way: one past made them so.
                let column = COLUMNS + 2 * log + usize::from(k >= SLIP.len());
                if let Some(past) = row.get_mut(column) {
                    *past += sign * stiffness * half;
                }
            }
            for (column, x) in row[FIRST_CREEP..].iter_mut().zip(creep.stretches()) {
                *column = x;
            }
            (row[VISCOUS], row[DAMPING]) = (-dq, self.rate[i]);
            let slope = gear.stiffness(x);
            (row[SKEW], row[SKEW + 1]) = (-slope * dq, -slope);
            slopes += slope * slope;
            rows += 1.0;
            for (column, wave) in row[SKEW + 2..COLUMNS].iter_mut().zip(waves(i)) {
                *column = -slope * wave;
            }
            blocks.add(i as f64 / self.tau.len() as f64, &row, tau);
        }
        let mut posterior = blocks.fit(&priors).ok_or_else(|| {
            Problem::new("training log: the gear's stiffness is not determined", "")
        })?;
        let reference = self.known.reference;
        // An offset of the torque passes for a zero by the stiffness where the log was.
        let offset = reference.offset / f64::sqrt(slopes / rows.max(1.0)).max(0.2 * self.stiffness);
        posterior.covariance[(0, 0)] += (reference.gain * posterior.x[0]).powi(2);
        posterior.covariance[(SKEW + 1, SKEW + 1)] += offset * offset;
        posterior.covariance[(SKEW, SKEW)] += LAG_S * LAG_S;
        self.springs = Some(std::array::from_fn(|k| posterior.x[FIRST_SPRING + k]));
        Ok(self.parameters(&posterior))
    }

    fn parameters(&self, posterior: &Posterior) -> GearFit {
        let x = &posterior.x;
        let sigma = |i: usize| posterior.covariance[(i, i)].max(0.0).sqrt();
        let kept = |i: &usize| x[*i] != 0.0;
        let springs = |first: usize, slips: &[f64], unit: f64| -> Vec<SlipElement> {
            (0..slips.len())
                .filter(|i| kept(&(first + i)))
                .map(|i| SlipElement {
                    limit: slips[i] * unit,
                    stiffness: x[first + i],
                })
                .collect()
        };
        let all = (0..2 + WIND_UP.len()).chain((FIRST_SPRING..VISCOUS).filter(kept));
        let all: Vec<usize> = all.chain(VISCOUS..COLUMNS).collect();
        let covariance = nalgebra::DMatrix::from_fn(all.len(), all.len(), |a, b| {
            posterior.covariance[(all[a], all[b])]
        });
        GearFit {
            parameters: GearParameters {
                linear: x[0],
                cubic: x[1],
                wind_up: (0..WIND_UP.len())
                    .map(|i| (WIND_UP[i] * self.x_max, x[2 + i]))
                    .collect(),
                slipping: springs(FIRST_SPRING, &SLIP, self.x_max),
                creeping: (CREEP_S.iter().zip(FIRST_CREEP..))
                    .filter(|(_, i)| kept(i))
                    .map(|(time, i)| CreepElement {
                        time: *time,
                        stiffness: x[i],
                    })
                    .collect(),
                damping: x[DAMPING],
                bearing: springs(FIRST_BEARING, &BEARING_SLIP, 1.0),
                bearing_viscous: x[VISCOUS],
            },
            stiffness: (x[0], sigma(0)),
            skew: (x[SKEW], sigma(SKEW)),
            zero: (x[SKEW + 1], sigma(SKEW + 1)),
            waves: std::array::from_fn(|i| x[SKEW + 2 + i]),
            uncertainty: directions(&covariance, DIRECTIONS),
            rms: posterior.rms,
            held_out: posterior.held_out,
        }
    }
}
