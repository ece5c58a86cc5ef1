//! A humanoid that lifts its feet in mode stand.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, spoil_ft, spoil_source};
use control::Stepping;
use robot_config::slots::Source;
use robot_state::{Event, Mode, Reference};

/// Bits of the F/T sensors of the left and the right foot.
const LEFT: u32 = 1;
const RIGHT: u32 = 2;
const RISE_M: f64 = 0.03;

/// The humanoid holds; a reference of mode stand, and steps from its pose.
fn begun() -> (Bench, Reference, Stepping) {
    let mut bench = Bench::new("humanoid");
    bench.run(1000);
    let reference = bench.reference(Mode::Stand.number(), 1);
    let joints = (reference.joints.iter()).take(bench.robot.parameters.joints.len());
    let pose: Vec<f64> = joints.map(|joint| joint.q_d).collect();
    let stepping = bench.robot.stepping(&pose, RISE_M).unwrap();
    (bench, reference, stepping)
}

/// A cycle of the client that steps.
fn step(bench: &mut Bench, reference: &mut Reference, stepping: &mut Stepping) {
    let on = bench.cycle.record().commanded.stands_on;
    assert!(
        stepping.update(on, reference, 1e-3),
        "a foot is awaited in vain"
    );
    reference.sequence += 1;
    bench.step(&client_input(reference));
}

/// Angle between the base's orientations, degrees.
fn turned(bench: &Bench, begun: &[f64; 4]) -> f64 {
    let now = bench.plant.truth().base_orientation;
    let dot: f64 = now.iter().zip(begun).map(|(a, b)| a * b).sum();
    2.0 * dot.abs().min(1.0).acos().to_degrees()
}

#[test]
fn it_steps_in_place() {
    let (mut bench, mut reference, mut stepping) = begun();
    let begun = bench.plant.truth().base_orientation;
    // Greatest angle of the base, and cycles in which a foot in the air bore nothing.
    let (mut most, mut free) = (0.0_f64, [0; 2]);
    for _ in 0..18_000 {
        step(&mut bench, &mut reference, &mut stepping);
        let record = bench.cycle.record();
        assert_eq!((record.fault, record.mode), (0, Mode::Stand.number()));
        most = most.max(turned(&bench, &begun));
        for (foot, free) in free.iter_mut().enumerate() {
            let in_air = record.commanded.stands_on >> foot & 1 == 0;
            let load = record.estimated.ft[foot].contact_wrench.force[2];
            *free += i32::from(in_air && load.abs() < 5.0);
        }
    }
    assert!(stepping.steps() >= 4, "{} steps", stepping.steps());
    assert!(
        most > 0.3 && most < 3.0,
        "the base turned by {most} degrees"
    );
    assert!(free.iter().all(|cycles| *cycles > 1000), "{free:?}");
}

/// The robot on one foot: the other one is lifted, and stays in the air.
fn on_one_foot(lifted: u32) -> (Bench, Reference) {
    let (mut bench, mut reference, _) = begun();
    reference.lifted_feet = lifted;
    for _ in 0..5000 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    let on = bench.cycle.record().commanded.stands_on;
    assert_eq!(on, u64::from(3 - lifted), "it stands on the other foot");
    (bench, reference)
}

#[test]
fn it_stands_on_one_foot() {
    for lifted in [LEFT, RIGHT] {
        let (mut bench, mut reference) = on_one_foot(lifted);
        let begun = bench.plant.truth().base_orientation;
        let mut motion = Motion::of(&bench);
        for _ in 0..3000 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        assert_eq!(bench.cycle.record().mode, Mode::Stand.number());
        assert!(turned(&bench, &begun) < 0.3, "{}", turned(&bench, &begun));
        // The foot rolls on a floor that gives way: a body that is believed to move with it swings by 0.6 degrees.
        let way = motion.displacement_deg();
        assert!(way < 0.3, "{lifted}: {way} degrees");
    }
}

