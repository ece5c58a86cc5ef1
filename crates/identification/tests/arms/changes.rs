//! Contradictions between a log and its URDF, each drawn in size and place.

use super::drawn::{Drawn, RATE, between};
use identification::inertia::{JointColumns, RobotLog};
use std::f64::consts::{FRAC_PI_2, TAU};
use test_support::Random;

/// A contradiction's name, and the log that it makes of an arm's.
pub(crate) type Change = (&'static str, fn(&Drawn, &mut Random) -> RobotLog);

fn changed(arm: &Drawn, change: impl FnOnce(&mut RobotLog)) -> RobotLog {
    let mut log = arm.log(0.0, None);
    change(&mut log);
    log
}

fn columns(log: &mut RobotLog, joint: usize) -> &mut JointColumns {
    log.joints[joint].as_mut().unwrap()
}

/// A low-pass of first order, Hz.
fn low_pass(x: &mut [f64], cut_off: f64) {
    let pole = (-TAU * cut_off / RATE).exp();
    let mut state = x[0];
    for x in x {
        state = pole * state + (1.0 - pole) * *x;
        *x = state;
    }
}

fn any(log: &RobotLog, random: &mut Random) -> usize {
    random.below(log.joints.len())
}

pub(crate) const CHANGES: &[Change] = &[
    ("angles within half a turn", |arm, _| {
        changed(arm, |log| {
            for columns in log.joints.iter_mut().flatten() {
                let within = |q: &mut f64| *q -= TAU * (*q / TAU).round();
                columns.q.iter_mut().for_each(within);
            }
        })
    }),
    ("zeros in some rows", |arm, random| {
        changed(arm, |log| {
            for _ in 0..12 {
                let (k, row) = (any(log, random), random.below(log.t.len()));
                columns(log, k).q[row] = 0.0;
                let (k, row) = (any(log, random), random.below(log.t.len()));
                columns(log, k).tau[row] = 0.0;
            }
        })
    }),
    ("columns in another order", |arm, random| {
        changed(arm, |log| {
            let (a, n) = (any(log, random), log.joints.len());
            log.joints.swap(a, (a + 1 + random.below(n - 1)) % n);
            let (a, b) = (any(log, random), any(log, random));
            if n > 3 {
                log.joints.swap(a, b);
            }
        })
    }),
    ("a joint counted the other way", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            columns(log, k).q.iter_mut().for_each(|q| *q = -*q);
        })
    }),
    ("an angle that never changes", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            let q = columns(log, k).q[0];
            columns(log, k).q.fill(q);
        })
    }),
    ("one torque in mN·m", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            columns(log, k).tau.iter_mut().for_each(|tau| *tau *= 1e3);
        })
    }),
    ("one angle in degrees", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            columns(log, k)
                .q
                .iter_mut()
                .for_each(|q| *q = q.to_degrees());
        })
    }),
    ("late torques", |arm, random| {
        arm.log(between(random, (5e-3, 0.1)), None)
    }),
    ("low-passed torques", |arm, random| {
        let cut_off = between(random, (0.5, 5.0));
        changed(arm, |log| {
            let each = log.joints.iter_mut().flatten();
            each.for_each(|columns| low_pass(&mut columns.tau, cut_off));
        })
    }),
    ("low-passed angles", |arm, random| {
        let cut_off = between(random, (0.5, 5.0));
        changed(arm, |log| {
            let each = log.joints.iter_mut().flatten();
            each.for_each(|columns| low_pass(&mut columns.q, cut_off));
        })
    }),
    ("stamps of another scale", |arm, random| {
        let factor = [0.5, 0.8, 1.25, 2.0][random.below(4)];
        changed(arm, |log| log.t.iter_mut().for_each(|t| *t *= factor))
    }),
    ("a payload for half of the log", |arm, _| {
        arm.log(0.0, Some(1500))
    }),
    ("a joint's zero a quarter turn off", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            columns(log, k).q.iter_mut().for_each(|q| *q += FRAC_PI_2);
        })
    }),
    ("a clipped torque", |arm, random| {
        changed(arm, |log| {
            let k = any(log, random);
            let tau = &mut columns(log, k).tau;
            let most = tau.iter().fold(0.0f64, |most, x| most.max(x.abs()));
            let bound = most * (0.4 + 0.4 * random.unit());
            tau.iter_mut().for_each(|x| *x = x.clamp(-bound, bound));
        })
    }),
    ("a log that runs backwards", |arm, _| {
        changed(arm, |log| {
            for columns in log.joints.iter_mut().flatten() {
                columns.q.reverse();
                columns.tau.reverse();
            }
        })
    }),
    ("a column that freezes", |arm, random| {
        changed(arm, |log| {
            let (k, rows) = (any(log, random), log.t.len());
            let from = rows / 10 + random.below(rows / 2);
            let to = (from + rows / 5 + random.below(rows / 3)).min(rows);
            let own = columns(log, k);
            let column = if random.below(2) == 0 {
                &mut own.q
            } else {
                &mut own.tau
            };
            let kept = column[from];
            column[from..to].fill(kept);
        })
    }),
];
