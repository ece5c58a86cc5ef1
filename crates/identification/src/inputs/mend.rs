//! A joint's log mended where there is one mending: wraps taken out, bad samples bridged, rows left
//! out in which a channel kept its last reading. Everything that was done is a finding.

use super::LogKind;
use super::signals::span;
use crate::log::LogRow;
use inspection::{Channel, Defect, Finding, Quantity, Severity, held};
use joint_file::JointFile;
use std::f64::consts::TAU;

/// A log after mending.
#[derive(Debug, Clone, Default)]
pub(super) struct Mended {
    pub(super) rows: Vec<LogRow>,
    pub(super) findings: Vec<Finding>,
}

/// Share of the motor side's range that its wraps have at least.
const WRAP_SHARE: f64 = 0.9;
/// Relative spread of wraps.
const WRAP_SPREAD: f64 = 0.05;
/// Share of another channel's range that it crosses while one stands still.
const WENT_ON: f64 = 0.05;
/// A channel that repeats this share of its samples elsewhere is coarse, and standing means nothing.
const COARSE: f64 = 0.2;
/// Shortest stretch that counts as standing still, s.
const HELD_S: f64 = 0.08;

/// Torsion that no gear reaches, rad: an encoder that stands while the other moves further is stuck.
const MAX_TWIST: f64 = 0.02;

/// Share of the rows with such readings up to which they are bad samples.
const MAX_TWISTED: f64 = 0.01;

type Column = (
    &'static str,
    Quantity,
    fn(&LogRow) -> f64,
    fn(&mut LogRow, f64),
);

const COLUMNS: [Column; 4] = [
    ("q", Quantity::Angle, |r| r.q, |r, x| r.q = x),
    ("theta", Quantity::Way, |r| r.theta, |r, x| r.theta = x),
    ("i", Quantity::Effort, |r| r.current, |r, x| r.current = x),
    (
        "tau_sensor",
        Quantity::Effort,
        |r| r.tau_sensor,
        |r, x| r.tau_sensor = x,
    ),
];

/// Mends a log whose stamps increase.
pub(super) fn mend(joint: &JointFile, rows: Vec<LogRow>, kind: LogKind) -> Mended {
    let t: Vec<f64> = rows.iter().map(|r| r.t).collect();
    let mut lost = vec![false; rows.len()];
    let mut out = Mended {
        rows,
        findings: Vec::new(),
    };
    for (column, quantity, get, set) in COLUMNS {
        let mut values: Vec<f64> = out.rows.iter().map(get).collect();
        if !values.iter().all(|x| x.is_finite()) {
            continue;
        }
        let name = kind.name(column);
        if column == "theta" {
            let q: Vec<f64> = out.rows.iter().map(|r| r.q).collect();
            out.findings.extend(motor_wraps(
                &t,
                &mut values,
                &q,
                joint.joint.gear_ratio,
                name,
            ));
        }
        let found = inspection::inspect(
            &t,
            Channel {
                name,
                quantity,
                values: &values,
            },
        );
        for &row in &found.lost {
            lost[row] |= found.findings.iter().any(|f| f.defect == Defect::Frozen)
                && frozen_at(&values, row);
        }
        out.findings.extend(found.findings);
        for (row, x) in out.rows.iter_mut().zip(&found.values) {
            set(row, *x);
        }
    }
    out.findings
        .extend(twisted(&t, &mut out.rows, joint.joint.gear_ratio));
    standing(&t, &mut out, kind, &mut lost, joint.joint.gear_ratio);
    let mut row = 0..;
    out.rows
        .retain(|_| row.next().is_some_and(|r: usize| !lost[r]));
    out
}

/// Bridges rows in which one encoder's reading, and no neighbour's, leaves the other by more than a gear can: bad
/// samples that are small beside the motion.
fn twisted(t: &[f64], rows: &mut [LogRow], ratio: f64) -> Option<Finding> {
    let torsion: Vec<f64> = rows.iter().map(|r| r.theta / ratio - r.q).collect();
    let alone = |&k: &usize| {
        let [before, own, behind] = [torsion[k - 1], torsion[k], torsion[k + 1]];
        (behind - before).abs() < 0.5 * MAX_TWIST
            && (own - 0.5 * (before + behind)).abs() > MAX_TWIST
    };
    let bad: Vec<usize> = (1..rows.len().saturating_sub(1)).filter(alone).collect();
    let first = *bad.first()?;
    if bad.len() as f64 > MAX_TWISTED * rows.len() as f64 {
        return None;
    }
    for &k in &bad {
        let (before, behind) = (rows[k - 1], rows[k + 1]);
        rows[k].theta = 0.5 * (before.theta + behind.theta);
        rows[k].q = 0.5 * (before.q + behind.q);
    }
    Some(Finding {
        defect: Defect::Spikes,
        severity: Severity::Warning,
        channel: "theta/N - q".to_owned(),
        row: Some(first),
        t: t[first],
        rows: bad.len(),
        text: format!(
            "theta/N - q leaps by {:.4} rad and back in {} samples",
            torsion[first] - torsion[first - 1],
            bad.len()
        ),
        cure: "bridged".to_owned(),
    })
}

