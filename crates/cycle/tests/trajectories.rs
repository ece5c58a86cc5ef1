//! Trajectories that a client sends ahead: followed through its stutter, stopped where they end or
//! their client dies, and checked in every cycle.

use crate::common;

use common::motion::Motion;
use common::{Bench, spoil_piece};
use cycle::ClientInput;
use robot_state::{
    CycleRecord, Event, JointPoint, Mode, Reference, TrajectoryPiece, piece_refusal,
};
use supervisor::Commanders;
use test_support::Random;

const MS: u64 = 1_000_000;
const JOINT: usize = 3;
/// Of the sine that the knee follows: rad, rad/s.
const SIZE: f64 = 0.2;
const RATE: f64 = 4.0;

/// A client and the loop's end for it.
struct Led {
    bench: Bench,
    commanders: Commanders,
    reference: Reference,
    pieces: u64,
    start: Vec<f64>,
}

impl Led {
    /// It has asked for hold, and would be followed.
    fn new(robot: &str) -> Self {
        let mut bench = Bench::new(robot);
        bench.run(400);
        let parameters = &bench.robot.parameters;
        let commanders = Commanders::new(parameters.timing.reference_timeout)
            .with_trajectories(parameters.trajectory_limits());
        let start = bench.cycle.record().measured.joints.iter();
        let start = start.map(|joint| joint.q).collect();
        let mut led = Self {
            commanders,
            reference: Reference {
                session: 5,
                session_began_ns: bench.now,
                joint_count: parameters.joints.len() as u32,
                ..Reference::default()
            },
            pieces: 0,
            start,
            bench,
        };
        led.cycles(20, true);
        led
    }

    /// Cycles in which the client sends, or is silent.
    fn cycles(&mut self, count: u64, alive: bool) -> CycleRecord {
        for _ in 0..count {
            self.bench.gather();
            let now = self.bench.now;
            if alive {
                self.reference.sequence += 1;
                self.reference.sent_ns = now;
                self.commanders.offer(&self.reference, now);
            }
            self.commanders.begin_cycle(now);
            let input = ClientInput {
                reference: self.commanders.reference(),
                age_s: self.commanders.age_s(now),
                commander: self.commanders.record(),
                ..ClientInput::default()
            };
            self.bench.compute(&input);
        }
        *self.bench.cycle.record()
    }

    fn at(&self, joint: usize, t: f64) -> JointPoint {
        let start = self.start[joint];
        match joint {
            JOINT => JointPoint {
                q_d: start + SIZE * (1.0 - (RATE * t).cos()),
                dq_d: SIZE * RATE * (RATE * t).sin(),
                ddq_d: SIZE * RATE * RATE * (RATE * t).cos(),
            },
            _ => JointPoint {
                q_d: start,
                ..JointPoint::default()
            },
        }
    }

    fn piece(&self, begins: u64, count: usize) -> TrajectoryPiece {
        let mut piece = TrajectoryPiece {
            session: self.reference.session,
            trajectory: 9,
            sequence: self.pieces + 1,
            begins_ns: begins,
            spacing_ns: 10 * MS,
            joint_count: self.reference.joint_count,
            point_count: count as u32,
            ..TrajectoryPiece::default()
        };
        for (k, point) in piece.points.iter_mut().take(count).enumerate() {
            let t = (begins + k as u64 * piece.spacing_ns) as f64 * 1e-9;
            for joint in 0..self.reference.joint_count as usize {
                point.joints[joint] = self.at(joint, t);
            }
        }
        piece
    }

    fn send(&mut self, piece: &TrajectoryPiece) -> Result<(), u32> {
        self.pieces += 1;
        self.commanders.offer_piece(piece)
    }

    fn begin(&mut self) {
        self.send(&self.piece(0, 30)).unwrap();
        self.reference.mode = Mode::InverseDynamics.number();
        self.reference.trajectory = 9;
    }

    fn count(&self, event: Event) -> u64 {
        self.bench.cycle.record().events[event.index()]
    }

    fn assert_no_flaw(&self) {
        use Event::{ReferenceJump, ReferenceLimit, ReferenceRejected, ReferenceStale};
        for event in [
            ReferenceJump,
            ReferenceLimit,
            ReferenceRejected,
            ReferenceStale,
        ] {
            assert_eq!(self.count(event), 0, "{event:?}");
        }
    }
}

