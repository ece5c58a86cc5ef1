//! Families of actuators: their frames beside those of masters that other people wrote, and what holds
//! for all of them.

use can_codec::Frame;
use drives::family::{Address, FAMILIES, Family, Feedback, Model, SetPoint, State};
use proptest::prelude::*;

const AT: Address = Address {
    bus: 1,
    node: 3,
    master: 0x13,
};

/// Frames of other people's masters, written and checked by rt-tests/python/test_drive_families.py.
const MASTERS: &str = include_str!("masters.txt");
/// Frames of our simulated actuators, which those masters read there.
const ANSWERS: &str = include_str!("answers.txt");

fn family(name: &str) -> &'static dyn Family {
    let mut all = FAMILIES.into_iter();
    all.find(|family| family.name() == name).expect("a family")
}

fn model(family: &dyn Family, name: &str) -> Model {
    let mut models = family.models().iter();
    *models.find(|model| model.name == name).expect("a model")
}

fn hex(frame: &Frame) -> String {
    frame
        .payload()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

/// Counts of a frame in MIT mode: position, velocity, kp, kd, torque.
fn counts(data: &str) -> [i64; 5] {
    let value = u64::from_str_radix(data, 16).expect("eight bytes");
    let mut first = 0;
    [16, 12, 12, 12, 12].map(|bits| {
        let count = value << first >> (64 - bits);
        first += bits;
        count as i64
    })
}

#[test]
fn ours_send_what_other_masters_send() {
    for line in MASTERS.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let (family, name) = (family(words[0]), words[0]);
        let model = model(family, words[1]);
        let numbers = words[5..]
            .iter()
            .map(|word| word.parse().expect("a number"));
        let numbers: Vec<f64> = numbers.collect();
        let frame = match words[2] {
            "enable" => family.enable(AT),
            "disable" => family.disable(AT),
            "clear" => family.clear(AT),
            "poll" => family.poll(AT).expect("a question"),
            "mode" | "position_gain" | "velocity_gains" => {
                let hold = SetPoint {
                    kp: 1.0,
                    kd: 0.03,
                    ..SetPoint::default()
                };
                let all = ["mode", "position_gain", "velocity_gains"];
                let at = all.iter().position(|what| *what == words[2]);
                let frames = family.prepare(AT, &model, &hold);
                frames[at.expect("one of them")].expect("a frame")
            }
            _ => {
                let &[position, velocity, torque, kp, kd] = numbers.as_slice() else {
                    panic!("{line}");
                };
                let set_point = SetPoint {
                    position,
                    velocity,
                    torque,
                    kp,
                    kd,
                };
                family.command(AT, &model, &set_point).expect("finite")
            }
        };
        assert_eq!(format!("{:x}", frame.id), words[3], "{line}");
        assert_eq!(frame.bus, AT.bus);
        if name == "damiao" && words[2] == "command" {
            // Theirs cuts a count's fraction off, ours takes the nearest; of kp ours leaves the end out.
            let (ours, theirs) = (counts(&hex(&frame)), counts(words[4]));
            for (field, (ours, theirs)) in ours.into_iter().zip(theirs).enumerate() {
                let end = field == 2 && (ours, theirs) == (4094, 4095);
                assert!(
                    end || (0..=1).contains(&(ours - theirs)),
                    "{line}: {}",
                    hex(&frame)
                );
            }
        } else {
            assert_eq!(hex(&frame), words[4], "{line}");
        }
    }
}

fn conditions(model: &Model) -> [Feedback; 3] {
    let share = |part: f64| Feedback {
        position: Some(part * model.position.min(12.0)),
        velocity: Some(-part * model.velocity),
        torque: Some(part * model.torque),
        current: Some(part * 6.0),
        temperature: Some(41.0),
        voltage: Some(48.0),
        state: Some(State::Enabled),
        error: Some(0),
    };
    let off = Feedback {
        state: Some(State::Off),
        ..share(0.0)
    };
    let fault = Feedback {
        state: Some(State::Fault),
        error: Some(0x8),
        ..share(-0.25)
    };
    [off, share(0.5), fault]
}

