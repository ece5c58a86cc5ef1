//! Laws of gears and friction that differ in structure: neither the estimators nor the project's plant
//! have them in this form.
//!
//! A run prescribes the torque that the gear carries; the law determines the torsion. All laws
//! are rate-independent and advance by exact steps, so that they need no integration.

use crate::random::Draw;

/// Elastic torque against torsion, both relative: torque in units of the rated one, torsion in
/// units of the linear gear's at rated torque.
#[derive(Debug, Clone, Copy)]
pub enum Compliance {
    /// `x = atan(c t)/c`: stiffens without bound (Z 10).
    Arctangent {
        /// c.
        c: f64,
    },
    /// `t = x (1 + b x²)`.
    Cubic {
        /// b.
        b: f64,
    },
    /// Three stiffnesses, as data sheets print them.
    Piecewise {
        /// Torques at which the stiffness changes.
        breaks: [f64; 2],
        /// Stiffnesses.
        slopes: [f64; 3],
    },
}

impl Compliance {
    /// Torsion that carries torque `t`.
    fn torsion(self, t: f64) -> f64 {
        match self {
            Self::Arctangent { c } => (c * t).atan() / c,
            Self::Cubic { b } => {
                let mut x = t / (1.0 + b);
                for _ in 0..30 {
                    let error = x * (1.0 + b * x * x) - t;
                    x -= error / (1.0 + 3.0 * b * x * x);
                }
                x
            }
            Self::Piecewise { breaks, slopes } => {
                let size = t.abs();
                let [first, second] = breaks;
                let x = size.min(first) / slopes[0]
                    + (size.min(second) - first).max(0.0) / slopes[1]
                    + (size - second).max(0.0) / slopes[2];
                x.copysign(t)
            }
        }
    }

    /// Torque at torsion `x`.
    fn torque(self, x: f64) -> f64 {
        match self {
            // The tangent's pole is far outside of what a run reaches; beyond it the line goes on.
            Self::Arctangent { c } => {
                let y = (c * x).clamp(-1.4, 1.4);
                (y.tan() + (c * x - y) * (1.0 + y.tan().powi(2))) / c
            }
            Self::Cubic { b } => x * (1.0 + b * x * x),
            Self::Piecewise { breaks, slopes } => {
                let [first, second] = [
                    breaks[0] / slopes[0],
                    breaks[0] / slopes[0] + (breaks[1] - breaks[0]) / slopes[1],
                ];
                let size = x.abs();
                let t = size.min(first) * slopes[0]
                    + (size.min(second) - first).max(0.0) * slopes[1]
                    + (size - second).max(0.0) * slopes[2];
                t.copysign(x)
            }
        }
    }
}

/// Hysteresis between torque and torsion, with its state.
#[derive(Debug, Clone)]
pub enum Hysteresis {
    /// Springs that slip: (stiffness, limit of stretch, stretch).
    MaxwellSlip(Vec<[f64; 3]>),
    /// `dz = sigma dx (1 - sign(dx) z/level)`.
    Dahl {
        /// sigma.
        sigma: f64,
        /// Largest torque.
        level: f64,
        /// z.
        z: f64,
    },
    /// `dz = sigma (dx - |dx| z |z|^(n-1) (beta + gamma sign(z dx)) / level^n)`.
    BoucWen {
        /// sigma.
        sigma: f64,
        /// Largest torque.
        level: f64,
        /// n.
        n: f64,
        /// beta; gamma is the rest to 1.
        beta: f64,
        /// z.
        z: f64,
    },
    /// Plays of the torque in the torsion (Prandtl, Ishlinskii): (weight, half width, play).
    Plays(Vec<[f64; 3]>),
}

impl Hysteresis {
    /// Torque after a move of `dx`, without advancing.
    fn torque(&self, dx: f64) -> f64 {
        match self {
            Self::MaxwellSlip(springs) => (springs.iter())
                .map(|[k, limit, s]| k * (s + dx).clamp(-limit, *limit))
                .sum(),
            Self::Dahl { sigma, level, z } => {
                let end = level.copysign(dx);
                end + (z - end) * (-sigma * dx.abs() / level).exp()
            }
            Self::BoucWen {
                sigma,
                level,
                n,
                beta,
                z,
            } => {
                const STEPS: usize = 4;
                let (mut z, step) = (*z, dx / STEPS as f64);
                for _ in 0..STEPS {
                    let slope = |z: f64| {
                        let with = beta + (1.0 - beta) * (z * dx).signum();
                        sigma * (1.0 - dx.signum() * z.signum() * (z / level).abs().powf(*n) * with)
                    };
                    let middle = z + 0.5 * step * slope(z);
                    z = (z + step * slope(middle)).clamp(-level, *level);
                }
                z
            }
            Self::Plays(_) => 0.0,
        }
    }

