//! Loads from wrenches and torques, judged on arms whose true load is known: joint torques by the
//! recursive Newton-Euler algorithm of a model that has the load, wrenches from the same by a sensor
//! in place of a fixed joint.

use dynamics::{Base, Data, Inertia, Model, Motion, forward_kinematics_acceleration, rnea};
use identification::load::motion::{Cut, Moving, Source, rigid_with};
use identification::load::{Channel, Knowledge, Load, Sample, checks, identify};
use nalgebra::{Matrix3, Rotation3, Vector3};
use test_support::Random;

/// A wrist of three joints on an arm's end that hangs from an inclined wall; a hand beyond a sensor.
fn urdf(mass: f64, centre: [f64; 3]) -> String {
    let link = |name: &str, mass: f64, [x, y, z]: [f64; 3]| {
        format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"{x} {y} {z}\"/><mass value=\"{mass}\"/>\
             <inertia ixx=\"0.004\" iyy=\"0.005\" izz=\"0.003\" ixy=\"0.0004\" ixz=\"0\" iyz=\"0\"/></inertial></link>"
        )
    };
    let joint = |name: &str, kind: &str, parent: &str, child: &str, xyz: &str, axis: &str| {
        format!(
            "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
             <origin xyz=\"{xyz}\" rpy=\"0.1 -0.2 0.3\"/><axis xyz=\"{axis}\"/>\
             <limit lower=\"-3\" upper=\"3\" effort=\"50\" velocity=\"5\"/></joint>"
        )
    };
    [
        "<robot name=\"wrist\"><link name=\"wall\"/>".to_owned(),
        link("a", 1.0, [0.0, 0.0, 0.1]),
        link("b", 0.8, [0.05, 0.0, 0.0]),
        link("c", 0.5, [0.0, 0.02, 0.03]),
        "<link name=\"sensor\"/>".to_owned(),
        link("hand", mass, centre),
        joint("one", "revolute", "wall", "a", "0 0 0.2", "0 0 1"),
        joint("two", "revolute", "a", "b", "0 0 0.25", "0 1 0"),
        joint("three", "revolute", "b", "c", "0.2 0 0", "1 0 0"),
        joint("mount", "fixed", "c", "sensor", "0 0 0.05", "0 0 1"),
        joint("grip", "fixed", "sensor", "hand", "0 0 0.03", "0 0 1"),
        "</robot>".to_owned(),
    ]
    .concat()
}

const GRAVITY_AXES: [f64; 3] = [1.0, -2.0, -9.5];

fn model(mass: f64, centre: [f64; 3]) -> Model {
    let mut model = Model::from_urdf(&urdf(mass, centre), "wrist.urdf", Base::Fixed).unwrap();
    model.set_gravity(GRAVITY_AXES.into());
    model
}

/// Angles, velocities, accelerations at a time; `swing`, rad.
fn motion(t: f64, swing: f64) -> [Vec<f64>; 3] {
    let rates = [0.31, 0.47, 0.73];
    let each = |f: &dyn Fn(f64, f64) -> f64| rates.iter().map(|w| swing * f(*w, w * t)).collect();
    [
        each(&|_, x| x.sin()),
        each(&|w, x| w * x.cos()),
        each(&|w, x| -w * w * x.sin()),
    ]
}

/// Twist of a body and its acceleration less gravity, in its axes.
fn proper(model: &Model, data: &mut Data, motion: &[Vec<f64>; 3], body: usize) -> (Motion, Motion) {
    let [q, dq, ddq] = motion;
    forward_kinematics_acceleration(model, data, q, dq, ddq);
    let up = data.placements()[body].rotation.tr_mul(&-model.gravity());
    let a = data.accelerations()[body] + Motion::new(up, Vector3::zeros());
    (data.velocities()[body], a)
}

struct Sensor {
    offset: [f64; 6],
    /// Rotation vector of its axes against its frame.
    turned: [f64; 3],
    noise: [f64; 2],
}

