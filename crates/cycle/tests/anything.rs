//! Whatever comes in, in whatever order: what leaves is finite, within limits, and only while the
//! robot is enabled; and with everything in order again the operator reaches holding.
//!
//! Several robots live one life after another, each from being switched on, some with a fault of an
//! earlier run: position and current drives, prismatic joints and one that follows another, with states by CiA 402 and without, enabled by an
//! operator or by themselves. Spoilt are frames and their stamps, references, settings, operators'
//! requests, cycles that are left out, commands that do not arrive, and the drives; encoders and F/T sensors
//! lie for a while, two of them at once now and then. In some lives clients send trajectories ahead, through the
//! lease; their pieces, sessions and silences are spoilt too. In others they lead frames in mode Cartesian, free
//! or pressing on something, which may let go.
//!
//! `CYCLE_STEPS` sets the number of steps in all lives (default 60,000; 10,000,000 take a quarter of an hour in
//! release), `CYCLE_SEED` the random numbers. A life that fails says how it alone is repeated: by `CYCLE_LIFE`,
//! its place among the robots, and a seed.

#[path = "anything/check.rs"]
mod check;
#[path = "anything/clients.rs"]
mod clients;
use crate::common;
#[path = "anything/faults.rs"]
mod faults;

use can_codec::Frames;
use check::{Before, check};
use clients::{Ahead, Leading, any_reference};
use common::{Bench, any_number, client_input};
use cycle::{ClientInput, Instants, OperatorRequest, Stamp};
use faults::{Lie, mend_drives, spoil, spoil_drive};
use robot_state::{
    CommanderRecord, CycleRecord, Event, Mode, Reference, RobotState, Settings, refusal,
};
use test_support::Random;

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

/// The foot is held by something stiff.
const CLAMPED: &str = "
[harness]
link = \"foot\"
stiffness_N_per_m = 6e5
damping_Ns_per_m = 2e3
stiffness_Nm_per_rad = 5e3
damping_Nms_per_rad = 15.0
";

/// A joint for whose sake it is not enabled, since it was left beyond a position limit, is moved inside by hand; by
/// its drive's own tool where that has no states and keeps its last set-point.
fn move_inside(bench: &mut Bench) {
    let refusal = bench.cycle.record().refusal;
    if refusal >> 16 != refusal::OUTSIDE {
        return;
    }
    let joint = (refusal & 0xffff) as usize;
    let parameters = &bench.robot.parameters.joints[joint];
    let (limits, inside_by) = (parameters.limits, parameters.kind.threshold(0.02));
    let q = |bench: &Bench| bench.plant.truth().joints[joint].q;
    let inwards = if q(bench) < limits.position_min {
        1.0
    } else {
        -1.0
    };
    let allowed = limits.position_min + inside_by..limits.position_max - inside_by;
    let by_position = parameters.takes_position();
    let holds_itself = by_position && bench.plant.drive_states(joint).is_none();
    let step = inwards * parameters.kind.threshold(0.002);
    for percent in 0..100 {
        let robot = bench.plant.robot_mut();
        if holds_itself {
            robot.command(joint, robot.set_point(joint) + step)
        } else {
            robot.set_load(joint, inwards * limits.torque * f64::from(percent) / 100.0)
        }
        bench.run(20);
        if allowed.contains(&q(bench)) {
            break;
        }
    }
    bench.plant.robot_mut().set_load(joint, 0.0);
    bench.run(300);
}

/// Who commands the robot in a life.
enum Client {
    /// A message of any kind in each cycle.
    Any,
    Ahead(Box<Ahead>),
    Leading(Box<Leading>),
}

/// One robot, and what came of it.
struct Life {
    bench: Bench,
    client: Client,
    automatic: bool,
    clamped: bool,
    active: u64,
    enabled: bool,
}

impl Life {
    /// The `index`-th robot, as it is switched on.
    fn new(index: u64, random: &mut Random) -> Self {
        let automatic = random.below(4) == 0;
        let robot = match index % 10 {
            3 | 6 => "test-joint",
            5 | 8 => "lift-gripper",
            9 => "humanoid",
            _ => "leg",
        };
        let with_states = random.below(4) > 0;
        let clamped = index % 10 == 7;
        let read = |path: &str| {
            let text = match robot {
                "test-joint" => common::read_with_current_drive(path)?,
                _ => common::read(path)?,
            };
            if path.ends_with("humanoid/sim.toml") {
                return Ok(hung(&text));
            }
            if clamped && path.ends_with("leg/sim.toml") {
                return Ok(text + CLAMPED);
            }
            if !path.ends_with("robot.toml") {
                return Ok(text);
            }
            let text = if automatic {
                text
            } else {
                text.replace("enable = \"automatic\"", "enable = \"operator\"")
            };
            let lines = text.split_inclusive('\n');
            Ok(if with_states {
                text
            } else {
                lines.filter(|l| !l.starts_with("control = {")).collect()
            })
        };
        let mut bench = Bench::reading(robot, &read);
        if random.below(4) == 0 {
            let events = [Event::EncoderImplausible, Event::LoopEnded, Event::BusDown];
            bench.cycle.start_with_fault(events[random.below(3)]);
        }
        Self {
            client: match index % 10 {
                2 | 7 => Client::Leading(Box::new(Leading::new(&bench))),
                1 | 3 | 5 | 9 => Client::Ahead(Box::new(Ahead::new(&bench))),
                _ => Client::Any,
            },
            bench,
            automatic,
            clamped,
            active: 0,
            enabled: false,
        }
    }

