//! Scans of buses with nodes and actuators of several families.

use can_codec::Frame;
use drives::canopen::server::Server;
use drives::canopen::{Object, SDO_REQUEST_ID};
use drives::cia402::{Kind, Mode, Reported, Side, simulated};
use drives::family::{Address, FAMILIES, Family, Feedback, State};
use drives::scan::{BusToScan, Found, Scan};

const MS: u64 = 1_000_000;

fn family(name: &str) -> &'static dyn Family {
    let mut all = FAMILIES.into_iter();
    all.find(|family| family.name() == name).expect("a family")
}

fn node(id: u8) -> Server {
    let kind = Kind {
        mode: Mode::Position,
        side: Side::Link,
        other_angle: Some(Object::new(0x2240, 0)),
        velocity_unit: None,
        rated_current: 5.0,
        current_per_torque: 5.0,
        rated_torque: 100.0,
        reported: Reported::default(),
        heartbeat_ms: 100,
        vendor: None,
        product: None,
        sdo: Vec::new(),
    };
    simulated::drive(0, id, &kind)
}

/// An actuator that answers to its question, or sends by itself every 100 ms.
struct Actuator {
    family: &'static dyn Family,
    at: Address,
    told: Feedback,
}

fn actuator(name: &str, node: u8) -> Actuator {
    let family = family(name);
    let told = Feedback {
        position: Some(1.0),
        state: Some(State::Fault),
        error: Some(0x20),
        temperature: Some(40.0),
        ..Feedback::default()
    };
    let at = Address {
        bus: 0,
        node,
        master: family.usual_reply(node),
    };
    Actuator { family, at, told }
}

/// Runs a scan; all frames that it sent, and what it found.
fn run(nodes: &mut [Server], actuators: &[Actuator], only: Option<u8>) -> (Vec<Frame>, Vec<Found>) {
    let mut scan = Scan::new(BusToScan { bus: 0, fd: true }, only);
    let mut all = Vec::new();
    for ms in 0..60_000 {
        let now = ms * MS;
        let mut sent = Vec::new();
        scan.poll(now, &mut sent);
        let mut answers = Vec::new();
        for a in actuators {
            let heartbeat = a.family.name() == "odrive" && ms.is_multiple_of(100);
            let asked = a.family.poll(a.at).is_some_and(|poll| sent.contains(&poll));
            if heartbeat || asked {
                let model = &a.family.models()[0];
                answers.extend(a.family.answer(a.at, model, &a.told));
            }
        }
        nodes
            .iter_mut()
            .for_each(|node| node.poll(now, &mut answers));
        while !(sent.is_empty() && answers.is_empty()) {
            for frame in std::mem::take(&mut sent) {
                all.push(frame);
                for node in nodes.iter_mut() {
                    node.receive(&frame, now, &mut answers);
                }
            }
            for frame in std::mem::take(&mut answers) {
                scan.receive(&frame, now, &mut sent);
            }
        }
        if scan.is_done() {
            return (all, scan.found());
        }
    }
    panic!("it does not end");
}

#[test]
fn who_is_there_is_found_and_named() {
    let mut nodes = [node(3), node(9)];
    let actuators = [
        actuator("moteus", 7),
        actuator("myactuator", 2),
        actuator("odrive", 5),
    ];
    let (_, found) = run(&mut nodes, &actuators, None);
    let names: Vec<_> = found.iter().map(|f| (f.family, f.node)).collect();
    let expected = [
        ("cia402", 3),
        ("cia402", 9),
        ("moteus", 7),
        ("myactuator", 2),
        ("odrive", 5),
    ];
    assert_eq!(names, expected);
    let [drive, _, moteus, rmd, odrive] = &found[..] else {
        panic!("{found:?}");
    };
    assert_eq!(drive.state, Some("switch on disabled"));
    assert!(
        drive
            .facts
            .contains(&("rated_current_mA", "5000".to_owned()))
    );
    assert_eq!(moteus.state, Some("fault"));
    assert_eq!(moteus.error.as_deref(), Some("0x20: calibration"));
    assert!(rmd.facts.contains(&("temperature_C", "40.0000".to_owned())));
    assert_eq!(odrive.error.as_deref(), Some("0x20: gate driver"));
}

#[test]
fn one_identifier_alone_is_asked() {
    let mut nodes = [node(3), node(9)];
    let (sent, found) = run(&mut nodes, &[actuator("moteus", 9)], Some(9));
    let names: Vec<_> = found.iter().map(|f| (f.family, f.node)).collect();
    assert_eq!(names, [("cia402", 9), ("moteus", 9)]);
    assert!(sent.iter().all(|frame| frame.id != SDO_REQUEST_ID + 3));
}

#[test]
fn nothing_that_is_asked_can_move_anything() {
    let (sent, _) = run(&mut [node(3)], &[], None);
    assert!(sent.len() > 400);
    for frame in &sent {
        let at = |node, family: &dyn Family| Address {
            bus: 0,
            node,
            master: family.usual_reply(node),
        };
        let is_question = FAMILIES.iter().any(|family| {
            let mut nodes = family.nodes();
            nodes.any(|node| family.questions(at(node, *family)).contains(frame))
        });
        // A reading by SDO, its segments, or its end.
        let reads = (SDO_REQUEST_ID..SDO_REQUEST_ID + 128).contains(&frame.id)
            && matches!(frame.data[0] & 0xE0, 0x40 | 0x60 | 0x80);
        assert!(is_question || reads, "{frame:?}");
    }
}

#[test]
fn an_odrive_gets_nothing_under_its_identifiers() {
    // 48 has those of CANopen's requests to nodes 1 to 31, 10 those of MyActuator's questions.
    for id in [10, 48] {
        let (sent, found) = run(&mut [node(40)], &[actuator("odrive", id)], None);
        let names: Vec<_> = found.iter().map(|f| (f.family, f.node)).collect();
        assert_eq!(names, [("cia402", 40), ("odrive", id)]);
        let own = |frame: &&Frame| frame.id >> 5 == u32::from(id) || frame.id == 0x7FF;
        assert_eq!(sent.iter().find(own), None);
    }
}

#[test]
fn damiao_and_robstride_answer_by_reading_registers() {
    let damiao = family("damiao");
    let at = |family: &dyn Family, node| Address {
        bus: 0,
        node,
        master: family.usual_reply(node),
    };
    let question = damiao.questions(at(damiao, 4))[0];
    assert_eq!(damiao.identify(&question), None, "a question is no answer");
    let mut answer = question;
    answer.id = 0x14;
    answer.data[4] = 0x14;
    let identity = damiao.identify(&answer).expect("an answer");
    assert_eq!((identity.node, identity.reply), (4, Some(0x14)));
    assert_eq!(identity.facts, [("reply_id", "20".to_owned())]);

    let robstride = family("robstride");
    let question = robstride.questions(at(robstride, 4))[0];
    assert_eq!(
        robstride.identify(&question),
        None,
        "a question is no answer"
    );
    let mut answer = question;
    answer.id = 0x8000_0000 | 17 << 24 | 4 << 8 | 0xFD;
    answer.data[4..8].copy_from_slice(&1.5f32.to_le_bytes());
    let identity = robstride.identify(&answer).expect("an answer");
    assert_eq!((identity.node, identity.reply), (4, Some(0xFD)));
}
