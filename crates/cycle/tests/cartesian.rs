//! Mode Cartesian: a frame led by springs and forces, in front of the simulated leg.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, read};
use dynamics::{Data, Se3, forward_kinematics, frame_placement};
use nalgebra::Vector3;
use robot_config::slots;
use robot_state::{Event, FrameReference, Mode, Reference, RobotState, frame_flags};
use test_support::allocations;

const CARTESIAN: u32 = Mode::Cartesian.number();
/// Knee of the leg.
const KNEE: usize = 3;

/// The leg with more in its simulation.
fn leg(more: &str) -> Bench {
    Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("leg/sim.toml") {
            format!("{text}\n{more}")
        } else {
            text
        })
    })
}

/// The foot is held by something of this stiffness, N/m.
fn clamped(stiffness: f64) -> String {
    format!(
        "[harness]\nlink = \"foot\"\nstiffness_N_per_m = {stiffness}\n\
         damping_Ns_per_m = {}\nstiffness_Nm_per_rad = {}\ndamping_Nms_per_rad = {}\n\
         slack_m = 0\nslack_deg = 0\n",
        stiffness / 300.0,
        stiffness / 120.0,
        stiffness / 40_000.0
    )
}

fn pushed(force: [f64; 3]) -> String {
    format!("[[push]]\nlink = \"foot\"\nstart_s = 3\nduration_s = 8\nforce_N = {force:?}\n")
}

/// A robot that holds and shows the pose of its first frame, and a reference for that pose.
fn shown(mut bench: Bench) -> (Bench, Reference) {
    bench.run(400);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    reference.contact_wrench_given = 0;
    reference.frames[0] = FrameReference {
        orientation: [1.0, 0.0, 0.0, 0.0],
        damping_ratio: 1.0,
        used: 1,
        ..FrameReference::default()
    };
    for _ in 0..20 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    let record = bench.cycle.record();
    let frame = &record.commanded.frames[0];
    assert_eq!(frame.flags, frame_flags::VALID);
    (
        reference.frames[0].position,
        reference.frames[0].orientation,
    ) = (frame.position, frame.orientation);
    for (desired, joint) in reference.joints.iter_mut().zip(&record.measured.joints) {
        desired.q_d = joint.q;
    }
    (bench, reference)
}

/// The bench in mode Cartesian, with these stiffnesses.
fn led(bench: Bench, stiffness: [f64; 6]) -> (Bench, Reference) {
    let (mut bench, mut reference) = shown(bench);
    reference.frames[0].stiffness = stiffness;
    reference.mode = CARTESIAN;
    let mut steps = Steps::default();
    steps.run(&mut bench, &mut reference, 1000);
    steps.assert_small(&bench, "entry");
    (bench, reference)
}

const STIFF: [f64; 6] = [3000.0, 3000.0, 3000.0, 120.0, 120.0, 120.0];

/// Greatest change of each joint's true torque within 5 ms, as a share of its limit.
#[derive(Default)]
struct Steps {
    torques: Vec<Vec<f64>>,
}

impl Steps {
    fn take(&mut self, bench: &Bench) {
        let joints = bench.plant.truth().joints.iter();
        self.torques.push(joints.map(|joint| joint.tau).collect());
    }

    fn run(&mut self, bench: &mut Bench, reference: &mut Reference, cycles: usize) {
        for _ in 0..cycles {
            reference.sequence += 1;
            bench.step(&client_input(reference));
            self.take(bench);
            let record = bench.cycle.record();
            assert_eq!(
                (record.fault, record.mode),
                (0, reference.mode),
                "{:?}",
                Event::from_number(record.commander.cause)
            );
        }
    }

    fn assert_small(&self, bench: &Bench, what: &str) {
        for (j, p) in bench.robot.parameters.joints.iter().enumerate() {
            let step = |rows: &[Vec<f64>]| (rows[5][j] - rows[0][j]).abs() / p.limits.torque;
            let most = self.torques.windows(6).map(step).fold(0.0, f64::max);
            assert!(most < 0.05, "{what}, {}: {:.1} %", p.name, 100.0 * most);
        }
    }
}

/// True placement of the foot.
fn foot(bench: &Bench) -> Se3 {
    let model = &bench.robot.model;
    let mut data = Data::new(model);
    let mut q = vec![0.0; model.nq()];
    for (joint, truth) in (bench.robot.parameters.joints.iter()).zip(&bench.plant.truth().joints) {
        q[joint.model_index] = truth.q;
    }
    forward_kinematics(model, &mut data, &q);
    frame_placement(model, &data, model.frame_index("foot").unwrap())
}

