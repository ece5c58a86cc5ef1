//! Clients that lead a robot for a while, by trajectories sent ahead or by frames, and spoil what can be spoilt.

use crate::common::{Bench, any_number, spoil_piece};
use cycle::ClientInput;
use robot_config::FrameParameters;
use robot_state::{
    CycleRecord, FrameReference, JointPoint, MAX_JOINTS, Mode, Reference, TrajectoryPiece,
    frame_flags,
};
use supervisor::Commanders;
use test_support::Random;

const MS: u64 = 1_000_000;

/// A message of any kind.
pub(crate) fn any_reference(random: &mut Random, record: &CycleRecord) -> Reference {
    let mut reference = Reference {
        sequence: random.bits() % 4 + record.sequence,
        mode: random.bits() as u32 % (Mode::ALL.len() as u32 + 1),
        joint_count: match random.below(20) {
            0 => random.bits() as u32,
            _ => record.joint_count,
        },
        contact_wrench_given: random.bits() as u32 % 2,
        gains_given: random.bits() as u32 % 2,
        held_joints: random.bits(),
        ..Reference::default()
    };
    let near = random.below(20) > 0;
    for j in 0..MAX_JOINTS.min(record.joint_count as usize) {
        let joint = &mut reference.joints[j];
        joint.q_d = record.measured.joints[j].q;
        joint.tau_d = 50.0 * random.symmetric();
        joint.stiffness = 100.0 * random.unit();
        joint.damping = random.unit();
        if reference.mode == Mode::Position.number() {
            joint.q_d += 0.5 * random.symmetric();
        }
        if !near && random.below(3) == 0 {
            joint.q_d += any_number(random);
            joint.dq_d = any_number(random);
            joint.ddq_d = any_number(random);
            joint.tau_d = any_number(random);
            joint.stiffness = any_number(random);
            joint.damping = any_number(random);
        }
    }
    if !near && random.below(3) == 0 {
        reference.contact_wrench[0].force[2] = any_number(random);
    }
    let shown = &record.commanded.frames[0];
    let frame = &mut reference.frames[0];
    frame.used = u32::from(random.below(10) > 0);
    (frame.position, frame.orientation) = (shown.position, shown.orientation);
    if frame.orientation == [0.0; 4] {
        frame.orientation[0] = 1.0;
    }
    frame.stiffness.fill_with(|| 100.0 * random.unit());
    frame.damping_ratio = 0.3 + 1.7 * random.unit();
    if !near && random.below(3) == 0 {
        let axis = random.below(6);
        frame.position[axis % 3] += any_number(random);
        frame.orientation[axis % 4] = any_number(random);
        frame.velocity[axis] = any_number(random);
        frame.stiffness[axis] = any_number(random);
        frame.force[axis] = any_number(random);
        frame.damping_ratio = any_number(random);
        frame.own_axes = random.bits() as u32;
        frame.force_axes = random.bits() as u32 >> random.below(32);
    }
    reference
}

/// The client of trajectories, and the lease that it goes through.
#[derive(Debug)]
pub(crate) struct Ahead {
    commanders: Commanders,
    reference: Reference,
    joints: usize,
    pieces: u64,
    /// End of what was taken of the trajectory, ns since its begin.
    end_ns: u64,
    /// Of the sines that the joints follow: rad, and rad/s times the joint's number.
    way: f64,
    rate: f64,
    start: Vec<f64>,
    silence: usize,
    /// Steps in which a trajectory was followed.
    pub(crate) led: u64,
}

impl Ahead {
    pub(crate) fn new(bench: &Bench) -> Self {
        let parameters = &bench.robot.parameters;
        let joints = parameters.joints.len();
        Self {
            commanders: Commanders::new(parameters.timing.reference_timeout)
                .with_trajectories(parameters.trajectory_limits()),
            reference: Reference {
                session: 1,
                session_began_ns: bench.now,
                joint_count: joints as u32,
                ..Reference::default()
            },
            joints,
            pieces: 0,
            end_ns: 0,
            way: 0.0,
            rate: 1.0,
            start: vec![0.0; joints],
            silence: 0,
            led: 0,
        }
    }