/// Over the references' time-out without a heartbeat but in time, and pieces a quarter of a second
/// apart: the knee follows as if every cycle had a reference.
#[test]
fn a_client_that_stutters_is_followed_smoothly() {
    let mut led = Led::new("leg");
    led.begin();
    let mut worst = 0.0f64;
    for k in 0..60u64 {
        // 35 ms without a word each.
        led.cycles(1, true);
        led.cycles(34, false);
        if k % 5 == 4 {
            let next = led.commanders.record().trajectory_left_s;
            let time = led.commanders.record().trajectory_s;
            let end = ((next + time) * 1e3).round() as u64;
            led.send(&led.piece(end * MS, 18)).unwrap();
        }
        let record = led.bench.cycle.record();
        assert_eq!(record.mode, Mode::InverseDynamics.number(), "{k}");
        let wanted = led.at(JOINT, record.commander.trajectory_s).q_d;
        worst = worst.max((record.measured.joints[JOINT].q - wanted).abs());
    }
    led.assert_no_flaw();
    assert!(worst < 0.3f64.to_radians(), "{:.3} deg", worst.to_degrees());
    assert_eq!(led.count(Event::TrajectoryEnded), 0);
}

/// No further piece: at rest soon, in the same mode, and reported.
#[test]
fn a_trajectory_that_ends_in_motion_comes_to_rest() {
    let mut led = Led::new("leg");
    led.begin();
    led.cycles(290, true);
    assert_eq!(led.count(Event::TrajectoryEnded), 0);
    assert!(led.bench.plant.truth().joints[JOINT].dq.abs() > 0.4);
    led.cycles(700, true);
    assert_eq!(led.count(Event::TrajectoryEnded), 1);
    led.assert_no_flaw();
    let rest = led.bench.plant.truth().joints[JOINT];
    assert!(rest.dq.abs() < 0.01, "{}", rest.dq);
    let mut motion = Motion::of(&led.bench);
    for _ in 0..300 {
        led.cycles(1, true);
        motion.take(&led.bench);
    }
    motion.assert_small("after the stop");
    let record = led.bench.cycle.record();
    assert_eq!(
        (record.mode, record.fault),
        (Mode::InverseDynamics.number(), 0)
    );
}

/// The client dies with 0.29 s of its trajectory buffered: noticed within 50 ms, as without a buffer.
#[test]
fn a_client_that_dies_is_noticed_though_points_are_left() {
    let mut led = Led::new("leg");
    led.begin();
    led.cycles(150, true);
    assert!(led.commanders.record().trajectory_left_s > 0.1);
    let mut noticed = None;
    let mut at_rest = None;
    for ms in 1..1000u32 {
        let record = led.cycles(1, false);
        if record.mode == Mode::Hold.number() {
            noticed.get_or_insert(ms);
        }
        let moving = led.bench.plant.truth().joints[JOINT].dq.abs() > 0.02;
        if moving {
            at_rest = Some(ms);
        }
    }
    assert!(noticed.is_some_and(|ms| ms <= 50), "{noticed:?}");
    assert!(at_rest.is_some_and(|ms| ms < 500), "{at_rest:?}");
    assert_eq!(led.count(Event::ReferenceStale), 1);
    assert_eq!(led.bench.cycle.record().fault, 0);
    // It does not go on by itself.
    led.cycles(50, true);
    assert_eq!(led.bench.cycle.record().mode, Mode::Hold.number());
}

/// Points that are within the limits one by one, but not between them: the cycle that is asked for
/// too much releases the robot.
#[test]
fn what_lies_between_the_points_is_checked_in_every_cycle() {
    let mut led = Led::new("leg");
    let mut piece = led.piece(0, 5);
    piece.spacing_ns = 200 * MS;
    for (k, point) in piece.points.iter_mut().enumerate() {
        let joint = &mut point.joints[JOINT];
        // At rest at each point, and far away at every other one.
        let way = if k % 2 == 0 { 0.0 } else { 0.5 };
        *joint = JointPoint {
            q_d: led.start[JOINT] + way,
            ..JointPoint::default()
        };
    }
    led.send(&piece).unwrap();
    led.reference.mode = Mode::InverseDynamics.number();
    led.reference.trajectory = 9;
    let record = led.cycles(150, true);
    let refused = led.count(Event::ReferenceLimit) + led.count(Event::ReferenceJump);
    assert!(refused > 0);
    assert_eq!(record.mode, Mode::Hold.number());
    let limit = led.bench.robot.parameters.joints[JOINT].limits.velocity;
    assert!(led.bench.plant.truth().joints[JOINT].dq.abs() < limit);
}

