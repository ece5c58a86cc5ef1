//! The picture, drawn into memory.

use super::super::model::{Key, Model, PARTS, PAST};
use super::draw;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use std::time::{Duration, Instant};
use torqued_client::robot_state::{
    CycleRecord, Description, Event, LoopRecord, Name, TorqueEstimate, torque_flags,
};

fn description() -> Description {
    let mut description = Description {
        robot: Name::new("leg"),
        rate_hz: 1000.0,
        joint_count: 3,
        ..Description::default()
    };
    for (j, name) in ["hip", "knee", "ankle"].into_iter().enumerate() {
        description.joint_names[j] = Name::new(name);
        description.torque_limits[j] = 100.0;
    }
    description
}

fn cycle(torques: [f64; 3]) -> CycleRecord {
    let mut cycle = CycleRecord {
        joint_count: 3,
        ..CycleRecord::default()
    };
    for (joint, tau) in cycle.estimated.joints.iter_mut().zip(torques) {
        joint.tau_hat = TorqueEstimate {
            tau,
            sigma: 0.5,
            flags: torque_flags::VALID,
            ..TorqueEstimate::default()
        };
    }
    cycle
}

fn shown(model: &Model) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(140, 24)).unwrap();
    terminal.draw(|frame| draw(frame, model)).unwrap();
    let buffer = terminal.backend().buffer().clone();
    let lines = buffer.content().chunks(140);
    lines
        .map(|line| line.iter().map(|cell| cell.symbol()).collect())
        .collect()
}

/// A model that has seen these torques, a record each 10 ms.
fn model(torques: impl Iterator<Item = [f64; 3]>) -> Model {
    let description = description();
    let mut model = Model::new(&description);
    let start = Instant::now();
    for (k, torques) in torques.enumerate() {
        let now = start + Duration::from_millis(10 * k as u64);
        model.take_cycle(&cycle(torques), &LoopRecord::default(), &description, now);
    }
    model
}

fn row<'a>(lines: &'a [String], joint: &str) -> &'a str {
    let found = lines.iter().find(|line| line.starts_with(joint));
    found.map_or("", String::as_str)
}

#[test]
fn a_row_shows_torque_share_past_and_extremes() {
    let rising = (0..1100).map(|k| [50.0, f64::from(k) * 0.05 - 20.0, 0.0]);
    let lines = shown(&model(rising));
    assert!(row(&lines, "hip").contains("50.00 ± 0.50"), "{lines:#?}");
    assert!(row(&lines, "hip").contains("█████      "), "{lines:#?}");
    assert!(row(&lines, "hip").contains("50%"));
    let knee = row(&lines, "knee");
    assert!(knee.contains("-20.00") && knee.contains("34.95"), "{knee}");
    let past: Vec<char> = knee.chars().filter(|c| "▁▂▃▄▅▆▇█".contains(*c)).collect();
    assert_eq!(past.last(), Some(&'█'), "{knee}");
    assert!(past.contains(&'▁'));
    assert_eq!(PAST.as_secs(), 10);
    assert_eq!(
        model((0..1100).map(|_| [0.0; 3])).pasts[0].parts.len(),
        PARTS
    );
}

#[test]
fn keys_sort_filter_hold_and_forget() {
    let mut model = model([[10.0, 90.0, 50.0]; 3].into_iter());
    let names = |model: &Model| -> Vec<usize> { model.rows() };
    assert_eq!(names(&model), [0, 1, 2]);
    for _ in 0..2 {
        model.press(Key::Char('s'));
    }
    assert_eq!(names(&model), [1, 2, 0], "by share of the limit");
    for key in ['/', 'K', 'n', 'q'] {
        assert!(!model.ends(Key::Char('q')) || !model.typing);
        model.press(Key::Char(key));
    }
    assert_eq!(
        names(&model),
        [0_usize; 0],
        "no joint has {:?}",
        model.filter
    );
    assert!(
        shown(&model)
            .iter()
            .any(|line| line.contains("joints with: Knq_"))
    );
    model.press(Key::Backspace);
    model.press(Key::Enter);
    assert_eq!(names(&model), [1]);
    assert!(model.ends(Key::Char('q')));
    model.press(Key::Escape);
    model.press(Key::Char(' '));
    let description = description();
    let next = cycle([-70.0, 0.0, 0.0]);
    model.take_cycle(&next, &LoopRecord::default(), &description, Instant::now());
    let lines = shown(&model);
    assert!(lines[0].contains("HELD") && row(&lines, "hip").contains("10.00 ± 0.50"));
    // Extremes go on meanwhile.
    assert!(row(&lines, "hip").contains("-70.00"), "{lines:#?}");
    model.press(Key::Char('r'));
    assert!(model.pasts.iter().all(|past| past.extremes.is_none()));
}

#[test]
fn events_and_a_fault_are_named_with_their_cause() {
    let mut model = model([[0.0; 3]; 2].into_iter());
    let mut next = cycle([0.0; 3]);
    next.stamp_ns = 5_250_000_000;
    next.events[Event::EncoderImplausible.index()] = 3;
    next.fault = Event::EncoderImplausible.number();
    model.take_cycle(
        &next,
        &LoopRecord::default(),
        &description(),
        Instant::now(),
    );
    let lines = shown(&model);
    assert!(lines[1].contains("FAULT 210"), "{lines:#?}");
    let event = lines.iter().find(|line| line.contains("5.250 s  210"));
    assert!(
        event.is_some_and(|line| line.contains("(3 times)")),
        "{lines:#?}"
    );
}

#[test]
fn a_small_terminal_and_a_robot_without_records_are_drawn() {
    for size in [(20, 5), (1, 1), (300, 100)] {
        let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).unwrap();
        let mut model = model([[1.0; 3]; 2].into_iter());
        model.press(Key::Char('?'));
        terminal.draw(|frame| draw(frame, &model)).unwrap();
        terminal
            .draw(|frame| draw(frame, &Model::new(&description())))
            .unwrap();
    }
}
