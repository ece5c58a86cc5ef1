//! The request server alone, with made-up records of the leg.

use crate::common;

use std::time::{Duration, Instant};

use common::leg_with_contacts;
use cycle::OperatorRequest;
use problem::Problem;
use proptest::prelude::*;
use robot_config::{JointCalibration, Robot};
use robot_state::{
    Answer, Event, Mode, Name, Request, RobotState, SharedRecord, answer_status, command_flags,
    measured_flags, refusal, request,
};
use test_support::TemporaryDirectory;
use torqued::offsets::Store;
use torqued::request_server::RequestServer;

const CONTACTS: &str = r#"
[[contacts]]
name = "in_the_air"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "none" }]
"#;

fn leg() -> Robot {
    leg_with_contacts(CONTACTS)
}

fn request_server(state: &TemporaryDirectory) -> RequestServer {
    RequestServer::new(&leg(), Ok(Store::at(state.path(), "leg"))).expect("a request server")
}

/// The leg hanging still with its joints at zero.
fn still() -> Box<SharedRecord> {
    let mut record = Box::<SharedRecord>::default();
    (record.cycle.joint_count, record.cycle.ft_count) = (6, 1);
    record.cycle.measured.ft[0].wrench.force = [1.0, 2.0, -20.0];
    record
}

fn asked(kind: u32) -> Request {
    Request {
        id: 7,
        kind,
        contact_set: Name::new("in_the_air"),
        ..Request::default()
    }
}

/// Passes records to the server, one per millisecond, until the request is answered.
fn served(
    server: &mut RequestServer,
    from: Instant,
    record: impl Fn(usize) -> Box<SharedRecord>,
) -> Answer {
    for k in 0..20_000 {
        let now = from + Duration::from_millis(k as u64);
        server.observe(&record(k), now);
        match server.advance(now) {
            Some(answer) if answer.status != answer_status::WORKING => return answer,
            // The disk may take its time.
            _ if k > 2500 => std::thread::sleep(Duration::from_millis(1)),
            _ => {}
        }
    }
    panic!("never answered");
}

fn refusal(server: &mut RequestServer, record: &SharedRecord) -> String {
    let now = Instant::now();
    server.observe(record, now);
    let answer = server.serve(&asked(request::TARE), now);
    assert_eq!((answer.id, answer.status), (7, answer_status::REFUSED));
    answer.text.to_string()
}

#[test]
fn a_robot_unfit_for_a_tare_is_refused_with_the_reason() {
    let state = TemporaryDirectory::new();
    let mut server = request_server(&state);
    let now = Instant::now();
    let none = server.serve(&asked(request::TARE), now).text;
    assert!(none.as_str().contains("no cycle has run"), "{none}");
    let reason_for = |server: &mut RequestServer, change: &dyn Fn(&mut SharedRecord)| {
        let mut record = still();
        change(&mut record);
        refusal(server, &record)
    };
    let fault = reason_for(&mut server, &|r| r.cycle.fault = Event::JointStale.number());
    assert!(fault.contains("fault 104 joint_stale"), "{fault}");
    let torque = reason_for(&mut server, &|r| r.cycle.mode = Mode::Torque.number());
    assert!(torque.contains("mode torque"), "{torque}");
    let stale = reason_for(&mut server, &|r| {
        r.cycle.measured.joints[3].flags = measured_flags::STALE;
    });
    assert!(stale.contains("joint knee has sent no sample"), "{stale}");
    let settling = reason_for(&mut server, &|r| {
        r.cycle.measured.ft[0].flags = measured_flags::SETTLING;
    });
    assert!(
        settling.contains("F/T sensor ankle is settling"),
        "{settling}"
    );
    let never = reason_for(&mut server, &|r| {
        r.cycle.measured.ft[0].flags = measured_flags::NEVER
    });
    assert!(never.contains("ankle has never answered"), "{never}");
    // An old record does not count.
    let later = now + Duration::from_secs(5);
    let late = server.serve(&asked(request::TARE), later).text;
    assert!(late.as_str().contains("no cycle has run"), "{late}");
}

