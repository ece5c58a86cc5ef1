//! Friction that is foreseen: a bristle that the desired motion of the rotor bends (Dahl).

/// Parameters of the friction on a rotor, link side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionModel {
    /// Torque at which it slides, N·m; zero: none is foreseen.
    pub level: f64,
    /// Stiffness of the bristles while they stick, N·m/rad.
    pub stiffness: f64,
}

/// Desired ways of the rotor in a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turned {
    /// Asked for by the reference: its torque winds up the gear, and the joint goes with it, rad.
    pub asked: f64,
    /// The rest, by measured motion, rad: feedback that must not feed itself.
    pub unasked: f64,
    /// Share of the level that this velocity certainly has, from -1 to 1.
    pub sliding: f64,
}

impl Turned {
    /// All of it is asked for.
    #[must_use]
    pub fn asked(way: f64) -> Self {
        Self {
            asked: way,
            unasked: 0.0,
            sliding: 0.0,
        }
    }
}

impl FrictionModel {
    /// Friction state of a joint without foreseen friction.
    pub const NONE: Self = Self {
        level: 0.0,
        stiffness: 0.0,
    };

    /// The friction after a period, N·m: `h' = sigma |v| (end - h) / level`, solved exactly, of both ways in turn.
    #[must_use]
    pub fn after(&self, friction: f64, turned: &Turned) -> f64 {
        if self.level <= 0.0 {
            return 0.0;
        }
        let bend = self.stiffness / self.level;
        let bent = |h: f64, way: f64, end: f64| end + (h - end) * (-bend * way.abs()).exp();
        let asked = bent(friction, turned.asked, self.level.copysign(turned.asked));
        bent(asked, turned.unasked, self.level * turned.sliding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRICTION: FrictionModel = FrictionModel {
        level: 8.0,
        stiffness: 60_000.0,
    };

    fn measured(way: f64, sliding: f64) -> Turned {
        Turned {
            asked: 0.0,
            unasked: way,
            sliding,
        }
    }

    /// Friction begins as a spring, ends at its level, and turns round within twice the level.
    #[test]
    fn a_bristle_bends_slides_and_turns_round() {
        let little = 1e-7;
        let spring = FRICTION.after(0.0, &Turned::asked(little)) / little;
        assert!((spring - 60_000.0).abs() < 100.0, "{spring}");
        let sliding = FRICTION.after(0.0, &Turned::asked(0.01));
        assert!((sliding - 8.0).abs() < 1e-9);
        let turned = FRICTION.after(sliding, &Turned::asked(-little));
        assert!(((turned - sliding) / little + 120_000.0).abs() < 200.0);
        assert!((FRICTION.after(sliding, &Turned::asked(-0.01)) + 8.0).abs() < 1e-9);
        assert_eq!(FrictionModel::NONE.after(0.0, &Turned::asked(0.01)), 0.0);
    }

    /// Friction after one long step is that after many short ones.
    #[test]
    fn the_step_is_exact() {
        let (mut h, n) = (3.0, 100);
        for _ in 0..n {
            h = FRICTION.after(h, &Turned::asked(2e-4 / f64::from(n)));
        }
        assert!((h - FRICTION.after(3.0, &Turned::asked(2e-4))).abs() < 1e-9);
    }

    /// A measured motion bends it as far as its velocity is certain, either way; asked motion goes on from there.
    #[test]
    fn a_slow_motion_that_nobody_asked_for_bends_it_a_little() {
        let slow = FRICTION.after(0.0, &measured(0.01, 0.1));
        assert!((slow - 0.8).abs() < 1e-9, "{slow}");
        let fast = FRICTION.after(slow, &measured(0.01, 1.0));
        assert!((fast - 8.0).abs() < 1e-9, "{fast}");
        let stopping = FRICTION.after(fast, &measured(0.01, 0.0));
        assert!(stopping.abs() < 1e-9, "{stopping}");
        let asked = FRICTION.after(slow, &Turned::asked(-0.01));
        assert!((asked + 8.0).abs() < 1e-9, "{asked}");
    }
}
