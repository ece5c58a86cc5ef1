//! A cycle and a simulated robot in lock-step, frame by frame.
#![allow(dead_code)]

pub(crate) mod motion;

use can_codec::{Frame, Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, OperatorRequest, Stamp};
use plant::{CanRobot, SimParameters};
use robot_config::Robot;
use robot_config::slots::{self, Source};
use robot_state::{CycleRecord, JointReference, Mode, Reference, TrajectoryPiece};
use std::io;
use std::sync::Mutex;
use test_support::Random;

/// Files of the project; configurations name theirs relative to themselves.
pub(crate) use test_support::read_project_file as read;

/// Of a simulated hrp2-like whose foot stands on the floor, pressed down by the harness.
pub(crate) const FLOOR: &str = "
[ground]
height_m = -0.6485
stiffness_N_per_m = 150000
damping_Ns_per_m = 1000
tangential_stiffness_N_per_m = 150000
tangential_damping_Ns_per_m = 500
friction = 0.7

[[foot]]
link = \"foot\"
corners_m = [[0.14, 0.07, -0.055], [0.14, -0.07, -0.055], [-0.1, 0.07, -0.055], [-0.1, -0.07, -0.055]]
";

/// A robot, and the files that it was read from: path, and text of those that are there.
type Known = (Robot, Vec<(String, Option<String>)>);

/// Reads a robot; one whose files are those of a robot read before is that one, as the choice of its designs takes
/// longer than many a test.
fn robot(path: &str, read: &dyn Fn(&str) -> io::Result<String>) -> Robot {
    static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());
    let is_alike = |(_, files): &&Known| {
        let of_path = files.first().is_some_and(|(first, _)| first == path);
        let mut files = files.iter();
        of_path && files.all(|(path, text)| read(path).ok() == *text)
    };
    let known = KNOWN
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some((robot, _)) = known.iter().find(is_alike) {
        return robot.clone();
    }
    drop(known);
    let files = Mutex::new(Vec::new());
    let remembering = |path: &str| {
        let text = read(path);
        let known = (path.to_owned(), text.as_ref().ok().cloned());
        files.lock().unwrap().push(known);
        text
    };
    let robot = robot_config::load(path, &remembering).unwrap();
    let mut known = KNOWN
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    known.push((robot.clone(), files.into_inner().unwrap()));
    robot
}

/// The cycle, the robot, and the frames between them.
pub(crate) struct Bench {
    pub(crate) robot: Robot,
    pub(crate) cycle: Cycle,
    pub(crate) plant: CanRobot,
    pub(crate) now: u64,
    pub(crate) rx: Frames,
    pub(crate) tx: Frames,
    sync: Frames,
}

impl Bench {
    /// A robot of the project in front of its cycle.
    pub(crate) fn new(name: &str) -> Self {
        Self::reading(name, &read)
    }

    /// A robot of the project whose files are those that `read` gives.
    pub(crate) fn reading(name: &str, read: &dyn Fn(&str) -> io::Result<String>) -> Self {
        let path = format!("config/{name}/robot.toml");
        let robot = robot(&path, read);
        let sim_path = format!("config/{name}/sim.toml");
        let sim = SimParameters::parse(&read(&sim_path).unwrap(), &sim_path).unwrap();
        let urdf = read(&robot.parameters.urdf_path).unwrap();
        let plant = CanRobot::new(&robot, &urdf, &sim).unwrap();
        let mut sync = Frames::default();
        for frame in &robot.sync {
            sync.push(*frame);
        }
        Self {
            cycle: Cycle::new(&robot).unwrap(),
            robot,
            plant,
            now: 1_000_000_000,
            rx: Frames::new(MAX_FRAMES),
            tx: Frames::new(MAX_FRAMES),
            sync,
        }
    }

    /// SYNC and the robot's answers, in `rx`.
    pub(crate) fn gather(&mut self) {
        self.now += (1e9 * self.robot.parameters.timing.sample_period).round() as u64;
        self.rx.clear();
        self.plant.exchange(&self.sync, self.now, &mut self.rx);
    }

    /// Computes from what is in `rx`, and hands the commands to the robot.
    pub(crate) fn compute(&mut self, client: &ClientInput<'_>) -> &CycleRecord {
        self.compute_deaf(client, |_| false)
    }

