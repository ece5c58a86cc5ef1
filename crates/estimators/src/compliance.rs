//! Compliance model of the harmonic drive (Z 7-22) and the joint torque that follows from it.
//!
//! ```text
//! theta/N - q --> torsion - err(q, theta) - torsion_wg(tau_wg)/N = torsion_fs --> tau --> low-pass
//!                                                   ^                               |
//! i, omega --> friction cases ----------------------+<------ tau/N of the last step-+
//! ```

mod law;
mod series_spring;

pub use law::{ComplianceParameters, Saturated};

use crate::exponential::exp;
use crate::joint::{DRIVE_OFF, JointSample, JointTorqueEstimator};
use crate::kinematic_error::KinematicErrorParameters;
use crate::low_pass::LowPass;
use crate::wave_generator::{WaveGenerator, WaveGeneratorParameters, WaveGeneratorTorque};
use robot_state::{TorqueEstimate, measured_flags, torque_flags, torque_source};
use series_spring::SeriesSpring;
use simd::{Instructions, Kernel, Lanes};

/// Parameters of a joint whose torque follows from encoders and current by Z's compliance.
#[derive(Debug, Clone, PartialEq)]
pub struct JointEstimatorParameters {
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Pole of the torque's low-pass, 0 (none) to below 1 (Z prints 0.95 at 1 kHz).
    pub low_pass_pole: f64,
    /// One count of the link-side encoder, rad, link side.
    pub link_resolution: f64,
    /// One count of the motor-side encoder, rad, motor side.
    pub motor_resolution: f64,
    /// Standard deviation of the torsion that the model does not explain (hysteresis, residual
    /// kinematic error), rad, link side; identified, 0 if unknown.
    pub torsion_sigma: f64,
    /// Standard deviation of the current, A; 0 if unknown.
    pub current_sigma: f64,
    /// Compliance of flexspline and wave generator.
    pub compliance: ComplianceParameters,
    /// From current to the wave generator's torque.
    pub wave_generator: WaveGeneratorParameters,
    /// Kinematic error.
    pub kinematic_error: KinematicErrorParameters,
}

/// Joint torque from both encoders and the motor current (Z III, Fig. 7).
#[derive(Debug, Clone)]
pub struct ComplianceEstimator {
    parameters: JointEstimatorParameters,
    wave_generator: WaveGenerator,
    low_pass: LowPass,
    /// tau of the last step before the low-pass, N·m; zero after a reset.
    tau: f64,
    last: TorqueEstimate,
    /// Variance of the torsion: encoders' resolution and identified misfit of the model, rad².
    torsion_variance: f64,
    /// The flexspline's torsion at the torque limit, rad.
    torsion_limit: f64,
    /// The torque by torsion alone, and the last sample's, N·m; none where it is beyond the limit.
    series: SeriesSpring,
    by_torsion: Option<f64>,
    instructions: Instructions,
}

/// Transcendental functions of a step, computed side by side.
struct Curves<'a> {
    parameters: &'a JointEstimatorParameters,
    q: f64,
    theta: f64,
    /// tau_wg and its standard deviation, N·m.
    tau_wg: f64,
    tau_wg_sigma: f64,
}

impl Kernel for Curves<'_> {
    /// err, torsion_wg and the latter's standard deviation, rad.
    type Output = (f64, f64, f64);

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let JointEstimatorParameters {
            kinematic_error: error,
            compliance: ComplianceParameters { k_wg0, c_wg, .. },
            ..
        } = self.parameters;
        let phases = L::set([error.w_link * self.q, error.w_motor * self.theta, 0.0, 0.0]);
        let (sin, cos) = simd::sin_cos(phases);
        let (sin, cos) = (sin.to_array(), cos.to_array());
        let err = error.error_of((sin[0], cos[0]), (sin[1], cos[1]));
        // A difference and not a derivative: the interval is wider than the curve is straight.
        let (low, high) = (
            self.tau_wg - self.tau_wg_sigma,
            self.tau_wg + self.tau_wg_sigma,
        );
        let torques = [self.tau_wg, low, high, 0.0];
        let mut torsions = torques.map(|tau_wg| tau_wg / k_wg0);
        if *c_wg > 0.0 {
            //= Z15: torsion_wg = sign(tau_wg) (1 - exp(-C_wg |tau_wg|)) / (C_wg K_wg0)
            let exponents = L::splat(-c_wg) * L::set(torques).abs();
            let yielded = (L::splat(1.0) - exp(exponents)) * L::splat(1.0 / (c_wg * k_wg0));
            torsions = yielded.to_array();
            for (torsion, tau_wg) in torsions.iter_mut().zip(torques) {
                *torsion = torsion.copysign(tau_wg);
            }
        }
        (err, torsions[0], 0.5 * (torsions[2] - torsions[1]))
    }
}