/// Samples of a sensor on the arm with another hand than `believed` has; every 20 ms.
fn wrenches(
    believed: &Model,
    truth: &Model,
    sensor: &Sensor,
    swing: f64,
    seconds: f64,
) -> Vec<Sample> {
    let frame = believed.frame_index("sensor").unwrap();
    let hand = believed.frame_index("hand").unwrap();
    let cut = Cut::before_link(believed, frame);
    let root = believed.frame_index("wall").unwrap();
    let gravity = Vector3::from(GRAVITY_AXES);
    let source = Source::Still {
        frame: root,
        gravity,
    };
    let (mut moving, mut data) = (Moving::new(believed, source), Data::new(truth));
    let mut random = Random::new(3);
    let rotation = Rotation3::new(Vector3::from(sensor.turned));
    (0..(50.0 * seconds) as usize)
        .map(|k| {
            let [q, dq, ddq] = motion(0.02 * k as f64, swing);
            moving.update(&q, &dq, &ddq, None);
            let mut sample = Sample {
                up: moving.up(hand),
                ..Sample::default()
            };
            cut.predict(&moving, Some(hand), &mut sample);
            // The true wrench, by the bodies' motions of the other model: c's body carries c, sensor, hand.
            let body = truth.frames()[frame].body;
            let (v, a) = proper(truth, &mut data, &[q, dq, ddq], body);
            let held = &truth.frames()[hand];
            let wrench = held.inertia.transformed(&held.placement).wrench(v, a);
            let in_sensor = truth.frames()[frame].placement.inverse_act_force(wrench);
            let w = [in_sensor.linear, in_sensor.angular].map(|x| rotation * x);
            let all = w
                .iter()
                .flat_map(|x| x.iter().copied())
                .zip(sensor.offset)
                .enumerate();
            sample.measured = all
                .map(|(c, (x, offset))| x + offset + sensor.noise[c / 3] * random.normal())
                .collect();
            sample.common = vec![0.0; 6];
            sample
        })
        .collect()
}

fn knowledge(model: &Model) -> Knowledge {
    let hand = model.frame_index("hand").unwrap();
    let channels = ["fx", "fy", "fz", "tx", "ty", "tz"].iter().enumerate();
    Knowledge {
        channels: channels
            .map(|(k, name)| Channel {
                name: (*name).to_owned(),
                unit: if k < 3 { "N" } else { "N·m" },
                sigma: if k < 3 { 0.1 } else { 0.01 },
                offset_sigma: if k < 3 { 20.0 } else { 2.0 },
            })
            .collect(),
        inertia: model.frames()[hand].inertia,
        mass_sigma: 0.2,
        centre_sigma: 0.03,
        sensor: true,
        angle_sigma: 0.03,
    }
}

const TRUE_CENTRE: [f64; 3] = [0.02, -0.015, 0.06];
const SENSOR: Sensor = Sensor {
    offset: [7.0, -4.0, 2.5, 0.3, -0.2, 0.1],
    turned: [0.012, -0.02, 0.008],
    noise: [0.1, 0.01],
};

fn assert_covered(load: &Load, mass: f64) {
    let near = |name: &str, value: &identification::drive::Value, truth: f64, most: f64| {
        let error = value.value - truth;
        assert!(value.determined, "{name}: {load:?}");
        assert!(
            error.abs() < 4.0 * value.sigma + 1e-9,
            "{name}: {value:?}, true {truth}"
        );
        assert!(
            value.sigma < most && error.abs() < most,
            "{name}: {value:?}, true {truth}"
        );
    };
    near("mass", &load.mass, mass, 0.01);
    for (k, (value, truth)) in load.centre.iter().zip(TRUE_CENTRE).enumerate() {
        near(["cx", "cy", "cz"][k], value, truth, 0.003);
    }
}

#[test]
fn offset_mass_centre_and_misalignment_are_found_together() {
    let (believed, truth) = (model(1.0, [0.0, 0.0, 0.05]), model(1.13, TRUE_CENTRE));
    let samples = wrenches(&believed, &truth, &SENSOR, 1.2, 90.0);
    checks::wiring(&samples, Some(1.0), 0.3).unwrap();
    let load = identify(&knowledge(&believed), &samples, 90.0).unwrap();
    assert_covered(&load, 1.13);
    for (c, (value, truth)) in load.offset.iter().zip(SENSOR.offset).enumerate() {
        let most = if c < 3 { 0.1 } else { 0.01 };
        assert!(
            (value.value - truth).abs() < most,
            "{c}: {value:?}, true {truth}"
        );
    }
    for (value, truth) in load.angle.iter().zip(SENSOR.turned) {
        assert!(
            (value.value - truth).abs() < 0.003,
            "{value:?}, true {truth}"
        );
    }
    assert!(load.helps() && load.turned > 1.5, "{load:?}");
    // The residual held out is the noise; tared alone much more.
    let (_, [before, tared, found]) = load.rms[0];
    assert!(
        found < 0.11 && tared > 3.0 * found && before > tared,
        "{:?}",
        load.rms
    );
}

