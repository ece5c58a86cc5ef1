//! Is this inertia that of some distribution of mass?

use super::Complaint;
use super::text::Lines;
use crate::spatial::{Inertia, Se3};
use nalgebra::{Matrix3, Vector3};

/// Share of the largest principal moment that rounding in a file may cost.
const ROUNDING: f64 = 1e-6;

/// Inertia of a link in its frame; adds a warning where it is odd but usable.
pub(super) fn of_link(
    link: &urdf_rs::Link,
    lines: &Lines,
    warnings: &mut Vec<String>,
) -> Result<Inertia, Complaint> {
    if !lines.has("inertial") {
        return Ok(Inertia::zero());
    }
    let mass = link.inertial.mass.value;
    if mass < 0.0 {
        let reason = format!(
            "link \"{}\": mass {mass} kg; allowed: a finite number >= 0",
            link.name
        );
        return Err((lines.of("mass"), reason));
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
        return Err((lines.of("inertial"), reason));
    }
    let m = sorted_moments(&tensor);
    if m[0] < -ROUNDING * m[2].abs() || m[0] + m[1] < m[2] * (1.0 - ROUNDING) {
        warnings.push(format!(
            "{}: link \"{}\": principal moments of inertia {:.6e} {:.6e} {:.6e} belong to no distribution of mass (each at most the sum of the others, none negative)",
            lines.of("inertia"), link.name, m[0], m[1], m[2]
        ));
    }
    Ok(inertia)
}

/// Refuses a body whose kinetic energy could be negative: nothing can be built that moves so, and
/// forward dynamics would answer a torque with acceleration the other way.
pub(super) fn check_body(name: &str, inertia: &Inertia) -> Result<(), String> {
    let m = sorted_moments(&inertia.central());
    // Parallel axes subtract large numbers: allow for their rounding too.
    let scale = m[2].abs().max(inertia.rotational.trace() * 1e-6);
    if m[0] >= -ROUNDING * scale {
        return Ok(());
    }
    Err(format!(
        "the body of link \"{name}\" (with what is fixed to it) has the principal moments of inertia {:.6e} {:.6e} {:.6e} kg m^2 about its centre of mass; allowed: none negative",
        m[0], m[1], m[2]
    ))
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
