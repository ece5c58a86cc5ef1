//! Tables of the judgement, as Markdown and as JSON.

use crate::course::Training;
use crate::family::{Case, Judged};
use crate::real::{FEED_FORWARD, FUSED, REGRESSION, RealCase, WITH_FEED_FORWARD};
use crate::score::Score;
use serde_json::{Value, json};
use std::fmt::Write;

/// Bounds of an honest ratio of error to sigma.
const HONEST: std::ops::RangeInclusive<f64> = 0.5..=2.0;
const SCENARIOS: [&str; 5] = ["slow", "fast", "sudden", "frequent", "static"];

/// Median and largest.
fn median_worst(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let middle = values.get(values.len() / 2).copied().unwrap_or(f64::NAN);
    (middle, values.last().copied().unwrap_or(f64::NAN))
}

fn share(values: &[f64]) -> f64 {
    let honest = values.iter().filter(|x| HONEST.contains(*x)).count();
    100.0 * honest as f64 / values.len().max(1) as f64
}

/// The family's tables.
#[must_use]
pub fn family(judged: &Judged) -> String {
    let mut text = String::from(
        "RMS error of the fused torque, % of the RMS torque: median / worst joint.\n\n\
         <!-- rows: torque-judge-family.csv, 3 greatest of sudden -->\n\n\
         | training | slow | fast | sudden | frequent | static | fused / best source | error/sigma in 0.5 to 2 | largest |\n\
         | --- | --- | --- | --- | --- | --- | --- | ---: | ---: |\n",
    );
    for (_, training) in Training::ALL.into_iter().chain(Training::UNTURNED) {
        text += &row(training, judged, training);
    }
    if !judged.refused.is_empty() {
        let _ = writeln!(text, "\nRefused: {}", judged.refused.join("; "));
    }
    text
}

/// A row of [`family`]: figures after a training; empty where no joint had it.
fn row(label: &str, judged: &Judged, training: &str) -> String {
    let cases = judged.cases.iter();
    let of: Vec<_> = cases.filter(|c| c.training == training).collect();
    if of.is_empty() {
        return String::new();
    }
    let mut text = format!("| {label} |");
    for scenario in SCENARIOS {
        let percent = of.iter().filter(|c| c.scenario == scenario);
        let percent = percent.filter_map(|c| Some(100.0 * c.score.fused()?.rms / c.score.torque));
        let (median, worst) = median_worst(percent.collect());
        let _ = write!(text, " {median:.2} / {worst:.1} |");
    }
    let ratios = of
        .iter()
        .filter_map(|c| Some(c.score.fused()?.rms / c.score.best()?.rms));
    let (median, worst) = median_worst(ratios.collect());
    let relative: Vec<f64> = of
        .iter()
        .filter_map(|c| Some(c.score.fused()?.ratio))
        .collect();
    let (_, largest) = median_worst(relative.clone());
    let _ = writeln!(
        text,
        " {median:.3} / {worst:.2} | {:.0} % | {largest:.2} |",
        share(&relative)
    );
    text
}

/// Parts of the family side by side: for each training a row of each part.
#[must_use]
pub fn sides(parts: &[(&str, &Judged)]) -> String {
    let mut text = String::from(
        "<!-- rows: torque-judge-sides.csv, 2 greatest of fused / best source -->\n\n\
         | training, joints | slow | fast | sudden | frequent | static | fused / best source | error/sigma in 0.5 to 2 | largest |\n\
         | --- | --- | --- | --- | --- | --- | --- | ---: | ---: |\n",
    );
    for (_, training) in Training::ALL {
        for (part, judged) in parts {
            text += &row(&format!("{training}, {part}"), judged, training);
        }
    }
    for (part, judged) in parts {
        if !judged.refused.is_empty() {
            let _ = writeln!(text, "\nRefused, {part}: {}", judged.refused.join("; "));
        }
    }
    text
}

