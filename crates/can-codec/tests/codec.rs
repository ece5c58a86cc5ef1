//! Frames to values and back.

mod common;

use can_codec::{BusDbc, DecodeError, EXTENDED_ID, Frame, Frames, Gather, SignalMap, Table};
use common::{bits_one_by_one, dbc, table};
use proptest::prelude::*;

fn frame(id: u32, bytes: &[u8]) -> Frame {
    let mut frame = Frame::zeroed(0, id, bytes.len() as u8, bytes.len() > 8);
    frame.data[..bytes.len()].copy_from_slice(bytes);
    frame
}

/// The example of the cantools documentation, with its bytes.
const MOTOHAWK: &str = "BO_ 496 ExampleMessage: 8 PCM1\n SG_ Temperature : 0|12@0- (0.01,250) [229.52|270.47] \"degK\" PCM1,FOO\n SG_ AverageRadius : 6|6@0+ (0.1,0) [0|5] \"m\" Vector__XXX\n SG_ Enable : 7|1@0+ (1,0) [0|0] \"-\" Vector__XXX";

#[test]
fn a_frame_of_another_library_means_the_same() {
    let file = dbc(MOTOHAWK);
    let table = table(&file);
    let bytes = [0xC0, 0x06, 0xE0, 0, 0, 0, 0, 0];
    let mut values = [f64::NAN; 3];
    assert_eq!(table.decode(&frame(496, &bytes), &mut values), Ok(Some(0)));
    for (value, expected) in values.iter().zip([250.55, 3.2, 1.0]) {
        assert!((value - expected).abs() < 1e-12, "{values:?}");
    }
    let mut made = Frame::zeroed(9, 9, 9, false);
    assert!(table.encode(0, &values, &mut made));
    assert_eq!(made, frame(496, &bytes));
}

#[test]
fn a_frame_of_the_leg_decodes_as_packed_by_hand() {
    // link_angle 0|19, motor_angle 19|16, current 35|16 signed, status 51|8: counts 262144 + 1,
    // 0xABCD, -1000 and 3, packed by hand.
    let packed: u64 = 262_145 | 0xABCD << 19 | (0x1_0000 - 1000) << 35 | 3 << 51;
    let text = include_str!("../../../robot-models/leg/drives.dbc");
    let leg = can_codec::Dbc::parse(text, "drives.dbc").unwrap();
    let table = table(&leg);
    let index = (0..table.message_count())
        .find(|&i| table.message(i).is_some_and(|m| m.name == "HIP_YAW_STATE"))
        .unwrap();
    let mut values = vec![f64::NAN; table.slot_count()];
    let decoded = table.decode(&frame(257, &packed.to_le_bytes()), &mut values);
    assert_eq!(decoded, Ok(Some(index)));
    let read: Vec<f64> = table.slots(index).map(|slot| values[slot]).collect();
    assert_eq!(read, [262_145.0, 43_981.0, -1000.0, 3.0]);
}

#[test]
fn a_message_is_found_however_many_its_bus_has() {
    for count in [1, 15, 16, 17, 200] {
        let message = |i| {
            format!(
                "BO_ {} M{i}: 1 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n\n",
                2047 - 7 * i
            )
        };
        let file = dbc(&(0..count).map(message).collect::<String>());
        let table = table(&file);
        for id in 0..2048 {
            let mut values = vec![-1.0; count];
            let i = (2047 - id) / 7;
            let decoded = table.decode(&frame(id as u32, &[i as u8]), &mut values);
            if (2047 - id) % 7 == 0 && i < count {
                assert_eq!(decoded, Ok(Some(i)), "{count} messages: {id}");
                values[i] -= (1 + i) as f64;
            } else {
                assert_eq!(
                    decoded,
                    Err(DecodeError::UnknownId),
                    "{count} messages: {id}"
                );
            }
            assert!(
                values.iter().all(|value| *value == -1.0),
                "{count} messages: {id}"
            );
        }
    }
}

