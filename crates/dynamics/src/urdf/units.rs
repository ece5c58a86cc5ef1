//! Numbers that look like another unit than the URDF's (m, kg, rad): usable, but worth a warning.

use super::problem_at;
use super::text::Lines;
use nalgebra::{Matrix3, Vector3};
use problem::Problem;
use std::f64::consts::{PI, TAU};

/// Lengths within a link that no robot has, m: the largest links of machines for digging are about as long.
const LONGEST: f64 = 10.0;
/// Angles that nobody writes for a rotation, rad: more than a turn.
const LARGEST_ANGLE: f64 = 1.01 * TAU;
/// Limits of a joint that nobody builds, rad: more than eight turns from zero.
const LARGEST_LIMIT: f64 = 8.0 * TAU;

/// Masses that small placeholders of moments do not make suspicious, kg.
const HEAVY: f64 = 20.0;
/// Density that no matter has, kg/m³: the densest, osmium, has 22,590.
const DENSEST: f64 = 1e5;

/// Warns of a link's mass that lies or spreads far from its frame, and of an orientation that looks like degrees.
pub(super) fn of_link(link: &urdf_rs::Link, lines: &Lines, warnings: &mut Vec<Problem>) {
    let inertial = &link.inertial;
    let (name, mass) = (&link.name, inertial.mass.value);
    let centre = Vector3::from(*inertial.origin.xyz).norm();
    if centre > LONGEST {
        let reason = format!(
            "link \"{name}\": its centre of mass is {centre} m from its frame; lengths are in m"
        );
        warnings.push(problem_at(lines.of("inertial"), reason, ""));
    }
    let i = &inertial.inertia;
    let largest = Matrix3::new(
        i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz,
    )
    .symmetric_eigenvalues()
    .max();
    let radius = (largest / mass).sqrt();
    if mass > 0.0 && radius > LONGEST {
        let reason = format!(
            "link \"{name}\": {largest} kg m^2 of {mass} kg are those of a body with a radius of gyration of \
             {radius:.0} m; moments are in kg m^2"
        );
        warnings.push(problem_at(lines.of("inertia"), reason, ""));
    }
    of_density(link, lines, warnings);
    of_rotation(
        &format!("link \"{name}\""),
        *inertial.origin.rpy,
        lines.of("inertial"),
        warnings,
    );
}

/// Warns of a mass that moments this small belong to no matter of: grams in place of kilograms. Of all bodies of one
/// density a ball has the least trace of the inertia, `6/5 m r²`.
fn of_density(link: &urdf_rs::Link, lines: &Lines, warnings: &mut Vec<Problem>) {
    let (mass, i) = (link.inertial.mass.value, &link.inertial.inertia);
    let trace = i.ixx + i.iyy + i.izz;
    // A point, or a mistake that is reported elsewhere.
    if mass < HEAVY || trace <= 0.0 {
        return;
    }
    let radius = (trace / (1.2 * mass)).sqrt();
    let density = mass / (4.0 / 3.0 * PI * radius.powi(3));
    if density > DENSEST {
        let reason = format!(
            "link \"{}\": {mass} kg with moments that add up to {trace} kg m^2 are denser than any metal; masses are in kg",
            link.name
        );
        warnings.push(problem_at(lines.of("mass"), reason, ""));
    }
}

/// Warns of a joint's placement and limits that look like degrees or mm.
pub(super) fn of_joint(joint: &urdf_rs::Joint, lines: &Lines, warnings: &mut Vec<Problem>) {
    let whose = format!("joint \"{}\"", joint.name);
    let way = Vector3::from(*joint.origin.xyz).norm();
    if way > LONGEST {
        let reason = format!("{whose}: it is {way} m from its parent's frame; lengths are in m");
        warnings.push(problem_at(lines.of("origin"), reason, ""));
    }
    of_rotation(&whose, *joint.origin.rpy, lines.of("origin"), warnings);
    let turns = matches!(joint.joint_type, urdf_rs::JointType::Revolute);
    let furthest = joint.limit.lower.abs().max(joint.limit.upper.abs());
    if turns && furthest > LARGEST_LIMIT {
        let reason = format!("{whose}: a limit of {furthest} rad; angles are in rad");
        warnings.push(problem_at(lines.of("limit"), reason, ""));
    }
}

fn of_rotation(whose: &str, rpy: [f64; 3], line: usize, warnings: &mut Vec<Problem>) {
    if rpy.iter().any(|angle| angle.abs() > LARGEST_ANGLE) {
        let reason = format!("{whose}: rpy {rpy:?} turns more than once; angles are in rad");
        warnings.push(problem_at(line, reason, ""));
    }
}
