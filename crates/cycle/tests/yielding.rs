//! Contacts: detected within milliseconds, not found where there is none, and what follows from one.

use crate::common;

use common::{Bench, client_input, read};
use cycle::{ClientInput, OperatorRequest};
use robot_state::{CycleRecord, Event, Mode, Reference, RobotState};
use test_support::Random;

const LEG: &str = "config/leg/robot.toml";

/// The leg with detection of contacts, a reaction to them, and other lines of that table.
fn leg(reaction: &str, more: &str) -> Bench {
    Bench::reading("leg", &|path: &str| {
        let text = read(path)?;
        Ok(match path {
            LEG => {
                text + &format!(
                    "\n[external_torque]\n{more}\n\
                     [safety.reactions]\nexternal_contact = \"{reaction}\"\n"
                )
            }
            _ => text,
        })
    })
}

/// The leg in front of a client that moves its joints by `way`, which gives angle, velocity and
/// acceleration for joint and time.
struct Moved {
    bench: Bench,
    reference: Reference,
    begin: Reference,
    cycles: usize,
}

impl Moved {
    fn new(mut bench: Bench) -> Self {
        bench.run(300);
        let mut reference = bench.follow();
        reference.contact_wrench_given = 0;
        let mut moved = Self {
            begin: reference,
            bench,
            reference,
            cycles: 0,
        };
        (0..700).for_each(|_| _ = moved.step(&|_, _| [0.0; 3]));
        moved.cycles = 0;
        assert_eq!(
            moved.bench.cycle.record().mode,
            Mode::InverseDynamics.number()
        );
        moved
    }

    fn step(&mut self, way: &dyn Fn(usize, f64) -> [f64; 3]) -> &CycleRecord {
        let t = 1e-3 * self.cycles as f64;
        self.cycles += 1;
        let joints = self.reference.joints.iter_mut().zip(&self.begin.joints);
        for (j, (asked, begin)) in joints.enumerate() {
            let [q, dq, ddq] = way(j, t);
            (asked.q_d, asked.dq_d, asked.ddq_d) = (begin.q_d + q, dq, ddq);
        }
        self.reference.sequence += 1;
        self.bench.step(&client_input(&self.reference))
    }

    fn rest(&mut self, cycles: usize) {
        (0..cycles).for_each(|_| _ = self.step(&|_, _| [0.0; 3]));
    }

    fn load(&mut self, joint: usize, torque: f64) {
        self.bench.plant.robot_mut().set_load(joint, torque);
    }

    fn q(&self, joint: usize) -> f64 {
        self.bench.plant.truth().joints[joint].q
    }

    fn dq(&self, joint: usize) -> f64 {
        self.bench.plant.truth().joints[joint].dq
    }

    fn limit(&self, joint: usize) -> f64 {
        self.bench.robot.parameters.joints[joint].limits.torque
    }

    fn record(&self) -> &CycleRecord {
        self.bench.cycle.record()
    }
}

fn flagged(record: &CycleRecord) -> Vec<usize> {
    let joints = record.estimated.joints.iter().enumerate();
    joints
        .filter(|(_, joint)| joint.contact_flag == 1)
        .map(|(j, _)| j)
        .collect()
}

fn contacts(record: &CycleRecord) -> u64 {
    record.events[Event::ExternalContact.index()]
}

const HIP_PITCH: usize = 2;
const KNEE: usize = 3;

/// A tenth of the torque limit, put on any joint at once, sets its flag within 10 ms, also while the
/// loop loses single samples; taken away, the flag ends.
#[test]
fn a_step_is_flagged_within_ten_milliseconds() {
    let mut moved = Moved::new(leg("warn", ""));
    for joint in 0..6 {
        let torque = 0.1 * moved.limit(joint) * if joint % 2 == 0 { 1.0 } else { -1.0 };
        moved.load(joint, torque);
        let found = (1..=10).find(|_| flagged(moved.step(&|_, _| [0.0; 3])).contains(&joint));
        assert!(found.is_some(), "joint {joint}");
        moved.load(joint, 0.0);
        moved.rest(1200);
        assert_eq!(flagged(moved.record()), [0; 0], "joint {joint}");
        assert_eq!(moved.record().fault, 0);
    }
}

