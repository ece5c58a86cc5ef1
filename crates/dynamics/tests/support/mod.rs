//! Random robots as URDF texts.
#![allow(dead_code)]

pub(crate) mod textbook;

use dynamics::{Base, Model, Random};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

/// Size and kinds of a random robot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    pub(crate) links: usize,
    pub(crate) base: Base,
    pub(crate) mimic: bool,
    /// Every link on the one before.
    pub(crate) chain: bool,
    /// Axes parallel or at right angles to each other, and often intersecting or the same.
    pub(crate) aligned: bool,
}

/// Text of a robot: a random tree of all kinds of joints, with realisable inertias.
pub(crate) fn random_urdf(seed: u64, kind: Kind) -> String {
    let mut r = Random::new(seed);
    let mut text = String::from("<robot name=\"random\">\n");
    for i in 0..kind.links {
        link(&mut text, &mut r, i);
    }
    let mut moving: Vec<usize> = Vec::new();
    for i in 1..kind.links {
        let parent = if r.uniform(0.0, 1.0) < 0.5 || kind.chain {
            i - 1
        } else {
            r.uniform(0.0, i as f64) as usize
        };
        let joint_type = match r.uniform(0.0, 10.0) as usize {
            0 | 1 => "fixed",
            2 => "prismatic",
            3 => "continuous",
            _ => "revolute",
        };
        let axis = if r.uniform(0.0, 1.0) < 0.5 || kind.aligned {
            let mut unit = [0.0; 3];
            unit[r.uniform(0.0, 3.0) as usize] = if r.uniform(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
            unit.to_vec()
        } else {
            r.vector(3, 1.0)
        };
        let (mut p, mut o) = (r.vector(3, 0.4), r.vector(3, 3.0));
        if kind.aligned {
            p.iter_mut()
                .filter(|p| p.abs() < 0.25)
                .for_each(|p| *p = 0.0);
            o.iter_mut().for_each(|o| *o = o.round() * FRAC_PI_2);
        }
        let _ = write!(
            text,
            "<joint name=\"j{}\" type=\"{joint_type}\"><parent link=\"l{parent}\"/><child link=\"l{i}\"/>\
             <origin xyz=\"{} {} {}\" rpy=\"{} {} {}\"/><axis xyz=\"{} {} {}\"/>\
             <limit lower=\"-3\" upper=\"3\" effort=\"10\" velocity=\"5\"/>",
            (i * 7919) % 101,
            p[0],
            p[1],
            p[2],
            o[0],
            o[1],
            o[2],
            axis[0],
            axis[1],
            axis[2]
        );
        if joint_type != "fixed" {
            if kind.mimic && !moving.is_empty() && r.uniform(0.0, 1.0) < 0.3 {
                let driver = moving[r.uniform(0.0, moving.len() as f64) as usize];
                let (a, b) = (r.uniform(-2.0, 2.0), r.uniform(-1.0, 1.0));
                let driver = (driver * 7919) % 101;
                let _ = write!(
                    text,
                    "<mimic joint=\"j{driver}\" multiplier=\"{a}\" offset=\"{b}\"/>"
                );
            } else {
                moving.push(i);
            }
        }
        text.push_str("</joint>\n");
    }
    text.push_str("</robot>\n");
    text
}

fn link(text: &mut String, r: &mut Random, i: usize) {
    // Any three non-negative second moments make a realisable inertia.
    let s: Vec<f64> = (0..3).map(|_| r.uniform(0.001, 0.05)).collect();
    let (c, o) = (r.vector(3, 0.2), r.vector(3, 3.0));
    let _ = writeln!(
        text,
        "<link name=\"l{i}\"><inertial><origin xyz=\"{} {} {}\" rpy=\"{} {} {}\"/><mass value=\"{}\"/>\
         <inertia ixx=\"{}\" iyy=\"{}\" izz=\"{}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>",
        c[0],
        c[1],
        c[2],
        o[0],
        o[1],
        o[2],
        r.uniform(0.2, 5.0),
        s[1] + s[2],
        s[0] + s[2],
        s[0] + s[1]
    );
}

/// The robot itself.
pub(crate) fn random_model(seed: u64, kind: Kind) -> Model {
    let text = random_urdf(seed, kind);
    Model::from_urdf(&text, "random.urdf", kind.base).expect("a sound robot")
}

/// A state: q, v, a.
pub(crate) fn random_state(seed: u64, model: &Model) -> [Vec<f64>; 3] {
    let mut r = Random::new(seed.wrapping_add(77));
    let q = r.configuration(model);
    [q, r.vector(model.nv(), 3.0), r.vector(model.nv(), 8.0)]
}

/// Largest difference over the largest of `b` (at least 1).
pub(crate) fn error(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    let worst = a.iter().zip(b).fold(0.0f64, |m, (x, y)| {
        let d = (x - y).abs();
        if d.is_nan() { f64::INFINITY } else { m.max(d) }
    });
    worst / scale
}
