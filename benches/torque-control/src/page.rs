//! The page of results.

use crate::joint::JOINTS;
use crate::scenario::{VELOCITIES, blocked, moved};
use crate::variant::{Conditions, Law, shipped};
use crate::{rows, tables};
use std::path::Path;
use std::sync::Mutex;

/// A joint of `JOINTS` in one row of the tables.
pub(crate) struct Case {
    pub(crate) index: usize,
    pub(crate) name: &'static str,
    pub(crate) conditions: Conditions,
}

/// Every joint under D's law and the predictive one, and under the latter where nothing was tuned.
fn cases() -> Vec<Case> {
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

/// Runs everything and writes the page and its picture.
///
/// # Errors
/// A run that fails, a file that cannot be written.
pub(crate) fn write(out: &Path, joints_only: bool) -> Result<(), String> {
    let all = cases();
    eprintln!("blocked joints");
    let blocked = parallel(&all, |case| blocked(case.index, &case.conditions))?;
    eprintln!("joints moved by hand");
    let moved = parallel(&all, |case| {
        let one = |velocity: f64| moved(case.index, &case.conditions, velocity);
        VELOCITIES
            .into_iter()
            .map(one)
            .collect::<Result<Vec<_>, _>>()
    })?;
    let mut aims = tables::aims(&all, &blocked, &moved);
    let mut tables = tables::blocked_tables(&all, &blocked);
    tables += "\n![Steps of 20 % of rated](torque-control.svg)\n";
    tables += &tables::moved_table(&all, &moved);
    if !joints_only {
        eprintln!("robots");
        let (text, more) = rows::tables()?;
        tables += &text;
        aims += &more;
        eprintln!("current drives");
        tables += &rows::currents()?;
    }
    let picture = tables::figure(&all, &blocked).write(&out.join("torque-control.svg"));
    picture.map_err(|e| e.to_string())?;
    let path = out.join("torque-control.md");
    let page = format!("{HEAD}{AIMS}{aims}{NOTES}{tables}");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))
}

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

const HEAD: &str = "\
# Torque control: results

Written by `cargo run --release -p torque-control-bench`; theory and gains: [control.md](../control.md). The simulated joints and robots have every disturbance of `sim.toml` on: stiction with bristles, hysteresis, meshing, ripple, encoders' noise and counts, torque constants off by up to 2 %, dead zone, current limits; masses off by 1 %. One cycle of transport delay unless said. The law knows `robot.toml` only: K_tau, K_v, dead zone, data-sheet inertia, catalogue gear. D is the law of the paper (D10-D12) with K_p = 2 on the torque of F/T sensors, 40 ms late. The test joint has no F/T sensor in its configuration; here it is judged with one, like the others.
";

const AIMS: &str = "
## Aims

Of the predictive law, over all joints. Nothing was tuned with the other seeds of the simulated joints and robots, nor with the law's parameters, its friction included, off by up to 20 % (2 draws for joints, 4 for robots).

| | aim | measured | other seeds | parameters ±20 % |
| --- | --- | --- | --- | --- |
";

const NOTES: &str = "
Missed: the reversal, by the drive's own damping ([control.md](../control.md)); with parameters off by 20 %, the overshoot of hip pitch and ankle pitch (one draw of two each) and the mean torque of a joint that is moved. The sine of 1 Hz on the test joint is worse with friction foreseen (14 % instead of 3 %): its link encoder is coarse, and the velocity of its noise bends the bristle. Not judged here: force control against a stiff object, the passive mode, contact reactions.
";
