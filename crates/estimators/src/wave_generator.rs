//! Placeholder: wave-generator torque from motor current (Z 21-22).

/// Which sign the motor's friction has when the motor brakes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrictionRule {
    /// `tau_wg = tau_m - tau_fm sign(omega)`: physically right.
    #[default]
    Physical,
    /// As printed in Z after 22.
    Published,
}

/// Motor parameters that lead from current to wave-generator torque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveGeneratorParameters {
    /// K_t: torque constant, motor side, N·m/A.
    pub torque_constant: f64,
    /// tau_fm: motor friction, motor side, N·m.
    pub friction: f64,
    /// B_m: viscous motor friction, motor side, N·m·s/rad.
    pub viscous_friction: f64,
    /// eps: velocity below which the torque is held, motor side, rad/s.
    pub epsilon: f64,
    /// Sign convention for friction when braking.
    pub rule: FrictionRule,
}
