//! `torquectl dynamics` as a whole process: a robot known by heart, and every kind of bad input.

use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A cart of 2 kg on a rail along x; on it a pendulum of 3 kg at 0.5 m that turns about y, with no
/// inertia of its own; on the rail a counterweight of 1 kg that mimics the cart, the other way.
const URDF: &str = r#"<robot name="cart">
<link name="rail"/>
<link name="cart"><inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
<link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="3"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
<link name="weight"><inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="3"/></joint>
<joint name="hinge" type="continuous"><parent link="cart"/><child link="bob"/><axis xyz="0 1 0"/></joint>
<joint name="counter" type="prismatic"><parent link="rail"/><child link="weight"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="3"/><mimic joint="slide" multiplier="-1"/></joint>
</robot>"#;

fn dynamics(test: &str, cases: &str, options: &[&str]) -> Output {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("dynamics-{test}"));
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("cart.urdf"), URDF).unwrap();
    fs::write(folder.join("cases.json"), cases).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
    command.args(["dynamics", "--urdf", "cart.urdf"]);
    command.args(options).arg("cases.json");
    command.current_dir(folder).output().unwrap()
}

fn answer(test: &str, cases: &Value, options: &[&str]) -> Value {
    let output = dynamics(test, &cases.to_string(), options);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn near(value: &Value, expected: &[f64]) {
    let numbers: Vec<f64> = serde_json::from_value(value.clone()).unwrap();
    assert_eq!(numbers.len(), expected.len(), "{value}");
    for (x, y) in numbers.iter().zip(expected) {
        assert!((x - y).abs() < 1e-12, "{numbers:?} is not {expected:?}");
    }
}

/// Lagrange's equations of the cart by hand, the joints in another order than the model's.
#[test]
fn the_cart_in_the_order_of_the_file() {
    let (q, dq, ddq): (f64, f64, f64) = (0.4, 1.5, -2.0);
    let (m, l, g, a) = (3.0, 0.5, 9.81, 0.7);
    let cases = json!({
        "joints": ["slide", "hinge"],
        "cases": [{"q": [0.2, q], "dq": [0.3, dq], "ddq": [a, ddq]}, {"q": [0.0, 0.0]}]
    });
    let answer = answer("order", &cases, &[]);
    assert_eq!(answer["joints"], json!(["slide", "hinge"]));
    let case = &answer["cases"][0];
    // The bob is at x = -l sin q, z = -l cos q from the cart.
    let coupling = -m * l * q.cos();
    near(&case["M"][0], &[2.0 + 1.0 + m, coupling]);
    near(&case["M"][1], &[coupling, m * l * l]);
    let nle = [m * l * q.sin() * dq * dq, m * g * l * q.sin()];
    near(&case["nle"], &nle);
    near(&case["g"], &[0.0, nle[1]]);
    let tau = [
        6.0 * a + coupling * ddq + nle[0],
        coupling * a + m * l * l * ddq + nle[1],
    ];
    near(&case["tau"], &tau);
    near(&case["ddq_of_tau"], &[a, ddq]);
    let x = (2.0 * 0.2 - 0.2 + m * (0.2 - l * q.sin())) / 6.0;
    near(&case["com"], &[x, 0.0, -m * l * q.cos() / 6.0]);
    near(&answer["cases"][1]["tau"], &[0.0, 0.0]);
    let keys: Vec<&String> = case.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["M", "com", "ddq_of_tau", "g", "nle", "tau"]);
    assert_eq!(answer.as_object().unwrap().len(), 2);
}

#[test]
fn a_mimic_joint_that_is_named_is_independent() {
    let cases = json!({
        "joints": ["counter", "hinge", "slide"],
        "cases": [{"q": [0.0, 0.0, 0.0], "ddq": [1.0, 0.0, 0.0]}]
    });
    near(
        &answer("mimic", &cases, &[])["cases"][0]["tau"],
        &[1.0, 0.0, 0.0],
    );
}

