//! The robot's distance to itself: capsules about its bodies, from the URDF's collision geometry, for
//! links without it from their visual geometry, or of a given radius along the lines from joint to
//! joint.
//!
//! Boxes and cylinders lie within their capsules; meshes are not read. Bodies that one joint connects
//! are not compared, nor are bodies two joints apart that touch where the motion begins; joints in
//! one place, as those of a hip, count as one. Others that are close there may come no closer.

use crate::motion::{Motion, SPACING_S};
use crate::plan::SelfDistance;
use crate::rigid::Rigid;
use dynamics::{Model, Se3};
use nalgebra::{Rotation3, Vector3};
use problem::Problem;
use robot_config::Robot;
use roxmltree::{Document, Node};

/// Least distance of bodies where the plan gives none, m.
const CLEARANCE: f64 = 0.02;
/// Bodies that are closer than that where the motion begins may come closer by this, m.
const CLOSER: f64 = 2e-3;
/// Points of the motion from one comparison to the next: 20 ms, in which no shipped robot's body gets
/// further than that from both.
const STEP: usize = 5;
/// Joints that are closer than this count as one, m.
const ONE_PLACE: f64 = 0.03;
/// A box is cut along the edges that are longer than this, but for its longest, m.
const THICK: f64 = 0.04;

/// The self-distance of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Distance {
    /// Least distance, m.
    pub least_m: f64,
    /// Allowed distance, m: less than the configured one for bodies that were closer at the start.
    pub allowed_m: f64,
    /// Between these bodies.
    pub between: (String, String),
    /// At this time, s.
    pub time_s: f64,
}

/// The points of a body within `radius` of a line from `a` to `b`, in the body's frame, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Capsule {
    body: usize,
    a: Vector3<f64>,
    b: Vector3<f64>,
    radius: f64,
}

/// The capsules of a robot.
#[derive(Debug, Clone)]
pub(crate) struct Hulls {
    capsules: Vec<Capsule>,
    clearance: f64,
    /// Bodies without a capsule.
    pub(crate) without: Vec<String>,
}

impl Hulls {
    /// From the URDF's text, and where that has no geometry from the plan.
    ///
    /// # Errors
    /// Neither of them has any.
    pub(crate) fn new(
        robot: &Robot,
        urdf: &str,
        given: Option<&SelfDistance>,
    ) -> Result<Self, Problem> {
        let model = &robot.model;
        let mut capsules = of_urdf(model, urdf);
        for body in 0..model.bodies().len() {
            if capsules.iter().any(|capsule| capsule.body == body) {
                continue;
            }
            let name = &model.bodies()[body].name;
            let own = given.and_then(|g| g.radii_m.get(name).copied().or(g.radius_m));
            if let Some(radius) = own {
                capsules.extend(along_links(model, body, radius));
            }
        }
        if capsules.is_empty() {
            return Err(Problem::new(
                "the self-distance cannot be checked: the URDF has no geometry of boxes, cylinders or \
                 spheres, and the plan no radius",
                "[self_distance] radius_m of the robot's links, or --no-self-distance",
            ));
        }
        let has = |body: usize| capsules.iter().any(|capsule| capsule.body == body);
        let bodies = model.bodies().iter().enumerate();
        let without = bodies.filter(|(body, _)| !has(*body));
        Ok(Self {
            without: without.map(|(_, body)| body.name.clone()).collect(),
            clearance: given.map_or(CLEARANCE, |given| given.least_m),
            capsules,
        })
    }

