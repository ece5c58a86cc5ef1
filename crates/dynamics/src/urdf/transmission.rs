//! Gear ratios and rotor inertias in `<transmission>` and `<ros2_control>`.

use super::namespaces::plain;
use super::problem_at;
use super::unread::alike;
use problem::Problem;
use roxmltree::Node;

/// Gear and rotor of one joint, as one element gives them.
pub(super) struct Transmission {
    pub(super) joint: String,
    pub(super) line: usize,
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

/// All gears and rotors in the robot's extensions.
pub(super) fn read(
    robot: Node,
    line: &dyn Fn(Node) -> usize,
) -> Result<Vec<Transmission>, Problem> {
    let mut found = Vec::new();
    for node in robot.children().filter(plain) {
        match node.tag_name().name() {
            "transmission" => transmission(node, line, &mut found)?,
            "ros2_control" => {
                for inner in node.children().filter(plain) {
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

/// A transmission's joints. Where it has one joint, the reductions of the joint, of the transmission
/// itself and of its only actuator multiply; else each joint has its own.
fn transmission(
    node: Node,
    line: &dyn Fn(Node) -> usize,
    found: &mut Vec<Transmission>,
) -> Result<(), Problem> {
    let parts = |tag: &str| -> Vec<Node> {
        let children = node.children().filter(Node::is_element);
        children.filter(|n| n.tag_name().name() == tag).collect()
    };
    let (joints, mut others) = (parts("joint"), parts("actuator"));
    match (joints.len(), others.len()) {
        (1, 0 | 1) => others.push(node),
        (1, _) => others = vec![node],
        _ => others.clear(),
    }
    for node in joints {
        let Some(mut one) = joint(node, line)? else {
            continue;
        };
        for other in &others {
            let ratio = gear_ratio(*other, line)?;
            one.gear_ratio = match (one.gear_ratio, ratio) {
                (Some(a), Some(b)) => Some(a * b),
                (a, b) => a.or(b),
            };
            one.rotor_inertia = one.rotor_inertia.or(rotor_inertia(*other, line)?);
        }
        found.push(one);
    }
    Ok(())
}

fn joint(node: Node, line: &dyn Fn(Node) -> usize) -> Result<Option<Transmission>, Problem> {
    let Some(name) = node.attribute("name") else {
        return Ok(None);
    };
    Ok(Some(Transmission {
        joint: name.to_owned(),
        line: line(node),
        gear_ratio: gear_ratio(node, line)?,
        rotor_inertia: rotor_inertia(node, line)?,
    }))
}

fn gear_ratio(node: Node, line: &dyn Fn(Node) -> usize) -> Result<Option<f64>, Problem> {
    number(node, &REDUCTION, line, "a finite number, not 0", |x| {
        x != 0.0
    })
}

fn rotor_inertia(node: Node, line: &dyn Fn(Node) -> usize) -> Result<Option<f64>, Problem> {
    number(node, &ROTOR, line, "a finite number >= 0", |x| x >= 0.0)
}

/// The number in a child element of one of these tags, or in a `<param>` of one of these names: as
/// its text, or as its attribute `value`.
fn number(
    node: Node,
    names: &[&str],
    line: &dyn Fn(Node) -> usize,
    allowed: &str,
    is_allowed: impl Fn(f64) -> bool,
) -> Result<Option<f64>, Problem> {
    let is_it = |n: &Node| match n.tag_name().name() {
        "param" => n.attribute("name").is_some_and(|a| names.contains(&a)),
        tag => names.contains(&tag),
    };
    let Some(child) = node.children().filter(Node::is_element).find(is_it) else {
        return match misspelt(node, names) {
            Some((child, written, meant)) => {
                let reason = format!("<{written}> is not read: names are exact");
                Err(problem_at(line(child), reason, format!("<{meant}>")))
            }
            None => Ok(None),
        };
    };
    let text = child.attribute("value").or(child.text()).unwrap_or("");
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() && is_allowed(x) => Ok(Some(x)),
        _ => {
            let tag = child.tag_name().name();
            let reason = format!("<{tag}> holds \"{}\"", text.trim());
            Err(problem_at(line(child), reason, allowed))
        }
    }
}

/// A child element whose name looks like one of these.
fn misspelt<'a, 'i>(
    node: Node<'a, 'i>,
    names: &[&'a str],
) -> Option<(Node<'a, 'i>, &'a str, &'a str)> {
    let mut children = node.children().filter(plain);
    children.find_map(|child| {
        let written = child.tag_name().name();
        let meant = names.iter().find(|name| alike(name, written))?;
        Some((child, written, *meant))
    })
}
