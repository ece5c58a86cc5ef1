//! An actuator that is withdrawn in a fault bears its joint by torque.

use super::*;
use drives::family::translation::BEARS;

/// The commands of one that bears its joint by a torque that it has reported, N·m: without a gain for position.
pub(crate) fn bearing(family: &dyn Family, torque: f64) -> Vec<Frame> {
    let a = actuator(family);
    let told = Feedback {
        position: Some(0.0),
        torque: Some(torque),
        ..Feedback::default()
    };
    let answers = family.answer(a.at, &a.model, &told);
    let read = |frame| family.feedback(a.at, &a.model, frame);
    let command = |read: Feedback| {
        let damped = SetPoint {
            position: read.position?,
            torque: read.torque.unwrap_or(0.0),
            kd: a.kd,
            ..SetPoint::default()
        };
        family.command(a.at, &a.model, &damped)
    };
    // Before it has reported a torque there is none.
    let silent = command(Feedback {
        torque: None,
        ..answers.iter().find_map(read).unwrap_or_default()
    });
    answers
        .iter()
        .filter_map(read)
        .filter_map(command)
        .chain(silent)
        .collect()
}

#[test]
fn withdrawn_it_goes_on_with_its_torque_of_before_without_a_position() {
    for family in FAMILIES {
        let (a, name) = (actuator(family), family.name());
        let mut l = Loop::new(&a);
        let told = |state, torque| Feedback {
            position: Some(0.0),
            velocity: Some(0.0),
            torque: Some(torque),
            current: Some(0.0),
            state: Some(state),
            error: Some(0),
            ..Feedback::default()
        };
        // Never enabled: there is nothing to go on with.
        tell(&mut l, family, &told(State::Off, 0.0), 1);
        let left = l.encode(CONTROL, f64::from(BEAR));
        assert!(
            left.iter().all(|frame| *frame == family.disable(a.at)),
            "{name}"
        );
        l.encode(CONTROL, f64::from(ENABLE));
        for k in 1..2000 {
            l.encode(SET_POINT, 0.5);
            // At last it runs away for 20 ms.
            let torque = if k < 1980 { 3.0 } else { a.model.torque };
            tell(&mut l, family, &told(State::Enabled, torque), k * 1_000_000);
        }
        let left = l.encode(CONTROL, f64::from(BEAR));
        if !family.commands_gains() {
            assert_eq!(left, [family.disable(a.at)], "{name}");
            continue;
        }
        assert!(left.is_empty(), "{name}");
        l.send(&ask(0));
        let sent = l.send(&ask(0));
        let most = 0.07 * 0.015 * a.kp;
        let within = (0..=20).any(|k| {
            let torque = 3.0 + most * f64::from(k) / 20.0;
            bearing(family, torque)
                .iter()
                .any(|frame| sent.contains(frame))
        });
        // Those that send floats are not hit by twenty tries.
        assert!(within || a.model.position > 1e3, "{name}");
        // Its status is that it bears the joint only where its torque is that of before.
        for (torque, status) in [(3.0, BEARS), (-3.0 - 0.2 * a.model.torque, ENABLE)] {
            tell(&mut l, family, &told(State::Enabled, torque), 3_000_000_000);
            assert_eq!(l.slots[STATUS], f64::from(status), "{name} {torque}");
        }
        assert_eq!(
            l.encode(CONTROL, f64::from(DISABLE)),
            [family.disable(a.at)],
            "{name}"
        );
        assert!(l.encode(SET_POINT, 0.5).is_empty(), "{name}");
    }
}
