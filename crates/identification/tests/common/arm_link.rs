//! A link of an arm that is drawn at random, as URDF text.

/// Names of the joints from the base on.
const JOINTS: [&str; 7] = ["turn", "lift", "elbow", "roll", "bend", "twist", "flange"];

/// Link `k` and the joint that bears it: mass, kg; centre of mass, m; `length`, m, after which the next one follows; axis;
/// greatest torque, N·m.
pub(crate) fn link(
    k: usize,
    mass: f64,
    centre: &[f64],
    (length, axis, effort): (f64, &str, f64),
) -> String {
    let parent = match k {
        0 => "base".to_owned(),
        _ => format!("link{}", k - 1),
    };
    let (thin, long) = (0.0016 * mass, mass * (0.0016 + length * length / 12.0));
    let (ahead, up) = if k == 0 { (0.0, 0.2) } else { (length, 0.0) };
    let (joint, [x, y, z]) = (JOINTS[k], [centre[0], centre[1], centre[2]]);
    format!(
        r#"<link name="link{k}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/><inertia ixx="{thin}" iyy="{long}" izz="{long}" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="link{k}"/><origin xyz="{ahead} 0 {up}"/><axis xyz="{axis}"/><limit effort="{effort}" velocity="3"/></joint>"#
    )
}
