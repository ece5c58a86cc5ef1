//! The law's design by the margins: what one set of bandwidths cannot serve.
//!
//! A hand that turns a joint round feels the drive's damping until the law has noticed. So `follow` is made as quick as
//! the margins allow, up to a bound: beyond it forces on soft objects swing more, and torques ripple more, than
//! reversals gain. A quicker link observer would serve a hand as well, and a wrong torque too: a joint whose encoder
//! drifts moved further before the drift was noticed.
//!
//! The default serves gears that are stiffer than the drive's position loop. A drive of two to six times
//! the gear's stiffness takes most of the phase itself, and its damping is many times what a light link
//! needs; a soft gear resonates where the rotor observer still believes it. Then the nearest design that keeps
//! the margins is taken: in steps from the default, with less stiffness, another damping and slower
//! observers.

use super::{JointLoop, Load, Margins};
use crate::predictive::{Design, DriveModel};

/// Shares of the default's stiffness, damping, `follow` and bandwidths of rotor and link observer, by steps away from
/// it.
const STIFFNESS: [f64; 5] = [1.0, 0.7, 0.5, 0.35, 0.2];
const DAMPING: [f64; 3] = [1.0, 1.5, 0.7];
const FOLLOW: [f64; 3] = [1.0, 0.3, 0.1];
const ROTOR: [f64; 3] = [1.0, 0.5, 0.25];
const LINK: [f64; 2] = [1.0, 0.33];
/// Shares of the default's `follow` of designs that are quicker, the quickest first.
const QUICKER: [f64; 4] = [4.0, 3.0, 2.0, 1.5];
/// Shares of its configured damping that a drive may have; data sheets have none.
const DAMPING_KNOWN: [f64; 3] = [1.0, 0.8, 1.2];

/// The quickest design with which the joint's loop keeps these margins: with every load, with K_s and K_d on every load
/// that moves, and with another damping of the drive. Else its own, where that keeps them; else the nearest one that
/// does, of several as near the one with the widest bandwidth where the rotor is stuck. Where no design keeps them with
/// K_s and K_d, one that does without; the joint's own if there is none. `quicker`: one that is quicker than its own is
/// allowed.
#[must_use]
pub fn choose_design(joint: &JointLoop, needed: &Margins, quicker: bool) -> Design {
    let mut search = Search {
        joint: *joint,
        needed: *needed,
        worst: [Load::Free; 2],
    };
    let own = joint.law.design;
    let quick = quicker.then(|| quickest(&mut search, own)).flatten();
    if let Some(design) = quick {
        return design;
    }
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

/// The quickest design that keeps the margins, also with a drive whose damping is not as configured: a hand that turns
/// the joint round feels the drive's damping until `follow` has noticed.
fn quickest(search: &mut Search, own: Design) -> Option<Design> {
    let DriveModel::Position { damping, .. } = search.joint.truth.drive else {
        return None;
    };
    let mut quicker = QUICKER.iter().map(|share| Design {
        follow: share * own.follow,
        ..own
    });
    let mut keeps = |design: &Design, share: f64| {
        let mut joint = search.with(*design);
        if let DriveModel::Position { damping: truth, .. } = &mut joint.truth.drive {
            *truth = share * damping;
        }
        search.keeps(&joint, true)
    };
    quicker.find(|design| DAMPING_KNOWN.iter().all(|&share| keeps(design, share)))
}

/// All designs that are so many steps away.
fn designs(own: Design, steps: usize) -> impl Iterator<Item = Design> {
    let indices = STIFFNESS
        .iter()
        .enumerate()
        .flat_map(move |(s, stiffness)| {
            DAMPING.iter().enumerate().flat_map(move |(d, damping)| {
                FOLLOW.iter().enumerate().flat_map(move |(f, follow)| {
                    ROTOR.iter().enumerate().flat_map(move |(r, rotor)| {
                        LINK.iter().enumerate().map(move |(l, link)| {
                            let design = Design {
                                rotor: rotor * own.rotor,
                                link: link * own.link,
                                follow: follow * own.follow,
                                stiffness: stiffness * own.stiffness,
                                damping: damping * own.damping,
                                ..own
                            };
                            (s + d + f + r + l, design)
                        })
                    })
                })
            })
        });
    indices
        .filter(move |(away, _)| *away == steps)
        .map(|(_, design)| design)
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
