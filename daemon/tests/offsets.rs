//! The file that keeps the offsets of tares: a written file is read again, and no other file is
//! ever accepted.

use jiff::Timestamp;
use proptest::prelude::*;
use test_support::TemporaryDirectory;
use torqued::offsets::{Offsets, SensorOffset, Store};

const NAMES: [&str; 2] = ["left", "right"];

fn sensor(name: &str, first: f64) -> SensorOffset {
    SensorOffset {
        name: name.to_owned(),
        offset: std::array::from_fn(|k| first * 0.1 + k as f64),
        sigma: [0.5, 0.25, 1.0 / 3.0, 0.0, 1e-9, 2.0],
        known: [true, false, true, true, false, true],
    }
}

fn offsets() -> Offsets {
    Offsets {
        date: Timestamp::from_second(1_795_245_606).expect("a date"),
        contacts: "in_the_air".to_owned(),
        sensors: vec![sensor("left", -3.0), sensor("right", 7.0)],
    }
}

/// A state directory of one test.
struct State(TemporaryDirectory);

impl State {
    fn store(&self) -> Store {
        Store::at(self.0.path(), "leg")
    }
}

#[test]
fn saved_offsets_are_loaded_until_they_are_forgotten() {
    let state = State(TemporaryDirectory::new());
    let store = state.store();
    assert_eq!(store.load(&NAMES), Ok(None), "no tare yet");
    let mut kept = offsets();
    for round in 0..3 {
        kept.sensors[1].offset[5] = f64::from(round) / 7.0;
        store.save(&kept).expect("saved");
        assert_eq!(
            store.load(&NAMES),
            Ok(Some(kept.clone())),
            "to the last bit"
        );
    }
    let files: Vec<_> = std::fs::read_dir(store.file().parent().expect("a folder"))
        .expect("readable")
        .flatten()
        .map(|f| f.file_name())
        .collect();
    assert_eq!(files, ["ft_offsets.toml"], "nothing is left beside it");
    let text = std::fs::read_to_string(store.file()).expect("text");
    assert!(text.contains("date = \"2026-11-21T"), "{text}");
    store.forget().expect("forgotten");
    store.forget().expect("nothing to forget");
    assert_eq!(store.load(&NAMES), Ok(None));
}

#[test]
fn sensors_may_stand_in_any_order() {
    let mut reversed = offsets();
    reversed.sensors.reverse();
    let text = reversed.to_text("leg").expect("text");
    assert_eq!(Offsets::parse(&text, "leg", &NAMES), Ok(offsets()));
}

#[test]
fn a_wrong_file_is_refused_with_its_name_and_the_remedy() {
    let state = State(TemporaryDirectory::new());
    let store = state.store();
    store.save(&offsets()).expect("saved");
    let good = std::fs::read_to_string(store.file()).expect("text");
    for (from, to, part) in [
        ("format = 1", "format = 2", "format 2"),
        ("robot = \"leg\"", "robot = \"arm\"", "robot \"arm\""),
        ("\"left\"", "\"ankle\"", "ankle, right; allowed"),
        ("\"left\"", "\"right\"", "right, right; allowed"),
        ("date = \"2026", "date = \"yesterday 2026", "RFC 3339"),
        ("sigma = [0.5,", "sigma = [-0.5,", "sensor left"),
        ("sigma = [0.5,", "sigma = [nan,", "sensor left"),
        ("offset = [", "offset = [0.0, ", "7 values; allowed: 6"),
        ("offset = [-0.30000000000000004, ", "offset = [", "5 values"),
        (
            "offset = [-0.30000000000000004,",
            "offset = [1e9,",
            "sensor left",
        ),
        ("known = [true,", "known = [1,", "boolean"),
        ("contacts =", "touch =", "touch"),
    ] {
        assert!(good.contains(from), "{from} in {good}");
        std::fs::write(store.file(), good.replacen(from, to, 1)).expect("written");
        let refused = store.load(&NAMES).expect_err(to).to_string();
        let file = store.file().display().to_string();
        for part in [part, &file, "remove it", "tare again"] {
            assert!(refused.contains(part), "{part} is missing in: {refused}");
        }
    }
    std::fs::write(store.file(), [0xff, 0xfe, 0x00]).expect("written");
    assert!(store.load(&NAMES).is_err(), "not UTF-8");
    std::fs::write(store.file(), "").expect("written");
    assert!(store.load(&NAMES).is_err(), "empty, as after a crash");
}

#[test]
fn a_folder_that_cannot_be_written_is_an_error() {
    let result = Store::at("/proc/torqued".as_ref(), "leg").save(&offsets());
    let problem = result.expect_err("/proc");
    assert!(problem.file.starts_with("/proc/torqued/leg"), "{problem}");
}

proptest! {
    #[test]
    fn random_bytes_are_no_offsets(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        prop_assert!(Offsets::parse(&text, "leg", &NAMES).is_err());
    }

    /// A changed byte is noticed, or makes another number or name that is still allowed.
    #[test]
    fn a_changed_byte_never_gives_numbers_out_of_range(place in 0_usize..900, byte in any::<u8>()) {
        let mut bytes = offsets().to_text("leg").expect("text").into_bytes();
        let place = place % bytes.len();
        bytes[place] = byte;
        if let Ok(read) = Offsets::parse(&String::from_utf8_lossy(&bytes), "leg", &NAMES) {
            prop_assert_eq!(read.sensors.len(), 2);
            for sensor in read.sensors {
                prop_assert!(NAMES.contains(&sensor.name.as_str()));
                prop_assert!(sensor.offset.iter().all(|x| x.abs() <= 1e5));
                prop_assert!(sensor.sigma.iter().all(|x| (0.0..=1e5).contains(x)));
            }
        }
    }

    #[test]
    fn any_numbers_survive(values in prop::array::uniform6(-1e5_f64..1e5)) {
        let mut kept = offsets();
        kept.sensors[0].offset = values;
        let text = kept.to_text("leg").expect("text");
        prop_assert_eq!(Offsets::parse(&text, "leg", &NAMES), Ok(kept));
    }
}
