//! Draws of joints: sizes about those of the shipped robots, and structure.

use crate::catalogue::Catalogue;
use crate::drive::{self, Velocity};
use crate::friction::{Dependence, Friction, Sizes};
use crate::gear::{Core, Element, Gear};
use crate::plant::{DT, Joint, Mechanism, Outside, Sensors, Transport, Waves};
use std::f64::consts::TAU;
use test_support::Random;

/// A joint as it is.
#[derive(Debug, Clone)]
pub(crate) struct Drawn {
    pub(crate) name: String,
    pub(crate) catalogue: Catalogue,
    /// Its structure in words.
    pub(crate) structure: String,
    pub(crate) mechanism: Mechanism,
    pub(crate) sensors: Sensors,
    pub(crate) transport: Transport,
    pub(crate) gear: Gear,
    pub(crate) friction: Friction,
    pub(crate) bearing: Friction,
    pub(crate) drive: drive::Sizes,
    /// Way of the motor over which its friction builds up, rad, motor side.
    pub(crate) presliding: f64,
    /// Torque of the current, N·m/A, motor side.
    pub(crate) torque_constant: f64,
    /// Bits of the link's encoder.
    pub(crate) bits: u32,
    pub(crate) seed: u64,
}

/// A number between two, of which each decade is as likely.
fn between(random: &mut Random, [least, most]: [f64; 2]) -> f64 {
    least * (most / least).powf(random.unit())
}

/// A number between two, of which any is as likely.
fn within(random: &mut Random, [least, most]: [f64; 2]) -> f64 {
    least + (most - least) * random.unit()
}

/// Something that is there with this likelihood, else zero.
fn at_times(random: &mut Random, likelihood: f64, value: f64) -> f64 {
    if random.unit() < likelihood {
        value
    } else {
        0.0
    }
}

fn wave(random: &mut Random, amplitude: f64, periods: f64) -> (f64, f64, f64) {
    (amplitude, periods, TAU * random.unit())
}

impl Drawn {
    /// The joint of a seed.
    pub(crate) fn new(catalogue: &Catalogue, seed: u64) -> Self {
        let mut random = Random::new(seed.wrapping_mul(0x9E37_79B9).wrapping_add(17));
        let r = &mut random;
        let c = catalogue;
        let rotor = c.rotor * c.ratio * c.ratio * between(r, [0.5, 2.0]);
        let gear = gear(r, c, rotor);
        let presliding = between(r, [1e-3, 30e-3]);
        let friction = friction(r, c, rotor, presliding);
        let torque_constant = c.torque_constant * between(r, [0.8, 1.25]);
        let drive = drive(r, c, rotor);
        let coulomb = friction.sizes.coulomb;
        let cogging = 0.2 * coulomb * r.unit();
        let cogging = at_times(r, 0.7, cogging);
        let poles = (6 + 2 * r.below(10)) as f64;
        let link = rotor * between(r, [1.0, 8.0]);
        let weight = c.rated * within(r, [0.0, 0.4]);
        let mechanism = Mechanism {
            ratio: c.ratio,
            rotor,
            link,
            weight,
            kinematic: kinematic(r),
            cogging: vec![wave(r, cogging, poles)],
        };
        let bits = 17 + r.below(3) as u32;
        let sensors = sensors(r, c, torque_constant, bits);
        let transport = Transport {
            delay: within(r, [0.5e-3, 1.7e-3]),
            jitter: within(r, [0.0, 0.3e-3]),
        };
        let bearing = bearing(r, c, link);
        let structure = format!(
            "{} core, {} slip elements in the gear, {} in the friction, {}{} drive at {:.0} us, velocity by {}, order {}{}",
            gear.core.name(),
            gear.elements.len(),
            friction.count(),
            if cogging > 0.0 { "cogging, " } else { "" },
            if drive.dead_zone > 0.0 {
                "dead zone,"
            } else {
                "no dead zone,"
            },
            drive.every as f64 * DT * 1e6,
            drive.velocity.name(),
            drive.order,
            if drive.late { ", a sample late" } else { "" },
        );
        Self {
            name: format!("{} {seed:02}", c.name),
            catalogue: c.clone(),
            structure,
            mechanism,
            sensors,
            transport,
            gear,
            friction,
            bearing,
            drive,
            presliding,
            torque_constant,
            bits,
            seed,
        }
    }

