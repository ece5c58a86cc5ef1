//! Sums of sinusoids from which inertial parameters can be identified: amplitudes and phases chosen
//! such that the regressor's condition number is small (Swevers et al. 1997; Gautier and Khalil 1992).
//!
//! The search is a (1+1) evolution strategy with the 1/5 rule: deterministic for a seed. Whatever it
//! tries is scaled to the shares of the joints' limits first.

use crate::jet::{Jet, window};
use crate::plan::Part;
use crate::rigid::Rigid;
use control::PlannedMotion;
use dynamics::Random;
use nalgebra::DMatrix;
use problem::Problem;
use robot_config::Robot;
use std::f64::consts::TAU;

/// Instants of a period at which the regressor is evaluated.
const INSTANTS: usize = 60;
/// Random states from which independent columns and their lengths are found.
const STATES: usize = 80;
/// A column that others explain up to this share of its length depends on them.
const DEPENDENT: f64 = 1e-6;
/// Share of a period in which the motion begins, and ends.
const FADE: f64 = 0.15;
/// Tries, and shares of the limits, where the plan gives none.
const TRIES: u32 = 400;
const POSITION: f64 = 60.0;
const VELOCITY: f64 = 60.0;
const TORQUE: f64 = 70.0;

/// Parameters chosen for a multisine.
#[derive(Debug, Clone)]
pub struct Choice {
    /// Its part.
    pub title: String,
    /// Base parameters of the joints that move.
    pub parameters: usize,
    /// Condition number of the first guess: random phases, all amplitudes alike.
    pub before: f64,
    /// Condition number of what was chosen.
    pub after: f64,
    /// Number of signals that were compared.
    pub tries: u32,
}

/// The sinusoids of a group of joints.
#[derive(Debug, Clone)]
pub(crate) struct Signals {
    joints: Vec<usize>,
    /// Sine and cosine of each harmonic, joint by joint.
    parts: Vec<f64>,
    harmonics: usize,
    base_hz: f64,
    duration: f64,
    /// Scale of each joint, rad.
    scale: Vec<f64>,
}

impl Signals {
    pub(crate) fn at(&self, t: f64, jets: &mut [Jet]) {
        let fade = FADE / self.base_hz;
        let fade = window(t, self.duration, (fade, fade));
        let parts = self.parts.chunks_exact(2 * self.harmonics);
        for ((joint, parts), scale) in self.joints.iter().zip(parts).zip(&self.scale) {
            let mut sum = Jet::default();
            for (k, pair) in parts.chunks_exact(2).enumerate() {
                let w = TAU * self.base_hz * (k + 1) as f64;
                let (s, c) = (w * t).sin_cos();
                let (a, b) = (pair[0], pair[1]);
                let value = a * s + b * c;
                sum.0 += value;
                sum.1 += w * (a * c - b * s);
                sum.2 -= w * w * value;
            }
            jets[*joint] = sum.times(fade).scaled(*scale);
        }
    }
}

/// Result of [`choose`].
pub(crate) struct Found {
    pub(crate) signals: Signals,
    pub(crate) duration: f64,
    pub(crate) choice: Choice,
}

/// Chooses the sinusoids of a part's joints about `pose`, rad.
///
/// # Errors
/// No motion within the limits, e.g. as gravity alone takes more torque.
pub(crate) fn choose(
    robot: &Robot,
    part: &Part,
    joints: &[usize],
    pose: &[f64],
    progress: &mut dyn FnMut(&str),
) -> Result<Found, Problem> {
    let harmonics = part.harmonics.unwrap_or(5) as usize;
    let base_hz = part.frequency_hz.unwrap_or(0.1);
    let periods = f64::from(part.times.unwrap_or(1));
    let mut random = Random::new(part.seed.unwrap_or(1));
    let mut search = Search::new(robot, part, joints, pose, &mut random)?;
    let mut best = Signals {
        joints: joints.to_vec(),
        parts: vec![0.0; 2 * harmonics * joints.len()],
        harmonics,
        base_hz,
        duration: periods / base_hz,
        scale: vec![0.0; joints.len()],
    };
    for pair in best.parts.chunks_exact_mut(2) {
        (pair[1], pair[0]) = (TAU * random.uniform(0.0, 1.0)).sin_cos();
    }
    let mut condition = search.judge(&mut best);
    let before = condition;
    let tries = part.tries.unwrap_or(TRIES);
    let (mut step, title) = (0.5f64, part.title());
    for k in 0..tries {
        let mut other = best.clone();
        for x in &mut other.parts {
            *x += step * gaussian(&mut random);
        }
        let found = search.judge(&mut other);
        if found < condition {
            (best, condition) = (other, found);
            step = (1.5 * step).min(2.0);
        } else {
            step = (step * 0.9).max(1e-3);
        }
        if k % 20 == 0 {
            progress(&format!(
                "{title}: condition number {condition:.0}, {k} of {tries} tries"
            ));
        }
    }
    if !condition.is_finite() {
        let what = format!("{title}: no motion about this pose is within the limits");
        return Err(Problem::new(
            what,
            "another pose, or a greater torque_per_cent",
        ));
    }
    Ok(Found {
        duration: best.duration,
        choice: Choice {
            title,
            parameters: search.independent.len(),
            before,
            after: condition,
            tries,
        },
        signals: best,
    })
}