    /// Reference that the loop gets from the lease in this cycle.
    pub(crate) fn input(&self, now: u64) -> ClientInput<'_> {
        ClientInput {
            reference: self.commanders.reference(),
            age_s: self.commanders.age_s(now),
            commander: self.commanders.record(),
            ..ClientInput::default()
        }
    }

    /// A cycle of the client: references, pieces, silence, or `strange`, as another client may send it.
    pub(crate) fn cycle(
        &mut self,
        random: &mut Random,
        now: u64,
        record: &CycleRecord,
        strange: &Reference,
    ) {
        let holds = record.mode == Mode::Hold.number();
        let asks_hold = self.reference.mode == Mode::Hold.number();
        self.led += u64::from(!holds && self.commanders.record().trajectory_s > 0.0);
        if !asks_hold && (holds || random.below(800) == 0) {
            self.reference.mode = Mode::Hold.number();
        } else if asks_hold && random.below(30) == 0 {
            self.begin(random, record);
        }
        if random.below(15) == 0 {
            let piece = self.piece(random);
            self.pieces += 1;
            if self.commanders.offer_piece(&piece).is_ok() {
                let way = u64::from(piece.point_count - 1) * piece.spacing_ns;
                self.end_ns = piece.begins_ns + way;
            }
        }
        if random.below(2_000) == 0 {
            self.silence = random.below(80);
        }
        self.silence = self.silence.saturating_sub(1);
        if self.commanders.record().session == 0 {
            // The lease was lost: another session, which begins with hold.
            self.reference.session += 1;
            self.reference.session_began_ns = now;
            self.reference.mode = Mode::Hold.number();
        }
        if self.silence == 0 {
            self.reference.sequence += 1;
            self.reference.sent_ns = now;
            _ = self.commanders.offer(&self.reference, now);
        }
        if random.below(500) == 0 {
            // A spoilt one of the session's own, or another client's.
            let session = match random.below(2) {
                0 => self.reference.session,
                _ => random.bits(),
            };
            let strange = Reference {
                session,
                session_began_ns: self.reference.session_began_ns,
                sequence: self.reference.sequence + 1,
                sent_ns: now,
                priority: random.below(2) as u32,
                trajectory: random.bits() % 3,
                ..*strange
            };
            self.reference.sequence += 1;
            _ = self.commanders.offer(&strange, now);
        }
        self.commanders.begin_cycle(now);
    }

    /// Asks for the next trajectory, from where the robot stands.
    fn begin(&mut self, random: &mut Random, record: &CycleRecord) {
        self.reference.mode = Mode::InverseDynamics.number();
        self.reference.trajectory += 1;
        self.end_ns = 0;
        (self.way, self.rate) = (0.4 * random.symmetric(), 0.5 + 2.0 * random.unit());
        let joints = record.measured.joints.iter();
        self.start = joints.take(self.joints).map(|joint| joint.q).collect();
    }

    fn at(&self, joint: usize, t: f64) -> JointPoint {
        let rate = self.rate * (1.0 + 0.2 * joint as f64);
        let way = self.way / (1.0 + 0.5 * joint as f64);
        JointPoint {
            q_d: self.start[joint] + way * (1.0 - (rate * t).cos()),
            dq_d: way * rate * (rate * t).sin(),
            ddq_d: way * rate * rate * (rate * t).cos(),
        }
    }

    /// The next piece, now and then spoilt in some way.
    fn piece(&self, random: &mut Random) -> TrajectoryPiece {
        let (begins_ns, spacing_ns) = (self.end_ns, MS * (1 + random.below(30) as u64));
        let mut piece = TrajectoryPiece {
            session: self.reference.session,
            trajectory: self.reference.trajectory,
            sequence: self.pieces + 1,
            begins_ns,
            spacing_ns,
            joint_count: self.joints as u32,
            point_count: 2 + random.below(31) as u32,
            ..TrajectoryPiece::default()
        };
        for (k, point) in piece.points.iter_mut().enumerate() {
            let t = (begins_ns + k as u64 * spacing_ns) as f64 * 1e-9;
            for joint in 0..self.joints {
                point.joints[joint] = self.at(joint, t);
            }
        }
        spoil_piece(&mut piece, self.joints, random);
        piece
    }
}

/// A client that leads frames in mode Cartesian: on ways, by springs and forces, with one thing spoilt now and
/// then.
#[derive(Debug)]
pub(crate) struct Leading {
    reference: Reference,
    frames: Vec<FrameParameters>,
    /// Its pose when the mode was asked for, and the sine that it then follows: m, and rad/s.
    start: [f64; 3],
    way: f64,
    rate: f64,
    cycles: u32,
    silence: usize,
    age_s: f64,
    /// Steps in which frames were led.
    pub(crate) led: u64,
}

impl Leading {
    pub(crate) fn new(bench: &Bench) -> Self {
        let parameters = &bench.robot.parameters;
        Self {
            reference: Reference {
                joint_count: parameters.joints.len() as u32,
                ..Reference::default()
            },
            frames: parameters.frames.clone(),
            start: [0.0; 3],
            way: 0.0,
            rate: 1.0,
            cycles: 0,
            silence: 0,
            age_s: 0.001,
            led: 0,
        }
    }

