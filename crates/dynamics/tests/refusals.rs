//! Problems of a URDF are reported with line, reason and allowed values.

#[path = "support/sound_urdf.rs"]
mod sound_urdf;

use dynamics::{Base, Model};
use problem::Problem;
use sound_urdf::LINES;

fn read(lines: &[&str]) -> Result<Model, String> {
    Model::from_urdf(&lines.join("\n"), "r.urdf", Base::Fixed).map_err(|e| e.to_string())
}

#[test]
fn the_sound_robot_is_read() {
    let model = read(&LINES).unwrap();
    assert_eq!((model.nv(), model.frames().len()), (1, 2));
}

/// Line to replace, its replacement, beginning (file and line) and part of the message.
const BAD: &[(usize, &str, &str, &str)] = &[
    (1, "<robt>", "r.urdf:12:", "not XML"),
    (
        4,
        r#"<mass value="-1"/>"#,
        "r.urdf:4:",
        "allowed: a finite number >= 0",
    ),
    (
        4,
        r#"<mass value="NaN"/>"#,
        "r.urdf:4:",
        "allowed: a finite number",
    ),
    (
        4,
        r#"<mass value="1e999"/>"#,
        "r.urdf:4:",
        "allowed: a finite number",
    ),
    (4, r#"<mass/>"#, "r.urdf:4:", "lacks the attribute value"),
    (4, "", "r.urdf:2:", "lacks <mass>"),
    (
        4,
        r#"<mass value="1"/><mass value="2"/>"#,
        "r.urdf:4:",
        "second <mass>",
    ),
    (
        3,
        r#"<origin xyz="0 0 0.1 x"/>"#,
        "r.urdf:3:",
        "3 finite numbers",
    ),
    (3, r#"<origin xyz="0 0"/>"#, "r.urdf:3:", "3 finite numbers"),
    (
        5,
        r#"<inertia ixx="-1" iyy="1" izz="1"/></inertial>"#,
        "r.urdf:5:",
        "allowed: none negative",
    ),
    (
        5,
        r#"<inertia ixx="1" iyy="1" izz="1" ixy="3"/></inertial>"#,
        "r.urdf:5:",
        "allowed: none negative",
    ),
    (
        5,
        r#"<inertia ixx="inf" iyy="1" izz="1"/></inertial>"#,
        "r.urdf:5:",
        "a finite number",
    ),
    (7, r#"<link name="a"/>"#, "r.urdf:7:", "already on line 2"),
    (7, r#"<link name=""/>"#, "r.urdf:7:", "allowed: a name"),
    (
        7,
        r#"<link name="b"/><link name="c"/>"#,
        "r.urdf:7:",
        "both have no parent joint",
    ),
    (
        8,
        r#"<joint name="j" type="ball">"#,
        "r.urdf:8:",
        "allowed: revolute, continuous, prismatic, fixed",
    ),
    (
        8,
        r#"<joint name="j" type="floating">"#,
        "r.urdf:8:",
        "allowed: revolute",
    ),
    (
        9,
        r#"<parent link="x"/><child link="b"/>"#,
        "r.urdf:9:",
        "no such link",
    ),
    (
        9,
        r#"<parent link="a"/><child link="x"/>"#,
        "r.urdf:9:",
        "no such link",
    ),
    (9, r#"<parent link="a"/>"#, "r.urdf:8:", "lacks <child>"),
    (
        9,
        r#"<parent link="b"/><child link="b"/>"#,
        "r.urdf:7:",
        "in a loop",
    ),
    (
        10,
        r#"<axis xyz="0 0 0"/>"#,
        "r.urdf:10:",
        "allowed: any vector but zero",
    ),
    (
        10,
        r#"<axis xyz="0 NaN 1"/>"#,
        "r.urdf:10:",
        "3 finite numbers",
    ),
    (
        11,
        r#"<limit lower="1" upper="-1"/>"#,
        "r.urdf:11:",
        "lower <= upper",
    ),
    (
        11,
        r#"<limit lower="NaN" upper="1"/>"#,
        "r.urdf:11:",
        "allowed: a number",
    ),
    (11, r#"<limit effort="-1"/>"#, "r.urdf:11:", "numbers >= 0"),
    (11, r#"<mimic joint="j"/>"#, "r.urdf:11:", "mimics itself"),
    (
        11,
        r#"<mimic joint="nobody"/>"#,
        "r.urdf:11:",
        "joint \"j\" mimics \"nobody\": no such joint",
    ),
    (
        12,
        r#"</joint><joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint></robot>"#,
        "r.urdf:12:",
        "allowed: one (loops are not)",
    ),
    (
        12,
        r#"</joint><joint name="j" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#,
        "r.urdf:12:",
        "already on line 8",
    ),
    (
        12,
        r#"</joint><joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#,
        "r.urdf:2:",
        "every link has a parent joint",
    ),
    (12, r#"</joint>"#, "r.urdf:1:", "not XML"),
];

/// Other people's extensions: prefixes without a declaration, and elements of other vocabularies.
#[test]
fn undeclared_prefixes_are_read_past() {
    let sound = read(&LINES).unwrap();
    let mut lines = LINES;
    lines[5] = r#"<drake:diaphragm/><visual><mesh my:scale="1"/></visual></link><drake:joint/>"#;
    lines[10] = r#"<limit lower="-1" upper="1" effort="1" velocity="1" drake:acceleration="5"/>"#;
    assert_eq!(read(&lines).unwrap(), sound);
    let head = "<?xml version='1.0'?><!-- <robot> --><robot name=\"r\">";
    lines[0] = head;
    assert_eq!(read(&lines).unwrap(), sound);
    // Lines stay where they are.
    lines[9] = r#"<axis xyz="0 0 0"/>"#;
    assert!(read(&lines).unwrap_err().starts_with("r.urdf:10:"));
}

#[test]
fn a_long_axis_has_a_direction() {
    let mut lines = LINES;
    lines[9] = r#"<axis xyz="0 0 1e200"/>"#;
    assert_eq!(read(&lines).unwrap(), read(&LINES).unwrap());
}

#[test]
fn bad_input_is_refused_with_line_and_reason() {
    for (line, replacement, place, reason) in BAD {
        let mut lines = LINES;
        lines[line - 1] = replacement;
        let message = read(&lines).expect_err(replacement);
        assert!(message.starts_with(place), "{replacement}: {message}");
        assert!(message.contains(reason), "{replacement}: {message}");
    }
    assert_eq!(
        read(&["<robot/>"]).unwrap_err(),
        "r.urdf:1: the robot has no <link>; allowed: at least one"
    );
}

#[test]
fn odd_but_usable_input_is_a_warning() {
    let odd = [
        (
            5,
            r#"<inertia ixx="1" iyy="1" izz="2.5"/></inertial>"#,
            "principal moments",
        ),
        (11, "", "no <limit>"),
        (4, r#"<mass value="1200"/>"#, "1200 kg with moments"),
        (7, r#"<link name="b"/>"#, "moves no mass"),
        (
            5,
            r#"<inertia ixx="2000" iyy="2000" izz="2000"/></inertial>"#,
            "radius of gyration",
        ),
        (3, r#"<origin xyz="78.3 0 0"/>"#, "78.3 m from its frame"),
        (3, r#"<origin rpy="90 0 0"/>"#, "angles are in rad"),
        (
            11,
            r#"<limit lower="-180" upper="180" effort="1" velocity="1"/>"#,
            "a limit of 180 rad",
        ),
    ];
    for (line, replacement, reason) in odd {
        let mut lines = LINES;
        lines[line - 1] = replacement;
        let model = read(&lines).expect(replacement);
        let warnings: String = model.warnings().iter().map(Problem::to_string).collect();
        assert!(warnings.contains(reason), "{replacement}: {warnings}");
    }
}

/// What nothing reads must not take a mass or a place with it in silence.
#[test]
fn what_would_be_lost_is_refused() {
    const EXPAND: &str = "allowed: a file that xacro has expanded";
    let lost = [
        (6, r#"</link><xacro:payload parent="a" mass="5"/>"#, EXPAND),
        (
            6,
            r#"</link><xacro:if value="true"><link name="c"/></xacro:if>"#,
            EXPAND,
        ),
        (6, r#"</link><gazebo><xacro:camera/></gazebo>"#, EXPAND),
        (6, r#"<xacro:insert_block name="x"/></link>"#, EXPAND),
        (3, r#"<origin xyz="0 0 ${l}" rpy="0 0 0"/>"#, EXPAND),
        (7, r#"<link name="${prefix}b"/>"#, EXPAND),
        (7, r#"<link name="$(arg prefix)b"/>"#, EXPAND),
        (
            7,
            r#"<link name="b"><Inertial><mass value="5"/></Inertial></link>"#,
            "<Inertial> within <link> is not read",
        ),
        (
            7,
            r#"<link name="b"><intertial><mass value="5"/></intertial></link>"#,
            "allowed: <inertial>",
        ),
        (
            7,
            r#"<link name="b"><body><mass value="5"/></body></link>"#,
            "with the masses and links in it",
        ),
        (6, r#"</link><Link name="c"/>"#, "allowed: <link>"),
        (
            6,
            r#"</link><assembly><link name="c"/></assembly>"#,
            "<assembly> within <robot> is not read",
        ),
        (
            3,
            r#"<origin pos="0 0 0.1" rpy="0 0 0"/>"#,
            "<origin pos=\"0 0 0.1\"> is not read; allowed: xyz, rpy",
        ),
        (3, r#"<Origin xyz="0 0 0.1"/>"#, "allowed: <origin>"),
        (
            10,
            r#"<axis xyz="0 0 1" rpy="0 1 0"/>"#,
            "<axis rpy=\"0 1 0\"> is not read",
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" Effort="1" velocity="1"/>"#,
            "<limit Effort=\"1\"> is not read",
        ),
        (
            11,
            r#"<limits lower="-1" upper="1" effort="1" velocity="1"/>"#,
            "allowed: <limit>",
        ),
        (11, r#"<dynamic damping="1"/>"#, "allowed: <dynamics>"),
    ];
    for (line, replacement, reason) in lost {
        let mut lines = LINES;
        lines[0] = r#"<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">"#;
        lines[line - 1] = replacement;
        let message = read(&lines).expect_err(replacement);
        assert!(
            message.starts_with(&format!("r.urdf:{line}: ")),
            "{replacement}: {message}"
        );
        assert!(message.contains(reason), "{replacement}: {message}");
    }
}

/// What no dynamics follows from is read past, in silence where it is known.
#[test]
fn extensions_are_read_past() {
    let sound = read(&LINES).unwrap();
    for (line, replacement) in [
        (
            6,
            r#"<visual><geometry><mesh filename="$(find r)/a.dae"/></geometry></visual></link>"#,
        ),
        (
            6,
            r#"</link><gazebo reference="a"><mass value="1"/></gazebo><ros2_control name="x" type="system"/>"#,
        ),
        (
            6,
            r#"</link><mujoco><compiler meshdir="x"/></mujoco><material name="m"/>"#,
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" effort="1" velocity="1" acceleration="3"/><calibration rising="0"/><safety_controller k_velocity="1"/>"#,
        ),
        (
            1,
            r#"<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">"#,
        ),
    ] {
        let mut lines = LINES;
        lines[line - 1] = replacement;
        assert_eq!(read(&lines).expect(replacement), sound, "{replacement}");
    }
    let mut lines = LINES;
    lines[5] = r#"<weather/></link>"#;
    let model = read(&lines).unwrap();
    let warnings: Vec<String> = model.warnings().iter().map(Problem::to_string).collect();
    assert_eq!(warnings[0], "r.urdf:6: <weather> within <link> is not read");
}
