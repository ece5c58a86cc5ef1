//! Gear ratios and rotor inertias in the forms in which files have them.

use dynamics::{Base, Data, Model, crba, neutral};

/// A robot of two joints, `j` and `k`, and an extension from line 8 on.
fn read(extension: &str) -> Result<Model, String> {
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"1\"/>\
             <inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial></link>\n"
        )
    };
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            "<joint name=\"{name}\" type=\"continuous\"><parent link=\"{parent}\"/>\
             <child link=\"{child}\"/><axis xyz=\"0 0 1\"/></joint>\n"
        )
    };
    let text = [
        "<robot name=\"r\" xmlns:drake=\"http://drake.mit.edu\">\n\n".to_owned(),
        link("a") + &link("b") + &link("c"),
        joint("j", "a", "b") + &joint("k", "b", "c"),
        format!("{extension}\n</robot>"),
    ];
    Model::from_urdf(&text.concat(), "r.urdf", Base::Fixed).map_err(|e| e.to_string())
}

/// Gear ratios of `j` and `k`.
fn ratios(extension: &str) -> [Option<f64>; 2] {
    let model = read(extension).unwrap();
    assert!(model.warnings().is_empty(), "{extension}");
    [0, 1].map(|i| model.joints()[i].gear_ratio)
}

#[test]
fn none_is_none() {
    assert_eq!(ratios(""), [None, None]);
    let only_names = r#"<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
        <joint name="j"/><actuator name="m"/></transmission>"#;
    assert_eq!(ratios(only_names), [None, None]);
}

#[test]
fn reduction_in_the_actuator() {
    let talos = r#"<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
        <actuator name="m"><mechanicalReduction>160</mechanicalReduction></actuator>
        <joint name="k"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
        </transmission>"#;
    assert_eq!(ratios(talos), [None, Some(160.0)]);
}

#[test]
fn reduction_in_the_transmission() {
    let pr2 = r#"<transmission name="t" type="SimpleTransmission"><actuator name="m"/>
        <joint name="j"/><mechanicalReduction>-79.2380952381</mechanicalReduction></transmission>"#;
    assert_eq!(ratios(pr2), [Some(-79.2380952381), None]);
}

#[test]
fn reduction_in_the_joint_of_ros2_control() {
    let ros2 = r#"<ros2_control name="arm" type="system">
        <hardware><plugin>hardware/System</plugin><param name="gear_ratio">7</param></hardware>
        <joint name="j"><command_interface name="effort"/></joint>
        <joint name="k"><param name="gear_ratio"> 30 </param></joint>
        <transmission name="t"><plugin>transmission_interface/SimpleTransmission</plugin>
          <actuator name="m" role="actuator1"/>
          <joint name="j" role="joint1"><mechanical_reduction>2.5</mechanical_reduction>
            <offset>0.1</offset></joint>
        </transmission></ros2_control>"#;
    assert_eq!(ratios(ros2), [Some(2.5), Some(30.0)]);
}

#[test]
fn two_stages_multiply_and_a_differential_has_one_reduction_a_joint() {
    let stages = r#"<transmission name="t"><joint name="j"><mechanical_reduction>2</mechanical_reduction>
        </joint><actuator name="m"><mechanical_reduction>50</mechanical_reduction></actuator></transmission>"#;
    assert_eq!(ratios(stages), [Some(100.0), None]);
    let differential = r#"<transmission name="t">
        <actuator name="m1"><mechanicalReduction>50</mechanicalReduction></actuator>
        <actuator name="m2"><mechanicalReduction>-50</mechanicalReduction></actuator>
        <joint name="j"><mechanicalReduction>2</mechanicalReduction></joint>
        <joint name="k"/></transmission>"#;
    assert_eq!(ratios(differential), [Some(2.0), None]);
}

#[test]
fn rotors_become_armatures() {
    let rotors = r#"<transmission name="t"><joint name="j"/><actuator name="m">
        <drake:gear_ratio value="100"/><drake:rotor_inertia value="2e-5"/></actuator></transmission>
        <ros2_control name="arm"><joint name="k"><param name="gear_ratio">50</param>
        <param name="rotor_inertia">1e-4</param></joint></ros2_control>"#;
    let mut model = read(rotors).unwrap();
    let rotor = |model: &Model, i: usize| model.joints()[i].rotor_inertia;
    assert_eq!([0, 1].map(|i| rotor(&model, i)), [Some(2e-5), Some(1e-4)]);
    let diagonal = |model: &Model| {
        let mut data = Data::new(model);
        let m = crba(model, &mut data, &neutral(model));
        [m[(0, 0)], m[(1, 1)]]
    };
    // Nothing changes until it is asked for.
    assert_eq!(diagonal(&model), [2.0, 1.0]);
    model.apply_rotor_inertias();
    let with = diagonal(&model);
    assert!((with[0] - 2.2).abs() < 1e-15 && (with[1] - 1.25).abs() < 1e-15);
}

#[test]
fn bad_numbers_are_refused_and_unknown_joints_are_a_warning() {
    let actuator = |inner: &str| {
        format!(
            "<transmission name=\"t\"><joint name=\"j\"/>\n<actuator name=\"m\">{inner}</actuator></transmission>"
        )
    };
    let bad = [
        (
            "<mechanicalReduction>0</mechanicalReduction>",
            "holds \"0\"; allowed: a finite number, not 0",
        ),
        (
            "<mechanicalReduction>fast</mechanicalReduction>",
            "holds \"fast\"",
        ),
        ("<mechanicalReduction/>", "holds \"\""),
        ("<gear_ratio>1e999</gear_ratio>", "holds \"1e999\""),
        (
            "<rotorInertia>-1e-5</rotorInertia>",
            "allowed: a finite number >= 0",
        ),
    ];
    for (inner, reason) in bad {
        let message = read(&actuator(inner)).expect_err(inner);
        assert!(message.starts_with("r.urdf:9: <"), "{message}");
        assert!(message.contains(reason), "{message}");
    }
    let stranger = r#"<transmission name="t"><joint name="x"/><actuator name="m"/></transmission>"#;
    let model = read(stranger).unwrap();
    assert_eq!(
        model
            .warnings()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>(),
        ["r.urdf:8: transmission of an unknown joint \"x\""]
    );
}
