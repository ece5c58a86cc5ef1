//! The motor's constants from loaded motion beside a torque sensor (D3, D7).

use crate::blocks::{Blocks, Posterior, Prior, directions};
use crate::record::{Record, ReferenceErrors};
use estimators::current_based::{CurrentParameters, STOPS, UNCERTAIN};
use estimators::hysteresis::{Hysteresis, SlipElement};
use estimators::low_pass::LowPass;
use nalgebra::{DMatrix, DVector};
use problem::Problem;

/// Time constant of the low-pass on current, s.
const TIME_CONSTANT_S: f64 = 0.005;
/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;

/// Ways of theta/N over which friction builds up, rad: a tenth to some times a gear's torsion at rated torque.
const WAYS: [f64; STOPS] = [1e-4, 5e-4, 3e-3];
/// Weight of rows at rest: there friction is known less well than in motion, whatever its model.
const AT_REST: f64 = 0.3;
/// The stop whose direction the friction per torque has.
const MESHING: usize = 1;
/// Velocity over which models without such a state smooth the sign of friction, over the largest one, and below
/// which a joint does not count as moving.
const MIN_RELATIVE_SPEED: f64 = 0.005;
/// The same for joints that hardly move, rad/s: slower motion is the encoder's noise.
const MIN_SPEED: f64 = 2e-3;
/// Friction of a usual harmonic drive, of its rated torque, before any data; its width is the same.
const FRICTION: f64 = 0.1;

/// Tolerance of a data sheet's torque constant, relative standard deviation.
const TORQUE_CONSTANT: f64 = 0.05;
/// Relative standard deviation of the rotor inertia that no log shows, as friction that depends on the
/// acceleration passes for it.
const INERTIA: f64 = 0.1;

/// The motor's data sheet, link side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorKnowledge {
    /// Torque per current, N·m/A.
    pub torque_constant: f64,
    /// Rotor's inertia, kg·m².
    pub inertia: f64,
    /// Rated torque, N·m.
    pub rated_torque: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
    /// Errors of the reference that no log shows.
    pub reference: ReferenceErrors,
}

/// The constants, and what is known about them.
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentFit {
    /// D3 and inertia.
    pub parameters: CurrentParameters,
    /// K1's standard deviation, N·m/A.
    pub sigma_1: f64,
    /// Directions of the covariance of the [`UNCERTAIN`] parameters.
    pub uncertainty: Vec<Vec<f64>>,
    /// Seconds of motion that were fitted to.
    pub seconds: f64,
}

/// Columns of the fit: K1, offset, K2, inertia, K4, then the friction of each stop.
const COLUMNS: usize = 5 + STOPS;

impl MotorKnowledge {
    fn priors(&self) -> [Prior; COLUMNS] {
        let r = self.rated_torque;
        let share = FRICTION * r / STOPS as f64;
        let stop = Prior::at_least(share, share, 0.0);
        [
            Prior::at_least(
                self.torque_constant,
                TORQUE_CONSTANT * self.torque_constant,
                0.6 * self.torque_constant,
            ),
            Prior::new(0.0, 0.02 * r),
            Prior::at_least(0.05 * r, 0.1 * r, 0.0),
            Prior::at_least(self.inertia, 0.5 * self.inertia, 0.0),
            Prior::at_least(0.03, 0.05, 0.0),
            stop,
            stop,
            stop,
        ]
    }
}

/// Fits `tau = K1 (i - offset) - K2 dq - (K3 + K4 |tau|) sign(dq) - J ddq`, with a sign that builds up along
/// theta/N. Without motion the data sheet is nearly all there is.
///
/// # Errors
/// Torque that falls with the current.
pub fn fit(record: &Record, known: &MotorKnowledge) -> Result<CurrentFit, Problem> {
    let tau = record.smooth(&record.tau, 0);
    let current = record.smooth(&record.current(), 0);
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let slowest = (MIN_RELATIVE_SPEED * fastest).max(MIN_SPEED);
    let rows: Vec<usize> = record
        .spread(MAX_SAMPLES)
        .filter(|&i| tau[i].is_finite())
        .collect();
    let priors = known.priors();
    let seconds = tau.len() as f64 * record.sample_period;
    let stops = stops(record);
    // Not every sample is a row of a long log.
    let spacing = tau.len().div_ceil(MAX_SAMPLES).max(1) as f64;
    let alike = Blocks::alike(record.sample_period) / spacing;
    let mut blocks = Blocks::new(COLUMNS, Blocks::count(seconds), alike);
    let moves = |i: usize| record.motion[i][0].abs() > slowest;
    let mut square = 0.0;
    for &i in &rows {
        let [dq, ddq] = record.motion[i];
        let stops = stops[i].map(|stop| -stop);
        let meshing = stops[MESHING] * tau[i].abs();
        let [first, second, third] = stops;
        let row = [current[i], 1.0, -dq, -ddq, meshing, first, second, third];
        let weight = if moves(i) { 1.0 } else { AT_REST };
        square += weight * weight;
        let row = row.map(|x| weight * x);
        blocks.add(i as f64 / tau.len() as f64, &row, weight * tau[i]);
    }
    let best = blocks.fit(&priors);
    // Without the prior's sign: data that contradict it are of another joint, or reversed.
    let mut free = priors;
    free[0] = Prior::new(known.torque_constant, 3.0 * known.torque_constant);
    let gain = blocks.fit(&free);
    if gain.is_some_and(|g| g.x[0] + 2.0 * g.covariance[(0, 0)].sqrt() < 0.0) {
        return Err(Problem::new(
            "training log: torque does not grow with the current",
            "a reference torque and motion under load, currents of the torque's sign",
        ));
    }
    let count = rows.len().max(1) as f64;
    let share = rows.iter().filter(|i| moves(**i)).count() as f64 / count;
    let mut posterior = best.unwrap_or_else(|| without_data(&priors));
    // Of a row in motion where there are any.
    posterior.held_out /= (square / count).sqrt().max(AT_REST);
    let spans = [seconds, share * seconds];
    Ok(constants(record, known, &posterior, slowest, spans))
}

