//! Friction with stiction: a bristle that bends before it slides (LuGre).

/// A bristle: it sticks like a spring and slides at a level that the caller sets step by step.
#[derive(Debug, Clone, Default)]
pub struct Bristle {
    /// z: bend, rad.
    bend: f64,
}

/// Constants of a bristle.
#[derive(Debug, Clone, Copy)]
pub struct BristleConstants {
    /// sigma_0: stiffness while it sticks, N·m/rad.
    pub stiffness: f64,
    /// sigma_1: damping of the bend, N·m·s/rad.
    pub damping: f64,
    /// sigma_2: viscous friction, N·m·s/rad.
    pub viscous: f64,
}

impl Bristle {
    /// Friction torque after a step of `dt` at velocity `v`, and its slope in `v`: the implicit
    /// step that follows uses both.
    #[must_use]
    pub fn torque(&self, c: &BristleConstants, level: f64, v: f64, dt: f64) -> (f64, f64) {
        let soften = 1.0 / (1.0 + dt * c.stiffness * v.abs() / level);
        let bend = (self.bend + dt * v) * soften;
        (
            c.stiffness * bend + c.damping * (bend - self.bend) / dt + c.viscous * v,
            (c.stiffness * dt + c.damping) * soften + c.viscous,
        )
    }

    /// Advances the bend with the velocity at the end of the step.
    pub fn advance(&mut self, c: &BristleConstants, level: f64, v: f64, dt: f64) {
        self.bend = (self.bend + dt * v) / (1.0 + dt * c.stiffness * v.abs() / level);
    }
}

/// Sliding friction that falls from static to Coulomb as motion sets in (Stribeck).
#[must_use]
pub fn stribeck(coulomb: f64, stiction: f64, velocity: f64, scale: f64) -> f64 {
    let x = velocity / scale;
    coulomb + (stiction - coulomb) * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: BristleConstants = BristleConstants {
        stiffness: 10.0,
        damping: 1e-3,
        viscous: 1e-5,
    };
    const DT: f64 = 1e-4;

    /// A rotor of 1e-5 kg·m² under a torque that rises for a tenth of a second, then stays.
    fn push(torque: f64, seconds: f64) -> (f64, f64) {
        let (mut bristle, mut angle, mut omega) = (Bristle::default(), 0.0, 0.0);
        for k in 0..(seconds / DT) as usize {
            let torque = torque * (10.0 * k as f64 * DT).min(1.0);
            let level = stribeck(0.02, 0.025, omega, 0.5);
            let (friction, slope) = bristle.torque(&C, level, omega, DT);
            let alpha = (torque - friction) / (1e-5 + DT * slope);
            omega += DT * alpha;
            angle += DT * omega;
            bristle.advance(&C, level, omega, DT);
        }
        (angle, omega)
    }

    #[test]
    fn sticks_below_stiction_without_creeping_and_slides_above() {
        let (one_second, omega) = push(0.021, 1.0);
        let (ten_seconds, _) = push(0.021, 10.0);
        assert!(omega.abs() < 1e-9, "{omega}");
        assert!((ten_seconds - one_second).abs() < 1e-9);
        // It bends by 0.0021 and gives way a little while it does.
        assert!((0.0021..0.01).contains(&one_second), "{one_second}");
        let (_, omega) = push(0.026, 1.0);
        assert!(omega > 1.0);
    }

    #[test]
    fn slides_at_coulomb_plus_viscous_level() {
        let (_, omega) = push(0.03, 20.0);
        assert!((omega - 0.01 / 1e-5).abs() < 5.0, "{omega}");
    }
}
