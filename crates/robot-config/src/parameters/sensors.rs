//! Parameters of F/T sensors and IMUs.

use crate::sampling::Sampling;
use control::Sole;
use supervisor::SignalParameters;
use whole_body::{FtConditioning, LastingErrors};

/// Place and noise of an F/T sensor, for the whole-body estimator.
#[derive(Debug, Clone, PartialEq)]
pub struct FtSensor {
    /// The sensor's name.
    pub name: String,
    /// The link in whose frame it measures; it and all beyond it is the end-effector.
    pub frame: String,
    /// The link beyond the sensor that the environment touches; the sensor's own if none is
    /// named.
    pub contact_link: Option<String>,
    /// Standard deviation of each force axis of a sample, N.
    pub sigma_force: f64,
    /// Standard deviation of each torque axis of a sample, N·m.
    pub sigma_torque: f64,
    /// Errors that last.
    pub lasting: LastingErrors,
}

/// One F/T sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct FtParameters {
    /// Place and noise; the standard deviations are those of single samples.
    pub sensor: FtSensor,
    /// Index of its bus.
    pub bus: usize,
    /// Sampling of its signals.
    pub sampling: Sampling,
    /// From the raw signals to the wrench that the part beyond applies to the part before; includes
    /// the sign.
    pub conditioning: FtConditioning,
    /// Range and noise of its signals: force x y z, torque x y z.
    pub signals: Vec<SignalParameters>,
    /// The sole beyond the sensor, of a foot on which the robot may be asked to stand.
    pub sole: Option<Sole>,
    /// True if the sensor sends a temperature.
    pub has_temperature: bool,
}

impl FtParameters {
    /// Greatest |force| and |torque| along each axis that the sensor can measure, by its signals' ranges and its
    /// calibration, N and N·m; infinite for signals that have no range.
    #[must_use]
    pub fn reach(&self) -> [f64; 6] {
        let ends = |signal: usize| {
            let ends = self.signals.get(signal);
            ends.map_or(f64::INFINITY, |s| s.min.abs().max(s.max.abs()))
        };
        self.conditioning.calibration.map(|row| {
            let used = row.iter().enumerate().filter(|(_, gain)| **gain != 0.0);
            used.map(|(signal, gain)| gain.abs() * ends(signal)).sum()
        })
    }
}

/// An IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuParameters {
    /// The link in whose frame it measures.
    pub frame: String,
    /// Index of its bus.
    pub bus: usize,
    /// Sampling of its signals.
    pub sampling: Sampling,
    /// Standard deviation of a sample of each gyro axis, rad/s.
    pub sigma_gyro: f64,
    /// Standard deviation of a sample of each accelerometer axis, m/s².
    pub sigma_accelerometer: f64,
    /// Range and noise of its signals: gyro x y z, accelerometer x y z.
    pub signals: Vec<SignalParameters>,
    /// Of an IMU beside the first one: mean difference from the motion that the first one shows, carried over
    /// by the joints, beyond which they disagree: of the angular velocity, rad/s, and of the acceleration, m/s².
    pub disagreement: [f64; 2],
}