#[test]
fn an_event_during_a_tare_ends_it() {
    type Change = fn(&mut SharedRecord);
    let state = TemporaryDirectory::new();
    let mut server = request_server(&state);
    let from = Instant::now();
    let changes: [(Change, &str); 5] = [
        (
            |r| r.cycle.mode = Mode::InverseDynamics.number(),
            "mode inverse_dynamics",
        ),
        (|r| r.cycle.fault = 403, "fault 403 command_not_finite"),
        (
            |r| r.cycle.measured.joints[2].dq_hat = 0.1,
            "joint `hip_pitch` moves",
        ),
        (
            |r| r.cycle.measured.ft[0].wrench.force[1] = 9.0,
            "fy of F/T sensor `ankle`",
        ),
        (
            |r| r.cycle.measured.ft[0].wrench.torque[2] = f64::NAN,
            "not finite",
        ),
    ];
    for (change, part) in changes {
        server.observe(&still(), from);
        let begun = server.serve(&asked(request::TARE), from);
        assert_eq!(begun.status, answer_status::WORKING, "{}", begun.text);
        let busy = server.serve(&asked(request::TARE), from);
        assert!(busy.text.as_str().contains("try again"), "{}", busy.text);
        let answer = served(&mut server, from, |k| {
            let mut record = still();
            if k > 300 {
                change(&mut record);
            }
            record
        });
        assert_eq!(answer.status, answer_status::REFUSED);
        assert!(answer.text.as_str().contains(part), "{}", answer.text);
    }
    assert!(
        server.describe_tare().contains("no tare"),
        "{}",
        server.describe_tare()
    );
}

#[test]
fn bridged_samples_do_not_count_and_a_tare_without_samples_ends() {
    let state = TemporaryDirectory::new();
    let mut server = request_server(&state);
    let from = Instant::now();
    let missing = |every: usize| {
        move |k: usize| {
            let mut record = still();
            if !k.is_multiple_of(every) {
                record.cycle.measured.ft[0].flags = measured_flags::MISSED;
                // Bridged samples are not used.
                record.cycle.measured.ft[0].wrench.force[0] = 1e6;
            }
            record
        }
    };
    server.observe(&still(), from);
    server.serve(&asked(request::TARE), from);
    let answer = served(&mut server, from, missing(2));
    assert_eq!(answer.status, answer_status::DONE, "{}", answer.text);
    server.serve(&asked(request::TARE), from);
    let answer = served(&mut server, from, missing(50));
    assert_eq!(answer.status, answer_status::REFUSED);
    assert!(
        answer.text.as_str().contains("of 2000 records"),
        "{}",
        answer.text
    );
}

/// The tare finds the same offset while an earlier one still blends in.
#[test]
fn a_tare_right_after_another_is_not_misled_by_blending() {
    let state = TemporaryDirectory::new();
    let mut server = request_server(&state);
    let from = Instant::now();
    let mut taken = [0.0; 3];
    for round in 0..2 {
        server.observe(&still(), from);
        server.serve(&asked(request::TARE), from);
        let answer = served(&mut server, from, |k| {
            let mut record = still();
            let share = (k as f64 / 250.0).min(1.0);
            for (axis, taken) in taken.iter().enumerate() {
                let now = taken * share;
                record.cycle.measured.ft[0].offset.force[axis] = now;
                record.cycle.measured.ft[0].wrench.force[axis] -= now;
            }
            record
        });
        assert_eq!(answer.status, answer_status::DONE, "{}", answer.text);
        let [before, after] = [&answer.ft[0].before, &answer.ft[0].offset].map(|w| w.force);
        assert_eq!(before, taken);
        if round == 1 {
            let moved = (0..3).map(|k| (after[k] - before[k]).abs());
            assert!(moved.fold(0.0, f64::max) < 1e-3, "{before:?} {after:?}");
        }
        taken = after;
    }
}

#[test]
fn offsets_that_cannot_be_kept_are_not_used() {
    let mut server = RequestServer::new(&leg(), Ok(Store::at("/proc/torqued".as_ref(), "leg")))
        .expect("a request server");
    let from = Instant::now();
    server.observe(&still(), from);
    server.serve(&asked(request::TARE), from);
    let answer = served(&mut server, from, |_| still());
    assert_eq!(answer.status, answer_status::REFUSED);
    assert!(
        answer.text.as_str().contains("/proc/torqued"),
        "{}",
        answer.text
    );
    assert_eq!(server.settings().ft_offset[0].force, [0.0; 3]);
    let mut homeless =
        RequestServer::new(&leg(), Err(Problem::new("no HOME", ""))).expect("a request server");
    homeless.observe(&still(), from);
    let answer = homeless.serve(&asked(request::TARE), from);
    assert!(answer.text.as_str().contains("no HOME"), "{}", answer.text);
}

