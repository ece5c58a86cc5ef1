//! What a URDF holds and nothing reads: refused where a mass or a place would be lost without a word,
//! a warning where it is merely unknown, silent where it is a known extension.

use super::namespaces::plain;
use super::problem_at;
use super::text::{JOINT, LINK, Rule};
use problem::{Problem, listed};
use roxmltree::{Document, Node};

/// Elements of `<robot>` that are no dynamics: of the URDF's own description, of Gazebo, ROS, `ros2_control`,
/// MuJoCo, Drake, SRDF, Isaac and CAD exporters.
const OF_ROBOT: &[&str] = &[
    "link",
    "joint",
    "material",
    "transmission",
    "gazebo",
    "ros2_control",
    "sensor",
    "mujoco",
    "frame",
    "loop_joint",
    "linkage",
    "bushing",
    "collision_filter_group",
    "group",
    "group_state",
    "gripper",
    "disable_collisions",
    "disable_default_collisions",
    "enable_collisions",
    "end_effector",
    "virtual_joint",
    "passive_joint",
    "link_sphere_approximation",
    "loop",
    "camera",
    "actuator",
    "plugin",
    "author",
    "version",
    "isaac_sim",
    "joint_properties",
    "self_collision_checking",
];
/// Elements of `<link>` beyond those that are read.
const OF_LINK: &[&str] = &[
    "visual",
    "collision",
    "sensor",
    "material",
    "contact",
    "self_collision_checking",
    "verbose",
    "static",
    "gravity",
    "audio",
    "projector",
    "collision_checking",
    "plugin",
    "gazebo",
];
/// Elements of `<joint>` beyond those that are read.
const OF_JOINT: &[&str] = &[
    "calibration",
    "safety_controller",
    "hardwareInterface",
    "mechanicalReduction",
    "physics",
    "actuator",
    "rotor_inertia",
    "gear_ratio",
    "controller",
    "sensor",
    "gazebo",
    "default",
    "screw_thread_pitch",
    "joint_properties",
    "limits_soft",
];
/// Attributes that some programs write and whose loss changes no dynamics that is read.
const ATTRIBUTES: &[&str] = &[
    "id",
    "acceleration",
    "jerk",
    "armature",
    "stiffness",
    "springref",
    "spring_stiffness",
    "spring_reference",
    "type",
    "comment",
    "description",
    "rotor_inertia",
    "gear_ratio",
    "frictionloss",
    "k_position",
    "k_velocity",
    "version",
    "version_number",
    "model",
    "has_acceleration_limits",
    "max_acceleration",
    "has_jerk_limits",
    "max_jerk",
    "deceleration",
];

/// Elements whose attributes may hold `$(find package)`: of drawings and of other programs.
const NOT_DYNAMICS: &[&str] = &[
    "visual",
    "collision",
    "material",
    "gazebo",
    "ros2_control",
    "sensor",
    "plugin",
    "mujoco",
];

/// Refuses elements of xacro: what they stand for is not in the text.
///
/// # Errors
/// The first such element, or the first expression in an attribute of an element that is read.
pub(super) fn refuse_xacro(
    document: &Document,
    line: &dyn Fn(Node) -> usize,
) -> Result<(), Problem> {
    const EXPAND: &str = "a file that xacro has expanded: `xacro robot.urdf.xacro > robot.urdf`";
    for node in document.root().descendants().filter(Node::is_element) {
        let namespace = node.tag_name().namespace().unwrap_or("");
        if namespace.contains("xacro") {
            let name = node.tag_name().name();
            let reason =
                format!("<xacro:{name}> is an element of xacro, whose contents are not read");
            return Err(problem_at(line(node), reason, EXPAND));
        }
        let expressions = node.attributes().filter(|attribute| {
            let value = attribute.value();
            value.contains("${") || value.contains("$(")
        });
        let drawn = (node.ancestors()).any(|a| NOT_DYNAMICS.contains(&a.tag_name().name()));
        let mut expressions = expressions.filter(|_| !drawn);
        if let Some(attribute) = expressions.next() {
            let (name, value) = (attribute.name(), attribute.value());
            let reason = format!("{name}=\"{value}\" is an expression of xacro");
            return Err(problem_at(line(node), reason, EXPAND));
        }
    }
    Ok(())
}

/// Characters of a text that a message shows.
const MAX_SHOWN: usize = 40;

/// Parts of links that have no mass of their own.
const DRAWN: &[&str] = &["visual", "collision", "material", "contact"];