/// Joints without an unloaded turn, scenario by scenario.
#[must_use]
pub fn unturned(judged: &Judged) -> String {
    let mut text = String::from(
        "<!-- rows: torque-judge-one-sign.csv, 2 greatest of worst -->\n\n\
         | training | scenario | torsion, median % | current | fused | fused / best source: geometric mean | worst | \
         error/sigma in 0.5 to 2 | below 0.5 | largest |\n\
         | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n",
    );
    let mut line = |training: &str, scenario: &str, of: &[&Case]| {
        let percent = |name: &str| {
            let found = of.iter().filter_map(|c| {
                let line = c.score.lines.iter().find(|l| l.name == name)?;
                Some(100.0 * line.rms / c.score.torque)
            });
            median_worst(found.collect()).0
        };
        let fused: Vec<_> = of.iter().filter_map(|c| c.score.fused()).collect();
        let over: Vec<f64> = (of.iter())
            .filter_map(|c| Some(c.score.fused()?.rms / c.score.best()?.rms))
            .collect();
        let mean = (over.iter().map(|x| x.ln()).sum::<f64>() / over.len().max(1) as f64).exp();
        let relative: Vec<f64> = fused.iter().map(|l| l.ratio).collect();
        let below = relative.iter().filter(|x| *x < HONEST.start()).count();
        let (_, largest) = median_worst(relative.clone());
        let _ = writeln!(
            text,
            "| {training} | {scenario} | {:.2} | {:.2} | {:.2} | {mean:.2} | {:.2} | {:.0} % | {below} of {} | {largest:.2} |",
            percent("hysteresis"),
            percent("current"),
            percent("fused"),
            median_worst(over).1,
            share(&relative),
            relative.len(),
        );
    };
    for (_, training) in Training::UNTURNED {
        let of: Vec<_> = (judged.cases.iter())
            .filter(|c| c.training == training)
            .collect();
        let mut scenarios: Vec<&str> = of.iter().map(|c| c.scenario).collect();
        scenarios.sort_unstable();
        scenarios.dedup();
        for scenario in scenarios {
            let of: Vec<_> = of
                .iter()
                .copied()
                .filter(|c| c.scenario == scenario)
                .collect();
            line(training, scenario, &of);
        }
        line(training, "all", &of);
    }
    text
}

/// How often intervals cover the truth.
#[must_use]
pub fn constants(judged: &Judged) -> String {
    let mut text = String::from(
        "| constant | 95 % interval covers the truth | median of \\|error\\|/sigma | largest |\n\
         | --- | ---: | ---: | ---: |\n",
    );
    let mut names: Vec<&str> = judged.constants.iter().map(|c| c.name).collect();
    names.sort_unstable();
    names.dedup();
    let mut line = |name: &str, ratios: Vec<f64>| {
        let covered = ratios.iter().filter(|r| **r < 1.96).count();
        let percent = 100.0 * covered as f64 / ratios.len().max(1) as f64;
        let count = ratios.len();
        let (median, worst) = median_worst(ratios);
        let _ = writeln!(
            text,
            "| {name} | {percent:.0} % of {count} fits | {median:.2} | {worst:.1} |"
        );
    };
    for name in names {
        let of = judged.constants.iter().filter(|c| c.name == name);
        line(name, of.map(|c| c.ratio.abs()).collect());
    }
    line(
        "all",
        judged.constants.iter().map(|c| c.ratio.abs()).collect(),
    );
    text
}