    /// Its newest message in this cycle, and the message's age, s.
    pub(crate) fn cycle(&mut self, random: &mut Random, record: &CycleRecord) -> (Reference, f64) {
        self.led += u64::from(record.mode == Mode::Cartesian.number());
        if random.below(2_000) == 0 {
            self.silence = random.below(80);
        }
        if self.silence > 0 {
            self.silence -= 1;
            self.age_s += 1e-3;
            return (self.reference, self.age_s);
        }
        self.age_s = 0.001;
        self.cycles += 1;
        let asks_hold = self.reference.mode == Mode::Hold.number();
        let ended = !asks_hold && record.mode != self.reference.mode && self.cycles > 1;
        if ended || random.below(1_500) == 0 {
            // In hold the frame is shown.
            (self.reference.mode, self.cycles) = (Mode::Hold.number(), 0);
            self.reference.frames[0] = FrameReference {
                orientation: [1.0, 0.0, 0.0, 0.0],
                damping_ratio: 1.0,
                used: 1,
                ..FrameReference::default()
            };
        } else if asks_hold && self.cycles > 3 && random.below(20) == 0 {
            self.begin(random, record);
        } else if !asks_hold {
            let phase = self.rate * 1e-3 * f64::from(self.cycles);
            let frame = &mut self.reference.frames[0];
            frame.position[2] = self.start[2] + self.way * phase.sin();
            frame.velocity[2] = self.way * self.rate * phase.cos();
        }
        self.reference.sequence += 1;
        let mut sent = self.reference;
        if random.below(300) == 0 {
            self.spoil(&mut sent, random);
        }
        (sent, self.age_s)
    }

    /// Asks for mode Cartesian where the frame is.
    fn begin(&mut self, random: &mut Random, record: &CycleRecord) {
        let shown = &record.commanded.frames[0];
        let Some(limits) = self.frames.first().map(|frame| frame.limits) else {
            return;
        };
        if shown.flags & frame_flags::VALID == 0 {
            return;
        }
        (self.reference.mode, self.cycles) = (Mode::Cartesian.number(), 0);
        let joints = self.reference.joints.iter_mut();
        for (desired, joint) in joints.zip(&record.measured.joints) {
            desired.q_d = joint.q;
        }
        self.start = shown.position;
        (self.way, self.rate) = (0.05 * random.symmetric(), 0.5 + 4.0 * random.unit());
        let fed_back = match random.below(2) {
            0 => 0,
            _ => random.bits() as u32 & 0b11_1111,
        };
        self.reference.frames[0] = FrameReference {
            position: shown.position,
            orientation: shown.orientation,
            stiffness: std::array::from_fn(|axis| match fed_back >> axis & 1 {
                1 => 0.0,
                _ => limits.stiffness[axis / 3] * random.unit(),
            }),
            force: std::array::from_fn(|axis| 0.5 * limits.wrench[axis / 3] * random.symmetric()),
            damping_ratio: 0.3 + 1.7 * random.unit(),
            force_axes: fed_back,
            own_axes: random.below(2) as u32,
            used: 1,
            ..FrameReference::default()
        };
    }

    /// One message that is wrong in some way, or strange.
    fn spoil(&self, sent: &mut Reference, random: &mut Random) {
        let (axis, other) = (random.below(6), random.below(sent.frames.len()));
        if random.below(4) == 0 {
            sent.frames[other] = sent.frames[0];
        }
        let frame = &mut sent.frames[0];
        match random.below(14) {
            0 => frame.position[axis % 3] = any_number(random),
            1 => frame.position[axis % 3] += 0.5 * random.symmetric(),
            2 => frame.orientation[axis % 4] = any_number(random),
            3 => frame.velocity[axis] = any_number(random),
            4 => frame.stiffness[axis] = 1e4 * any_number(random),
            5 => frame.force[axis] = 1e3 * any_number(random),
            6 => frame.damping_ratio = any_number(random),
            7 => frame.used = random.bits() as u32 >> random.below(32),
            8 => frame.own_axes ^= 1,
            9 => frame.force_axes = random.bits() as u32 >> random.below(32),
            10 => sent.sequence = random.bits() >> random.below(64),
            11 => sent.mode = random.bits() as u32 % (Mode::ALL.len() as u32 + 1),
            12 => sent.joints[axis].q_d = any_number(random),
            _ => (sent.gains_given, sent.joints[axis].stiffness) = (1, any_number(random)),
        }
    }
}
