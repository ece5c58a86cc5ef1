//! Underdetermined sets of sensors and contacts are refused with the names of links and sensors,
//! shown on one leg.

use dynamics::{Base, ImuMotion, Model, Se3};
use nalgebra::Vector3;
use robot_state::Wrench;
use whole_body::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, LastingErrors,
    MotionSource, Place, Residual, Weighting, WholeBody, WholeBodyInput, WholeBodyParameters,
};

/// hip -j1- thigh -j2- shank -(sensor)- ankle, and a toe -j3- on the ankle.
fn leg() -> Model {
    let link = |name: &str| {
        format!(
            "<link name='{name}'><inertial><mass value='1'/><inertia ixx='0.1' iyy='0.1' izz='0.1' \
             ixy='0' ixz='0' iyz='0'/></inertial></link>"
        )
    };
    let joint = |name: &str, kind: &str, parent: &str, child: &str| {
        format!(
            "<joint name='{name}' type='{kind}'><origin xyz='0.1 0 -0.3'/><parent link='{parent}'/>\
             <child link='{child}'/><axis xyz='0 1 0'/><limit lower='-9' upper='9' velocity='9' \
             effort='9'/></joint>"
        )
    };
    let text: String = ["hip", "thigh", "shank", "ankle", "toe"]
        .iter()
        .map(|l| link(l))
        .collect();
    let text = text
        + &joint("j1", "revolute", "hip", "thigh")
        + &joint("j2", "revolute", "thigh", "shank")
        + &joint("sensor", "fixed", "shank", "ankle")
        + &joint("j3", "revolute", "ankle", "toe");
    let text = format!("<robot name='leg'>{text}</robot>");
    Model::from_urdf(&text, "leg.urdf", Base::Floating).unwrap()
}

fn contact(link: &str, kind: ContactKind) -> ContactParameters {
    ContactParameters {
        link: link.into(),
        point: Vector3::zeros(),
        kind,
    }
}

fn sensor(name: &str, cut: &str) -> FtSensorParameters {
    FtSensorParameters {
        name: name.into(),
        cut: cut.into(),
        frame: Place::link(cut),
        sigma_force: 0.3,
        sigma_torque: 0.02,
        lasting: LastingErrors::default(),
    }
}

fn parameters(contacts: &[ContactParameters]) -> WholeBodyParameters {
    WholeBodyParameters {
        joints: ["j1", "j2", "j3"].map(Into::into).to_vec(),
        sigma_ddq: vec![0.0; 3],
        ft_sensors: vec![sensor("ankle_ft", "ankle")],
        source: MotionSource::Imu(ImuParameters {
            frame: Place::link("hip"),
            sigma_accelerometer: 0.05,
            lasting_accelerometer: 0.0,
            sigma_angular_acceleration: 0.0,
        }),
        hypotheses: vec![Hypothesis {
            name: String::new(),
            contacts: contacts.to_vec(),
        }],
        weighting: Weighting::Unit,
        residual: Residual::Stays,
        sigma_model: 0.0,
    }
}

const FULL: ContactKind = ContactKind::FullWrench;
const FORCE: ContactKind = ContactKind::PureForce;

fn good() -> Vec<ContactParameters> {
    vec![contact("hip", FULL), contact("ankle", FULL)]
}

fn refused(parameters: &WholeBodyParameters, expected: &[&str]) {
    let message = WholeBody::new(&leg(), parameters).unwrap_err().to_string();
    for part in expected {
        assert!(message.contains(part), "{message}\nlacks {part}");
    }
}

