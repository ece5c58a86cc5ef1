//! One joint of the family: structure by its number, everything else drawn at random.
//!
//! Numbers below [`FIRST_JUDGED`] are for design: looked at while the estimators were made. Those from
//! it on are for judging only; they include structures that no design joint has.

use crate::laws::{self, Friction, Gear, KINDS, NAMES};
use crate::random::Draw;
use joint_file::{JointFile, JointTable};

/// First number of the part for judging.
pub const FIRST_JUDGED: u64 = 1000;

/// A series of harmonics: order, amplitude (rad), phase.
pub type Series = Vec<[f64; 3]>;

/// Sensors of a joint.
#[derive(Debug, Clone)]
pub struct Sensors {
    /// Noise of the encoders, rad, motor and link.
    pub angle_noise: [f64; 2],
    /// Errors of the link encoder by q.
    pub link_error: Series,
    /// Errors of the motor encoder by theta.
    pub motor_error: Series,
    /// Delay of the motor-side sample after the link-side one, s.
    pub skew: f64,
    /// Gain and offset (A) of the current's measurement, its noise (A), its cogging (relative).
    pub current_gain: f64,
    /// Offset, A.
    pub current_offset: f64,
    /// Noise, A.
    pub current_noise: f64,
    /// Torque ripple of six periods a motor turn, of the rated torque.
    pub cogging: f64,
    /// Torque sensor: gain, offset (of the rated torque), noise (of the rated torque).
    pub torque_gain: f64,
    /// Offset.
    pub torque_offset: f64,
    /// Noise.
    pub torque_noise: f64,
}

/// A joint.
#[derive(Debug, Clone)]
pub struct Specimen {
    /// Its number.
    pub number: u64,
    /// Data sheet.
    pub sheet: JointTable,
    /// Gear without load, in relative units.
    pub gear: Gear,
    /// Torsion of the linear gear at rated torque, rad.
    pub torsion: f64,
    /// Creep: share of the torsion that comes late, and how late, s. Half of the joints have it.
    pub creep: [f64; 2],
    /// Growth of the kinematic error's part by theta with the torque carried, relative.
    pub loaded_error: f64,
    /// Friction at rest.
    pub friction: Friction,
    /// Coulomb friction, of the rated torque.
    pub coulomb: f64,
    /// Viscous friction at 200 rad/s, of the rated torque.
    pub viscous: f64,
    /// Ripple of the friction over a turn: amplitude and phase.
    pub ripple: [f64; 2],
    /// Friction of the output bearing, of the rated torque, and its viscous part at 1 rad/s.
    pub bearing: [f64; 2],
    /// Kinematic error by q, by theta, by theta - q (wave generator against flexspline).
    pub kinematic: [Series; 3],
    /// True over nominal torque constant.
    pub torque_constant: f64,
    /// Stiffness of the drive's position control, rated torque per rad, and its time constant, s.
    pub drive: [f64; 2],
    /// Resonance of load and gear: rad/s, damping ratio.
    pub resonance: [f64; 2],
    /// Its sensors.
    pub sensors: Sensors,
}

fn series(draw: &mut Draw, orders: &[f64], parts: usize, size: f64) -> Series {
    (0..parts)
        .map(|_| {
            let order = draw.choice(orders);
            let amplitude = size * draw.scale(0.1, 1.0) / order.max(1.0).sqrt();
            [order, amplitude, draw.within(0.0, std::f64::consts::TAU)]
        })
        .collect()
}

/// Value of a series at an angle.
#[must_use]
pub fn value(series: &Series, angle: f64) -> f64 {
    let parts = series.iter();
    parts
        .map(|[n, a, phase]| a * (n * angle + phase).cos())
        .sum()
}

