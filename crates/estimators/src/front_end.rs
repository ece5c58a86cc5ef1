//! From one joint's raw readings to the sample that every estimator takes.
//!
//! Fits, evaluation and the loop all build samples here, so that an estimator runs on samples made
//! as those that it was fitted to. A joint without a joint file has no window for its velocities:
//! there the loop takes those of its control filter, which makes up for the ages of the readings.

use crate::encoder::{EncoderParameters, JointAngles, JointEncoders};
use crate::filter_bank::FilterBank;
use crate::joint::JointSample;
use crate::savitzky_golay::SavitzkyGolayParameters;
use problem::Problem;
use robot_state::measured_flags;

/// Encoders, skew and velocities of one joint.
#[derive(Debug, Clone)]
pub struct FrontEnd {
    encoders: JointEncoders,
    /// theta and q: first derivative; none where velocities come from elsewhere.
    velocity: Option<FilterBank>,
    current: f64,
    sample_period: f64,
}

impl FrontEnd {
    /// Velocities are the slopes of straight lines through `velocity_window` samples; without a
    /// window they are left at zero, for the caller to fill in.
    ///
    /// # Errors
    /// A window or sample period that is not allowed.
    pub fn new(
        parameters: EncoderParameters,
        velocity_window: Option<usize>,
    ) -> Result<Self, Problem> {
        let bank = |window| {
            let filter = SavitzkyGolayParameters::centred(window, 1, 1, parameters.sample_period);
            FilterBank::new(2, filter)
        };
        Ok(Self {
            encoders: JointEncoders::new(parameters),
            velocity: velocity_window.map(bank).transpose()?,
            current: 0.0,
            sample_period: parameters.sample_period,
        })
    }

    /// Of a joint whose only encoder is the motor's. It has no velocities of its own.
    #[must_use]
    pub fn of_motor(parameters: EncoderParameters) -> Self {
        Self {
            encoders: JointEncoders::of_motor(parameters),
            velocity: None,
            current: 0.0,
            sample_period: parameters.sample_period,
        }
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
        let (omega, dq) = self.velocity.as_mut().map_or((0.0, 0.0), |velocity| {
            velocity.update(&[or_nan(angles.aligned_theta), or_nan(angles.aligned_q)]);
            let rates = velocity.first_derivatives();
            (rates[0], rates[1])
        });
        JointSample {
            q: angles.aligned_q,
            theta: angles.aligned_theta,
            dq,
            omega,
            current: self.current,
            feed_forward: None,
            flags,
        }
    }

    /// Takes the samples that a log lacks between `last` and `now`, s, as missed; before the first
    /// sample there is no last.
    pub fn bridge(&mut self, last: Option<f64>, now: f64) {
        /// Missed samples after which every filter holds, with a wide margin.
        const MAX_MISSED: f64 = 10_000.0;
        let missing = last.map_or(0.0, |last| {
            ((now - last) / self.sample_period).round() - 1.0
        });
        for _ in 0..missing.clamp(0.0, MAX_MISSED) as usize {
            self.update(f64::NAN, f64::NAN, f64::NAN);
        }
    }

    /// Whether samples have velocities of their own.
    #[must_use]
    pub fn has_velocities(&self) -> bool {
        self.velocity.is_some()
    }

    /// The angles after the last readings.
    #[must_use]
    pub fn angles(&self) -> &JointAngles {
        self.encoders.angles()
    }

    /// theta and q, rad, as they were read last, also where they jumped.
    #[must_use]
    pub fn read(&self) -> [f64; 2] {
        self.encoders.read()
    }

    /// The last reading of one encoder jumped to where the one before had.
    #[must_use]
    pub fn stays_elsewhere(&self) -> bool {
        self.encoders.stays_elsewhere()
    }

    /// Forgets every reading.
    pub fn reset(&mut self) {
        self.encoders.reset();
        if let Some(velocity) = &mut self.velocity {
            velocity.reset();
        }
        self.current = 0.0;
    }
}
