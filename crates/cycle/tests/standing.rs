//! A humanoid that stands on both feet: references without contact wrenches, pushes at its chest.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, read, spoil_ft, spoil_source};
use cycle::ClientInput;
use robot_config::slots::Source;
use robot_state::{Event, Mode};
use test_support::Random;

/// Numbers of the drives in the file of the simulation, and the range of the factor by which each is drawn to be another.
const DRAWN: [(&str, [f64; 2]); 4] = [
    ("coulomb_Nm = ", [0.5, 2.0]),
    ("presliding_rad = ", [0.5, 2.0]),
    ("K_4_A_per_rad = ", [0.9, 1.1]),
    ("K_5_As_per_rad = ", [0.9, 1.1]),
];

/// A text of a simulation with other joints: every such number times a factor, of which each decade is as likely.
fn drawn(text: &str, seed: u64) -> String {
    let mut random = Random::new(seed);
    let line = |line: &str| {
        let number = DRAWN.iter().find_map(|(key, range)| {
            let rest = line.strip_prefix(key)?;
            let (number, comment) = rest.split_once(' ').unwrap_or((rest, ""));
            Some((key, range, number.parse::<f64>().unwrap(), comment))
        });
        let Some((key, [least, most], number, comment)) = number else {
            return format!("{line}\n");
        };
        let factor = least * (most / least).powf(0.5 + 0.5 * random.symmetric());
        format!("{key}{:?} {comment}\n", number * factor)
    };
    text.lines().map(line).collect()
}

/// The standing humanoid with other joints whose chest is pushed by `force` (N, world axes) for 0.3 s at 1.5 s.
fn standing(force: [f64; 2], seed: u64) -> Bench {
    let [x, y] = force;
    let push = format!(
        "\n[[push]]\nlink = \"chest_pitch_link\"\nstart_s = 1.5\nduration_s = 0.3\n\
         force_N = [{x:.1}, {y:.1}, 0.0]\n"
    );
    Bench::reading("humanoid", &|path| {
        let text = read(path)?;
        Ok(if path == "config/humanoid/sim.toml" {
            drawn(&text, seed) + &push
        } else {
            text
        })
    })
}

/// What a push did.
#[derive(Debug)]
struct Swayed {
    /// Greatest angular velocity of the base, rad/s.
    fastest: f64,
    /// Sway of the base's orientation over the last second, degrees.
    left: f64,
    /// Angle of the base in the end from where it was when the mode began, degrees.
    off: f64,
}

/// Greatest angle between orientations, degrees.
fn spread(orientations: &[[f64; 4]]) -> f64 {
    let Some(first) = orientations.first() else {
        return 0.0;
    };
    let angle = |q: &[f64; 4]| {
        let dot: f64 = q.iter().zip(first).map(|(a, b)| a * b).sum();
        2.0 * dot.abs().min(1.0).acos().to_degrees()
    };
    orientations.iter().map(angle).fold(0.0, f64::max)
}

/// Stands for `seconds` in a mode, with a reference of which nothing but the pose is set.
fn stand(bench: &mut Bench, mode: Mode, seconds: f64) -> Swayed {
    bench.run(1000);
    let mut reference = bench.reference(mode.number(), 1);
    reference.contact_wrench_given = 0;
    if mode == Mode::Velocity {
        reference
            .joints
            .iter_mut()
            .for_each(|joint| joint.q_d = 0.0);
    }
    let mut swayed = Swayed {
        fastest: 0.0,
        left: 0.0,
        off: 0.0,
    };
    let begun = bench.plant.truth().base_orientation;
    let cycles = (1000.0 * seconds) as usize;
    let mut last = Vec::new();
    for cycle in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        let record = bench.cycle.record();
        let fault = Event::from_number(record.fault);
        assert_eq!(
            record.fault,
            0,
            "{fault:?} {:.3} s in mode",
            1e-3 * cycle as f64
        );
        assert_eq!(
            record.mode,
            mode.number(),
            "{:.3} s in mode",
            1e-3 * cycle as f64
        );
        let truth = bench.plant.truth();
        let [_, _, _, x, y, z] = truth.base_velocity;
        swayed.fastest = swayed.fastest.max((x * x + y * y + z * z).sqrt());
        if cycle + 1000 >= cycles {
            last.push(truth.base_orientation);
        }
    }
    swayed.left = spread(&last);
    swayed.off = spread(&[begun, bench.plant.truth().base_orientation]);
    swayed
}

/// Nobody falls: a wrench that was measured some time before, fed forward, swayed ever more and fell at 30 N.
fn assert_stands(mode: Mode, force: [f64; 2], seed: u64) {
    let swayed = stand(&mut standing(force, seed), mode, 6.8);
    let stands = swayed.fastest < 0.5 && swayed.left < 0.5;
    assert!(stands, "{} {force:?} {seed}: {swayed:?}", mode.name());
    // Without an integral the base stays 0.2 to 0.3 degrees off.
    let upright = mode != Mode::Stand || swayed.off < 0.15;
    assert!(upright, "{force:?} {seed}: {swayed:?}");
}

#[test]
fn it_stands_through_a_push_from_behind() {
    assert_stands(Mode::InverseDynamics, [60.0, 0.0], 1);
}

#[test]
fn it_stands_through_a_push_from_the_front() {
    assert_stands(Mode::Position, [-60.0, 0.0], 2);
}

#[test]
fn it_stands_through_a_push_from_the_right() {
    assert_stands(Mode::InverseDynamics, [0.0, 60.0], 3);
}

