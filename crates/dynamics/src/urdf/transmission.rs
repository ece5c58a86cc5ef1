//! Gear ratios and rotor inertias in `<transmission>` and `<ros2_control>`.

use super::Complaint;
use roxmltree::Node;

/// What one element says of one joint.
pub(super) struct Transmission {
    pub(super) joint: String,
    pub(super) line: u32,
    pub(super) gear_ratio: Option<f64>,
    pub(super) rotor_inertia: Option<f64>,
}

const REDUCTION: [&str; 4] = [
    "mechanicalReduction",
    "mechanical_reduction",
    "gear_ratio",
    "gearRatio",
];
const ROTOR: [&str; 2] = ["rotorInertia", "rotor_inertia"];

/// All that the robot's extensions say of gears and rotors.
pub(super) fn read(
    robot: Node,
    line: &dyn Fn(Node) -> u32,
) -> Result<Vec<Transmission>, Complaint> {
    let mut found = Vec::new();
    for node in robot.children().filter(Node::is_element) {
        match node.tag_name().name() {
            "transmission" => transmission(node, line, &mut found)?,
            "ros2_control" => {
                for inner in node.children().filter(Node::is_element) {
                    match inner.tag_name().name() {
                        "transmission" => transmission(inner, line, &mut found)?,
                        "joint" => found.extend(joint(inner, line)?),
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }
    Ok(found)
}

/// A transmission's joints; where it has one joint and one actuator, their reductions multiply.
fn transmission(
    node: Node,
    line: &dyn Fn(Node) -> u32,
    found: &mut Vec<Transmission>,
) -> Result<(), Complaint> {
    let parts = |tag: &str| -> Vec<Node> {
        let children = node.children().filter(Node::is_element);
        children.filter(|n| n.tag_name().name() == tag).collect()
    };
    let (joints, actuators) = (parts("joint"), parts("actuator"));
    let simple = joints.len() == 1 && actuators.len() == 1;
    for node in joints {
        let Some(mut one) = joint(node, line)? else {
            continue;
        };
        if simple {
            let ratio = number(actuators[0], &REDUCTION, line)?;
            one.gear_ratio = match (one.gear_ratio, ratio) {
                (Some(a), Some(b)) => Some(a * b),
                (a, b) => a.or(b),
            };
            let rotor = number(actuators[0], &ROTOR, line)?;
            one.rotor_inertia = one.rotor_inertia.or(rotor);
        }
        found.push(one);
    }
    Ok(())
}

fn joint(node: Node, line: &dyn Fn(Node) -> u32) -> Result<Option<Transmission>, Complaint> {
    let Some(name) = node.attribute("name") else {
        return Ok(None);
    };
    let gear_ratio = number(node, &REDUCTION, line)?;
    if gear_ratio == Some(0.0) {
        let reason = format!("joint \"{name}\": gear ratio 0; allowed: any other finite number");
        return Err((line(node), reason));
    }
    let rotor_inertia = number(node, &ROTOR, line)?;
    Ok(Some(Transmission {
        joint: name.to_owned(),
        line: line(node),
        gear_ratio,
        rotor_inertia,
    }))
}

/// The number in a child element of one of these tags, or in a `<param>` of one of these names.
fn number(
    node: Node,
    names: &[&str],
    line: &dyn Fn(Node) -> u32,
) -> Result<Option<f64>, Complaint> {
    let is_it = |n: &Node| match n.tag_name().name() {
        "param" => n.attribute("name").is_some_and(|a| names.contains(&a)),
        tag => names.contains(&tag),
    };
    let Some(child) = node.children().filter(Node::is_element).find(is_it) else {
        return Ok(None);
    };
    let text = child.text().unwrap_or("").trim();
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(Some(x)),
        _ => {
            let tag = child.tag_name().name();
            let reason = format!("<{tag}> holds \"{text}\"; allowed: a finite number");
            Err((line(child), reason))
        }
    }
}