/// Stretch of each stop over its way, at every sample, as the estimator has it.
fn stops(record: &Record) -> Vec<[f64; STOPS]> {
    let element = |way: f64| SlipElement {
        limit: way,
        stiffness: 1.0,
    };
    let mut stops = Hysteresis::new(&WAYS.map(element));
    let place = |i: usize| record.samples[i].theta / record.gear_ratio;
    (0..record.samples.len())
        .map(|i| {
            stops.update(place(i) - place(0));
            let mut stretches = [0.0; STOPS];
            let of_stops = stops.stretches().zip(WAYS);
            for (stretch, (own, way)) in stretches.iter_mut().zip(of_stops) {
                *stretch = own / way;
            }
            stretches
        })
        .collect()
}

/// The priors as they are.
fn without_data(priors: &[Prior]) -> Posterior {
    let n = priors.len();
    Posterior {
        x: DVector::from_fn(n, |i, _| priors[i].mean),
        covariance: DMatrix::from_fn(
            n,
            n,
            |i, j| if i == j { priors[i].sigma.powi(2) } else { 0.0 },
        ),
        rms: 0.0,
        held_out: 0.0,
    }
}

/// Covariance of the [`UNCERTAIN`] parameters: the friction is that of all stops.
fn of_parameters(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    // K1, offset, K2, K3, inertia, K4.
    const PLACES: [usize; 5] = [0, 1, 2, 4, 5];
    let mut sums = DMatrix::zeros(UNCERTAIN, COLUMNS);
    for (column, place) in PLACES.into_iter().enumerate() {
        sums[(place, column)] = 1.0;
    }
    for stop in 0..STOPS {
        sums[(3, PLACES.len() + stop)] = 1.0;
    }
    &sums * covariance * sums.transpose()
}

fn constants(
    record: &Record,
    known: &MotorKnowledge,
    posterior: &Posterior,
    smoothing: f64,
    [seconds, moved]: [f64; 2],
) -> CurrentFit {
    let x = &posterior.x;
    let friction: [f64; STOPS] = std::array::from_fn(|k| x[COLUMNS - STOPS + k]);
    let k_3: f64 = friction.iter().sum();
    let mut covariance = of_parameters(&posterior.covariance);
    covariance[(0, 0)] += (known.reference.gain * x[0]).powi(2);
    covariance[(1, 1)] += known.reference.offset.powi(2);
    covariance[(4, 4)] += (INERTIA * x[3]).powi(2);
    let pole = (-record.sample_period / TIME_CONSTANT_S).exp();
    debug_assert!(LowPass::new(pole).delay_samples().is_finite());
    // A second is about one independent sample of the residual; the prior counts as three.
    let usual = 0.25 * FRICTION * known.rated_torque;
    let held_out = posterior.held_out;
    let sigma = ((seconds * held_out * held_out + 3.0 * usual * usual) / (seconds + 3.0)).sqrt();
    let share = |friction: f64| friction / k_3.max(f64::MIN_POSITIVE);
    CurrentFit {
        parameters: CurrentParameters {
            k_1: x[0],
            k_2: x[2],
            k_3,
            inertia: x[3],
            // Half would lock the gear against being driven back.
            k_4: x[4].min(0.5),
            offset: -x[1] / x[0],
            sign_smoothing: smoothing,
            presliding: std::array::from_fn(|k| (WAYS[k], share(friction[k]))),
            gear_ratio: record.gear_ratio,
            low_pass_pole: pole,
            sigma,
            sample_period: record.sample_period,
            torque_limit: known.torque_limit,
        },
        sigma_1: covariance[(0, 0)].max(0.0).sqrt(),
        uncertainty: directions(&covariance, UNCERTAIN),
        seconds: moved,
    }
}