#[test]
fn frames_of_no_message_are_refused_by_kind() {
    let file = dbc(
        "BO_ 1 USED: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n\nBO_ 2 IDLE: 8 A\n\nBO_ 2147483649 EXTENDED: 4 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B",
    );
    let table = table(&file);
    assert_eq!(table.message_count(), 2);
    let mut values = [-1.0; 2];
    let mut decode = |frame: Frame| table.decode(&frame, &mut values);
    assert_eq!(decode(frame(1, &[7; 8])), Ok(Some(0)));
    assert_eq!(decode(frame(2, &[7; 8])), Ok(None));
    assert_eq!(decode(frame(1 | EXTENDED_ID, &[7; 4])), Ok(Some(1)));
    assert_eq!(decode(frame(1, &[7; 7])), Err(DecodeError::WrongLength));
    assert_eq!(decode(frame(2, &[7; 3])), Err(DecodeError::WrongLength));
    assert_eq!(decode(frame(3, &[7; 8])), Err(DecodeError::UnknownId));
    assert_eq!(
        decode(frame(2 | EXTENDED_ID, &[7; 8])),
        Err(DecodeError::UnknownId)
    );
    // A remote request (bit 30), another bus, an error frame.
    assert_eq!(
        decode(frame(1 | 1 << 30, &[7; 8])),
        Err(DecodeError::UnknownId)
    );
    let other_bus = Frame {
        bus: 1,
        ..frame(1, &[7; 8])
    };
    assert_eq!(decode(other_bus), Err(DecodeError::UnknownId));
    let error = Frame {
        error: true,
        ..frame(1, &[7; 8])
    };
    assert_eq!(decode(error), Err(DecodeError::UnknownId));
    assert_eq!(values, [7.0; 2]);
}

#[test]
fn maps_are_folded_into_the_scale() {
    let file = dbc("BO_ 1 M: 2 A\n SG_ a : 0|16@1- (0.5,10) [0|0] \"deg\" B");
    let map = SignalMap {
        slot: 3,
        message: "M".to_owned(),
        signal: "a".to_owned(),
        scale: -2.0,
        offset: 1.0,
        wraps: false,
    };
    let on_bus = BusDbc {
        bus: 4,
        fd: false,
        dbc: &file,
    };
    let table = Table::compile(&[on_bus], &[(4, map)]).unwrap();
    let mut values = [0.0; 4];
    let received = Frame {
        bus: 4,
        ..frame(1, &(-6i16).to_le_bytes())
    };
    assert_eq!(table.decode(&received, &mut values), Ok(Some(0)));
    // (-6 · 0.5 + 10) · -2 + 1
    assert_eq!(values, [0.0, 0.0, 0.0, -13.0]);
    let mut made = received;
    assert!(table.encode(0, &values, &mut made));
    assert_eq!(made, received);
}

#[test]
fn values_beyond_the_range_are_limited_or_wrapped() {
    let file = dbc("BO_ 1 M: 2 A\n SG_ a : 0|16@1+ (1,0) [0|3599] \"\" B");
    let encoded = |wraps: bool, value: f64| {
        let map = SignalMap {
            slot: 0,
            message: "M".to_owned(),
            signal: "a".to_owned(),
            scale: 1.0,
            offset: 0.0,
            wraps,
        };
        let on_bus = BusDbc {
            bus: 0,
            fd: false,
            dbc: &file,
        };
        let table = Table::compile(&[on_bus], &[(0, map)]).unwrap();
        let mut made = frame(0, &[]);
        assert!(table.encode(0, &[value], &mut made));
        u16::from_le_bytes([made.data[0], made.data[1]])
    };
    assert_eq!(encoded(false, -5.0), 0);
    assert_eq!(encoded(false, 1e300), 3599);
    assert_eq!(encoded(false, 1.6), 2);
    assert_eq!(encoded(true, -5.0), 3595);
    assert_eq!(encoded(true, 3600.0), 0);
    assert_eq!(encoded(true, 3599.6), 0);
    assert_eq!(encoded(true, -1e-20), 0);
    assert_eq!(encoded(true, 7205.0), 5);
}