#[test]
fn contacts_that_do_not_follow() {
    assert!(WholeBody::new(&leg(), &parameters(&good())).is_ok());
    let with = |extra: &[ContactParameters]| parameters(&[&good(), extra].concat());
    let beyond = "the part beyond F/T sensor `ankle_ft` (links `ankle`, `toe`)";
    let root =
        "the part with the root, before F/T sensor `ankle_ft` (links `hip`, `thigh`, `shank`)";
    let two_full = [
        "9 unknowns",
        "full wrench on link `ankle`",
        "at most 6",
        beyond,
    ];
    refused(&with(&[contact("toe", FORCE)]), &two_full);
    refused(&parameters(&good()[..1]), &["no contact", beyond, "`none`"]);
    refused(&parameters(&good()[1..]), &["no contact", root]);
    refused(&parameters(&[]), &["no contact"]);
    refused(&with(&[contact("moon", FORCE)]), &["link `moon`"]);
    refused(&with(&[contact("ankle", FULL)]), &["listed twice"]);
    let nothing = contact("toe", ContactKind::Nothing);
    refused(&with(&[nothing]), &["one or the other", beyond]);
    let two_forces = [
        contact("hip", FULL),
        contact("ankle", FORCE),
        contact("toe", FORCE),
    ];
    let expected = [
        "of 6 unknowns only 5",
        "force on link `ankle`, the pure force on link `toe`",
        beyond,
    ];
    refused(&parameters(&two_forces), &expected);
    let zero = contact("toe", ContactKind::KnownDirection(Vector3::zeros()));
    refused(
        &parameters(&[good()[0].clone(), zero]),
        &["direction", "toe"],
    );
    let mut nowhere = contact("toe", FORCE);
    nowhere.point.x = f64::NAN;
    refused(
        &parameters(&[good()[0].clone(), nowhere]),
        &["point", "toe"],
    );
}

#[test]
fn sensors_joints_and_sources_that_do_not_follow() {
    let change = |change: &dyn Fn(&mut WholeBodyParameters)| {
        let mut p = parameters(&good());
        change(&mut p);
        p
    };
    type Edit<'a> = &'a dyn Fn(&mut WholeBodyParameters);
    let cases: [(Edit, &str); 13] = [
        (
            &|p| p.ft_sensors.push(sensor("ankle_ft", "toe")),
            "F/T sensor `ankle_ft` is named twice",
        ),
        (
            &|p| p.ft_sensors.push(sensor("other", "ankle")),
            "`ankle_ft` and `other` cut the tree at the same place, just before link `ankle`",
        ),
        (
            &|p| p.ft_sensors[0] = sensor("s", "hip"),
            "F/T sensor `s` is on the root link",
        ),
        (
            &|p| p.ft_sensors[0] = sensor("s", "moon"),
            "F/T sensor `s`: link `moon` is not in",
        ),
        (
            &|p| p.ft_sensors[0].frame = Place::link("moon"),
            "F/T sensor `ankle_ft`: link `moon`",
        ),
        (
            &|p| p.ft_sensors[0].sigma_force = -1.0,
            "standard deviation of F/T sensor `ankle_ft`",
        ),
        (
            &|p| p.ft_sensors[0].frame.placement.translation.y = f64::INFINITY,
            "finite",
        ),
        (&|p| p.joints[0] = "elbow".into(), "joint `elbow` is not in"),
        (&|p| p.joints[0] = "j2".into(), "listed exactly once"),
        (&|p| drop(p.joints.pop()), "listed exactly once"),
        (&|p| p.hypotheses.clear(), "at least one set of contacts"),
        (
            &|p| p.hypotheses.push(p.hypotheses[0].clone()),
            "is named twice",
        ),
        (
            &|p| {
                p.source = MotionSource::Fixed {
                    link: "moon".into(),
                    gravity: Vector3::zeros(),
                };
            },
            "fixed base: link `moon`",
        ),
    ];
    for (edit, expected) in cases {
        refused(&change(edit), &[expected]);
    }
    let stand = change(&|p| {
        p.source = MotionSource::Fixed {
            link: "thigh".into(),
            gravity: Vector3::new(0.0, 0.0, -9.8),
        };
        p.hypotheses[0].contacts[0] = contact("hip", ContactKind::Nothing);
    });
    refused(&stand, &["held by a stand", "the part with the root"]);
}

/// Forces of known direction may depend on one another at one pose and not at others.
#[test]
fn a_singular_pose_is_flagged() {
    let z = ContactKind::KnownDirection(Vector3::z());
    let p = parameters(&[
        contact("hip", FULL),
        contact("ankle", z),
        contact(
            "toe",
            ContactKind::KnownDirection(Vector3::new(0.1, 0.0, -0.3)),
        ),
        // Through the same line once the toe is straight: along it from the ankle.
        contact(
            "ankle",
            ContactKind::KnownDirection(Vector3::new(0.1, 0.0, -0.3)),
        ),
    ]);
    let mut whole_body = WholeBody::new(&leg(), &p).unwrap();
    let mut update = |q3: f64| {
        let input = WholeBodyInput {
            q: &[0.1, 0.2, q3],
            dq: &[0.0; 3],
            ddq: &[0.0; 3],
            ft: &[Wrench::default()],
            imu: ImuMotion {
                angular_velocity: Vector3::zeros(),
                angular_acceleration: Vector3::zeros(),
                proper_acceleration: Vector3::z() * 9.8,
            },
        };
        let estimate = whole_body.update(&input);
        (
            estimate.valid,
            estimate.parts[1].rank,
            estimate.parts[1].unknowns,
        )
    };
    assert_eq!(update(0.0), (false, 2, 3));
    assert_eq!(update(0.5), (true, 3, 3));
}

