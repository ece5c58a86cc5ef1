//! One channel: mended where there is one mending, its rows without a measurement marked.

use crate::finding::{Defect, Finding, Severity};
use crate::statistics::{fill, quantile, span, steps};
use crate::{frozen, held_rows, marks, sources, spikes, wraps};

/// Share of rows without a measurement above which a log is refused.
const MAX_LOST: f64 = 0.2;
/// Step of a zero: multiple of the ordinary steps around it, and share of the range.
const MIN_STEP: f64 = 8.0;
const MIN_STEP_SHARE: f64 = 0.03;
/// Multiple of the ordinary step of the stamps from which rows are missing.
const GAP: f64 = 5.0;
/// Samples on either side by which a step's ordinary neighbours are measured.
const AROUND: usize = 25;

/// Meaning of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// An angle, rad: it moves steadily, and a step of a turn is a wrap.
    Angle,
    /// A way, m: it moves steadily.
    Way,
    /// A torque, force or current: it may step.
    Effort,
}

/// A channel of a log.
#[derive(Debug, Clone, Copy)]
pub struct Channel<'a> {
    /// Its name for messages, such as "q of `elbow`".
    pub name: &'a str,
    /// What it measures.
    pub quantity: Quantity,
    /// Values, one a row.
    pub values: &'a [f64],
}

/// A channel after inspection.
#[derive(Debug, Clone, Default)]
pub struct Inspected {
    /// Values, mended.
    pub values: Vec<f64>,
    /// Rows that hold no measurement, in their order.
    pub lost: Vec<usize>,
    /// What was found.
    pub findings: Vec<Finding>,
}

/// Inspects and mends a channel of rows stamped `t`.
#[must_use]
pub fn inspect(t: &[f64], channel: Channel<'_>) -> Inspected {
    let mut out = Inspected {
        values: channel.values.to_vec(),
        ..Inspected::default()
    };
    let finding = |defect, severity, row: usize, rows, text: String, cure: &str| Finding {
        defect,
        severity,
        channel: channel.name.to_owned(),
        row: Some(row),
        t: t.get(row).copied().unwrap_or(f64::NAN),
        rows,
        text,
        cure: cure.to_owned(),
    };
    let marked = marks(channel.values);
    if let Some(&row) = marked.first() {
        let text = format!(
            "{}: {} of {:e}, far beyond all others: a mark for a missing reading",
            channel.name,
            counted(marked.len(), "sample"),
            channel.values[row],
        );
        let rows = marked.len();
        out.findings.push(finding(
            Defect::Spikes,
            Severity::Warning,
            row,
            rows,
            text,
            "left out",
        ));
    }
    fill(&mut out.values, &marked);
    if channel.quantity != Quantity::Effort {
        out.findings
            .extend(of_one_source(&out.values, channel.name, &finding));
    }
    unwrapped(t, &channel, &mut out, &finding);
    let bad = spikes(&out.values);
    if let Some(&row) = bad.first() {
        let text = format!(
            "{}: {} that no neighbour confirms ({} between {})",
            channel.name,
            counted(bad.len(), "sample"),
            channel.values[row],
            channel.values[row.saturating_sub(1)],
        );
        out.findings.push(finding(
            Defect::Spikes,
            Severity::Warning,
            row,
            bad.len(),
            text,
            "left out",
        ));
    }
    fill(&mut out.values, &bad);
    let still = frozen(&out.values);
    for run in &still {
        let text = format!(
            "{} stays at {} for {} rows and then leaps: the reading was kept",
            channel.name,
            channel.values[run.start],
            run.len()
        );
        out.findings.push(finding(
            Defect::Frozen,
            Severity::Warning,
            run.start,
            run.len(),
            text,
            "left out",
        ));
    }
    if channel.quantity != Quantity::Effort {
        let of_frozen = |row: usize| still.iter().any(|run| run.end == row || run.start == row);
        if let Some((row, step)) = zero_step(t, &out.values).filter(|(row, _)| !of_frozen(*row)) {
            let text = format!(
                "{} steps by {step:.4} from one row to the next and stays there: an encoder lost \
                 its zero, or two recordings were joined",
                channel.name
            );
            let cure = "one zero in a log: cut it there and give both parts as logs";
            out.findings.push(finding(
                Defect::Stepped,
                Severity::Refused,
                row,
                1,
                text,
                cure,
            ));
        }
    }
    out.lost = bad;
    out.lost.extend(marked);
    out.lost.extend(still.into_iter().flatten());
    out.lost.sort_unstable();
    out.lost.dedup();
    if out.lost.len() as f64 > MAX_LOST * t.len() as f64 {
        let text = format!(
            "{} holds no measurement in {} of {} rows",
            channel.name,
            out.lost.len(),
            t.len()
        );
        let cure = "a log in which the channel is recorded throughout";
        let row = out.lost.first().copied().unwrap_or(0);
        out.findings.push(finding(
            Defect::Frozen,
            Severity::Refused,
            row,
            out.lost.len(),
            text,
            cure,
        ));
    }
    out
}