impl Specimen {
    /// The joint of a number.
    #[must_use]
    pub fn new(number: u64) -> Self {
        let mut draw = Draw::new(number, 1);
        let structure = Self::structure(number);
        let rated = draw.scale(10.0, 300.0).round();
        let ratio = draw.choice(&[50.0, 80.0, 100.0, 120.0, 160.0]);
        let sheet = JointTable {
            radius: None,
            w_link: None,
            name: format!("family-{number}"),
            gear_ratio: ratio,
            torque_constant: rated / ratio / draw.within(2.0, 8.0),
            rotor_inertia: rated * draw.scale(0.003, 0.012) / (ratio * ratio),
            rated_torque: rated,
            link_counts_per_turn: draw.choice(&[18, 19, 20, 21, 23]).pow_of_two(),
            motor_counts_per_turn: draw.choice(&[12, 13, 16, 19]).pow_of_two(),
            sample_rate: 1000.0,
            torque_limit: None,
            max_velocity: 30.0,
            stiffness: None,
        };
        let current = rated / ratio / sheet.torque_constant;
        let counts = |n: f64| std::f64::consts::TAU / n;
        let sensors = Sensors {
            angle_noise: [
                counts(sheet.motor_counts_per_turn).max(ratio * 5e-7) * draw.scale(0.3, 1.5),
                counts(sheet.link_counts_per_turn).max(5e-7) * draw.scale(0.3, 1.5),
            ],
            link_error: [
                series(&mut draw, &[1.0, 2.0], 2, 1.2e-4),
                series(&mut draw, &[16.0, 32.0, 64.0], 1, 2e-5),
            ]
            .concat(),
            motor_error: series(&mut draw, &[1.0, 2.0], 2, 1e-3),
            skew: draw.within(-5e-4, 5e-4),
            current_gain: 1.0 + 0.02 * draw.normal(),
            current_offset: current * 0.01 * draw.normal(),
            current_noise: current * draw.scale(0.003, 0.02),
            cogging: draw.scale(0.001, 0.008),
            torque_gain: 1.0 + 0.001 * draw.normal(),
            torque_offset: 5e-4 * draw.normal(),
            torque_noise: draw.scale(3e-4, 1e-3),
        };
        Self {
            number,
            gear: Gear::new(
                laws::compliance(structure[0], &mut draw),
                laws::hysteresis(structure[1], &mut draw),
            ),
            torsion: draw.within(1.2e-3, 2.4e-3),
            creep: if draw.within(0.0, 1.0) < 0.5 {
                [0.0, 1.0]
            } else {
                [draw.scale(0.01, 0.05), draw.scale(0.3, 5.0)]
            },
            loaded_error: draw.within(-0.5, 0.5),
            friction: laws::friction(structure[2], &mut draw),
            coulomb: draw.scale(0.04, 0.12),
            viscous: draw.scale(0.02, 0.1),
            ripple: [draw.within(0.0, 0.15), draw.within(0.0, 6.0)],
            bearing: [draw.scale(0.001, 0.006), draw.scale(0.001, 0.006)],
            kinematic: [
                series(&mut draw, &[1.0, 2.0, 3.0, 5.0], 3, 8e-5),
                series(&mut draw, &[1.0, 2.0, 3.0, 4.0, 6.0], 3, 6e-5),
                series(&mut draw, &[2.0, 4.0], 1, 1.5e-5),
            ],
            torque_constant: 1.0 + 0.03 * draw.normal(),
            drive: [draw.scale(150.0, 600.0), draw.scale(0.1, 0.4)],
            resonance: [
                std::f64::consts::TAU * draw.within(15.0, 40.0),
                draw.within(0.15, 0.4),
            ],
            sheet,
            sensors,
        }
    }

    /// Kinds of compliance, hysteresis and friction. Design joints leave out every third structure.
    #[must_use]
    pub fn structure(number: u64) -> [usize; 3] {
        let of = |n: usize| [n % KINDS[0], n / 3 % KINDS[1], n / 12 % KINDS[2]];
        match number.checked_sub(FIRST_JUDGED) {
            // Neighbours differ in all three laws; 36 numbers cover all structures.
            Some(k) => of((k as usize * 17) % 36),
            None => {
                let design: Vec<usize> = (0..36).filter(|n| (n + n / 3) % 3 != 0).collect();
                of(design[(number as usize * 7) % design.len()])
            }
        }
    }

    /// The structure's name.
    #[must_use]
    pub fn describe(&self) -> String {
        let kinds = Self::structure(self.number);
        let names: Vec<&str> = kinds.iter().zip(NAMES).map(|(k, n)| n[*k]).collect();
        names.join(", ")
    }

    /// The joint file before any fit: the data sheet alone.
    #[must_use]
    pub fn file(&self) -> JointFile {
        JointFile::new(self.sheet.clone())
    }

    /// The same joint with three times the noise on every signal.
    #[must_use]
    pub fn noisy(mut self) -> Self {
        let s = &mut self.sensors;
        s.angle_noise = s.angle_noise.map(|x| 3.0 * x);
        s.current_noise *= 3.0;
        s.torque_noise *= 3.0;
        self
    }

    /// The same joint with an eighth of the encoders' counts.
    #[must_use]
    pub fn coarse(mut self) -> Self {
        self.sheet.link_counts_per_turn /= 8.0;
        self.sheet.motor_counts_per_turn /= 8.0;
        self
    }
}

trait PowerOfTwo {
    fn pow_of_two(self) -> f64;
}

impl PowerOfTwo for i32 {
    fn pow_of_two(self) -> f64 {
        2f64.powi(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn judging_covers_every_structure_and_design_does_not() {
        let judged: BTreeSet<_> = (FIRST_JUDGED..FIRST_JUDGED + 36)
            .map(Specimen::structure)
            .collect();
        let design: BTreeSet<_> = (0..FIRST_JUDGED).map(Specimen::structure).collect();
        assert_eq!(judged.len(), 36);
        assert_eq!(design.len(), 24);
    }
}