/// Whatever the leg does within its limits, no contact is found where there is none.
#[test]
fn motion_is_no_contact() {
    for seed in 0..4 {
        let mut moved = Moved::new(leg("warn", ""));
        let mut random = Random::new(seed);
        let swings: Vec<[f64; 3]> = (moved.bench.robot.parameters.joints.iter())
            .zip(&moved.begin.joints)
            .map(|(joint, begin)| {
                let room = (joint.limits.position_max - begin.q_d)
                    .min(begin.q_d - joint.limits.position_min);
                let w = 2.0 + 4.0 * random.symmetric().abs();
                let fastest = (0.2 + 0.4 * random.symmetric().abs()) * joint.limits.velocity;
                [(0.5 * room).min(fastest / w), w, 3.0 * random.symmetric()]
            })
            .collect();
        let mut worst = 0.0f64;
        for _ in 0..3000 {
            let record = moved.step(&|j, t| {
                let Some([a, w, phase]) = swings.get(j) else {
                    return [0.0; 3];
                };
                // It swells as 1 - cos within a second.
                let pi = std::f64::consts::PI;
                let (s, ds, dds) = match t {
                    t if t < 1.0 => {
                        let (sin, cos) = (pi * t).sin_cos();
                        (0.5 * (1.0 - cos), 0.5 * pi * sin, 0.5 * pi * pi * cos)
                    }
                    _ => (1.0, 0.0, 0.0),
                };
                let (sin, cos) = (w * t + phase).sin_cos();
                [
                    a * s * sin,
                    a * (ds * sin + s * w * cos),
                    a * (dds * sin + 2.0 * ds * w * cos - s * w * w * sin),
                ]
            });
            assert_eq!(record.mode, Mode::InverseDynamics.number(), "seed {seed}");
            assert_eq!(flagged(record), [0; 0], "seed {seed}");
            let joints = record.estimated.joints.iter();
            worst = joints.map(|j| j.contact_ratio).fold(worst, f64::max);
        }
        assert!(worst > 0.05, "seed {seed}: nothing is judged");
    }
}

/// A soft limb gives way to a push further than a stiff one, damped, not beyond its bound, and keeps
/// its weight; the operator's acknowledgement leads to hold where it is.
#[test]
fn a_limb_complies() {
    let way = |reaction: &str, more: &str| {
        let mut moved = Moved::new(leg(reaction, more));
        let before = moved.q(KNEE);
        moved.load(KNEE, -0.3 * moved.limit(KNEE));
        moved.rest(400);
        let way = (moved.q(KNEE) - before).abs();
        (moved, way)
    };
    let (_, stiff) = way("stop", "");
    let (mut moved, soft) = way("comply", "[external_torque.reaction]\ncomply_deg = 90");
    let record = moved.record();
    assert_eq!(record.fault, Event::ExternalContact.number());
    assert_eq!(record.mode, Mode::Hold.number());
    assert!(soft > 10.0 * stiff && soft > 0.1, "{soft} and {stiff} rad");
    let fastest = moved.bench.robot.parameters.joints[KNEE].torque_velocity;
    assert!(
        moved.dq(KNEE).abs() < 1.1 * fastest,
        "{} rad/s",
        moved.dq(KNEE)
    );
    // Let go, it stays where it was pushed: neither a spring nor its weight moves it far.
    moved.load(KNEE, 0.0);
    moved.rest(300);
    let let_go: Vec<f64> = (0..6).map(|j| moved.q(j)).collect();
    moved.rest(1000);
    for (j, q) in let_go.iter().enumerate() {
        // Torques that are known to 3 % of the limit, against the damping, for a second.
        let k_d = moved.bench.robot.parameters.joints[j].gains.k_d;
        let (way, most) = ((moved.q(j) - q).abs(), 0.03 * moved.limit(j) / k_d);
        assert!(way < most, "joint {j}: {way} rad, at most {most}");
    }
    let number = Event::ExternalContact.number();
    moved.bench.ask(OperatorRequest::Acknowledge(number));
    let here = moved.q(KNEE);
    moved.bench.run(300);
    let record = moved.record();
    assert_eq!(
        (record.fault, record.state),
        (0, RobotState::Holding.number())
    );
    assert!((moved.q(KNEE) - here).abs() < 0.01);

    // Pushed on, it is stopped at its bound.
    let bound = 5f64.to_radians();
    let (mut moved, _) = way("comply", "[external_torque.reaction]\ncomply_deg = 5");
    let there = moved.q(KNEE);
    moved.rest(300);
    let beyond = (there - moved.begin.joints[KNEE].q_d).abs() - bound;
    assert!(beyond < 0.07, "{beyond} rad beyond");
    assert!((moved.q(KNEE) - there).abs() < 0.005);
}

