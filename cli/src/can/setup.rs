//! `torquectl can setup --dry-run`: what a set-up would write, beside what is there.

use super::{Done, Line, SetupArguments, load};
use drives::canopen::bring_up::{BringUp, Limits, Outcome};
use robot_config::Robot;
use serde_json::{Value, json};

pub(super) fn run(arguments: &SetupArguments) -> Done {
    let robot = load(&arguments.config)?;
    let plans = robot.nodes.plans.iter().cloned();
    let mut nodes: Vec<_> = plans
        .map(|plan| BringUp::dry(plan, Limits::default()))
        .collect();
    if !nodes.is_empty() {
        let mut line = Line::open(&robot.parameters.buses)?;
        line.run(|frames, now, out| {
            for node in &mut nodes {
                for frame in frames {
                    node.receive(frame, now, out);
                }
                node.poll(now, out);
            }
            let working = |node: &BringUp| matches!(node.outcome(), Outcome::Working(_));
            !nodes.iter().any(working)
        });
    }
    let done = nodes.iter().all(|node| *node.outcome() == Outcome::Done);
    let text = if arguments.json {
        let all: Vec<_> = nodes.iter().map(object).collect();
        format!("{:#}\n", json!({ "nodes": all, "as_planned": done }))
    } else {
        page(&robot, &nodes)
    };
    Ok((text, done))
}

fn page(robot: &Robot, nodes: &[BringUp]) -> String {
    let mut text = String::new();
    for node in nodes {
        let plan = node.plan();
        text += &format!("{} (node {})\n", plan.name, plan.node);
        for reading in &node.done().readings {
            text += &format!(
                "  {} {}: {:#x}\n",
                reading.object, reading.meaning, reading.value
            );
        }
        for change in &node.done().changes {
            text += &format!("  {change}\n");
        }
        for remark in &node.done().remarks {
            text += &format!("  note: {remark}\n");
        }
        if let Outcome::Failed(trouble) = node.outcome() {
            text += &format!("  not as planned: {trouble}\n");
        }
    }
    for actuator in &robot.nodes.actuators {
        let (name, node) = (&actuator.name, actuator.at.node);
        text += &format!(
            "{name} (node {node}): {}, no object is written\n",
            actuator.family
        );
    }
    if text.is_empty() {
        text = "No drive has a profile: nothing is written.\n".to_owned();
    }
    text
}

fn object(node: &BringUp) -> Value {
    let done = node.done();
    let readings = done.readings.iter().map(|reading| {
        let object = reading.object.to_string();
        json!({ "object": object, "meaning": reading.meaning, "value": reading.value })
    });
    let changes = done.changes.iter().map(|change| {
        json!({
            "object": change.object.to_string(),
            "meaning": change.meaning,
            "old": change.old,
            "new": change.new,
            "missing": change.missing,
        })
    });
    let trouble = match node.outcome() {
        Outcome::Failed(trouble) => Some(trouble.to_string()),
        _ => None,
    };
    json!({
        "joint": node.plan().name,
        "node": node.plan().node,
        "read": readings.collect::<Vec<_>>(),
        "written": changes.collect::<Vec<_>>(),
        "notes": done.remarks,
        "not_as_planned": trouble,
    })
}
