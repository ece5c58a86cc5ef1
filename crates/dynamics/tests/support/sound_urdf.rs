//! A sound URDF, of which tests replace a line.

/// A robot of two links and a joint, one element a line.
pub(crate) const LINES: [&str; 12] = [
    r#"<robot name="r">"#,
    r#"<link name="a"><inertial>"#,
    r#"<origin xyz="0 0 0.1" rpy="0 0 0"/>"#,
    r#"<mass value="1"/>"#,
    r#"<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#,
    r#"<visual><geometry/></visual></link>"#,
    r#"<link name="b"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>"#,
    r#"<joint name="j" type="revolute"><origin xyz="0 0 1"/>"#,
    r#"<parent link="a"/><child link="b"/>"#,
    r#"<axis xyz="0 0 1"/>"#,
    r#"<limit lower="-1" upper="1" effort="1" velocity="1"/>"#,
    r#"</joint></robot>"#,
];