    fn advance(&mut self, dx: f64) {
        let after = self.torque(dx);
        match self {
            Self::MaxwellSlip(springs) => springs
                .iter_mut()
                .for_each(|[_, limit, s]| *s = (*s + dx).clamp(-*limit, *limit)),
            Self::Dahl { z, .. } | Self::BoucWen { z, .. } => *z = after,
            Self::Plays(_) => (),
        }
    }
}

/// A gear: elastic part and hysteresis.
#[derive(Debug, Clone)]
pub struct Gear {
    /// The elastic part.
    pub compliance: Compliance,
    /// The hysteresis.
    pub hysteresis: Hysteresis,
    x: f64,
}

impl Gear {
    /// A gear without load.
    #[must_use]
    pub fn new(compliance: Compliance, hysteresis: Hysteresis) -> Self {
        Self {
            compliance,
            hysteresis,
            x: 0.0,
        }
    }

    /// Torsion after the torque has gone to `t` in one step; both relative.
    pub fn load(&mut self, t: f64) -> f64 {
        if let Hysteresis::Plays(plays) = &mut self.hysteresis {
            let mut x = self.compliance.torsion(t);
            for [weight, half, play] in plays {
                *play = play.clamp(t - *half, t + *half);
                x += *weight * *play;
            }
            self.x = x;
            return x;
        }
        // The torque rises with the torsion: bisection within a bracket around the last one.
        let (compliance, hysteresis, last) = (self.compliance, &self.hysteresis, self.x);
        let error = |x: f64| compliance.torque(x) + hysteresis.torque(x - last) - t;
        let mut width = 1e-3;
        let (mut low, mut high) = (last, last);
        while error(low) > 0.0 {
            low -= width;
            width *= 2.0;
        }
        while error(high) < 0.0 {
            high += width;
            width *= 2.0;
        }
        while high - low > 1e-9 {
            let middle = 0.5 * (low + high);
            if error(middle) > 0.0 {
                high = middle
            } else {
                low = middle
            }
        }
        let x = 0.5 * (low + high);
        self.hysteresis.advance(x - last);
        self.x = x;
        x
    }
}

/// Friction of motor and wave generator, link side, in units of the rated torque.
#[derive(Debug, Clone)]
pub enum Friction {
    /// A bristle that bends and slides (LuGre): states in rad of the motor.
    LuGre {
        /// Bend at which it slides, rad.
        bend: f64,
        /// Static over Coulomb friction.
        stiction: f64,
        /// Stribeck's velocity, rad/s.
        speed: f64,
        /// Present bend, relative.
        z: f64,
    },
    /// A spring that slips, its limit by Stribeck's exponential of the speed.
    Stribeck {
        /// Stretch at which it slips, rad.
        stretch: f64,
        /// Static over Coulomb friction.
        stiction: f64,
        /// Stribeck's velocity, rad/s.
        speed: f64,
        /// Present stretch, relative.
        z: f64,
    },
    /// Springs that slip at several stretches, their level by the load, with a power law of the speed.
    Load {
        /// Stretches, rad.
        stretches: [f64; 3],
        /// Friction per torque carried.
        meshing: f64,
        /// Exponent of the speed in the viscous part.
        exponent: f64,
        /// Present stretches, rad.
        z: [f64; 3],
    },
}

impl Friction {
    /// Friction after the motor has moved by `dtheta` at `omega`, the gear carrying `t`; `coulomb` and
    /// `viscous` (at 200 rad/s) in units of the rated torque.
    pub fn advance(&mut self, dtheta: f64, omega: f64, t: f64, coulomb: f64, viscous: f64) -> f64 {
        let relative = omega / 200.0;
        let falling = |stiction: f64, speed: f64| {
            1.0 + (stiction - 1.0) * (-(omega / speed) * (omega / speed)).exp()
        };
        match self {
            Self::LuGre {
                bend,
                stiction,
                speed,
                z,
            } => {
                let level = falling(*stiction, *speed);
                let end = level.copysign(dtheta);
                *z = end + (*z - end) * (-dtheta.abs() / (*bend * level)).exp();
                coulomb * *z + viscous * relative
            }
            Self::Stribeck {
                stretch,
                stiction,
                speed,
                z,
            } => {
                let level = falling(*stiction, *speed);
                *z = (*z + dtheta / *stretch).clamp(-level, level);
                coulomb * *z + viscous * relative
            }
            Self::Load {
                stretches,
                meshing,
                exponent,
                z,
            } => {
                let mut sum = 0.0;
                for (z, stretch) in z.iter_mut().zip(*stretches) {
                    *z = (*z + dtheta).clamp(-stretch, stretch);
                    sum += *z / stretch / 3.0;
                }
                let speed = relative.abs().powf(*exponent).copysign(relative);
                (coulomb + *meshing * t.abs()) * sum + viscous * speed
            }
        }
    }
}

