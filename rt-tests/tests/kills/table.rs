//! The page of results: a row for each kind of kill.

use std::fmt::Write;

use torqued_client::robot_state::SharedRecord;

use super::{Watch, is_virtual, state};

/// One kind of damage, done again and again.
pub(crate) struct Row {
    pub(crate) what: &'static str,
    /// State in which every one of them must end.
    pub(crate) wanted: &'static str,
    pub(crate) states: Vec<String>,
    /// Until it was noticed: cycles, from the last one before, and ms, from the deed.
    pub(crate) cycles: Vec<f64>,
    pub(crate) ms: Vec<f64>,
    /// Greatest distance of a joint from where it was, degrees.
    pub(crate) motion: f64,
    pub(crate) recovery_s: Vec<f64>,
    pub(crate) unseen: u64,
}

impl Row {
    pub(crate) fn new(what: &'static str, wanted: &'static str) -> Self {
        Self {
            what,
            wanted,
            states: Vec::new(),
            cycles: Vec::new(),
            ms: Vec::new(),
            motion: 0.0,
            recovery_s: Vec::new(),
            unseen: 0,
        }
    }

    pub(crate) fn add(&mut self, watch: &Watch, last: &SharedRecord) {
        self.states.push(state(last));
        self.motion = self.motion.max(watch.motion.to_degrees());
        self.unseen += watch.unseen;
    }

    pub(crate) fn noticed(&mut self, cycles: u64, begun_ns: u64, record: &SharedRecord) {
        self.cycles.push(cycles as f64);
        let ns = record.cycle.stamp_ns.saturating_sub(begun_ns);
        self.ms.push(ns as f64 * 1e-6);
    }

    pub(crate) fn text(&self) -> String {
        let mut states = self.states.clone();
        states.sort();
        states.dedup();
        format!(
            "| {} | {} | {} | {} | {} | {:.3} | {} |",
            self.what,
            self.states.len(),
            states.join(", "),
            span(&self.cycles, 0),
            span(&self.ms, 1),
            self.motion,
            span(&self.recovery_s, 2)
        )
    }

    pub(crate) fn check(&self) {
        assert!(
            self.states.iter().all(|state| state == self.wanted),
            "{}",
            self.text()
        );
        assert!(self.motion < 1.0, "{}", self.text());
    }
}

/// Least, median and greatest.
pub(crate) fn span(values: &[f64], digits: usize) -> String {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match (sorted.first(), sorted.last()) {
        (Some(least), Some(greatest)) => {
            let median = sorted[sorted.len() / 2];
            format!("{least:.digits$}, {median:.digits$}, {greatest:.digits$}")
        }
        _ => "-".to_owned(),
    }
}

/// The page of the results.
pub(crate) fn text(rows: &[Row], rate_hz: f64, lost: usize, counts: [usize; 4]) -> String {
    let kernel = if is_virtual() {
        "User-Mode Linux, where a process may wait for many milliseconds"
    } else {
        "PREEMPT_RT; in a virtual machine with counted time, or on a machine of its own"
    };
    let mut out = format!(
        "# Processes killed on a real CAN\n\n\
         Written by `rt-tests/vcan/kills.sh`: `torqued`, `torqued-sim` and a compiled client as \
         processes of their own on two vcan interfaces. Kernel: {kernel}. The leg runs at \
         {rate_hz:.0} Hz with `reference_timeout_ms = 40`; the client moves its first joint by inverse \
         dynamics, up to 2 degrees a second.\n\n\
         | killed | times | state reached | noticed after, cycles: least, median, greatest | ms | \
         largest motion of a joint, deg | recovery, s |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for row in rows {
        let _ = writeln!(out, "{}", row.text());
    }
    let unseen: u64 = rows.iter().map(|row| row.unseen).sum();
    let [begun, meanwhile, quiet, left] = counts;
    let _ = write!(
        out,
        "\n\
         - Commander: cycles from the last one that had a new reference to the one in which the lease \
         is free, by the daemon's records; at most 50 ms are promised. ms: from the kill, to the \
         stamp of that cycle. Its motion counts from the kill. Recovery: until the next \
         client, a new process, is followed.\n\
         - A client that was stopped and goes on (SIGCONT) is not followed, and ends with an error.\n\
         - Bus and simulated robot: cycles from the first missed joint to the latched fault. \
         Recovery: by an operator's acknowledge and enable, until the robot holds.\n\
         - Simulated robot: a new one begins at a pose of its own; its motion counts once it is held.\n\
         - Daemon: every other time while a client commands, which ends with an error. Recovery: until \
         the next daemon, started at once with `enable = \"automatic\"`, holds the robot; \
         motion counts over the whole gap.\n\
         - Clients that had lost the command without being killed, and were started again: {lost}. \
         Records that the watching program missed: {unseen}.\n\
         - Files in shared memory and in the run directory: {begun} before the first commander was \
         killed, {meanwhile} after the last one, {left} at the end; a run in which nothing is killed \
         leaves {quiet}.\n"
    );
    out
}