#[test]
fn what_is_not_finite_is_not_sent() {
    let file = dbc(
        "BO_ 1 M: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B\n\nBO_ 2 N: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B",
    );
    let table = table(&file);
    let mut frames = Frames::new(8);
    assert_eq!(table.encode_all(&[f64::NAN, 5.0], &mut frames), 1);
    assert_eq!(frames.as_slice()[0].id, 2);
    assert_eq!(table.encode_all(&[1.0, f64::INFINITY], &mut frames), 1);
    // A value that is missing is not made up.
    assert_eq!(table.encode_all(&[1.0], &mut frames), 1);
    let mut short = Frames::new(1);
    assert_eq!(table.encode_all(&[1.0, 2.0], &mut short), 1);
    assert_eq!(short.overflow(), 1);
    short.clear();
    assert_eq!((short.len(), short.overflow()), (0, 0));
}

#[test]
fn gather_waits_for_every_mapped_message() {
    let file = dbc(
        "BO_ 1 M: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B\n\nBO_ 2 N: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B\n\nBO_ 3 IDLE: 2 A",
    );
    let table = table(&file);
    let mut gather = Gather::new(table.message_count());
    assert!(!gather.complete());
    assert!(!gather.note(&table, &frame(1, &[0; 2])));
    assert!(!gather.note(&table, &frame(1, &[0; 2])));
    // Neither an idle message nor a malformed one is an answer.
    assert!(!gather.note(&table, &frame(3, &[0; 2])));
    assert!(!gather.note(&table, &frame(2, &[0; 1])));
    assert_eq!(gather.missing().collect::<Vec<_>>(), [1]);
    assert!(gather.note(&table, &frame(2, &[0; 2])));
    gather.begin();
    assert_eq!(gather.missing().collect::<Vec<_>>(), [0, 1]);
    assert!(Gather::new(0).complete());
    // Messages that come when they like are not waited for, and do no harm.
    let mut only = Gather::only(&[false, true]);
    assert!(!only.note(&table, &frame(1, &[0; 2])));
    assert_eq!(only.missing().collect::<Vec<_>>(), [1]);
    assert!(only.note(&table, &frame(2, &[0; 2])));
    only.begin();
    assert!(!only.complete());
    gather.wait_like(&only);
    assert_eq!(gather.missing().collect::<Vec<_>>(), [1]);
}

#[test]
fn gather_waits_for_a_late_answer_too() {
    let table = table(&dbc(
        "BO_ 1 M: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B\n\nBO_ 2 N: 2 A\n SG_ a : 0|16@1+ (1,0) [0|0] \"\" B",
    ));
    let (m, n) = (frame(1, &[0; 2]), frame(2, &[0; 2]));
    let mut gather = Gather::new(table.message_count());
    // A signal that has never come is not late.
    gather.note(&table, &m);
    gather.begin();
    assert!(!gather.note(&table, &m) && gather.note(&table, &n));
    gather.begin();
    gather.note(&table, &m);
    gather.begin();
    // N's first one may be that of the cycle before.
    assert!(!gather.note(&table, &n));
    assert!(!gather.note(&table, &m));
    assert_eq!(gather.missing().count(), 0);
    assert!(gather.note(&table, &n));
    gather.begin();
    gather.note(&table, &m);
    gather.begin();
    assert!(!gather.note(&table, &m) && !gather.note(&table, &n));
    // It was lost: no cycle waits for it any longer.
    gather.begin();
    assert!(!gather.note(&table, &n) && gather.note(&table, &m));
    // One that comes before the next cycle begins is not waited for then.
    gather.begin();
    gather.note(&table, &m);
    gather.note(&table, &n);
    gather.begin();
    assert!(!gather.note(&table, &n) && gather.note(&table, &m));
    // A drive that is back after a long silence: a few late ones at most.
    for _ in 0..300 {
        gather.begin();
        gather.note(&table, &m);
    }
    gather.begin();
    gather.note(&table, &m);
    assert!(!gather.note(&table, &n) && !gather.note(&table, &n) && gather.note(&table, &n));
    gather.begin();
    assert!(!gather.note(&table, &n) && gather.note(&table, &m));
}

