//! Signs: a reference or a current whose sign changes within a log, and a current that has none.
//!
//! Each is a hypothesis about the same linear probe of the joint, with signs as its unknowns: one for each part of the
//! log, or one for each row of a current that shows its size alone. It is claimed where it makes the log far likelier
//! than one sign throughout, by samples that count as independent.

use super::LogKind;
use super::contradictions::{SIGNIFICANT, UNLIKELY};
use super::probes::{Design, Probes, SIGN, Side, TORQUE, Terms};
use super::signals::Signals;
use crate::least_squares::{Batch, Solution};
use inspection::{Defect, Finding, Severity};
use joint_file::JointFile;

/// Parts of a log in which signs are looked at.
const PARTS: usize = 20;
/// Torque per current, or torsion per torque, of parts with one sign over that of the others, either way.
const ALIKE: f64 = 2.5;
/// Rounds in which signs and coefficients follow each other; they stand still after three or four.
const ROUNDS: usize = 12;
/// Friction of the rated torque that the search for a current's signs begins with.
const FRICTION: f64 = 0.1;
/// Largest current of the rarer sign, as a share of the largest, that a current without a sign shows: its noise.
const OTHER_SIGN: f64 = 0.05;
/// Rows of the rarer sign, as a share, from which a current that never shows it has lost it.
const RARER: f64 = 0.005;
const RIDGE: f64 = 1e-10;
const TERMS: Terms = Terms {
    bent: false,
    drift: false,
    lasting: false,
};

/// Changed and missing signs.
pub(super) fn found(
    s: &Signals,
    probes: &Probes,
    joint: &JointFile,
    kind: LogKind,
) -> Vec<Finding> {
    let finding = |channel: &str, row: Option<usize>, text: String, cure: &str| Finding {
        defect: Defect::Sign,
        severity: Severity::Refused,
        channel: channel.to_owned(),
        row,
        t: s.t[row.unwrap_or(0)],
        rows: s.t.len(),
        text,
        cure: cure.to_owned(),
    };
    let [tau, i] = ["tau_sensor", "i"].map(|column| kind.name(column));
    if let Some(share) = unsigned(probes, joint) {
        let text = format!(
            "{i} has no sign: it follows the size of a torque that {:.0} % of the rows have the other way",
            100.0 * share
        );
        let cure = "the motor's measured current with its sign";
        return vec![finding(i, None, text, cure)];
    }
    let [torsion, current] = [Side::Torsion, Side::Current].map(|side| Parts::new(probes, side));
    let Some(row) = current.as_ref().and_then(|parts| parts.changes(probes)) else {
        return Vec::new();
    };
    let by_torsion = torsion.as_ref().and_then(|parts| parts.changes(probes));
    let steady = torsion.as_ref().is_some_and(Parts::one_sign);
    let name = match (by_torsion, steady) {
        (Some(_), _) => tau.to_owned(),
        (None, true) => i.to_owned(),
        (None, false) => format!("{i} or {tau}"),
    };
    let text = format!("the sign of {name} changes within the log");
    vec![finding(
        &name,
        Some(by_torsion.unwrap_or(row)),
        text,
        "one sign throughout",
    )]
}

/// Coefficient of the torque over its standard deviation, by the share of samples that count.
fn torque(fit: &Solution, counted: f64) -> (f64, f64) {
    let (x, sigma) = (fit.x[TORQUE], fit.sigma[TORQUE] / counted.sqrt());
    (x, x / sigma.max(1e-300))
}

fn square(residual: &[f64]) -> f64 {
    residual.iter().map(|x| x * x).sum()
}

/// Logarithm of the ratio of likelihoods of two sums of squares.
fn likelier(without: f64, with: f64, independent: f64) -> f64 {
    0.5 * independent * (without / with.max(1e-300)).ln()
}

/// A probe's rows by parts of the log.
struct Parts {
    design: Design,
    /// Rows of the design in each part, and their normal equations.
    parts: Vec<(core::ops::Range<usize>, Batch)>,
}

impl Parts {
    fn new(probes: &Probes, side: Side) -> Option<Self> {
        let design = probes.design(side, 0.0, TERMS);
        let rows = design.values.len();
        let bound = |part: usize| part * rows / PARTS;
        let batch = |part: usize| {
            let range = bound(part)..bound(part + 1);
            (range.clone(), design.batch(range))
        };
        let parts = (0..PARTS).map(batch).collect();
        let varies = design.values.iter().any(|x| *x != design.values[0]);
        varies.then_some(Self { design, parts })
    }

    /// Least squares with the torque's sign of each part; parts of sign 0 are left out.
    fn fit(&self, signs: &[f64]) -> Option<(Solution, f64)> {
        let mut all = Batch::new(self.design.rows[0].len());
        for ((_, batch), sign) in self
            .parts
            .iter()
            .zip(signs)
            .filter(|(_, sign)| **sign != 0.0)
        {
            all.merge(batch, |column| if column == TORQUE { *sign } else { 1.0 });
        }
        let fit = all.solve(RIDGE)?;
        let rest = fit.rms.powi(2) * all.rows() as f64;
        Some((fit, rest))
    }

    fn residual(&self, fit: &Solution, signs: &[f64]) -> Vec<f64> {
        let all = self
            .parts
            .iter()
            .zip(signs)
            .filter(|(_, sign)| **sign != 0.0);
        let each = all.flat_map(|((rows, _), sign)| rows.clone().map(move |k| (k, *sign)));
        each.map(|(k, sign)| self.design.residual(fit, k, sign))
            .collect()
    }

