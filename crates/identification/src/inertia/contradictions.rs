//! Results that contradict what the URDF claims: masses, centres and inertias of links, torques
//! against `effort`, residuals against the torque they should explain.

use super::checks::Motion;
use super::consistent::of_links;
use super::judge::{Judged, Model};
use super::robot::Robot;
use super::rows::Rows;
use dynamics::Inertia;
use problem::Problem;

/// Ratio of a link's mass to the URDF's, either way, that no error of a URDF has.
const MAX_MASS_RATIO: f64 = 3.0;
/// Ratio of a link's moments of inertia about its centre, either way.
const MAX_INERTIA_RATIO: f64 = 20.0;
/// Way of a centre of mass, as a multiple of the link's own size, and at least, m.
const MAX_CENTRE_WAY: f64 = 3.0;
const MIN_CENTRE_WAY: f64 = 0.15;
/// Mass of a link, as a share of the whole arm's, below which torques hardly depend on it.
const LIGHT: f64 = 0.01;
/// RMS torque, and torque of a hundredth of the time, over `effort`.
const MAX_RMS_EFFORT: f64 = 1.0;
const MAX_PEAK_EFFORT: f64 = 2.0;
/// Share of a moving joint's torque that stays unexplained from which it is named.
const POOR: f64 = 0.5;
/// Error over sigma from which it is named.
const MAX_OVER_SIGMA: f64 = 3.0;

/// Torques that the URDF's `effort` does not allow.
#[must_use]
pub fn efforts(robot: &Robot<'_>, rows: &Rows) -> Vec<Problem> {
    let mut problems = Vec::new();
    for (k, own) in rows.of.iter().enumerate() {
        let joint = &robot.model.joints()[robot.measured[k]];
        let effort = joint.limits.effort;
        if !(effort.is_finite() && effort > 0.0) {
            continue;
        }
        let mut sizes: Vec<f64> = own.raw.iter().map(|x| x.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let peak = sizes
            .get(sizes.len().saturating_sub(1) * 99 / 100)
            .copied()
            .unwrap_or(0.0);
        let square = sizes.iter().map(|x| x * x).sum::<f64>();
        let rms = (square / sizes.len().max(1) as f64).sqrt();
        if rms <= MAX_RMS_EFFORT * effort && peak <= MAX_PEAK_EFFORT * effort {
            continue;
        }
        let unit = robot.unit(k);
        let hint = if rms > 20.0 * effort {
            format!(": is it in m{unit}?")
        } else {
            String::new()
        };
        let reason = format!(
            "tau of `{}` is {rms:.4} {unit} RMS, {peak:.4} at most, beyond its `effort` of {effort} in the URDF{hint}",
            joint.name
        );
        problems.push(Problem::new(
            reason,
            format!("torques in {unit} that the joint can bear"),
        ));
    }
    problems
}

/// Links that cannot be those of the URDF, each with its body.
#[must_use]
pub fn links(robot: &Robot<'_>, inertias: &[Inertia]) -> Vec<(usize, String)> {
    let bodies = &robot.model.bodies()[1..];
    let total: f64 = bodies.iter().map(|b| b.inertia.mass).sum();
    let before = |name: &str| {
        let mut frames = robot.model.frames().iter();
        frames
            .find(|f| f.name == name)
            .map(|f| (f.body.saturating_sub(1), f.inertia))
    };
    let mut out = Vec::new();
    for (name, after) in of_links(robot, inertias) {
        let Some((body, prior)) = before(&name).filter(|(_, p)| p.mass > 0.0) else {
            continue;
        };
        let ratio = after.mass / prior.mass;
        if !(1.0 / MAX_MASS_RATIO..=MAX_MASS_RATIO).contains(&ratio) {
            out.push((
                body,
                format!(
                    "link `{name}`: {:.3} kg, the URDF has {:.3} kg",
                    after.mass, prior.mass
                ),
            ));
            continue;
        }
        if prior.mass < LIGHT * total {
            continue;
        }
        let trace = |i: &Inertia| i.central().trace();
        let size = (trace(&prior) / prior.mass).max(0.0).sqrt();
        let way = (after.center() - prior.center()).norm();
        if way > MIN_CENTRE_WAY && way > MAX_CENTRE_WAY * (size + prior.center().norm()) {
            out.push((body, format!(
                "link `{name}`: its centre of mass moves by {way:.3} m, the link is some {size:.3} m large"
            )));
        }
        let turned = trace(&after) / trace(&prior).max(1e-12);
        // A point mass has no inertia that could be compared.
        if size > 0.01 && !(1.0 / MAX_INERTIA_RATIO..=MAX_INERTIA_RATIO).contains(&turned) {
            out.push((
                body,
                format!("link `{name}`: its moments of inertia are {turned:.2e} times the URDF's"),
            ));
        }
    }
    out
}

/// A verdict for each joint that is poorly explained.
#[must_use]
pub fn joints(robot: &Robot<'_>, judged: &[Judged], motion: &Motion) -> Vec<String> {
    let mut out = Vec::new();
    for (k, own) in judged.iter().enumerate().filter(|(k, _)| motion.moves[*k]) {
        let name = robot.name(k);
        let share = own.residual(Model::Identified) / own.deviation().max(1e-12);
        if share > POOR {
            out.push(format!(
                "joint `{name}`: {:.0} % of its torque's deviation stays unexplained",
                100.0 * share
            ));
        } else if own.sigma_check() > MAX_OVER_SIGMA {
            out.push(format!(
                "joint `{name}`: held-out torques are {:.1} sigma off: other motions are not covered",
                own.sigma_check()
            ));
        }
    }
    out
}
