//! Wave-generator torque from motor current (Z 21-22 and the cases after).

/// Sign of the motor's friction when the motor brakes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrictionRule {
    /// `tau_wg = tau_m - tau_fm sign(omega)`: physically right.
    #[default]
    Physical,
    /// The rule that Z prints after (22): friction always reduces `|tau_m|`, also when the motor brakes.
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

/// The wave generator's torque and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveGeneratorTorque {
    /// tau_wg: torque on the wave generator, motor side, N·m.
    pub tau_wg: f64,
    /// Half of the interval in which the torque lies while the friction's sign is unknown, motor
    /// side, N·m: zero while the motor turns and drives.
    pub unknown: f64,
}

/// Follows the wave generator's torque over time.
#[derive(Debug, Clone)]
pub struct WaveGenerator {
    parameters: WaveGeneratorParameters,
    /// tau_wg of the last sample, N·m.
    held: f64,
}

impl WaveGenerator {
    /// A wave generator at rest without torque.
    #[must_use]
    pub fn new(parameters: WaveGeneratorParameters) -> Self {
        Self {
            parameters,
            held: 0.0,
        }
    }

    /// Forgets the held torque.
    pub fn reset(&mut self) {
        self.held = 0.0;
    }

    /// One step from current and motor-side velocity.
    ///
    /// `tau_over_n` is the last estimate of the joint torque over the gear ratio: this
    /// step's torque itself depends on the result (an algebraic loop).
    ///
    /// Viscous friction counts as part of tau_fm, which so grows with speed.
    pub fn update(&mut self, current: f64, omega: f64, tau_over_n: f64) -> WaveGeneratorTorque {
        let WaveGeneratorParameters {
            torque_constant,
            friction,
            viscous_friction,
            epsilon,
            rule,
        } = self.parameters;
        //= Z Section III: tau_m = K_t i
        let tau_m = torque_constant * current;
        let tau_fm = friction + viscous_friction * omega.abs();
        //= Z22: tau_wg = tau_m - tau_fm; tau/N where |tau_m| < tau_fm, held where |omega| <= eps
        let (tau_wg, unknown) = if omega.abs() <= epsilon {
            // Below eps it is held: the direction of friction is unknown.
            (self.held, tau_fm)
        } else if tau_m.abs() < tau_fm {
            (tau_over_n, tau_fm)
        } else {
            let direction = match rule {
                FrictionRule::Physical => omega.signum(),
                FrictionRule::Published => tau_m.signum(),
            };
            (tau_m - tau_fm * direction, 0.0)
        };
        if tau_wg.is_finite() {
            self.held = tau_wg;
        }
        WaveGeneratorTorque {
            tau_wg: self.held,
            unknown,
        }
    }
}
