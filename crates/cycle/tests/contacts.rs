//! Contact sets in the cycle: chosen by the rule and by clients, changed without a step; and contact
//! flags from external torques.

use crate::common;

use can_codec::Frames;
use common::{Bench, read};
use cycle::{ClientInput, Cycle};
use robot_state::{CycleRecord, Event, Settings};

const HUMANOID: &str = "config/humanoid/robot.toml";
const SIM: &str = "config/humanoid/sim.toml";

/// The humanoid, with a text at the end of its simulation's file.
fn humanoid(simulation: &str) -> Bench {
    blending("100.0", simulation)
}

/// The humanoid with the blending time `ms`.
fn blending(ms: &str, simulation: &str) -> Bench {
    const BLEND: &str = "blend_ms = 100.0";
    Bench::reading("humanoid", &|path: &str| {
        let text = read(path)?;
        Ok(match path {
            SIM => text + simulation,
            HUMANOID => {
                assert!(text.contains(BLEND));
                text.replace(BLEND, &format!("blend_ms = {ms}"))
            }
            _ => text,
        })
    })
}

fn count(record: &CycleRecord, event: Event) -> u64 {
    record.events[event.index()]
}

/// A client's choice of a contact set is used until the client returns it to the rule; the record
/// shows both.
#[test]
fn clients_choose_contact_sets() {
    let mut bench = humanoid("");
    bench.run(300);
    let record = bench.cycle.record();
    assert_eq!(
        (
            record.estimated.contact_set,
            record.estimated.contact_set_automatic
        ),
        (0, 1)
    );
    let mut settings = Settings {
        sequence: 1,
        contact_set: 6,
        ..Settings::default()
    };
    let ask = |bench: &mut Bench, settings: &Settings| {
        for _ in 0..200 {
            bench.step(&ClientInput {
                settings: Some(settings),
                ..ClientInput::default()
            });
        }
        let record = bench.cycle.record();
        (
            record.estimated.contact_set,
            record.estimated.contact_set_automatic,
        )
    };
    assert_eq!(ask(&mut bench, &settings), (5, 0));
    settings.contact_set = 99;
    assert_eq!(ask(&mut bench, &settings), (5, 0), "there is no such set");
    settings.contact_set = 0;
    assert_eq!(ask(&mut bench, &settings), (0, 1));
}

/// Somebody leans on the chest.
const LEANING: &str = "\n[[push]]\nlink = \"chest_pitch_link\"\nstart_s = 0.1\nduration_s = 1.6\n\
                       torque_Nm = [5.0, 20.0, 10.0]\n";

/// A push on the chest that one contact set explains and the other does not: the torques of the
/// trunk change from one to the other over the configured time.
#[test]
fn torques_do_not_step_with_the_contact_set() {
    let largest_step = |blend_ms: &str| {
        let mut bench = blending(blend_ms, LEANING);
        bench.run(900);
        let settings = Settings {
            sequence: 1,
            contact_set: 5,
            ..Settings::default()
        };
        let mut last = bench
            .cycle
            .record()
            .estimated
            .joints
            .map(|j| j.tau_whole_body.tau);
        let (mut step, before) = (0.0f64, last);
        for _ in 0..150 {
            let record = bench.step(&ClientInput {
                settings: Some(&settings),
                ..ClientInput::default()
            });
            let now = record.estimated.joints.map(|j| j.tau_whole_body.tau);
            let steps = now.iter().zip(&last).map(|(a, b)| (a - b).abs());
            step = steps.fold(step, f64::max);
            last = now;
        }
        let record = bench.cycle.record();
        let ratios =
            (record.estimated.residual.torque.iter()).zip(&record.estimated.residual_sigma.torque);
        let residual = ratios.map(|(r, s)| r.abs() / s).fold(0.0, f64::max);
        assert!(residual > 5.0, "a missing contact shows: {residual} sigmas");
        let change = last.iter().zip(&before).map(|(a, b)| (a - b).abs());
        (step, change.fold(0.0, f64::max))
    };
    let (at_once, change) = largest_step("0.0");
    let (blended, _) = largest_step("100.0");
    assert!(change > 5.0, "{change} N·m: the sets do not differ");
    assert!(at_once > 0.8 * change, "{at_once} of {change} N·m");
    assert!(blended < 0.02 * change, "{blended} of {change} N·m");
}

