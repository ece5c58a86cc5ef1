//! The results page: what was run, and every table.

use crate::drives::Offered;
use crate::family::Judged;
use crate::page::{constants, family, real, sources, splits, unturned};
use crate::real::RealCase;
use std::collections::BTreeSet;

const HEAD: &str = "\
# The fused torque, judged where it was not tuned

Made by `cargo run --release -p torque-judge -- results --logs FOLDER --drives FOLDER --out docs/results/torque-judge.md`. \
Aims and what limits the figures: [decision 9](../decisions/0009-fused-torque.md#where-the-figures-end); what a sigma \
covers: [joint-file.md](../joint-file.md#what-a-sigma-covers). Error/sigma is the root mean square of the error over the \
published sigma; 1 is ideal, 0.5 to 2 is honest.

## A real arm

Two logs of a NEURA LARA8 (`sweep.csv`, `jog_joints.csv` of the repository allwinlucious/MasterThesis, \
BSD-3-Clause): no unloaded turn, encoder zeros unknown, rated torque and stiffness by the catalogue of gears of \
these ratios. The reference is the flange's F/T sensor through the arm's Jacobian plus the controller's \
feed-forward without friction; its own error is some N·m. Every method is tared on the first 50 samples, the fused \
torque and its sources by their own tare, all others by a constant.

Plain methods are the raw current, regressions on current and on torsion, each with speed and direction, and one with \
torsion and feed-forward (without its friction). \"Feed-forward\" is that source alone. The priors' widths were chosen \
while looking at these logs: they are design data, not held out. Error/sigma in brackets.

";

/// Where the family's part of the page begins.
const FAMILY: &str = "\n## A family of joints\n";
/// Remark in its part of the page when it has been kept.
const KEPT: &str = "\n**Older than the tables above**: this section and the next are of an earlier state of the estimators.\n";

/// The section of design joints beside unseen ones, and the one behind it.
const SIDES: &str = "\n## Design and unseen, side by side\n";
const TIME: &str = "\n## Time\n";

/// That section of a page; empty where it has none.
fn sides_of(page: &str) -> &str {
    let from = page.find(SIDES).unwrap_or(page.len());
    let until = page.find(TIME).filter(|until| *until > from);
    &page[from..until.unwrap_or(from)]
}

/// The page with another section of design joints beside those of a seed; none if it has no section of times.
#[must_use]
pub fn with_sides(old: &str, seed: u64, joints: u64, table: &str) -> Option<String> {
    let without = old.replacen(sides_of(old), "", 1);
    let (before, after) = without.split_once(TIME)?;
    Some(format!(
        "{before}{SIDES}\n\
         Made by `cargo run --release -p torque-judge -- sides --seed $(date +%Y%m%d) --joints {joints} --out \
         docs/results/torque-judge.md`: {joints} joints that were looked at while the estimators were made, and as many \
         drawn by the date (seed {seed}), which nobody chose. \"Outside\" is judged at angles that the loaded training has \
         not reached. Columns as above.\n\n{table}{TIME}{after}"
    ))
}

/// The page's text with the part of family and times of the `old` page, which then says so; none if it has no
/// such part.
#[must_use]
pub fn without_family(tared: &TaredCases, offered: &[Offered], old: &str) -> Option<String> {
    let (_, kept) = old.split_once(FAMILY)?;
    let kept = kept.strip_prefix(KEPT).unwrap_or(kept);
    Some(format!(
        "{}{FAMILY}{KEPT}{kept}",
        without_figures(tared, offered)
    ))
}

/// Parts before the family's: the real arm, its other splits, joints without an unloaded turn.
pub struct TaredCases {
    /// The real arm.
    pub real: Vec<RealCase>,
    /// Its other splits.
    pub splits: Vec<(&'static str, RealCase)>,
    /// Joints of the family without an unloaded turn.
    pub unturned: Judged,
}

/// The page's head, the real arm, joints without an unloaded turn, and the drives.
fn without_figures(tared: &TaredCases, offered: &[Offered]) -> String {
    let joints: BTreeSet<u64> = tared.unturned.cases.iter().map(|c| c.number).collect();
    format!(
        "{HEAD}{}\n\
         ### Other splits of the same logs\n\n\
         Every half after the other, every third after each of the others (1.3 and 2.5 s), without the cases above; \
         pairs of logs on joints 4 and 6. Joints that are not informative stand under a steady torque. Nothing was \
         chosen by these splits.\n\n{}\n\
         ## Joints without an unloaded turn\n\n\
         {} joints of the family below, as the real arm's logs are: 8 s of training under loads of one sign, in motion or at rest, no unloaded turn, no catalogue's stiffness. Each log has an encoder zero of its own, each judged run is tared on its first 50 samples. \"Other sign\" is a run like \
         the training with the other sign of the load.\n\n{}\n\
         ## Drives without a torque reference\n\n\
         Two runs of three axes of a KUKA KR300 (repository JonasWeigand/Robot_Identification, MIT). The stiffness must not pass as determined, with or without the motor's torque as the reference.\n\n{}",
        real(&tared.real),
        splits(&tared.splits),
        joints.len(),
        unturned(&tared.unturned),
        drives(offered),
    )
}

/// The page's text, with the section of design joints of the `old` page. `times`: processor time of `fit all` and of the
/// fused torque of a sample, s.
#[must_use]
pub fn results(
    tared: &TaredCases,
    offered: &[Offered],
    judged: &Judged,
    times: [f64; 2],
    old: &str,
) -> String {
    let structures: BTreeSet<&str> = judged.cases.iter().map(|c| c.structure.as_str()).collect();
    let joints: BTreeSet<u64> = judged.cases.iter().map(|c| c.number).collect();
    let fits: BTreeSet<_> = judged
        .cases
        .iter()
        .map(|c| (c.number, c.training))
        .collect();
    let [all, sample] = times;
    format!(
        "{}{FAMILY}\n\
         {} joints of {} structures (compliance, hysteresis and friction by {}), drawn at random. None was looked at before; their laws are neither those of the estimators nor of the plant. \
         {} fits, each after an unloaded turn: by turns after the training \"full\" (120 s) and after one of the \
         others. The learned estimators are left out. Errors are against the true torque, without any tare.\n\n{}\n{}\n\
         ### Constants\n\n\
         Constants of these fits that the family's laws have in the same sense; stiffness and friction are \
         curves there.\n\n{}{}{TIME}\n\
         Processor time: `fit all` on 150,000 samples {all:.0} s; the fused torque of a sample, as the loop \
         computes it, {:.2} us.\n",
        without_figures(tared, offered),
        joints.len(),
        structures.len(),
        laws(&structures),
        fits.len(),
        family(judged),
        sources(judged, "full"),
        constants(judged),
        sides_of(old),
        1e6 * sample,
    )
}

/// The verdict on each axis.
fn drives(offered: &[Offered]) -> String {
    let line = |o: &Offered| {
        let determined = if o.determined {
            "**determined**"
        } else {
            "not determined"
        };
        format!(
            "| {} | {} | {determined} | {} |\n",
            o.axis, o.reference, o.said
        )
    };
    let lines: String = offered.iter().map(line).collect();
    format!(
        "<!-- rows: torque-judge-drives.csv, first 1 -->\n\n| run | reference | stiffness | said |\n| --- | --- | --- | --- |\n{lines}"
    )
}

/// The laws in the structures' names.
fn laws(structures: &BTreeSet<&str>) -> String {
    let laws: BTreeSet<&str> = structures.iter().flat_map(|s| s.split(", ")).collect();
    laws.into_iter().collect::<Vec<_>>().join(", ")
}
