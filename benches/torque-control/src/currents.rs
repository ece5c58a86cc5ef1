//! Gains possible with a current-commanded drive: the predictive law around a current, by its margins.

use crate::joint::JOINTS;
use crate::robots::load;
use control::margins::{JointLoop, Load, NEEDED, least_margins};
use control::predictive::{Design, DriveLoop, LawParameters};
use std::f64::consts::TAU;

/// Rate of the loop, Hz, cycles of transport delay, and where the loop runs.
pub(crate) const LOOPS: [(f64, f64, &str); 5] = [
    (1000.0, 1.0, "over a bus"),
    (1000.0, 0.0, "over a bus that answers within the cycle"),
    (2500.0, 1.0, "over a fast bus"),
    (2500.0, 0.0, "in the drive"),
    (5000.0, 0.0, "in the drive"),
];
/// Lag of the drive's current loop and converter, s.
const CURRENT_LOOP: f64 = 0.15e-3;

/// The design with the widest margins, over all joints.
pub(crate) struct Best {
    pub(crate) design: Design,
    /// Phase, degrees, and gain, dB.
    pub(crate) margins: (f64, f64),
    /// Every joint keeps 30 degrees and 6 dB.
    pub(crate) kept: bool,
    /// Least -3 dB of the blocked link, sliding and stuck, Hz.
    pub(crate) bandwidth: [f64; 2],
}

/// The best of a grid of designs.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn best(&(rate, cycles, _): &(f64, f64, &str)) -> Result<Best, String> {
    let joints = JOINTS.map(|(robot, name, _)| {
        let (robot, _) = load(robot)?;
        let found = robot.parameters.joints.iter().find(|j| j.name == name);
        found.cloned().ok_or_else(|| format!("no joint {name}"))
    });
    let joints = joints.into_iter().collect::<Result<Vec<_>, String>>()?;
    let loops = |design: Design| {
        joints.iter().map(move |joint| {
            let n = joint.estimator.gear_ratio;
            let generator = &joint.estimator.wave_generator;
            let law = LawParameters {
                sample_period: 1.0 / rate,
                delay: cycles / rate + CURRENT_LOOP,
                drive: DriveLoop::Current {
                    torque_constant: generator.torque_constant * n,
                    viscous: generator.viscous_friction * n * n,
                },
                design,
                ..joint.law
            };
            JointLoop::nominal(law, CURRENT_LOOP, joint.link_inertia)
        })
    };
    let mut found: Option<(f64, Best)> = None;
    for rotor in [20.0, 30.0, 40.0, 60.0, 100.0] {
        for (stiffness, link) in [(1.0, 60.0), (1.5, 60.0), (2.0, 60.0), (1.5, 25.0)] {
            let design = Design {
                rotor: TAU * rotor,
                link: TAU * link,
                stiffness,
                ..Design::default()
            };
            let least = loops(design)
                .map(|joint| least_margins(&joint, &Load::ALL).0)
                .reduce(|a, b| a.least(b))
                .ok_or("no joints")?;
            let kept = least.keeps(&NEEDED);
            let margins = least.in_degrees_and_db();
            // Of those that keep the margins the quickest; else that which is nearest to them.
            let score = if kept {
                10.0 + rotor * stiffness
            } else {
                (margins.0 / 30.0).min(margins.1 / 6.0)
            };
            if found.as_ref().is_none_or(|(best, _)| score > *best) {
                let least = |load: Load| {
                    let all = loops(design).map(|joint| joint.with(load).bandwidth());
                    all.fold(f64::INFINITY, f64::min)
                };
                let best = Best {
                    design,
                    margins,
                    kept,
                    bandwidth: [least(Load::Blocked), least(Load::Stuck)],
                };
                found = Some((score, best));
            }
        }
    }
    found
        .map(|(_, best)| best)
        .ok_or_else(|| "no design".to_owned())
}
