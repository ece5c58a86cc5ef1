//! Other readings of a log's columns: another sign, zero, order or unit of a joint's columns, another
//! direction of gravity, torques of another time, stamps of another scale. The reading under which the URDF explains the
//! torques far better than as they stand is named.
//!
//! Every reading is judged by one number, the least of `chi² = sum w r² + (phi - phi0)' H
//! (phi - phi0)` over all inertias phi and each joint's friction. The second term is the curvature of
//! the divergence from the URDF's inertias: without it wrong columns are explained by impossible
//! links. Both terms do not depend on the torques' unit, so that readings of other units compare.

mod readings;

use super::consistent::Prior;
use super::friction::Friction;
use super::robot::Robot;
use super::rows::Rows;
use dynamics::{Data, PARAMETERS, joint_torque_regressor};
use nalgebra::{DMatrix, DVector, Vector3};
use readings::{Columns, Reading, SHIFTS, readings};

/// Samples that a reading is judged by.
const SAMPLES: usize = 160;
/// Samples that count as independent: motion goes through few poses in a log.
const INDEPENDENT: f64 = 40.0;
/// Deviation of a torque that no reading explains, as a share of the torque's own.
const UNEXPLAINED: f64 = 0.05;
/// Columns of friction beside the rigid bodies: offset, Coulomb, viscous.
const FRICTION: usize = 3;
/// chi² a joint up to which a log fits as it stands, and no other reading is tried.
const FITS: f64 = 25.0;
/// Share of chi² that another reading may leave at most to be named.
const MUCH_BETTER: f64 = 0.3;
/// The same of another order of all columns, of which there are many.
const ANOTHER_ORDER: f64 = 0.1;
/// Readings that are combined at most: a robot may have two joints with another direction.
const COMBINED: usize = 4;

/// How well a log fits the URDF.
#[derive(Debug, Clone, Default)]
pub struct Fitting {
    /// chi² a joint as the columns stand.
    pub chi: f64,
    /// Share of the torques' deviation that is left then, RMS over the joints.
    pub left: f64,
    /// chi² a joint under the other readings, if these are much better.
    pub other: Option<(f64, f64, Vec<String>)>,
}

impl Fitting {
    /// True if the log contradicts the URDF.
    #[must_use]
    pub fn contradicts(&self) -> bool {
        self.chi > FITS
    }
}

/// States and torques, `[joint][sample]`, and how they are weighted.
#[derive(Clone)]
struct Moments {
    state: Vec<Vec<[f64; 3]>>,
    tau: Vec<Vec<f64>>,
    gravity: Vector3<f64>,
}

/// Judges a log as it stands, and under every other reading if it does not fit.
#[must_use]
pub fn fitting(robot: &Robot<'_>, rows: &Rows, prior: &Prior, friction: &[Friction]) -> Fitting {
    let judge = Judge {
        robot,
        prior,
        speed: friction.iter().map(|f| f.speed.max(1e-3)).collect(),
        moves: friction.iter().map(|f| f.moves).collect(),
    };
    let places: Vec<usize> = places(rows);
    let moments = Moments::new(robot, rows, &places, 0);
    let Some((chi, left)) = judge.chi(&moments) else {
        return Fitting::default();
    };
    let mut out = Fitting {
        chi,
        left,
        other: None,
    };
    if prior.guessed || !out.contradicts() {
        return out;
    }
    let all = readings(robot);
    let (mut now, mut chosen) = (moments, Vec::new());
    let (mut best, mut rest) = (chi, left);
    while chosen.len() < COMBINED && best > FITS {
        let tried = all.iter().filter_map(|reading| {
            let other = now.read(robot, rows, &places, reading)?;
            let (chi, left) = judge.chi(&other)?;
            Some((chi, left, reading, other))
        });
        let Some((chi, left, reading, other)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            break;
        };
        if chi > MUCH_BETTER.max(if chosen.is_empty() { 0.0 } else { 0.6 }) * best {
            break;
        }
        chosen.push(reading.words(robot, rows));
        (best, rest, now) = (chi, left, other);
    }
    if !chosen.is_empty() && best < MUCH_BETTER * chi {
        out.other = Some((best, rest, chosen));
    } else {
        out.other = judge.order(rows, &places, chi);
    }
    out
}

/// Samples that are judged, evenly spread, with room for shifts.
fn places(rows: &Rows) -> Vec<usize> {
    let n = rows.len();
    let margin = (SHIFTS as usize).min(n / 8);
    let inner = n.saturating_sub(2 * margin);
    let count = inner.min(SAMPLES);
    (0..count)
        .map(|k| margin + k * inner / count.max(1))
        .collect()
}