#[test]
fn without_a_turn_the_offset_is_found_and_the_mass_named() {
    let (believed, truth) = (model(1.0, [0.0, 0.0, 0.05]), model(1.0, [0.0, 0.0, 0.05]));
    let still = Sensor {
        turned: [0.0; 3],
        ..SENSOR
    };
    let samples = wrenches(&believed, &truth, &still, 0.002, 30.0);
    let load = identify(&knowledge(&believed), &samples, 30.0).unwrap();
    assert!(
        load.undetermined.iter().any(|name| name == "mass"),
        "{load:?}"
    );
    assert!((load.mass.value - 1.0).abs() < 1e-3, "{:?}", load.mass);
    for (c, (value, truth)) in load.offset.iter().zip(SENSOR.offset).enumerate() {
        let most = if c < 3 { 0.1 } else { 0.01 };
        assert!(
            (value.value - truth).abs() < most,
            "{c}: {value:?}, true {truth}"
        );
    }
}

#[test]
fn what_something_touched_for_a_while_does_not_count_and_most_of_it_is_refused() {
    let (believed, truth) = (model(1.0, [0.0, 0.0, 0.05]), model(1.13, TRUE_CENTRE));
    let mut samples = wrenches(&believed, &truth, &SENSOR, 1.2, 90.0);
    let count = samples.len();
    for sample in &mut samples[count / 3..count / 3 + count / 12] {
        sample.measured[0] += 15.0;
        sample.measured[4] += 2.0;
    }
    let load = identify(&knowledge(&believed), &samples, 90.0).unwrap();
    assert_covered(&load, 1.13);
    assert!(load.left_out > 0.08, "{}", load.left_out);
    let mut random = Random::new(8);
    for sample in &mut samples {
        let push = random.symmetric();
        if push > 0.2 {
            sample.measured.iter_mut().for_each(|x| *x += 60.0 * push);
        }
    }
    let refusal = checks::wiring(&samples, Some(1.0), 0.3).unwrap_err();
    assert!(
        refusal.to_string().contains("do not follow the weight"),
        "{refusal}"
    );
}

#[test]
fn wrong_wiring_is_named() {
    let hand = model(1.0, TRUE_CENTRE);
    let samples = wrenches(&hand, &hand, &SENSOR, 1.2, 40.0);
    let refusal = |change: &dyn Fn(&mut Vec<f64>)| {
        let mut samples = samples.clone();
        samples.iter_mut().for_each(|s| change(&mut s.measured));
        checks::wiring(&samples, Some(1.0), 0.3)
            .map_or_else(|e| e.to_string(), |()| "accepted".to_owned())
    };
    let text = refusal(&|m| m.swap(0, 1));
    assert!(text.contains("are y, x, z"), "{text}");
    let text = refusal(&|m| m[..3].iter_mut().for_each(|x| *x = -*x));
    assert!(text.contains("are -x, -y, -z"), "{text}");
    let text = refusal(&|m| m.rotate_left(3));
    assert!(text.contains("force"), "{text}");
    let text = refusal(&|m| m.iter_mut().for_each(|x| *x /= 9.80665));
    assert!(text.contains("kgf"), "{text}");
    let text = refusal(&|m| m.iter_mut().for_each(|x| *x *= 1e3));
    assert!(text.contains("mN"), "{text}");
    let mut random = Random::new(1);
    let noise: Vec<f64> = (0..6).map(|_| random.normal()).collect();
    assert!(
        refusal(&|m| m.iter_mut().zip(&noise).for_each(|(x, n)| *x = *n)).contains("do not follow")
    );
    // The centre of mass is further away than a robot is long.
    let text = refusal(&|m| m[3..].iter_mut().for_each(|x| *x *= 1e3));
    assert!(text.contains("N·mm"), "{text}");
}