/// Warnings of what nothing reads in links and joints, and beside them.
///
/// # Errors
/// What looks like a misspelt or misplaced element or attribute that would be read, an unknown element that holds a
/// mass, and whatever is unknown in an element whose numbers are read.
pub(super) fn judge(root: Node, line: &dyn Fn(Node) -> usize) -> Result<Vec<Problem>, Problem> {
    let mut judge = Judge {
        line,
        warnings: Vec::new(),
    };
    judge.text(root, "robot", &[])?;
    for node in root.children().filter(Node::is_element) {
        match node.tag_name().name() {
            _ if !plain(&node) => judge.foreign(node, "robot", &[]),
            "link" => judge.element(&LINK, node, OF_LINK)?,
            "joint" => {
                judge.element(&JOINT, node, OF_JOINT)?;
                judge.limit(node);
            }
            _ => judge.unread(node, "robot", &["link", "joint"], OF_ROBOT)?,
        }
    }
    Ok(judge.warnings)
}

struct Judge<'a> {
    line: &'a dyn Fn(Node) -> usize,
    warnings: Vec<Problem>,
}

impl Judge<'_> {
    /// An element that is read: its attributes, the text in it, and the elements in it.
    fn element(&mut self, rule: &Rule, node: Node, others: &[&str]) -> Result<(), Problem> {
        self.attributes(rule, node)?;
        let names: Vec<&str> = rule.attributes.iter().map(|(name, ..)| *name).collect();
        let values = if rule.children.is_empty() {
            &*names
        } else {
            &[]
        };
        self.text(node, rule.tag, values)?;
        let read: Vec<&str> = rule.children.iter().map(|child| child.tag).collect();
        for child in node.children().filter(Node::is_element) {
            let tag = child.tag_name().name();
            match rule.children.iter().find(|known| known.tag == tag) {
                _ if !plain(&child) => self.foreign(child, rule.tag, &read),
                Some(known) => self.element(known, child, &[])?,
                None if others.is_empty() => {
                    let reason = format!("<{tag}> within <{}> is not read", rule.tag);
                    let allowed = if read.is_empty() {
                        listed(names.iter().copied())
                    } else {
                        elements(&read, tag)
                    };
                    return Err(problem_at((self.line)(child), reason, allowed));
                }
                None => self.unread(child, rule.tag, &read, others)?,
            }
        }
        Ok(())
    }

    /// An element with another prefix: warned of where it has the name of one that is `read`, or a mass.
    fn foreign(&mut self, node: Node, within: &str, read: &[&str]) {
        let (tag, namespace) = (node.tag_name().name(), node.tag_name().namespace());
        if !read.contains(&tag) && !node.descendants().any(|part| holds_mass(&part)) {
            return;
        }
        let prefix = namespace.and_then(|namespace| node.lookup_prefix(namespace));
        let prefix = prefix.unwrap_or_default();
        let reason = format!("<{prefix}:{tag}> within <{within}> is not read");
        self.warnings
            .push(problem_at((self.line)(node), reason, ""));
    }

    /// Text between elements: refused where the `attributes` of an element hold what it says.
    fn text(&mut self, node: Node, tag: &str, attributes: &[&str]) -> Result<(), Problem> {
        let texts = node.children().filter(Node::is_text);
        let mut texts = texts.filter_map(|text| text.text()).map(str::trim);
        let Some(text) = texts.find(|text| !text.is_empty()) else {
            return Ok(());
        };
        let shown: String = text.chars().take(MAX_SHOWN).collect();
        let reason = format!("the text \"{shown}\" within <{tag}> is not read");
        let line = (self.line)(node);
        if attributes.is_empty() {
            self.warnings.push(problem_at(line, reason, ""));
            return Ok(());
        }
        let allowed = format!("attributes: {}", listed(attributes.iter().copied()));
        Err(problem_at(line, reason, allowed))
    }

    fn attributes(&mut self, rule: &Rule, node: Node) -> Result<(), Problem> {
        let known: Vec<&str> = rule.attributes.iter().map(|(name, ..)| *name).collect();
        let lacks = known.iter().any(|name| node.attribute(*name).is_none());
        for attribute in node.attributes().filter(|a| a.namespace().is_none()) {
            let name = attribute.name();
            if known.contains(&name) || ATTRIBUTES.contains(&name) {
                continue;
            }
            let tag = rule.tag;
            let reason = format!("<{tag} {name}=\"{}\"> is not read", attribute.value());
            let near = known.iter().any(|known| alike(known, name));
            // Without its own attribute such an element would silently have the value where omitted.
            let numeric = matches!(tag, "origin" | "mass" | "inertia" | "axis" | "mimic")
                || (tag == "limit" && lacks);
            let line = (self.line)(node);
            if near || numeric {
                return Err(problem_at(line, reason, listed(known.iter().copied())));
            }
            if let Some(place) = place_of(rule, name) {
                return Err(problem_at(line, reason, place));
            }
            self.warnings.push(problem_at(line, reason, ""));
        }
        Ok(())
    }

    /// Warns of what a limit leaves out: the URDF's own values for that are seldom meant.
    fn limit(&mut self, joint: Node) {
        let mut parts = joint.children().filter(plain);
        let Some(limit) = parts.find(|part| part.tag_name().name() == "limit") else {
            return;
        };
        let (name, kind) = (joint.attribute("name"), joint.attribute("type"));
        let name = name.unwrap_or_default();
        let mut warn = |what: &str, taken: &str| {
            let reason = format!("joint \"{name}\": its <limit> has no {what}: {taken}");
            self.warnings
                .push(problem_at((self.line)(limit), reason, ""));
        };
        if kind == Some("fixed") {
            return;
        }
        for what in ["effort", "velocity"] {
            if limit.attribute(what).is_none() {
                warn(what, "none is assumed");
            }
        }
        let bounds = limit.attribute("lower").or(limit.attribute("upper"));
        if bounds.is_none() && kind != Some("continuous") {
            warn("lower and upper", "both are 0, and it cannot move");
        }
    }

    /// An element that is not read.
    fn unread(
        &mut self,
        node: Node,
        within: &str,
        read: &[&str],
        known: &[&str],
    ) -> Result<(), Problem> {
        let tag = node.tag_name().name();
        let line = (self.line)(node);
        let reason = format!("<{tag}> within <{within}> is not read");
        let allowed = elements(read, tag);
        let is_known = known.contains(&tag) && !read.contains(&tag);
        if is_known && !DRAWN.contains(&tag) {
            return Ok(());
        }
        if !is_known && read.iter().any(|read| alike(read, tag)) {
            let reason = format!("{reason}: names are exact");
            return Err(problem_at(line, reason, allowed));
        }
        if node.descendants().any(|part| holds_mass(&part)) {
            let reason = format!("{reason}, with the masses and links in it");
            return Err(problem_at(line, reason, allowed));
        }
        if is_known {
            return Ok(());
        }
        let meant = place_of(&LINK, tag).or(place_of(&JOINT, tag));
        if let Some(place) = meant.filter(|_| !is_zero(&node)) {
            return Err(problem_at(line, reason, place));
        }
        self.warnings.push(problem_at(line, reason, ""));
        Ok(())
    }
}

