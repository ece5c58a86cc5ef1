//! DBC files as other programs write them, sound and broken: read as they are meant, or refused with their line.

use can_codec::Dbc;

/// The line, from 1, on which the messages of `dbc_text` begin.
const FIRST_LINE: usize = 9;

/// A file around some messages.
fn dbc_text(messages: &str) -> String {
    format!("VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n{messages}\n")
}

/// One message with one signal.
const M: &str = "BO_ 1 M: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] \"\" B\n";

/// A message whose multiplexer `x` chooses one of `y` and `z`, of which each chooses a signal at one place.
const NESTED: &str = "BO_ 1 M: 8 A\n SG_ x M : 0|8@1+ (1,0) [0|0] \"\" B\n SG_ y m0M : 8|8@1+ (1,0) [0|0] \"\" B\n SG_ z m1M : 8|8@1+ (1,0) [0|0] \"\" B\n SG_ a m0 : 16|8@1+ (1,-5) [0|0] \"\" B\n SG_ b m0 : 16|8@1+ (1,-7) [0|0] \"\" B\n";
const CHOICES: &str = "SG_MUL_VAL_ 1 y x 0-0;\nSG_MUL_VAL_ 1 z x 1-1;\nSG_MUL_VAL_ 1 a y 0-3, 7-9;\nSG_MUL_VAL_ 1 b z 0-0;\n";

fn read(text: &str) -> Result<Dbc, String> {
    Dbc::parse(text, "f.dbc").map_err(|error| error.to_string())
}

