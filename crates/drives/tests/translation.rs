//! Actuators as the loop sees them, and what leaves on the bus for its messages.

use can_codec::{BusDbc, Frame, Frames, SignalMap, Table};
use drives::family::translation::{
    self, Actuator, BEAR, DISABLE, ENABLE, RESET, Translator, ask, is_own,
};
use drives::family::{Address, FAMILIES, Family, Feedback, SetPoint, State};
use proptest::prelude::*;

#[path = "translation/bearing.rs"]
mod bearing;
use bearing::bearing;

fn actuator(family: &dyn Family) -> Actuator {
    Actuator {
        family: family.name(),
        model: family.models()[0],
        at: Address {
            bus: 0,
            node: 3,
            master: 0x13,
        },
        name: "knee".to_owned(),
        kp: 80.0,
        kd: 2.0,
        gear_ratio: 10.0,
        torque_per_current: 2.0,
    }
}

/// The loop's side: its tables, and the messages that it sends.
struct Loop {
    translator: Translator,
    table: Table,
    slots: Vec<f64>,
}

/// Slots, in the order of the messages' signals.
const ANGLE: usize = 0;
const VELOCITY: usize = 1;
const CURRENT: usize = 2;
const STATUS: usize = 3;
const TORQUE: usize = 4;
const TEMPERATURE: usize = 5;
const VOLTAGE: usize = 6;
const ERROR: usize = 7;
const SET_POINT: usize = 8;
const CONTROL: usize = 9;

impl Loop {
    fn new(actuator: &Actuator) -> Self {
        let dbc = actuator.messages();
        let dbcs = [BusDbc {
            bus: 0,
            fd: true,
            dbc: &dbc,
        }];
        let table = Table::compile(&dbcs, &SignalMap::all(0, &dbc.messages)).expect("a table");
        let translator = Translator::new(std::slice::from_ref(actuator));
        Self {
            translator: translator.expect("families").expect("an actuator"),
            table,
            slots: vec![0.0; 10],
        }
    }

    /// What leaves for a frame of the loop.
    fn send(&mut self, frame: &Frame) -> Vec<Frame> {
        let mut out = Frames::new(self.translator.most() + 1);
        self.translator.send(frame, &mut out);
        out.iter().copied().collect()
    }

    /// What leaves for the message with that signal.
    fn encode(&mut self, slot: usize, value: f64) -> Vec<Frame> {
        self.slots[slot] = value;
        let index = (0..self.table.message_count())
            .find(|&index| self.table.slots(index).any(|s| s == slot))
            .expect("its message");
        let mut frame = Frame::zeroed(0, 0, 0, false);
        assert!(self.table.encode(index, &self.slots, &mut frame));
        self.send(&frame)
    }

    fn receive(&mut self, frame: &Frame, stamp_ns: u64) -> bool {
        let mut frame = Frame { stamp_ns, ..*frame };
        // Whatever the loop gets of an actuator, it knows; what somebody else sends as its message is without data.
        let passed = self.translator.receive(&mut frame) && frame.len > 0;
        let known = matches!(self.table.decode(&frame, &mut self.slots), Ok(Some(_)));
        assert_eq!(passed, known, "{frame:?}");
        known
    }
}

/// Tells the loop a state, as the family's actuator does.
fn tell(l: &mut Loop, family: &dyn Family, told: &Feedback, stamp_ns: u64) -> bool {
    let a = actuator(family);
    // What is told apart is told before the position.
    let mut frames = family.answer(a.at, &a.model, told);
    frames.reverse();
    let mut any = false;
    for frame in &frames {
        any |= l.receive(frame, stamp_ns);
    }
    any
}