/// A sensor that shows a load under a foot that the client still lifts, and an IMU that errs, move no leg.
#[test]
fn on_one_foot_sensors_that_err_move_no_leg() {
    type Spoil = fn(&mut Bench);
    let cases: [(&str, Spoil); 3] = [
        ("the lifted foot's sensor", |bench| {
            spoil_ft(bench, |axes| axes[2] += 200.0)
        }),
        ("the accelerometer", |bench| {
            spoil_source(bench, Source::Imu(0), |axes| axes[4] += 1.0);
        }),
        ("the gyroscope", |bench| {
            spoil_source(bench, Source::Imu(0), |axes| axes[0] += 0.1);
        }),
    ];
    for (what, spoil) in cases {
        let (mut bench, mut reference) = on_one_foot(LEFT);
        let mut motion = Motion::of(&bench);
        for _ in 0..3000 {
            bench.gather();
            spoil(&mut bench);
            reference.sequence += 1;
            bench.compute(&client_input(&reference));
            motion.take(&bench);
            assert_ne!(bench.cycle.record().commanded.stands_on, 3, "{what}");
        }
        motion.assert_small(what);
    }
}

#[test]
fn the_last_foot_is_not_lifted() {
    let (mut bench, mut reference, _) = begun();
    for lifted in [3, 1 << 7] {
        reference.lifted_feet = lifted;
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        bench.step(&client_input(&reference));
        let record = bench.cycle.record();
        assert_eq!(
            record.commander.cause,
            Event::ReferenceLimit.number(),
            "{lifted}"
        );
        assert_ne!(record.mode, Mode::Stand.number());
    }
}

/// When a fault begins: the robot leans over to the other foot, one is in the air, it has just come down.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Leans,
    InAir,
    CameDown,
}

/// The client steps until the left foot is in this phase.
fn until(phase: Phase, bench: &mut Bench, reference: &mut Reference, stepping: &mut Stepping) {
    let (mut lifted, mut cycles) = (false, 0);
    for _ in 0..12_000 {
        let stands = bench.cycle.record().commanded.stands_on & 1 == 1;
        let asked = reference.lifted_feet & LEFT != 0;
        lifted |= !stands;
        let is_in = match phase {
            Phase::Leans => asked && stands,
            Phase::InAir => !stands,
            Phase::CameDown => lifted && stands,
        };
        cycles = if is_in { cycles + 1 } else { 0 };
        if cycles > 300 {
            return;
        }
        step(bench, reference, stepping);
    }
    panic!("never in {phase:?}");
}

/// Sensors that err, one or three in one cycle, while the robot steps and its client goes on as if nothing were: it does not
/// fall, and no joint moves fast. Its mode may end.
#[test]
fn faults_while_it_steps_do_not_make_it_fall() {
    type Spoil = fn(&mut Bench);
    let cases: [(&str, Spoil); 4] = [
        ("gyroscope", |bench| {
            spoil_source(bench, Source::Imu(0), |axes| axes[0] += 0.05);
        }),
        ("moment under the right foot", |bench| {
            spoil_source(bench, Source::Ft(1), |axes| axes[3] += 10.0);
        }),
        ("force under the left foot", |bench| {
            spoil_ft(bench, |axes| axes[2] += 200.0)
        }),
        ("accelerometer and both feet", |bench| {
            spoil_source(bench, Source::Imu(0), |axes| axes[3] -= 1.0);
            spoil_source(bench, Source::Ft(0), |axes| axes[4] += 20.0);
            spoil_source(bench, Source::Ft(1), |axes| axes[4] -= 20.0);
        }),
    ];
    for (what, spoil) in cases {
        for phase in [Phase::Leans, Phase::InAir, Phase::CameDown] {
            let (mut bench, mut reference, mut stepping) = begun();
            let begun = bench.plant.truth().base_orientation;
            let height = bench.plant.truth().base_position[2];
            until(phase, &mut bench, &mut reference, &mut stepping);
            let mut motion = Motion::of(&bench);
            for _ in 0..3000 {
                bench.gather();
                spoil(&mut bench);
                let on = bench.cycle.record().commanded.stands_on;
                stepping.update(on, &mut reference, 1e-3);
                reference.sequence += 1;
                bench.compute(&client_input(&reference));
                motion.take(&bench);
            }
            let (turned, share) = (turned(&bench, &begun), motion.speed_share());
            let lower = height - bench.plant.truth().base_position[2];
            assert!(turned < 3.0, "{what}, {phase:?}: {turned:.2} degrees");
            assert!(lower < 0.04, "{what}, {phase:?}: {lower:.3} m lower");
            assert!(share < 0.5, "{what}, {phase:?}: {:.0} %", 100.0 * share);
        }
    }
}