/// Kinds of each law: their product is the number of structures.
pub const KINDS: [usize; 3] = [3, 4, 3];
/// Their names, for the page.
pub const NAMES: [[&str; 4]; 3] = [
    ["arctangent", "cubic", "piecewise", ""],
    ["Maxwell slip", "Dahl", "Bouc-Wen", "Prandtl-Ishlinskii"],
    ["LuGre", "Stribeck", "load-dependent", ""],
];

/// A compliance of the given kind.
#[must_use]
pub fn compliance(kind: usize, draw: &mut Draw) -> Compliance {
    match kind {
        0 => Compliance::Arctangent {
            c: draw.within(0.3, 1.0),
        },
        1 => Compliance::Cubic {
            b: draw.within(0.05, 0.5),
        },
        _ => {
            let first = draw.within(0.6, 0.9);
            let second = draw.within(0.95, 1.2);
            Compliance::Piecewise {
                breaks: [draw.within(0.1, 0.3), draw.within(0.5, 0.8)],
                slopes: [first, second, second * draw.within(1.0, 1.2)],
            }
        }
    }
}

/// A hysteresis of the given kind, of about 0.8 to 4 % of the rated torque.
#[must_use]
pub fn hysteresis(kind: usize, draw: &mut Draw) -> Hysteresis {
    let level = draw.scale(0.008, 0.04);
    // Torsion over which the loop turns round.
    let turn = draw.scale(0.03, 0.2);
    match kind {
        0 => {
            let springs = (0..5).map(|k| {
                let limit = turn * 2f64.powi(k - 2) * draw.scale(0.8, 1.25);
                [level / 5.0 / limit, limit, 0.0]
            });
            Hysteresis::MaxwellSlip(springs.collect())
        }
        1 => Hysteresis::Dahl {
            sigma: level / turn,
            level,
            z: 0.0,
        },
        2 => Hysteresis::BoucWen {
            sigma: level / turn,
            level,
            n: draw.within(1.0, 2.0),
            beta: draw.within(0.5, 0.9),
            z: 0.0,
        },
        _ => {
            let plays = (0..4).map(|k| {
                let half = level * 2f64.powi(k - 1) * draw.scale(0.8, 1.25);
                [draw.within(0.02, 0.08), half, 0.0]
            });
            Hysteresis::Plays(plays.collect())
        }
    }
}

/// A friction of the given kind.
#[must_use]
pub fn friction(kind: usize, draw: &mut Draw) -> Friction {
    let bend = draw.scale(0.004, 0.03);
    let stiction = draw.within(1.0, 1.4);
    let speed = draw.scale(1.0, 10.0);
    match kind {
        0 => Friction::LuGre {
            bend,
            stiction,
            speed,
            z: 0.0,
        },
        1 => Friction::Stribeck {
            stretch: bend,
            stiction,
            speed,
            z: 0.0,
        },
        _ => Friction::Load {
            stretches: [0.5 * bend, bend, 3.0 * bend],
            meshing: draw.within(0.01, 0.07),
            exponent: draw.within(0.5, 1.0),
            z: [0.0; 3],
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compliance_and_its_inverse_agree() {
        for kind in 0..KINDS[0] {
            let law = compliance(kind, &mut Draw::new(3, kind as u64));
            for i in -15..=15 {
                let t = 0.1 * f64::from(i);
                let back = law.torque(law.torsion(t));
                assert!((back - t).abs() < 1e-9, "{law:?} {t} {back}");
            }
        }
    }

    #[test]
    fn every_hysteresis_loses_energy_and_carries_the_torque() {
        for kind in 0..KINDS[1] {
            let mut draw = Draw::new(5, kind as u64);
            let mut gear = Gear::new(compliance(1, &mut draw), hysteresis(kind, &mut draw));
            let (mut work, mut last) = (0.0, 0.0);
            for i in 0..8000 {
                let phase = std::f64::consts::TAU * f64::from(i) / 2000.0;
                let t = 0.9 * phase.sin();
                let x = gear.load(t);
                if i >= 4000 {
                    work += t * (x - last);
                }
                last = x;
            }
            // Two loops: between a quarter and all of the largest possible loss.
            assert!((0.002..0.4).contains(&work), "kind {kind}: {work}");
        }
    }
}