/// Every source's median error, for one training.
#[must_use]
pub fn sources(judged: &Judged, training: &str) -> String {
    let of: Vec<_> = judged
        .cases
        .iter()
        .filter(|c| c.training == training)
        .collect();
    let mut names: Vec<&str> = of
        .iter()
        .flat_map(|c| c.score.lines.iter().map(|l| l.name.as_str()))
        .collect();
    names.sort_unstable();
    names.dedup();
    let mut text = format!(
        "After training \"{training}\": median % of every source; in brackets median and largest error/sigma.\n\n\
         <!-- rows: torque-judge-sources.csv, 2 least of slow -->\n\n\
         | source | slow | fast | sudden | frequent | static |\n| --- | --- | --- | --- | --- | --- |\n"
    );
    for name in names {
        let _ = write!(text, "| {name} |");
        for scenario in SCENARIOS {
            let lines: Vec<_> = of
                .iter()
                .filter(|c| c.scenario == scenario)
                .filter_map(|c| {
                    let line = c.score.lines.iter().find(|l| l.name == name)?;
                    Some((100.0 * line.rms / c.score.torque, line.ratio))
                })
                .collect();
            let (percent, _) = median_worst(lines.iter().map(|l| l.0).collect());
            let (ratio, largest) = median_worst(lines.iter().map(|l| l.1).collect());
            let _ = write!(text, " {percent:.2} ({ratio:.1}, {largest:.1}) |");
        }
        text.push('\n');
    }
    text
}

/// Errors of every estimator on some logs.
#[must_use]
pub fn logs(scores: &[(String, Score)]) -> String {
    let names: Vec<&str> = scores.iter().map(|(name, _)| name.as_str()).collect();
    let mut text = format!(
        "% of the RMS torque (error/sigma):\n\n| estimator | {} |\n| --- |{}\n",
        names.join(" | "),
        " --- |".repeat(names.len())
    );
    let Some((_, first)) = scores.first() else {
        return text;
    };
    for (k, line) in first.lines.iter().enumerate() {
        let _ = write!(text, "| {} |", line.name);
        for (_, score) in scores {
            if let Some(line) = score.lines.get(k) {
                let percent = 100.0 * line.rms / score.torque;
                let _ = write!(text, " {percent:.2} ({:.2}) |", line.ratio);
            }
        }
        text.push('\n');
    }
    text
}

/// The real arm's table.
#[must_use]
pub fn real(cases: &[RealCase]) -> String {
    let names = [
        "fused",
        "torsion",
        "current",
        "raw current",
        "current regression",
        "torsion regression",
        REGRESSION,
        FEED_FORWARD,
        WITH_FEED_FORWARD,
    ];
    let mut text = format!(
        "RMS error, N·m, tared on the first 50 samples; `*`: informative.\n\n\
         <!-- rows: torque-judge-arm.csv, 3 greatest of fused / best plain -->\n\n\
         | joint | logs | {} | fused / best plain |\n| --- | --- |{} ---: |\n",
        names.join(" | "),
        " ---: |".repeat(names.len())
    );
    for c in cases {
        let mark = if c.informative { "*" } else { "" };
        let _ = write!(text, "| {}{mark} | {} |", c.joint, c.logs);
        for name in names {
            let _ = write!(text, " {:.2}", c.rms(name));
            let ratio = c.ratio(name);
            let _ = if ratio.is_finite() {
                write!(text, " ({ratio:.2}) |")
            } else {
                write!(text, " |")
            };
        }
        let _ = writeln!(text, " {:.2} |", c.over_best());
    }
    let informative: Vec<f64> = cases
        .iter()
        .filter(|c| c.informative)
        .map(RealCase::over_best)
        .collect();
    let mean = informative.iter().map(|x| x.ln()).sum::<f64>() / informative.len().max(1) as f64;
    let (_, worst) = median_worst(informative);
    let relative: Vec<f64> = cases.iter().map(|c| c.ratio("fused")).collect();
    let (_, largest) = median_worst(relative.clone());
    let _ = writeln!(
        text,
        "\nFused over the best plain method in hindsight, informative cases: geometric mean {:.2}, worst \
         {worst:.2}. Error/sigma within 0.5 to 2 in {:.0} % of all cases, largest {largest:.2}.",
        mean.exp(),
        share(&relative)
    );
    text += &feed_forward(cases);
    text
}