/// The rule follows the feet: on the ground, and lifted off it at the shoulders.
#[test]
fn the_rule_follows_the_feet() {
    let lifted = "\n[[push]]\nlink = \"chest_pitch_link\"\nstart_s = 0.4\nduration_s = 0.8\n\
                  force_N = [0.0, 0.0, 900.0]\n";
    let mut bench = humanoid(lifted);
    bench.run(400);
    assert_eq!(bench.cycle.record().estimated.contact_set, 0, "standing");
    let mut seen = Vec::new();
    for _ in 0..500 {
        let record = bench.step(&ClientInput::default());
        if seen.last() != Some(&record.estimated.contact_set) {
            seen.push(record.estimated.contact_set);
        }
    }
    assert_eq!(seen.last(), Some(&3), "in the air: {seen:?}");
    assert!(seen.len() < 5, "the choice alternates: {seen:?}");
}

/// A push where no contact is declared sets the contact flags of the joints that it loads, and no
/// others.
#[test]
fn a_push_on_the_elbow_sets_the_shoulders_contact_flags() {
    let pushed = "\n[[push]]\nlink = \"left_elbow_link\"\nstart_s = 0.5\nduration_s = 0.8\n\
                  force_N = [60.0, 0.0, 0.0]\n";
    let mut bench = humanoid(pushed);
    bench.run(500);
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::ExternalContact), 0);
    let mut flagged = Vec::new();
    for _ in 0..600 {
        let record = bench.step(&ClientInput::default());
        for (j, joint) in record.estimated.joints.iter().enumerate() {
            if joint.contact_flag == 1 && !flagged.contains(&j) {
                flagged.push(j);
            }
        }
    }
    let names: Vec<&str> = (flagged.iter())
        .map(|&j| bench.robot.parameters.joints[j].name.as_str())
        .collect();
    assert!(!names.is_empty(), "no contact flag was set");
    assert!(
        names.iter().all(|n| n.starts_with("left_shoulder")),
        "{names:?}"
    );
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::ExternalContact), flagged.len() as u64);
}

/// A leg with a fixed base, and one with a floating base whose root link is fixed to a stand, have the
/// same torques.
#[test]
fn a_stand_is_a_fixed_base() {
    let mut bench = Bench::new("leg");
    let standing = robot_config::load("config/leg/robot.toml", &|path: &str| {
        let text = read(path)?;
        let stand = "base = \"floating\"\n\n[fixed_base]\nlink = \"base_link\"\n";
        Ok(text.replace("base = \"fixed\"\n", stand))
    })
    .unwrap();
    let mut cycle = Cycle::new(&standing).unwrap();
    let mut tx = Frames::default();
    for _ in 0..400 {
        bench.step(&ClientInput::default());
        tx.clear();
        let now = bench.instants();
        let record = cycle.step(now, &bench.rx, &ClientInput::default(), &mut tx);
        let tau = |r: &CycleRecord| r.estimated.joints.map(|j| j.tau_whole_body.tau);
        let tau_d = |r: &CycleRecord| r.commanded.joints.map(|j| j.tau_d);
        let fixed = bench.cycle.record();
        for (what, a, b) in [
            ("estimated", tau(record), tau(fixed)),
            ("desired", tau_d(record), tau_d(fixed)),
        ] {
            for (a, b) in a.iter().zip(b) {
                assert!((a - b).abs() < 1e-9, "{what}: {a} and {b} N·m");
            }
        }
    }
    let loads = bench
        .cycle
        .record()
        .estimated
        .joints
        .map(|j| j.tau_whole_body.tau);
    assert!(loads.iter().any(|tau| tau.abs() > 1.0), "{loads:?}");
}

/// The weight of a robot with a fixed base is no contact, and a push on its knee is one.
#[test]
fn a_push_on_a_leg_with_fixed_base_sets_a_contact_flag() {
    const LEG: &str = "config/leg/robot.toml";
    let pushed = "\n[[push]]\nlink = \"ankle_pitch_link\"\nstart_s = 0.6\nduration_s = 0.8\n\
                  force_N = [80.0, 0.0, 0.0]\n";
    let mut bench = Bench::reading("leg", &|path: &str| {
        let text = read(path)?;
        Ok(match path {
            "config/leg/sim.toml" => text + pushed,
            LEG => text.replace("[control]", "[external_torque]\n\n[control]"),
            _ => text,
        })
    });
    bench.run(600);
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::ExternalContact), 0);
    let weight = record.estimated.joints.map(|j| j.tau_whole_body.tau.abs());
    assert!(weight.iter().any(|tau| *tau > 1.0), "{weight:?}");
    let mut most = 0.0f64;
    for _ in 0..600 {
        let record = bench.step(&ClientInput::default());
        most = record
            .estimated
            .joints
            .iter()
            .map(|j| j.tau_ext.abs())
            .fold(most, f64::max);
    }
    assert!(most > 10.0, "{most} N·m");
    assert!(count(bench.cycle.record(), Event::ExternalContact) > 0);
}