/// Complying ends with the contact where that is asked for.
#[test]
fn complying_ends_with_the_contact() {
    let more = "[external_torque.reaction]\ncomply_ends = \"contact_gone\"\ngone_ms = 200";
    let mut moved = Moved::new(leg("comply", more));
    moved.load(KNEE, -0.3 * moved.limit(KNEE));
    moved.rest(60);
    moved.load(KNEE, 0.0);
    moved.rest(2500);
    let before = moved.q(KNEE);
    // A hand that comes again finds a joint that holds.
    moved.load(KNEE, 0.1 * moved.limit(KNEE));
    moved.rest(300);
    assert!((moved.q(KNEE) - before).abs() < 0.005);
    assert_eq!(moved.record().fault, Event::ExternalContact.number());
}

/// A source of the torque that fails while the limb is soft, or before, leads to a stop for good.
#[test]
fn no_limb_yields_without_a_sound_torque() {
    for before in [false, true] {
        let mut moved = Moved::new(leg("comply", "[external_torque.reaction]\ncomply_deg = 90"));
        let push = -0.3 * moved.limit(KNEE);
        if !before {
            moved.load(KNEE, push);
            moved.rest(100);
            assert!(moved.dq(KNEE).abs() > 0.1, "it does not comply");
        }
        let step = |moved: &mut Moved, silent: bool| {
            moved.bench.gather();
            if silent {
                let table = moved.bench.robot.receive.clone();
                moved.bench.drop_answers(|frame| {
                    let message = table.classify(frame);
                    let ft = |slot| slot == robot_config::slots::ft(0, 0);
                    message.is_some_and(|message| table.slots(message).any(ft))
                });
            }
            moved.reference.sequence += 1;
            let input = client_input(&moved.reference);
            moved.bench.compute(&ClientInput { ..input });
        };
        (0..60).for_each(|_| step(&mut moved, true));
        if before {
            moved.load(KNEE, push);
        }
        // A sensor that comes back makes no limb soft that has been stopped.
        (0..200).for_each(|_| step(&mut moved, before));
        let there = moved.q(KNEE);
        (0..300).for_each(|_| step(&mut moved, before));
        let way = (moved.q(KNEE) - there).abs();
        assert!(way < 0.005, "before: {before}: it moves by {way} rad");
    }
}

/// After a contact in motion the limb goes back, away from it, and holds there; one that stood is
/// stopped.
#[test]
fn a_limb_retracts() {
    let back = 5f64.to_radians();
    let mut moved = Moved::new(leg("retract", ""));
    // A thigh that swings at 0.5 rad/s, up to the contact.
    let swing = |j: usize, t: f64| match j {
        HIP_PITCH => {
            let (w, a) = (std::f64::consts::PI, 0.3);
            [
                a * (1.0 - (w * t).cos()) / 2.0,
                a * w / 2.0 * (w * t).sin(),
                a * w * w / 2.0 * (w * t).cos(),
            ]
        }
        _ => [0.0; 3],
    };
    (0..600).for_each(|_| _ = moved.step(&swing));
    assert_eq!(contacts(moved.record()), 0);
    let there = moved.q(HIP_PITCH);
    moved.load(HIP_PITCH, -0.3 * moved.limit(HIP_PITCH));
    (0..100).for_each(|_| _ = moved.step(&swing));
    moved.load(HIP_PITCH, 0.0);
    (0..2000).for_each(|_| _ = moved.step(&swing));
    let way = there - moved.q(HIP_PITCH);
    assert!(
        (0.5 * back..1.2 * back).contains(&way),
        "{} degrees",
        way.to_degrees()
    );
    assert!(moved.dq(HIP_PITCH).abs() < 0.01);
    assert_eq!(moved.record().fault, Event::ExternalContact.number());

    let mut moved = Moved::new(leg("retract", ""));
    let there = moved.q(KNEE);
    moved.load(KNEE, 0.3 * moved.limit(KNEE));
    moved.rest(500);
    assert_eq!(moved.record().fault, Event::ExternalContact.number());
    let way = (moved.q(KNEE) - there).abs();
    assert!(way < 0.02, "{way} rad");
}