/// Whether a row repeats a neighbour: bad samples are bridged, kept readings left out.
fn frozen_at(values: &[f64], row: usize) -> bool {
    let same = |other: Option<&f64>| other == values.get(row);
    same(row.checked_sub(1).and_then(|r| values.get(r))) || same(values.get(row + 1))
}

/// Takes out steps of the motor side that the link side does not make: registers that overflow.
fn motor_wraps(t: &[f64], theta: &mut [f64], q: &[f64], ratio: f64, name: &str) -> Option<Finding> {
    let low = theta.iter().copied().fold(f64::INFINITY, f64::min);
    let high = theta.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let covered = high - low;
    let beyond = |k: usize| (theta[k] - theta[k - 1]) - ratio * (q[k] - q[k - 1]);
    let steps: Vec<(usize, f64)> = (1..theta.len())
        .map(|k| (k, beyond(k)))
        .filter(|(_, step)| step.abs() > 0.5 * covered)
        .collect();
    let mut sizes: Vec<f64> = steps.iter().map(|(_, s)| s.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let range = *sizes.get(sizes.len() / 2)?;
    let turn = TAU * (range / TAU).round();
    let range = if (range - turn).abs() < 0.03 * TAU {
        turn
    } else {
        range
    };
    let alike = sizes
        .iter()
        .filter(|s| (*s / range - 1.0).abs() < WRAP_SPREAD)
        .count();
    // A spike steps there and back: it passes through both bounds no more than a wrap does, but alternates.
    let back = steps
        .windows(2)
        .filter(|w| w[0].0 + 1 == w[1].0 && w[0].1 * w[1].1 < 0.0)
        .count();
    let clean = 10 * alike >= 9 * sizes.len() && 2 * back < sizes.len();
    if !clean || covered > range / WRAP_SHARE || covered < WRAP_SHARE * range {
        return None;
    }
    let (mut shift, mut next) = (0.0, 0);
    for (k, x) in theta.iter_mut().enumerate() {
        if steps.get(next).is_some_and(|(row, _)| *row == k) {
            shift -= range * steps[next].1.signum();
            next += 1;
        }
        *x += shift;
    }
    let row = steps[0].0;
    Some(Finding {
        defect: Defect::Wrapped,
        severity: Severity::Note,
        channel: name.to_owned(),
        row: Some(row),
        t: t[row],
        rows: steps.len(),
        text: format!("{name} wraps: {} steps by {range:.4}", steps.len()),
        cure: "unwrapped".to_owned(),
    })
}

/// Current and reference that stand still while the joint and the other one go on.
fn standing(t: &[f64], out: &mut Mended, kind: LogKind, lost: &mut [bool], ratio: f64) {
    let column = |get: fn(&LogRow) -> f64| -> Vec<f64> { out.rows.iter().map(get).collect() };
    let [current, tau, q] = [
        column(|r| r.current),
        column(|r| r.tau_sensor),
        column(|r| r.q),
    ];
    let theta: Vec<f64> = out.rows.iter().map(|r| r.theta / ratio).collect();
    let has_tau = tau.iter().all(|x| x.is_finite());
    let mut found = Vec::new();
    for (name, own, others) in [
        ("i", &current, vec![&theta, &tau]),
        ("tau_sensor", &tau, vec![&theta, &current]),
        ("q", &q, vec![&theta]),
        ("theta", &theta, vec![&q]),
    ] {
        let encoder = matches!(name, "q" | "theta");
        let (went_on, coarse) = if encoder {
            (WENT_ON.max(MAX_TWIST / span(&q).max(1e-9)), 1.0)
        } else {
            (WENT_ON, COARSE)
        };
        let bounds = [f64::min, f64::max].map(|of| own.iter().copied().fold(own[0], of));
        if name == "tau_sensor" && !has_tau {
            continue;
        }
        let others: Vec<&[f64]> = others
            .into_iter()
            .filter(|x| x.iter().all(|x| x.is_finite()))
            .map(Vec::as_slice)
            .collect();
        let name = kind.name(name);
        let shortest = (HELD_S / period(t)).ceil().max(8.0) as usize;
        for run in held(own, &others, shortest, went_on, coarse) {
            // A channel that stands at its bound is clipped, one that stands all along is none.
            let clipped = !encoder && bounds.contains(&own[run.start]);
            if clipped || 2 * run.len() > own.len() || run.clone().all(|row| lost[row]) {
                continue;
            }
            run.clone().for_each(|row| lost[row] = true);
            found.push((name, run));
        }
    }
    for (name, run) in found {
        let (text, rows) = (
            format!(
                "{name} stays at one value for {} rows ({:.2} s) while the joint goes on: the reading was kept",
                run.len(),
                t[run.end - 1] - t[run.start]
            ),
            run.len(),
        );
        out.findings.push(Finding {
            defect: Defect::Frozen,
            severity: Severity::Warning,
            channel: name.to_owned(),
            row: Some(run.start),
            t: t[run.start],
            rows,
            text,
            cure: "left out".to_owned(),
        });
    }
}

fn period(t: &[f64]) -> f64 {
    let ends = t.first().zip(t.last());
    ends.map_or(1.0, |(a, b)| (b - a) / (t.len() - 1).max(1) as f64)
}