/// Refuses a steady motion that is of several sources, or was sampled too slowly.
fn of_one_source(
    values: &[f64],
    name: &str,
    finding: &impl Fn(Defect, Severity, usize, usize, String, &str) -> Finding,
) -> Option<Finding> {
    if let Some(count) = sources(values) {
        let text = format!(
            "{name} leaps to and fro from row to row: samples of {count} sources (publishers, drives) in one column"
        );
        let cure = "rows of one source: leave out those of the others";
        return Some(finding(
            Defect::Stepped,
            Severity::Refused,
            0,
            values.len(),
            text,
            cure,
        ));
    }
    let rows = held_rows(values)?;
    let text = format!(
        "{name} repeats each number for {rows} rows and then leaps: it was sampled more slowly than logged"
    );
    let cure = "a log at the rate at which the channel is sampled, or faster sampling";
    Some(finding(
        Defect::Frozen,
        Severity::Refused,
        0,
        values.len(),
        text,
        cure,
    ))
}

/// Takes wraps out of the channel.
fn unwrapped(
    t: &[f64],
    channel: &Channel<'_>,
    out: &mut Inspected,
    finding: &impl Fn(Defect, Severity, usize, usize, String, &str) -> Finding,
) {
    let range = match channel.quantity {
        Quantity::Angle => Some(core::f64::consts::TAU),
        Quantity::Way | Quantity::Effort => wraps::range_of_wraps(&out.values),
    };
    let Some(range) = range else { return };
    let (mut found, mut shift): (Option<wraps::Unwrapped>, f64) = (None, 0.0);
    // A joint moves on while no row is recorded: turns are not counted over a gap.
    let mut bounds = gaps(t);
    bounds.insert(0, 0);
    bounds.push(out.values.len());
    for part in bounds.windows(2) {
        let Some(values) = out.values.get_mut(part[0]..part[1]) else {
            continue;
        };
        let last = values.last().copied();
        if let Some(own) = wraps::unwrap(values, range) {
            let all = found.get_or_insert(wraps::Unwrapped {
                count: 0,
                row: part[0] + own.row,
                ..own
            });
            all.count += own.count;
        }
        let moved = values.last().zip(last).map_or(0.0, |(a, b)| a - b);
        values.iter_mut().for_each(|x| *x += shift);
        shift += moved;
    }
    let Some(found) = found else { return };
    let text = format!(
        "{} wraps: {} by {:.4}",
        channel.name,
        counted(found.count, "step"),
        found.range
    );
    out.findings.push(finding(
        Defect::Wrapped,
        Severity::Note,
        found.row,
        found.count,
        text,
        "unwrapped",
    ));
}

/// Rows behind steps of the stamps far beyond the ordinary one.
fn gaps(t: &[f64]) -> Vec<usize> {
    // Clocks that are read coarsely give several rows one stamp.
    let steps = t.windows(2).map(|w| w[1] - w[0]).filter(|step| *step > 0.0);
    let ordinary = quantile(steps.collect(), 0.5);
    (1..t.len())
        .filter(|&k| t[k] - t[k - 1] > GAP * ordinary)
        .collect()
}

/// The largest step that nothing around it announces: row behind it, and size.
fn zero_step(t: &[f64], values: &[f64]) -> Option<(usize, f64)> {
    let all = steps(values);
    let least = MIN_STEP_SHARE * span(values);
    // A joint moves on while no row is recorded.
    let gaps = gaps(t);
    let gap = |k: usize| gaps.binary_search(&(k + 1)).is_ok();
    let sudden = (0..all.len()).filter(|&k| {
        let around =
            (k.saturating_sub(AROUND)..(k + AROUND + 1).min(all.len())).filter(|i| *i != k);
        let most = around.map(|i| all[i]).fold(0.0, f64::max);
        all[k] > least && all[k] > MIN_STEP * most && most > 0.0 && !gap(k)
    });
    let largest = sudden.max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
    Some((largest + 1, values[largest + 1] - values[largest]))
}

fn counted(n: usize, what: &str) -> String {
    if n == 1 {
        format!("1 {what}")
    } else {
        format!("{n} {what}s")
    }
}
