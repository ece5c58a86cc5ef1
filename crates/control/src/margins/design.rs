//! The law's design by the margins: what one set of bandwidths cannot serve.
//!
//! The default serves gears that are stiffer than the drive's position loop. A drive of two to six times
//! the gear's stiffness takes most of the phase itself, and its damping is many times what a light link
//! needs; a soft gear resonates where the rotor observer still believes it. Then the nearest design that keeps
//! the margins is taken: in steps from the default, with less stiffness, another damping and slower
//! observers.
//!
//! The help for a hand is not linear, and no margin is known of it. A joint has as much of it as lets simulations in
//! time come to rest: with as much more gain as the margins must be, and with the phase as a delay.

use super::lifted::comes_to_rest;
use super::{JointLoop, Load, Margins};
use crate::predictive::{Design, DriveLoop};
use std::f64::consts::TAU;

/// Shares of the default's stiffness, damping, `follow` and bandwidths of rotor and link observer, by steps away from
/// it. Chosen on the simulated leg with drives of three times the stiffness and gears of half (docs/control-law.md,
/// Joints for which the default does not serve).
const STIFFNESS: [f64; 5] = [1.0, 0.7, 0.5, 0.35, 0.2];
/// Chosen as [`STIFFNESS`].
const DAMPING: [f64; 3] = [1.0, 1.5, 0.7];
/// Chosen as [`STIFFNESS`].
const FOLLOW: [f64; 3] = [1.0, 0.3, 0.1];
/// Chosen as [`STIFFNESS`].
const ROTOR: [f64; 3] = [1.0, 0.5, 0.25];
/// Chosen as [`STIFFNESS`].
const LINK: [f64; 2] = [1.0, 0.33];
/// Shares of the default's help for a hand, and of the bandwidth of the estimates that it goes by, the most helpful
/// first. With the slowest there is nothing to help with that the law's own do not know. Chosen on the simulated test
/// joint and leg (docs/control-law.md, A hand).
const HAND: [[f64; 2]; 10] = [
    [1.8, 1.0],
    [1.6, 1.0],
    [1.4, 1.0],
    [1.2, 1.0],
    [1.8, 0.9],
    [1.6, 0.9],
    [1.0, 1.0],
    [1.2, 0.9],
    [1.0, 0.9],
    [1.0, 0.8],
];
/// Loads with which a hand is helped.
const HELPED: [Load; 4] = [Load::Free, Load::Light, Load::Spring, Load::Heavy];
/// Frequency at which a delay has the phase that is needed, Hz. Chosen on the simulated test joint and leg: the highest
/// at which loops with help have rung, those of light links. Slower ones bear more.
const RINGS_AT: f64 = 83.0;
/// Least share of its configured damping that a drive may have; data sheets have none. More damping than configured
/// leaves more margin on all joints that were tried. Chosen; no experiment recorded.
const DAMPING_KNOWN: f64 = 0.8;

/// The joint's own design where its loop keeps these margins with every load; else the nearest one that keeps them,
/// also with K_s and K_d on every load that moves, of several as near the one with the widest bandwidth where the rotor
/// is stuck. Where no design keeps them with K_s and K_d, one that does without; the joint's own if there is none. With
/// as much help for a hand as rings with no load, and at most `most_help`.
#[must_use]
pub fn choose_design(joint: &JointLoop, needed: &Margins, most_help: f64) -> Design {
    let design = linear_design(joint, needed);
    let helping = HAND.iter().map(|[help, hand]| Design {
        assist: help * design.assist,
        assist_bandwidth: hand * design.assist_bandwidth,
        ..design
    });
    let mut hardest = 0;
    let may_help = |design: &Design| {
        let helped = matches!(joint.truth.drive, DriveLoop::Position { .. });
        helped && design.assist > 0.0 && design.assist <= most_help
    };
    let helping = helping.filter(may_help).find(|&design| {
        let mut with = *joint;
        with.law.design = design;
        helps(&with, needed, &mut hardest)
    });
    helping.unwrap_or(Design {
        assist: 0.0,
        ..design
    })
}