/// A signal somewhere in a frame of 64 bytes, as a DBC file numbers its bits.
fn anywhere() -> impl Strategy<Value = (usize, usize, bool, bool)> {
    (1..=64usize, any::<bool>(), any::<bool>())
        .prop_flat_map(|(size, big, signed)| (0..=512 - size, Just((size, big, signed))))
        .prop_map(|(first, (size, big, signed))| {
            let start = if big {
                8 * (first / 8) + 7 - first % 8
            } else {
                first
            };
            (start, size, big, signed)
        })
}

fn one_signal(start: usize, size: usize, big: bool, signed: bool) -> Table {
    let (order, sign) = (u8::from(!big), if signed { '-' } else { '+' });
    table(&dbc(&format!(
        "BO_ 1 M: 64 A\n SG_ a : {start}|{size}@{order}{sign} (1,0) [0|0] \"\" B"
    )))
}

proptest! {
    #[test]
    fn any_signal_of_any_frame_reads_as_bit_by_bit(
        (start, size, big, signed) in anywhere(),
        data in prop::array::uniform32(any::<u8>()),
        more in prop::array::uniform32(any::<u8>()),
    ) {
        let table = one_signal(start, size, big, signed);
        let frame = frame(1, &[data, more].concat());
        let mut value = [f64::NAN];
        prop_assert_eq!(table.decode(&frame, &mut value), Ok(Some(0)));
        let bits = bits_one_by_one(&frame.data, start, size, big);
        let unused = 64 - size as u32;
        let expected = if signed { ((bits << unused) as i64 >> unused) as f64 } else { bits as f64 };
        prop_assert_eq!(value[0], expected);
    }

    #[test]
    fn any_count_survives_the_frame_and_touches_no_other_bit(
        (start, size, big, signed) in anywhere(),
        bits in any::<u64>(),
    ) {
        // Beyond 53 bits a count is no f64: those below are.
        let kept = size.min(53) as u32;
        let count = if signed {
            (bits as i64 >> (64 - kept)) as f64
        } else {
            (bits >> (64 - kept)) as f64
        };
        let table = one_signal(start, size, big, signed);
        let mut made = frame(0, &[]);
        prop_assert!(table.encode(0, &[count], &mut made));
        let mut value = [f64::NAN];
        prop_assert_eq!(table.decode(&made, &mut value), Ok(Some(0)));
        prop_assert_eq!(value[0], count);
        let set: u32 = made.data.iter().map(|byte| byte.count_ones()).sum();
        prop_assert_eq!(set, bits_one_by_one(&made.data, start, size, big).count_ones());
    }

    #[test]
    fn floats_survive_unchanged(bits in any::<u64>(), start in 0..448usize) {
        let file = format!("BO_ 1 M: 64 A\n SG_ a : {start}|64@1- (1,0) [0|0] \"\" B\n\nSIG_VALTYPE_ 1 a : 2;");
        let value = f64::from_bits(bits);
        let table = table(&dbc(&file));
        let mut made = frame(0, &[]);
        prop_assert_eq!(table.encode(0, &[value], &mut made), value.is_finite());
        if value.is_finite() {
            let mut read = [f64::NAN];
            prop_assert_eq!(table.decode(&made, &mut read), Ok(Some(0)));
            prop_assert_eq!(read[0], value);
        }
    }

    #[test]
    fn no_frame_makes_it_panic(
        bus in any::<u8>(), id in any::<u32>(), len in any::<u8>(), near in 0..4u32,
        error in any::<bool>(), fd in any::<bool>(), data in prop::array::uniform32(any::<u8>()),
    ) {
        let file = dbc(MOTOHAWK);
        let table = table(&file);
        let mut received = frame(if near == 0 { id } else { 496 }, &data);
        (received.bus, received.len, received.fd, received.error) = (bus % 2, len, fd, error);
        let mut gather = Gather::new(table.message_count());
        gather.note(&table, &received);
        let decoded = table.decode(&received, &mut [0.0; 1]);
        let ok = !error && bus % 2 == 0 && received.id == 496 && len == 8;
        prop_assert_eq!(decoded.is_ok(), ok);
        prop_assert!(received.payload().len() <= 64);
    }
}
