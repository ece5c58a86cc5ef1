//! Drives described by DBC files and as nodes of CiA 402, side by side: the time of `Cycle::step` for the humanoid, and
//! for each robot the errors of torques: `docs/results/cycle-profiles.md`.
//!
//! `profiles [--page FILE] [BLOCKS]` runs so many blocks (40) of cycles of both, alternating.
//! `valgrind --tool=callgrind --toggle-collect='cycle::cycle::Cycle::step' target/release/examples/profiles --only dbc 4`
//! counts the instructions of one of the two (`dbc`, `profiles`).

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "prints what the clock shows"
)]

use can_codec::{Frame, Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use drives::canopen::bring_up::{BringUp, Limits, Outcome};
use drives::canopen::heartbeat;
use drives::cia402::MASTER;
use plant::{CanRobot, SimParameters};
use robot_state::{JointReference, MAX_JOINTS, Mode, Reference, RobotState};
use std::path::PathBuf;
use std::time::Instant;
use test_support::{ResultsPage, read_project_file, with_canopen_nodes};

type Error = Box<dyn std::error::Error>;

/// The robot whose time counts, and those whose torques do.
const TIMED: &str = "humanoid";
const ROBOTS: [&str; 4] = ["test-joint", "lift-gripper", "hrp2-like", "humanoid"];
/// Cycles of a block.
const BLOCK: usize = 250;
/// Cycles after each change of mode that are not counted: filters and transitions settle.
const SETTLING: usize = 400;
/// Joints on a bus at 1 kHz (docs/drives.md).
const JOINTS_PER_BUS: usize = 2;
const PERIOD_NS: u64 = 1_000_000;
/// Motion while torques are compared: slow and small, so that the humanoid goes on standing. rad or m, 1/s, cycles.
const MOTION: [f64; 2] = [0.005, 2.0];
const MOVED: usize = 6000;

/// A robot in front of its cycle.
struct Side {
    cycle: Cycle,
    plant: CanRobot,
    /// Torque limits, N·m or N.
    limits: Vec<f64>,
    buses: usize,
    sync: Frames,
    rx: Frames,
    tx: Frames,
    now: u64,
    reference: Reference,
    stood: [f64; MAX_JOINTS],
    /// Times of the cycles, us, and most frames in one.
    times: Vec<f64>,
    most: [usize; 2],
}

impl Side {
    /// A robot with these drives, set up and holding.
    fn new(name: &str, canopen: bool) -> Result<Self, Error> {
        let config = format!("config/{name}/robot.toml");
        let read = |path: &str| {
            let text = read_project_file(path)?;
            Ok(match canopen && path == config {
                true => with_canopen_nodes(&text, JOINTS_PER_BUS),
                false => text,
            })
        };
        let robot = robot_config::load(&config, &read).map_err(|e| e.to_string())?;
        let sim_path = format!("config/{name}/sim.toml");
        let sim = SimParameters::parse(&read_project_file(&sim_path)?, &sim_path)?;
        let urdf = read_project_file(&robot.parameters.urdf_path)?;
        let mut sync = Frames::new(MAX_FRAMES);
        let buses = robot.nodes.plans.iter().map(|plan| plan.bus);
        let mut buses: Vec<u8> = buses.collect();
        buses.dedup();
        for bus in buses {
            sync.push(heartbeat(bus, MASTER));
        }
        for frame in &robot.sync {
            sync.push(*frame);
        }
        let mut side = Self {
            cycle: Cycle::new(&robot).map_err(|e| e.to_string())?,
            plant: CanRobot::new(&robot, &urdf, &sim).map_err(|e| e.to_string())?,
            limits: robot
                .parameters
                .joints
                .iter()
                .map(|j| j.limits.torque)
                .collect(),
            buses: robot.sync.len(),
            sync,
            rx: Frames::new(MAX_FRAMES),
            tx: Frames::new(MAX_FRAMES),
            now: 1_000_000_000,
            reference: Reference::default(),
            stood: [0.0; MAX_JOINTS],
            times: Vec::new(),
            most: [0; 2],
        };
        let plans = robot.nodes.plans.iter().cloned();
        side.set_up(
            plans
                .map(|plan| BringUp::new(plan, Limits::default()))
                .collect(),
        )?;
        for _ in 0..20 * BLOCK {
            side.step();
            if side.cycle.record().state == RobotState::Holding.number() {
                return Ok(side);
            }
        }
        let record = side.cycle.record();
        Err(format!("state {}, fault {}", record.state, record.fault).into())
    }

    /// Sets the nodes up, if there are any.
    fn set_up(&mut self, mut nodes: Vec<BringUp>) -> Result<(), Error> {
        let mut out = Vec::<Frame>::with_capacity(MAX_FRAMES);
        while nodes
            .iter()
            .any(|n| matches!(n.outcome(), Outcome::Working(_)))
        {
            self.now += PERIOD_NS;
            nodes.iter_mut().for_each(|n| n.poll(self.now, &mut out));
            self.tx.clear();
            out.drain(..).for_each(|frame| {
                self.tx.push(frame);
            });
            self.rx.clear();
            self.plant.exchange(&self.tx, self.now, &mut self.rx);
            for frame in &self.rx {
                let now = self.now;
                nodes
                    .iter_mut()
                    .for_each(|n| n.receive(frame, now, &mut out));
            }
        }
        match nodes.iter().find_map(|n| match n.outcome() {
            Outcome::Failed(trouble) => Some(trouble),
            _ => None,
        }) {
            Some(trouble) => Err(format!("{trouble:?}").into()),
            None => Ok(()),
        }
    }

    /// Begins a mode where the robot stands.
    fn begin(&mut self, mode: Mode) {
        let record = self.cycle.record();
        (self.reference.mode, self.reference.joint_count) = (mode.number(), record.joint_count);
        for (stood, joint) in self.stood.iter_mut().zip(&record.measured.joints) {
            *stood = joint.q;
        }
        for (desired, stood) in self.reference.joints.iter_mut().zip(self.stood) {
            *desired = JointReference {
                q_d: stood,
                ..JointReference::default()
            };
        }
        self.times.clear();
    }

    /// One cycle.
    fn step(&mut self) {
        self.gather();
        self.compute();
        self.send();
    }

    /// SYNC, and what it brings.
    fn gather(&mut self) {
        self.now += PERIOD_NS;
        self.rx.clear();
        self.plant.exchange(&self.sync, self.now, &mut self.rx);
    }

    /// Part that is timed; its time, us.
    fn compute(&mut self) -> f64 {
        self.tx.clear();
        self.reference.sequence += 1;
        let client = ClientInput {
            reference: (self.reference.mode != 0).then_some(&self.reference),
            age_s: 0.001,
            ..ClientInput::default()
        };
        let at = Instants {
            sync: Stamp(self.now),
            now: Stamp(self.now),
        };
        let begin = Instant::now();
        self.cycle.step(at, &self.rx, &client, &mut self.tx);
        begin.elapsed().as_secs_f64() * 1e6
    }

    fn send(&mut self) {
        for (most, frames) in self.most.iter_mut().zip([&self.rx, &self.tx]) {
            *most = (*most).max(frames.len());
        }
        let mut none = Frames::default();
        self.plant.exchange(&self.tx, self.now, &mut none);
    }

    /// Root mean squares over a motion, in per mille of each joint's torque limit: error of the estimated torque, and of
    /// the true one against the desired one.
    fn torque_errors(&mut self) -> [Vec<f64>; 2] {
        let mut sums = [0, 1].map(|_| vec![0.0; self.limits.len()]);
        for cycle in 0..MOVED {
            let moved = MOTION[0] * (MOTION[1] * 1e-3 * cycle as f64).sin();
            for (desired, stood) in self.reference.joints.iter_mut().zip(self.stood) {
                desired.q_d = stood + moved;
            }
            self.step();
            let record = self.cycle.record();
            let joints = record.estimated.joints.iter().zip(&record.commanded.joints);
            let truth = self.plant.truth().joints.iter().zip(&self.limits);
            for (j, ((estimated, commanded), (truth, limit))) in joints.zip(truth).enumerate() {
                sums[0][j] += ((estimated.tau_hat.tau - truth.tau) / limit).powi(2);
                sums[1][j] += ((truth.tau - commanded.tau_d) / limit).powi(2);
            }
        }
        let rms = |sum: &f64| 1e3 * (sum / MOVED as f64).sqrt();
        sums.map(|sums| sums.iter().map(rms).collect())
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// One of the two ways to describe the frames.
struct Way {
    name: &'static str,
    side: Side,
}

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1).peekable();
    let mut value = |key: &str| match arguments.next_if(|argument| argument == key) {
        Some(_) => arguments.next(),
        None => None,
    };
    let (page, only) = (value("--page").map(PathBuf::from), value("--only"));
    let blocks = arguments.next().map_or(Ok(40), |number| number.parse())?;
    let mut ways = Vec::new();
    for (name, canopen) in [("dbc", false), ("profiles", true)] {
        if only.as_ref().is_none_or(|only| only == name) {
            let side = Side::new(TIMED, canopen)?;
            ways.push(Way { name, side });
        }
    }
    let mut rows = String::new();
    for mode in [Mode::Hold, Mode::InverseDynamics] {
        let row = compare(&mut ways, mode, blocks)?;
        eprint!("{row}");
        rows += &row;
    }
    let mut text = format!("{HEAD}{rows}\n{}", frames(&ways));
    if only.is_none() {
        text += TORQUES;
        for name in ROBOTS {
            let row = torques(name)?;
            eprint!("{row}");
            text += &row;
        }
    }
    match page {
        Some(page) => ResultsPage::new(&text)?.write(&page)?,
        None => println!("{text}"),
    }
    Ok(())
}

/// Runs a mode in alternating blocks: the row of the table.
fn compare(ways: &mut [Way], mode: Mode, blocks: usize) -> Result<String, Error> {
    for way in ways.iter_mut() {
        way.side.begin(mode);
        (0..SETTLING).for_each(|_| way.side.step());
    }
    let mut ratios = Vec::new();
    for _ in 0..blocks {
        let mut medians = Vec::new();
        let begin: Vec<usize> = ways.iter().map(|way| way.side.times.len()).collect();
        for cycle in 0..BLOCK {
            // Both find the caches as the other's simulation and cycle leave them, and neither is always the first.
            ways.iter_mut().for_each(|way| way.side.gather());
            ways.rotate_left(cycle % ways.len());
            for way in ways.iter_mut() {
                let time = way.side.compute();
                way.side.times.push(time);
            }
            ways.rotate_right(cycle % ways.len());
            ways.iter_mut().for_each(|way| way.side.send());
        }
        for (way, begin) in ways.iter().zip(begin) {
            medians.push(median(&mut way.side.times[begin..].to_vec()));
        }
        if let [dbc, profiles] = medians[..] {
            ratios.push(profiles / dbc);
        }
    }
    let mut medians = Vec::new();
    for way in ways.iter_mut() {
        let reached = way.side.cycle.record().mode;
        if reached != mode.number() {
            return Err(format!("{}: {}: mode {reached}", way.name, mode.name()).into());
        }
        medians.push(format!("{:.1}", median(&mut way.side.times)));
    }
    let ratio = median(&mut ratios);
    let quartile = |share: usize| {
        ratios
            .get(ratios.len() * share / 4)
            .copied()
            .unwrap_or(f64::NAN)
    };
    let spread = format!(
        "{:+.1} to {:+.1}",
        percent(quartile(1)),
        percent(quartile(3))
    );
    let (name, medians) = (mode.name(), medians.join(" | "));
    Ok(format!(
        "| {name} | {medians} | {:+.1} | {spread} |\n",
        percent(ratio)
    ))
}

/// A robot's row of the second table.
fn torques(name: &str) -> Result<String, Error> {
    let mut cells = String::new();
    let mut buses = Vec::new();
    let mut errors = Vec::new();
    for canopen in [false, true] {
        let mut side = Side::new(name, canopen)?;
        side.begin(Mode::InverseDynamics);
        (0..SETTLING).for_each(|_| side.step());
        errors.push(side.torque_errors());
        buses.push(side.buses.to_string());
    }
    for of in [0, 1] {
        for errors in &mut errors {
            let greatest = errors[of].iter().copied().fold(0.0, f64::max);
            cells += &format!(" {:.1}, {greatest:.1} |", median(&mut errors[of]));
        }
    }
    Ok(format!("| {name} | {} |{cells}\n", buses.join(", ")))
}

fn percent(ratio: f64) -> f64 {
    100.0 * (ratio - 1.0)
}

fn frames(ways: &[Way]) -> String {
    let of = |way: &Way| {
        let [received, sent] = way.side.most;
        format!("{}: {received} received, {sent} sent", way.name)
    };
    let all: Vec<String> = ways.iter().map(of).collect();
    format!("Most frames in a cycle: {}.\n", all.join("; "))
}

const HEAD: &str = "\
# Profiles beside DBC files

```sh
cargo run --release -p cycle --example profiles -- --page docs/results/cycle-profiles.md
```

times `Cycle::step` of the humanoid: its 30 drives described by DBC files, and by `profile = \"cia402\"` and `node`, two
on each of 15 buses. Both are set up and simulated, and take turns: one cycle of each, neither always the first. Buses
are in memory. Medians, us; the change is the median of those of 250 cycles each.

| mode | DBC | profiles | change, % | quartiles |
| --- | --- | --- | --- | --- |
";

const TORQUES: &str = "
## Torques

Each robot moves by 0.005 rad (m) at 2 rad/s in mode inverse dynamics for 6 s, with the drives of its DBC file, and
with nodes of CiA 402 that count the same encoders. Root mean square errors of the estimated torque against the true
one, and of the true one against the desired one, per mille of the torque limit: median and greatest of the joints.

| robot | buses | estimated: DBC | profiles | made: DBC | profiles |
| --- | --- | --- | --- | --- | --- |
";
