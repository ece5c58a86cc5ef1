//! Links that the fit takes far from the URDF's although the torques hardly feel them: their mass, or all of their
//! inertia, stays the URDF's.

use super::consistent::{self, Prior};
use super::contradictions;
use super::equations::{Normal, consistent_solution};
use super::robot::Robot;
use super::select::Choice;
use dynamics::{Inertia, PARAMETERS};
use nalgebra::DVector;

/// Weight of the URDF's inertia of a body that is held, in the fit's own; of a mass, at a deviation of its own size.
const HELD: f64 = 1e4;
/// Share by which the residual's squares may rise: as much as a term of friction must lower them to be taken.
const UNSEEN: f64 = 0.01;
/// Rounds: where one body is held, another may move.
const ROUNDS: usize = 3;

/// A solution with bodies held at the URDF's inertia, and the names of their links.
#[derive(Debug, Clone)]
pub struct Held {
    /// All unknowns.
    pub x: DVector<f64>,
    /// Links of the bodies that are held.
    pub links: Vec<String>,
}

/// Bodies of a solution, each about its own frame.
#[must_use]
pub fn inertias(robot: &Robot<'_>, x: &DVector<f64>) -> Vec<Inertia> {
    (0..robot.bodies)
        .map(|body| consistent::inertia(&consistent::of_body(x, body)))
        .collect()
}

/// How much of a body is held.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    /// Its mass alone: where it lies and how it spreads follow the torques.
    Mass,
    /// All ten parameters.
    All,
}

/// Holds every body that contradicts the URDF's where the torques are explained as well with the URDF's own.
#[must_use]
pub fn hold(
    robot: &Robot<'_>,
    prior: &Prior,
    normal: &Normal,
    choice: &Choice,
    found: &DVector<f64>,
) -> Held {
    let most = normal.residual(found) * (1.0 + UNSEEN);
    let far = |x: &DVector<f64>| -> Vec<usize> {
        let far = contradictions::links(robot, &inertias(robot, x));
        far.into_iter().map(|(body, _)| body).collect()
    };
    let (mut x, mut held): (DVector<f64>, Vec<(usize, Part)>) = (found.clone(), Vec::new());
    for _ in 0..ROUNDS {
        let before = held.len();
        for body in far(&x) {
            if held.iter().any(|(other, _)| *other == body) {
                continue;
            }
            let tried = [Part::Mass, Part::All].into_iter().find_map(|part| {
                let with: Vec<_> = held.iter().copied().chain([(body, part)]).collect();
                let other = solution(robot, prior, normal, choice, &with, found)?;
                let fits = normal.residual(&other) <= most && !far(&other).contains(&body);
                fits.then_some((other, with))
            });
            if let Some(better) = tried {
                (x, held) = better;
            }
        }
        if held.len() == before {
            break;
        }
    }
    let mut bodies: Vec<usize> = held.iter().map(|(body, _)| *body).collect();
    bodies.sort_unstable();
    let links = bodies.iter().map(|body| robot.link(*body).to_owned());
    Held {
        links: links.collect(),
        x,
    }
}

/// The solution with the URDF's mass or inertia of some bodies.
fn solution(
    robot: &Robot<'_>,
    prior: &Prior,
    normal: &Normal,
    choice: &Choice,
    held: &[(usize, Part)],
    found: &DVector<f64>,
) -> Option<DVector<f64>> {
    let mut pulled = normal.clone();
    for &(body, part) in held {
        let at = PARAMETERS * body;
        if part == Part::Mass {
            let mass = robot.model.bodies().get(body + 1)?.inertia.mass;
            let weight = HELD / mass.powi(2).max(1e-12);
            pulled.a[(at, at)] += weight;
            pulled.m[at] += weight * mass;
            continue;
        }
        let weight = prior.curvature[body] * HELD;
        let own = prior.parameters.rows(at, PARAMETERS).into_owned();
        let mut block = pulled.a.view_mut((at, at), (PARAMETERS, PARAMETERS));
        block += weight;
        let mut moment = pulled.m.rows_mut(at, PARAMETERS);
        moment += weight * own;
    }
    consistent_solution(&pulled, prior, choice.lambda, &choice.keep, found)
}