struct Search<'a> {
    rigid: Rigid<'a>,
    joints: Vec<usize>,
    pose: Vec<PlannedMotion>,
    /// Greatest position about the pose, velocity and acceleration of each joint, torque too.
    most: Vec<[f64; 4]>,
    regressor: DMatrix<f64>,
    independent: Vec<usize>,
    lengths: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(
        robot: &'a Robot,
        part: &Part,
        joints: &[usize],
        pose: &[f64],
        random: &mut Random,
    ) -> Result<Self, Problem> {
        let share = |given: Option<f64>, or: f64| 1e-2 * given.unwrap_or(or);
        let limits: Vec<_> = robot.parameters.motion_limits().collect();
        let most = joints.iter().map(|&j| {
            let joint = &robot.parameters.joints[j];
            let l = &joint.limits;
            let room = (pose[j] - l.position_min).min(l.position_max - pose[j]);
            let range =
                share(part.position_per_cent, POSITION) * 0.5 * (l.position_max - l.position_min);
            let velocity = share(part.velocity_per_cent, VELOCITY) * l.velocity;
            let torque = share(part.torque_per_cent, TORQUE) * l.torque;
            [
                range.min(0.95 * room),
                velocity,
                limits[j].acceleration,
                torque,
            ]
        });
        let most: Vec<[f64; 4]> = most.collect();
        if let Some(k) = most.iter().position(|most| most[0] <= 0.0) {
            let name = &robot.parameters.joints[joints[k]].name;
            let what = format!("{}: joint {name:?} is at its position limit", part.title());
            return Err(Problem::new(what, "a pose with room to both sides"));
        }
        let rigid = Rigid::new(robot);
        let mut search = Self {
            regressor: rigid.empty_regressor(),
            rigid,
            joints: joints.to_vec(),
            pose: pose
                .iter()
                .map(|&q| PlannedMotion {
                    q,
                    ..PlannedMotion::default()
                })
                .collect(),
            most,
            independent: Vec::new(),
            lengths: Vec::new(),
        };
        search.find_base(random);
        Ok(search)
    }

    /// Independent columns of the regressor at random states, and their lengths there.
    fn find_base(&mut self, random: &mut Random) {
        let columns = self.regressor.ncols();
        let rows = self.joints.len();
        let mut w = DMatrix::zeros(STATES * rows, columns);
        for state in 0..STATES {
            let mut point = self.pose.clone();
            for (j, most) in self.joints.iter().zip(&self.most) {
                point[*j].q += most[0] * random.uniform(-1.0, 1.0);
                point[*j].dq = most[1] * random.uniform(-1.0, 1.0);
                point[*j].ddq = most[2] * random.uniform(-1.0, 1.0);
            }
            self.add(&point, &mut w, state * rows);
        }
        let lengths: Vec<f64> = w.column_iter().map(|c| c.norm()).collect();
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        let mut units: Vec<nalgebra::DVector<f64>> = Vec::new();
        for (k, &length) in lengths.iter().enumerate() {
            if length <= 1e-9 * longest {
                continue;
            }
            let mut rest = w.column(k) / length;
            for _ in 0..2 {
                for unit in &units {
                    let part = unit.dot(&rest);
                    rest.axpy(-part, unit, 1.0);
                }
            }
            let norm = rest.norm();
            if norm > DEPENDENT {
                self.independent.push(k);
                self.lengths.push(length / (STATES as f64).sqrt());
                units.push(rest / norm);
            }
        }
    }

    /// The joints' rows of the regressor at a point, as shares of their torque limits.
    fn add(&mut self, point: &[PlannedMotion], w: &mut DMatrix<f64>, first: usize) {
        self.rigid.set(point);
        self.rigid.regressor(&mut self.regressor);
        for (i, j) in self.joints.iter().enumerate() {
            let row = self.regressor.row(self.rigid.row(*j)) / self.most[i][3];
            w.row_mut(first + i).copy_from(&row);
        }
    }

    /// Scales the signals to the limits; the condition number of their regressor, infinite where there
    /// is no such scale.
    fn judge(&mut self, signals: &mut Signals) -> f64 {
        signals.scale.fill(1.0);
        let period = 1.0 / signals.base_hz;
        // Where the motion is faded in, within it, and where it is faded out.
        let length = signals.duration.min(2.0 * period);
        let count = (INSTANTS as f64 * length / period).ceil() as usize;
        let instant = |k: usize| length * (k as f64 + 0.5) / count as f64;
        let joints = self.pose.len();
        let shape = |t: f64, signals: &Signals| -> Vec<Jet> {
            let mut jets = vec![Jet::default(); joints];
            let t = if t > 0.5 * length {
                t + signals.duration - length
            } else {
                t
            };
            signals.at(t, &mut jets);
            jets
        };
        let mut greatest = vec![[0.0f64; 3]; self.joints.len()];
        // Denser than the regressor's instants, so that no peak is missed.
        for k in 0..4 * count {
            let jets = shape(instant(k) / 4.0, signals);
            for (j, most) in self.joints.iter().zip(&mut greatest) {
                let Jet(q, dq, ddq) = jets[*j];
                *most = [
                    most[0].max(q.abs()),
                    most[1].max(dq.abs()),
                    most[2].max(ddq.abs()),
                ];
            }
        }
        for ((scale, greatest), most) in signals.scale.iter_mut().zip(&greatest).zip(&self.most) {
            let scales = greatest
                .iter()
                .zip(most)
                .map(|(is, may)| may / is.max(1e-12));
            *scale = scales.fold(f64::INFINITY, f64::min);
        }
        let rows = self.joints.len();
        for _ in 0..8 {
            let mut w = DMatrix::zeros(count * rows, self.regressor.ncols());
            let mut worst = 0.0f64;
            for k in 0..count {
                let jets = shape(instant(k), signals);
                let mut point = self.pose.clone();
                for (point, jet) in point.iter_mut().zip(&jets) {
                    *point = PlannedMotion {
                        q: point.q + jet.0,
                        dq: jet.1,
                        ddq: jet.2,
                    };
                }
                self.add(&point, &mut w, k * rows);
                worst = worst.max(self.torque_share(&point));
            }
            if worst <= 1.0 {
                return self.condition(&w, count);
            }
            for scale in &mut signals.scale {
                *scale *= 0.8;
            }
        }
        f64::INFINITY
    }

    /// Greatest torque over what is allowed.
    fn torque_share(&mut self, point: &[PlannedMotion]) -> f64 {
        let torques = self.rigid.torques().to_vec();
        let joints = self.joints.iter().zip(&self.most);
        let shares = joints.map(|(j, most)| {
            let link = torques[*j];
            let rotor = self.rigid.rotor(*j) * point[*j].ddq;
            link.abs().max((link + rotor).abs()) / most[3]
        });
        shares.fold(0.0, f64::max)
    }

    fn condition(&self, w: &DMatrix<f64>, count: usize) -> f64 {
        let mut own = w.select_columns(&self.independent);
        for (mut column, length) in own.column_iter_mut().zip(&self.lengths) {
            column /= length * (count as f64).sqrt();
        }
        let gram = own.tr_mul(&own);
        let values = gram.symmetric_eigenvalues();
        let (least, most) = (values.min(), values.max());
        if least > 1e-14 * most {
            (most / least).sqrt()
        } else {
            f64::INFINITY
        }
    }
}

fn gaussian(random: &mut Random) -> f64 {
    (0..12).map(|_| random.uniform(0.0, 1.0)).sum::<f64>() - 6.0
}