/// Splits of the real arm's logs, by kind and joint: see [`crate::real::splits`].
#[must_use]
pub fn splits(cases: &[(&'static str, RealCase)]) -> String {
    let mut text = String::from(
        "| split | cases | informative | fused / best plain: geometric mean | worst (joint, logs) | error/sigma in 0.5 to 2, \
         informative | all | below 0.5 | largest |\n\
         | --- | ---: | ---: | ---: | --- | ---: | ---: | ---: | ---: |\n",
    );
    let mut kinds: Vec<&str> = cases.iter().map(|(kind, _)| *kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let mut line = |kind: &str, of: &[&RealCase]| {
        let informative: Vec<_> = of.iter().filter(|c| c.informative).collect();
        let ratios = informative.iter().map(|c| c.over_best().ln());
        let mean = (ratios.sum::<f64>() / informative.len().max(1) as f64).exp();
        let worst = (informative.iter()).max_by(|a, b| a.over_best().total_cmp(&b.over_best()));
        let worst = worst.map_or("none".to_owned(), |c| {
            format!("{:.2} ({}, {})", c.over_best(), c.joint, c.logs)
        });
        let relative = |c: &RealCase| c.ratio(FUSED);
        let all: Vec<f64> = of.iter().map(|c| relative(c)).collect();
        let shares: Vec<f64> = informative.iter().map(|c| relative(c)).collect();
        let below = all.iter().filter(|x| *x < HONEST.start()).count();
        let (_, largest) = median_worst(all.clone());
        let of_informative = |text: String| {
            if informative.is_empty() {
                "none".to_owned()
            } else {
                text
            }
        };
        let _ = writeln!(
            text,
            "| {kind} | {} | {} | {} | {worst} | {} | {:.0} % | {below} | {largest:.2} |",
            of.len(),
            informative.len(),
            of_informative(format!("{mean:.2}")),
            of_informative(format!("{:.0} %", share(&shares))),
            share(&all),
        );
    };
    for kind in kinds {
        let of: Vec<_> = cases
            .iter()
            .filter(|(k, _)| *k == kind)
            .map(|(_, c)| c)
            .collect();
        line(kind, &of);
    }
    line("all", &cases.iter().map(|(_, c)| c).collect::<Vec<_>>());
    text
}

/// The fused torque with the feed-forward as a source.
fn feed_forward(cases: &[RealCase]) -> String {
    let informative: Vec<f64> = (cases.iter().filter(|c| c.informative))
        .map(RealCase::with_feed_forward)
        .filter(|ratio| ratio.is_finite())
        .collect();
    let mean = informative.iter().map(|x| x.ln()).sum::<f64>() / informative.len().max(1) as f64;
    let (median, worst) = median_worst(informative);
    let relative: Vec<f64> = cases.iter().map(|c| c.ratio(WITH_FEED_FORWARD)).collect();
    let (_, largest) = median_worst(relative.clone());
    format!(
        "\nWith the feed-forward as a source, over the regression that has it, informative cases: geometric mean \
         {:.2}, median {median:.2}, worst {worst:.2}. Error/sigma within 0.5 to 2 in {:.0} % of all cases, largest \
         {largest:.2}.\n",
        mean.exp(),
        share(&relative)
    )
}

/// Everything for machines.
#[must_use]
pub fn to_json(judged: &Judged, cases: &[RealCase]) -> Value {
    let family: Vec<Value> = (judged.cases.iter())
        .map(|c| {
            let sources: serde_json::Map<_, _> = (c.score.lines.iter())
                .map(|l| {
                    (
                        l.name.clone(),
                        json!({"rms_Nm": l.rms, "error_over_sigma": l.ratio}),
                    )
                })
                .collect();
            json!({"joint": c.number, "structure": c.structure, "training": c.training,
                "scenario": c.scenario, "rms_torque_Nm": c.score.torque, "estimators": sources})
        })
        .collect();
    let real: Vec<Value> = (cases.iter())
        .map(|c| {
            let methods: serde_json::Map<_, _> = (c.methods.iter())
                .map(|m| (m.name.to_owned(), json!({"rms_Nm": m.rms, "error_over_sigma": m.ratio})))
                .collect();
            json!({"joint": c.joint, "logs": c.logs, "informative": c.informative, "methods": methods,
                "report": c.report})
        })
        .collect();
    json!({"family": family, "refused": judged.refused, "reports": judged.reports, "real": real})
}
