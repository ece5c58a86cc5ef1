//! The page's figures.

use super::{Moment, Traces};
use charts::{COLOURS, Figure, Line, Mark, Panel};

/// Dots of a panel at most: more do not show more.
const MAX_DOTS: usize = 1500;
/// Points of the hysteresis loop at most.
const MAX_LOOP: usize = 6000;
/// Bins of a residual's mean.
const BINS: usize = 24;
/// Samples that a bin needs.
const MIN_BIN: usize = 5;
/// Points of the calibration curve.
const LEVELS: usize = 20;

/// Reference and estimates over time; the last source, fused where there is a fusion, on top.
pub(super) fn torque(traces: &Traces) -> Figure {
    let over_time = |value: &dyn Fn(usize) -> f64| {
        let each = traces.moments.iter().enumerate();
        each.map(|(i, m)| (m.t, value(i))).collect::<Vec<_>>()
    };
    let reference = Line::new(
        "reference",
        COLOURS[0],
        over_time(&|i| traces.moments[i].reference),
    );
    let source = |(k, name): (usize, &String)| {
        let points = over_time(&|i| traces.estimates[k][i].0);
        Line::new(name.clone(), COLOURS[1 + k % (COLOURS.len() - 1)], points)
    };
    let mut sources: Vec<Line> = traces.names.iter().enumerate().map(source).collect();
    let last = sources.pop();
    let panel = |caption: &str, lines: Vec<Line>| Panel {
        caption: caption.to_owned(),
        x_unit: "s".to_owned(),
        lines,
        ..Panel::default()
    };
    let mut panels = Vec::new();
    if let Some(last) = last {
        let caption = format!("{}, N·m", last.label);
        panels.push(panel(&caption, vec![last, reference.clone()]));
    }
    if !sources.is_empty() {
        sources.push(reference);
        panels.push(panel("every other source, N·m", sources));
    }
    Figure {
        title: "Torque and reference".to_owned(),
        columns: 1,
        panel_size: (1000, 260),
        panels,
    }
}

/// One source: against the reference, hysteresis loop, residuals, calibration.
pub(super) fn source(traces: &Traces, source: usize) -> Figure {
    let all: Vec<(&Moment, f64, f64)> = traces.judged(source).collect();
    let dots = |x: &dyn Fn(&Moment) -> f64, y: &dyn Fn(&Moment, f64) -> f64| {
        let step = all.len().div_ceil(MAX_DOTS).max(1);
        let each = all.iter().step_by(step);
        each.map(|(m, tau, _)| (x(m), y(m, *tau)))
            .collect::<Vec<_>>()
    };
    let residual = |m: &Moment, tau: f64| tau - m.reference;
    let over = |caption: &str, x: &dyn Fn(&Moment) -> f64| {
        let points: Vec<(f64, f64)> = all
            .iter()
            .map(|(m, tau, _)| (x(m), residual(m, *tau)))
            .collect();
        Panel {
            caption: caption.to_owned(),
            lines: vec![
                Line::new("sample", COLOURS[1], dots(x, &residual)).with_mark(Mark::Dots),
                Line::new("mean", COLOURS[5], means(&points)),
            ],
            ..Panel::default()
        }
    };
    let against = dots(&|m| m.reference, &|_, tau| tau);
    let ends = against
        .iter()
        .fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.0), b.max(p.0)));
    let panels = vec![
        Panel {
            caption: "estimate over reference, N·m".to_owned(),
            lines: vec![
                Line::new("sample", COLOURS[1], against).with_mark(Mark::Dots),
                Line::new(
                    "ideal",
                    COLOURS[0],
                    vec![(ends.0, ends.0), (ends.1, ends.1)],
                ),
            ],
            ..Panel::default()
        },
        hysteresis(&all),
        calibration(&all),
        over("residual over torque, N·m", &|m| m.reference),
        over("residual over angle (rad), N·m", &|m| m.q),
        over("residual over speed (rad/s), N·m", &|m| m.dq),
    ];
    Figure {
        title: String::new(),
        columns: 3,
        panel_size: (340, 240),
        panels,
    }
}

