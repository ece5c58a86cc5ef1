//! The plant's own reading of a URDF: links with inertia, revolute, prismatic and fixed joints, mimic
//! joints.
//!
//! Deliberately independent of `dynamics`, so that a comparison reveals a mistake in either.

use crate::random::Random;
use nalgebra::{Matrix3, Rotation3, Vector3};
use problem::Problem;

/// A link and its inertia.
#[derive(Debug, Clone)]
pub struct Link {
    /// Name.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the link's frame, m.
    pub com: Vector3<f64>,
    /// Inertia about the centre of mass in the link's axes, kg·m².
    pub inertia: Matrix3<f64>,
}

/// A joint between two links.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Rotation of the joint's frame in the parent link's.
    pub rotation: Matrix3<f64>,
    /// Origin of the joint's frame in the parent link's, m.
    pub offset: Vector3<f64>,
    /// Unit axis in the joint's frame; `None` for a fixed joint.
    pub axis: Option<Vector3<f64>>,
    /// The child moves along the axis, not about it.
    pub slides: bool,
    /// The joint that this one follows, with multiplier and offset.
    pub mimic: Option<(String, f64, f64)>,
}

/// Links and joints of a robot as written in its URDF.
#[derive(Debug, Clone)]
pub struct Urdf {
    /// Links in the file's order.
    pub links: Vec<Link>,
    /// Joints in the file's order.
    pub joints: Vec<Joint>,
    /// Index of the root link: no joint's child.
    pub root: usize,
}

impl Urdf {
    /// Reads a URDF.
    ///
    /// # Errors
    /// A [`Problem`] with file and line.
    pub fn parse(text: &str, file: &str) -> Result<Self, Problem> {
        let document = roxmltree::Document::parse(text)
            .map_err(|e| problem(e.to_string()).at(file, e.pos().row as usize))?;
        let at = |node: roxmltree::Node, problem: Problem| {
            problem.at(file, document.text_pos_at(node.range().start).row as usize)
        };
        let robot = document.root_element();
        let mut links = Vec::new();
        for node in robot.children().filter(|n| n.has_tag_name("link")) {
            links.push(link(node).map_err(|m| at(node, m))?);
        }
        let mut joints = Vec::new();
        for node in robot.children().filter(|n| n.has_tag_name("joint")) {
            joints.push(joint(node, &links).map_err(|m| at(node, m))?);
        }
        let mut roots = (0..links.len()).filter(|i| joints.iter().all(|j: &Joint| j.child != *i));
        let (Some(root), None) = (roots.next(), roots.next()) else {
            return Err(problem("not exactly one link is the root").at(file, 0));
        };
        Ok(Self {
            links,
            joints,
            root,
        })
    }

    /// Changes masses, centres of mass and inertias at random by up to `fraction` of themselves:
    /// no robot has exactly the parameters of its URDF.
    pub fn perturb(&mut self, fraction: f64, random: &mut Random) {
        for link in &mut self.links {
            let mass = 1.0 + fraction * random.symmetric();
            link.mass *= mass;
            link.inertia *= mass * (1.0 + fraction * random.symmetric());
            link.com = link.com.map(|x| x * (1.0 + fraction * random.symmetric()));
        }
    }
}

fn problem(reason: impl Into<String>) -> Problem {
    Problem::new(reason, "")
}

fn link(node: roxmltree::Node) -> Result<Link, Problem> {
    let name = attribute(node, "name")?.to_owned();
    let mut link = Link {
        name,
        mass: 0.0,
        com: Vector3::zeros(),
        inertia: Matrix3::zeros(),
    };
    let Some(inertial) = child(node, "inertial") else {
        return Ok(link);
    };
    let (rotation, com) = origin(inertial)?;
    let mass = child(inertial, "mass").ok_or_else(|| problem("inertial without mass"))?;
    let inertia = child(inertial, "inertia").ok_or_else(|| problem("inertial without inertia"))?;
    let i = |key| number(attribute(inertia, key)?);
    let (xx, xy, xz) = (i("ixx")?, i("ixy")?, i("ixz")?);
    let (yy, yz, zz) = (i("iyy")?, i("iyz")?, i("izz")?);
    link.mass = number(attribute(mass, "value")?)?;
    link.com = com;
    link.inertia =
        rotation * Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * rotation.transpose();
    Ok(link)
}

fn joint(node: roxmltree::Node, links: &[Link]) -> Result<Joint, Problem> {
    let name = attribute(node, "name")?.to_owned();
    let find = |tag| {
        let element = child(node, tag).ok_or_else(|| problem(format!("joint {name}: no {tag}")))?;
        let link = attribute(element, "link")?;
        let place = links.iter().position(|l| l.name == link);
        place.ok_or_else(|| problem(format!("joint {name}: there is no link {link}")))
    };
    let (parent, child_link) = (find("parent")?, find("child")?);
    let (rotation, offset) = origin(node)?;
    let axis = match attribute(node, "type")? {
        "fixed" => None,
        "revolute" | "continuous" | "prismatic" => {
            let axis = match child(node, "axis") {
                Some(axis) => triple(attribute(axis, "xyz")?)?,
                None => Vector3::x(),
            };
            let unit = axis.try_normalize(1e-9);
            Some(unit.ok_or_else(|| problem(format!("joint {name}: zero axis")))?)
        }
        other => {
            return Err(Problem::new(
                format!("joint {name}: type {other} cannot be simulated"),
                "revolute, continuous, prismatic, fixed",
            ));
        }
    };
    let mimic = child(node, "mimic").map(|mimic| {
        let value = |key, default: f64| mimic.attribute(key).map_or(Ok(default), number);
        let driver = attribute(mimic, "joint")?.to_owned();
        Ok((driver, value("multiplier", 1.0)?, value("offset", 0.0)?))
    });
    Ok(Joint {
        slides: attribute(node, "type")? == "prismatic",
        mimic: mimic.transpose()?.filter(|_| axis.is_some()),
        name,
        parent,
        child: child_link,
        rotation,
        offset,
        axis,
    })
}

fn child<'a>(node: roxmltree::Node<'a, 'a>, tag: &str) -> Option<roxmltree::Node<'a, 'a>> {
    node.children().find(|n| n.has_tag_name(tag))
}

fn attribute<'a>(node: roxmltree::Node<'a, 'a>, name: &str) -> Result<&'a str, Problem> {
    let tag = node.tag_name().name();
    (node.attribute(name)).ok_or_else(|| problem(format!("<{tag}> without attribute {name}")))
}

fn number(text: &str) -> Result<f64, Problem> {
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(problem(format!("{text:?} is not a finite number"))),
    }
}

fn triple(text: &str) -> Result<Vector3<f64>, Problem> {
    let numbers = text
        .split_whitespace()
        .map(number)
        .collect::<Result<Vec<_>, _>>()?;
    match numbers[..] {
        [x, y, z] => Ok(Vector3::new(x, y, z)),
        _ => Err(problem(format!("{text:?} is not three numbers"))),
    }
}

fn origin(node: roxmltree::Node) -> Result<(Matrix3<f64>, Vector3<f64>), Problem> {
    let Some(origin) = child(node, "origin") else {
        return Ok((Matrix3::identity(), Vector3::zeros()));
    };
    let read = |name| origin.attribute(name).map_or(Ok(Vector3::zeros()), triple);
    let (xyz, rpy) = (read("xyz")?, read("rpy")?);
    let rotation = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z);
    Ok((rotation.into_inner(), xyz))
}
