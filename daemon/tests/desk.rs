//! The desk alone, with made-up records of the leg.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use robot_config::Robot;
use robot_state::{
    Answer, Event, Mode, Name, Request, SharedRecord, answer_status, measured_flags, request,
};
use test_support::read_project_file;
use torqued::desk::Desk;
use torqued::offsets::Store;

const CONTACTS: &str = r#"
[[contacts]]
name = "in_the_air"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "none" }]
"#;

fn leg() -> Robot {
    let line = "unknown_wrench_link = \"base_link\"\n";
    let read = |path: &str| {
        let text = read_project_file(path)?;
        Ok(match path.ends_with("robot.toml") {
            true => format!("{}{CONTACTS}", text.replace(line, "")),
            false => text,
        })
    };
    robot_config::load("config/leg/robot.toml", &read).expect("the leg")
}

struct State(PathBuf);

impl State {
    fn new(test: &str) -> Self {
        let name = format!("torqued-desk-{}-{test}", std::process::id());
        Self(std::env::temp_dir().join(name))
    }
}

impl Drop for State {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn desk(state: &State) -> Desk {
    Desk::new(&leg(), Ok(Store::at(&state.0, "leg"))).expect("a desk")
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

/// Shows records, one a millisecond, until the request is answered.
fn served(desk: &mut Desk, from: Instant, record: impl Fn(usize) -> Box<SharedRecord>) -> Answer {
    for k in 0..20_000 {
        let now = from + Duration::from_millis(k as u64);
        desk.see(&record(k), now);
        match desk.work(now) {
            Some(answer) if answer.status != answer_status::WORKING => return answer,
            // A disk has its own time.
            _ if k > 2500 => std::thread::sleep(Duration::from_millis(1)),
            _ => {}
        }
    }
    panic!("never answered");
}

fn refusal(desk: &mut Desk, record: &SharedRecord) -> String {
    let now = Instant::now();
    desk.see(record, now);
    let answer = desk.ask(&asked(request::TARE), now);
    assert_eq!((answer.id, answer.status), (7, answer_status::REFUSED));
    answer.text.to_string()
}

#[test]
fn a_robot_that_is_not_fit_is_refused_with_the_reason() {
    let state = State::new("unfit");
    let mut desk = desk(&state);
    let now = Instant::now();
    let none = desk.ask(&asked(request::TARE), now).text;
    assert!(none.as_str().contains("no cycle has run"), "{none}");
    let told = |desk: &mut Desk, change: &dyn Fn(&mut SharedRecord)| {
        let mut record = still();
        change(&mut record);
        refusal(desk, &record)
    };
    let fault = told(&mut desk, &|r| r.cycle.fault = Event::JointStale.number());
    assert!(fault.contains("fault 104 joint_stale"), "{fault}");
    let torque = told(&mut desk, &|r| r.cycle.mode = Mode::Torque.number());
    assert!(torque.contains("mode torque"), "{torque}");
    let stale = told(&mut desk, &|r| {
        r.cycle.measured.joints[3].flags = measured_flags::STALE;
    });
    assert!(stale.contains("joint knee is silent"), "{stale}");
    let settling = told(&mut desk, &|r| {
        r.cycle.measured.ft[0].flags = measured_flags::SETTLING;
    });
    assert!(
        settling.contains("F/T sensor ankle is settling"),
        "{settling}"
    );
    let never = told(&mut desk, &|r| {
        r.cycle.measured.ft[0].flags = measured_flags::NEVER
    });
    assert!(never.contains("ankle has never answered"), "{never}");
    // An old record tells nothing.
    let later = now + Duration::from_secs(5);
    let late = desk.ask(&asked(request::TARE), later).text;
    assert!(late.as_str().contains("no cycle has run"), "{late}");
}

#[test]
fn what_happens_during_a_tare_ends_it() {
    type Change = fn(&mut SharedRecord);
    let state = State::new("during");
    let mut desk = desk(&state);
    let from = Instant::now();
    let changes: [(Change, &str); 5] = [
        (
            |r| r.cycle.mode = Mode::InverseDynamics.number(),
            "mode inverse_dynamics",
        ),
        (|r| r.cycle.fault = 403, "fault 403 command_not_finite"),
        (
            |r| r.cycle.measured.joints[2].dq_hat = 0.1,
            "joint `hip_pitch` turns",
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
        desk.see(&still(), from);
        let begun = desk.ask(&asked(request::TARE), from);
        assert_eq!(begun.status, answer_status::WORKING, "{}", begun.text);
        let busy = desk.ask(&asked(request::TARE), from);
        assert!(busy.text.as_str().contains("try again"), "{}", busy.text);
        let answer = served(&mut desk, from, |k| {
            let mut record = still();
            if k > 300 {
                change(&mut record);
            }
            record
        });
        assert_eq!(answer.status, answer_status::REFUSED);
        assert!(answer.text.as_str().contains(part), "{}", answer.text);
    }
    assert!(desk.about().contains("no tare"), "{}", desk.about());
}

#[test]
fn bridged_samples_do_not_count_and_a_tare_without_samples_ends() {
    let state = State::new("bridged");
    let mut desk = desk(&state);
    let from = Instant::now();
    let missing = |every: usize| {
        move |k: usize| {
            let mut record = still();
            if !k.is_multiple_of(every) {
                record.cycle.measured.ft[0].flags = measured_flags::MISSED;
                // What is bridged is not looked at.
                record.cycle.measured.ft[0].wrench.force[0] = 1e6;
            }
            record
        }
    };
    desk.see(&still(), from);
    desk.ask(&asked(request::TARE), from);
    let answer = served(&mut desk, from, missing(2));
    assert_eq!(answer.status, answer_status::DONE, "{}", answer.text);
    desk.ask(&asked(request::TARE), from);
    let answer = served(&mut desk, from, missing(50));
    assert_eq!(answer.status, answer_status::REFUSED);
    assert!(
        answer.text.as_str().contains("of 2000 records"),
        "{}",
        answer.text
    );
}

/// Whatever the loop still takes off while an earlier offset blends in, the tare finds the same.
#[test]
fn a_tare_right_after_another_is_not_misled_by_blending() {
    let state = State::new("blending");
    let mut desk = desk(&state);
    let from = Instant::now();
    let mut taken = [0.0; 3];
    for round in 0..2 {
        desk.see(&still(), from);
        desk.ask(&asked(request::TARE), from);
        let answer = served(&mut desk, from, |k| {
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
    let mut desk =
        Desk::new(&leg(), Ok(Store::at("/proc/torqued".as_ref(), "leg"))).expect("a desk");
    let from = Instant::now();
    desk.see(&still(), from);
    desk.ask(&asked(request::TARE), from);
    let answer = served(&mut desk, from, |_| still());
    assert_eq!(answer.status, answer_status::REFUSED);
    assert!(
        answer.text.as_str().contains("/proc/torqued"),
        "{}",
        answer.text
    );
    assert_eq!(desk.settings().ft_offset[0].force, [0.0; 3]);
    let mut homeless = Desk::new(&leg(), Err("no HOME".to_owned())).expect("a desk");
    homeless.see(&still(), from);
    let answer = homeless.ask(&asked(request::TARE), from);
    assert!(answer.text.as_str().contains("no HOME"), "{}", answer.text);
}

proptest! {
    #[test]
    fn whatever_a_client_asks_it_gets_an_answer(kinds in prop::collection::vec((any::<u32>(), 0_u32..8, ".{0,30}"), 1..40)) {
        let mut desk = Desk::new(&leg(), Err("nowhere".to_owned())).expect("a desk");
        let now = Instant::now();
        desk.see(&still(), now);
        for (wild, near, name) in kinds {
            for kind in [wild, near] {
                let asked = Request { id: u64::from(wild), kind, contact_set: Name::new(&name), ..Request::default() };
                let answer = desk.ask(&asked, now);
                prop_assert_eq!(answer.id, asked.id);
                let shown = kind == request::SHOW_TARE;
                let expected = if shown { answer_status::DONE } else { answer_status::REFUSED };
                prop_assert_eq!(answer.status, expected, "{} {}", kind, answer.text);
                prop_assert!(!answer.text.as_str().is_empty());
            }
            prop_assert!(desk.work(now).is_none());
            prop_assert!(desk.settings().contact_set == 0);
        }
    }
}

#[test]
fn stored_offsets_of_another_robot_keep_the_daemon_from_starting() {
    let state = State::new("other");
    let store = Store::at(&state.0, "leg");
    std::fs::create_dir_all(store.file().parent().expect("a folder")).expect("made");
    std::fs::write(store.file(), "format = 1\nrobot = \"leg\"\n").expect("written");
    let refused = Desk::new(&leg(), Ok(store.clone())).err().expect("refused");
    let file = store.file().display().to_string();
    assert!(
        refused.contains(&file) && refused.contains("remove it"),
        "{refused}"
    );
}
