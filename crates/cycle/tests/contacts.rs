//! Contacts in the cycle: chosen by the rule and by clients, changed without a step; and what pushes
//! the robot besides them.

mod common;

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

/// The same with another time of blending.
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

/// A client's choice holds until it is handed back; the record tells both.
#[test]
fn clients_choose_contacts() {
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

/// The push on the chest is explained or not, as a client says; the torques of the trunk go from one
/// to the other over the time that is configured.
#[test]
fn torques_do_not_step_with_the_contacts() {
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

/// The rule follows the feet: on the ground, and lifted off it by its shoulders.
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
    assert!(seen.len() < 5, "it flickers: {seen:?}");
}

/// A push where no contact is declared is seen at the joints that feel it, and nowhere else.
#[test]
fn a_push_on_the_elbow_is_told() {
    let pushed = "\n[[push]]\nlink = \"left_elbow_link\"\nstart_s = 0.5\nduration_s = 0.8\n\
                  force_N = [60.0, 0.0, 0.0]\n";
    let mut bench = humanoid(pushed);
    bench.run(500);
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::ExternalContact), 0);
    let mut told = Vec::new();
    for _ in 0..600 {
        let record = bench.step(&ClientInput::default());
        for (j, joint) in record.estimated.joints.iter().enumerate() {
            if joint.contact_flag == 1 && !told.contains(&j) {
                told.push(j);
            }
        }
    }
    let names: Vec<&str> = (told.iter())
        .map(|&j| bench.robot.parameters.joints[j].name.as_str())
        .collect();
    assert!(!names.is_empty(), "nothing is told");
    assert!(
        names.iter().all(|n| n.starts_with("left_shoulder")),
        "{names:?}"
    );
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::ExternalContact), told.len() as u64);
}

/// A leg whose root is bolted down, and one that could move but hangs on a stand by that link: two
/// ways to say the same.
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
        let bolted = bench.cycle.record();
        for (what, a, b) in [
            ("estimated", tau(record), tau(bolted)),
            ("desired", tau_d(record), tau_d(bolted)),
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

/// A bolted robot's weight is no push, and a push on its knee is one.
#[test]
fn a_push_on_a_bolted_leg_is_told() {
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
