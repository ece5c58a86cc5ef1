//! Torques that are the URDF's but for a factor (a unit, a gear ratio), that end at a bound while the joint moves,
//! and friction that drives the motion instead of braking it: each with its likely cause.

use super::JointFriction;
use super::checks::{Motion, model_torques};
use super::friction::{Friction, TERMS, Term};
use super::judge::Judged;
use super::robot::Robot;
use super::rows::{JointRows, Rows};
use crate::least_squares::Batch;
use problem::Problem;

/// Share of a joint's torque that the URDF's must explain before its factor is judged.
const EXPLAINED: f64 = 0.8;
/// Factor, either way, that no error of a URDF's masses has.
const MAX_FACTOR: f64 = 3.0;
/// Factors of all joints that are one: largest over smallest.
const ONE_FACTOR: f64 = 2.0;
/// Share of the rows at the largest torque, while the joint moves, from which it is a bound; different torques
/// and multiple of the rows at each, so that a coarse resolution is none.
const AT_BOUND: f64 = 0.02;
const MIN_TORQUES: usize = 20;
const CROWDED: f64 = 5.0;
/// Speed of a moving joint as a share of its own.
const MOVES: f64 = 0.05;
/// Friction along the motion, as a share of the torque's deviation, that is no scatter.
const DRIVING: f64 = 0.02;

/// Joints of which the torque is several times the URDF's, or a part of it.
#[must_use]
pub fn factors(robot: &Robot<'_>, rows: &Rows, friction: &[Friction]) -> Vec<Problem> {
    let model = model_torques(robot, rows);
    let moving = (0..rows.joints).filter(|&k| friction[k].moves);
    let judged = moving.filter_map(|k| {
        let (factor, explained) = factor(&rows.of[k], &model[k])?;
        (explained > EXPLAINED && factor > 0.0).then_some((k, factor, explained))
    });
    let judged: Vec<(usize, f64, f64)> = judged.collect();
    let far = |factor: f64| !(1.0 / MAX_FACTOR..=MAX_FACTOR).contains(&factor);
    let cause = |factor: f64| {
        if factor < 1.0 {
            "a motor current, a torque on the motor's side of the gear, or another unit?"
        } else {
            "a gear ratio that counts twice, or another unit?"
        }
    };
    let allowed = "torques of the joint in N·m (N): motor current × torque constant × gear ratio; --accept takes them as they stand";
    let sizes = judged.iter().map(|(_, factor, _)| *factor);
    let (least, most) = sizes.fold((f64::MAX, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
    if judged.len() > 1 && judged.iter().all(|(_, x, _)| far(*x)) && most < ONE_FACTOR * least {
        let middle = (least * most).sqrt();
        let reason = format!(
            "tau is some {middle:.3} times the URDF's torques: {}",
            cause(middle)
        );
        return vec![Problem::new(reason, allowed)];
    }
    let each = judged.into_iter().filter(|(_, x, _)| far(*x));
    each.map(|(k, factor, explained)| {
        let reason = format!(
            "tau of `{}` is {factor:.4} times the URDF's torque, which explains {:.0} % of it: {}",
            robot.name(k),
            100.0 * explained,
            cause(factor)
        );
        Problem::new(reason, allowed)
    })
    .collect()
}

/// Factor of the model's torque in a joint's, beside offset, friction and a rotor, and the share of its squares that
/// the model explains.
fn factor(own: &JointRows, model: &[f64]) -> Option<(f64, f64)> {
    let n = own.place.len() - TERMS.len();
    let (mut with, mut without) = (Batch::new(5), Batch::new(5));
    for (sample, (tau, model)) in own.tau.iter().zip(model).enumerate() {
        let terms = &own.row(sample)[n..n + 3];
        let row = [*model, terms[0], terms[1], terms[2], own.state[sample][2]];
        with.add(&row, *tau);
        without.add(&row, *tau);
    }
    let with = with.solve(1e-9)?;
    let without = without.solve_columns(1e-9, |k| k > 0)?;
    let explained = 1.0 - (with.rms / without.rms.max(1e-30)).powi(2);
    Some((with.x[0], explained))
}

/// Joints of which the torque stays at one number, its largest or least, while they move.
#[must_use]
pub fn bounds(robot: &Robot<'_>, rows: &Rows, friction: &[Friction]) -> Vec<Problem> {
    let mut problems = Vec::new();
    for (k, own) in rows
        .of
        .iter()
        .enumerate()
        .filter(|(k, _)| friction[*k].moves)
    {
        let mut torques = own.raw.clone();
        torques.sort_unstable_by(f64::total_cmp);
        torques.dedup();
        let [least, .., most] = torques[..] else {
            continue;
        };
        let moves = |sample: &usize| own.state[*sample][1].abs() > MOVES * friction[k].speed;
        let count = |bound: f64| {
            let at = |sample: &usize| (own.raw[*sample] - bound).abs() <= 1e-9 * bound.abs();
            (0..own.raw.len()).filter(|s| at(s) && moves(s)).count() as f64
        };
        let all = own.raw.len() as f64;
        let usual = (CROWDED * all / torques.len() as f64).max(AT_BOUND * all);
        let (at, bound) = [least, most]
            .map(|b| (count(b), b))
            .into_iter()
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a });
        if torques.len() >= MIN_TORQUES && at > usual {
            let reason = format!(
                "tau of `{}` stays at {bound:.3} in {:.0} % of the rows while the joint moves: its measurement ends there",
                robot.name(k),
                100.0 * at / all
            );
            let allowed =
                "torques within the sensor's range; --accept where the torque itself was limited";
            problems.push(Problem::new(reason, allowed));
        }
    }
    problems
}

/// Friction of most joints that pushes along the motion: nothing does that but a log that runs backwards.
#[must_use]
pub fn driving(
    robot: &Robot<'_>,
    friction: &[JointFriction],
    judged: &[Judged],
    motion: &Motion,
) -> Option<String> {
    let of = |joint: &JointFriction| -> f64 {
        let term = |(term, x): &(Term, f64)| match term {
            Term::Coulomb => *x,
            Term::Viscous => 0.5 * joint.speed * x,
            _ => 0.0,
        };
        joint.terms.iter().map(term).sum()
    };
    let moving: Vec<usize> = (0..friction.len()).filter(|&k| motion.moves[k]).collect();
    let share = |k: &usize| of(&friction[*k]) / judged[*k].deviation().max(1e-12);
    let driven: Vec<usize> = moving
        .iter()
        .copied()
        .filter(|k| share(k) < -DRIVING)
        .collect();
    let worst = driven.iter().min_by(|a, b| share(a).total_cmp(&share(b)))?;
    (2 * driven.len() > moving.len()).then(|| {
        format!(
            "friction of {} of {} joints pushes along the motion ({:.3} {} of `{}`): does the log run backwards in time?",
            driven.len(),
            moving.len(),
            of(&friction[*worst]),
            robot.unit(*worst),
            robot.name(*worst)
        )
    })
}