impl Moments {
    fn new(robot: &Robot<'_>, rows: &Rows, places: &[usize], shift: i64) -> Self {
        let shifted = |k: usize| (k as i64 + shift).clamp(0, rows.len() as i64 - 1) as usize;
        Self {
            state: rows
                .of
                .iter()
                .map(|own| places.iter().map(|&k| own.state[k]).collect())
                .collect(),
            tau: rows
                .of
                .iter()
                .map(|own| places.iter().map(|&k| own.tau[shifted(k)]).collect())
                .collect(),
            gravity: robot.model.gravity(),
        }
    }

    /// The moments under a reading; none where it makes no sense.
    fn read(
        &self,
        robot: &Robot<'_>,
        rows: &Rows,
        places: &[usize],
        reading: &Reading,
    ) -> Option<Self> {
        let mut out = self.clone();
        let arrange = |columns: Columns, order: &[usize], out: &mut Self| {
            if columns != Columns::Torques {
                out.state = order.iter().map(|&k| self.state[k].clone()).collect();
            }
            if columns != Columns::Angles {
                out.tau = order.iter().map(|&k| self.tau[k].clone()).collect();
            }
        };
        match reading {
            Reading::Angle(joint, sign, offset) => {
                for [q, dq, ddq] in &mut out.state[*joint] {
                    (*q, *dq, *ddq) = (sign * *q + offset, sign * *dq, sign * *ddq);
                }
            }
            Reading::Torque(joint, factor) => out.tau[*joint].iter_mut().for_each(|x| *x *= factor),
            Reading::Both(joint) => {
                out = self.read(robot, rows, places, &Reading::Angle(*joint, -1.0, 0.0))?;
                out = out.read(robot, rows, places, &Reading::Torque(*joint, -1.0))?;
            }
            Reading::Exchanged(columns, a, b) => {
                let mut order: Vec<usize> = (0..out.tau.len()).collect();
                order.swap(*a, *b);
                arrange(*columns, &order, &mut out);
            }
            Reading::Order(columns, order, _) => arrange(*columns, order, &mut out),
            Reading::AllTorques(factor) => {
                out.tau.iter_mut().flatten().for_each(|x| *x *= factor);
            }
            Reading::Gravity(gravity) => out.gravity = *gravity,
            Reading::Stamps(factor) => {
                for [_, dq, ddq] in out.state.iter_mut().flatten() {
                    (*dq, *ddq) = (*dq / factor, *ddq / (factor * factor));
                }
            }
            Reading::Late(rows_late) => {
                let shifted = Self::new(robot, rows, places, *rows_late);
                // Shifts are of the log as it stands alone: they do not combine.
                let untouched = Self::new(robot, rows, places, 0);
                if untouched.tau != self.tau {
                    return None;
                }
                out.tau = shifted.tau;
            }
            Reading::LateJoint(columns, k, rows_late) => {
                let shifted = |place: &usize| {
                    (*place as i64 + rows_late).clamp(0, rows.len() as i64 - 1) as usize
                };
                let untouched = Self::new(robot, rows, places, 0);
                let own = &rows.of[*k];
                if *columns == Columns::Angles && untouched.state[*k] == self.state[*k] {
                    out.state[*k] = places.iter().map(|p| own.state[shifted(p)]).collect();
                } else if *columns == Columns::Torques && untouched.tau[*k] == self.tau[*k] {
                    out.tau[*k] = places.iter().map(|p| own.tau[shifted(p)]).collect();
                } else {
                    return None;
                }
            }
            Reading::Saturated(k, multiple) => {
                let most = self.tau[*k]
                    .iter()
                    .fold(0.0f64, |most, x| most.max(x.abs()));
                let bound = (multiple * most).max(1e-12);
                out.tau[*k]
                    .iter_mut()
                    .for_each(|x| *x = bound * (*x / bound).atanh());
            }
        }
        Some(out)
    }
}

/// What every reading is judged by.
struct Judge<'a> {
    robot: &'a Robot<'a>,
    prior: &'a Prior,
    speed: Vec<f64>,
    moves: Vec<bool>,
}

