//! URDFs as people and other programs write them: read as they are meant, or refused with their line.

#[path = "support/sound_urdf.rs"]
mod sound_urdf;

use dynamics::{Base, Model};
use problem::Problem;
use sound_urdf::LINES;

fn with(line: usize, replacement: &str) -> String {
    let mut lines = LINES;
    lines[line - 1] = replacement;
    lines.join("\n")
}

fn read(text: &str) -> Result<Model, String> {
    Model::from_urdf(text, "r.urdf", Base::Fixed).map_err(|e| e.to_string())
}

#[test]
fn text_that_other_parsers_take_is_read() {
    let sound = LINES.join("\n");
    let model = read(&sound).unwrap();
    assert!(model.warnings().is_empty());
    for text in [
        format!("\n <?xml version=\"1.0\"?>\n{sound}"),
        format!("<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n<!-- höhe -->{sound}"),
        format!("<!-- a -- b -->\n<!-- c --->{sound}"),
        format!("<!DOCTYPE robot>\n{sound}"),
        sound.replace('\n', "\r\n"),
        sound.replace("<robot", "<robot xmlns=\"http://www.ros.org\""),
        sound.replace('"', "'"),
        with(
            6,
            "<!-- -- --><visual><![CDATA[<!-- -- -->]]></visual></link>",
        ),
        with(
            6,
            r#"</link><gazebo reference="a"><mass value="5"/><![CDATA[ <mass/> ]]></gazebo>"#,
        ),
        with(
            6,
            r#"</link><sensor name="s"><parent link="a"/><origin xyz="0 0 1"/></sensor>"#,
        ),
        with(
            8,
            r#"<joint name="f" type="fixed"><parent link="b"/><child link="c"/><axis xyz="0 0 0"/><limit/></joint><link name="c"/><joint name="j" type="revolute"><origin xyz="0 0 1"/>"#,
        ),
        with(10, r#"<axis xyz="0 0 2"/>"#),
        with(3, "<origin xyz=' +0. .0\t1e-1 ' rpy='0 -0 0'/>"),
    ] {
        let read = read(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(read.joints(), model.joints(), "{text}");
        assert_eq!(read.bodies(), model.bodies(), "{text}");
        assert!(read.warnings().is_empty(), "{text}");
    }
    // Lines stay where they are.
    let faulty = format!(
        "\n<?xml version=\"1.0\"?>\n<!-- -- -->\n{}",
        with(4, "<mass/>")
    );
    assert!(read(&faulty).unwrap_err().starts_with("r.urdf:7: "));
}

#[test]
fn bounds_that_are_left_out_are_zero() {
    for (limit, range) in [
        (r#"<limit upper="2" effort="1" velocity="1"/>"#, (0.0, 2.0)),
        (
            r#"<limit lower="-2" effort="1" velocity="1"/>"#,
            (-2.0, 0.0),
        ),
        (r#"<limit effort="1" velocity="1"/>"#, (0.0, 0.0)),
    ] {
        let model = read(&with(11, limit)).unwrap();
        let limits = &model.joints()[0].limits;
        assert_eq!((limits.lower, limits.upper), range, "{limit}");
    }
}

#[test]
fn doubtful_input_is_a_warning() {
    for (line, replacement, said) in [
        (
            8,
            r#"<joint name="j" type="continuous">"#,
            "lower -1 and upper 1 are no limits of a continuous joint",
        ),
        (
            4,
            r#"<mass value="0"/>"#,
            "moments of inertia with a mass of 0 kg",
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" effort="0" velocity="1"/>"#,
            "effort 0 allows none",
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" velocity="1"/>"#,
            "its <limit> has no effort: none is assumed",
        ),
        (
            11,
            r#"<limit effort="1" velocity="1"/>"#,
            "has no lower and upper: both are 0",
        ),
        (
            7,
            r#"<link name="b"><origin xyz="0 0 0" rpy="0 -0 0"/></link>"#,
            "<origin> within <link> is not read",
        ),
        (
            6,
            r#"</link><x:link name="c"><inertial><mass value="5"/></inertial></x:link>"#,
            "<x:link> within <robot> is not read",
        ),
        (6, "</link> ;", "the text \";\" within <robot> is not read"),
        (
            6,
            r#"<x:inertial><mass value="3"/></x:inertial></link>"#,
            "<x:inertial> within <link> is not read",
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" effort="1" velocity="1" foo="2"/>"#,
            "foo=\"2\"> is not read",
        ),
        (
            11,
            r#"<limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics D="1" damping="0.003" mu_viscous="16"/>"#,
            "mu_viscous=\"16\"> is not read",
        ),
    ] {
        let model = read(&with(line, replacement)).expect(replacement);
        let warnings: String = model.warnings().iter().map(Problem::to_string).collect();
        assert!(warnings.contains(said), "{replacement}: {warnings}");
    }
}

/// Line to replace, its replacement, line and part of the refusal.
const BROKEN: &[(usize, &str, usize, &str)] = &[
    (
        6,
        r#"</link><payload parent="a" mass="5"/>"#,
        6,
        "<payload> within <robot> is not read, with the masses",
    ),
    (
        7,
        r#"<link name="b" mass="5"/>"#,
        7,
        "<link mass=\"5\"> is not read; allowed: <mass> within <inertial>",
    ),
    (
        6,
        r#"<visual><inertial><mass value="3"/></inertial></visual></link>"#,
        6,
        "<visual> within <link> is not read, with the masses",
    ),
    (
        6,
        r#"<collision><mass value="3"/></collision></link>"#,
        6,
        "<collision> within <link> is not read, with the masses",
    ),
    (
        3,
        "<origin>0 0 1</origin>",
        3,
        "the text \"0 0 1\" within <origin> is not read; allowed: attributes: xyz, rpy",
    ),
    (
        3,
        "<origin><xyz>0 0 1</xyz></origin>",
        3,
        "<xyz> within <origin> is not read; allowed: xyz, rpy",
    ),
    (
        4,
        "<mass>5</mass>",
        4,
        "the text \"5\" within <mass> is not read; allowed: attributes: value",
    ),
    (
        5,
        "<inertia><ixx>1</ixx></inertia></inertial>",
        5,
        "<ixx> within <inertia> is not read",
    ),
    (
        3,
        "<pose>0 0 1 0 0 0</pose>",
        3,
        "<pose> within <inertial> is not read; allowed: <origin>",
    ),
    (
        11,
        "<limit>-1 1</limit>",
        11,
        "the text \"-1 1\" within <limit>",
    ),
    (
        11,
        r#"<limit min="-1" max="1" effort="1" velocity="1"/>"#,
        11,
        "min=\"-1\"> is not read; allowed: lower, upper",
    ),
    (
        11,
        r#"<limit lower="-1" upper="1" effort="1" vel="1"/>"#,
        11,
        "vel=\"1\"> is not read",
    ),
    (
        11,
        r#"<limit lower="1" effort="1" velocity="1"/>"#,
        11,
        "lower 1 above upper 0",
    ),
    (
        8,
        r#"<joint name="j" type="revolute" axis="0 0 1">"#,
        8,
        "allowed: <axis> within <joint>",
    ),
    (
        8,
        r#"<joint name="j" type="revolute" xyz="0 0 1">"#,
        8,
        "allowed: <origin xyz=",
    ),
    (
        8,
        r#"<joint name="j" type="revolute" lower="0">"#,
        8,
        "allowed: <limit lower=",
    ),
    (
        7,
        r#"<link name="b"><origin xyz="0 0 1"/></link>"#,
        7,
        "<origin> within <link> is not read; allowed: <origin> within <inertial>",
    ),
    (
        6,
        r#"</link><limit lower="1"/>"#,
        6,
        "<limit> within <robot> is not read; allowed: <limit> within <joint>",
    ),
    (
        11,
        r#"<limit lower="-1" upper="1" effort="1" velocity="1"><axis xyz="1 0 0"/></limit>"#,
        11,
        "<axis> within <limit> is not read",
    ),
    (
        6,
        r#"<joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint></link>"#,
        6,
        "<joint> within <link> is not read",
    ),
    (
        11,
        r#"<dynamics damping="-1"/>"#,
        11,
        "damping=\"-1\">; allowed: a finite number >= 0",
    ),
    (
        11,
        r#"<dynamics friction="-1"/>"#,
        11,
        "a finite number >= 0",
    ),
    (
        6,
        "</link><transmission><joint name='j'><mechanicalReduction>50</mechanicalReduction></joint></transmission>\n<transmission><joint name='j'><mechanicalReduction>100</mechanicalReduction></joint></transmission>",
        7,
        "joint \"j\" has transmissions with 50 and with 100",
    ),
    (
        6,
        "</link><transmission><joint name='j'><mechanicalReducton>50</mechanicalReducton></joint></transmission>",
        6,
        "<mechanicalReducton> is not read: names are exact; allowed: <mechanicalReduction>",
    ),
    (
        1,
        "<!DOCTYPE robot [<!ENTITY m '5'>]><robot name='r'>",
        1,
        "a document type",
    ),
];

#[test]
fn what_would_change_a_number_is_refused() {
    for (line, replacement, place, said) in BROKEN {
        let error = read(&with(*line, replacement)).expect_err(replacement);
        assert!(
            error.starts_with(&format!("r.urdf:{place}: ")),
            "{replacement}: {error}"
        );
        assert!(error.contains(said), "{replacement}: {error}");
    }
}
