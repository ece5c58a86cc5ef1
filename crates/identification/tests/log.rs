//! Logs that can be read, and messages for those that cannot.

use identification::log::LogReader;
use std::io::Read;

fn message(text: &str) -> String {
    match LogReader::new(text.as_bytes(), "run.csv").and_then(|mut log| log.rows()) {
        Ok(rows) => panic!("accepted: {rows:?}"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn columns_may_stand_in_any_order_among_others() {
    let text = "\u{feff}x,q, theta ,t,i,tau_sensor\r\n9,0.1,10,0,2,3\r\n\n9,0.2,20,0.001,-2,4\n";
    let mut log = LogReader::new(text.as_bytes(), "run.csv").unwrap();
    assert!(log.has_torque());
    let rows = log.rows().unwrap();
    assert_eq!(rows.len(), 2);
    let row = rows[1];
    assert_eq!(
        [row.t, row.theta, row.q, row.current],
        [0.001, 20.0, 0.2, -2.0]
    );
    assert_eq!(row.tau_sensor, 4.0);
    let rows = LogReader::new("t,theta,q,i\n0,1,2,3".as_bytes(), "x")
        .unwrap()
        .rows()
        .unwrap();
    assert!(rows[0].tau_sensor.is_nan());
}

#[test]
fn fields_may_be_separated_by_commas_semicolons_or_tabs() {
    let text = "t,theta,q,i,note\n0,1,2,3,a;b\n0.001,2,3,4,c;d\n";
    let read = |text: &str| {
        let mut log = LogReader::new(text.as_bytes(), "run.csv").unwrap();
        log.rows().unwrap()
    };
    let expected = read(text).iter().map(|r| r.theta).collect::<Vec<_>>();
    for delimiter in ["; ", "\t"] {
        let text = text.replace(';', "").replace(',', delimiter);
        let rows = read(&text);
        assert_eq!(rows.iter().map(|r| r.theta).collect::<Vec<_>>(), expected);
        assert_eq!(rows[1].current, 4.0);
    }
    // What some spreadsheets write: names in quotes, decimal commas.
    let quoted = read("\"t\";\"theta\";\"q\";\"i\"\n0;1,5;2;3\n");
    assert_eq!((quoted[0].theta, quoted[0].current), (1.5, 3.0));
    let mixed = message("t;theta;q;i\n0;1,5;2.5;3\n");
    assert!(mixed.contains("run.csv:2: `q` is `2.5`, but"), "{mixed}");
}

#[test]
fn bad_logs_are_refused_with_their_line() {
    let cases = [
        ("", "run.csv:1: the log is empty"),
        ("t,theta,q,i\n", "the log has no rows"),
        (
            "t,theta,q\n1,2,3\n",
            "run.csv:1: column `i` is missing among `t,theta,q`",
        ),
        ("t,theta,q,i,t\n", "run.csv:1: column `t` is named twice"),
        (
            "t,theta,q,i\n0,1,2,3\n1,2,3\n",
            "run.csv:3: the field of column `i` is missing",
        ),
        (
            "t,theta,q,i\n0,1,NaN,3\n",
            "run.csv:2: `q` is `NaN`; allowed: a finite number",
        ),
        (
            "t,theta,q,i\n0,1,2,3\n1,inf,2,3\n",
            "run.csv:3: `theta` is `inf`",
        ),
        ("t,theta,q,i\n0,1,2,x\n", "run.csv:2: `i` is `x`"),
        (
            "t,theta,q,i\n1,1,2,3\n\n0.9,1,2,3\n",
            "run.csv:4: time 0.9 s follows 1 s",
        ),
        (
            "t,theta,q,i\n1,1,2,3\n1,1,2,3\n",
            "run.csv:3: time 1 s follows 1 s",
        ),
    ];
    for (text, expected) in cases {
        let message = message(text);
        assert!(message.contains(expected), "{message}");
    }
    let endless = "t,theta,q,i\n".to_owned() + &"1".repeat(100_000);
    assert!(message(&endless).contains("run.csv:2: the line is too long"));
}

/// Rows made while they are read: a log larger than memory.
struct Endless {
    row: u64,
    rows: u64,
    rest: Vec<u8>,
}

impl Read for Endless {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while self.rest.len() < out.len() && self.row < self.rows {
            self.rest
                .extend_from_slice(format!("{},1.5,0.25,0.5\n", self.row).as_bytes());
            self.row += 1;
        }
        let count = out.len().min(self.rest.len());
        out[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(count)
    }
}

#[test]
fn long_logs_are_read_row_by_row() {
    let header = "t,theta,q,i\n".as_bytes();
    let rows = 300_000;
    let input = header.chain(Endless {
        row: 0,
        rows,
        rest: Vec::new(),
    });
    let mut log = LogReader::new(std::io::BufReader::new(input), "long.csv").unwrap();
    let mut count = 0;
    while let Some(row) = log.next_row().unwrap() {
        assert_eq!(row.t, count as f64);
        count += 1;
    }
    assert_eq!(count, rows);
}