/// The element that `written` may be meant as, or all that are read.
fn elements(read: &[&str], written: &str) -> String {
    let tag = |tag: &&str| format!("<{tag}>");
    match read.iter().find(|read| alike(read, written)) {
        Some(meant) => tag(meant),
        None => {
            let tags: Vec<String> = read.iter().map(tag).collect();
            listed(tags.iter().map(String::as_str))
        }
    }
}

/// An element that has a mass, or is a link.
fn holds_mass(node: &Node) -> bool {
    let tag = node.tag_name().name().to_ascii_lowercase();
    matches!(tag.as_str(), "mass" | "inertial" | "link") || node.attribute("mass").is_some()
}

/// An element that would say nothing wherever it stood: exporters write such origins.
fn is_zero(node: &Node) -> bool {
    let zero = |token: &str| token.parse() == Ok(0.0);
    let mut attributes = node.attributes();
    attributes.all(|attribute| attribute.value().split_whitespace().all(zero))
}

/// Where below an element an element or attribute of that name is read, in words.
fn place_of(rule: &Rule, name: &str) -> Option<String> {
    rule.children.iter().find_map(|child| {
        let tag = child.tag;
        if tag == name {
            return Some(format!("<{tag}> within <{}>", rule.tag));
        }
        let own = child.attributes.iter().any(|(own, ..)| *own == name);
        let here = own.then(|| format!("<{tag} {name}=\"...\">"));
        here.or_else(|| place_of(child, name))
    })
}

/// Whether `written` may be meant as `known`: but for upper case, an underscore, or one letter in five.
pub(super) fn alike(known: &str, written: &str) -> bool {
    let plain = |name: &str| name.to_ascii_lowercase().replace(['_', '-'], "");
    let (a, b) = (plain(known), plain(written));
    let letters = a.chars().count();
    a == b || (letters >= 4 && distance(&a, &b) <= letters.div_ceil(5))
}

/// Number of letters to add, drop, exchange with their neighbour or replace (restricted Damerau and
/// Levenshtein).
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let replaced = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = replaced.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}
