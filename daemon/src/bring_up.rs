//! Set-up of CANopen drives on the robot's buses, before the loop's first cycle.
//!
//! A plain piece of the main thread: all nodes at once, each by its own plan, until all are
//! operational or one is not as planned. Only the loop sends the heartbeat that drives listen for, so
//! that it ends with the loop: none is sent here.

use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};

use can_codec::{Frame, Frames, Gather, MAX_FRAMES, Table};
use drives::canopen::bring_up::{BringUp, Limits, Outcome, Plan, Reading, Trouble};
use drives::canopen::emcy::{self, Emergency};
use problem::{Problem, Problems};
use robot_config::Robot;

use crate::bus::Waiting;
use crate::failure::Failure;

/// Longest time between two looks at the nodes' time limits, ns.
pub(crate) const LOOK_NS: u64 = 2_000_000;

/// Sets all nodes of the robot up, and tells what they are.
///
/// # Errors
/// Every node that is not as planned, once the others have ended; `stop` was set meanwhile.
pub fn bring_up(robot: &Robot, bus: &mut impl Waiting, stop: &AtomicBool) -> Result<(), Failure> {
    let plans = &robot.nodes.plans;
    if plans.is_empty() {
        return Ok(());
    }
    if std::io::stderr().is_terminal() {
        tracing::info!("setting {} drives up", plans.len());
    }
    let limits = Limits::default();
    let nodes = plans.iter().map(|plan| BringUp::new(plan.clone(), limits));
    let nodes = run(nodes.collect(), bus, &robot.receive, stop)?;
    let buses = bus_names(robot);
    let mut problems = Vec::new();
    for node in &nodes {
        match node.outcome() {
            Outcome::Failed(trouble) => problems.push(problem(trouble, &buses)),
            _ => tell(node),
        }
    }
    if problems.is_empty() {
        Ok(())
    } else {
        Err(Failure::environment(Problems(problems)))
    }
}

/// The names of the robot's buses.
pub(crate) fn bus_names(robot: &Robot) -> Vec<String> {
    let buses = robot.parameters.buses.iter();
    buses.map(|bus| bus.name.clone()).collect()
}

/// Why a set-up failed, with node, bus, step and object, and what to do.
pub(crate) fn problem(trouble: &Trouble, buses: &[String]) -> Problem {
    let bus = buses.get(usize::from(trouble.bus));
    let bus = bus.map_or("?", String::as_str);
    let who = format!("{} (node {} on bus {bus})", trouble.name, trouble.node);
    let object = trouble.object.map(|object| format!(", object {object}"));
    let object = object.unwrap_or_default();
    let what = format!("{who}: {}{object}: {}", trouble.step, trouble.what);
    Problem::new(format!("{what}; {}", trouble.cure), "")
}

/// Tells what a node is that was set up, and what it lacks.
fn tell(node: &BringUp) {
    let (name, id) = (&node.plan().name, node.plan().node);
    let shown = |reading: &Reading| format!("{} {:#x}", reading.meaning, reading.value);
    let identity: Vec<_> = node.done().readings.iter().map(shown).collect();
    tracing::info!("{name} (node {id}): {}", identity.join(", "));
    for remark in &node.done().remarks {
        tracing::warn!("{name} (node {id}): {remark}");
    }
    for change in node.done().changes.iter().filter(|change| change.missing) {
        tracing::warn!("{name} (node {id}): {change}");
    }
}

/// Runs set-ups side by side until all have ended.
///
/// # Errors
/// `stop` was set.
pub fn run(
    mut nodes: Vec<BringUp>,
    bus: &mut impl Waiting,
    table: &Table,
    stop: &AtomicBool,
) -> Result<Vec<BringUp>, Failure> {
    let (mut rx, mut tx) = (Frames::default(), Frames::default());
    let mut gather = Gather::only(&vec![false; table.message_count()]);
    let mut out = Vec::<Frame>::with_capacity(MAX_FRAMES);
    let working = |node: &BringUp| matches!(node.outcome(), Outcome::Working(_));
    while nodes.iter().any(working) {
        if stop.load(Ordering::Relaxed) {
            return Err(Failure::environment(
                "stopped while drives were set up: nothing has moved",
            ));
        }
        let now = bus.now_ns();
        nodes.iter_mut().for_each(|node| node.poll(now, &mut out));
        send(bus, &mut tx, &mut out);
        bus.wait(now + LOOK_NS);
        rx.clear();
        gather.begin();
        bus.receive(&mut rx, &mut gather, table, 0);
        let now = bus.now_ns();
        for frame in &rx {
            if let Some(emergency) = Emergency::of(frame) {
                show(nodes.iter().map(BringUp::plan), frame.bus, emergency);
            }
            for node in &mut nodes {
                node.receive(frame, now, &mut out);
            }
        }
        send(bus, &mut tx, &mut out);
    }
    Ok(nodes)
}

/// Sends what is in `out`, and empties it.
pub(crate) fn send(bus: &mut impl Waiting, tx: &mut Frames, out: &mut Vec<Frame>) {
    tx.clear();
    for frame in out.drain(..) {
        tx.push(frame);
    }
    if !tx.is_empty() {
        // What the kernel does not take is asked for again.
        bus.send(tx);
    }
}

/// Shows an emergency in words, with the joint whose drive sent it.
pub(crate) fn show<'p>(plans: impl Iterator<Item = &'p Plan>, bus: u8, emergency: Emergency) {
    let mut sender = plans.filter(|plan| (plan.bus, plan.node) == (bus, emergency.node));
    let (node, code) = (emergency.node, emergency.code);
    let Some(plan) = sender.next() else {
        return;
    };
    let text = emcy::text(code);
    tracing::info!("{} (node {node}): emergency {code:04X}, {text}", plan.name);
}