#[track_caller]
fn one_signal(text: &str) {
    let file = read(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(file.messages.len(), 1, "{text}");
    let signals: Vec<&str> = (file.messages[0].signals.iter())
        .map(|signal| signal.name.as_str())
        .collect();
    assert_eq!(signals, ["a"], "{text}");
}

#[test]
fn statements_of_other_tools_are_read_past() {
    for behind in [
        "VAL_ 1 a 0 \"off\"\n 1 \"on; \\\"x\\\"\"\n -2 \"\" ;",
        "VAL_ 1 a 0.0 \"off\" 1.0 \"on\" ;",
        "VAL_ 1 a 0 \"off\"\nCM_ \"no semicolons\"\nCM_ BO_ 1 \"none\"",
        "VAL_TABLE_ T 1 \"BO_ 7 X: 8 A\" ;",
        "CM_ SG_ 1 a \"over\nBO_ 9 N: 8 A\n SG_ z : 0|8@1+ (1,0) [0|0] \\\"\\\" B\n\";",
        "CM_ SG_ 1 a \"a path that ends C:\\temp\\\";\nCM_ BO_ 1 \"m\";",
        "CM_ SG_ 1 a \"C:\\temp\\\";",
        "CM_ SG_ 1 a \"he said \\\"no\\\"; then\n\\\"yes\\\";\nand went\";",
        "EV_ E: 1 [0|1234.5] \"\" 0.5 3 DUMMY_NODE_VECTOR2 A;\nENVVAR_DATA_ E: 10;",
        "SGTYPE_ T : 8@1+ (1,0) [0|0] \"\" 0 VT;\nSIG_TYPE_REF_ 1 a : T;\nBA_DEF_SGTYPE_ \"x\" INT 0 1;",
        "CAT_DEF_ 1 c 2;\nCAT_ 1 2;\nFILTER 1;",
        "SIG_GROUP_ 1 G 1 :\n a;\nBO_TX_BU_ 1 : A,B;",
        "BA_DEF_ BO_ \"X\" INT;\nBA_DEF_ BO_ \"Y\" ENUM\n \"a\",\n \"b;c\" ;\nBA_DEF_DEF_ \"Y\" \"a\";\nBA_ \"X\" BO_\n 1 3;\nBA_ \"BusType\" \"CAN FD\";",
        "BA_DEF_REL_ BU_SG_REL_ \"T\" INT 0 9;\nBA_DEF_DEF_REL_ \"T\" 0;\nBA_REL_ \"T\" BU_SG_REL_ B SG_ 1 a 5;",
        "// by hand\nCM_ BO_ 1 \"http://x\"; // done",
        "BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n SG_ b : 0|8@1- (1,0) [0|0] \"\" Vector__XXX\nBA_ \"GenSigStartValue\" SG_ 3221225472 b 7;\nSIG_VALTYPE_ 3221225472 b : 1;",
        // Of a message that was taken out of the file.
        "BA_ \"VFrameFormat\" BO_ 77 14;\nBA_ \"GenSigStartValue\" SG_ 77 gone 1;",
        "\u{1A}",
    ] {
        one_signal(&dbc_text(&format!("{M}{behind}")));
    }
}

#[test]
fn layout_and_spelling_are_free() {
    one_signal(M);
    one_signal(M.trim_end());
    let whole = dbc_text(M);
    one_signal(&whole.replace('\n', "\r\n"));
    one_signal(&whole.replace('\n', "\r"));
    one_signal(&whole.replace(' ', "\t"));
    one_signal(&whole.replace(
        "NS_ :",
        "NS_ : \n\tCM_\n\tBA_DEF_\n\tBO_TX_BU_\n\tSG_MUL_VAL_",
    ));
    one_signal(&whole.replace("BU_: A B", "BU_: A\n B\n  C-1"));
    one_signal(&whole.replace("BS_:", "BS_: 500000 : 1,2"));
    for message in [
        "BO_ 1 M:8 A\n SG_ a:0|8@1+(1.,0.)[0.|255]\"\" A,B",
        "BO_ 1 M : 8 3MCU\n\n SG_ a : 0 | 8 @ 1 + ( 1.E+000 , -.5 ) [ 0 | 0 ] \"°C\" A , B ;",
        "BO_ 1 M: 8\n SG_ a : 0|8@1+ (1,0) [0|0] \"\"",
        "BO_ 1 M: 8 A SG_ a : 0|8@1+ (1,0) [0|0] \"\" B",
    ] {
        one_signal(&dbc_text(message));
    }
}

#[test]
fn multiplexers_may_be_several() {
    let file = read(&dbc_text(&format!("{NESTED}{CHOICES}"))).unwrap();
    // Of the nested signals those are sent that the multiplexers' zeros choose.
    assert_eq!(file.messages[0].at_start(0).data[..4], [0, 0, 5, 0]);
    let started = |start: &str| {
        let start = format!("{NESTED}{CHOICES}BA_ \"GenSigStartValue\" SG_ 1 {start};\n");
        read(&dbc_text(&start)).unwrap().messages[0]
            .at_start(0)
            .data
    };
    assert_eq!(started("x 1")[..4], [1, 0, 7, 0]);
    assert_eq!(started("y 8")[..4], [0, 8, 5, 0]);
    assert_eq!(started("y 4")[..4], [0, 4, 0, 0]);
    // Two beside each other, each with signals of its own.
    let two = NESTED
        .replace("y m0M", "y M")
        .replace(" SG_ z m1M : 8|8@1+ (1,0) [0|0] \"\" B\n", "");
    let choices = "SG_MUL_VAL_ 1 a y 0-0;\nSG_MUL_VAL_ 1 b y 1-1;\n";
    assert!(read(&dbc_text(&format!("{two}{choices}"))).is_ok());
}

/// The messages, the line on which the fault is, counted from their first, and parts of the refusal.
const BROKEN: &[(&str, usize, &[&str])] = &[
    ("BO_ 1 M: A", 0, &["on: `A`", "the length in bytes"]),
    ("BO_ 1 M 8 A", 0, &["on: `8 A`", "`:`"]),
    (
        "BO_ 1 M: -8 A",
        0,
        &["`-8 A`", "the length in bytes, a whole number"],
    ),
    (
        "BO_ 0x1 M: 8 A",
        0,
        &["`0x1 M: 8 A`", "an identifier, a whole number"],
    ),
    ("BO_ 99999999999 M: 8 A", 0, &["has id 99999999999"]),
    ("BO_ 1 M: 8 A rubbish", 0, &["`rubbish`"]),
    (
        " SG_ a : 0|8@1+ (1,0) [0|0] \"\" B",
        0,
        &["before any message"],
    ),
    ("@ : 0|8@1 (1,0) [0|0] \"\"", 1, &["the sign, `-` or `+`"]),
    (
        "@ : 0|8@2+ (1,0) [0|0] \"\"",
        1,
        &["`0` (Motorola) or `1` (Intel)"],
    ),
    ("@ : 0@1+ (1,0) [0|0] \"\"", 1, &["`|`"]),
    (
        "@ : -1|8@1+ (1,0) [0|0] \"\"",
        1,
        &["`-1|8@1+", "the start bit"],
    ),
    (
        "@ : 0|8@1+ (0,5,0) [0|0] \"\"",
        1,
        &["`,0)", "decimals have points"],
    ),
    (
        "@ : 0|8@1+ (1,0) [0|25,5] \"\"",
        1,
        &["`,5]", "decimals have points"],
    ),
    (
        "@ : 0|8@1+ (nan,0) [0|0] \"\"",
        1,
        &["`nan,0)", "the scale, a number"],
    ),
    (
        "@ : 0|8@1+ (1,0) [-inf|inf] \"\"",
        1,
        &["`-inf|inf]", "the least value"],
    ),
    ("@ : 0|8@1+ (1e400,0) [0|0] \"\"", 1, &["scale inf"]),
    ("@ : 0|8@1+ (1,0) \"\"", 1, &["`[`"]),
    (
        "@ : 0|8@1+ (1,0) [0|0]",
        1,
        &["the unit in quotation marks"],
    ),
    (
        "@ : 0|8@1+ (1,0) [0|0] \"",
        1,
        &["no quotation mark ends it"],
    ),
    (
        "@ : 0|8@1+ (1,0) [0|0] \"\" B rubbish",
        1,
        &["`rubbish B`", "`,` between receivers"],
    ),
    ("@ : 0|8@1+ (1,", 1, &["`B`", "the offset, a number"]),
    (
        "@ X : 0|8@1+ (1,0) [0|0] \"\"",
        1,
        &["`X :", "`M`, `m` with a number"],
    ),
    (
        "@ m : 0|8@1+ (1,0) [0|0] \"\"",
        1,
        &["`m :", "`M`, `m` with a number"],
    ),
    (
        "@ m0 : 0|8@1+ (1,0) [0|0] \"\"",
        1,
        &["has no multiplexer", "the mark `M`"],
    ),
    (
        "+SG_MULVAL_ 1 a x 0-0;",
        2,
        &["`SG_MULVAL_ 1 a x 0-0;`", "SG_MUL_VAL_"],
    ),
    ("+bo_ 2 N: 8 A", 2, &["`bo_ 2 N: 8 A`", "a statement"]),
    (
        "+SIG_GROUP_ 1 G 1 : a\nBO_ 2 N: 8 A",
        2,
        &["the line ends", "`;`"],
    ),
    (
        "+BA_ \"GenSigStartValue\" SG_ 1 a 3\nCM_ \"\";",
        2,
        &["the line ends behind `BA_", "`;`"],
    ),
    (
        "+CM_ SG_ 1 a \"abc;\nCM_ BO_ 1 \"m\";",
        2,
        &["ends on line 12, before `m", "is a quotation mark missing?"],
    ),
    (
        "+CM_ SG_ 1 a \"abc;\nVAL_ 1 a 0 \"m\";",
        2,
        &["ends on line 12, before `m"],
    ),
    (
        "+CM_ \"5\" pipe\";\nSIG_VALTYPE_ 1 a : 1;\nCM_ \"x\";",
        2,
        &["`pipe"],
    ),
    ("+CM_ BO_ 1 \"abc;", 2, &["no quotation mark ends it"]),
    ("+BA_ \"GenSigStart", 2, &["no quotation mark ends it"]),
    (
        "+SIG_VALTYPE_ 1 a : 3;",
        2,
        &["`3;`", "0 (integer), 1 (float"],
    ),
    (
        "+SIG_VALTYPE_ 1 a : 0;\nSIG_VALTYPE_ 1 a : 1;",
        3,
        &["for signal a contradicts line 11"],
    ),
    (
        "+BA_ \"GenSigStartValue\" SG_ 1 a 3;\nBA_ \"GenSigStartValue\" SG_ 1 a 4;",
        3,
        &["contradicts line 11"],
    ),
    (
        "+BA_ \"GenSigStartValue\" SG_ 1 aa 3;",
        2,
        &["signal aa of message M, which has no such", "allowed: a"],
    ),
    (
        "+BA_ \"VFrameFormat\" BO_ 1 0;\nBA_ \"VFrameFormat\" BO_ 1 14;",
        3,
        &["VFrameFormat contradicts line 11"],
    ),
    (
        "+BA_ \"VFrameFormat\" BO_ 2147483649 14;",
        2,
        &["id 1 (0x1, extended)", "1, which is message M"],
    ),
    (
        "+BA_DEF_ BO_ \"VFrameFormat\" ENUM \"A\",\"B\";\nBA_DEF_ BO_ \"VFrameFormat\" ENUM \"B\";",
        3,
        &["contradicts line 11"],
    ),
    (
        "+BA_DEF_DEF_ \"VFrameFormat\" 0;\nBA_DEF_DEF_ \"VFrameFormat\" 14;",
        3,
        &["contradicts line 11"],
    ),
];

#[test]
fn broken_files_are_refused_with_line_and_expectation() {
    for (messages, line, parts) in BROKEN {
        let text = match (messages.strip_prefix('@'), messages.strip_prefix('+')) {
            (Some(signal), _) => format!("BO_ 1 M: 8 A\n SG_ a{signal} B\n"),
            (_, Some(behind)) => format!("{M}{behind}\n"),
            _ => format!("{messages}\n"),
        };
        let error = read(&dbc_text(&text)).expect_err(messages);
        let place = format!("f.dbc:{}: ", FIRST_LINE + line);
        assert!(error.starts_with(&place), "{messages}: {error}");
        for part in *parts {
            assert!(
                error.contains(part),
                "{messages}: {part:?} is not in {error}"
            );
        }
    }
}

#[test]
fn contradictory_multiplexing_is_refused() {
    // Replacement in the nested message, line and part of the refusal.
    for (from, to, line, part) in [
        (
            "a y 0-3",
            "a nope 0-3",
            17,
            "chosen by nope, which is no multiplexer",
        ),
        (
            "a y 0-3",
            "a b 0-3",
            17,
            "allowed: a signal of message M with the mark `M`: x, y, z",
        ),
        ("1 a y", "1 aa y", 17, "signal aa of message M"),
        ("y 0-3", "y 5-2", 17, "does not run backwards"),
        ("b z 0-0", "b y 9-9", 14, "overlaps signal a"),
        ("b m0 : 16", "b m0 : 8", 14, "overlaps signal z"),
        (
            "y x 0-0",
            "y z 0-0;\nSG_MUL_VAL_ 1 z y 0-0",
            17,
            "SG_MUL_VAL_ for signal z contradicts line 16",
        ),
        ("y x 0-0", "y y 0-0", 15, "y is chosen by itself"),
        (
            "y x 0-0;\nSG_MUL_VAL_ 1 z x",
            "y z 0-0;\nSG_MUL_VAL_ 1 z y",
            16,
            "z is chosen by itself",
        ),
        ("SG_MUL_VAL_ 1 b z 0-0;\n", "", 14, "by x or by y"),
        (
            "b z 0-0",
            "b z 256-300",
            14,
            "where z is 256, which its 8 bits cannot be",
        ),
    ] {
        let text = dbc_text(&format!("{NESTED}{CHOICES}"));
        assert!(text.contains(from));
        let error = read(&text.replace(from, to)).expect_err(to);
        assert!(error.contains(&format!("f.dbc:{line}: ")), "{to}: {error}");
        assert!(error.contains(part), "{to}: {error}");
    }
    let float = "BO_ 1 M: 8 A\n SG_ x M : 0|32@1- (1,0) [0|0] \"\" B\n SG_ a m0 : 32|8@1+ (1,0) [0|0] \"\" B\nSIG_VALTYPE_ 1 x : 1;";
    let error = read(&dbc_text(float)).unwrap_err();
    assert!(
        error.starts_with("f.dbc:10: signal M.a is chosen by x, which is a float"),
        "{error}"
    );
}