#[test]
fn a_state_reaches_the_loop_in_its_units() {
    for family in FAMILIES {
        let mut l = Loop::new(&actuator(family));
        let told = Feedback {
            position: Some(-1.25),
            velocity: Some(2.0),
            torque: Some(3.0),
            current: Some(0.75),
            state: Some(State::Enabled),
            error: Some(0),
            ..Feedback::default()
        };
        // Some do not tell that they are on.
        l.encode(CONTROL, f64::from(ENABLE));
        assert!(tell(&mut l, family, &told, 1_000), "{}", family.name());
        // Ten turns of the motor are one of the output.
        let turns = if family.at_motor() { 1.0 } else { 10.0 };
        let slots = &l.slots;
        // Half a count of those that count, of a position twice, and what is left of a float.
        let model = &family.models()[0];
        let counts = model.position < 1e3;
        let near = |slot: f64, meant: f64, range: f64, counted: f64| {
            let count = if counts { range / counted } else { 2e-5 };
            assert!(
                (slot - meant).abs() <= count,
                "{} {slot} {meant}",
                family.name()
            );
        };
        near(slots[ANGLE] / turns, -1.25, 2.0 * model.position, 65535.0);
        near(slots[VELOCITY] / turns, 2.0, model.velocity, 4095.0);
        // A torque of 3 N·m is 1.5 A; who tells the current is believed.
        let tells = matches!(family.name(), "odrive" | "moteus");
        let current = if tells { 0.75 } else { 1.5 };
        near(slots[CURRENT], current, model.torque / 2.0, 4095.0);
        assert_eq!(l.slots[STATUS] as u32 & 0xFF, 1);
    }
}

#[test]
fn a_state_that_is_no_longer_told_is_unknown() {
    // ODrive tells its state apart from its position.
    let family = translation::named("odrive").expect("a family");
    let mut l = Loop::new(&actuator(family));
    let told = Feedback {
        position: Some(0.0),
        state: Some(State::Enabled),
        ..Feedback::default()
    };
    assert!(tell(&mut l, family, &told, 1_000));
    let a = actuator(family);
    let frames = family.answer(a.at, &a.model, &told);
    let (position, current) = (frames[0], frames[1]);
    assert!(l.receive(&position, 400_000_000));
    assert_eq!(l.slots[STATUS], 1.0);
    assert!(
        !l.receive(&position, 600_000_000),
        "its current is not told"
    );
    assert!(!l.receive(&current, 600_000_000), "no position");
    assert!(l.receive(&position, 600_000_000));
    assert_eq!(l.slots[STATUS], 3.0);
}

#[test]
fn one_that_tells_its_state_seldom_is_enabled_once_and_where_it_stands() {
    let family = translation::named("odrive").expect("a family");
    let a = actuator(family);
    let mut l = Loop::new(&a);
    let told = |state| Feedback {
        position: Some(4.0),
        state: Some(state),
        ..Feedback::default()
    };
    assert!(tell(&mut l, family, &told(State::Off), 1));
    // At the motor, which turns ten times for the output's once.
    let hold = SetPoint {
        position: 4.0,
        kp: 0.8,
        kd: 0.02,
        ..SetPoint::default()
    };
    let before = family.prepare(a.at, &a.model, &hold);
    let mut all: Vec<Frame> = before.into_iter().flatten().collect();
    all.push(family.enable(a.at));
    assert_eq!(l.encode(CONTROL, f64::from(ENABLE)), all);
    for _ in 0..3 {
        assert!(l.encode(CONTROL, f64::from(ENABLE)).is_empty());
    }
    tell(&mut l, family, &told(State::Off), 2);
    assert!(
        l.encode(CONTROL, f64::from(ENABLE)).is_empty(),
        "told before it could hear"
    );
    tell(&mut l, family, &told(State::Off), 3);
    assert_eq!(
        l.encode(CONTROL, f64::from(ENABLE)),
        all,
        "the frame was lost"
    );
    // Off, though nothing has told yet that it was on.
    assert_eq!(
        l.encode(CONTROL, f64::from(DISABLE)),
        [family.disable(a.at)]
    );
    // A calibration is not broken off.
    tell(&mut l, family, &told(State::Busy), 4);
    assert!(l.encode(CONTROL, f64::from(ENABLE)).is_empty());
    assert_eq!(l.slots[STATUS], 3.0);
}

#[test]
fn the_messages_between_loop_and_translation_are_on_no_bus() {
    for family in FAMILIES {
        let mut l = Loop::new(&actuator(family));
        l.encode(CONTROL, f64::from(ENABLE));
        let all = [
            l.encode(SET_POINT, 0.5),
            l.send(&ask(0)),
            l.encode(CONTROL, f64::from(RESET)),
        ];
        assert!(all.iter().flatten().all(|frame| !is_own(frame.id)));
        // Nor are they believed if somebody else sends them.
        let mut state = Frame::zeroed(0, actuator(family).messages().messages[0].id, 16, true);
        state.data[0] = 1;
        assert!(!l.receive(&state, 1));
    }
}

