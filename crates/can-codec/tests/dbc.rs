//! Refusals of the DBC reader, and their messages.

mod common;

use can_codec::{BusDbc, Coding, Dbc, SignalMap, Table};
use common::{bits_one_by_one, dbc, dbc_text, table};

/// The line, from 1, on which the messages of `dbc_text` begin.
const FIRST_LINE: usize = 9;

/// The messages that a faulty file leads to.
fn refusal(messages: &str) -> String {
    match Dbc::parse(&dbc_text(messages), "bad.dbc") {
        Ok(_) => panic!("accepted:\n{messages}"),
        Err(error) => error.to_string(),
    }
}

#[track_caller]
fn refused(messages: &str, line: usize, parts: &[&str]) {
    let text = refusal(messages);
    let place = format!("bad.dbc:{}: ", FIRST_LINE + line);
    assert!(text.starts_with(&place), "{text}");
    assert!(text.contains("; allowed: "), "{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }
}

#[test]
fn overlaps_are_refused_in_both_byte_orders() {
    refused(
        "BO_ 1 M: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ b : 7|8@1+ (1,0) [0|0] \"\" B",
        2,
        &["signal M.b overlaps signal a"],
    );
    // Big endian from bit 7 covers byte 0; from bit 3, the lower half of it and the upper of 1.
    refused(
        "BO_ 1 M: 8 A\n SG_ a : 7|8@0+ (1,0) [0|0] \"\" B\n SG_ b : 3|8@0+ (1,0) [0|0] \"\" B",
        2,
        &["signal M.b overlaps signal a"],
    );
    dbc("BO_ 1 M: 8 A\n SG_ a : 7|8@0+ (1,0) [0|0] \"\" B\n SG_ b : 8|8@1+ (1,0) [0|0] \"\" B");
}

#[test]
fn signals_beyond_the_end_are_refused() {
    let little = "BO_ 1 M: 2 A\n SG_ a : 9|8@1+ (1,0) [0|0] \"\" B";
    refused(little, 1, &["passes the end", "the message's 2 bytes"]);
    let big = "BO_ 1 M: 2 A\n SG_ a : 14|8@0+ (1,0) [0|0] \"\" B";
    refused(big, 1, &["passes the end"]);
    let start = "BO_ 1 M: 0 A\n SG_ a : 0|1@1+ (1,0) [0|0] \"\" B";
    refused(start, 1, &["passes the end"]);
    let far = "BO_ 1 M: 8 A\n SG_ a : 18446744073709551615|8@1+ (1,0) [0|0] \"\" B";
    refused(far, 1, &["passes the end"]);
}

#[test]
fn impossible_sizes_scales_and_ranges_are_refused() {
    let signal = |text: &str| format!("BO_ 1 M: 64 A\n SG_ a : {text} \"\" B");
    refused(&signal("0|0@1+ (1,0) [0|0]"), 1, &["has 0 bits", "1 to 64"]);
    refused(
        &signal("0|65@1+ (1,0) [0|0]"),
        1,
        &["has 65 bits", "1 to 64"],
    );
    refused(
        &signal("0|8@1+ (0,0) [0|0]"),
        1,
        &["has scale 0", "other than 0"],
    );
    refused(&signal("0|8@1+ (1,0) [9|5]"), 1, &["has range [9|5]"]);
    refused(
        &signal("0|8@1+ (1,0) [300|400]"),
        1,
        &["no count", "meets [0|255]"],
    );
}

#[test]
fn impossible_messages_are_refused() {
    refused("BO_ 1 M: 9 A", 0, &["9 bytes long", "12, 16, 20"]);
    refused("BO_ 1 M: 65 A", 0, &["65 bytes long"]);
    refused("BO_ 2048 M: 8 A", 0, &["has id 2048", "0 to 2047"]);
    refused("BO_ 65537 M: 8 A", 0, &["has id 65537"]);
    refused("BO_ 3221225473 M: 8 A", 0, &["29 bits"]);
    refused(
        "BO_ 1 M: 8 A\n\nBO_ 1 N: 8 A",
        2,
        &["id 1 (0x1) like message M of line 9"],
    );
    refused(
        "BO_ 1 M: 8 A\n\nBO_ 2 M: 8 A",
        2,
        &["second message is called M"],
    );
    let twice = " SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ a : 8|8@1+ (1,0) [0|0] \"\" B";
    refused(&format!("BO_ 1 M: 8 A\n{twice}"), 2, &["M.a occurs twice"]);
}

#[test]
fn text_that_is_no_dbc_file_is_refused_with_its_line() {
    refused(
        "BO_ 1 M: 8 A\n SG_ a : 0|8 (1,0) [0|0] \"\" B",
        1,
        &[
            "not a DBC file from column 14 on: `(1,0) [0|0] \"\" B`",
            "allowed: `@`",
        ],
    );
    assert!(Dbc::parse("<html>", "x.dbc").is_err());
}

#[test]
fn every_problem_of_a_file_is_reported() {
    let text = refusal(
        "BO_ 1 M: 8 A\n SG_ a : 0|0@1+ (1,0) [0|0] \"\" B\n SG_ b : 0|8@1+ (0,0) [0|0] \"\" B\n\nBO_ 1 N: 9 A",
    );
    assert_eq!(text.lines().count(), 4, "{text}");
}

#[test]
fn floats_have_the_size_of_their_type() {
    let float = |size: u32, kind: u32| {
        format!(
            "BO_ 1 M: 8 A\n SG_ a : 0|{size}@1- (1,0) [0|0] \"\" B\n\nSIG_VALTYPE_ 1 a : {kind};"
        )
    };
    assert_eq!(
        dbc(&float(32, 1)).messages[0].signals[0].coding,
        Coding::Float32
    );
    assert_eq!(
        dbc(&float(64, 2)).messages[0].signals[0].coding,
        Coding::Float64
    );
    refused(
        &float(16, 1),
        1,
        &["float signal M.a has 16 bits", "32 bits"],
    );
}

#[test]
fn multiplexed_signals_may_overlap_but_not_be_used() {
    let file = dbc(
        "BO_ 1 M: 8 A\n SG_ which M : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ a m0 : 8|8@1+ (1,0) [0|0] \"\" B\n SG_ b m1 : 8|8@1+ (1,0) [0|0] \"\" B",
    );
    let map = SignalMap {
        slot: 0,
        message: "M".to_owned(),
        signal: "b".to_owned(),
        scale: 1.0,
        offset: 0.0,
        wraps: false,
    };
    let on_bus = BusDbc {
        bus: 0,
        fd: false,
        dbc: &file,
    };
    let error = Table::compile(&[on_bus], &[(0, map)]).unwrap_err();
    assert_eq!(error.0[0].map, Some(0));
    assert!(error.0[0].problem.reason.contains("M.b is multiplexed"));
    refused(
        "BO_ 1 M: 8 A\n SG_ which M : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ a m1 : 8|8@1+ (1,0) [0|0] \"\" B\n SG_ b m1 : 8|8@1+ (1,0) [0|0] \"\" B",
        3,
        &["M.b overlaps signal a"],
    );
}

#[test]
fn fd_messages_need_an_fd_bus() {
    let file = dbc("BO_ 1 M: 12 A");
    let on_bus = BusDbc {
        bus: 0,
        fd: false,
        dbc: &file,
    };
    let error = Table::compile(&[on_bus], &[]).unwrap_err();
    let problem = &error.0[0].problem;
    assert_eq!(problem.line, FIRST_LINE);
    assert!(problem.reason.contains("CAN FD frame on a classic bus"));
    let named = dbc(
        "BO_ 1 M: 8 A\n\nBA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\";\nBA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\nBA_ \"VFrameFormat\" BO_ 1 14;",
    );
    assert!(named.messages[0].fd);
}

/// A number counts in the file's own enumeration, as canmatrix, cantools and others write it.
#[test]
fn frame_formats_count_in_the_files_own_enumeration() {
    const CANMATRIX: &str =
        "\"StandardCAN\",\"ExtendedCAN\",\"StandardCAN_FD\",\"ExtendedCAN_FD\",\"J1939PG\"";
    let with = |kind: &str, default: &str, value: &str| {
        dbc_text(&format!(
            "BO_ 1 M: 8 A\n\nBA_DEF_ BO_ \"VFrameFormat\" {kind};\nBA_DEF_DEF_ \"VFrameFormat\" {default};\n{value}"
        ))
    };
    let value = |value: &str| format!("BA_ \"VFrameFormat\" BO_ 1 {value};");
    let candb = format!(
        "ENUM \"StandardCAN\",\"ExtendedCAN\",{}\"J1939PG\",{}\"StandardCAN_FD\",\"ExtendedCAN_FD\"",
        "\"reserved\",",
        "\"reserved\",".repeat(10)
    );
    let canmatrix = format!("ENUM {CANMATRIX}");
    let standard = "\"StandardCAN\"";
    let cases = [
        (&*canmatrix, standard, value("2"), true),
        (&canmatrix, standard, value("3"), true),
        (&canmatrix, standard, value("4"), false),
        (&canmatrix, standard, value("0"), false),
        (&canmatrix, "\"StandardCAN_FD\"", String::new(), true),
        (&canmatrix, "\"StandardCAN_FD\"", value("1"), false),
        (&canmatrix, standard, value("\"ExtendedCAN_FD\""), true),
        (&candb, standard, value("14"), true),
        (&candb, standard, value("2"), false),
        ("ENUM \"CAN FD\",\"CAN\"", "\"CAN\"", value("0"), true),
        ("ENUM \"CAN\",\"CANFD\"", "\"CAN\"", value("1"), true),
        ("INT 0 15", "0", value("15"), true),
        ("INT 0 15", "0", value("2"), false),
    ];
    for (kind, default, value, fd) in cases {
        let mut text = with(kind, default, &value);
        // Formats of extended identifiers need one.
        let extended = ["BO_ 1 3;", "BO_ 1 1;", "Extended", "BO_ 1 15;"];
        if kind.contains("Extended") && extended.iter().any(|word| value.contains(word)) {
            text = text.replace("BO_ 1 ", "BO_ 2147483649 ");
        }
        let read = Dbc::parse(&text, "f.dbc").unwrap();
        assert_eq!(read.messages[0].fd, fd, "{kind} {default} {value}");
    }
    for number in ["5", "-1", "\"7\"", "\"CAN-FD\""] {
        let error = Dbc::parse(&with(&canmatrix, standard, &value(number)), "f.dbc").unwrap_err();
        let text = error.to_string();
        assert!(
            text.starts_with("f.dbc:9: message M has VFrameFormat "),
            "{text}"
        );
        assert!(
            text.contains("2 (StandardCAN_FD), 3 (ExtendedCAN_FD)"),
            "{text}"
        );
    }
}

#[test]
fn a_frame_format_for_identifiers_of_the_other_length_is_refused() {
    let with = |id: u64, value: &str| {
        dbc_text(&format!(
            "BO_ {id} M: 8 A\n\nBA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\",\
             \"StandardCAN_FD\",\"ExtendedCAN_FD\";\nBA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\n{value}"
        ))
    };
    let of = |id: u64, value: &str| with(id, &format!("BA_ \"VFrameFormat\" BO_ {id} {value};"));
    for (id, value, said) in [
        (
            513,
            "1",
            "an identifier of 11 bits and VFrameFormat ExtendedCAN",
        ),
        (
            513,
            "3",
            "an identifier of 11 bits and VFrameFormat ExtendedCAN_FD",
        ),
        (513, "\"ExtendedCAN\"", "an identifier of 11 bits"),
        (
            2_147_484_161,
            "2",
            "an identifier of 29 bits and VFrameFormat StandardCAN_FD",
        ),
    ] {
        let text = Dbc::parse(&of(id, value), "f.dbc").unwrap_err().to_string();
        assert!(text.starts_with("f.dbc:") && text.contains(said), "{text}");
    }
    let long = of(513, "0").replace("M: 8", "M: 12");
    let text = Dbc::parse(&long, "f.dbc").unwrap_err().to_string();
    assert!(text.contains(
        "is 12 bytes long and has VFrameFormat StandardCAN; allowed: a format of CAN FD"
    ));
    // A default stands in files with all kinds.
    assert!(Dbc::parse(&with(513, "").replace("M: 8", "M: 12"), "f.dbc").is_ok());
    assert!(Dbc::parse(&with(2_147_484_161, ""), "f.dbc").is_ok());
    assert!(Dbc::parse(&of(2_147_484_161, "3"), "f.dbc").is_ok());
}

#[test]
fn ranges_of_floats_need_their_type() {
    let of = |size: u8, sign: char, scale: &str, range: &str| {
        format!("BO_ 1 M: 8 A\n SG_ a : 0|{size}@1{sign} ({scale},0) [{range}] \"\" B")
    };
    for (size, sign, scale, range) in [
        (32, '-', "1", "-3.4e38|3.4e38"),
        (32, '+', "1", "-3.40282346638529E+38|3.40282346638529E+38"),
        (32, '-', "1", "0|1e38"),
        (32, '-', "0.001", "-1e20|1e20"),
        (32, '+', "1", "-1E+37|0"),
        (64, '-', "1", "-1.7e308|1.7e308"),
        (32, '-', "1", "-12.566|12.566"),
        (64, '+', "1", "0|0.5"),
    ] {
        let text = of(size, sign, scale, range);
        refused(
            &text,
            1,
            &["M.a has range [", "its type is missing", "SIG_VALTYPE_"],
        );
        let number = if size == 32 { 1 } else { 2 };
        dbc(&format!("{text}\n\nSIG_VALTYPE_ 1 a : {number};"));
        dbc(&format!("{text}\n\nSIG_VALTYPE_ 1 a : 0;"));
        // As the format's description has it, and no program writes it.
        dbc(&format!("{text}\n\nSIG_VALTYPE_ 1 a {number};"));
    }
    // Rounded, and the fraction of a scale.
    dbc(&of(32, '+', "1", "0|42949672.95"));
    dbc(&of(32, '-', "0.5", "-12.5|12.5"));
    // Too wide by a few powers of ten, as real files are, and sizes that no float has.
    dbc(&of(32, '-', "1e-07", "-100000|100000"));
    dbc(&of(16, '+', "1", "0|3.4e38"));
    dbc(&of(32, '+', "1", "0|0"));
}

#[test]
fn a_type_that_names_no_signal_is_refused() {
    let messages = "BO_ 1 M: 8 A\n SG_ a : 0|32@1- (1,0) [0|0] \"\" B\n SG_ b : 32|32@1- (1,0) [0|0] \"\" B\n\nBO_ 2 N: 8 A\n SG_ c : 0|32@1- (1,0) [0|0] \"\" B\n\n";
    for (typed, said) in [
        (
            "1 aa : 1;",
            "signal aa of message M, which has no such signal; allowed: a, b",
        ),
        (
            "1 c : 1;",
            "signal c of message M, which has no such signal; allowed: 2 for c, which is a signal of message N",
        ),
        (
            "3 c 1;",
            "signal c of a message with id 3 (0x3), which the file does not have; allowed: 2 for c, which is a signal of message N",
        ),
    ] {
        refused(&format!("{messages}SIG_VALTYPE_ {typed}"), 7, &[said]);
    }
    // The type of a signal whose message was taken out of the file is no mistake.
    dbc(&format!("{messages}SIG_VALTYPE_ 3 gone : 1;"));
    refused(
        &format!("{messages}SIG_VALTYPE_ 1 a : ;"),
        7,
        &["SIG_VALTYPE_ id name : 1;"],
    );
}

#[test]
fn reads_what_dbc_files_usually_hold() {
    let file = dbc(
        "BO_ 2566834709 E: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n\nBO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n SG_ lost : 0|8@1- (1,0) [0|0] \"\" Vector__XXX\n\nCM_ BO_ 1 \"over\nBO_ 7 X: 8 A\nlines\";",
    );
    assert_eq!(file.messages.len(), 1);
    assert_eq!(file.messages[0].id, 2_566_834_709);
    assert_eq!(file.messages[0].line, FIRST_LINE);
    assert_eq!(table(&file).message_count(), 1);
}

#[test]
fn the_slow_reading_reads_as_the_format_is_described() {
    // The reference of the other tests, on bytes that can be read by eye.
    let data = [0xC0, 0x06, 0xE0];
    assert_eq!(bits_one_by_one(&data, 7, 1, true), 1);
    assert_eq!(bits_one_by_one(&data, 6, 6, true), 32);
    assert_eq!(bits_one_by_one(&data, 0, 12, true), 55);
    assert_eq!(bits_one_by_one(&data, 4, 8, false), 0x6C);
}
