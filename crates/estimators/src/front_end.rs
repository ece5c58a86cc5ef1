//! From one joint's raw readings to the sample that every estimator takes.

use crate::encoder::{EncoderParameters, JointEncoders};
use crate::filter_bank::FilterBank;
use crate::joint::JointSample;
use crate::savitzky_golay::SavitzkyGolayParameters;
use problem::Problem;
use robot_state::measured_flags;

/// Encoders, skew and velocities of one joint.
#[derive(Debug, Clone)]
pub struct FrontEnd {
    encoders: JointEncoders,
    velocity: FilterBank,
    current: f64,
    sample_period: f64,
}

impl FrontEnd {
    /// Velocities come from straight lines through `velocity_window` samples.
    ///
    /// # Errors
    /// A window or sample period that is not allowed.
    pub fn new(parameters: EncoderParameters, velocity_window: usize) -> Result<Self, Problem> {
        let filter =
            SavitzkyGolayParameters::centred(velocity_window, 1, 1, parameters.sample_period);
        Ok(Self {
            encoders: JointEncoders::new(parameters),
            velocity: FilterBank::new(2, filter)?,
            current: 0.0,
            sample_period: parameters.sample_period,
        })
    }

    /// Takes one reading of each; NaN where there is none.
    pub fn update(&mut self, theta: f64, q: f64, current: f64) -> JointSample {
        let angles = self.encoders.update(theta, q);
        let mut flags = angles.flags;
        if current.is_finite() {
            self.current = current;
        } else {
            flags |= measured_flags::MISSED;
        }
        let fresh = angles.flags == 0;
        let or_nan = |x: f64| if fresh { x } else { f64::NAN };
        self.velocity
            .update(&[or_nan(angles.aligned_theta), or_nan(angles.aligned_q)]);
        let rates = self.velocity.first_derivatives();
        JointSample {
            q: angles.aligned_q,
            theta: angles.aligned_theta,
            dq: rates[1],
            omega: rates[0],
            current: self.current,
            flags,
        }
    }

    /// Tells the filters of the samples that a log lacks between `last` and `now`, s; before the
    /// first sample there is no last.
    pub fn bridge(&mut self, last: Option<f64>, now: f64) {
        /// A longer gap than this is filled no further: the filters hold by then.
        const MOST: f64 = 10_000.0;
        let missing = last.map_or(0.0, |last| {
            ((now - last) / self.sample_period).round() - 1.0
        });
        for _ in 0..missing.clamp(0.0, MOST) as usize {
            self.update(f64::NAN, f64::NAN, f64::NAN);
        }
    }

    /// How late the velocities are, s.
    #[must_use]
    pub fn velocity_delay_s(&self) -> f64 {
        self.velocity.delay_s()
    }

    /// Forgets every reading.
    pub fn reset(&mut self) {
        self.encoders.reset();
        self.velocity.reset();
        self.current = 0.0;
    }
}
