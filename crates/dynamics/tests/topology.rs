//! Topology of a small robot, by hand.

use dynamics::{Base, Model};

const ARM: &str = r#"<robot name="arm">
<link name="base"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="sensor"/>
<link name="flange"><inertial><origin xyz="0 0 0.5"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="finger"><inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="camera"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 2 0"/><limit lower="-1" upper="1" effort="9" velocity="3"/></joint>
<joint name="mount" type="fixed"><origin xyz="0 0 1"/><parent link="upper"/><child link="sensor"/></joint>
<joint name="bolt" type="fixed"><parent link="sensor"/><child link="flange"/></joint>
<joint name="grip" type="prismatic"><origin xyz="0 0 0.6"/><parent link="flange"/><child link="finger"/><axis xyz="1 0 0"/></joint>
<joint name="bracket" type="fixed"><parent link="upper"/><child link="camera"/></joint>
</robot>"#;

#[test]
fn fixed_joints_lump_links_into_bodies() {
    let model = Model::from_urdf(ARM, "arm.urdf", Base::Fixed).unwrap();
    assert_eq!(
        model.joint_names().collect::<Vec<_>>(),
        ["shoulder", "grip"]
    );
    assert_eq!(model.bodies().len(), 3);
    assert!((model.bodies()[1].inertia.mass - 3.2).abs() < 1e-15);
    assert!((model.total_mass() - 8.3).abs() < 1e-12);

    assert!(model.supports(1, 2) && model.supports(0, 2) && !model.supports(2, 1));
}

#[test]
fn limits_and_warnings_are_kept() {
    let model = Model::from_urdf(ARM, "arm.urdf", Base::Fixed).unwrap();
    let shoulder = model.joint_limits(0).unwrap();
    assert_eq!(
        (shoulder.lower, shoulder.effort, shoulder.velocity),
        (-1.0, 9.0, 3.0)
    );
    assert_eq!(model.joint_limits(1).unwrap().upper, f64::INFINITY);
    assert_eq!(model.joint_limits(2), None);
    assert_eq!(
        model
            .warnings()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>(),
        ["arm.urdf:11: joint \"grip\" has no <limit>: none is assumed"]
    );
}
