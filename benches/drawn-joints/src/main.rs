//! Torque control on single joints that share nothing with the project's plant but the frames: writes what
//! docs/results/torque-control.md says of them beside the own plant.

mod catalogue;
mod config;
mod draw;
mod drive;
mod friction;
mod gear;
mod plant;
mod rig;
mod tasks;

use catalogue::Catalogue;
use config::Bristles;
use draw::Drawn;
use tasks::Extent;

fn main() {
    let catalogue = Catalogue::all().unwrap();
    for seed in 0..std::env::args().nth(1).map_or(7, |n| n.parse().unwrap()) {
        let drawn = Drawn::new(&catalogue[seed as usize % 7], seed);
        println!("{}: {}", drawn.name, drawn.structure);
        let t = std::time::Instant::now();
        println!("{:?} {:?}", tasks::joint(&drawn, Bristles::Known, Extent::ALL), t.elapsed());
    }
}
