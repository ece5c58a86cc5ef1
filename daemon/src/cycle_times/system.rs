//! What the system did to the loop's thread, as `/proc` counts it.

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};

/// The loop's thread, once it runs.
#[derive(Debug, Clone, Default)]
pub struct LoopThread(Arc<AtomicI32>);

impl LoopThread {
    /// Called by the loop's thread itself, before its first cycle.
    pub fn is_this_one(&self) {
        self.0
            .store(nix::unistd::gettid().as_raw(), Ordering::Relaxed);
    }

    /// Counts since the thread's and the machine's start.
    pub(super) fn counts(&self) -> Counts {
        let thread = self.0.load(Ordering::Relaxed);
        let read = |file: &str| fs::read_to_string(file).unwrap_or_default();
        let at = format!("/proc/self/task/{thread}");
        Counts::parse(
            &read(&format!("{at}/status")),
            &read(&format!("{at}/stat")),
            &read("/proc/stat"),
        )
    }
}

/// What happened, in counts that only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Counts {
    /// The thread was taken off its CPU though it wanted to run.
    pub(super) preempted: u64,
    /// Page faults served from memory.
    pub(super) minor_faults: u64,
    /// Page faults that needed a disk.
    pub(super) major_faults: u64,
    /// The CPU on which the thread ran last.
    pub(super) cpu: u64,
    /// Time that the host of a virtual machine took from that CPU, in the kernel's ticks.
    pub(super) stolen: u64,
}

impl Counts {
    /// From the texts of a thread's `status` and `stat`, and of the machine's `stat`: proc(5).
    fn parse(status: &str, stat: &str, machine: &str) -> Self {
        let value = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            line.and_then(|value| value.trim().parse().ok())
                .unwrap_or(0)
        };
        // Behind the name, which may contain spaces, the third field follows.
        let fields: Vec<&str> = stat
            .rsplit_once(')')
            .map_or(Vec::new(), |(_, after)| after.split_whitespace().collect());
        let field = |number: usize| {
            fields
                .get(number - 3)
                .and_then(|text| text.parse().ok())
                .unwrap_or(0)
        };
        // user, nice, system, idle, iowait, irq, softirq, steal.
        let cpu = field(39);
        let own = format!("cpu{cpu}");
        let mut lines = machine.lines();
        let line = lines.find(|line| line.split_whitespace().next() == Some(&own));
        let stolen = line.and_then(|line| line.split_whitespace().nth(8)?.parse().ok());
        Self {
            preempted: value("nonvoluntary_ctxt_switches:"),
            minor_faults: field(10),
            major_faults: field(12),
            cpu,
            stolen: stolen.unwrap_or(0),
        }
    }

    /// What happened since, the gravest first; none where nothing of it is counted.
    pub(super) fn since(&self, before: &Self) -> Option<&'static str> {
        let more = |of: fn(&Self) -> u64| of(self) > of(before);
        if self.cpu == before.cpu && more(|counts| counts.stolen) {
            return Some("the host of this virtual machine took the CPU away");
        }
        if more(|counts| counts.major_faults) {
            return Some("page faults that needed a disk");
        }
        if more(|counts| counts.preempted) {
            return Some("another thread ran in the loop's place");
        }
        more(|counts| counts.minor_faults).then_some("page faults")
    }
}

#[cfg(test)]
mod tests {
    use super::Counts;

    #[test]
    fn counts_are_those_of_proc() {
        let status = "Name:\tloop\nvoluntary_ctxt_switches:\t7\nnonvoluntary_ctxt_switches:\t3\n";
        let stat = format!(
            "78 (my loop) S 1 1 1 0 -1 64 21 0 5 0 {}1 80 1",
            "9 ".repeat(25)
        );
        let counts = Counts::parse(
            status,
            &stat,
            "cpu  1 2 3 4 5 6 7 99 0 0\ncpu1 1 2 3 4 5 6 7 88 0 0",
        );
        let expected = Counts {
            preempted: 3,
            minor_faults: 21,
            major_faults: 5,
            cpu: 1,
            stolen: 88,
        };
        assert_eq!(counts, expected);
        assert_eq!(counts.since(&counts), None);
        let before = Counts {
            stolen: 87,
            ..counts
        };
        assert!(
            counts
                .since(&before)
                .is_some_and(|cause| cause.contains("host"))
        );
    }

    #[test]
    fn this_thread_has_been_counted() {
        let thread = super::LoopThread::default();
        thread.is_this_one();
        // Memory of its own, page by page.
        std::hint::black_box(vec![1_u8; 1 << 20]);
        assert!(thread.counts().minor_faults > 0);
    }
}
