//! The joints of a URDF that drives move.

use crate::output::read_input;
use problem::{Problem, Problems};
use roxmltree::{Document, Node};
use std::path::Path;

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Joint {
    pub(super) name: String,
    /// N·m.
    pub(super) effort: f64,
    /// rad/s.
    pub(super) velocity: f64,
}

/// The revolute joints in the order of the file.
pub(super) fn joints(path: &Path) -> Result<Vec<Joint>, Problems> {
    let file = path.display().to_string();
    let text = read_input(path).map_err(Problems::from)?;
    let refuse =
        |what: String, allowed: &str| Problems::from(Problem::new(what, allowed).at(&file, 0));
    let document = Document::parse(&text).map_err(|e| refuse(e.to_string(), "a URDF"))?;
    let mut joints = Vec::new();
    let is_joint = |node: &Node<'_, '_>| node.has_tag_name("joint") && node.has_attribute("type");
    for node in document.root_element().children().filter(is_joint) {
        let name = node.attribute("name").unwrap_or("-");
        let kind = node.attribute("type").unwrap_or("-");
        let has = |tag: &str| node.children().find(|child| child.has_tag_name(tag));
        if kind == "fixed" || has("mimic").is_some() {
            continue;
        }
        if !matches!(kind, "revolute" | "continuous") {
            let what = format!("joint {name} is {kind}: a drive for it cannot be guessed");
            return Err(refuse(
                what,
                "revolute joints; write the configuration by hand",
            ));
        }
        let limit = |key: &str| {
            let limit = has("limit").and_then(|limit| limit.attribute(key)?.parse::<f64>().ok());
            limit.filter(|x| *x > 0.0 && x.is_finite()).ok_or_else(|| {
                let what = format!("joint {name} has no limit {key}");
                refuse(what, "a number above 0")
            })
        };
        joints.push(Joint {
            name: name.to_owned(),
            effort: limit("effort")?,
            velocity: limit("velocity")?,
        });
    }
    if joints.is_empty() {
        return Err(refuse(
            "no joint that a drive moves".to_owned(),
            "one joint or more",
        ));
    }
    Ok(joints)
}
