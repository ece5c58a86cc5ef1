//! The gear: an elastic core, softer around zero and stiffer far out, with slip elements beside it.
//!
//! `T(x) = K (x + b x³ - (1 - r) w s(x/w)) + sum of the elements`, `s` of slope 1 at zero and at most 1. An element is a
//! spring that slips at a torque of its own (generalised Maxwell slip): closed loops that lose energy at any rate.

use std::f64::consts::PI;

/// Form of the soft core's curve `s`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Core {
    /// `u / sqrt(1 + u²)`.
    Root,
    /// `2/pi atan(pi u / 2)`, which reaches further out.
    Arc,
}

impl Core {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Root => "root",
            Self::Arc => "arctangent",
        }
    }
}

/// A spring that slips, link side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Element {
    /// N·m/rad.
    pub(crate) stiffness: f64,
    /// Torque at which it slips, N·m.
    pub(crate) limit: f64,
    torque: f64,
}

impl Element {
    pub(crate) fn new(stiffness: f64, limit: f64) -> Self {
        Self {
            stiffness,
            limit,
            torque: 0.0,
        }
    }
}

/// The gear between rotor and link.
#[derive(Debug, Clone)]
pub(crate) struct Gear {
    pub(crate) core: Core,
    /// K: stiffness beyond the core, N·m/rad.
    pub(crate) stiffness: f64,
    /// b: 1/rad².
    pub(crate) cubic: f64,
    /// r: stiffness at zero over K.
    pub(crate) softness: f64,
    /// w: width of the core, rad.
    pub(crate) width: f64,
    /// N·m·s/rad.
    pub(crate) damping: f64,
    pub(crate) elements: Vec<Element>,
}

impl Gear {
    /// Torque at torsion `x` without the elements, N·m.
    pub(crate) fn elastic(&self, x: f64) -> f64 {
        let u = x / self.width;
        let s = match self.core {
            Core::Root => u / (1.0 + u * u).sqrt(),
            Core::Arc => 2.0 / PI * (0.5 * PI * u).atan(),
        };
        self.stiffness * (x + self.cubic * x.powi(3) - (1.0 - self.softness) * self.width * s)
    }

    /// The torsion that carries `torque` without the elements, rad.
    pub(crate) fn torsion_of(&self, torque: f64) -> f64 {
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if self.elastic(middle) < torque {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Torque at torsion `x`, reached by a further `dx` at the rate `dx/dt`, N·m.
    pub(crate) fn advance(&mut self, x: f64, dx: f64, rate: f64) -> f64 {
        let mut torque = self.elastic(x) + self.damping * rate;
        for element in &mut self.elements {
            let stretched = element.torque + element.stiffness * dx;
            element.torque = stretched.clamp(-element.limit, element.limit);
            torque += element.torque;
        }
        torque
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gear(core: Core) -> Gear {
        Gear {
            core,
            stiffness: 10_000.0,
            cubic: 1e4,
            softness: 0.4,
            width: 2e-4,
            damping: 0.0,
            elements: vec![Element::new(2000.0, 0.2), Element::new(5000.0, 0.3)],
        }
    }

    /// Work of a torsion to and fro between plus and minus `most`, once it has closed.
    fn loss(gear: &mut Gear, most: f64) -> f64 {
        let dx = 1e-6;
        let count = (most / dx).round() as i32;
        let path = (0..count).chain((-count..count).rev());
        let path = path.chain(-count..count).chain((-count..count).rev());
        let path: Vec<i32> = path.chain(-count..count).collect();
        let begins = path.len() - 4 * count as usize;
        let (mut last, mut before, mut work) = (0.0, 0.0, 0.0);
        for (k, &at) in path.iter().enumerate() {
            let x = f64::from(at) * dx;
            let torque = gear.advance(x, x - last, 0.0);
            if k >= begins {
                work += 0.5 * (torque + before) * (x - last);
            }
            (last, before) = (x, torque);
        }
        work
    }

    #[test]
    fn a_closed_loop_loses_what_its_elements_slip_over() {
        for core in [Core::Root, Core::Arc] {
            let most = 1e-3;
            let expected: f64 = [(2000.0, 0.2), (5000.0, 0.3)]
                .map(|(stiffness, limit): (f64, f64)| 4.0 * limit * (most - limit / stiffness))
                .iter()
                .sum();
            let lost = loss(&mut gear(core), most);
            assert!((lost / expected - 1.0).abs() < 0.02, "{lost} {expected}");
        }
        // Within the stretch of its first slip nothing is lost.
        let little = loss(&mut gear(Core::Root), 4e-5);
        assert!(little.abs() < 1e-7, "{little}");
    }

    #[test]
    fn the_core_is_soft_and_the_torsion_is_the_inverse() {
        for core in [Core::Root, Core::Arc] {
            let gear = gear(core);
            let at_zero = gear.elastic(1e-7) / 1e-7;
            assert!((at_zero - 4000.0).abs() < 1.0, "{at_zero}");
            let far = (gear.elastic(1.01e-2) - gear.elastic(1e-2)) / 1e-4;
            assert!(far > 10_000.0, "{far}");
            for torque in [-40.0, -1.0, 0.0, 3.0, 80.0] {
                let back = gear.elastic(gear.torsion_of(torque));
                assert!((back - torque).abs() < 1e-6);
            }
        }
    }
}
