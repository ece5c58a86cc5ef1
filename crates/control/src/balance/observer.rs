//! Observer: velocities that no floor that gives way can make.
//!
//! Ground gives way under feet, which then turn against the shanks though the body does not move. So velocities follow
//! from what is asked for, corrected by where it is seen.

use nalgebra::SVector;

/// Frequency of the three poles, rad/s. Chosen on the simulated humanoid: velocities by the joints alone, low-passed by 50
/// rad/s, made the ankle ring by 40 N·m at 20 Hz on a floor that gives way.
pub(crate) const OBSERVES: f64 = 35.0;
/// Frequency of the three poles on one foot, rad/s: it rolls on the floor by itself, which joints show as motion of the body
/// where no gyroscope shows the roll. Chosen on the simulated humanoid, on whose floor a foot rolls by 1 rad for 2 to 3 kN·m.
/// Without a gyroscope the ankle goes on swinging by 16 N·m at 12 Hz with 12 rad/s, the hip with 35, neither with 10.
pub(super) const OBSERVES_ON_ONE_FOOT: f64 = 10.0;

/// Observer of an angle or a place whose acceleration is known but for one that lasts (D. G. Luenberger, 1966): three
/// poles in one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observer<const N: usize> {
    pub(super) at: SVector<f64, N>,
    pub(super) rate: SVector<f64, N>,
    /// Acceleration that nobody asks for, of torques that err or of a push.
    pub(super) disturbance: SVector<f64, N>,
    /// Acceleration that is asked for in the next cycle.
    pub(super) acceleration: SVector<f64, N>,
}

impl<const N: usize> Observer<N> {
    /// A cycle passes, after which it is measured there; `o`: frequency of the three poles, rad/s.
    pub(super) fn update(&mut self, measured: &SVector<f64, N>, o: f64, dt: f64) {
        let error = measured - self.at;
        self.at += (self.rate + 3.0 * o * error) * dt;
        self.rate += (self.acceleration + self.disturbance + 3.0 * o * o * error) * dt;
        self.disturbance += o * o * o * error * dt;
    }
}
