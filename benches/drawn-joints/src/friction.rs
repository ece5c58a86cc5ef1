//! Friction of the rotor, link side: generalised Maxwell slip (Al-Bender, Lampaert, Swevers, IEEE TAC 2005).
//!
//! An element sticks as a spring until its share of the level `s(v)`; then its torque follows that share with a lag, and
//! it sticks again where the velocity changes its sign. The level falls with velocity (Stribeck), grows with the gear's
//! torque, and depends on direction and position.

/// Dependence of the level on load, direction and position.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Dependence {
    /// Share of the gear's torque.
    pub(crate) load: f64,
    /// More in positive direction, less in negative: share.
    pub(crate) direction: f64,
    /// Shares by the motor's turn and the link's: amplitude, periods in a turn, phase, rad.
    pub(crate) position: [(f64, f64, f64); 2],
}

/// Constants of the friction, link side.
#[derive(Debug, Clone)]
pub(crate) struct Sizes {
    /// N·m.
    pub(crate) coulomb: f64,
    /// Static over Coulomb friction.
    pub(crate) static_ratio: f64,
    /// Velocity over which it falls, rad/s, and the exponent of the fall.
    pub(crate) stribeck: (f64, f64),
    /// N·m·s/rad.
    pub(crate) viscous: f64,
    /// Damping of the elements that stick, N·m·s/rad.
    pub(crate) sticking: f64,
    /// Time in which a slipping element's torque follows its level, s.
    pub(crate) lag: f64,
    pub(crate) dependence: Dependence,
}

#[derive(Debug, Clone, Copy)]
struct Element {
    /// N·m/rad.
    stiffness: f64,
    /// Share of the level; all add up to one.
    share: f64,
    torque: f64,
    slips: bool,
}

/// The friction with its elements.
#[derive(Debug, Clone)]
pub(crate) struct Friction {
    pub(crate) sizes: Sizes,
    elements: Vec<Element>,
    direction: f64,
}

impl Friction {
    /// Elements of these stiffnesses, N·m/rad, and shares.
    pub(crate) fn new(sizes: Sizes, elements: &[(f64, f64)]) -> Self {
        let element = |&(stiffness, share): &(f64, f64)| Element {
            stiffness,
            share,
            torque: 0.0,
            slips: false,
        };
        Self {
            sizes,
            elements: elements.iter().map(element).collect(),
            direction: 0.0,
        }
    }

    /// Number of its elements.
    pub(crate) fn count(&self) -> usize {
        self.elements.len()
    }

    /// Energy that its elements hold at most at a level, J.
    #[cfg(test)]
    pub(crate) fn lent(&self, level: f64) -> f64 {
        let one = |e: &Element| 0.5 * (e.share * level).powi(2) / e.stiffness;
        self.elements.iter().map(one).sum()
    }

    /// Level at velocity `v`, with this torque in the gear, at these angles of motor and link, N·m.
    pub(crate) fn level(&self, v: f64, gear: f64, angles: [f64; 2]) -> f64 {
        let s = &self.sizes;
        let (scale, exponent) = s.stribeck;
        let falls = (-(v.abs() / scale).powf(exponent)).exp();
        let of_position: f64 = (s.dependence.position.iter().zip(angles))
            .map(|((amplitude, periods, phase), angle)| amplitude * (periods * angle + phase).sin())
            .sum();
        let shares = 1.0 + of_position + s.dependence.direction * (v / scale).tanh();
        let sliding = s.coulomb * shares + s.dependence.load * gear.abs();
        sliding * (1.0 + (s.static_ratio - 1.0) * falls)
    }

    /// Torque against a velocity `v` for a step of `dt`, N·m.
    pub(crate) fn advance(&mut self, v: f64, level: f64, dt: f64) -> f64 {
        let turned = v * self.direction < 0.0;
        if v != 0.0 {
            self.direction = v.signum();
        }
        let mut torque = self.sizes.viscous * v;
        let mut sticking = 0.0;
        for element in &mut self.elements {
            element.slips &= !turned;
            let most = element.share * level;
            if element.slips {
                let share = dt / (dt + self.sizes.lag);
                element.torque += share * (most.copysign(v) - element.torque);
            } else {
                element.torque += element.stiffness * v * dt;
                sticking += element.share;
                if element.torque.abs() >= most && element.torque * v > 0.0 {
                    element.torque = most.copysign(v);
                    element.slips = true;
                }
            }
            torque += element.torque;
        }
        torque + sticking * self.sizes.sticking * v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 25e-6;

    fn friction() -> Friction {
        let sizes = Sizes {
            coulomb: 4.0,
            static_ratio: 1.5,
            stribeck: (0.02, 1.0),
            viscous: 2.0,
            sticking: 100.0,
            lag: 2e-3,
            dependence: Dependence {
                load: 0.05,
                direction: 0.1,
                ..Dependence::default()
            },
        };
        Friction::new(sizes, &[(1e5, 0.5), (3e4, 0.3), (1e4, 0.2)])
    }

    /// A rotor of 0.5 kg·m² under a torque that rises within 50 ms: way and velocity after so many seconds.
    fn push(torque: f64, seconds: f64) -> (f64, f64) {
        let mut friction = friction();
        let (mut way, mut v) = (0.0, 0.0);
        for k in 0..(seconds / DT) as usize {
            let rises = (k as f64 * DT / 0.05).min(1.0);
            let level = friction.level(v, 0.0, [0.0; 2]);
            v += DT / 0.5 * (rises * torque - friction.advance(v, level, DT));
            way += DT * v;
        }
        (way, v)
    }

    #[test]
    fn it_holds_at_rest_below_the_static_level_and_slides_above() {
        // Half of the static friction of 6 N·m: bent by 3 N·m over 1.4e5 N·m/rad, and more where elements slip.
        let (one, _) = push(3.0, 1.0);
        let (ten, v) = push(3.0, 10.0);
        assert!((2e-5..2e-4).contains(&one), "{one}");
        assert!(
            (ten - one).abs() < 1e-8 && v.abs() < 1e-7,
            "{one} {ten} {v}"
        );
        let (_, v) = push(8.0, 20.0);
        // Coulomb friction, a tenth more in this direction, and 2 N·m·s/rad.
        assert!((v - (8.0 - 4.4) / 2.0).abs() < 0.02, "{v}");
    }

    #[test]
    fn it_falls_with_velocity_and_grows_with_load() {
        let friction = friction();
        let level = |v: f64, gear: f64| friction.level(v, gear, [0.0; 2]);
        assert!((level(0.0, 0.0) - 6.0).abs() < 1e-12);
        assert!((level(1.0, 0.0) - 4.4).abs() < 1e-6);
        assert!((level(-1.0, 0.0) - 3.6).abs() < 1e-6);
        assert!((level(1.0, -100.0) - 9.4).abs() < 1e-6);
    }

    #[test]
    fn motion_to_and_fro_loses_energy_whatever_its_way() {
        for amplitude in [2e-6, 2e-5, 2e-4, 2e-2] {
            let mut friction = friction();
            let mut work = 0.0;
            let w = 6.0;
            for k in 0..(3.0 / DT) as usize {
                let v = amplitude * w * (w * k as f64 * DT).cos();
                let level = friction.level(v, 0.0, [0.0; 2]);
                let power = friction.advance(v, level, DT) * v;
                work += power * DT;
            }
            assert!(work > 0.0, "{amplitude}: {work}");
        }
    }
}
