//! Two faults at once: in the same cycle, one after the other, one hidden before.

use problem::Problem;
use robot_state::Event;
use serde::Serialize;

use crate::motion::{Motion, Moved, Reference};
use crate::rig::Fault;
use crate::robots::Prepared;
use crate::run::{begin, observed};
use crate::scenarios::{Bound, Place, Scenario, all, noise, places};

/// Two faults, and when they begin.
#[derive(Clone, Copy)]
pub struct Pair {
    /// The faults.
    pub scenarios: [Scenario; 2],
    /// Where each strikes; in the same state of the same robot.
    pub places: [Place; 2],
    /// Cycles from the first one's beginning to the second one's.
    pub delay: usize,
}

/// What a pair led to.
#[derive(Debug, Clone, Serialize)]
pub struct PairOutcome {
    /// Robot, state, faults, joints.
    pub robot: String,
    /// State at the beginning.
    pub start: &'static str,
    /// Names of the faults.
    pub faults: [&'static str; 2],
    /// Names of the joints.
    pub joints: [String; 2],
    /// Cycles between the beginnings.
    pub delay: usize,
    /// The latched fault's number, or 0.
    pub fault: u32,
    /// Numbers of the events that came.
    pub events: Vec<u32>,
    /// True motion.
    #[serde(flatten)]
    pub moved: Moved,
}

impl PairOutcome {
    /// More than 5 degrees, or half of a velocity limit.
    #[must_use]
    pub fn injures(&self) -> bool {
        self.moved.displacement > 5_f64.to_radians() || self.moved.speed_share > 0.5
    }

    /// More than a degree.
    #[must_use]
    pub fn is_beyond(&self) -> bool {
        self.moved.displacement > 1_f64.to_radians()
    }
}

/// Draws `count` pairs of faults that should not move a robot by themselves, by a seed.
#[must_use]
pub fn draw(prepared: &[Prepared], count: usize, seed: u64) -> Vec<(usize, Pair)> {
    let mut random = noise(seed.max(1));
    let mut index = move |n: usize| ((random() + 1.0) / 2.0 * n as f64) as usize % n.max(1);
    let moves_itself = |s: &Scenario| {
        let bounds = [Some(s.bound), s.bound_of_currents];
        let still = [Bound::Motion, Bound::MotionAndStep, Bound::Straying];
        s.setup.is_some()
            || bounds
                .into_iter()
                .flatten()
                .any(|bound| !still.contains(&bound))
    };
    let scenarios: Vec<_> = all().into_iter().filter(|s| !moves_itself(s)).collect();
    // Of each robot the places of every fault, once.
    let of_robot: Vec<Vec<(Scenario, Place)>> = prepared
        .iter()
        .map(|prepared| {
            let its = |s: &Scenario| {
                places(prepared, s, false)
                    .into_iter()
                    .map(|p| (*s, p))
                    .collect()
            };
            scenarios
                .iter()
                .flat_map(|s| -> Vec<_> { its(s) })
                .collect()
        })
        .collect();
    let mut pairs = Vec::with_capacity(count);
    while pairs.len() < count {
        let robot = index(prepared.len());
        let its = &of_robot[robot];
        if its.is_empty() {
            continue;
        }
        let first = its[index(its.len())];
        let same: Vec<_> = its
            .iter()
            .filter(|(_, p)| p.start == first.1.start)
            .collect();
        let second = *same[index(same.len())];
        // In the same cycle, up to 30 ms apart, or hidden for a while.
        let delay = [0, 1 + index(30), 100 + index(300)][index(3)];
        pairs.push((
            robot,
            Pair {
                scenarios: [first.0, second.0],
                places: [first.1, second.1],
                delay,
            },
        ));
    }
    pairs
}

/// Runs a pair.
///
/// # Errors
/// A robot that does not get into the state.
pub fn run_pair(
    prepared: &Prepared,
    pair: &Pair,
    reference: &Reference,
) -> Result<PairOutcome, Problem> {
    let [place, other] = pair.places;
    let (mut rig, mut client) = begin(prepared, &place, None)?;
    let mut motion = Motion::of(&rig, Some(reference));
    let mut faults = [
        (pair.scenarios[0].make)(place),
        (pair.scenarios[1].make)(other),
    ];
    let delay = pair.delay;
    let mut act: Fault = Box::new(move |at, rig, k| {
        if let Some(client) = &mut client {
            client(at, rig, k);
        }
        faults[0](at, rig, k);
        if k >= delay {
            faults[1](at, rig, k - delay);
        }
    });
    let before = rig.cycle.record().events;
    for k in 0..observed(place.start) {
        rig.step(Some((&mut act, k)));
        motion.take(&rig);
    }
    let joints = &rig.robot.parameters.joints;
    Ok(PairOutcome {
        robot: prepared.variant.name(),
        start: place.start.name(),
        faults: [pair.scenarios[0].name, pair.scenarios[1].name],
        joints: [place, other].map(|place| joints[place.joint].name.clone()),
        delay,
        fault: rig.cycle.record().fault,
        events: (Event::ALL.iter())
            .filter(|event| rig.cycle.record().events[event.index()] > before[event.index()])
            .map(|event| event.number())
            .collect(),
        moved: motion.moved,
    })
}