    /// The joint at rest at an angle, rad.
    pub(crate) fn at_rest(&self, q: f64, outside: Outside) -> Joint {
        Joint::at_rest(
            (self.mechanism.clone(), self.sensors.clone(), self.transport),
            (
                self.gear.clone(),
                self.friction.clone(),
                self.bearing.clone(),
            ),
            self.drive.clone(),
            (q, outside),
            Random::new(self.seed ^ 0x5EED),
        )
    }
}

fn gear(r: &mut Random, c: &Catalogue, rotor: f64) -> Gear {
    // The torsion at the rated torque, which catalogues show.
    let rated = c.torsion(c.rated) / between(r, [0.6, 1.5]);
    let core = [Core::Root, Core::Arc][r.below(2)];
    let (softness, cubic) = (within(r, [0.35, 0.95]), within(r, [0.0, 0.4]));
    let width = rated * between(r, [0.03, 0.25]);
    let mut gear = Gear {
        core,
        stiffness: 1.0,
        cubic: cubic / rated.powi(2),
        softness,
        width,
        damping: 0.0,
        elements: Vec::new(),
    };
    gear.stiffness = c.rated / gear.elastic(rated);
    gear.damping = 2.0 * within(r, [0.005, 0.04]) * (gear.stiffness * rotor).sqrt();
    let hysteresis = c.rated * between(r, [0.003, 0.04]);
    let count = r.below(7);
    let shares: Vec<f64> = (0..count).map(|_| 0.2 + r.unit()).collect();
    let sum: f64 = shares.iter().sum();
    for share in shares {
        let limit = hysteresis * share / sum;
        let stretch = rated * between(r, [0.03, 0.3]);
        gear.elements.push(Element::new(limit / stretch, limit));
    }
    gear
}

fn friction(r: &mut Random, c: &Catalogue, rotor: f64, presliding: f64) -> Friction {
    let coulomb = c.ratio * c.coulomb * between(r, [0.5, 2.5]);
    let stiffness = coulomb * c.ratio / presliding;
    let of_motor = at_times(r, 0.7, 0.15);
    let of_motor = of_motor * r.unit();
    let of_link = at_times(r, 0.5, 0.1);
    let of_link = of_link * r.unit();
    let (direction, load) = (at_times(r, 0.5, 1.0), at_times(r, 0.7, 1.0));
    let periods = [1 + r.below(3), 1 + r.below(6)].map(|n| n as f64);
    let dependence = Dependence {
        load: load * within(r, [0.01, 0.08]),
        direction: direction * 0.15 * r.symmetric(),
        position: [wave(r, of_motor, periods[0]), wave(r, of_link, periods[1])],
    };
    let static_ratio = 1.0 + at_times(r, 0.8, 0.8) * r.unit();
    let sizes = Sizes {
        coulomb,
        static_ratio,
        stribeck: (between(r, [0.5, 10.0]) / c.ratio, within(r, [0.5, 2.0])),
        viscous: c.viscous * c.ratio * c.ratio * between(r, [0.5, 3.0]),
        sticking: within(r, [0.3, 1.0]) * (stiffness * rotor).sqrt(),
        lag: between(r, [0.5e-3, 5e-3]),
        dependence,
    };
    let count = 1 + r.below(6);
    let shares: Vec<f64> = (0..count).map(|_| 0.2 + r.unit()).collect();
    let weights: Vec<f64> = (0..count).map(|_| between(r, [0.2, 1.0])).collect();
    let (sum, heavy): (f64, f64) = (shares.iter().sum(), weights.iter().sum());
    let elements = shares.iter().zip(&weights);
    let elements: Vec<(f64, f64)> =
        (elements.map(|(share, weight)| (stiffness * weight / heavy, share / sum))).collect();
    Friction::new(sizes, &elements)
}