    /// Computes a cycle of which frames for which `lost` is true do not reach the robot.
    pub(crate) fn compute_deaf(
        &mut self,
        client: &ClientInput<'_>,
        lost: impl Fn(&Frame) -> bool,
    ) -> &CycleRecord {
        self.tx.clear();
        let at = self.instants();
        self.cycle.step(at, &self.rx, client, &mut self.tx);
        let mut heard = Frames::new(MAX_FRAMES);
        for frame in self.tx.iter().filter(|frame| !lost(frame)) {
            heard.push(*frame);
        }
        let mut answers = Frames::default();
        self.plant.exchange(&heard, self.now, &mut answers);
        assert!(answers.is_empty(), "commands are not answered");
        self.cycle.record()
    }

    /// SYNC and its answers take no time in this simulation.
    pub(crate) fn instants(&self) -> Instants {
        Instants {
            sync: Stamp(self.now),
            now: Stamp(self.now),
        }
    }

    /// One whole cycle.
    pub(crate) fn step(&mut self, client: &ClientInput<'_>) -> &CycleRecord {
        self.gather();
        self.compute(client)
    }

    /// Cycles without a client.
    pub(crate) fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            self.step(&ClientInput::default());
        }
    }

    /// One whole cycle with an operator's request.
    pub(crate) fn ask(&mut self, request: OperatorRequest) -> &CycleRecord {
        self.step(&ClientInput {
            request: Some(request),
            ..ClientInput::default()
        })
    }

    /// Set-points left in this cycle, in frames for which `counts` is true.
    pub(crate) fn sent_set_points(&self, counts: impl Fn(&Frame) -> bool) -> bool {
        let table = &self.robot.send;
        let is_command = |slot| matches!(slots::sent(slot), slots::Sent::Command(_));
        self.tx.iter().filter(|frame| counts(frame)).any(|frame| {
            let index = table.classify(frame);
            index.is_some_and(|index| table.slots(index).any(is_command))
        })
    }

    /// Drops the answers for which `drop` is true.
    pub(crate) fn drop_answers(&mut self, drop: impl Fn(&Frame) -> bool) {
        let kept: Vec<Frame> = self.rx.iter().filter(|f| !drop(f)).copied().collect();
        self.rx.clear();
        for frame in kept {
            self.rx.push(frame);
        }
    }

    /// A reference for the present pose in `mode`.
    pub(crate) fn reference(&self, mode: u32, sequence: u64) -> Reference {
        let record = self.cycle.record();
        let mut reference = Reference {
            sequence,
            mode,
            joint_count: record.joint_count,
            contact_wrench_given: 1,
            ..Reference::default()
        };
        for (desired, joint) in reference.joints.iter_mut().zip(&record.measured.joints) {
            *desired = JointReference {
                q_d: joint.q,
                ..JointReference::default()
            };
        }
        reference
    }

    /// Runs until the filters are full and the robot follows the client.
    pub(crate) fn follow(&mut self) -> Reference {
        self.run(200);
        let reference = self.reference(Mode::InverseDynamics.number(), 1);
        let client = client_input(&reference);
        assert_eq!(self.step(&client).mode, Mode::InverseDynamics.number());
        reference
    }
}

/// The test joint with a drive that takes currents.
pub(crate) fn current_drive() -> Bench {
    Bench::reading("test-joint", &read_with_current_drive)
}

/// Files of the project, in which the drive of the test joint takes currents.
pub(crate) fn read_with_current_drive(path: &str) -> std::io::Result<String> {
    let text = read(path)?;
    Ok(if path.ends_with("config/test-joint/robot.toml") {
        let from = text.find("K_tau_rad_per_Nm").unwrap();
        let to = text.find("sign_smoothing_rad_per_s").unwrap();
        let motor = "K_1_Nm_per_A = 5.0\nK_2_Nms_per_rad = 0.1\nK_3_Nm = 1.5\n";
        let text = format!("{}{motor}{}", &text[..from], &text[to..]);
        // One cycle of delay is too much for the predictive law around a current (docs/control.md).
        let changes = [
            ("law = \"predictive\"\n", ""),
            (
                "torque_feedback = \"torsion\"",
                "torque_feedback = \"encoder\"",
            ),
            (
                "gains = { K_s_Nm_per_rad = 2083.0, K_d_Nms_per_rad = 20.8 }",
                "gains = { K_p = 2.0, K_s_Nm_per_rad = 1389.0, K_d_Nms_per_rad = 13.9 }",
            ),
            (
                "command = \"position\"",
                "command = \"current\"\ncurrent_limit_A = 7.4",
            ),
        ];
        changes.iter().fold(text, |text, (from, to)| {
            assert!(text.contains(from), "{from}");
            text.replace(from, to)
        })
    } else if path.ends_with("drives.dbc") {
        let from = text.find("SG_ joint_position").unwrap();
        let line = text[from..].lines().next().unwrap();
        text.replace(
            line,
            "SG_ joint_position : 0|32@1- (1,0) [0|0] \"mA\" DRIVES",
        )
    } else {
        text
    })
}

