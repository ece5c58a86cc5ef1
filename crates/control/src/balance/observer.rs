//! Observer: velocities that no floor that gives way can make.
//!
//! Ground gives way under feet, which then turn against the shanks though the body does not move. So velocities follow
//! from what is asked for, corrected by where it is seen.

use nalgebra::SVector;

/// Frequency of the observers of the centre of mass and of the base's rotation, critically damped, rad/s. Chosen on the
/// simulated humanoid: on one foot velocities by the joints alone, low-passed so, made 20 Hz of 40 N·m on a floor that
/// gives way.
pub(crate) const OBSERVES: f64 = 35.0;

/// Observer of an angle or a place whose acceleration is known but for one that lasts (D. G. Luenberger, 1966): three
/// poles in one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observer<const N: usize> {
    pub(super) at: SVector<f64, N>,
    pub(super) rate: SVector<f64, N>,
    /// Acceleration that is not asked for: weight on a slope of torques that err, a push.
    pub(super) disturbance: SVector<f64, N>,
    /// What is asked for in the cycle that comes.
    pub(super) acceleration: SVector<f64, N>,
}

impl<const N: usize> Observer<N> {
    /// A cycle passes, after which it is measured there.
    pub(super) fn update(&mut self, measured: &SVector<f64, N>, dt: f64) {
        let (o, error) = (OBSERVES, measured - self.at);
        self.at += (self.rate + 3.0 * o * error) * dt;
        self.rate += (self.acceleration + self.disturbance + 3.0 * o * o * error) * dt;
        self.disturbance += o * o * o * error * dt;
    }
}