impl Judge<'_> {
    /// The order of all columns under which a log fits far better: exchanges one after another, the best first.
    fn order(&self, rows: &Rows, places: &[usize], chi: f64) -> Option<(f64, f64, Vec<String>)> {
        let n = self.robot.measured.len();
        let mut order: Vec<usize> = (0..n).collect();
        let (mut best, mut rest) = (chi, 0.0);
        let first = Moments::new(self.robot, rows, places, 0);
        for _ in 1..n {
            let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
            let tried = pairs.filter_map(|(a, b)| {
                let mut other = order.clone();
                other.swap(a, b);
                let reading = Reading::Order(Columns::All, other.clone(), "");
                let moments = first.read(self.robot, rows, places, &reading)?;
                let (chi, left) = self.chi(&moments)?;
                Some((chi, left, other))
            });
            let (chi, left, other) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
            if chi >= best {
                break;
            }
            (best, rest, order) = (chi, left, other);
        }
        let moved: Vec<usize> = (0..n).filter(|&k| order[k] != k).collect();
        (moved.len() > 2 && best < ANOTHER_ORDER * chi).then(|| {
            let each = moved.iter().map(|&k| {
                let (own, of) = (self.robot.name(order[k]), self.robot.name(k));
                format!("those of `{own}` are of `{of}`")
            });
            let words = each.collect::<Vec<_>>().join(", ");
            (
                best,
                rest,
                vec![format!("columns q and tau come in another order ({words})")],
            )
        })
    }

    /// chi² a joint, and the share of the torques' deviation that is left.
    fn chi(&self, moments: &Moments) -> Option<(f64, f64)> {
        let joints = moments.tau.len();
        let samples = moments.tau.first().map_or(0, Vec::len);
        let rigid = PARAMETERS * self.robot.bodies;
        let unknowns = rigid + FRICTION * joints;
        let weight: Vec<f64> = moments.tau.iter().map(|tau| weight(tau)).collect();
        let mut model = self.robot.model.clone();
        model.set_gravity(moments.gravity);
        let (mut data, n) = (Data::new(&model), model.joint_count());
        let mut state = [self.robot.rest.clone(), vec![0.0; n], vec![0.0; n]];
        let mut regressor = DMatrix::zeros(n, rigid);
        let mut x = DMatrix::zeros(unknowns, joints * samples);
        let mut y = DVector::zeros(joints * samples);
        for sample in 0..samples {
            for (k, &joint) in self.robot.measured.iter().enumerate() {
                (0..3).for_each(|d| state[d][joint] = moments.state[k][sample][d]);
            }
            let [q, dq, ddq] = &state;
            joint_torque_regressor(&model, &mut data, q, dq, ddq, &mut regressor);
            for (k, &joint) in self.robot.measured.iter().enumerate() {
                let (row, w) = (joints * sample + k, weight[k]);
                (0..rigid).for_each(|p| x[(p, row)] = w * regressor[(joint, p)]);
                let v = dq[joint] / self.speed[k];
                let own = [1.0, (v / 0.02).tanh(), v];
                let terms = if self.moves[k] { FRICTION } else { 1 };
                (0..terms).for_each(|t| x[(rigid + FRICTION * k + t, row)] = w * own[t]);
                y[row] = w * moments.tau[k][sample];
            }
        }
        let mut a = &x * x.transpose();
        let mut b = &x * &y;
        let mut square = y.norm_squared();
        for (body, h) in self.prior.curvature.iter().enumerate() {
            let place = PARAMETERS * body;
            let own = self.prior.parameters.rows(place, PARAMETERS).into_owned();
            let pull = h * &own;
            let mut block = a.view_mut((place, place), (PARAMETERS, PARAMETERS));
            block += h;
            let mut moment = b.rows_mut(place, PARAMETERS);
            moment += &pull;
            square += own.dot(&pull);
        }
        // Friction of the size of the torque itself is likely.
        for k in rigid..unknowns {
            let size = weight[(k - rigid) / FRICTION] * (samples as f64).sqrt();
            a[(k, k)] += (size * UNEXPLAINED).powi(2).max(1e-12) / INDEPENDENT;
        }
        let solution = a.cholesky()?.solve(&b);
        let chi = square - b.dot(&solution);
        let left = (x.tr_mul(&solution) - &y).norm_squared() / (joints as f64 * INDEPENDENT);
        Some((
            (chi / joints as f64).max(0.0),
            (left * UNEXPLAINED * UNEXPLAINED).sqrt(),
        ))
    }
}

/// Weight of a torque's rows: one over the deviation that no reading explains.
fn weight(tau: &[f64]) -> f64 {
    let n = tau.len().max(1) as f64;
    let mean = tau.iter().sum::<f64>() / n;
    let deviation = (tau.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    (INDEPENDENT / n).sqrt() / (UNEXPLAINED * deviation.max(1e-9))
}