/// The input of a client with a new reference.
pub(crate) fn client_input(reference: &Reference) -> ClientInput<'_> {
    ClientInput {
        reference: Some(reference),
        age_s: 0.001,
        ..ClientInput::default()
    }
}

/// Changes a joint's signals in the answers of this cycle.
pub(crate) fn spoil(bench: &mut Bench, joint: usize, change: impl Fn(&mut [f64])) {
    let table = &bench.robot.receive;
    let mut values = vec![0.0; slots::receive_len(&bench.robot.parameters)];
    let frames: Vec<Frame> = bench.rx.iter().copied().collect();
    bench.rx.clear();
    for mut frame in frames {
        if let Ok(Some(message)) = table.decode(&frame, &mut values)
            && table
                .slots(message)
                .any(|slot| slot == slots::motor_angle(joint))
        {
            let stamp_ns = frame.stamp_ns;
            change(&mut values);
            assert!(table.encode(message, &values, &mut frame));
            frame.stamp_ns = stamp_ns;
        }
        bench.rx.push(frame);
    }
}

/// Changes the first F/T sensor's signals in the answers of this cycle.
pub(crate) fn spoil_ft(bench: &mut Bench, change: impl Fn(&mut [f64; 6])) {
    spoil_source(bench, Source::Ft(0), change);
}

/// Changes the six signals of an F/T sensor or an IMU in the answers of this cycle.
pub(crate) fn spoil_source(bench: &mut Bench, source: Source, change: impl Fn(&mut [f64; 6])) {
    let first = match source {
        Source::Ft(sensor) => slots::ft(sensor, 0),
        Source::Imu(imu) => slots::gyro(imu, 0),
        _ => panic!("{source:?} is neither"),
    };
    let table = &bench.robot.receive;
    let mut values = vec![0.0; slots::receive_len(&bench.robot.parameters)];
    let mut frames: Vec<_> = bench.rx.iter().copied().collect();
    for frame in &frames {
        table.decode(frame, &mut values).unwrap();
    }
    let mut axes = std::array::from_fn(|axis| values[first + axis]);
    change(&mut axes);
    values[first..first + 6].copy_from_slice(&axes);
    bench.rx.clear();
    for frame in &mut frames {
        let message = table.classify(frame).unwrap();
        if table
            .slots(message)
            .any(|slot| slots::source(slot) == source)
        {
            let stamp_ns = frame.stamp_ns;
            assert!(table.encode(message, &values, frame));
            frame.stamp_ns = stamp_ns;
        }
        bench.rx.push(*frame);
    }
}

/// A number that a client may send.
pub(crate) fn any_number(random: &mut Random) -> f64 {
    match random.below(9) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => -1e300,
        4 => 0.0,
        5 => 1e3 * (random.symmetric()),
        _ => random.symmetric(),
    }
}

/// Two pieces in three stay as they are; something of the third is wrong or strange.
pub(crate) fn spoil_piece(piece: &mut TrajectoryPiece, joints: usize, random: &mut Random) {
    let (point, joint) = (random.below(32), random.below(joints));
    let joint = &mut piece.points[point].joints[joint];
    match random.below(30) {
        0 => joint.q_d = any_number(random),
        1 => joint.dq_d = any_number(random),
        2 => joint.ddq_d = any_number(random),
        3 => piece.begins_ns = random.bits() >> random.below(64),
        4 => piece.spacing_ns = random.bits() >> random.below(64),
        5 => piece.point_count = random.bits() as u32 >> random.below(32),
        6 => piece.joint_count = random.bits() as u32 >> random.below(32),
        7 => piece.trajectory = random.bits() % 3,
        8 => piece.sequence = random.bits() % 100,
        9 => piece.session = random.bits() % 9,
        _ => {}
    }
}