#[test]
fn a_set_point_goes_out_once_enabled_and_again_when_the_next_cycle_asks() {
    let family = translation::named("damiao").expect("a family");
    let a = actuator(family);
    let mut l = Loop::new(&a);
    let question = family.poll(a.at).expect("a question");
    assert_eq!(l.send(&ask(0)), [question]);
    assert!(l.encode(SET_POINT, 0.5).is_empty());
    assert_eq!(l.encode(CONTROL, f64::from(ENABLE)), [family.enable(a.at)]);
    // A count of its position: no remainder is left for the torque.
    let position = 2622.0 * 2.0 * a.model.position / 65535.0 - a.model.position;
    let set_point = SetPoint {
        position,
        kp: 80.0,
        kd: 2.0,
        ..SetPoint::default()
    };
    let command = family.command(a.at, &a.model, &set_point).expect("a frame");
    assert_eq!(l.encode(SET_POINT, position), [command]);
    assert_eq!(l.send(&ask(0)), [command]);
    // Withdrawn: asked without gains.
    assert_eq!(l.send(&ask(0)), [question]);
}

/// Position, rad, and torque, N·m, of a Damiao command by the maker's manual: fields of 16, 12, 12, 12 and 12 bits.
fn by_the_manual(frame: &Frame, range: f64, torque_range: f64) -> (f64, f64) {
    let d = &frame.data;
    let position = f64::from(u16::from_be_bytes([d[0], d[1]]));
    let torque = f64::from(u16::from(d[6] & 0x0F) << 8 | u16::from(d[7]));
    (
        position * 2.0 * range / 65535.0 - range,
        torque * 2.0 * torque_range / 4095.0 - torque_range,
    )
}

#[test]
fn what_counting_takes_from_a_position_goes_as_torque() {
    let family = translation::named("damiao").expect("a family");
    let a = actuator(family);
    let mut l = Loop::new(&a);
    l.encode(CONTROL, f64::from(ENABLE));
    let half_a_count = a.model.torque / 4095.0;
    let mut without: f64 = 0.0;
    for k in 0..1000 {
        let asked = -12.4 + 0.024_813 * f64::from(k);
        let frame = l.encode(SET_POINT, asked)[0];
        let (position, torque) = by_the_manual(&frame, a.model.position, a.model.torque);
        let missing = a.kp * (asked - position);
        assert!((torque - missing).abs() < 1.01 * half_a_count, "{asked}");
        without = without.max(missing.abs());
    }
    assert!(without > 5.0 * half_a_count, "{without}");
    // Beyond the range nothing makes it up.
    let frame = l.encode(SET_POINT, 20.0)[0];
    let (position, torque) = by_the_manual(&frame, a.model.position, a.model.torque);
    assert_eq!(position, a.model.position);
    assert!(torque.abs() < 1.01 * half_a_count, "{torque}");
}

#[derive(Clone, Debug)]
enum Act {
    Ask,
    Control(u32),
    SetPoint(f64),
    Told(State),
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let state = prop_oneof![
        Just(State::Off),
        Just(State::Enabled),
        Just(State::Fault),
        Just(State::Busy)
    ];
    let act = prop_oneof![
        Just(Act::Ask),
        (0u32..4).prop_map(Act::Control),
        (-3.0..3.0).prop_map(Act::SetPoint),
        state.prop_map(Act::Told),
    ];
    proptest::collection::vec(act, 1..60)
}