/// Read once: its check of margins takes longer than a case.
static LEG: std::sync::LazyLock<Robot> = std::sync::LazyLock::new(leg);

proptest! {
    #[test]
    fn every_request_gets_an_answer(kinds in prop::collection::vec((any::<u32>(), 0_u32..12, ".{0,30}"), 1..40)) {
        let mut server = RequestServer::new(&LEG, Err(Problem::new("nowhere", ""))).expect("a request server");
        let now = Instant::now();
        server.observe(&still(), now);
        for (wild, near, name) in kinds {
            for kind in [wild, near] {
                let asked = Request { id: u64::from(wild), kind, contact_set: Name::new(&name), ..Request::default() };
                let answer = server.serve(&asked, now);
                prop_assert_eq!(answer.id, asked.id);
                let expected = match kind {
                    request::SHOW_TARE => answer_status::DONE,
                    request::ENABLE..=request::ACKNOWLEDGE => answer_status::WORKING,
                    _ => answer_status::REFUSED,
                };
                prop_assert_eq!(answer.status, expected, "{} {}", kind, answer.text);
                prop_assert!(expected == answer_status::WORKING || !answer.text.as_str().is_empty());
            }
            // Of operators' requests all but the last are refused at once.
            while let Some(answer) = server.advance(now) {
                prop_assert_eq!(answer.status, answer_status::REFUSED);
            }
            prop_assert!(server.settings().contact_set == 0);
        }
    }
}

/// A record after `requests` requests, the last with this `refusal`.
fn after(requests: u32, refusal: u32, state: RobotState) -> Box<SharedRecord> {
    let mut record = still();
    let cycle = &mut record.cycle;
    (cycle.requests, cycle.refusal, cycle.state) = (requests, refusal, state.number());
    record
}

#[test]
fn a_later_request_of_an_operator_takes_the_place_of_one_that_waits() {
    let mut server =
        RequestServer::new(&leg(), Err(Problem::new("nowhere", ""))).expect("a server");
    let now = Instant::now();
    server.observe(&after(0, 0, RobotState::Ready), now);
    server.serve(&asked(request::ENABLE), now);
    assert_eq!(
        server.next_operator_request(now),
        Some(OperatorRequest::Enable)
    );
    let mut disable = asked(request::DISABLE);
    disable.id = 8;
    server.serve(&disable, now);
    let superseded = server.advance(now).expect("an answer");
    assert_eq!(
        (superseded.id, superseded.status),
        (7, answer_status::REFUSED)
    );
    // One at a time: the refusal of the first is not taken for the second's.
    assert_eq!(server.next_operator_request(now), None);
    server.observe(&after(1, refusal::STATE << 16, RobotState::Ready), now);
    assert!(server.advance(now).is_none());
    assert_eq!(
        server.next_operator_request(now),
        Some(OperatorRequest::Disable)
    );
    server.observe(&after(2, 0, RobotState::Ready), now);
    let answer = server.advance(now).expect("an answer");
    assert_eq!((answer.id, answer.status), (8, answer_status::DONE));
}

#[test]
fn waits_for_the_loop_and_for_drives_have_limits_and_name_what_they_wait_for() {
    let mut server =
        RequestServer::new(&leg(), Err(Problem::new("nowhere", ""))).expect("a server");
    let from = Instant::now();
    let at = |ms: u64| from + Duration::from_millis(ms);
    server.observe(&after(0, 0, RobotState::Ready), from);
    server.serve(&asked(request::ENABLE), from);
    server.next_operator_request(from).expect("handed over");
    let working = server.advance(at(150)).expect("an answer");
    assert_eq!(working.status, answer_status::WORKING);
    let ended = server.advance(at(600)).expect("an answer");
    assert_eq!(ended.status, answer_status::REFUSED);
    assert!(
        ended.text.as_str().contains("has not taken"),
        "{}",
        ended.text
    );

    server.serve(&asked(request::ENABLE), at(700));
    server.next_operator_request(at(700)).expect("handed over");
    let mut enabling = after(1, 0, RobotState::Enabling);
    for joint in &mut enabling.cycle.commanded.joints[..5] {
        joint.flags = command_flags::ENGAGED;
    }
    server.observe(&enabling, at(701));
    let working = server.advance(at(900)).expect("an answer");
    let text = working.text.as_str();
    assert_eq!(working.status, answer_status::WORKING);
    assert!(
        text.ends_with("switched on: ankle_roll (bus b, drive unknown)"),
        "{text}"
    );
    let ended = server.advance(at(9000)).expect("an answer");
    let text = ended.text.as_str();
    assert_eq!(ended.status, answer_status::REFUSED);
    assert!(
        text.contains("ankle_roll") && text.contains("torquectl state"),
        "{text}"
    );
}

