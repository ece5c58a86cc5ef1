//! The page of results.

use crate::cases::{cases, parallel};
use crate::scenario::{VELOCITIES, blocked, moved};
use crate::{rows, tables};
use std::path::Path;

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
The reversals that come nearest to the aim are those of hip roll and knee, whose drives are stiff and damp much ([control-law.md](../control-law.md#a-hand)). Stiffness and damping of the drive are corrected by its current, so that the errors of both count only until the joint has moved for a second. Not judged here: force control against a stiff object, the passive mode, contact reactions.
";
