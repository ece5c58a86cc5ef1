//! Whatever comes in, in whatever order: what leaves is finite, within limits, and only while the
//! robot is enabled; and with everything in order again the operator reaches holding.
//!
//! Several robots live one life after another, each from being switched on, some with a fault of an
//! earlier run: position and current drives, with states by CiA 402 and without, enabled by an
//! operator or by themselves. Spoilt are frames and their stamps, references, settings, operators'
//! requests, cycles that are left out, commands that do not arrive, and the drives. In every other life
//! clients send trajectories ahead, through the lease; their pieces, sessions and silences are spoilt too.
//!
//! `CYCLE_STEPS` sets the number of steps in all lives (default 60,000; 10,000,000 take a quarter of an
//! hour in release), `CYCLE_SEED` the random numbers.

mod anything_ahead;
mod common;

use anything_ahead::{Ahead, any_number};
use can_codec::{EXTENDED_ID, Frame, Frames};
use common::{Bench, client_input};
use cycle::{ClientInput, Instants, OperatorRequest, Stamp};
use plant::DriveError;
use robot_config::slots;
use robot_state::{
    CommanderRecord, CycleRecord, Event, MAX_JOINTS, Mode, Reference, RobotState, Settings,
    command_flags,
};
use supervisor::Actuation;
use test_support::Random;

