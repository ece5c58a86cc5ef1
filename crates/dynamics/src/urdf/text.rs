//! The XML: numbers are checked where their line is known, then `urdf-rs` reads a clean copy.

use super::namespaces::{self, plain};
use super::problem_at;
use super::transmission::{self, Transmission};
use super::unread;
use problem::Problem;
use roxmltree::{Document, Node};
use std::fmt::Write;

/// The robot as `urdf-rs` read it, and the line of each element.
pub(super) struct Source {
    pub(super) robot: urdf_rs::Robot,
    /// Line of `<robot>`.
    pub(super) line: usize,
    pub(super) links: Vec<Lines>,
    pub(super) joints: Vec<Lines>,
    pub(super) transmissions: Vec<Transmission>,
    /// Elements and attributes that nothing reads, each with its line.
    pub(super) unread: Vec<Problem>,
}

/// Lines of a link or joint and of its child elements, by tag.
pub(super) struct Lines {
    own: usize,
    parts: Vec<(&'static str, usize)>,
}

impl Lines {
    /// Line of the element itself.
    pub(super) fn own(&self) -> usize {
        self.own
    }
    /// Line of a child element, or of the element where it has none such.
    pub(super) fn of(&self, tag: &str) -> usize {
        let part = self.parts.iter().find(|p| p.0 == tag);
        part.map_or(self.own, |p| p.1)
    }
    /// True if the child element is there.
    pub(super) fn has(&self, tag: &str) -> bool {
        self.parts.iter().any(|p| p.0 == tag)
    }
}

/// Allowed value of an attribute.
pub(super) enum Kind {
    Text,
    /// Reads `N` finite numbers.
    Numbers(usize),
    /// One finite number that is not negative.
    NotNegative,
    /// One number, infinite allowed.
    Bound,
    /// A type of joint.
    JointType,
}
use Kind::{Bound, JointType, NotNegative, Numbers, Text};

const JOINT_TYPES: [&str; 4] = ["revolute", "continuous", "prismatic", "fixed"];

/// An element that matters: tag, attributes (name, kind, value where omitted), child elements.
pub(super) struct Rule {
    pub(super) tag: &'static str,
    pub(super) attributes: &'static [(&'static str, Kind, Option<&'static str>)],
    required: &'static [&'static str],
    pub(super) children: &'static [Rule],
}

const ORIGIN: Rule = Rule {
    tag: "origin",
    attributes: &[
        ("xyz", Numbers(3), Some("0 0 0")),
        ("rpy", Numbers(3), Some("")),
        ("quat_xyzw", Numbers(4), Some("")),
    ],
    required: &[],
    children: &[],
};

const fn leaf(
    tag: &'static str,
    attributes: &'static [(&'static str, Kind, Option<&'static str>)],
) -> Rule {
    Rule {
        tag,
        attributes,
        required: &[],
        children: &[],
    }
}

pub(super) const LINK: Rule = Rule {
    tag: "link",
    attributes: &[("name", Text, None)],
    required: &[],
    children: &[Rule {
        tag: "inertial",
        attributes: &[],
        required: &["mass", "inertia"],
        children: &[
            ORIGIN,
            leaf("mass", &[("value", Numbers(1), None)]),
            leaf(
                "inertia",
                &[
                    ("ixx", Numbers(1), None),
                    ("ixy", Numbers(1), Some("0")),
                    ("ixz", Numbers(1), Some("0")),
                    ("iyy", Numbers(1), None),
                    ("iyz", Numbers(1), Some("0")),
                    ("izz", Numbers(1), None),
                ],
            ),
        ],
    }],
};

pub(super) const JOINT: Rule = Rule {
    tag: "joint",
    attributes: &[("name", Text, None), ("type", JointType, None)],
    required: &["parent", "child"],
    children: &[
        ORIGIN,
        leaf("parent", &[("link", Text, None)]),
        leaf("child", &[("link", Text, None)]),
        leaf("axis", &[("xyz", Numbers(3), None)]),
        leaf(
            "limit",
            &[
                ("lower", Bound, Some("0")),
                ("upper", Bound, Some("0")),
                ("effort", Bound, Some("inf")),
                ("velocity", Bound, Some("inf")),
            ],
        ),
        leaf(
            "dynamics",
            &[
                ("damping", NotNegative, Some("0")),
                ("friction", NotNegative, Some("0")),
            ],
        ),
        leaf(
            "mimic",
            &[
                ("joint", Text, None),
                ("multiplier", Numbers(1), Some("1")),
                ("offset", Numbers(1), Some("0")),
            ],
        ),
    ],
};

/// Lines of a text by position, found once: roxmltree counts from the start for every element.
struct LineEnds(Vec<usize>);

impl LineEnds {
    fn of(text: &str) -> Self {
        Self(text.match_indices('\n').map(|(at, _)| at).collect())
    }
    fn line_at(&self, position: usize) -> usize {
        1 + self.0.partition_point(|end| *end < position)
    }
}

