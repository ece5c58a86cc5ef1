//! The motor's constants from loaded motion beside a torque sensor (D3, D7).

use crate::blocks::{Blocks, Posterior, Prior, directions};
use crate::record::{Record, ReferenceErrors};
use estimators::current_based::{CurrentParameters, UNCERTAIN};
use estimators::low_pass::LowPass;
use problem::Problem;

/// Time constant of the low-pass on current, s.
const TIME_CONSTANT_S: f64 = 0.005;
/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;

/// Velocities over which the sign of friction may be smoothed, and below which its direction is
/// unknown, over the largest velocity.
const SMOOTHING: [f64; 4] = [0.002, 0.005, 0.01, 0.02];
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

/// What the data sheet says about the motor, link side.
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

impl MotorKnowledge {
    fn priors(&self) -> [Prior; UNCERTAIN] {
        let r = self.rated_torque;
        [
            Prior::at_least(
                self.torque_constant,
                TORQUE_CONSTANT * self.torque_constant,
                0.6 * self.torque_constant,
            ),
            Prior::new(0.0, 0.02 * r),
            Prior::at_least(0.05 * r, 0.1 * r, 0.0),
            Prior::at_least(FRICTION * r, FRICTION * r, 0.0),
            Prior::at_least(self.inertia, 0.5 * self.inertia, 0.0),
            Prior::at_least(0.03, 0.05, 0.0),
        ]
    }
}

/// Fits `tau = K1 (i - offset) - K2 dq - (K3 + K4 |tau|) sign(dq) - J ddq` to samples in motion; without motion
/// the data sheet is all there is.
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
        .filter(|&i| record.motion[i][0].abs() > slowest && tau[i].is_finite())
        .collect();
    let priors = known.priors();
    let seconds = tau.len() as f64 * record.sample_period;
    // Not every sample is a row of a long log.
    let spacing = tau.len().div_ceil(MAX_SAMPLES).max(1) as f64;
    let gather = |smoothing: f64| {
        let alike = Blocks::alike(record.sample_period) / spacing;
        let mut blocks = Blocks::new(UNCERTAIN, Blocks::count(seconds), alike);
        for &i in &rows {
            let [dq, ddq] = record.motion[i];
            let direction = (dq / smoothing).tanh();
            let meshing = -direction * tau[i].abs();
            let row = [current[i], 1.0, -dq, -direction, -ddq, meshing];
            blocks.add(i as f64 / tau.len() as f64, &row, tau[i]);
        }
        blocks
    };
    let attempt = |smoothing: f64| {
        let blocks = gather(smoothing);
        Some((blocks.fit(&priors)?, smoothing))
    };
    let best = SMOOTHING
        .iter()
        .filter_map(|part| attempt((part * fastest).max(MIN_SPEED)))
        .min_by(|a, b| a.0.held_out.total_cmp(&b.0.held_out));
    if let Some((_, smoothing)) = &best {
        // Without the prior's sign: data that contradict it are of another joint, or reversed.
        let mut free = priors;
        free[0] = Prior::new(known.torque_constant, 3.0 * known.torque_constant);
        let gain = gather(*smoothing).fit(&free);
        if gain.is_some_and(|g| g.x[0] + 2.0 * g.covariance[(0, 0)].sqrt() < 0.0) {
            return Err(Problem::new(
                "training log: torque does not grow with the current",
                "`tau_sensor` and motion under load, currents of the torque's sign",
            ));
        }
    }
    let share = rows.len() as f64 / record.spread(MAX_SAMPLES).count().max(1) as f64;
    let moved = share * seconds;
    let (posterior, smoothing) = best.unwrap_or_else(|| (without_data(&priors), MIN_SPEED));
    Ok(constants(record, known, &posterior, smoothing, moved))
}

/// The priors as they are.
fn without_data(priors: &[Prior]) -> Posterior {
    let n = priors.len();
    Posterior {
        x: nalgebra::DVector::from_fn(n, |i, _| priors[i].mean),
        covariance: nalgebra::DMatrix::from_fn(n, n, |i, j| match i == j {
            true => priors[i].sigma.powi(2),
            false => 0.0,
        }),
        rms: 0.0,
        held_out: 0.0,
    }
}

fn constants(
    record: &Record,
    known: &MotorKnowledge,
    posterior: &Posterior,
    smoothing: f64,
    seconds: f64,
) -> CurrentFit {
    let x = &posterior.x;
    let mut covariance = posterior.covariance.clone();
    covariance[(0, 0)] += (known.reference.gain * x[0]).powi(2);
    covariance[(1, 1)] += known.reference.offset.powi(2);
    covariance[(4, 4)] += (INERTIA * x[4]).powi(2);
    let pole = (-record.sample_period / TIME_CONSTANT_S).exp();
    debug_assert!(LowPass::new(pole).delay_samples().is_finite());
    // A second of motion is about one independent sample of the residual; the prior counts as three.
    let usual = 0.25 * FRICTION * known.rated_torque;
    let held_out = posterior.held_out;
    let sigma = ((seconds * held_out * held_out + 3.0 * usual * usual) / (seconds + 3.0)).sqrt();
    CurrentFit {
        parameters: CurrentParameters {
            k_1: x[0],
            k_2: x[2],
            k_3: x[3],
            inertia: x[4],
            // Half would lock the gear against being driven back.
            k_4: x[5].min(0.5),
            offset: -x[1] / x[0],
            sign_smoothing: smoothing,
            low_pass_pole: pole,
            sigma,
            sample_period: record.sample_period,
            torque_limit: known.torque_limit,
        },
        sigma_1: covariance[(0, 0)].max(0.0).sqrt(),
        uncertainty: directions(&covariance, UNCERTAIN),
        seconds,
    }
}