#[test]
fn our_answers_are_the_recorded_ones() {
    let mut lines = Vec::new();
    for family in FAMILIES {
        for model in family.models() {
            for condition in conditions(model) {
                for frame in family.answer(AT, model, &condition) {
                    let number = |x: Option<f64>| x.unwrap_or(f64::NAN);
                    lines.push(format!(
                        "{} {} {:x} {} {} {} {} {} {} {} {} {}",
                        family.name(),
                        model.name,
                        frame.id,
                        hex(&frame),
                        number(condition.position),
                        number(condition.velocity),
                        number(condition.torque),
                        number(condition.current),
                        number(condition.temperature),
                        number(condition.voltage),
                        format!("{:?}", condition.state.unwrap_or_default()).to_lowercase(),
                        condition.error.unwrap_or(0),
                    ));
                }
            }
        }
    }
    assert_eq!(ANSWERS, lines.join("\n") + "\n", "{}", lines.join("\n"));
}

#[test]
fn an_answer_is_read_as_it_was_meant() {
    for family in FAMILIES {
        for model in family.models() {
            for condition in conditions(model) {
                let mut read = Feedback::default();
                for frame in family.answer(AT, model, &condition) {
                    let part = family.feedback(AT, model, &frame).expect("its own");
                    read.position = part.position.or(read.position);
                    read.velocity = part.velocity.or(read.velocity);
                    read.state = part.state.or(read.state);
                    read.error = part.error.or(read.error);
                    let whole = |read: Option<f64>, part: Option<f64>| part.or(read);
                    read.current = whole(read.current, part.current);
                    read.temperature = whole(read.temperature, part.temperature);
                    read.voltage = whole(read.voltage, part.voltage);
                    // Neither another node nor another bus takes it for its own.
                    let others = [Address { node: 4, ..AT }, Address { bus: 0, ..AT }];
                    for other in others {
                        assert_eq!(family.feedback(other, model, &frame), None, "{frame:?}");
                    }
                }
                let near = |read: Option<f64>, meant: Option<f64>, range: f64| {
                    let (read, meant) = (read.expect("read"), meant.expect("meant"));
                    assert!((read - meant).abs() <= range / 4095.0, "{read} {meant}");
                };
                near(read.position, condition.position, model.position.min(12.5));
                near(read.velocity, condition.velocity, model.velocity);
                let told = condition
                    .state
                    .filter(|&state| family.tells_whether_on() || state == State::Fault);
                assert_eq!((read.state, read.error), (told, condition.error));
                assert_eq!(read.temperature, condition.temperature);
                // Not all tell these.
                let or_none = |x: Option<f64>, meant| x.is_none() || x == meant;
                assert!(or_none(read.current, condition.current));
                assert!(or_none(read.voltage, condition.voltage));
                assert!(!family.error_text(condition.error.unwrap_or(0)).is_empty());
            }
        }
    }
}

/// Torque of a command frame by the counts that the actuator reads; none where it has no such field.
fn torque_of(family: &dyn Family, model: &Model, frame: &Frame) -> f64 {
    match family.name() {
        "damiao" | "cubemars" | "myactuator" => {
            let [_, _, kp, kd, torque] = counts(&hex(frame));
            assert_eq!((kp, kd), (0, 0));
            (torque as f64 / 4095.0 * 2.0 - 1.0) * model.torque
        }
        "moteus" => {
            // Five floats from the seventh byte on; the last two are shares of its own gains.
            let float = |i: usize| {
                let bytes = frame.data[6 + 4 * i..].first_chunk::<4>().expect("a float");
                f64::from(f32::from_le_bytes(*bytes))
            };
            assert_eq!((float(3), float(4)), (0.0, 0.0));
            float(2)
        }
        "robstride" => {
            assert_eq!(frame.data[4..8], [0; 4]);
            (f64::from(frame.id >> 8 & 0xFFFF) / 65535.0 * 2.0 - 1.0) * model.torque
        }
        _ => f64::from(i16::from_le_bytes([frame.data[6], frame.data[7]])) / 1000.0,
    }
}

#[test]
fn what_is_sent_before_enabling_ends_with_where_it_stands() {
    for family in FAMILIES {
        let model = &family.models()[0];
        let hold = SetPoint {
            position: 0.7,
            kp: 1.0,
            kd: 0.03,
            ..SetPoint::default()
        };
        let frames: Vec<Frame> = family
            .prepare(AT, model, &hold)
            .into_iter()
            .flatten()
            .collect();
        let words = [family.enable(AT), family.disable(AT), family.clear(AT)];
        assert!(
            frames
                .iter()
                .all(|frame| words.iter().all(|word| word.id != frame.id))
        );
        let target = family.command(AT, model, &hold);
        assert!(
            frames.is_empty() || frames.last().copied() == target,
            "{}",
            family.name()
        );
    }
}