impl ComplianceEstimator {
    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: JointEstimatorParameters) -> Self {
        // A count hides a uniform error whose variance is its square over 12. No credit is taken
        // for the low-pass: at rest the error of quantisation is constant and passes.
        let count = |resolution: f64| resolution * resolution / 12.0;
        let torsion_variance = count(parameters.motor_resolution / parameters.gear_ratio)
            + count(parameters.link_resolution)
            + parameters.torsion_sigma.powi(2);
        Self {
            wave_generator: WaveGenerator::new(parameters.wave_generator),
            low_pass: LowPass::new(parameters.low_pass_pole),
            tau: 0.0,
            last: TorqueEstimate::default(),
            torsion_variance,
            torsion_limit: parameters
                .compliance
                .flexspline_torsion(parameters.torque_limit),
            series: SeriesSpring::new(
                &parameters.compliance,
                parameters.gear_ratio,
                parameters.torque_limit,
            ),
            by_torsion: None,
            instructions: Instructions::detect(),
            parameters,
        }
    }

    /// Delay of the torque behind its sample, s.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.low_pass.delay_samples() * self.parameters.sample_period
    }

    /// sigma: standard deviation of the torque, N·m.
    ///
    /// The variances of the torsion and of the wave generator's part of it, through the local
    /// stiffness: `sigma = K_fl(tau) sqrt(var(torsion) + var(torsion_wg)/N^2)`. The wave
    /// generator's torque is off by the current's noise, or lies anywhere in an interval where
    /// the direction of friction is not known (a uniform distribution).
    fn sigma(&self, tau: f64, torsion_wg_sigma: f64) -> f64 {
        let p = &self.parameters;
        let torsion_wg_sigma = torsion_wg_sigma / p.gear_ratio;
        let variance = self.torsion_variance + torsion_wg_sigma * torsion_wg_sigma;
        (p.compliance.stiffness(tau) * variance.sqrt()).min(p.torque_limit)
    }
}

impl JointTorqueEstimator for ComplianceEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let p = &self.parameters;
        let JointSample {
            q,
            theta,
            omega,
            current,
            flags,
            ..
        } = *sample;
        let torsion = theta / p.gear_ratio - q;
        if !(torsion.is_finite() && omega.is_finite() && current.is_finite())
            || flags & measured_flags::NEVER != 0
        {
            // Without a sample the last value is held and marked as invalid.
            self.last.flags &= !torque_flags::VALID;
            self.last.source = torque_source::ENCODER;
            return self.last;
        }
        let wave_generator = self
            .wave_generator
            .update(current, omega, self.tau / p.gear_ratio);
        let WaveGeneratorTorque { tau_wg, unknown } = wave_generator;
        let current_noise = p.wave_generator.torque_constant * p.current_sigma;
        let variance = current_noise * current_noise + unknown * unknown / 3.0;
        let curves = Curves {
            parameters: p,
            q,
            theta,
            tau_wg,
            tau_wg_sigma: variance.sqrt(),
        };
        let (err, torsion_wg, torsion_wg_sigma) = simd::run(self.instructions, curves);
        //= Z19: torsion_fs = torsion - torsion_wg/N - err
        let torsion_fs = torsion - torsion_wg / p.gear_ratio - err;
        let Saturated { tau, saturated } =
            p.compliance
                .torque_within(torsion_fs, p.torque_limit, self.torsion_limit);
        self.tau = tau;
        self.by_torsion = self.series.torque(torsion - err);
        let tau_hat = self.low_pass.update(tau);
        let mut out = torque_flags::VALID;
        if saturated {
            out |= torque_flags::SATURATED;
        }
        if flags & !DRIVE_OFF != 0 {
            out |= torque_flags::DEGRADED;
        }
        self.last = TorqueEstimate {
            tau: tau_hat,
            sigma: self.sigma(tau, torsion_wg_sigma),
            delay_s: self.low_pass.delay_samples() * p.sample_period,
            source: torque_source::ENCODER,
            flags: out,
        };
        self.last
    }

    /// By torsion alone, and so without a step where the motor's friction changes its case.
    fn undelayed(&self) -> Option<f64> {
        let usable = torque_flags::VALID | torque_flags::SATURATED;
        let valid = self.last.flags & usable == torque_flags::VALID;
        self.by_torsion.filter(|_| valid)
    }

    fn reset(&mut self) {
        self.wave_generator.reset();
        self.low_pass.reset();
        self.tau = 0.0;
        self.by_torsion = None;
        self.last = TorqueEstimate::default();
    }
}