fn any_reference(random: &mut Random, record: &CycleRecord) -> Reference {
    let mut reference = Reference {
        sequence: random.bits() % 4 + record.sequence,
        mode: random.bits() as u32 % 5,
        joint_count: match random.below(20) {
            0 => random.bits() as u32,
            _ => record.joint_count,
        },
        contact_wrench_given: random.bits() as u32 % 2,
        gains_given: random.bits() as u32 % 2,
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
    reference
}

fn any_request(random: &mut Random, record: &CycleRecord) -> Option<OperatorRequest> {
    Some(match random.below(600) {
        0 => OperatorRequest::Disable,
        1 => OperatorRequest::Stop,
        2..40 => OperatorRequest::Enable,
        40..80 => OperatorRequest::Acknowledge(record.fault),
        80 => OperatorRequest::Acknowledge(random.bits() as u32),
        _ => return None,
    })
}

fn any_settings(random: &mut Random) -> Settings {
    let mut settings = Settings {
        sequence: random.bits() % 8,
        contact_set: random.bits() as u32 % 6,
        ..Settings::default()
    };
    if random.below(10) == 0 {
        settings.ft_offset[0].torque[1] = any_number(random);
    }
    settings
}

/// Spoils the answers of one cycle in some way.
fn spoil(random: &mut Random, rx: &mut Frames, now: u64) {
    let frames: Vec<Frame> = rx.iter().copied().collect();
    rx.clear();
    for mut frame in frames {
        match random.below(40) {
            0 => continue,
            1 => frame.data[random.below(8)] ^= 1 << random.below(8),
            2 => frame.data[..8].fill_with(|| random.bits() as u8),
            3 => frame.len = random.below(9) as u8,
            4 => frame.id = random.bits() as u32,
            5 => frame.error = true,
            6 => frame.stamp_ns = random.bits(),
            7 => frame.stamp_ns = now.saturating_sub(random.below(5_000_000) as u64),
            8 => _ = rx.push(frame),
            _ => {}
        }
        rx.push(frame);
    }
    if random.below(10) == 0 {
        rx.push(Frame::zeroed(
            1,
            random.bits() as u32 | EXTENDED_ID,
            8,
            true,
        ));
    }
}

/// Changes something about one drive.
fn spoil_drive(random: &mut Random, bench: &mut Bench) {
    let joint = random.below(bench.robot.parameters.joints.len());
    let Some(states) = bench.plant.drive_states(joint) else {
        return;
    };
    match random.below(5) {
        0 => states.set_power(random.below(2) == 0),
        1 => states.set_cause(Some(DriveError::OverCurrent)),
        2 => states.set_cause(None),
        3 => states.set_refuses(random.below(2) == 0),
        _ => states.set_step_time(random.unit() * 0.1),
    }
}

fn mend_drives(bench: &mut Bench) {
    for joint in 0..bench.robot.parameters.joints.len() {
        if let Some(states) = bench.plant.drive_states(joint) {
            states.set_power(true);
            states.set_cause(None);
            states.set_refuses(false);
            states.set_step_time(2e-3);
        }
    }
}

/// The signals' resolution and rounding, in the commands' units.
const RESOLUTION: f64 = 1.1e-3;

/// What was sent to a joint before.
#[derive(Debug, Clone, Copy, Default)]
struct Before {
    /// The set-point, rad.
    q_c: Option<f64>,
    /// Cycles in a row for which it was held.
    held: u32,
}

/// Cycles within which a joint that is held has come to rest: half of pi times 0.2 s from its velocity
/// limit.
const AT_REST: u32 = 350;
/// Share of the velocity limit at which a set-point at rest gives way.
const YIELDS: f64 = 0.03;

impl Before {
    /// A held set-point may lead a joint that is pulled away from it by any angle: it may itself move no
    /// faster than the joint may while it comes to rest, and then only give way.
    fn holds(&self, q_c: f64, velocity: f64) -> bool {
        let share = if self.held < AT_REST { 1.0 } else { YIELDS };
        let step = share * velocity * 1e-3 + 1e-9;
        self.q_c.is_some_and(|last| (q_c - last).abs() <= step)
    }
}

/// What has left is what the record shows, finite, within limits, and only to engaged joints.
fn check(bench: &Bench, before: &mut [Before]) {
    let record = bench.cycle.record();
    let state = RobotState::from_number(record.state).expect("a state");
    let table = &bench.robot.send;
    let mut values = vec![f64::NAN; slots::send_len(&bench.robot.parameters)];
    for frame in bench.tx.iter() {
        table
            .decode(frame, &mut values)
            .expect("a frame of the robot's");
    }
    for (j, parameters) in bench.robot.parameters.joints.iter().enumerate() {
        let (commanded, limits) = (&record.commanded.joints[j], &parameters.limits);
        let engaged = commanded.flags & command_flags::ENGAGED != 0;
        let sent = Some(values[slots::command(j)]).filter(|x| !x.is_nan());
        assert!(commanded.q_c.is_finite() && commanded.delta_q.is_finite());
        assert!(commanded.current_c.is_finite());
        let takes_current = matches!(parameters.actuation, Actuation::Current { .. });
        if matches!(state, RobotState::Boot) {
            // No current is no set-point.
            let none = sent.is_none() || takes_current && sent == Some(0.0);
            assert!(none, "a set-point in boot");
        }
        let last = std::mem::take(&mut before[j]);
        let Some(sent) = sent else {
            continue;
        };
        let measured = &record.measured.joints[j];
        if !engaged {
            // No current; or its place in a message that an engaged joint needs, and no torque.
            let table = &bench.robot.send;
            let messages = (0..table.message_count()).map(|m| table.slots(m).collect::<Vec<_>>());
            let mut its = messages.filter(|slots| slots.contains(&slots::command(j)));
            let needed = its.any(|slots| {
                let joints = record.commanded.joints.iter().enumerate();
                let mut engaged = joints.filter(|(_, c)| c.flags & command_flags::ENGAGED != 0);
                engaged.any(|(other, _)| slots.contains(&slots::command(other)))
            });
            let profile = parameters.drive_profile.as_ref();
            let off = profile.is_some_and(|profile| profile.control.is_some());
            let harmless = match takes_current {
                true => sent == 0.0,
                false => needed && off && (sent - measured.q).abs() < RESOLUTION,
            };
            assert!(harmless, "{sent} to joint {j}, which is not engaged");
            continue;
        }
        match parameters.actuation {
            Actuation::Position {
                k_tau,
                k_tau_motor,
                k_v,
            } => {
                assert!((sent - commanded.q_c).abs() < RESOLUTION, "{sent}");
                let theta = measured.theta / parameters.encoders.gear_ratio;
                // Inside, or pulled out by a joint that both encoders show outside.
                let reach = limits.lead + 0.3;
                let low = limits.position_min.min(measured.q.min(theta)) - reach;
                let high = limits.position_max.max(measured.q.max(theta)) + reach;
                assert!((low..=high).contains(&sent), "joint {j}: {sent}");
                // By one encoder at least it asks for no more than the torque limit.
                let dq = measured.dq.abs();
                let lead = |k: f64| (k * limits.torque).min(limits.lead) + k_v * dq + RESOLUTION;
                let within = (sent - measured.q).abs() <= lead(k_tau)
                    || (sent - theta).abs() <= lead(k_tau_motor)
                    || (sent - measured.q) * (sent - theta) < 0.0;
                let holds = record.mode == Mode::Hold.number();
                let kept = commanded.flags & command_flags::NOT_FINITE != 0
                    || holds && last.holds(commanded.q_c, limits.velocity);
                before[j] = Before {
                    q_c: Some(commanded.q_c),
                    held: if holds { last.held + 1 } else { 0 },
                };
                assert!(
                    within || kept,
                    "{}, joint {j}: {sent} leads too far: {state:?}, mode {}, q {}, theta {theta}, \
                     {commanded:?} after {last:?}, flags {:#x}",
                    bench.robot.parameters.name,
                    record.mode,
                    measured.q,
                    measured.flags
                );
            }
            Actuation::Current { k_1, current, .. } => {
                assert!((sent - commanded.current_c).abs() < RESOLUTION, "{sent}");
                let most = current.min(limits.torque / k_1) + RESOLUTION;
                assert!(sent.abs() <= most, "joint {j}: {sent} A");
            }
        }
    }
}

/// The humanoid hangs in its harness. Nobody balances it here: standing it falls, through the floor, which its feet
/// alone touch, and swings from them; their blows on the floor are more than an ankle's encoders can separate from a
/// slip, so that 210 is latched again and again.
fn hung(sim: &str) -> String {
    let hung = sim.replace("on_ground = true", "base_position_m = [0.0, 0.0, 1.2]");
    assert_ne!(sim, hung);
    hung + "
[harness]
link = \"chest_pitch_link\"
stiffness_N_per_m = 5e4
damping_Ns_per_m = 2e3
stiffness_Nm_per_rad = 5e3
damping_Nms_per_rad = 200.0
"
}

/// One robot, and what came of it.
struct Life {
    bench: Bench,
    /// The client that sends trajectories ahead, in a life that has one.
    ahead: Option<Ahead>,
    automatic: bool,
    active: u64,
    enabled: bool,
}

impl Life {
    /// The `index`-th robot, as it is switched on.
    fn new(index: u64, random: &mut Random) -> Self {
        let automatic = random.below(4) == 0;
        let robot = match index % 10 {
            3 | 6 => "test-joint",
            9 => "humanoid",
            _ => "leg",
        };
        let with_states = random.below(4) > 0;
        let read = |path: &str| {
            let text = match robot {
                "test-joint" => common::read_with_current_drive(path)?,
                _ => common::read(path)?,
            };
            if path.ends_with("humanoid/sim.toml") {
                return Ok(hung(&text));
            }
            if !path.ends_with("robot.toml") {
                return Ok(text);
            }
            let text = match automatic {
                true => text,
                false => text.replace("enable = \"automatic\"", "enable = \"operator\""),
            };
            let lines = text.split_inclusive('\n');
            Ok(match with_states {
                true => text,
                false => lines.filter(|l| !l.starts_with("control = {")).collect(),
            })
        };
        let mut bench = Bench::reading(robot, &read);
        if random.below(4) == 0 {
            let events = [Event::EncoderImplausible, Event::LoopEnded, Event::BusDown];
            bench.cycle.start_with_fault(events[random.below(3)]);
        }
        Self {
            ahead: (index % 2 == 1).then(|| Ahead::new(&bench)),
            bench,
            automatic,
            active: 0,
            enabled: false,
        }
    }

    fn live(&mut self, steps: u64, random: &mut Random) {
        let bench = &mut self.bench;
        let mut before = vec![Before::default(); bench.robot.parameters.joints.len()];
        let mut older = Reference::default();
        let mut spoiling = false;
        for step in 0..steps {
            // Episodes with good frames let the robot get anywhere; others spoil what can be spoilt.
            if step % 500 == 0 {
                spoiling = random.below(3) == 0;
                mend_drives(bench);
            }
            if spoiling && random.below(300) == 0 {
                spoil_drive(random, bench);
            }
            if random.below(500) == 0 {
                // Cycles that are left out.
                (0..random.below(12)).for_each(|_| bench.gather());
            }
            bench.gather();
            if spoiling {
                spoil(random, &mut bench.rx, bench.now);
            }
            let record = *bench.cycle.record();
            let mut reference = any_reference(random, &record);
            if random.below(30) == 0 {
                std::mem::swap(&mut reference, &mut older);
            }
            let settings = any_settings(random);
            let request = any_request(random, &record);
            let settings = (random.below(4) == 0).then_some(&settings);
            let input = match &mut self.ahead {
                Some(ahead) => {
                    ahead.cycle(random, bench.now, &record, &reference);
                    ClientInput {
                        settings,
                        request,
                        ..ahead.input(bench.now)
                    }
                }
                None => ClientInput {
                    reference: (random.below(4) > 0).then_some(&reference),
                    age_s: match random.below(50) {
                        0 => any_number(random),
                        _ => 0.001,
                    },
                    commander: CommanderRecord {
                        refused: random.below(5) as u32,
                        replaced: u32::from(random.below(1000) == 0),
                        ..CommanderRecord::default()
                    },
                    settings,
                    request,
                },
            };
            if random.below(20_000) == 0 {
                let event = [Event::LatenessLasts, Event::LateCycle, Event::BusDown];
                bench.cycle.note(event[random.below(3)], 1);
            }
            let at = Instants {
                sync: Stamp(bench.now),
                now: Stamp(bench.now + random.below(900_000) as u64),
            };
            bench.tx.clear();
            bench.cycle.step(at, &bench.rx, &input, &mut bench.tx);
            if !spoiling || random.below(10) > 0 {
                let mut answers = Frames::default();
                bench.plant.exchange(&bench.tx, bench.now, &mut answers);
            }
            check(bench, &mut before);
            let now = bench.cycle.record();
            let ready = RobotState::Ready.number();
            if now.state >= RobotState::Enabling.number() && record.state <= ready {
                let asked = matches!(request, Some(OperatorRequest::Enable));
                assert!(asked || self.automatic || now.state == RobotState::Fault.number());
            }
            self.active += u64::from(now.mode != Mode::Hold.number());
            self.enabled |= now.state == RobotState::Holding.number();
        }
    }

    /// Joints that cannot be used: flags, age (s), torsion (rad), true torsion (rad).
    fn unusable(&self) -> Vec<(usize, u32, f64, f64, f64)> {
        let (record, truth) = (self.bench.cycle.record(), self.bench.plant.truth());
        let joints = record.measured.joints.iter().zip(&truth.joints).enumerate();
        joints
            .filter(|(_, (measured, _))| measured.flags != 0)
            .map(|(j, (measured, truth))| {
                let n = self.bench.robot.parameters.joints[j].encoders.gear_ratio;
                let torsion = truth.theta / n - truth.q;
                (j, measured.flags, measured.age_s, measured.torsion, torsion)
            })
            .collect()
    }

    /// Everything is in order again: acknowledged and enabled, it holds.
    fn recover(&mut self) {
        let bench = &mut self.bench;
        mend_drives(bench);
        for _ in 0..5 {
            let fault = bench.cycle.record().fault;
            if fault != 0 {
                bench.ask(OperatorRequest::Acknowledge(fault));
            }
            bench.run(300);
            bench.ask(OperatorRequest::Enable);
            bench.run(100);
        }
        let record = *bench.cycle.record();
        let fault = Event::from_number(record.fault);
        assert_eq!(
            record.state,
            RobotState::Holding.number(),
            "{fault:?} {:#x} {:?} {:?}",
            record.refusal,
            self.unusable(),
            self.bench
                .plant
                .truth()
                .joints
                .iter()
                .map(|j| j.q)
                .collect::<Vec<_>>()
        );
        // And a client is followed that asks for hold first.
        let mut reference = bench.reference(Mode::Hold.number(), record.sequence + 100);
        bench.step(&client_input(&reference));
        (reference.mode, reference.sequence) = (Mode::Torque.number(), reference.sequence + 1);
        let record = bench.step(&client_input(&reference));
        assert_eq!(record.mode, Mode::Torque.number());
    }
}

#[test]
fn whatever_comes_in_what_leaves_is_within_limits_and_the_operator_reaches_holding() {
    let number = |key: &str, or: u64| std::env::var(key).map_or(or, |text| text.parse().unwrap());
    let steps = number("CYCLE_STEPS", 60_000);
    let mut random = Random::new(number("CYCLE_SEED", 1));
    let (mut done, mut index) = (0, 0);
    let (mut active, mut enabled, mut led) = (0, 0, 0);
    while done < steps {
        // Long lives reach what takes long; a run of the tests has short ones.
        let life = (steps / 10).min(20_000);
        let mut robot = Life::new(index, &mut random);
        robot.live(life, &mut random);
        robot.recover();
        (active, enabled) = (active + robot.active, enabled + u64::from(robot.enabled));
        led += robot.ahead.as_ref().map_or(0, |ahead| ahead.led);
        (done, index) = (done + life, index + 1);
    }
    assert!(
        enabled > index / 2 && active > done / 200,
        "{enabled} of {index} lives held, {active} of {done} steps in a client's mode"
    );
    assert!(
        led > done / 400,
        "{led} of {done} steps on trajectories sent ahead"
    );
}
