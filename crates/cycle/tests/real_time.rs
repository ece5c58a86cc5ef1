//! The cycle does not allocate, and depends on its arguments alone.

mod common;

use common::{Bench, client_input, read};
use cycle::ClientInput;
use robot_state::{Event, Mode, Settings};
use test_support::allocations;

#[test]
fn no_cycle_allocates_whatever_happens_in_it() {
    // Drives with latency, sensors with clocks of their own.
    let own_times = Bench::reading("humanoid", &|path| {
        let text = read(path)?;
        let keys = "sampled = \"when_sent\"\nlatency_us = 300";
        Ok(text
            .replace("sigma_N =", &format!("{keys}\nsigma_N ="))
            .replace("gyro = [", &format!("{keys}\ngyro = ["))
            .replace("gear_ratio =", "latency_us = 100\ngear_ratio ="))
    });
    assert!(!own_times.robot.answers().iter().all(|answers| *answers));
    let benches = [
        ("leg", Bench::new("leg")),
        ("humanoid", Bench::new("humanoid")),
        ("humanoid with own times", own_times),
    ];
    for (name, mut bench) in benches {
        let mut total = 0;
        for cycle in 0..400 {
            bench.gather();
            // No answers, invalid frames, a client, a flawed reference: every branch is taken.
            if cycle % 50 == 7 {
                bench.drop_answers(|f| f.id % 2 == 0);
            }
            if cycle % 50 == 8 {
                let mut frame = bench.rx.as_slice()[0];
                frame.len = 1;
                bench.rx.push(frame);
                frame.id = 0x7fe;
                bench.rx.push(frame);
            }
            let mut reference = bench.reference(Mode::InverseDynamics.number(), cycle);
            reference.mode = [
                Mode::Hold.number(),
                Mode::Torque.number(),
                Mode::InverseDynamics.number(),
                Mode::Position.number(),
                Mode::Passive.number(),
                Mode::TorqueFeedbackMotion.number(),
                Mode::Velocity.number(),
                Mode::Stand.number(),
            ][cycle as usize / 20 % 8];
            reference.held_joints = cycle;
            if cycle % 90 == 89 {
                reference.joints[1].dq_d = f64::NAN;
            }
            // Offsets and contact sets change too, sometimes to invalid ones.
            let mut settings = Settings {
                sequence: cycle,
                contact_set: [0, 2, 1, 99][cycle as usize / 30 % 4],
                ..Settings::default()
            };
            settings.ft_offset[0].force[2] = [0.0, 5.0, f64::NAN][cycle as usize / 40 % 3];
            let client = ClientInput {
                settings: Some(&settings),
                ..if cycle % 70 < 60 {
                    client_input(&reference)
                } else {
                    ClientInput::default()
                }
            };
            bench.tx.clear();
            let at = bench.instants();
            let before = allocations();
            bench.cycle.step(at, &bench.rx, &client, &mut bench.tx);
            total += allocations() - before;
        }
        assert_eq!(total, 0, "{name}");
        // The branches were indeed taken.
        let events = bench.cycle.record().events;
        for event in [
            Event::JointMissed,
            Event::FrameWrongLength,
            Event::FrameUnknownId,
            Event::ReferenceNotFinite,
        ] {
            assert!(events[event.index()] > 0, "{name}: {}", event.name());
        }
    }
}

#[test]
fn a_robot_that_balances_allocates_nothing() {
    let mut bench = Bench::new("humanoid");
    bench.run(800);
    let mut reference = bench.reference(Mode::Stand.number(), 1);
    for _ in 0..50 {
        reference.sequence += 1;
        bench.gather();
        bench.tx.clear();
        let at = bench.instants();
        let before = allocations();
        (bench.cycle).step(at, &bench.rx, &client_input(&reference), &mut bench.tx);
        assert_eq!(allocations() - before, 0);
        assert_eq!(bench.cycle.record().mode, Mode::Stand.number());
    }
}

#[test]
fn the_counter_counts() {
    let before = allocations();
    drop(std::hint::black_box(vec![1u8; 100]));
    assert_eq!(allocations() - before, 2);
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    let run = || {
        let mut bench = Bench::new("leg");
        let reference = bench.follow();
        let mut frames = Vec::new();
        for _ in 0..300 {
            bench.step(&client_input(&reference));
            frames.extend(bench.tx.iter().map(|f| (f.id, f.data)));
        }
        (*bench.cycle.record(), frames)
    };
    let (first, second) = (run(), run());
    assert!(first == second);
}
