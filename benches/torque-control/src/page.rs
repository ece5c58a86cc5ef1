//! The page of results.

use crate::cases::{cases, parallel};
use crate::scenario::{VELOCITIES, blocked, moved};
use crate::{bristles, rows, tables};
use std::path::Path;
use test_support::{ResultsPage, section};

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
    eprintln!("bristles");
    tables += &bristles::table()?;
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
    // Another bench's part of the page stays; a page that is written for the first time has none.
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    let drawn = section(&before, DRAWN_JOINTS);
    let page = format!("{HEAD}{AIMS}{aims}{NOTES}{drawn}{tables}");
    ResultsPage::new(&page)?.write(&path)
}

/// Heading of the part that `drawn-joints-bench` writes.
const DRAWN_JOINTS: &str = "## Drawn joints of another structure";

const HEAD: &str = "\
# Torque control: results

Written by `cargo run --release -p torque-control-bench`; theory and gains: [control.md](../control.md). Every
disturbance of `sim.toml` is on: stiction with bristles, hysteresis, meshing, ripple, encoders' noise and counts, torque
constants off by up to 2 %, dead zone, current limits; masses off by 1 %. Transport takes one cycle unless said. The law
knows `robot.toml` alone. D is the paper's law (D10-D12) with K_p = 2 on the torque of F/T sensors, 40 ms late. The test
joint is judged with an F/T sensor, like the others.
";

const AIMS: &str = "
## Aims

Of the predictive law, over all joints. Nothing was tuned with the other seeds, nor with the law's parameters, friction
included, off by up to 20 % (2 draws for joints, 4 for robots).

| | aim | measured | other seeds | parameters ±20 % |
| --- | --- | --- | --- | --- |
";

const NOTES: &str = "
Hip roll and knee come nearest to the aim of reversals ([why](../control-law.md#a-hand)). Errors of the drive's stiffness
and damping count only until its current has corrected them, within a second of motion.
";