/// True force of the environment on the foot, in the base's axes.
fn force(bench: &Bench) -> Vector3<f64> {
    let external = &bench.plant.truth().external[0];
    foot(bench).rotation * Vector3::from(external.wrench.force)
}

/// Pushed slowly, the foot gives way as far as its springs say, along each axis.
#[test]
fn a_frame_is_as_stiff_as_asked() {
    for (axis, stiffness) in [(0, 3000.0), (1, 1500.0), (2, 4000.0)] {
        let mut push = [0.0; 3];
        push[axis] = 60.0;
        let mut asked = STIFF;
        asked[axis] = stiffness;
        let (mut bench, mut reference) = led(leg(&pushed(push)), asked);
        let mut steps = Steps::default();
        let before = foot(&bench).translation;
        // The push is greatest after 7 s.
        let cycles = ((7.0 - bench.plant.truth().time) * 1e3) as usize;
        steps.run(&mut bench, &mut reference, cycles);
        let (way, felt) = (foot(&bench).translation - before, force(&bench));
        let shown = felt[axis] / way[axis];
        let error = shown / stiffness - 1.0;
        assert!(
            error.abs() < 0.15,
            "axis {axis}: {shown:.0} N/m, {:.0} % off",
            100.0 * error
        );
        steps.assert_small(&bench, "pushed");
    }
}

/// D 5.4: the foot on a floor as stiff as that of the simulated humanoid applies a force that swings about a
/// mean: it overshoots by at most 5 % of the amplitude, and so much is felt along the other axes. Pulling as well,
/// on an object an eighth as stiff, and without mean along the other axes, where the knee's torque passes zero
/// and its gear winds up.
#[test]
fn a_force_is_applied_to_a_stiff_object() {
    for (stiffness, axis, bias, hz) in [
        (6e5, 2, 150.0, 0.5),
        (6e5, 2, 150.0, 1.0),
        (6e5, 2, -100.0, 0.5),
        (6e5, 0, 0.0, 0.25),
        (6e5, 1, 0.0, 0.25),
        (7.5e4, 2, 200.0, 0.5),
        (7.5e4, 2, 150.0, 1.0),
        (7.5e4, 0, 0.0, 0.25),
    ] {
        let amplitude = 100.0;
        let held = leg(&clamped(stiffness));
        let (mut bench, mut reference) = led(held, [0.0, 0.0, 0.0, 100.0, 100.0, 100.0]);
        reference.frames[0].force_axes = 0b111;
        reference.frames[0].force[axis] = bias;
        let mut steps = Steps::default();
        steps.run(&mut bench, &mut reference, 2500);
        let (mut most, mut coupled) = (0.0f64, 0.0f64);
        for k in 0..4000 {
            let phase = std::f64::consts::TAU * hz * f64::from(k) * 1e-3;
            reference.frames[0].force[axis] = bias + amplitude * phase.sin();
            steps.run(&mut bench, &mut reference, 1);
            let felt = force(&bench);
            most = most.max((felt[axis] - bias).abs());
            for other in (0..3).filter(|other| *other != axis) {
                coupled = coupled.max(felt[other].abs());
            }
        }
        let what = format!("{stiffness} N/m, axis {axis}, {hz} Hz");
        let overshoot = most / amplitude - 1.0;
        assert!(overshoot.abs() < 0.05, "{what}: {:.1} %", 100.0 * overshoot);
        let coupled = coupled / amplitude;
        assert!(coupled < 0.05, "{what}: {:.1} % coupled", 100.0 * coupled);
        // Steps, each in one message.
        let mut last = bias;
        for step in [1.0, -1.0, 0.5, 0.0] {
            let wanted = bias + amplitude * step;
            reference.frames[0].force[axis] = wanted;
            let mut beyond = 0.0f64;
            for _ in 0..1000 {
                steps.run(&mut bench, &mut reference, 1);
                beyond = beyond.max((force(&bench)[axis] - wanted) * (wanted - last).signum());
            }
            let end = force(&bench)[axis] - wanted;
            assert!(
                beyond < 0.2 * amplitude,
                "{what} to {wanted}: {beyond:.1} N beyond"
            );
            assert!(
                end.abs() < 0.05 * amplitude,
                "{what} at {wanted}: {end:.1} N off"
            );
            last = wanted;
        }
        steps.assert_small(&bench, "forces");
    }
}

