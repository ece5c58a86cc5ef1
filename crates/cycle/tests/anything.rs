//! Whatever comes in, in whatever order: what leaves is finite, within limits, and only while the
//! robot is enabled; and with everything in order again the operator reaches holding.
//!
//! `CYCLE_STEPS` sets the number of steps (default 60,000; 10,000,000 take some minutes).

mod common;

use can_codec::{EXTENDED_ID, Frame, Frames};
use common::Bench;
use cycle::{ClientInput, Instants, OperatorRequest, Stamp};
use robot_config::slots;
use robot_state::{CycleRecord, Event, MAX_JOINTS, Mode, Reference, RobotState, command_flags};
use test_support::Random;

/// A number that a client may send.
fn any_number(random: &mut Random) -> f64 {
    match random.below(8) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -1e300,
        3 => 0.0,
        4 => 1e3 * (random.symmetric()),
        _ => random.symmetric(),
    }
}

fn any_reference(random: &mut Random, record: &CycleRecord) -> Reference {
    let mut reference = Reference {
        sequence: random.bits() % 4 + record.sequence,
        mode: random.bits() as u32 % 5,
        joint_count: match random.below(20) {
            0 => random.bits() as u32,
            _ => record.joint_count,
        },
        contact_wrench_given: random.bits() as u32 % 2,
        ..Reference::default()
    };
    let near = random.below(20) > 0;
    for j in 0..MAX_JOINTS.min(record.joint_count as usize) {
        let joint = &mut reference.joints[j];
        joint.q_d = record.measured.joints[j].q;
        joint.tau_d = 50.0 * random.symmetric();
        if !near && random.below(3) == 0 {
            joint.q_d += any_number(random);
            joint.dq_d = any_number(random);
            joint.ddq_d = any_number(random);
            joint.tau_d = any_number(random);
        }
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

/// Asserts that the frames carry the record's commands, finite, within limits, to engaged joints alone.
fn check(bench: &Bench, last: &mut [Option<f64>]) {
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
        if state == RobotState::Boot {
            assert!(sent.is_none(), "a set-point in boot");
        }
        let Some(sent) = sent else {
            last[j] = None;
            continue;
        };
        assert!(engaged, "a set-point to joint {j}, which is not engaged");
        let resolution = 1e-4;
        assert!(
            (sent - commanded.q_c).abs() < resolution,
            "{sent} {}",
            commanded.q_c
        );
        let measured = &record.measured.joints[j];
        let theta = measured.theta / parameters.encoders.gear_ratio;
        // Inside, or pulled out by a joint that both encoders show outside.
        let reach = limits.lead + 0.3;
        let low = limits.position_min.min(measured.q.min(theta)) - reach;
        let high = limits.position_max.max(measured.q.max(theta)) + reach;
        assert!((low..=high).contains(&sent), "joint {j}: {sent}");
        last[j] = Some(sent);
    }
}

#[test]
fn whatever_comes_in_what_leaves_is_within_limits_and_the_operator_reaches_holding() {
    let steps: u64 = std::env::var("CYCLE_STEPS").map_or(60_000, |text| text.parse().unwrap());
    let read = |path: &str| {
        let text = common::read(path)?;
        Ok(text.replace("enable = \"automatic\"", "enable = \"operator\""))
    };
    let mut random = Random::new(1);
    let mut bench = Bench::reading("leg", &read);
    let mut last = vec![None; bench.robot.parameters.joints.len()];
    let (mut was_active, mut was_enabled) = (0_u64, false);
    let mut spoiling = false;
    for step in 0..steps {
        // Episodes with good frames let the robot get anywhere; others spoil what can be spoilt.
        if step % 500 == 0 {
            spoiling = random.below(3) == 0;
        }
        bench.gather();
        if spoiling {
            spoil(&mut random, &mut bench.rx, bench.now);
        }
        let record = *bench.cycle.record();
        let reference = any_reference(&mut random, &record);
        let request = any_request(&mut random, &record);
        let input = ClientInput {
            reference: (random.below(4) > 0).then_some(&reference),
            age_s: match random.below(50) {
                0 => any_number(&mut random),
                _ => 0.001,
            },
            settings: None,
            request,
        };
        let at = Instants {
            sync: Stamp(bench.now),
            now: Stamp(bench.now + random.below(900_000) as u64),
        };
        bench.tx.clear();
        bench.cycle.step(at, &bench.rx, &input, &mut bench.tx);
        let mut answers = Frames::default();
        bench.plant.exchange(&bench.tx, bench.now, &mut answers);
        check(&bench, &mut last);
        let now = bench.cycle.record();
        if now.state >= RobotState::Enabling.number() && record.state <= RobotState::Ready.number()
        {
            let asked = matches!(request, Some(OperatorRequest::Enable));
            assert!(asked || now.state == RobotState::Fault.number());
        }
        was_active += u64::from(now.mode != Mode::Hold.number());
        was_enabled |= now.state == RobotState::Holding.number();
    }
    assert!(
        was_enabled && was_active > steps / 200,
        "{was_active} steps in a client's mode"
    );

    // In order again: acknowledged and enabled, it holds.
    for _ in 0..5 {
        let fault = bench.cycle.record().fault;
        if fault != 0 {
            let request = Some(OperatorRequest::Acknowledge(fault));
            bench.step(&ClientInput {
                request,
                ..ClientInput::default()
            });
        }
        bench.run(300);
        let request = Some(OperatorRequest::Enable);
        bench.step(&ClientInput {
            request,
            ..ClientInput::default()
        });
        bench.run(100);
    }
    let record = bench.cycle.record();
    let fault = Event::from_number(record.fault);
    assert_eq!(
        record.state,
        RobotState::Holding.number(),
        "{fault:?} {}",
        record.refusal
    );
}
