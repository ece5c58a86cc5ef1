//! Time to decode a frame, against reading its bits one by one.
//!
//! `cargo bench -p can-codec`

use can_codec::{BusDbc, Dbc, Frame, Frames, Gather, SignalMap, Table};
use std::hint::black_box;
use std::io::{self, Write};
use std::time::Duration;

const DBC: &str = include_str!("../../../robot-models/humanoid/drives.dbc");
/// Short, so that some of the times fall between two switches of tasks.
const ROUNDS: u32 = 100;
const TIMES: usize = 2000;

fn main() -> io::Result<()> {
    let dbc = Dbc::parse(DBC, "drives.dbc").map_err(io::Error::other)?;
    let states: Vec<_> = dbc
        .messages
        .iter()
        .filter(|m| m.name.ends_with("_STATE"))
        .collect();
    let mut maps = SignalMap::all(0, states.iter().copied());
    for (_, map) in &mut maps {
        (map.scale, map.offset) = (1e-3, 0.5);
    }
    let bus = BusDbc {
        bus: 0,
        fd: true,
        dbc: &dbc,
    };
    let table = Table::compile(&[bus], &maps).map_err(io::Error::other)?;
    let mut slots = vec![0.25; table.slot_count()];
    let mut frames = Frames::default();
    table.encode_all(&slots, &mut frames);
    let (count, signals) = (frames.len(), slots.len());

    let decode = time(|| {
        for frame in black_box(&frames) {
            black_box(table.decode(frame, &mut slots).is_ok());
        }
    });
    let mut gather = Gather::new(table.message_count());
    let noted = time(|| {
        gather.begin();
        for frame in black_box(&frames) {
            black_box(gather.note(&table, frame));
        }
    });
    let encode = time(|| {
        let mut made = Frame::zeroed(0, 0, 0, false);
        for index in 0..table.message_count() {
            black_box(table.encode(index, black_box(&slots), &mut made));
        }
    });
    // Little endian, as this DBC file is: start and size of each signal of each frame.
    let places: Vec<Vec<(usize, usize)>> = states
        .iter()
        .map(|message| message.signals.iter().scan(0, place).collect())
        .collect();
    let naive = time(|| {
        for (frame, places) in black_box(&frames).iter().zip(&places) {
            for &(start, size) in places {
                let bits = (0..size).fold(0u64, |value, i| {
                    let bit = start + i;
                    value | u64::from(frame.data[bit / 8] >> (bit % 8) & 1) << i
                });
                black_box(bits as f64 * 1e-3 + 0.5);
            }
        }
    });
    let mut out = io::stdout();
    writeln!(
        out,
        "{count} frames, {signals} signals; per frame of {} signals:",
        signals / count
    )?;
    for (what, whole) in [
        ("decode", decode),
        ("bit by bit", naive),
        ("gather", noted),
        ("encode", encode),
    ] {
        let ns = whole.as_secs_f64() * 1e9 / f64::from(ROUNDS) / count as f64;
        writeln!(out, "  {what:<12} {ns:8.1} ns")?;
    }
    Ok(())
}

/// A stand-in for the signals' places: one after the other.
fn place(next: &mut usize, signal: &can_codec::Signal) -> Option<(usize, usize)> {
    let size = usize::from(signal.size);
    let start = *next;
    *next += size;
    Some((start, size))
}

/// The best of many times of `ROUNDS` calls.
#[allow(clippy::disallowed_methods, reason = "a benchmark looks at the clock")]
fn time(mut work: impl FnMut()) -> Duration {
    let mut best = Duration::MAX;
    for _ in 0..TIMES {
        let start = std::time::Instant::now();
        (0..ROUNDS).for_each(|_| work());
        best = best.min(start.elapsed());
    }
    best
}