/// A force where nothing is to press on, until the foot meets something after 20 mm: it approaches slowly, meets it
/// without a step, and presses as asked; taken away, it is slow again.
#[test]
fn a_force_approaches_slowly_what_it_presses_on() {
    for (stiffness, wanted, fed_back) in [
        (7.5e4, 120.0, 0b111),
        (2e4, -80.0, 0b111),
        (7.5e4, 200.0, 0b100),
    ] {
        let far = clamped(stiffness).replace("slack_m = 0\n", "slack_m = 0.02\n");
        let (mut bench, mut reference) = led(leg(&far), [0.0, 0.0, 0.0, 100.0, 100.0, 100.0]);
        (reference.frames[0].force_axes, reference.frames[0].force[2]) = (fed_back, wanted);
        let mut steps = Steps::default();
        let (mut fastest, mut beyond, before) = (0.0f64, 0.0f64, foot(&bench).translation.z);
        for _ in 0..5000 {
            steps.run(&mut bench, &mut reference, 1);
            let joints = bench.plant.truth().joints.iter();
            for (joint, p) in joints.zip(&bench.robot.parameters.joints) {
                fastest = fastest.max(joint.dq.abs() / p.limits.velocity);
            }
            beyond = beyond.max(force(&bench).z / wanted - 1.0);
        }
        let what = format!("{wanted} N on {stiffness} N/m");
        let (way, end) = (foot(&bench).translation.z - before, force(&bench).z);
        assert!(way.abs() > 0.018, "{what}: {way} m");
        assert!(fastest < 0.1, "{what}: {:.1} %", 100.0 * fastest);
        assert!((end / wanted - 1.0).abs() < 0.1, "{what}: {end:.1} N");
        assert!(beyond < 0.3, "{what}: {:.0} % beyond", 100.0 * beyond);
        steps.assert_small(&bench, &what);
    }
}

/// A pose that steps is led there: no step of a torque, and no more than the limit of the force.
#[test]
fn a_step_of_the_pose_is_led() {
    let (mut bench, mut reference) = led(leg(""), STIFF);
    let before = foot(&bench).translation;
    let mut steps = Steps::default();
    reference.frames[0].position[2] += 0.08;
    let limit = bench.robot.parameters.joints[KNEE].torque_velocity;
    let mut speed = 0.0f64;
    for _ in 0..4000 {
        steps.run(&mut bench, &mut reference, 1);
        speed = speed.max(bench.plant.truth().joints[KNEE].dq.abs());
    }
    steps.assert_small(&bench, "a step of the pose");
    let way = foot(&bench).translation - before;
    assert!(way.z > 0.07 && way.z < 0.09, "{way}");
    assert!(speed < 1.3 * limit, "{speed:.2} of {limit:.2} rad/s");
    // Without stiffness and back.
    reference.frames[0].stiffness = [0.0; 6];
    steps.run(&mut bench, &mut reference, 500);
    reference.frames[0].stiffness = STIFF;
    steps.run(&mut bench, &mut reference, 1500);
    steps.assert_small(&bench, "stiffness that falls and rises");
}

/// From mode to mode, at rest with a load and in motion.
#[test]
fn modes_follow_each_other_without_a_step() {
    let (mut bench, mut reference) = led(leg(""), STIFF);
    let mut steps = Steps::default();
    reference.frames[0].force[2] = -40.0;
    steps.run(&mut bench, &mut reference, 1500);
    for mode in [Mode::InverseDynamics, Mode::Cartesian, Mode::Hold] {
        let record = bench.cycle.record();
        for (desired, joint) in reference.joints.iter_mut().zip(&record.measured.joints) {
            desired.q_d = joint.q;
        }
        let frame = &record.commanded.frames[0];
        (
            reference.frames[0].position,
            reference.frames[0].orientation,
        ) = (frame.position, frame.orientation);
        reference.mode = mode.number();
        steps.run(&mut bench, &mut reference, 1500);
    }
    steps.assert_small(&bench, "changes of mode");
}

type Change = fn(&mut Reference);