    fn live(&mut self, steps: u64, random: &mut Random) {
        let bench = &mut self.bench;
        let mut before = vec![Before::default(); bench.robot.parameters.joints.len()];
        let mut older = Reference::default();
        let mut spoiling = false;
        let mut lies: Vec<Lie> = Vec::new();
        for step in 0..steps {
            // Episodes with good frames let the robot get anywhere; others spoil what can be spoilt.
            if step % 500 == 0 {
                spoiling = random.below(3) == 0;
                mend_drives(bench);
                let liars = if spoiling { random.below(3) } else { 0 };
                lies.clear();
                lies.extend((0..liars).map(|_| Lie::new(random, bench)));
            }
            let leads = matches!(self.client, Client::Leading(_));
            if spoiling && leads && random.below(5_000) == 0 {
                bench.plant.robot_mut().release_harness();
            }
            if spoiling && random.below(300) == 0 {
                spoil_drive(random, bench);
            }
            if random.below(500) == 0 {
                // Cycles that are left out.
                (0..random.below(12)).for_each(|_| bench.gather());
            }
            bench.gather();
            for lie in &mut lies {
                lie.apply(bench);
            }
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
            let led;
            let input = match &mut self.client {
                Client::Ahead(ahead) => {
                    ahead.cycle(random, bench.now, &record, &reference);
                    ClientInput {
                        settings,
                        request,
                        ..ahead.input(bench.now)
                    }
                }
                Client::Leading(leading) => {
                    led = leading.cycle(random, &record);
                    ClientInput {
                        reference: Some(&led.0),
                        age_s: led.1,
                        settings,
                        request,
                        ..ClientInput::default()
                    }
                }
                Client::Any => ClientInput {
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
        if self.clamped {
            // Jammed there, the foot may press its F/T sensor beyond its range, and no mode needs that.
            bench.plant.robot_mut().release_harness();
        }
        for _ in 0..5 {
            let fault = bench.cycle.record().fault;
            if fault != 0 {
                bench.ask(OperatorRequest::Acknowledge(fault));
            }
            bench.run(300);
            bench.ask(OperatorRequest::Enable);
            bench.run(100);
            move_inside(bench);
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
        let record = *bench.step(&client_input(&reference));
        assert_eq!(
            record.mode,
            Mode::Torque.number(),
            "{}: {:?}, possible {:#x}, state {}, {:?}",
            self.bench.robot.parameters.name,
            Event::from_number(record.commander.cause),
            record.possible_modes,
            record.state,
            self.unusable()
        );
    }
}

#[test]
#[expect(
    clippy::disallowed_macros,
    reason = "which life it was, shown where one fails"
)]
fn whatever_comes_in_what_leaves_is_within_limits_and_the_operator_reaches_holding() {
    let number = |key: &str, or: u64| std::env::var(key).map_or(or, |text| text.parse().unwrap());
    let steps = number("CYCLE_STEPS", 60_000);
    let mut random = Random::new(number("CYCLE_SEED", 1));
    let first = number("CYCLE_LIFE", 0);
    let (mut done, mut index) = (0, first);
    let (mut active, mut enabled, mut led, mut frames) = (0, 0, 0, 0);
    while done < steps {
        // Long lives reach what takes long; a run of the tests has short ones.
        let life = (steps / 10).min(20_000);
        let seed = random.seed();
        println!(
            "CYCLE_LIFE={index} CYCLE_SEED={seed} CYCLE_STEPS={}",
            10 * life
        );
        let mut robot = Life::new(index, &mut random);
        robot.live(life, &mut random);
        robot.recover();
        (active, enabled) = (active + robot.active, enabled + u64::from(robot.enabled));
        match &robot.client {
            Client::Ahead(ahead) => led += ahead.led,
            Client::Leading(leading) => frames += leading.led,
            Client::Any => {}
        }
        (done, index) = (done + life, index + 1);
    }
    assert!(
        enabled > (index - first) / 2 && active > done / 200,
        "{enabled} of {} lives held, {active} of {done} steps in a client's mode",
        index - first
    );
    assert!(
        led > done / 400,
        "{led} of {done} steps on trajectories sent ahead"
    );
    assert!(
        frames > done / 100,
        "{frames} of {done} steps leading frames"
    );
}