/// Free fall: the base's six components first; its spatial acceleration is `dv/dt` in base axes.
#[test]
fn a_floating_base_comes_first() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // Turned by 90 degrees about x: down is -y of the base.
    let base = json!({
        "p": [1, 2, 3], "quat_xyzw": [half, 0, 0, half], "v": [0, 0, 0, 0, 0, 0], "a": [0, -9.81, 0, 0, 0, 0]
    });
    let cases = json!({
        "joints": ["slide", "hinge"],
        "cases": [{"q": [0.1, 0.2], "base": base}, {"q": [0.0, 0.0]}]
    });
    let answer = answer("floating", &cases, &["--floating"]);
    let case = &answer["cases"][0];
    near(&case["tau"], &[0.0; 8]);
    near(
        &case["ddq_of_tau"],
        &[0.0, -9.81, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    assert_eq!(case["M"].as_array().unwrap().len(), 8);
    // Without "base" it is at the origin, at rest: the weight must be carried.
    near(
        &answer["cases"][1]["tau"],
        &[0.0, 0.0, 6.0 * 9.81, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
}

/// Cases, and what the message must contain beside the file's name.
const BAD: &[(&str, &[&str], &str)] = &[
    ("{", &[], "line 1 column 1"),
    ("{}", &[], "missing field `cases`"),
    (r#"{"cases":[{}]}"#, &[], "cases[0]: missing field `q`"),
    (r#"{"cases":[{"q":[0,NaN]}]}"#, &[], "cases[0].q[1]: "),
    (
        r#"{"cases":[{"q":[0,1e999]}]}"#,
        &[],
        "cases[0].q[1]: number out of range",
    ),
    (
        r#"{"cases":[{"q":[0,null]}]}"#,
        &[],
        "cases[0].q[1]: invalid type: null",
    ),
    (
        r#"{"cases":[{"q":[0,"1"]}]}"#,
        &[],
        "cases[0].q[1]: invalid type: string",
    ),
    (
        r#"{"cases":[{"q":[0,0]},{"q":[0]}]}"#,
        &[],
        "cases[1].q: 1 numbers; allowed: 2",
    ),
    (
        r#"{"cases":[{"q":[0,0],"dq":[0,0,0]}]}"#,
        &[],
        "cases[0].dq: 3 numbers; allowed: 2",
    ),
    (
        r#"{"cases":[{"q":[0,0],"ddq":[]}]}"#,
        &[],
        "cases[0].ddq: 0 numbers",
    ),
    (
        r#"{"cases":[{"q":[0,0],"qd":[0,0]}]}"#,
        &[],
        "unknown field `qd`",
    ),
    (
        r#"{"cases":[{"q":[0,0],"dq":[0,1e200]}]}"#,
        &[],
        "cases[0].q, dq, ddq, base, f_ext: too large",
    ),
    (
        r#"{"joints":["slide"],"cases":[]}"#,
        &[],
        "\"hinge\" is missing",
    ),
    (
        r#"{"joints":["slide","hinge","elbow"],"cases":[]}"#,
        &[],
        "\"elbow\" is no moving joint",
    ),
    (
        r#"{"joints":["slide","hinge","slide"],"cases":[]}"#,
        &[],
        "\"slide\" is named twice",
    ),
    (
        r#"{"frames":["hand"],"cases":[]}"#,
        &[],
        "frames: no link \"hand\"",
    ),
    (
        r#"{"armature":{"elbow":1},"cases":[]}"#,
        &[],
        "armature: \"elbow\" is no moving joint",
    ),
    (
        r#"{"armature":{"slide":-1},"cases":[]}"#,
        &[],
        "armature.slide: -1; allowed: a number >= 0",
    ),
    (
        r#"{"cases":[{"q":[0,0],"f_ext":{"hand":[0,0,0,0,0,0]}}]}"#,
        &[],
        "cases[0].f_ext: no link \"hand\"",
    ),
    (
        r#"{"cases":[{"q":[0,0],"f_ext":{"bob":[0,0,0]}}]}"#,
        &[],
        "cases[0].f_ext.bob: invalid length 3",
    ),
    (
        r#"{"cases":[{"q":[0,0],"base":{"p":[0,0,1],"quat_xyzw":[0,0,0,1]}}]}"#,
        &[],
        "cases[0].base: the root link is fixed to the world's origin; allowed: no base, or --floating",
    ),
    (
        r#"{"cases":[{"q":[0,0],"base":{"p":[0,0,1],"quat_xyzw":[0,0,1,1]}}]}"#,
        &["--floating"],
        "cases[0].base.quat_xyzw: length 1.41",
    ),
    (
        r#"{"cases":[{"q":[0,0],"base":{"p":[0,0,1],"quat_xyzw":[0,0,0,0]}}]}"#,
        &["--floating"],
        "cases[0].base.quat_xyzw: length 0; allowed: 1",
    ),
    (
        r#"{"cases":[{"q":[0,0],"base":{"p":[0,0,1]}}]}"#,
        &["--floating"],
        "cases[0].base: missing field `quat_xyzw`",
    ),
    (
        r#"{"cases":[{"q":[0,0],"base":{"p":[0,0],"quat_xyzw":[0,0,0,1]}}]}"#,
        &["--floating"],
        "cases[0].base.p: invalid length 2",
    ),
    (r#"{"cases":[]} x"#, &[], "trailing characters"),
];

#[test]
fn bad_input_is_refused_by_file_and_key() {
    for (cases, options, reason) in BAD {
        let output = dynamics("bad", cases, options);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{cases}: {message}");
        assert!(output.stdout.is_empty(), "{cases}");
        let place = "cases.json: ";
        assert!(message.starts_with(place), "{cases}: {message}");
        assert!(message.contains(reason), "{cases}: {message}");
    }
}

#[test]
fn missing_files_are_named() {
    let output = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["dynamics", "--urdf", "nobody.urdf", "nothing.json"])
        .output()
        .unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(message.contains("nobody.urdf: "), "{message}");
}
