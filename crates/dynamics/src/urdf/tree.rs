//! Topology: unique names, parents and children, one root, no loop; mimic joints resolved.

use super::problem_at;
use super::text::Source;
use problem::Problem;
use std::collections::{HashMap, HashSet};
use urdf_rs::JointType;

/// Indices into the URDF's links and joints.
pub(super) struct Tree {
    /// The only link without a parent.
    pub(super) root: usize,
    /// Joints that leave each link, sorted by name.
    pub(super) children: Vec<Vec<usize>>,
    /// Child link of each joint.
    pub(super) child: Vec<usize>,
    /// For each joint the one that drives it, and `q = ratio q_driver + offset`.
    pub(super) driver: Vec<Driver>,
    /// Odd but usable parts, each with its line.
    pub(super) warnings: Vec<Problem>,
}

/// See `Tree::driver`.
#[derive(Clone, Copy)]
pub(super) struct Driver {
    pub(super) joint: usize,
    pub(super) ratio: f64,
    pub(super) offset: f64,
}

impl Tree {
    pub(super) fn new(source: &Source, independent: &[String]) -> Result<Tree, Problem> {
        let robot = &source.robot;
        let links = by_name("link", robot.links.iter().map(|l| l.name.as_str()), |i| {
            source.links[i].own()
        })?;
        let joints = by_name("joint", robot.joints.iter().map(|j| j.name.as_str()), |i| {
            source.joints[i].own()
        })?;
        let mut children = vec![Vec::new(); robot.links.len()];
        let mut carrier: Vec<Option<usize>> = vec![None; robot.links.len()];
        let mut child = Vec::new();
        for (i, joint) in robot.joints.iter().enumerate() {
            let lines = &source.joints[i];
            let find = |tag: &str, link: &str| {
                links.get(link).copied().ok_or_else(|| {
                    let name = &joint.name;
                    let reason = format!("joint \"{name}\": <{tag} link=\"{link}\">: no such link");
                    problem_at(lines.of(tag), reason, "")
                })
            };
            let p = find("parent", &joint.parent.link)?;
            let c = find("child", &joint.child.link)?;
            if let Some(other) = carrier[c] {
                let other: &urdf_rs::Joint = &robot.joints[other];
                let reason = format!(
                    "link \"{}\" is carried by joint \"{}\" and by joint \"{}\"",
                    joint.child.link, other.name, joint.name
                );
                return Err(problem_at(lines.of("child"), reason, "one (loops are not)"));
            }
            carrier[c] = Some(i);
            children[p].push(i);
            child.push(c);
        }
        for list in &mut children {
            list.sort_by(|a, b| robot.joints[*a].name.cmp(&robot.joints[*b].name));
        }
        let root = root(source, &carrier)?;
        let mut warnings = Vec::new();
        let independent: HashSet<&str> = independent.iter().map(String::as_str).collect();
        let driver = drivers(source, &joints, &independent, &mut warnings)?;
        let tree = Tree {
            root,
            children,
            child,
            driver,
            warnings,
        };
        tree.refuse_loops(source)?;
        Ok(tree)
    }

    /// With one carrier per link, a link that the root does not reach is in a loop.
    fn refuse_loops(&self, source: &Source) -> Result<(), Problem> {
        let mut reached = vec![false; self.children.len()];
        let mut stack = vec![self.root];
        while let Some(link) = stack.pop() {
            reached[link] = true;
            stack.extend(self.children[link].iter().map(|j| self.child[*j]));
        }
        match reached.iter().position(|r| !r) {
            None => Ok(()),
            Some(link) => {
                let name = &source.robot.links[link].name;
                let reason = format!("link \"{name}\" is in a loop of joints or carried by one");
                Err(problem_at(source.links[link].own(), reason, "a tree"))
            }
        }
    }
}

fn by_name<'a>(
    what: &str,
    names: impl Iterator<Item = &'a str>,
    line: impl Fn(usize) -> usize,
) -> Result<HashMap<&'a str, usize>, Problem> {
    let mut map = HashMap::new();
    for (i, name) in names.enumerate() {
        if let Some(first) = map.insert(name, i) {
            let reason = format!("{what} \"{name}\" is already on line {}", line(first));
            return Err(problem_at(line(i), reason, "each name once"));
        }
    }
    Ok(map)
}

fn root(source: &Source, carrier: &[Option<usize>]) -> Result<usize, Problem> {
    let mut roots = (0..carrier.len()).filter(|i| carrier[*i].is_none());
    let Some(root) = roots.next() else {
        return Err(match source.links.first() {
            None => problem_at(source.line, "the robot has no <link>", "at least one"),
            Some(first) => problem_at(
                first.own(),
                "every link has a parent joint",
                "exactly one has none (the root)",
            ),
        });
    };
    if let Some(second) = roots.next() {
        let reason = format!(
            "links \"{}\" and \"{}\" both have no parent joint",
            source.robot.links[root].name, source.robot.links[second].name
        );
        return Err(problem_at(
            source.links[second].own(),
            reason,
            "exactly one (the root)",
        ));
    }
    Ok(root)
}

/// Follows mimic joints to the independent joint at their end.
fn drivers(
    source: &Source,
    joints: &HashMap<&str, usize>,
    independent: &HashSet<&str>,
    warnings: &mut Vec<Problem>,
) -> Result<Vec<Driver>, Problem> {
    let all = &source.robot.joints;
    let mut drivers = Vec::with_capacity(all.len());
    for start in 0..all.len() {
        let line = source.joints[start].of("mimic");
        let mut d = Driver {
            joint: start,
            ratio: 1.0,
            offset: 0.0,
        };
        let mut steps = 0;
        while let Some(mimic) = mimic(&all[d.joint], independent) {
            let name = &all[start].name;
            let next = joints.get(mimic.joint.as_str()).copied();
            if next.is_none() {
                let reason = format!(
                    "joint \"{}\" mimics \"{}\": no such joint",
                    all[d.joint].name, mimic.joint
                );
                let line = source.joints[d.joint].of("mimic");
                return Err(problem_at(line, reason, "a joint of this file"));
            }
            let Some(next) = next.filter(|n| all[*n].joint_type != JointType::Fixed) else {
                if steps == 0 {
                    let reason = format!(
                        "joint \"{name}\" mimics \"{}\", which is no moving joint: taken as independent",
                        mimic.joint
                    );
                    warnings.push(problem_at(line, reason, ""));
                }
                break;
            };
            d.offset += d.ratio * mimic.offset.unwrap_or(0.0);
            d.ratio *= mimic.multiplier.unwrap_or(1.0);
            d.joint = next;
            steps += 1;
            if steps > all.len() {
                let reason = format!("joint \"{name}\" mimics itself in the end");
                return Err(problem_at(line, reason, ""));
            }
        }
        if !(d.ratio.is_finite() && d.offset.is_finite()) {
            return Err(problem_at(line, "mimic ratios multiply to infinity", ""));
        }
        drivers.push(d);
    }
    Ok(drivers)
}

fn mimic<'a>(joint: &'a urdf_rs::Joint, independent: &HashSet<&str>) -> Option<&'a urdf_rs::Mimic> {
    match joint.joint_type {
        JointType::Fixed => None,
        _ if independent.contains(joint.name.as_str()) => None,
        _ => joint.mimic.as_ref(),
    }
}