/// A reference that a frame cannot follow, or does not begin with, releases the robot and moves nothing.
#[test]
fn frames_that_cannot_be_led_move_nothing() {
    let changes: [(&str, Change, Event); 14] = [
        (
            "NaN",
            |r| r.frames[0].position[0] = f64::NAN,
            Event::ReferenceNotFinite,
        ),
        (
            "infinite stiffness of a frame that is not used",
            |r| {
                r.frames[3].stiffness[0] = f64::INFINITY;
            },
            Event::ReferenceNotFinite,
        ),
        ("no frame", |r| r.frames[0].used = 0, Event::ReferenceLimit),
        (
            "a frame that there is not",
            |r| r.frames[2].used = 1,
            Event::ReferenceLimit,
        ),
        (
            "far away",
            |r| r.frames[0].position[2] = -9.0,
            Event::ReferenceLimit,
        ),
        (
            "no rotation",
            |r| r.frames[0].orientation = [0.0; 4],
            Event::ReferenceLimit,
        ),
        (
            "stiff",
            |r| r.frames[0].stiffness[1] = 1e5,
            Event::ReferenceLimit,
        ),
        (
            "negative stiffness",
            |r| r.frames[0].stiffness[4] = -1.0,
            Event::ReferenceLimit,
        ),
        (
            "undamped",
            |r| r.frames[0].damping_ratio = 0.0,
            Event::ReferenceLimit,
        ),
        (
            "a great force",
            |r| r.frames[0].force[0] = 1e3,
            Event::ReferenceLimit,
        ),
        (
            "fast",
            |r| r.frames[0].velocity[0] = 9.0,
            Event::ReferenceLimit,
        ),
        (
            "force and stiffness on one axis",
            |r| r.frames[0].force_axes = 1,
            Event::ReferenceLimit,
        ),
        (
            "elsewhere",
            |r| r.frames[0].position[0] += 0.1,
            Event::ReferenceJump,
        ),
        (
            "turned",
            |r| r.frames[0].orientation = [0.0, 1.0, 0.0, 0.0],
            Event::ReferenceJump,
        ),
    ];
    for (what, change, event) in changes {
        let (mut bench, mut reference) = shown(leg(""));
        let mut motion = Motion::of(&bench);
        reference.frames[0].stiffness = STIFF;
        reference.mode = CARTESIAN;
        change(&mut reference);
        for _ in 0..200 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        let record = bench.cycle.record();
        assert!(record.events[event.index()] > 0, "{what}");
        assert_eq!(record.mode, Mode::Hold.number(), "{what}");
        assert_eq!(record.state, RobotState::Holding.number(), "{what}");
        motion.assert_small(what);
    }
}

/// Frames and axes stay those with which the mode began.
#[test]
fn frames_do_not_change_on_the_way() {
    for change in [(|r| r.frames[0].own_axes = 1) as Change, |r| {
        (r.frames[0].used, r.frames[1].used) = (0, 1)
    }] {
        let (mut bench, mut reference) = led(leg(""), STIFF);
        change(&mut reference);
        let mut motion = Motion::of(&bench);
        for _ in 0..300 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
        motion.assert_small("other frames");
    }
}

/// The F/T sensor falls silent while the foot presses: the mode ends, and the leg holds.
#[test]
fn a_sensor_that_fails_ends_the_mode() {
    let (mut bench, mut reference) = led(leg(&clamped(6e5)), [0.0, 0.0, 0.0, 100.0, 100.0, 100.0]);
    reference.frames[0].force[2] = 60.0;
    reference.frames[0].force_axes = 0b111;
    let mut steps = Steps::default();
    steps.run(&mut bench, &mut reference, 1500);
    let mut motion = Motion::of(&bench);
    for _ in 0..500 {
        reference.sequence += 1;
        bench.gather();
        let table = bench.robot.receive.clone();
        bench.drop_answers(|frame| {
            let message = table.classify(frame);
            message.is_some_and(|m| table.slots(m).any(|slot| slot == slots::ft(0, 2)))
        });
        bench.compute(&client_input(&reference));
        motion.take(&bench);
        steps.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!((record.mode, record.fault), (Mode::Hold.number(), 0));
    assert_eq!(record.possible_modes & 1 << CARTESIAN, 0);
    motion.assert_small("a silent sensor");
    steps.assert_small(&bench, "a silent sensor");
}

#[test]
fn leading_a_frame_allocates_nothing() {
    let (mut bench, mut reference) = led(leg(""), STIFF);
    reference.frames[0].stiffness[2] = 0.0;
    reference.frames[0].force_axes = 1 << 2;
    for _ in 0..100 {
        reference.sequence += 1;
        bench.gather();
        bench.tx.clear();
        let at = bench.instants();
        let before = allocations();
        let client = client_input(&reference);
        bench.cycle.step(at, &bench.rx, &client, &mut bench.tx);
        assert_eq!(allocations() - before, 0);
        let mut none = can_codec::Frames::default();
        bench.plant.exchange(&bench.tx, bench.now, &mut none);
    }
    assert_eq!(bench.cycle.record().mode, CARTESIAN);
}