#[test]
fn stored_offsets_of_another_robot_keep_the_daemon_from_starting() {
    let state = TemporaryDirectory::new();
    let store = Store::at(state.path(), "leg");
    std::fs::create_dir_all(store.file().parent().expect("a folder")).expect("made");
    std::fs::write(store.file(), "format = 1\nrobot = \"leg\"\n").expect("written");
    let refused = RequestServer::new(&leg(), Ok(store.clone()))
        .err()
        .expect("refused");
    let file = store.file().display().to_string();
    assert_eq!(refused.file, file);
    assert!(refused.to_string().contains("remove it"), "{refused}");
}

/// The leg with a joint file of its knee.
fn calibrated_leg() -> Robot {
    let file = "[joint]\nname = \"knee\"\ngear_ratio = 100.0\ntorque_constant_Nm_per_A = 0.05\n\
        rotor_inertia_kg_m2 = 1e-5\nrated_torque_Nm = 50.0\nlink_counts_per_turn = 524288\n\
        motor_counts_per_turn = 4096\nsample_rate_hz = 1000.0\n[hysteresis]\n\
        linear_Nm_per_rad = 7000.0\ncubic_Nm_per_rad3 = 0.0\nwind_up = []\nslipping = []\n\
        torsion_sigma_rad = 5e-5\n";
    let mut robot = leg();
    let file = joint_file::JointFile::parse(file, "knee.toml", &joint_file::no_files);
    robot.parameters.joints[3].calibration =
        Some(JointCalibration::new(file.expect("a joint file")));
    robot
}

#[test]
fn a_joint_is_tared_only_where_its_torque_can_be_known() {
    let state = TemporaryDirectory::new();
    let store = Store::at(state.path(), "leg");
    let mut server = RequestServer::new(&calibrated_leg(), Ok(store)).expect("a request server");
    let good = Request {
        joint: 3,
        torque: 4.0,
        sigma: 0.1,
        ..asked(request::TARE_JOINT)
    };
    let mut ask = |asked: &Request, change: &dyn Fn(&mut SharedRecord)| {
        let (mut record, now) = (still(), Instant::now());
        change(&mut record);
        server.observe(&record, now);
        let answer = server.serve(asked, now);
        let tares = server.settings().joint_tares;
        (answer.status, answer.text.to_string(), tares[3].count)
    };
    let nothing = |_: &mut SharedRecord| ();
    for (asked, why) in [
        (Request { joint: 99, ..good }, "no joint of index 99"),
        (
            Request { joint: 2, ..good },
            "hip_pitch has no calibrated gear",
        ),
        (
            Request {
                torque: f64::NAN,
                ..good
            },
            "no torque that is known",
        ),
        (
            Request {
                torque: 1e6,
                ..good
            },
            "no torque that is known",
        ),
        (Request { sigma: 0.0, ..good }, "no torque that is known"),
    ] {
        let (status, text, tares) = ask(&asked, &nothing);
        assert_eq!((status, tares), (answer_status::REFUSED, 0), "{text}");
        assert!(text.contains(why), "{text}");
    }
    for (change, why) in [
        (
            (|r| r.cycle.mode = Mode::Torque.number()) as fn(&mut SharedRecord),
            "mode torque",
        ),
        (|r| r.cycle.measured.joints[3].dq = 0.1, "knee moves"),
        (
            |r| r.cycle.measured.joints[3].flags = measured_flags::STALE,
            "knee has sent no sample",
        ),
    ] {
        let (status, text, tares) = ask(&good, &change);
        assert_eq!((status, tares), (answer_status::REFUSED, 0), "{text}");
        assert!(text.contains(why), "{text}");
    }
    let (status, text, tares) = ask(&good, &nothing);
    assert_eq!((status, tares), (answer_status::DONE, 1), "{text}");
    assert!(text.starts_with("knee: "), "{text}");
}
