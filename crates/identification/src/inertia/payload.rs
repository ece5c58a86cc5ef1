//! A payload that is in the hand for a part of the log: the last body's mass and first moment are one thing before a
//! moment and another after it. One solution for all rows would lie between both.

use super::consistent::Prior;
use super::equations::{Grams, Solved};
use super::noise;
use super::robot::Robot;
use super::rows::{BLOCKS, Rows, Sampling};
use super::select::Fit;
use dynamics::PARAMETERS;

/// Mass and first moment: a payload's own inertia is felt little.
const CHANGED: usize = 4;
/// Share of the squares beyond noise that a change explains at least to be named, and of all squares. On sound logs of
/// thirty drawn arms a change explained at most a thirtieth of all squares; with a payload it was more than a third.
const OF_SYSTEMATIC: f64 = 0.5;
const OF_ALL: f64 = 0.25;
/// Least change of a mass, as a share of the link's: friction that warms up resembles less.
const LEAST: f64 = 0.1;

/// A link whose mass changes within the log, where that explains most of what noise leaves open.
#[must_use]
pub fn changes(
    robot: &Robot<'_>,
    rows: &Rows,
    sampling: &Sampling,
    prior: &Prior,
    fit: &Fit,
    grams: &Grams,
) -> Option<String> {
    let all: Vec<usize> = (0..BLOCKS).collect();
    let normal = grams.normal(&all, &fit.weights.sigma);
    let solved = Solved::new(&normal, prior, fit.choice.lambda, &fit.choice.keep)?;
    let square = normal.residual(&solved.x);
    let noise = noise::squares(rows, sampling, &solved.x, grams, &fit.weights);
    let carries = |body: usize| robot.model.bodies().iter().any(|b| b.parent == body + 1);
    let hands: Vec<usize> = (0..robot.bodies).filter(|body| !carries(*body)).collect();
    let tried = (1..BLOCKS).flat_map(|block| {
        let late: Vec<usize> = (block..BLOCKS).collect();
        let late = grams.normal(&late, &fit.weights.sigma);
        let of = |body: &usize| {
            let at = PARAMETERS * body;
            let places: Vec<usize> = (at..at + CHANGED).collect();
            let (change, gain) = solved.change(&late, &places)?;
            Some((gain, *body, block, change[0]))
        };
        hands.iter().filter_map(of).collect::<Vec<_>>()
    });
    let (gain, body, block, mass) = tried.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let own = prior.parameters[PARAMETERS * body];
    if gain < OF_ALL * square || gain < OF_SYSTEMATIC * (square - noise) || mass.abs() < LEAST * own
    {
        return None;
    }
    let first = rows.block.iter().position(|b| *b == block)?;
    let more = if mass > 0.0 { "more" } else { "less" };
    Some(format!(
        "link `{}`: its mass is {:.3} kg {more} from some t = {:.1} s on, which explains {:.0} % of the residual's squares: a payload for a part of the log?",
        robot.link(body),
        mass.abs(),
        rows.stamps[first].1,
        100.0 * gain / square
    ))
}
