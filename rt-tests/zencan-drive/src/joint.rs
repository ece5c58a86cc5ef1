//! A joint on a vertical axis with its drive: states of CiA 402, position loop or torque, gear, friction, encoders.
//! The figures are those of rt-tests/udp/durand_drive.py.

use std::f64::consts::TAU;

const LINK_COUNTS: f64 = 524_288.0;
const MOTOR_COUNTS: f64 = 65_536.0;
const RATIO: f64 = 100.0;
/// Rotor and link, link, kg·m²; gear, N·m/rad; friction, N·m; N·m/A at the joint; A.
const INERTIA: f64 = 0.704;
const LINK_INERTIA: f64 = 0.59;
const STIFFNESS: f64 = 8333.0;
const FRICTION: f64 = 1.5;
const TORQUE_PER_AMPERE: f64 = 5.0;
const RATED_A: f64 = 5.0;
/// Position and velocity gain of the drive's loop, N·m/rad and N·m·s/rad.
const GAINS: [f64; 2] = [6000.0, 120.0];
/// Interval of SYNC, s, and steps in it.
const PERIOD_S: f64 = 0.005;
const STEPS: u32 = 10;

/// Status words; bit 9: remote.
const DISABLED: u16 = 0x240;
const READY: u16 = 0x231;
const ON: u16 = 0x233;
const ENABLED: u16 = 0x237;

/// Target that the drive follows.
#[derive(Clone, Copy)]
pub enum Target {
    /// rad.
    Angle(f64),
    /// N·m at the joint.
    Torque(f64),
}

impl Target {
    pub fn counts(counts: i32) -> Self {
        Self::Angle(f64::from(counts) / LINK_COUNTS * TAU)
    }

    pub fn per_mille(per_mille: i16) -> Self {
        Self::Torque(f64::from(per_mille) / 1000.0 * RATED_A * TORQUE_PER_AMPERE)
    }

    /// Degrees, or N·m.
    pub fn shown(self) -> f64 {
        match self {
            Self::Angle(angle) => angle.to_degrees(),
            Self::Torque(torque) => torque,
        }
    }
}

pub struct Joint {
    status: u16,
    angle: f64,
    velocity: f64,
    acceleration: f64,
    torque: f64,
    worst_jump: f64,
    random: u64,
}

impl Joint {
    pub fn new(degrees: f64, seed: u64) -> Self {
        Self {
            status: DISABLED,
            angle: degrees.to_radians(),
            velocity: 0.0,
            acceleration: 0.0,
            torque: 0.0,
            worst_jump: 0.0,
            random: seed,
        }
    }

    pub fn status(&self) -> u16 {
        self.status
    }

    pub fn is_enabled(&self) -> bool {
        self.status == ENABLED
    }

    pub fn degrees(&self) -> f64 {
        self.angle.to_degrees()
    }

    /// Greatest error of the position loop, rad.
    pub fn worst_jump(&self) -> f64 {
        self.worst_jump
    }

    pub fn control(&mut self, word: u16) {
        self.status = match (word & 0x0F, self.status) {
            (low, _) if low & 0x02 == 0 || low & 0x04 == 0 => DISABLED,
            (0x06, _) => READY,
            (0x07, READY | ON | ENABLED) => ON,
            (0x0F, ON) => ENABLED,
            (_, status) => status,
        };
    }

    /// One period; without a target the motor has no torque.
    pub fn step(&mut self, target: Option<Target>) {
        let (dt, before) = (PERIOD_S / f64::from(STEPS), self.velocity);
        for _ in 0..STEPS {
            self.torque = match target {
                None => 0.0,
                Some(Target::Torque(torque)) => torque,
                Some(Target::Angle(angle)) => {
                    let error = angle - self.angle;
                    self.worst_jump = self.worst_jump.max(error.abs());
                    GAINS[0] * error - GAINS[1] * self.velocity
                }
            };
            let velocity = self.velocity + dt * self.torque / INERTIA;
            let brake = dt * FRICTION / INERTIA;
            self.velocity = velocity - velocity.clamp(-brake, brake);
            self.angle += dt * self.velocity;
        }
        self.acceleration = (self.velocity - before) / PERIOD_S;
    }

    /// Counts of the link and of the motor, thousandths of the rated current, with noise.
    pub fn readings(&mut self) -> [i32; 3] {
        let torsion = LINK_INERTIA * self.acceleration / STIFFNESS;
        let exact = [
            self.angle / TAU * LINK_COUNTS,
            (self.angle + torsion) / TAU * RATIO * MOTOR_COUNTS,
            1000.0 * self.torque / TORQUE_PER_AMPERE / RATED_A,
        ];
        let sigmas = [0.5, 0.5, 4.0];
        [0, 1, 2].map(|i| (exact[i] + sigmas[i] * self.normal()).round() as i32)
    }

    /// A normal number: the sum of twelve uniform ones (splitmix64).
    fn normal(&mut self) -> f64 {
        let mut uniform = || {
            self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let x = (self.random ^ (self.random >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}
