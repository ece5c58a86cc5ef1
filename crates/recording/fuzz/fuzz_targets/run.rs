//! Any bytes: refused, or read as far as they are whole.
#![no_main]

use libfuzzer_sys::fuzz_target;
use recording::{Counts, CycleMessage, Decoder, Glance, Run, Timeline};

fuzz_target!(|bytes: &[u8]| {
    let mut message = CycleMessage::default();
    let mut timeline = Timeline::default();
    // As a file.
    if let Ok(mut run) = Run::open(bytes) {
        while run.next_cycle(&mut message).unwrap_or(false) {
            timeline.observe(&message);
        }
        let header = run.header().clone();
        for span in timeline.finish() {
            let _ = span.words(&header);
        }
    }
    // As another program's file.
    if let Ok((signals, _)) = recording::read_signals(bytes) {
        let advances = |t: &[f64]| t.windows(2).all(|pair| pair[0] < pair[1]);
        assert!(signals.columns.values().all(|signal| advances(&signal.t)));
    }
    // As a message of a file whose checksums are right.
    let counts = Counts {
        joints: 1,
        sensors: 0,
        further_imus: 1,
    };
    let _ = Glance::at(bytes);
    let _ = Decoder::new(counts).decode(bytes, &mut message);
});