/// Without expected errors there are no weights by them; a fallback would be silent.
#[test]
fn weights_without_expected_errors_are_refused() {
    let contacts = [contact("hip", FULL), contact("ankle", FORCE)];
    let mut p = parameters(&contacts);
    p.weighting = Weighting::Expected;
    assert!(WholeBody::new(&leg(), &p).is_ok());
    // Forces alone leave three directions of the wrench without an error.
    p.ft_sensors[0].sigma_torque = 0.0;
    let MotionSource::Imu(imu) = &mut p.source else {
        unreachable!()
    };
    imu.sigma_accelerometer = 0.0;
    refused(&p, &["weights `expected`", "`ankle_ft`", "weights `unit`"]);
    // As many unknowns as equations: weights change nothing.
    let full = parameters(&good());
    p.hypotheses = full.hypotheses;
    assert!(WholeBody::new(&leg(), &p).is_ok());
}

/// Finite signals whose effect overflows.
#[test]
fn results_that_overflow_are_not_valid() {
    let mut whole_body = WholeBody::new(&leg(), &parameters(&good())).unwrap();
    let mut update = |rate: f64| {
        let input = WholeBodyInput {
            q: &[0.1; 3],
            dq: &[rate; 3],
            ddq: &[0.0; 3],
            ft: &[Wrench::default()],
            imu: ImuMotion {
                angular_velocity: Vector3::zeros(),
                angular_acceleration: Vector3::zeros(),
                proper_acceleration: Vector3::z() * 9.8,
            },
        };
        whole_body.update(&input).clone()
    };
    let good = update(1.0);
    assert!(good.valid);
    let bad = update(1e200);
    assert!(!bad.valid);
    assert_eq!((&bad.tau, &bad.parts), (&good.tau, &good.parts));
}

/// A sensor's readings may be in a frame before the cut, and its cut right behind a moving joint.
#[test]
fn the_frame_need_not_be_where_the_cut_is() {
    let contacts = [contact("hip", FULL), contact("toe", FULL)];
    let mut at_cut = parameters(&contacts);
    at_cut.ft_sensors[0] = sensor("s", "toe");
    let mut elsewhere = at_cut.clone();
    elsewhere.ft_sensors[0].frame = Place {
        link: "shank".into(),
        placement: Se3::from_xyz_rpy([0.1, 0.2, 0.3], [0.4, 0.5, 0.6]),
    };
    let q3 = 0.7f64;
    // The toe's frame in the shank's, by hand.
    let ankle = Se3::from_xyz_rpy([0.1, 0.0, -0.3], [0.0; 3]);
    let toe = ankle.compose(&Se3::from_xyz_rpy([0.1, 0.0, -0.3], [0.0, q3, 0.0]));
    let f = dynamics::Force::from_array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let in_shank = toe.act_force(f);
    let in_frame = elsewhere.ft_sensors[0]
        .frame
        .placement
        .inverse_act_force(in_shank);
    let evaluate = |p: &WholeBodyParameters, f: dynamics::Force| {
        let input = WholeBodyInput {
            q: &[0.1, 0.2, q3],
            dq: &[0.3, -0.4, 0.5],
            ddq: &[1.0, 2.0, 3.0],
            ft: &[Wrench {
                force: f.linear.into(),
                torque: f.angular.into(),
            }],
            imu: ImuMotion {
                angular_velocity: Vector3::new(0.1, 0.2, 0.3),
                angular_acceleration: Vector3::new(1.0, 2.0, -1.0),
                proper_acceleration: Vector3::new(1.0, 2.0, 9.0),
            },
        };
        let mut whole_body = WholeBody::new(&leg(), p).unwrap();
        whole_body.update(&input).clone()
    };
    let (a, b) = (evaluate(&at_cut, f), evaluate(&elsewhere, in_frame));
    for (x, y) in a.tau.iter().zip(&b.tau) {
        assert!((x - y).abs() < 1e-12);
    }
    // The joint just before the cut has nothing but the sensor: its axis is y.
    assert!((a.tau[2] + 5.0).abs() < 1e-12, "{:?}", a.tau);
}