proptest! {
    /// A command without gains and torque makes none, wherever it says that the joint should be: at
    /// most half a count of it.
    #[test]
    fn no_gains_and_no_torque_are_no_torque(position in -100.0..100.0f64, velocity in -100.0..100.0f64) {
        for family in FAMILIES {
            for model in family.models() {
                let set_point = SetPoint { position, velocity, ..SetPoint::default() };
                let frame = family.command(AT, model, &set_point).expect("finite");
                let torque = torque_of(family, model, &frame);
                prop_assert!(torque.abs() <= model.torque / 4095.0, "{} {torque}", family.name());
            }
        }
    }

    /// What is not finite makes no frame.
    #[test]
    fn what_is_not_finite_is_not_sent(field in 0usize..5, bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)]) {
        let mut numbers = [0.0; 5];
        numbers[field] = bad;
        let [position, velocity, torque, kp, kd] = numbers;
        for family in FAMILIES {
            let set_point = SetPoint { position, velocity, torque, kp, kd };
            prop_assert!(family.command(AT, &family.models()[0], &set_point).is_none());
        }
    }

    /// No bytes make a reader panic, or give a number that is not finite.
    #[test]
    fn any_frame_is_read_or_passed_over(id in any::<u32>(), own: bool, bytes in prop::collection::vec(any::<u8>(), 0..=8)) {
        for family in FAMILIES {
            for model in family.models() {
                let from = family.answer(AT, model, &Feedback::default());
                let id = if own { from[0].id } else { id };
                let mut frame = Frame::zeroed(AT.bus, id, bytes.len() as u8, from[0].fd);
                frame.data[..bytes.len()].copy_from_slice(&bytes);
                if let Some(read) = family.feedback(AT, model, &frame) {
                    let numbers = [
                        read.position,
                        read.velocity,
                        read.torque,
                        read.current,
                        read.temperature,
                        read.voltage,
                    ];
                    prop_assert!(numbers.iter().flatten().all(|x| x.is_finite()), "{read:?}");
                }
            }
        }
    }
}

proptest! {
    /// No command is a word that enables, disables, clears or sets the zero.
    #[test]
    fn no_command_is_a_word(
        numbers in [-1e3..1e3f64, -1e3..1e3f64, -1e3..1e3f64, -1e3..1e3f64, -1e3..1e3f64],
        at_end: bool,
    ) {
        let [position, velocity, torque, kp, kd] = numbers;
        let all = SetPoint { position, velocity, torque, kp, kd };
        let end = SetPoint { position: 1e3, velocity: 1e3, kp: 1e3, kd: 1e3, ..all };
        for family in FAMILIES {
            for model in family.models() {
                // Near the end of the torque's range lie the words' last bytes.
                let torque = model.torque * (1.0 - torque.abs() * 1e-5);
                let set_point = if at_end { SetPoint { torque, ..end } } else { all };
                let frame = family.command(AT, model, &set_point).expect("finite");
                // Elsewhere a word has an identifier of its own.
                let enable = family.enable(AT);
                let shares = frame.id == enable.id && enable.data[..7] == [0xFF; 7];
                prop_assert!(!shares || frame.data[..7] != [0xFF; 7], "{}", family.name());
            }
        }
    }
}

#[test]
fn a_question_can_move_nothing() {
    for family in FAMILIES {
        let Some(poll) = family.poll(AT) else {
            continue;
        };
        let model = &family.models()[0];
        let words = [family.enable(AT), family.clear(AT)];
        assert!(
            words
                .iter()
                .all(|word| (word.id, word.data) != (poll.id, poll.data))
        );
        // It has another identifier, or another kind, than a command; of moteus it writes nothing.
        let command = family
            .command(AT, model, &SetPoint::default())
            .expect("finite");
        let reads = poll.fd && poll.data[..7] == [0x11, 0, 0x1C, 4, 1, 0x13, 0xD];
        let nothing = poll.payload()[7..].iter().all(|byte| *byte == 0x50);
        assert!(command.id != poll.id || reads && nothing);
    }
}
