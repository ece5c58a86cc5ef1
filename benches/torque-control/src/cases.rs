//! Cases in which every joint is judged, and runs of all of them side by side.

use crate::joint::JOINTS;
use crate::variant::{Conditions, Law, shipped};
use std::sync::Mutex;

/// A joint of `JOINTS` in one row of the tables.
pub(crate) struct Case {
    pub(crate) index: usize,
    pub(crate) name: &'static str,
    pub(crate) conditions: Conditions,
}

/// Every joint under D's law and the predictive one, and under the latter where nothing was tuned.
pub(crate) fn cases() -> Vec<Case> {
    let base = Conditions::new(shipped());
    let other = |seed: u64, error: f64| Conditions {
        seed,
        error,
        draw: seed,
        ..base
    };
    let mut rows = vec![
        ("D", Conditions::new(Law::D { k6: None })),
        (PREDICTIVE, base),
    ];
    for seed in 2..=3 {
        rows.push((SEEDS, other(seed, 0.0)));
        rows.push((WRONG, other(seed, 0.2)));
    }
    (0..JOINTS.len())
        .flat_map(|index| {
            rows.iter().map(move |&(name, conditions)| Case {
                index,
                name,
                conditions,
            })
        })
        .collect()
}

/// Names of rows: the predictive law where it was tuned, with other seeds, and with parameters wrong by
/// up to 20 %.
pub(crate) const PREDICTIVE: &str = "predictive";
pub(crate) const SEEDS: &str = "predictive, other seeds";
pub(crate) const WRONG: &str = "predictive, parameters ±20 %";

/// Runs all on both cores, in order.
pub(crate) fn parallel<T: Sync, R: Send>(
    of: &[T],
    run: impl Fn(&T) -> Result<R, String> + Sync,
) -> Result<Vec<R>, String> {
    let next = Mutex::new(0);
    let done = Mutex::new(Vec::new());
    let take = || {
        let mut next = next.lock().ok()?;
        *next += 1;
        of.get(*next - 1).map(|item| (*next, item))
    };
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((index, item)) = take() {
                    let result = run(item);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, result));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}
