//! What a frame holds for signals that nobody sets.

use can_codec::{BusDbc, Dbc, Frame, SignalMap, Table};
use proptest::prelude::*;

fn dbc_text(messages: &str) -> String {
    format!("VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n{messages}\n")
}

fn dbc(messages: &str) -> Dbc {
    Dbc::parse(&dbc_text(messages), "test.dbc").unwrap_or_else(|error| panic!("{error}"))
}

/// The command frame of an actuator in MIT mode: count 0 is the full negative torque.
const MIT: &str = "BO_ 1 MIT: 8 A\n SG_ p : 7|16@0+ (0.000381476,-12.5) [-12.5|12.5] \"rad\" B\n SG_ v : 23|12@0+ (0.021978,-45) [-45|45] \"rad/s\" B\n SG_ kp : 27|12@0+ (0.1221,0) [0|500] \"\" B\n SG_ kd : 47|12@0+ (0.001221,0) [0|5] \"\" B\n SG_ t : 51|12@0+ (0.00488281,-10) [-10|10] \"Nm\" B";

fn with_one_signal(file: &Dbc, message: &str, signal: &str) -> Table {
    let map = SignalMap {
        slot: 0,
        message: message.to_owned(),
        signal: signal.to_owned(),
        scale: 1.0,
        offset: 0.0,
        wraps: false,
    };
    let on_bus = BusDbc {
        bus: 0,
        fd: false,
        dbc: file,
    };
    Table::compile(&[on_bus], &[(0, map)]).expect("a table")
}

fn made(table: &Table, value: f64) -> Frame {
    let mut frame = Frame::zeroed(0, 0, 0, false);
    assert!(table.encode(0, &[value], &mut frame));
    frame
}

#[test]
fn a_signal_that_nobody_sets_is_its_physical_zero() {
    let file = dbc(MIT);
    let frame = made(&with_one_signal(&file, "MIT", "kp"), 0.0);
    // The actuator's own reading, as its manual has it.
    let d = frame.data;
    let t = u16::from(d[6] & 0xF) << 8 | u16::from(d[7]);
    let torque = -10.0 + f64::from(t) * 20.0 / 4096.0;
    assert!(torque.abs() < 0.005, "{torque} N·m");
    let v = u16::from(d[2]) << 4 | u16::from(d[3] >> 4);
    let velocity = -45.0 + f64::from(v) * 90.0 / 4095.0;
    assert!(velocity.abs() < 0.03, "{velocity} rad/s");
    assert_eq!(file.message("MIT").unwrap().at_start(0), frame);
}

#[test]
fn a_start_value_of_the_file_is_sent() {
    let attributes = "BA_DEF_ SG_ \"GenSigStartValue\" INT -65536 65536;\nBA_DEF_DEF_ \"GenSigStartValue\" 0;\nBA_ \"GenSigStartValue\" SG_ 1 kd 2048;\nBA_ \"GenSigStartValue\" SG_ 1 p 65535;";
    let file = dbc(&format!("{MIT}\n\n{attributes}"));
    let message = file.message("MIT").unwrap();
    let starts: Vec<_> = message.signals.iter().map(|s| s.start).collect();
    // The attribute's default says nothing of a signal: count 0 of t would be full torque.
    assert_eq!(starts, [Some(65535.0), None, None, Some(2048.0), None]);
    let table = with_one_signal(&file, "MIT", "t");
    let d = made(&table, 0.0).data;
    assert_eq!([d[0], d[1]], [0xFF, 0xFF]);
    assert_eq!(u16::from(d[5]) << 4 | u16::from(d[6] >> 4), 2048);
}

#[test]
fn a_start_value_that_no_bits_hold_is_refused() {
    for value in ["4096", "-1", "1.5"] {
        let attribute = format!(
            "BA_DEF_ SG_ \"GenSigStartValue\" FLOAT -65536 65536;\nBA_DEF_DEF_ \"GenSigStartValue\" 0;\nBA_ \"GenSigStartValue\" SG_ 1 kp {value};"
        );
        let text = dbc_text(&format!("{MIT}\n\n{attribute}"));
        let problems = Dbc::parse(&text, "mit.dbc")
            .expect_err("refused")
            .to_string();
        for part in [
            "mit.dbc:12",
            "MIT.kp has a GenSigStartValue",
            "from 0 to 4095",
        ] {
            assert!(problems.contains(part), "{value}: {problems}");
        }
    }
}

#[test]
fn of_multiplexed_signals_the_selected_ones_are_sent() {
    let text = "BO_ 1 M: 4 A\n SG_ mode M : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ a m0 : 8|8@1+ (1,-5) [0|0] \"\" B\n SG_ b m3 : 8|8@1+ (1,-7) [0|0] \"\" B\n SG_ c : 16|8@1+ (1,0) [0|0] \"\" B\n\nBA_DEF_ SG_ \"GenSigStartValue\" INT 0 255;\nBA_DEF_DEF_ \"GenSigStartValue\" 0;\n";
    let of = |text: &str| made(&with_one_signal(&dbc(text), "M", "c"), 9.0).data;
    assert_eq!(of(text)[..4], [0, 5, 9, 0]);
    let third = format!("{text}BA_ \"GenSigStartValue\" SG_ 1 mode 3;");
    assert_eq!(of(&third)[..4], [3, 7, 9, 0]);
}

proptest! {
    /// Whatever a frame's coding, what nobody sets reads as zero, or as the value nearest to it.
    #[test]
    fn what_nobody_sets_reads_as_zero(
        start in 0usize..40,
        size in 1usize..=16,
        scale in prop_oneof![-10.0..-1e-3f64, 1e-3..10.0f64],
        part in 0.0..1.0f64,
        signed: bool,
    ) {
        let low = if signed { -(2f64.powi(size as i32 - 1)) } else { 0.0 };
        let count = low + (part * (2f64.powi(size as i32) - 1.0)).round();
        let offset = -count * scale;
        let sign = if signed { '-' } else { '+' };
        let text = format!(
            "BO_ 1 M: 8 A\n SG_ a : {start}|{size}@1{sign} ({scale:?},{offset:?}) [0|0] \"\" B\n SG_ b : 56|8@1+ (1,0) [0|0] \"\" B"
        );
        let file = dbc(&text);
        let frame = made(&with_one_signal(&file, "M", "b"), 1.0);
        let mut read = [f64::NAN];
        prop_assert!(with_one_signal(&file, "M", "a").decode(&frame, &mut read).is_ok());
        prop_assert!(read[0].abs() <= 1e-6 * scale.abs() * (1.0 + count.abs()), "{read:?} {text}");
    }
}