#[test]
fn a_payload_is_found_from_joint_torques_with_offsets_by_an_empty_run() {
    let (believed, truth) = (model(1.0, TRUE_CENTRE), model(1.0, TRUE_CENTRE));
    let hand = believed.frame_index("hand").unwrap();
    let payload = Inertia::from_central(
        2.2,
        Vector3::new(0.05, 0.01, 0.09),
        0.004 * Matrix3::identity(),
    );
    let root = believed.frame_index("wall").unwrap();
    let gravity = Vector3::from(GRAVITY_AXES);
    let mut moving = Moving::new(
        &believed,
        Source::Still {
            frame: root,
            gravity,
        },
    );
    let mut data = Data::new(&truth);
    let mut random = Random::new(5);
    let offsets = [0.4, -0.6, 0.2];
    let cuts: Vec<Cut> = (0..3).map(|j| Cut::at_joint(&believed, j)).collect();
    let run = |loaded: bool,
               moving: &mut Moving<'_>,
               data: &mut Data,
               random: &mut Random|
     -> Vec<Sample> {
        (0..3000)
            .map(|k| {
                let [q, dq, ddq] = motion(0.02 * f64::from(k), 1.0);
                moving.update(&q, &dq, &ddq, None);
                let mut sample = Sample {
                    up: moving.up(hand),
                    ..Sample::default()
                };
                for cut in &cuts {
                    cut.predict(moving, loaded.then_some(hand), &mut sample);
                }
                let torques = rnea(&truth, data, &q, &dq, &ddq, None).to_vec();
                // The payload's part by its power: S^T of its wrench, by differences of placements.
                let extra = if loaded {
                    payload_torques(&truth, &payload, &q, &dq, &ddq)
                } else {
                    [0.0; 3]
                };
                sample.measured = (0..3)
                    .map(|j| torques[j] + extra[j] + offsets[j] + 0.02 * random.normal())
                    .collect();
                sample.common = vec![0.0; 3];
                sample
            })
            .collect()
    };
    let mut samples = run(true, &mut moving, &mut data, &mut random);
    samples.extend(run(false, &mut moving, &mut data, &mut random));
    let channels = ["one", "two", "three"].map(|name| Channel {
        name: name.to_owned(),
        unit: "N·m",
        sigma: 0.05,
        offset_sigma: 2.0,
    });
    let known = Knowledge {
        channels: channels.to_vec(),
        inertia: Inertia::zero(),
        mass_sigma: 2.0,
        centre_sigma: 0.2,
        sensor: false,
        angle_sigma: 0.0,
    };
    let load = identify(&known, &samples, 120.0).unwrap();
    assert!((load.mass.value - 2.2).abs() < 0.02, "{:?}", load.mass);
    for (value, truth) in load.centre.iter().zip([0.05, 0.01, 0.09]) {
        assert!((value.value - truth).abs() < 0.003, "{value:?} {truth}");
    }
    for (value, truth) in load.offset.iter().zip(offsets) {
        assert!((value.value - truth).abs() < 0.02, "{value:?} {truth}");
    }
}

/// Torques that a payload on the hand adds: those of the arm with the heavier hand less its own.
fn payload_torques(arm: &Model, payload: &Inertia, q: &[f64], dq: &[f64], ddq: &[f64]) -> [f64; 3] {
    let mut data = Data::new(arm);
    let hand = &arm.frames()[arm.frame_index("hand").unwrap()];
    let all = [q, dq, ddq].map(<[f64]>::to_vec);
    let (v, a) = proper(arm, &mut data, &all, hand.body);
    let mut wrench = payload.transformed(&hand.placement).wrench(v, a);
    let mut torques = [0.0; 3];
    let mut body = hand.body;
    while let Some(parent) = arm.parent(body) {
        let b = &arm.bodies()[body];
        torques[b.joint] = b.along_axis(wrench);
        wrench = b.placement_at(q[b.joint]).act_force(wrench);
        body = parent;
        if body == 0 {
            break;
        }
    }
    torques
}

#[test]
fn an_imu_on_a_moving_link_gives_the_same_as_a_base_that_stands() {
    let robot = model(1.0, TRUE_CENTRE);
    let (root, carrier) = (
        robot.frame_index("wall").unwrap(),
        robot.frame_index("b").unwrap(),
    );
    let gravity = Vector3::from(GRAVITY_AXES);
    let mut still = Moving::new(
        &robot,
        Source::Still {
            frame: root,
            gravity,
        },
    );
    let mut carried = Moving::new(&robot, Source::Imu { frame: carrier });
    let cut = Cut::before_link(&robot, robot.frame_index("sensor").unwrap());
    let mut data = Data::new(&robot);
    for k in 0..20 {
        let [q, dq, ddq] = motion(0.3 * f64::from(k), 1.0);
        still.update(&q, &dq, &ddq, None);
        rnea(&robot, &mut data, &q, &dq, &ddq, None);
        let frame = &robot.frames()[carrier];
        let all = [q.clone(), dq.clone(), ddq.clone()];
        let (v, a) = proper(&robot, &mut data, &all, frame.body);
        let [v, a] = [v, a].map(|m| frame.placement.inverse_act_motion(m));
        let imu = dynamics::ImuMotion {
            angular_velocity: v.angular,
            angular_acceleration: a.angular,
            proper_acceleration: a.linear + v.angular.cross(&v.linear),
        };
        carried.update(&q, &dq, &ddq, Some(&imu));
        let [mut one, mut other] = [Sample::default(), Sample::default()];
        cut.predict(&still, None, &mut one);
        cut.predict(&carried, None, &mut other);
        for (a, b) in one.modelled.iter().zip(&other.modelled) {
            assert!((a - b).abs() < 1e-9, "{one:?} {other:?}");
        }
    }
    assert_eq!(
        rigid_with(&robot, robot.frame_index("sensor").unwrap()).len(),
        2
    );
}