    /// Signs of the parts that fit best: of one change, then part by part.
    fn signs(&self) -> Option<Vec<f64>> {
        let one_change = |at: usize| -> Vec<f64> {
            (0..PARTS)
                .map(|part| if part < at { 1.0 } else { -1.0 })
                .collect()
        };
        let mut best = (f64::INFINITY, Vec::new());
        for at in 1..=PARTS {
            let signs = one_change(at);
            let rest = self.fit(&signs)?.1;
            if rest < best.0 {
                best = (rest, signs);
            }
        }
        for _ in 0..ROUNDS {
            let before = best.0;
            for part in 0..PARTS {
                let mut signs = best.1.clone();
                signs[part] = -signs[part];
                let rest = self.fit(&signs)?.1;
                if rest < best.0 {
                    best = (rest, signs);
                }
            }
            if best.0 == before {
                break;
            }
        }
        Some(best.1)
    }

    /// The first row behind a change of the torque's sign.
    fn changes(&self, probes: &Probes) -> Option<usize> {
        let signs = self.signs()?;
        // A part in which the sign changes has both, and spoils what it is added to.
        let whole = |part: usize| {
            let around = signs[part.saturating_sub(1)..(part + 2).min(PARTS)].iter();
            around.copied().all(|sign| sign == signs[part])
        };
        let of = |part: usize| if whole(part) { signs[part] } else { 0.0 };
        let hypothesis: Vec<f64> = (0..PARTS).map(of).collect();
        let (fit, rest) = self.fit(&hypothesis)?;
        let residual = self.residual(&fit, &hypothesis);
        let independent = Probes::independent(&residual);
        let one_sign: Vec<f64> = hypothesis.iter().map(|sign| sign.abs()).collect();
        if likelier(self.fit(&one_sign)?.1, rest, independent) < UNLIKELY {
            return None;
        }
        // Each sign has to show in its own rows alone, whatever their zero and friction are.
        let counted = independent / residual.len() as f64;
        let alone = |sign: f64| {
            let own: Vec<f64> = hypothesis.iter().map(|s| f64::from(*s == sign)).collect();
            self.fit(&own).map(|(fit, _)| torque(&fit, counted))
        };
        let ((up, by_up), (down, by_down)) = (alone(1.0)?, alone(-1.0)?);
        let certain = by_up.abs().min(by_down.abs()) > SIGNIFICANT;
        let alike = (1.0 / ALIKE..ALIKE).contains(&(-up / down));
        (certain && alike).then(|| probes.rows()[self.change(&fit, &signs)])
    }

    /// Row of the design, about the first change of parts, from which on the other sign fits better.
    fn change(&self, fit: &Solution, signs: &[f64]) -> usize {
        let part = (1..PARTS).find(|&k| signs[k] != signs[k - 1]).unwrap_or(1);
        let around = self.parts[part - 1].0.start..self.parts[part].0.end;
        let mut gain = 0.0;
        let mut best = (0.0, around.start);
        for k in around {
            let [own, other] =
                [1.0, -1.0].map(|s| self.design.residual(fit, k, s * signs[part - 1]).powi(2));
            gain += own - other;
            if gain < best.0 {
                best = (gain, k + 1);
            }
        }
        best.1.min(self.design.values.len() - 1)
    }

    /// Whether one sign throughout shows the torque.
    fn one_sign(&self) -> bool {
        let signs = [1.0; PARTS];
        self.fit(&signs).is_some_and(|(fit, _)| {
            let residual = self.residual(&fit, &signs);
            let counted = Probes::independent(&residual) / residual.len() as f64;
            torque(&fit, counted).1.abs() > SIGNIFICANT
        })
    }
}

/// Share of the rows whose sign the current has lost; none where it has one.
fn unsigned(probes: &Probes, joint: &JointFile) -> Option<f64> {
    let design = probes.design(Side::Current, 0.0, TERMS);
    let mut sorted = design.values.clone();
    sorted.sort_by(f64::total_cmp);
    let [low, high] =
        [0.01, 0.99].map(|share| sorted[((sorted.len() - 1) as f64 * share) as usize]);
    if low.min(-high).abs() == 0.0 || (low < -OTHER_SIGN * high && high > -OTHER_SIGN * low) {
        return None;
    }
    let whole = if high > -low { 1.0 } else { -1.0 };
    let sized: Vec<f64> = design.values.iter().map(|x| whole * x).collect();
    let signed = design.batch(0..sized.len()).solve(RIDGE)?;
    // The search begins with the data sheet's torque constant and an ordinary friction.
    let mut x = vec![0.0; design.rows[0].len()];
    (x[TORQUE], x[SIGN]) = (1.0, FRICTION * joint.joint.rated_torque);
    let dot = |x: &[f64], row: &[f64]| x.iter().zip(row).map(|(a, b)| a * b).sum::<f64>();
    let mut fit = None;
    for _ in 0..ROUNDS {
        let mut batch = Batch::new(x.len());
        for (row, size) in design.rows.iter().zip(&sized) {
            batch.add(row, size.abs() * dot(&x, row).signum());
        }
        let next = batch.solve(RIDGE)?;
        x = next.x.iter().copied().collect();
        fit = Some(next);
    }
    let fit = fit?;
    let with: Vec<f64> = (design.rows.iter().zip(&sized))
        .map(|(row, size)| size - dot(&x, row).abs())
        .collect();
    let without: Vec<f64> = (0..sized.len())
        .map(|k| design.residual(&signed, k, 1.0))
        .collect();
    let negative = design.rows.iter().filter(|row| dot(&x, row) < 0.0).count();
    let share = negative as f64 / sized.len() as f64;
    let independent = Probes::independent(&with);
    let certain = torque(&fit, independent / sized.len() as f64).1 > SIGNIFICANT;
    let claimed = certain
        && (RARER..1.0 - RARER).contains(&share)
        && likelier(square(&without), square(&with), independent) > UNLIKELY;
    claimed.then_some(share.min(1.0 - share))
}