/// Reads the text of a URDF.
pub(super) fn read(text: &str) -> Result<Source, Problem> {
    let text = namespaces::declared(text).map_err(|e| not_xml(&e))?;
    let document = Document::parse(&text).map_err(|e| not_xml(&e))?;
    let root = document.root_element();
    let line_ends = LineEnds::of(&text);
    let line = |n: Node| line_ends.line_at(n.range().start);
    unread::refuse_xacro(&document, &line)?;
    if root.tag_name().name() != "robot" {
        let tag = root.tag_name().name();
        let reason = format!("the root element is <{tag}>");
        return Err(problem_at(line(root), reason, "<robot>"));
    }
    let mut copy = String::from("<robot");
    for name in ["name", "version"] {
        if let Some(value) = root.attribute(name) {
            attribute(&mut copy, name, value);
        }
    }
    copy.push('>');
    let (mut links, mut joints) = (Vec::new(), Vec::new());
    let unread = unread::judge(root, &line)?;
    for node in root.children().filter(|n| plain(n)) {
        let (rule, lines) = match node.tag_name().name() {
            "link" => (&LINK, &mut links),
            "joint" => (&JOINT, &mut joints),
            _ => continue,
        };
        let mut parts = Vec::new();
        element(rule, node, &line, &mut copy, &mut parts)?;
        lines.push(Lines {
            own: line(node),
            parts,
        });
    }
    copy.push_str("</robot>");
    let robot =
        urdf_rs::read_from_string(&copy).map_err(|e| problem_at(line(root), e.to_string(), ""))?;
    if robot.links.len() != links.len() || robot.joints.len() != joints.len() {
        return Err(problem_at(
            line(root),
            "links or joints were lost in reading",
            "",
        ));
    }
    Ok(Source {
        robot,
        line: line(root),
        links,
        joints,
        transmissions: transmission::read(root, &line)?,
        unread,
    })
}

/// A refusal of text that is not XML.
fn not_xml(error: &roxmltree::Error) -> Problem {
    if matches!(error, roxmltree::Error::DtdDetected) {
        let reason = "a document type (<!DOCTYPE>) with its entities is not read";
        return problem_at(
            1,
            reason,
            "a file without one, each entity (`&name;`) replaced by its text",
        );
    }
    problem_at(error.pos().row as usize, format!("not XML: {error}"), "")
}

/// Checks one element and writes its clean copy.
fn element(
    rule: &Rule,
    node: Node,
    line: &dyn Fn(Node) -> usize,
    copy: &mut String,
    parts: &mut Vec<(&'static str, usize)>,
) -> Result<(), Problem> {
    let _ = write!(copy, "<{}", rule.tag);
    for (name, kind, default) in rule.attributes {
        let value = match (node.attribute(*name), default) {
            (Some(given), _) => {
                if let Some(allowed) = allowed_instead(kind, given) {
                    let reason = format!("<{} {name}=\"{given}\">", rule.tag);
                    return Err(problem_at(line(node), reason, allowed));
                }
                given
            }
            (None, Some("")) => continue,
            (None, Some(default)) => default,
            (None, None) => {
                let tag = rule.tag;
                let reason = format!("<{tag}> lacks the attribute {name}");
                return Err(problem_at(line(node), reason, ""));
            }
        };
        attribute(copy, name, value);
    }
    copy.push('>');
    for child in rule.children {
        let mut found = node
            .children()
            .filter(|c| plain(c) && c.tag_name().name() == child.tag);
        match found.next() {
            Some(first) => {
                parts.push((child.tag, line(first)));
                element(child, first, line, copy, parts)?;
            }
            None if rule.required.contains(&child.tag) => {
                let reason = format!("<{}> lacks <{}>", rule.tag, child.tag);
                return Err(problem_at(line(node), reason, ""));
            }
            None => {}
        }
        if let Some(second) = found.next() {
            let reason = format!("<{}> holds a second <{}>", rule.tag, child.tag);
            return Err(problem_at(line(second), reason, "one"));
        }
    }
    let _ = write!(copy, "</{}>", rule.tag);
    Ok(())
}

/// Description of the allowed values, unless `value` is one of them.
fn allowed_instead(kind: &Kind, value: &str) -> Option<String> {
    let (is_allowed, allowed) = match kind {
        Text => (!value.trim().is_empty(), "a name".into()),
        JointType => (JOINT_TYPES.contains(&value), JOINT_TYPES.join(", ")),
        Bound => {
            let number = value.trim().parse::<f64>();
            (number.is_ok_and(|x| !x.is_nan()), "a number".into())
        }
        NotNegative => {
            let number = value.trim().parse::<f64>();
            let is_allowed = number.is_ok_and(|x| x.is_finite() && x >= 0.0);
            (is_allowed, "a finite number >= 0".into())
        }
        Numbers(n) => {
            let finite = |t: &str| t.parse::<f64>().is_ok_and(f64::is_finite);
            let mut tokens = value.split_whitespace();
            let all = tokens.clone().count() == *n && tokens.all(finite);
            let allowed = match n {
                1 => "a finite number".into(),
                n => format!("{n} finite numbers"),
            };
            (all, allowed)
        }
    };
    (!is_allowed).then_some(allowed)
}

fn attribute(copy: &mut String, name: &str, value: &str) {
    let _ = write!(copy, " {name}=\"");
    for c in value.chars() {
        match c {
            '&' => copy.push_str("&amp;"),
            '<' => copy.push_str("&lt;"),
            '>' => copy.push_str("&gt;"),
            '"' => copy.push_str("&quot;"),
            // A line break in an attribute would be read back as a space.
            c if c.is_control() => copy.push(' '),
            c => copy.push(c),
        }
    }
    copy.push('"');
}