proptest! {
    /// No set-point by accident: whatever the loop does and the actuator tells, nothing with gains or an
    /// enabling word leaves unless enabling was the last control word.
    #[test]
    fn nothing_moves_it_unless_it_is_to_be_enabled(acts in acts()) {
        for family in FAMILIES {
            let a = actuator(family);
            let mut l = Loop::new(&a);
            let mut word = DISABLE;
            let harmless: Vec<Frame> = [
                family.idle(a.at, &a.model),
                family.poll(a.at),
                Some(family.disable(a.at)),
                Some(family.clear(a.at)),
            ]
            .into_iter()
            .flatten()
            .collect();
            for act in &acts {
                let out = match act {
                    Act::Ask => l.send(&ask(0)),
                    Act::Control(w) => {
                        let was_on = word == ENABLE;
                        word = *w;
                        let out = l.encode(CONTROL, f64::from(*w));
                        // No torque after disabling, whatever it has told of itself.
                        let off = [family.disable(a.at), family.clear(a.at)];
                        let ends = out.iter().any(|frame| off.contains(frame));
                        prop_assert!(!was_on || matches!(word, ENABLE | BEAR) || ends, "{}", family.name());
                        out
                    }
                    Act::SetPoint(x) => l.encode(SET_POINT, *x),
                    Act::Told(state) => {
                        let told = Feedback { position: Some(0.0), state: Some(*state), ..Feedback::default() };
                        tell(&mut l, family, &told, 1);
                        Vec::new()
                    }
                };
                for frame in out {
                    let bears = word == BEAR && bearing(family, 0.0).contains(&frame);
                    prop_assert!(word == ENABLE || bears || harmless.contains(&frame), "{act:?}: {frame:?}");
                }
            }
        }
    }
}

#[test]
fn temperature_voltage_torque_and_error_reach_the_loop_until_they_are_old() {
    let told = Feedback {
        position: Some(0.5),
        velocity: Some(0.0),
        torque: Some(1.0),
        current: Some(0.5),
        temperature: Some(61.0),
        voltage: Some(48.0),
        state: Some(State::Fault),
        error: Some(8),
    };
    for family in FAMILIES {
        let mut l = Loop::new(&actuator(family));
        assert!(tell(&mut l, family, &told, 1_000_000), "{}", family.name());
        let name = family.name();
        // Each as its frames tell it: as the family's own reading of them.
        let a = actuator(family);
        let mut read = Feedback::default();
        for frame in family.answer(a.at, &a.model, &told) {
            let one = family.feedback(a.at, &a.model, &frame).expect("an answer");
            read.torque = one.torque.or(read.torque);
            read.temperature = one.temperature.or(read.temperature);
            read.voltage = one.voltage.or(read.voltage);
            read.error = one.error.or(read.error);
        }
        let ratio = if family.at_motor() { 10.0 } else { 1.0 };
        let wanted = [
            (TORQUE, read.torque.map(|x| x * ratio)),
            (TEMPERATURE, read.temperature),
            (VOLTAGE, read.voltage),
            (ERROR, read.error.map(f64::from)),
        ];
        for (slot, wanted) in wanted {
            let known = l.slots[slot];
            match wanted {
                Some(wanted) => assert!((known - wanted).abs() < 1e-4, "{name} {slot} {known}"),
                None => assert!(known.is_nan() || slot == ERROR, "{name} {slot} {known}"),
            }
        }
        // Three seconds later a position comes alone.
        let only = family
            .answer(a.at, &a.model, &told)
            .into_iter()
            .find(|frame| {
                let one = family.feedback(a.at, &a.model, frame);
                one.is_some_and(|one| one.position.is_some() && one.temperature.is_none())
            });
        if let Some(frame) = only {
            l.receive(&frame, 3_000_000_000);
            let current = family.answer(a.at, &a.model, &told);
            for frame in &current {
                let one = family.feedback(a.at, &a.model, frame).expect("an answer");
                if one.temperature.is_none() && one.voltage.is_none() {
                    l.receive(frame, 3_000_000_000);
                }
            }
            l.receive(&frame, 3_000_000_001);
            assert!(l.slots[TEMPERATURE].is_nan(), "{name}");
        }
    }
}

#[test]
fn a_bus_carries_what_is_counted() {
    for family in FAMILIES {
        let a = actuator(family);
        let all = a.exchanged(1e-3);
        let of = |received| {
            let its = all.iter().filter(|one| one.received == received);
            its.map(|one| one.per_cycle).sum::<f64>()
        };
        // Two commands and two answers, or one command and what comes by itself.
        let polled = if family.tells_apart() { 1.0 } else { 2.0 };
        assert!((of(false) - polled).abs() < 0.1, "{}", family.name());
        assert!((of(true) - 2.0).abs() < 0.2, "{}", family.name());
    }
}