fn bearing(r: &mut Random, c: &Catalogue, link: f64) -> Friction {
    let coulomb = c.rated * between(r, [0.002, 0.01]);
    let stiffness = coulomb / between(r, [3e-5, 3e-4]);
    let sizes = Sizes {
        coulomb,
        static_ratio: within(r, [1.0, 1.4]),
        stribeck: (0.02, 1.0),
        viscous: c.rated * within(r, [0.001, 0.008]),
        sticking: 0.5 * (stiffness * link).sqrt(),
        lag: 1e-3,
        dependence: Dependence::default(),
    };
    Friction::new(sizes, &[(stiffness, 1.0)])
}

/// Largest phase, rad, by which the drive's damping may be late at its own corner: its maker chooses gains at which its
/// loop does not ring.
const LATE_DAMPING: f64 = 0.45;

fn drive(r: &mut Random, c: &Catalogue, rotor: f64) -> drive::Sizes {
    let own = c.drive_stiffness();
    let stiffness = own * between(r, [0.4, 2.5]);
    let nominal = c.rotor * c.ratio * c.ratio;
    let ratio = own * c.k_v / (2.0 * (own * nominal).sqrt());
    let damping = 2.0 * ratio * between(r, [0.75, 1.5]) * (stiffness * rotor).sqrt();
    let has_zone = at_times(r, 0.6, 1.0);
    let mut sizes = drive::Sizes {
        stiffness,
        damping,
        dead_zone: has_zone * within(r, [0.005, 0.03]) * c.rated / stiffness,
        every: 10,
        phase: 0,
        velocity: Velocity::Difference(1),
        late: false,
        order: 1 + r.below(2),
        lag: between(r, [0.5e-4, 2e-4]),
        limit: c.limit * within(r, [1.1, 1.5]),
        ripple: (at_times(r, 0.7, 0.03) * r.unit(), 6.0, TAU * r.unit()),
        count: drive::count(65_536.0 * between(r, [1.0, 16.0]).round(), c.ratio),
    };
    loop {
        sizes.every = [10, 16, 20, 40][r.below(4)];
        sizes.phase = r.below(sizes.every);
        sizes.late = r.unit() < 0.5;
        sizes.velocity = match r.below(3) {
            0 => Velocity::LowPass(between(r, [1e-4, 1e-3])),
            n => Velocity::Difference(2 * n - 1),
        };
        let late = sizes.mean_lag(DT) + sizes.velocity_lag(DT);
        let smallest = sizes.every == 10 && !sizes.late && late < 5e-4;
        if damping / rotor * late < LATE_DAMPING || smallest {
            return sizes;
        }
    }
}

/// Largest amplitude of the kinematic error that a calibration has found, rad: as Z Table I.
const KINEMATIC: [f64; 2] = [7.5e-5, 5.0e-5];

fn kinematic(r: &mut Random) -> [Waves; 2] {
    let [link, motor] = KINEMATIC.map(|most| most * r.unit());
    [
        vec![wave(r, link, 1.0)],
        vec![wave(r, motor, 2.0), wave(r, 0.1 * motor, 4.0)],
    ]
}

fn sensors(r: &mut Random, c: &Catalogue, torque_constant: f64, bits: u32) -> Sensors {
    let count = TAU / f64::from(1_u32 << bits);
    let link = (0.008_f64 * r.unit()).to_radians();
    let motor = (0.08_f64 * r.unit()).to_radians();
    let per_current = c.ratio * torque_constant;
    Sensors {
        eccentric: [
            vec![wave(r, link, 1.0), wave(r, 0.2 * link, 2.0)],
            vec![wave(r, motor, 1.0), wave(r, 0.2 * motor, 2.0)],
        ],
        noise: [
            count * within(r, [0.2, 0.8]),
            TAU / 4096.0 * within(r, [0.1, 0.5]),
            0.01 * c.rated / per_current * within(r, [0.3, 1.5]),
        ],
        per_current,
        offset: 0.01 * c.rated / per_current * r.symmetric(),
        gain: 1.0 + 0.02 * r.symmetric(),
    }
}