/// Torque over torsion, of the reference and of the estimate.
fn hysteresis(all: &[(&Moment, f64, f64)]) -> Panel {
    let step = all.len().div_ceil(MAX_LOOP).max(1);
    let zero = all.first().map_or(0.0, |(m, ..)| m.torsion);
    let path = |value: &dyn Fn(&(&Moment, f64, f64)) -> f64| {
        let each = all.iter().step_by(step);
        each.map(|s| (1e3 * (s.0.torsion - zero), value(s)))
            .collect::<Vec<_>>()
    };
    Panel {
        caption: "torque over torsion (mrad), N·m".to_owned(),
        lines: vec![
            Line::new("reference", COLOURS[0], path(&|s| s.0.reference)).with_mark(Mark::Path),
            Line::new("estimate", COLOURS[2], path(&|s| s.1)).with_mark(Mark::Path),
        ],
        ..Panel::default()
    }
}

/// Share of the errors within the interval of a probability, over that probability.
fn calibration(all: &[(&Moment, f64, f64)]) -> Panel {
    let mut ratios: Vec<f64> = all
        .iter()
        .map(|(m, tau, sigma)| (tau - m.reference).abs() / sigma.max(1e-12))
        .collect();
    ratios.sort_by(f64::total_cmp);
    let share = |z: f64| ratios.partition_point(|r| *r <= z) as f64 / ratios.len().max(1) as f64;
    let point = |k: usize| {
        let z = 3.0 * k as f64 / LEVELS as f64;
        (within(z), share(z))
    };
    Panel {
        caption: "errors within sigma's interval, by its probability".to_owned(),
        x_range: Some((0.0, 1.0)),
        y_range: Some((0.0, 1.0)),
        lines: vec![
            Line::new("ideal", COLOURS[0], vec![(0.0, 0.0), (1.0, 1.0)]),
            Line::new("found", COLOURS[3], (0..=LEVELS).map(point).collect()),
        ],
        ..Panel::default()
    }
}

/// Probability that a normal variable lies within z standard deviations: its density by Simpson's
/// rule.
fn within(z: f64) -> f64 {
    const STEPS: usize = 64;
    let h = z / STEPS as f64;
    let density = |x: f64| (-0.5 * x * x).exp();
    let inner: f64 = (1..STEPS)
        .map(|i| density(h * i as f64) * if i % 2 == 1 { 4.0 } else { 2.0 })
        .sum();
    (density(0.0) + inner + density(z)) * h / 3.0 * (2.0 / std::f64::consts::PI).sqrt()
}

/// Mean of y in bins of x.
fn means(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (low, high) = points
        .iter()
        .fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.0), b.max(p.0)));
    let width = (high - low) / BINS as f64;
    let mut sums = [(0.0, 0.0, 0usize); BINS];
    for (x, y) in points {
        let bin = if width > 0.0 {
            ((x - low) / width) as usize
        } else {
            0
        };
        let sum = &mut sums[bin.min(BINS - 1)];
        *sum = (sum.0 + x, sum.1 + y, sum.2 + 1);
    }
    let kept = sums.iter().filter(|s| s.2 >= MIN_BIN);
    kept.map(|&(x, y, n)| (x / n as f64, y / n as f64))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{means, within};

    #[test]
    fn probabilities_are_those_of_a_normal_variable() {
        for (z, p) in [
            (0.0, 0.0),
            (1.0, 0.682_689_5),
            (1.96, 0.950_004_2),
            (3.0, 0.997_300_2),
        ] {
            assert!((within(z) - p).abs() < 1e-6, "{z} {}", within(z));
        }
    }

    #[test]
    fn means_of_bins_lie_on_a_line_of_points() {
        let points: Vec<(f64, f64)> = (0..1000)
            .map(|i| (f64::from(i), 2.0 * f64::from(i) + f64::from(i % 2) - 0.5))
            .collect();
        let means = means(&points);
        assert_eq!(means.len(), 24);
        assert!(means.iter().all(|(x, y)| (y - 2.0 * x).abs() < 0.1));
    }
}
