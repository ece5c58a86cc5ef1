//! Friction that is foreseen: a bristle that the desired motion of the rotor bends (Dahl).

/// What is known of the friction on a rotor, link side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionModel {
    /// Torque at which it slides, N·m; zero: none is foreseen.
    pub level: f64,
    /// Stiffness of the bristles while they stick, N·m/rad.
    pub stiffness: f64,
}

impl FrictionModel {
    /// No friction is foreseen.
    pub const NONE: Self = Self {
        level: 0.0,
        stiffness: 0.0,
    };

    /// The friction after the rotor went on by `turned` (rad), N·m:
    /// `h' = sigma omega (1 - h sign(omega) / level)`, solved exactly.
    #[must_use]
    pub fn after(&self, friction: f64, turned: f64) -> f64 {
        if self.level <= 0.0 {
            return 0.0;
        }
        let end = self.level.copysign(turned);
        end + (friction - end) * (-self.stiffness * turned.abs() / self.level).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRICTION: FrictionModel = FrictionModel {
        level: 8.0,
        stiffness: 60_000.0,
    };

    /// It begins as a spring, ends at its level, and turns round within twice the level.
    #[test]
    fn a_bristle_bends_slides_and_turns_round() {
        let little = 1e-7;
        let spring = FRICTION.after(0.0, little) / little;
        assert!((spring - 60_000.0).abs() < 100.0, "{spring}");
        let sliding = FRICTION.after(0.0, 0.01);
        assert!((sliding - 8.0).abs() < 1e-9);
        let turned = FRICTION.after(sliding, -little);
        assert!(((turned - sliding) / little + 120_000.0).abs() < 200.0);
        assert!((FRICTION.after(sliding, -0.01) + 8.0).abs() < 1e-9);
        assert_eq!(FrictionModel::NONE.after(0.0, 0.01), 0.0);
    }

    /// One step or many: the same.
    #[test]
    fn the_step_is_exact() {
        let (mut h, n) = (3.0, 100);
        for _ in 0..n {
            h = FRICTION.after(h, 2e-4 / f64::from(n));
        }
        assert!((h - FRICTION.after(3.0, 2e-4)).abs() < 1e-9);
    }
}
