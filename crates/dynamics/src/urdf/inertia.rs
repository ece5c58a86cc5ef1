//! Inertias of links and bodies: refused or warned of where no distribution of mass has them.

use super::problem_at;
use super::text::Lines;
use super::units;
use crate::spatial::{Inertia, Se3};
use nalgebra::{Matrix3, Vector3};
use problem::Problem;

/// Share of the largest principal moment that rounding in a file may cost.
const ROUNDING: f64 = 1e-6;

/// Inertia of a link in its frame; adds a warning where it is odd but usable.
pub(super) fn of_link(
    link: &urdf_rs::Link,
    lines: &Lines,
    warnings: &mut Vec<Problem>,
) -> Result<Inertia, Problem> {
    if !lines.has("inertial") {
        return Ok(Inertia::zero());
    }
    let mass = link.inertial.mass.value;
    if mass < 0.0 {
        let reason = format!("link \"{}\": mass {mass} kg", link.name);
        return Err(problem_at(lines.of("mass"), reason, "a finite number >= 0"));
    }
    let i = &link.inertial.inertia;
    let tensor = Matrix3::new(
        i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz,
    );
    let origin = &link.inertial.origin;
    let placement = Se3::from_xyz_rpy(*origin.xyz, *origin.rpy);
    let inertia = Inertia::from_central(mass, Vector3::zeros(), tensor).transformed(&placement);
    let numbers = inertia.rotational.iter().chain(&inertia.first_moment);
    if !numbers.copied().all(f64::is_finite) {
        let reason = format!("link \"{}\": its inertia overflows", link.name);
        return Err(problem_at(lines.of("inertial"), reason, ""));
    }
    let m = sorted_moments(&tensor);
    if m[0] < -ROUNDING * m[2].abs() || m[0] + m[1] < m[2] * (1.0 - ROUNDING) {
        let reason = format!(
            "link \"{}\": principal moments of inertia {:.6e} {:.6e} {:.6e} belong to no distribution of mass (each at most the sum of the others, none negative)",
            link.name, m[0], m[1], m[2]
        );
        warnings.push(problem_at(lines.of("inertia"), reason, ""));
    }
    if mass == 0.0 && tensor != Matrix3::zeros() {
        let reason = format!(
            "link \"{}\": moments of inertia with a mass of 0 kg",
            link.name
        );
        warnings.push(problem_at(lines.of("mass"), reason, ""));
    }
    units::of_link(link, lines, warnings);
    Ok(inertia)
}

/// Refuses a body whose kinetic energy could be negative: nothing can be built that moves so, and
/// forward dynamics would accelerate it against the torque.
pub(super) fn check_body(name: &str, inertia: &Inertia) -> Result<(), Problem> {
    let m = sorted_moments(&inertia.central());
    // Parallel axes subtract large numbers: allow for their rounding too.
    let scale = m[2].abs().max(inertia.rotational.trace() * 1e-6);
    if m[0] >= -ROUNDING * scale {
        return Ok(());
    }
    let reason = format!(
        "the body of link \"{name}\" (with what is fixed to it) has the principal moments of inertia {:.6e} {:.6e} {:.6e} kg m^2 about its centre of mass",
        m[0], m[1], m[2]
    );
    Err(Problem::new(reason, "none negative"))
}

/// Smallest principal moment about the centre of mass.
pub(super) fn smallest_moment(inertia: &Inertia) -> f64 {
    sorted_moments(&inertia.central())[0]
}

fn sorted_moments(tensor: &Matrix3<f64>) -> [f64; 3] {
    let mut m: [f64; 3] = tensor.symmetric_eigenvalues().into();
    m.sort_by(f64::total_cmp);
    m
}