/// Whether the loop with help for a hand comes to rest with every load, with a drive that damps less than configured,
/// with and without K_s and K_d. `hardest`: the case that has refused the last design, which is tried first.
fn helps(joint: &JointLoop, needed: &Margins, hardest: &mut usize) -> bool {
    let mut in_space = *joint;
    if let DriveLoop::Position { damping, .. } = &mut in_space.truth.drive {
        *damping *= DAMPING_KNOWN;
    }
    let torque = JointLoop {
        stiffness: 0.0,
        damping: 0.0,
        ..in_space
    };
    let late = needed.phase / (TAU * RINGS_AT);
    let cases = [torque, in_space].map(|with| {
        let mut later = with;
        later.truth.delay += late;
        [(with, needed.gain), (later, 1.0)]
    });
    let cases = cases.as_flattened();
    let (before, after) = cases.split_at(*hardest);
    let mut order = after.iter().chain(before);
    let refused = order.position(|(with, gain)| !comes_to_rest(with, HELPED, *gain));
    if let Some(at) = refused {
        *hardest = (*hardest + at) % cases.len();
    }
    refused.is_none()
}

fn linear_design(joint: &JointLoop, needed: &Margins) -> Design {
    let mut search = Search {
        joint: *joint,
        needed: *needed,
        worst: [Load::Free; 2],
    };
    let own = joint.law.design;
    // Gains that are too great for a loop that is in order are to be made smaller.
    if search.keeps(&search.with(own), false) {
        return own;
    }
    let nearest = |search: &mut Search, with_stiffness: bool| {
        let steps = STIFFNESS.len() + DAMPING.len() + FOLLOW.len() + ROTOR.len() + LINK.len() - 5;
        (0..=steps).find_map(|steps| {
            let kept = designs(own, steps).filter(|&design| {
                let joint = search.with(design);
                search.keeps(&joint, with_stiffness)
            });
            let kept: Vec<Design> = kept.collect();
            let bandwidth = |design: &Design| search.with(*design).with(Load::Stuck).bandwidth();
            let widest = kept.iter().map(|design| (bandwidth(design), design));
            widest
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, design)| *design)
        })
    };
    nearest(&mut search, true)
        .or_else(|| nearest(&mut search, false))
        .unwrap_or(own)
}

/// All designs that are so many steps away.
fn designs(own: Design, steps: usize) -> impl Iterator<Item = Design> {
    let counts = [
        STIFFNESS.len(),
        DAMPING.len(),
        FOLLOW.len(),
        ROTOR.len(),
        LINK.len(),
    ];
    (0..counts.iter().product()).filter_map(move |mut k: usize| {
        // The last share changes first.
        let mut places = [0; 5];
        for (place, count) in places.iter_mut().zip(counts).rev() {
            (*place, k) = (k % count, k / count);
        }
        let [s, d, f, r, l] = places;
        (places.iter().sum::<usize>() == steps).then(|| Design {
            rotor: ROTOR[r] * own.rotor,
            link: LINK[l] * own.link,
            follow: FOLLOW[f] * own.follow,
            stiffness: STIFFNESS[s] * own.stiffness,
            damping: DAMPING[d] * own.damping,
            ..own
        })
    })
}

struct Search {
    joint: JointLoop,
    needed: Margins,
    /// Loads that have refused the last designs, without and with K_s and K_d: they are tried first.
    worst: [Load; 2],
}

impl Search {
    fn with(&self, design: Design) -> JointLoop {
        let mut joint = self.joint;
        joint.law.design = design;
        joint
    }

    fn keeps(&mut self, in_space: &JointLoop, with_stiffness: bool) -> bool {
        let torque = JointLoop {
            stiffness: 0.0,
            damping: 0.0,
            ..*in_space
        };
        self.all(0, &torque, &Load::ALL)
            && (!with_stiffness || self.all(1, in_space, &Load::MOVING))
    }

    fn all(&mut self, kind: usize, joint: &JointLoop, loads: &[Load]) -> bool {
        let first = loads
            .iter()
            .position(|load| *load == self.worst[kind])
            .unwrap_or(0);
        let mut order = loads[first..].iter().chain(&loads[..first]);
        let keeps = |load: &Load| joint.with(*load).margins().keeps(&self.needed);
        let refused = order.find(|load| !keeps(load));
        if let Some(load) = refused {
            self.worst[kind] = *load;
        }
        refused.is_none()
    }
}