    /// The least distance of a motion over what is allowed, and the bodies that were not compared.
    pub(crate) fn least(
        &self,
        rigid: &mut Rigid<'_>,
        motion: &Motion,
    ) -> (Option<Distance>, Vec<(String, String)>) {
        let model = rigid.model();
        let name = |capsule: &Capsule| model.bodies()[capsule.body].name.clone();
        let mut touching = Vec::new();
        let mut pairs = Vec::new();
        let placed = self.placed(rigid, motion, 0);
        for (i, a) in self.capsules.iter().enumerate() {
            for (j, b) in self.capsules.iter().enumerate().skip(i + 1) {
                let apart = joints_between(model, a.body, b.body);
                if apart < 2 {
                    continue;
                }
                let start = distance(&placed[i], &placed[j]) - a.radius - b.radius;
                if apart == 2 && start < self.clearance {
                    touching.push((name(a), name(b)));
                } else {
                    pairs.push((i, j, self.clearance.min(start - CLOSER)));
                }
            }
        }
        let mut least: Option<(f64, Distance)> = None;
        for index in (0..motion.len()).step_by(STEP) {
            let placed = self.placed(rigid, motion, index);
            for (i, j, allowed) in &pairs {
                let (a, b) = (&self.capsules[*i], &self.capsules[*j]);
                let apart = distance(&placed[*i], &placed[*j]) - a.radius - b.radius;
                // Of pairs that may be closer than the others, what they have more than that.
                let more = apart - allowed;
                if least.as_ref().is_none_or(|(so_far, _)| more < *so_far) {
                    let found = Distance {
                        least_m: apart,
                        allowed_m: *allowed,
                        between: (name(a), name(b)),
                        time_s: index as f64 * SPACING_S,
                    };
                    least = Some((more, found));
                }
            }
        }
        touching.sort();
        touching.dedup();
        (least.map(|(_, distance)| distance), touching)
    }

    /// The ends of all capsules in the world.
    fn placed(&self, rigid: &mut Rigid<'_>, motion: &Motion, index: usize) -> Vec<Line> {
        rigid.set(motion.point(index));
        let places = rigid.places();
        let line = |capsule: &Capsule| {
            let place = &places[capsule.body];
            [place.act_point(capsule.a), place.act_point(capsule.b)]
        };
        self.capsules.iter().map(line).collect()
    }
}

type Line = [Vector3<f64>; 2];

/// Joints on the way from one body to another; those in one place count as one.
fn joints_between(model: &Model, a: usize, b: usize) -> usize {
    let path = |mut body: usize| {
        let mut path = vec![body];
        while body > 0 {
            body = model.bodies()[body].parent;
            path.push(body);
        }
        path.reverse();
        path
    };
    let (a, b) = (path(a), path(b));
    let shared = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    // From the common body outwards; the first joint counts, wherever it is.
    let apart = |body: &&usize| model.bodies()[**body].placement.translation.norm() > ONE_PLACE;
    let count = |path: &[usize]| {
        let own = path.get(shared..).unwrap_or_default();
        let far = own.iter().skip(1).filter(apart).count();
        far + usize::from(!own.is_empty())
    };
    count(&a) + count(&b)
}