/// A reference that names a trajectory waits for its first piece; pieces of others move nothing.
#[test]
fn nothing_moves_without_a_piece_of_ones_own() {
    let mut led = Led::new("leg");
    led.reference.mode = Mode::InverseDynamics.number();
    led.reference.trajectory = 9;
    let mut strange = led.piece(0, 30);
    strange.session = 6;
    assert_eq!(led.send(&strange), Err(piece_refusal::SESSION));
    let record = led.cycles(60, true);
    assert_eq!(record.mode, Mode::Hold.number());
    assert_eq!(led.count(Event::TrajectoryRefused), 1);
    led.assert_no_flaw();
    led.send(&led.piece(0, 30)).unwrap();
    let record = led.cycles(1, true);
    assert_eq!(record.mode, Mode::InverseDynamics.number());
    // A trajectory that was left is not gone on with.
    led.reference.mode = Mode::Hold.number();
    led.cycles(100, true);
    led.reference.mode = Mode::InverseDynamics.number();
    let record = led.cycles(30, true);
    assert_eq!(record.mode, Mode::Hold.number());
    led.assert_no_flaw();
}

/// The next piece, spoilt in some way or another, or none.
fn any_piece(led: &Led, random: &mut Random, end: u64, way: f64) -> TrajectoryPiece {
    let mut piece = led.piece(end, 2 + random.below(31));
    piece.trajectory = led.reference.trajectory;
    piece.spacing_ns = MS * (1 + random.below(30) as u64);
    for (k, point) in piece.points.iter_mut().enumerate() {
        let t = (end + k as u64 * piece.spacing_ns) as f64 * 1e-9;
        let joints = point.joints.iter_mut().zip(&led.start).enumerate();
        for (j, (joint, start)) in joints {
            let (rate, way) = (1.0 + j as f64, way / (1.0 + j as f64));
            joint.q_d = start + way * (1.0 - (rate * t).cos());
            joint.dq_d = way * rate * (rate * t).sin();
            joint.ddq_d = way * rate * rate * (rate * t).cos();
        }
    }
    spoil_piece(&mut piece, 6, random);
    piece
}

/// NaN, overlapping, past, far, of wrong counts, of others, too fast, beyond limits: the robot keeps
/// its limits and goes on being led, whatever is sent ahead and however its client stutters.
#[test]
fn whatever_is_sent_ahead_the_robot_keeps_its_limits() {
    let (mut moved, mut taken, mut refused) = (0u32, 0u32, 0u32);
    for seed in 0..4 {
        let mut random = Random::new(seed);
        let mut led = Led::new("leg");
        let (mut end, mut way, mut silence) = (0, 0.0, 0);
        for _ in 0..5_000 {
            let record = *led.bench.cycle.record();
            let holds = record.mode == Mode::Hold.number();
            if led.reference.mode != Mode::Hold.number() && (holds || random.below(400) == 0) {
                led.reference.mode = Mode::Hold.number();
            } else if random.below(50) == 0 && led.reference.mode == Mode::Hold.number() {
                led.reference.mode = Mode::InverseDynamics.number();
                led.reference.trajectory += 1;
                (end, way) = (0, 0.4 * random.symmetric());
                let joints = record.measured.joints.iter();
                led.start = joints.take(6).map(|joint| joint.q).collect();
            }
            if random.below(25) == 0 {
                let piece = any_piece(&led, &mut random, end, way);
                match led.send(&piece) {
                    Ok(()) => {
                        taken += 1;
                        end = piece.begins_ns + u64::from(piece.point_count - 1) * piece.spacing_ns;
                    }
                    Err(_) => refused += 1,
                }
            }
            if random.below(600) == 0 {
                silence = random.below(80);
            }
            silence = silence.saturating_sub(1);
            if led.commanders.record().session == 0 {
                // The lease was lost: another session, which begins with hold.
                led.reference.session += 1;
                led.reference.session_began_ns = led.bench.now;
                led.reference.mode = Mode::Hold.number();
            }
            let record = led.cycles(1, silence == 0);
            assert_eq!(record.fault, 0);
            let truth = led.bench.plant.truth();
            let joints = led.bench.robot.parameters.joints.iter().zip(&truth.joints);
            for (j, (joint, truth)) in joints.enumerate() {
                let (limits, q_c) = (&joint.limits, record.commanded.joints[j].q_c);
                let reach = limits.lead + 0.02;
                let range = limits.position_min - reach..=limits.position_max + reach;
                assert!(range.contains(&q_c), "seed {seed}, joint {j}: {q_c}");
                assert!(
                    range.contains(&truth.q),
                    "seed {seed}, joint {j}: at {}",
                    truth.q
                );
                let speed = truth.dq.abs() / limits.velocity;
                assert!(
                    speed < 1.1,
                    "seed {seed}, joint {j}: {speed} of its velocity limit"
                );
                moved += u32::from(speed > 0.02);
            }
        }
    }
    assert!(moved > 5_000, "{moved} times a joint moved");
    assert!(
        taken > 100 && refused > 100,
        "{taken} pieces taken, {refused} refused"
    );
}