#[test]
fn it_stands_through_a_push_from_the_left() {
    assert_stands(Mode::Velocity, [0.0, -30.0], 4);
}

#[test]
fn it_keeps_its_balance_through_a_push_from_behind() {
    assert_stands(Mode::Stand, [60.0, 0.0], 5);
}

#[test]
fn it_keeps_its_balance_through_a_push_from_the_left() {
    assert_stands(Mode::Stand, [0.0, -60.0], 6);
}

/// A leg has no spring: a torque that followed what the sensors show would move it by degrees.
#[test]
fn no_leg_moves_by_an_ft_sensor_that_errs() {
    let mut bench = standing([0.0, 0.0], 1);
    bench.run(1000);
    let mut reference = bench.reference(Mode::Stand.number(), 1);
    let mut motion = None;
    for cycle in 0..4000 {
        bench.gather();
        if cycle >= 2500 {
            let time = 1e-3 * f64::from(cycle - 2500);
            spoil_ft(&mut bench, |axes| {
                axes[0] += 100.0;
                axes[2] += 100.0 * time;
                axes[4] -= 10.0 * time;
            });
            motion
                .get_or_insert_with(|| Motion::of(&bench))
                .take(&bench);
        }
        reference.sequence += 1;
        bench.compute(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, Mode::Stand.number());
    motion.unwrap().assert_small("F/T sensor errs");
}

/// Feet stand still: up that turns under both of them is the IMU's, and no leg follows it.
#[test]
fn no_leg_moves_by_an_accelerometer_that_errs() {
    let mut bench = standing([0.0, 0.0], 2);
    bench.run(1000);
    let mut reference = bench.reference(Mode::Stand.number(), 1);
    let mut motion = None;
    for cycle in 0..5000 {
        bench.gather();
        if cycle >= 2500 {
            spoil_source(&mut bench, Source::Imu(0), |axes| axes[4] += 1.0);
            motion
                .get_or_insert_with(|| Motion::of(&bench))
                .take(&bench);
        }
        reference.sequence += 1;
        bench.compute(&client_input(&reference));
    }
    let record = bench.cycle.record();
    assert_eq!(record.mode, Mode::Hold.number());
    assert_eq!(record.commander.cause, Event::ReferenceRejected.number());
    motion.unwrap().assert_small("accelerometer errs");
}

/// The standing humanoid in mode stand, until the mode ends or for so many cycles; the cycles.
fn until_it_ends(bench: &mut Bench, cycles: usize) -> usize {
    bench.run(1000);
    let mut reference = bench.reference(Mode::Stand.number(), 1);
    for cycle in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        if bench.cycle.record().mode != Mode::Stand.number() {
            // The record explains it in the next cycle.
            bench.step(&client_input(&reference));
            return cycle;
        }
    }
    cycles
}

#[test]
fn what_its_feet_cannot_hold_ends_the_mode_by_name() {
    // Pushed at 0.5 s in the mode by what would throw a person.
    let mut bench = standing([300.0, 0.0], 1);
    let ended = until_it_ends(&mut bench, 2000);
    assert!((600..1500).contains(&ended), "{ended}");
    let record = bench.cycle.record();
    assert_eq!(record.fault, 0, "{}", record.fault);
    assert_eq!(record.events[Event::ReferenceRejected.index()], 1);
    assert_eq!(record.commander.cause, Event::ReferenceRejected.number());
}

/// Changes the six signals of an F/T sensor.
type Spoil = fn(&mut [f64; 6]);

/// Wrenches that do not carry the robot: to balance by them would make it sway by degrees.
#[test]
fn it_does_not_begin_to_balance_by_an_ft_sensor_that_has_erred_before() {
    let spoils: [(&str, Spoil); 3] = [
        ("force along", |axes| axes[2] += 80.0),
        ("force across", |axes| axes[0] -= 80.0),
        ("moment", |axes| axes[5] += 20.0),
    ];
    for (name, spoil) in spoils {
        let mut bench = standing([0.0, 0.0], 3);
        bench.run(500);
        let mut motion = Motion::of(&bench);
        let mut reference = bench.reference(Mode::Stand.number(), 1);
        for cycle in 0..1500 {
            bench.gather();
            spoil_ft(&mut bench, spoil);
            reference.sequence += 1;
            let client = client_input(&reference);
            if cycle < 1000 {
                bench.compute(&ClientInput::default())
            } else {
                bench.compute(&client)
            };
            motion.take(&bench);
        }
        let record = bench.cycle.record();
        assert_eq!(record.mode, Mode::Hold.number(), "{name}");
        assert_eq!(record.fault, 0, "{name}");
        let refused = Event::ReferenceRejected.number();
        assert_eq!(record.commander.cause, refused, "{name}");
        motion.assert_small(name);
    }
}

#[test]
fn a_robot_whose_soles_are_not_known_does_not_have_the_mode() {
    let mut bench = Bench::reading("humanoid", &|path| {
        let text = read(path)?;
        let known = text
            .lines()
            .filter(|line| !line.starts_with("sole_corners_m"));
        Ok(known.map(|line| format!("{line}\n")).collect())
    });
    let lacks = bench.robot.cannot_stand().unwrap().to_string();
    assert!(lacks.contains("sole_corners_m"), "{lacks}");
    assert_eq!(until_it_ends(&mut bench, 10), 0);
    assert_eq!(
        bench.cycle.record().possible_modes >> Mode::Stand.number() & 1,
        0
    );
}