/// Least distance of two lines, each between two points (C. Ericson: Real-Time Collision Detection,
/// 5.1.9).
fn distance(first: &Line, second: &Line) -> f64 {
    let (d1, d2) = (first[1] - first[0], second[1] - second[0]);
    let r = first[0] - second[0];
    let (a, e, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    let (c, b) = (d1.dot(&r), d1.dot(&d2));
    let denominator = a * e - b * b;
    let mut s = if denominator > 1e-12 {
        ((b * f - c * e) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut t = if e > 1e-12 { (b * s + f) / e } else { 0.0 };
    if !(0.0..=1.0).contains(&t) || e <= 1e-12 {
        t = t.clamp(0.0, 1.0);
        s = if a > 1e-12 {
            ((b * t - c) / a).clamp(0.0, 1.0)
        } else {
            0.0
        };
    }
    (first[0] + d1 * s - second[0] - d2 * t).norm()
}

/// Capsules from a body's joint to those that it carries; to its centre of mass where it carries none.
fn along_links(model: &Model, body: usize, radius: f64) -> Vec<Capsule> {
    let children = model
        .bodies()
        .iter()
        .skip(1)
        .filter(|child| child.parent == body);
    let mut ends: Vec<Vector3<f64>> = children.map(|child| child.placement.translation).collect();
    if ends.is_empty() {
        let frames = model.frames().iter().filter(|frame| frame.body == body);
        ends.extend(frames.map(|frame| frame.placement.translation));
        ends.push(model.bodies()[body].inertia.center());
    }
    let capsule = |end: Vector3<f64>| Capsule {
        body,
        a: Vector3::zeros(),
        b: end,
        radius,
    };
    ends.into_iter().map(capsule).collect()
}

/// Capsules about the geometry of a URDF; meshes and what is no number are left out.
fn of_urdf(model: &Model, text: &str) -> Vec<Capsule> {
    let Ok(document) = Document::parse(text) else {
        return Vec::new();
    };
    let root = document.root_element();
    let links = root.children().filter(|node| node.has_tag_name("link"));
    let mut capsules = Vec::new();
    for link in links {
        let frame = link
            .attribute("name")
            .and_then(|name| model.frame_index(name));
        let Some(frame) = frame.and_then(|frame| model.frames().get(frame)) else {
            continue;
        };
        let shapes = |tag: &'static str| link.children().filter(move |n| n.has_tag_name(tag));
        let tag = match shapes("collision").next() {
            Some(_) => "collision",
            None => "visual",
        };
        for collision in shapes(tag) {
            let place = frame.placement.compose(&origin(collision));
            let shapes = (collision.children())
                .find(|node| node.has_tag_name("geometry"))
                .and_then(|geometry| geometry.children().find_map(shape));
            let capsule = |(centre, half, radius): (Vector3<f64>, Vector3<f64>, f64)| Capsule {
                body: frame.body,
                a: place.act_point(centre - half),
                b: place.act_point(centre + half),
                radius,
            };
            capsules.extend(shapes.into_iter().flatten().map(capsule));
        }
    }
    capsules
}

/// Centre, half of the axis and radius of each of a shape's capsules.
type Part = (Vector3<f64>, Vector3<f64>, f64);

fn shape(node: Node<'_, '_>) -> Option<Vec<Part>> {
    let number = |name: &str| node.attribute(name)?.trim().parse::<f64>().ok();
    let zero = Vector3::zeros();
    match node.tag_name().name() {
        "sphere" => Some(vec![(zero, zero, number("radius")?)]),
        "cylinder" | "capsule" => {
            let half = 0.5 * number("length")?;
            Some(vec![(
                zero,
                Vector3::new(0.0, 0.0, half),
                number("radius")?,
            )])
        }
        "box" => Some(box_parts(numbers(node.attribute("size")?)?)),
        _ => None,
    }
}

/// A box along its longest edge, in up to four parts; each radius reaches the corners of its part.
fn box_parts(size: Vector3<f64>) -> Vec<Part> {
    let long = size.imax();
    let (u, v) = ((long + 1) % 3, (long + 2) % 3);
    let cuts = |edge: f64| if edge > THICK { 2 } else { 1 };
    let (nu, nv) = (cuts(size[u]), cuts(size[v]));
    let (wu, wv) = (size[u] / nu as f64, size[v] / nv as f64);
    let mut half = Vector3::zeros();
    half[long] = 0.5 * size[long];
    let mut parts = Vec::new();
    for i in 0..nu {
        for k in 0..nv {
            let mut centre = Vector3::zeros();
            centre[u] = wu * (i as f64 + 0.5) - 0.5 * size[u];
            centre[v] = wv * (k as f64 + 0.5) - 0.5 * size[v];
            parts.push((centre, half, 0.5 * wu.hypot(wv)));
        }
    }
    parts
}

fn origin(collision: Node<'_, '_>) -> Se3 {
    let node = collision
        .children()
        .find(|node| node.has_tag_name("origin"));
    let of = |name: &str| {
        let text = node.and_then(|node| node.attribute(name));
        text.and_then(numbers).unwrap_or_else(Vector3::zeros)
    };
    let (xyz, rpy) = (of("xyz"), of("rpy"));
    let rotation = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z);
    Se3::new(rotation.into_inner(), xyz)
}

fn numbers(text: &str) -> Option<Vector3<f64>> {
    let mut numbers = text.split_whitespace().map(str::parse::<f64>);
    let mut next = || numbers.next()?.ok();
    Some(Vector3::new(next()?, next()?, next()?))
}

#[cfg(test)]
mod tests {
    use super::distance;
    use nalgebra::Vector3;
    use test_support::Random;

    /// Beside the least distance of many points on both lines.
    #[test]
    fn lines_are_as_far_apart_as_their_closest_points() {
        let mut random = Random::new(4);
        let mut point = || Vector3::from_fn(|_, _| random.symmetric());
        for case in 0..200 {
            let (mut first, second) = ([point(), point()], [point(), point()]);
            if case % 5 == 0 {
                first[1] = first[0];
            }
            let found = distance(&first, &second);
            let on = |line: &[Vector3<f64>; 2], k: usize| {
                line[0] + (line[1] - line[0]) * (k as f64 / 200.0)
            };
            let mut least = f64::INFINITY;
            for i in 0..=200 {
                for k in 0..=200 {
                    least = least.min((on(&first, i) - on(&second, k)).norm());
                }
            }
            assert!(
                found <= least + 1e-12 && found > least - 0.02,
                "{found} {least}"
            );
        }
    }
}
