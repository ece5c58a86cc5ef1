//! The law in front of friction of other bristles, known to it or not.

use crate::cases::parallel;
use crate::joint::JOINTS;
use crate::scenario::{blocked, moved};
use crate::variant::{Bristles, Conditions, shipped};
use std::fmt::Write;

/// Ways of the motor over which the plant's bristles bend, rad: sim.toml has 0.01.
const WAYS: [f64; 5] = [0.03, 0.01, 0.003, 0.001, 0.0005];
/// Knowledge of the law: nothing, the way, or one that is too short by a factor of two.
const KNOWN: [(Option<f64>, &str); 3] = [
    (None, "not given"),
    (Some(1.0), "right"),
    (Some(0.5), "half"),
];
/// Velocity of the hand, rad/s.
const HAND: f64 = 0.5;

/// The table, of all joints.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn table() -> Result<String, String> {
    let mut text = HEAD.to_owned();
    for way in WAYS {
        for (known, name) in KNOWN {
            let conditions = Conditions {
                bristles: Some(Bristles { way, known }),
                ..Conditions::new(shipped())
            };
            let indices: Vec<usize> = (0..JOINTS.len()).collect();
            let runs = parallel(&indices, |&index| {
                let hand = moved(index, &conditions, HAND)?;
                Ok((blocked(index, &conditions)?, hand))
            })?;
            let hz = |at: usize| {
                move |run: &_| {
                    let (blocked, _): &(crate::scenario::Blocked, _) = run;
                    blocked.bandwidth[at].unwrap_or(0.0)
                }
            };
            let columns = [
                range(runs.iter().map(hz(0))),
                range(runs.iter().map(hz(1))),
                range(runs.iter().map(|(blocked, _)| blocked.peak[0])),
                range(runs.iter().map(|(blocked, _)| blocked.step[1])),
                range(runs.iter().map(|(_, hand)| hand.reversal)),
            ];
            let _ = write!(text, "\n| {} | {name} |", 1e3 * way);
            for [least, median, most] in columns {
                let _ = write!(text, " {median:.1} ({least:.1} to {most:.1}) |");
            }
        }
    }
    text.push('\n');
    Ok(text)
}

/// Least, median and most.
fn range(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    [0, values.len() / 2, values.len() - 1].map(|at| values[at])
}

const HEAD: &str = "
## Bristles

The blocked joint and the hand at 0.5 rad/s again, with other bristles in the plant: the way of the motor over which
friction builds up, and what `presliding_rad` gives the law of it. Median of the seven joints (least to most).
Below 10 mrad friction turns round within a sine of 2 %, which is a fifth of it; its static part is not known.

<!-- rows: torque-control-bristles.csv, first 9 -->

| bristles, mrad | `presliding_rad` | -3 dB at 2 %, Hz | -3 dB at 20 %, Hz | peak at 2 % | overshoot, % | reversal, % of rated |
| --- | --- | --- | --- | --- | --- | --- |";
