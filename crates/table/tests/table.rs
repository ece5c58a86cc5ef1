//! Tables as programs write them mean the numbers that they were made from.

use table::Table;

const PLAIN: &str = "t,theta,q,note\n0,1.5,-0.25,a\n0.001,2500,1e-3,b\n";

fn read(bytes: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let mut rows = Vec::new();
    let mut read = || {
        let mut table = Table::new(bytes, "f.csv", None)?;
        let names = ["t", "theta", "q"];
        let mut places = [0; 3];
        for (place, name) in places.iter_mut().zip(names) {
            let missing = || table.problem(format!("no {name}"), table.names().join("|"));
            *place = table.column(name)?.ok_or_else(missing)?;
        }
        while table.next_row()? {
            let mut row = [0.0; 3];
            for (value, place) in row.iter_mut().zip(places) {
                *value = table.number(place)?;
            }
            rows.push(row);
        }
        Ok::<_, problem::Problem>(())
    };
    read().map_err(|p| p.to_string())?;
    Ok(rows)
}

#[test]
fn every_program_writes_these_numbers() {
    let commas = |text: &str| text.replace(',', ";").replace('.', ",");
    let utf_16 = |text: &str| {
        let units = text.encode_utf16().flat_map(u16::to_le_bytes);
        [0xFF, 0xFE].into_iter().chain(units).collect::<Vec<u8>>()
    };
    let quoted: String = PLAIN
        .lines()
        .map(|line| {
            let fields: Vec<String> = line.split(',').map(|f| format!("\"{f}\"")).collect();
            fields.join(",") + "\r\n"
        })
        .collect();
    let cp1252 = b"t;theta;q;\xB0C\n0;1.5;-0.25;\x80\n0.001;2500;1e-3;\xE9\n".to_vec();
    let files: [(&str, Vec<u8>); 20] = [
        ("plain", PLAIN.into()),
        ("byte-order mark", format!("\u{feff}{PLAIN}").into()),
        ("UTF-16", utf_16(PLAIN)),
        ("Windows-1252", cp1252),
        ("semicolons", PLAIN.replace(',', "; ").into()),
        ("tabs", PLAIN.replace(',', "\t").into()),
        ("bars", PLAIN.replace(',', " | ").into()),
        (
            "spaces",
            PLAIN.replace(',', "   ").replace("\n0", "\n  0").into(),
        ),
        ("decimal commas", commas(PLAIN).into()),
        (
            "decimal commas, tabs",
            PLAIN.replace(',', "\t").replace('.', ",").into(),
        ),
        ("quotes", quoted.clone().into()),
        ("quoted decimal commas", quoted.replace('.', ",").into()),
        ("sep=", format!("sep=;\r\n{}", commas(PLAIN)).into()),
        ("numpy", format!("# {}", PLAIN.replace(',', " ")).into()),
        (
            "a comment first",
            format!("# arm 2, 1 kHz\n\n{PLAIN}").into(),
        ),
        (
            "a comment as long as the header",
            format!("# a,b,c,d\n{PLAIN}").into(),
        ),
        (
            "comments, one of them the header",
            format!("% recorded by x\n% {PLAIN}").into(),
        ),
        (
            "a comment at the end",
            format!("{PLAIN}# two rows\n").into(),
        ),
        ("delimiter at the end", PLAIN.replace('\n', ",\n").into()),
        (
            "a note over lines",
            PLAIN.replace(",a\n", ",\"a \"\"x\"\",\n\n5,6\"\n").into(),
        ),
    ];
    for (name, bytes) in files {
        let expected = vec![[0.0, 1.5, -0.25], [0.001, 2500.0, 1e-3]];
        assert_eq!(read(&bytes), Ok(expected), "{name}");
    }
}

