//! Piecewise deformation model (S II): five straight segments, a polynomial in the current, and three
//! harmonics of each angle.
//!
//! S fits the coefficients segment by segment and then has to choose a segment at run time. Here
//! all segments share one `h` and are continuous (S10), so with stiffnesses above zero the inverse is
//! unique.

use crate::joint::{JointSample, JointTorqueEstimator};
use crate::low_pass::LowPass;
use crate::output::Output;
use robot_state::{TorqueEstimate, torque_source};

/// Segments of the flexspline's curve.
pub const SEGMENTS: usize = 5;
/// Order of the polynomial in the current.
pub const CURRENT_ORDER: usize = 6;
/// Harmonics of each angle.
pub const HARMONICS: usize = 3;
/// All coefficients, in the order of [`regressor`].
pub const COEFFICIENTS: usize = SEGMENTS + 1 + CURRENT_ORDER + 4 * HARMONICS;

/// Factor of the angles in S9.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AngularFrequency {
    /// A constant spatial frequency of 1, as in Z.
    #[default]
    Spatial,
    /// The measured velocity, as printed in S 13-14.
    Published,
}

/// Coefficients of S10.
#[derive(Debug, Clone, PartialEq)]
pub struct DeformationParameters {
    /// tau_0: rated torque, N·m; the segments' breaks are at thirds of it.
    pub rated_torque: f64,
    /// k1..k5 (rad/(N·m)), k_0 (rad), current coefficients, a_n b_n c_n d_n (rad), as in [`regressor`].
    pub coefficients: [f64; COEFFICIENTS],
    /// Meaning of the frequency in S9.
    pub frequency: AngularFrequency,
    /// Largest |i| of the training data, A: beyond it the polynomial is held.
    pub current_limit: f64,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Pole of the torque's low-pass, 0 to below 1.
    pub low_pass_pole: f64,
    /// Standard deviation of the torsion that the model leaves, rad; identified.
    pub torsion_sigma: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Torsion carried by each segment's reciprocal stiffness at torque `tau` (S7), N·m.
///
/// k1 counts in the middle, k2 and k3 on the negative, k4 and k5 on the positive side.
#[must_use]
pub fn segment_shares(tau: f64, rated_torque: f64) -> [f64; SEGMENTS] {
    let third = rated_torque / 3.0;
    //= S7: torsion_fs = sum_n k_n share_n(tau), breaks at thirds of tau_0
    [
        tau.clamp(-third, third),
        (tau + third).clamp(-third, 0.0),
        (tau + 2.0 * third).min(0.0),
        (tau - third).clamp(0.0, third),
        (tau - 2.0 * third).max(0.0),
    ]
}

/// The row of S15's matrix that belongs to a sample with torque `tau`.
#[must_use]
pub fn regressor(
    sample: &JointSample,
    tau: f64,
    rated_torque: f64,
    gear_ratio: f64,
    frequency: AngularFrequency,
) -> [f64; COEFFICIENTS] {
    let mut row = [0.0; COEFFICIENTS];
    let (segments, rest) = row.split_at_mut(SEGMENTS);
    segments.copy_from_slice(&segment_shares(tau, rated_torque));
    let (constant, rest) = rest.split_at_mut(1);
    constant[0] = 1.0;
    let (powers, harmonics) = rest.split_at_mut(CURRENT_ORDER);
    //= S8, S10: torsion_wg / N = (1/N) sum_n w_n i^n, n = 1..6
    let mut power = 1.0 / gear_ratio;
    for p in powers {
        power *= sample.current;
        *p = power;
    }
    let (w_link, w_motor) = match frequency {
        AngularFrequency::Spatial => (1.0, 1.0),
        AngularFrequency::Published => (sample.dq, sample.omega),
    };
    //= S9: err = a_0 + sum_n a_n cos(n w_l q) + b_n sin(n w_l q)
    //=     + c_n cos(n w_w theta) + d_n sin(n w_w theta)
    let ((sl, cl), (sm, cm)) = (
        (sample.q * w_link).sin_cos(),
        (sample.theta * w_motor).sin_cos(),
    );
    let (mut link, mut motor) = ((sl, cl), (sm, cm));
    for h in harmonics.chunks_exact_mut(4) {
        h.copy_from_slice(&[link.1, link.0, motor.1, motor.0]);
        link = (link.0 * cl + link.1 * sl, link.1 * cl - link.0 * sl);
        motor = (motor.0 * cm + motor.1 * sm, motor.1 * cm - motor.0 * sm);
    }
    row
}

impl DeformationParameters {
    /// The flexspline's torsion at torque `tau` (S7), rad.
    #[must_use]
    pub fn flexspline_torsion(&self, tau: f64) -> f64 {
        let shares = segment_shares(tau, self.rated_torque);
        shares
            .iter()
            .zip(&self.coefficients)
            .map(|(share, k)| share * k)
            .sum()
    }

    /// The torque at a torsion of the flexspline, N·m, and the reciprocal stiffness there (S27).
    #[must_use]
    pub fn torque(&self, torsion_fs: f64) -> (f64, f64) {
        let third = self.rated_torque / 3.0;
        let k = |i: usize| self.coefficients[i].max(f64::MIN_POSITIVE);
        let side = if torsion_fs < 0.0 {
            [k(0), k(1), k(2)]
        } else {
            [k(0), k(3), k(4)]
        };
        let torsion = torsion_fs.abs();
        //= S27: tau = (torsion_fs - breaks of the inner segments) / k_n + their torque
        let (first, second) = (side[0] * third, (side[0] + side[1]) * third);
        let (tau, k) = if torsion < first {
            (torsion / side[0], side[0])
        } else if torsion < second {
            (third + (torsion - first) / side[1], side[1])
        } else {
            (2.0 * third + (torsion - second) / side[2], side[2])
        };
        (tau.copysign(torsion_fs), k)
    }
}

/// S's model as an estimator.
#[derive(Debug, Clone)]
pub struct DeformationEstimator {
    parameters: DeformationParameters,
    low_pass: LowPass,
    output: Output,
}

impl DeformationEstimator {
    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: DeformationParameters) -> Self {
        let low_pass = LowPass::new(parameters.low_pass_pole);
        let delay_s = low_pass.delay_samples() * parameters.sample_period;
        let output = Output::new(torque_source::ENCODER, parameters.torque_limit, delay_s);
        Self {
            parameters,
            low_pass,
            output,
        }
    }
}

impl JointTorqueEstimator for DeformationEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            return self.output.held();
        }
        let p = &self.parameters;
        let current = sample.current.clamp(-p.current_limit, p.current_limit);
        let bounded = JointSample { current, ..*sample };
        let row = regressor(&bounded, 0.0, p.rated_torque, p.gear_ratio, p.frequency);
        //= S26: torsion_fs = torsion - err - k_0 - (1/N) sum_n w_n i^n
        let h: f64 = row.iter().zip(&p.coefficients).map(|(a, x)| a * x).sum();
        let torsion_fs = sample.theta / p.gear_ratio - sample.q - h;
        let (tau, k) = p.torque(torsion_fs);
        if !tau.is_finite() {
            return self.output.held();
        }
        let tau = self
            .low_pass
            .update(tau.clamp(-p.torque_limit, p.torque_limit));
        self.output
            .give(sample, tau, (p.torsion_sigma / k).min(p.torque_limit))
    }

    fn reset(&mut self) {
        self.low_pass.reset();
        self.output.reset();
    }
}
