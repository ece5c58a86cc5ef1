//! Compliance model of the harmonic drive (Z 7-22) and the joint torque that follows from it.
//!
//! ```text
//! theta/N - q --> torsion - err(q, theta) - torsion_wg(tau_wg)/N = torsion_fs --> tau --> low-pass
//!                                                   ^                               |
//! i, omega --> friction cases ----------------------+<------ tau/N of the last step-+
//! ```

use crate::exponential::exp;
use crate::joint::{DRIVE_OFF, JointSample, JointTorqueEstimator};
use crate::kinematic_error::KinematicErrorParameters;
use crate::low_pass::LowPass;
use crate::series_spring::SeriesSpring;
use crate::wave_generator::{WaveGenerator, WaveGeneratorParameters, WaveGeneratorTorque};
use robot_state::{TorqueEstimate, measured_flags, torque_flags, torque_source};
use simd::{Instructions, Kernel, Lanes};
use std::f64::consts::FRAC_PI_2;

/// Constants of the compliance model (Z Table II).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComplianceParameters {
    /// K_fs0: flexspline stiffness at zero torque, N·m/rad.
    pub k_fs0: f64,
    /// C_fs: growth of the flexspline's stiffness, 1/(N·m).
    pub c_fs: f64,
    /// K_wg0: wave-generator stiffness at zero torque, motor side, N·m/rad.
    pub k_wg0: f64,
    /// C_wg: growth of the wave generator's stiffness, 1/(N·m).
    pub c_wg: f64,
}

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

/// A torque, and whether the torsion's torque exceeds the limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturated {
    /// The torque, N·m, within plus or minus the limit.
    pub tau: f64,
    /// Whether the limit was reached.
    pub saturated: bool,
}

impl ComplianceParameters {
    /// K_fl: local stiffness of the flexspline at torque `tau`, N·m/rad.
    #[must_use]
    pub fn stiffness(&self, tau: f64) -> f64 {
        //= Z10: K_fl = K_fs0 (1 + (C_fs tau)^2)
        self.k_fs0 * (1.0 + (self.c_fs * tau).powi(2))
    }

    /// torsion_fs: the flexspline's torsion at torque `tau`, rad, link side.
    #[must_use]
    pub fn flexspline_torsion(&self, tau: f64) -> f64 {
        //= Z12: torsion_fs = atan(C_fs tau) / (C_fs K_fs0)
        if self.c_fs > 0.0 {
            (self.c_fs * tau).atan() / (self.c_fs * self.k_fs0)
        } else {
            // The limit of Z12 for C_fs -> 0: a linear spring.
            tau / self.k_fs0
        }
    }

    /// torsion_wg: the wave generator's torsion at torque `tau_wg`, rad, both motor side.
    #[must_use]
    pub fn wave_generator_torsion(&self, tau_wg: f64) -> f64 {
        //= Z15: torsion_wg = sign(tau_wg) (1 - exp(-C_wg |tau_wg|)) / (C_wg K_wg0)
        if self.c_wg > 0.0 {
            let yielded = 1.0 - (-self.c_wg * tau_wg.abs()).exp();
            (yielded / (self.c_wg * self.k_wg0)).copysign(tau_wg)
        } else {
            tau_wg / self.k_wg0
        }
    }

    /// tau: the torque that twists the flexspline by `torsion_fs`, at most `limit`, N·m.
    #[must_use]
    pub fn torque(&self, torsion_fs: f64, limit: f64) -> Saturated {
        self.torque_within(torsion_fs, limit, self.flexspline_torsion(limit))
    }

    /// [`Self::torque`], `torsion_limit` being the flexspline's torsion at `limit`.
    fn torque_within(&self, torsion_fs: f64, limit: f64, torsion_limit: f64) -> Saturated {
        // Compared as torsions: the tangent changes its sign beyond pi/2 and would wrap.
        if torsion_fs.abs() >= torsion_limit {
            return Saturated {
                tau: limit.copysign(torsion_fs),
                saturated: true,
            };
        }
        let tau = if self.c_fs > 0.0 {
            //= Z20: tau = tan(C_fs K_fs0 torsion_fs) / C_fs
            let angle = self.c_fs * self.k_fs0 * torsion_fs;
            debug_assert!(
                angle.abs() < FRAC_PI_2,
                "beyond the tangent's pole: {angle}"
            );
            angle.tan() / self.c_fs
        } else {
            self.k_fs0 * torsion_fs
        };
        Saturated {
            tau: tau.clamp(-limit, limit),
            saturated: false,
        }
    }
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