#[test]
fn what_is_no_table_of_numbers_is_refused_with_its_line() {
    let cases: [(&[u8], &str); 14] = [
        (b"", "f.csv:1: the log is empty"),
        (b"\n\n", "f.csv:3: the log is empty"),
        (b"a,b\n0,1\n", "f.csv:1: no t"),
        (
            b"t,theta,q,q\n",
            "f.csv:1: column `q` is named twice, as the columns 3 and 4",
        ),
        (
            b"t,theta,q\n0,1\n",
            "f.csv:2: the field of column `q` is missing: the row has 2 fields, the header 3",
        ),
        (
            b"t,theta,q\n0,001,1,5,0,25\n",
            "f.csv:2: the row has 6 fields, the header 3 (decimal commas between commas?)",
        ),
        (
            b"t;theta;q\n0,001;1.5;2\n",
            "f.csv:2: `theta` is `1.5`, but numbers before it have decimal commas",
        ),
        (b"t;theta;q\n0;1.234,5;2\n", "f.csv:2: `theta` is `1.234,5`"),
        (
            b"t,theta,q\n0,,2\n",
            "f.csv:2: `theta` is empty; allowed: a finite number in each row; `torquectl import`",
        ),
        (
            b"t,theta,q\n\n0,nan,2\n",
            "f.csv:3: `theta` is `nan`; allowed: a finite number",
        ),
        (
            b"t,theta,q\n0,1,\"2\n3\n",
            "f.csv:2: a quotation mark is not closed",
        ),
        (
            b"t,theta,q\n0,1,2\n0,\x001,2\n",
            "f.csv:3: is no text: it holds a byte 0",
        ),
        (b"\x89MCAP0\r\n\0\0", "f.csv:2: is no text"),
        (b"t,theta,q\n0,1,2\n0,1,2,\x81\n", "f.csv:3: byte 0x81"),
    ];
    for (bytes, expected) in cases {
        let message = read(bytes).unwrap_err();
        assert!(message.starts_with(expected), "{expected}\n{message}");
    }
}

#[test]
fn absent_values_are_no_numbers() {
    let text = "t;x\n0;\n1;nan\n2;NaN\n3;null\n4;N/A\n5;1,5\n6;oops\n";
    let mut table = Table::new(text.as_bytes(), "f.csv", None).unwrap();
    let mut values = Vec::new();
    for _ in 0..6 {
        assert!(table.next_row().unwrap());
        values.push(table.optional(1).unwrap());
    }
    assert_eq!(values, [None, None, None, None, None, Some(1.5)]);
    assert!(table.next_row().unwrap());
    let refusal = table.optional(1).unwrap_err().to_string();
    assert_eq!(refusal, "f.csv:8: `x` is `oops`; allowed: a finite number");
    assert!(!table.next_row().unwrap());
}

#[test]
fn instruments_write_lines_above_and_units_below_the_header() {
    let utf_16: Vec<u8> = PLAIN.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let units = PLAIN.replacen('\n', "\n[s],[rad],rad,-\n", 1);
    let files: [(&str, Vec<u8>); 9] = [
        ("UTF-16 without a mark", utf_16),
        ("carriage returns alone", PLAIN.replace('\n', "\r").into()),
        ("a quoted sep=", format!("\"sep=,\"\r\n{PLAIN}").into()),
        (
            "a title",
            format!("Bench 3, recorded at noon\n{PLAIN}").into(),
        ),
        (
            "names and values above",
            format!("Device;ABC\nRate;1000\n\n{}", PLAIN.replace(',', ";")).into(),
        ),
        ("units", units.into()),
        (
            "exponents of Fortran",
            PLAIN.replace("1e-3", "1.0D-03").into(),
        ),
        (
            "a typesetter's minus",
            PLAIN.replace("-0.25", "\u{2212}0.25").into(),
        ),
        ("the last row cut", format!("{PLAIN}0.002,25").into()),
    ];
    for (name, bytes) in files {
        let expected = vec![[0.0, 1.5, -0.25], [0.001, 2500.0, 1e-3]];
        assert_eq!(read(&bytes), Ok(expected), "{name}");
    }
    // The mark of a comment belongs to the name, or does not.
    let text = format!("%{PLAIN}");
    let table = Table::new(text.as_bytes(), "f.csv", None).unwrap();
    assert_eq!(
        [table.column("%t").unwrap(), table.column("t").unwrap()],
        [Some(0); 2]
    );
}

#[test]
fn units_of_the_log_are_known_and_other_ones_than_of_the_si_refused() {
    let text = "t;theta;q\nms;\u{b0};rad\n0;1;2\n";
    let mut table = Table::new(text.as_bytes(), "f.csv", None).unwrap();
    assert_eq!(table.unit(0).map(|unit| unit.factor), Some(1e-3));
    assert!(table.require_si(2).is_ok());
    let refusal = table.require_si(1).unwrap_err().to_string();
    assert_eq!(
        refusal,
        "f.csv:2: the row of units below the header gives `theta` in `\u{b0}`; allowed: rad; `torquectl import` converts units"
    );
    assert!(table.next_row().unwrap() && table.number(1) == Ok(1.0));
}
