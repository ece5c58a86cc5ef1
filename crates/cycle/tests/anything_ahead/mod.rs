//! A client that sends trajectories ahead, and spoils what can be spoilt of them.

use crate::common::Bench;
use cycle::ClientInput;
use robot_state::{CycleRecord, JointPoint, Mode, Reference, TrajectoryPiece};
use supervisor::Commanders;
use test_support::Random;

const MS: u64 = 1_000_000;

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

/// The client, and the lease that it goes through.
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

    /// What the loop gets from the lease in this cycle.
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
        let (point, joint) = (random.below(32), random.below(self.joints));
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
        piece
    }
}
