//! Arms drawn at random: the URDF that a user has, the arm as it is, and its motion, slow to fast, with friction and
//! with torque noise from a thousandth to a fifth of the torque.

use crate::arm_link::link;
use dynamics::{Base, Data, Model, rnea};
use identification::inertia::{Calibration, JointColumns, Robot, RobotLog, calibrate};
use problem::Problems;
use std::f64::consts::{FRAC_PI_2, TAU};
use test_support::Random;

pub(crate) const RATE: f64 = 100.0;
const SECONDS: f64 = 30.0;
/// Share of the torque's RMS that noise has, pace of the motion: least and most.
const NOISE: (f64, f64) = (1e-3, 0.2);
const PACE: (f64, f64) = (0.4, 2.0);

/// An arm drawn at random with its log.
pub(crate) struct Drawn {
    /// The URDF that a user has.
    pub(crate) urdf: Model,
    /// The arm as it is, and as it is with a payload in its hand.
    pub(crate) truth: Model,
    loaded: Model,
    /// Share of the torque's RMS that noise has, and pace of the motion.
    pub(crate) noise: f64,
    pub(crate) pace: f64,
    waves: Vec<Vec<[f64; 3]>>,
    zero: Vec<f64>,
    friction: Vec<[f64; 2]>,
    seed: u64,
}

/// Draws evenly by the logarithm.
pub(crate) fn between(random: &mut Random, (least, most): (f64, f64)) -> f64 {
    least * (most / least).powf(random.unit())
}

impl Drawn {
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let joints = 2 + random.below(6);
        let texts = urdfs(joints, &mut random);
        let [urdf, truth, loaded] =
            texts.map(|text| Model::from_urdf(&text, "arm.urdf", Base::Fixed).unwrap());
        let pace = between(&mut random, PACE);
        let mut wave = |k: usize| {
            let f = pace * 0.13 * (k + 1) as f64 * (1.0 + 0.2 * random.unit());
            let size = 0.7 / (k + 1) as f64 * (0.6 + 0.8 * random.unit());
            [size, TAU * f, TAU * random.unit()]
        };
        let waves = (0..joints).map(|_| (0..4).map(&mut wave).collect());
        Self {
            urdf,
            truth,
            loaded,
            waves: waves.collect(),
            zero: (0..joints).map(|_| random.symmetric()).collect(),
            friction: (0..joints)
                .map(|k| [1.5, 1.0].map(|f| f * (0.5 + random.unit()) / (1.0 + k as f64)))
                .collect(),
            noise: between(&mut random, NOISE),
            pace,
            seed,
        }
    }

    /// The log: torques `late` s after the angles, the payload in the hand from a row on.
    pub(crate) fn log(&self, late: f64, loaded_from: Option<usize>) -> RobotLog {
        let n = self.truth.joint_count();
        let mut random = Random::new(self.seed ^ 0x5eed);
        let mut data = [&self.truth, &self.loaded].map(Data::new);
        let mut out = RobotLog {
            name: "log.csv".into(),
            t: Vec::new(),
            joints: vec![Some(JointColumns::default()); n],
        };
        for row in 0..(SECONDS * RATE) as usize {
            let t = row as f64 / RATE;
            let state = |t: f64| {
                let of = |d: i32| (0..n).map(|j| self.wave(j, t, d)).collect::<Vec<f64>>();
                [of(0), of(1), of(2)]
            };
            let loaded = usize::from(loaded_from.is_some_and(|from| row >= from));
            let model = [&self.truth, &self.loaded][loaded];
            let [at, v, a] = state(t - late);
            let tau = rnea(model, &mut data[loaded], &at, &v, &a, None);
            let [q, ..] = state(t);
            out.t.push(t);
            for (j, columns) in out.joints.iter_mut().flatten().enumerate() {
                let [coulomb, viscous] = self.friction[j];
                let slip = coulomb * (v[j] / 0.02).tanh() + viscous * v[j];
                columns.q.push(q[j] + 2e-5 * random.normal());
                columns.tau.push(tau[j] + slip);
            }
        }
        for columns in out.joints.iter_mut().flatten() {
            let square: f64 = columns.tau.iter().map(|x| x * x).sum();
            let size = self.noise * (square / columns.tau.len() as f64).sqrt();
            let noisy = |tau: &mut f64| *tau += size * random.normal();
            columns.tau.iter_mut().for_each(noisy);
        }
        out
    }

    /// A joint's angle (0) or its derivatives, rad, rad/s, rad/s².
    fn wave(&self, joint: usize, t: f64, d: i32) -> f64 {
        let term =
            |[a, w, p]: &[f64; 3]| a * w.powi(d) * (w * t + p + f64::from(d) * FRAC_PI_2).sin();
        let sum: f64 = self.waves[joint].iter().map(term).sum();
        sum + if d == 0 { self.zero[joint] } else { 0.0 }
    }

    pub(crate) fn calibrate(&self, log: &RobotLog) -> Result<Calibration, Problems> {
        let all: Vec<usize> = (0..self.urdf.joint_count()).collect();
        let robot = Robot::new(&self.urdf, &all);
        calibrate(&robot, std::slice::from_ref(log), &[], |_, _| {})
    }

    /// Largest ratio of a link's mass to the true one, either way; that of a payload counts as true.
    pub(crate) fn worst(&self, found: &Calibration) -> f64 {
        let of = |model: &Model| -> Vec<f64> {
            let bodies = model.bodies()[1..].iter();
            bodies.map(|b| b.inertia.mass).collect()
        };
        let (least, most) = (of(&self.truth), of(&self.loaded));
        let each = found.inertias.iter().enumerate();
        let ratio = each.map(|(k, own)| (own.mass / most[k]).max(least[k] / own.mass));
        ratio.fold(1.0, f64::max)
    }
}

/// A URDF; the arm with masses up to a third off and centres up to 2 cm; and that with a payload.
fn urdfs(joints: usize, random: &mut Random) -> [String; 3] {
    let mut texts = [(); 3].map(|()| r#"<robot name="arm"><link name="base"/>"#.to_owned());
    for k in 0..joints {
        let length = 0.15 + 0.25 * random.unit();
        let mass = (6.0 - 1.1 * k as f64).max(0.8) * (0.7 + 0.6 * random.unit());
        let across = [0.03 * random.symmetric(), 0.03 * random.symmetric()];
        let centre = [0.5 * length, across[0], across[1]];
        // The second axis lies: without gravity no mass would be felt.
        let axis = match (k, random.below(3)) {
            (1, _) | (_, 0) => "0 1 0",
            (0, _) | (_, 1) => "0 0 1",
            _ => "1 0 0",
        };
        let effort = 400.0 / (1.0 + k as f64);
        let change = 1.0 + 0.33 * random.symmetric();
        let moved = random.array::<3>();
        let payload = if k + 1 == joints {
            0.5 + random.unit()
        } else {
            0.0
        };
        for (text, (factor, way)) in
            texts
                .iter_mut()
                .zip([(1.0, 0.0), (change, 0.02), (change + payload, 0.02)])
        {
            let c: Vec<f64> = (0..3)
                .map(|i| centre[i] + way * (2.0 * moved[i] - 1.0))
                .collect();
            *text += &link(k, mass * factor, &c, (length, axis, effort));
        }
    }
    texts.map(|text| text + "</robot>")
}
