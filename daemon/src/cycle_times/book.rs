//! Histograms of times, and causes of late cycles.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use cycle::STAGES;
use hdrhistogram::Histogram;
use robot_config::{Robot, slots};
use serde_json::{Value, json};

use super::system::{Counts, LoopThread};
use super::{CycleTimes, NONE, TimesReceiver};
use torqued_client::TimingFile;

/// Longest time that a histogram distinguishes, ns.
const LONGEST_NS: u64 = 10_000_000_000;
/// Late cycles of which each is kept by itself.
const RECENT: usize = 50;
/// Time from one writing of the file to the next.
const INTERVAL: Duration = Duration::from_secs(1);
/// Cycles before whose number no phase has a usual time.
const FIRST: u64 = 100;
/// Phases before the stages, and all of them.
const BEFORE: usize = 2;
const PHASES: usize = BEFORE + STAGES.len() + 1;

/// A late cycle and what made it late.
struct Late {
    cycle: u64,
    phase: &'static str,
    phase_ns: u64,
    cause: String,
}

/// Keeps the times of a loop.
pub struct Book {
    receiver: TimesReceiver,
    thread: LoopThread,
    file: Option<TimingFile>,
    phases: Vec<Histogram<u64>>,
    whole: Histogram<u64>,
    before: Option<CycleTimes>,
    counts: Counts,
    cycles: u64,
    late: u64,
    skipped: u64,
    causes: BTreeMap<String, u64>,
    recent: VecDeque<Late>,
    /// Who sends each message: the joint or sensor, and its bus.
    senders: Vec<String>,
    gather_deadline_ns: u64,
    written: Instant,
}

impl Book {
    /// Times of the robot's loop; `file`: where others read them.
    ///
    /// # Panics
    /// Never: the bounds are constants that the histogram accepts.
    #[must_use]
    pub fn new(
        robot: &Robot,
        receiver: TimesReceiver,
        thread: LoopThread,
        file: Option<TimingFile>,
    ) -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("constant bounds are in order");
        let mut book = Self {
            receiver,
            thread,
            file,
            phases: vec![histogram(); PHASES],
            whole: histogram(),
            before: None,
            counts: Counts::default(),
            cycles: 0,
            late: 0,
            skipped: 0,
            causes: BTreeMap::new(),
            recent: VecDeque::new(),
            senders: (0..robot.receive.message_count())
                .map(|message| sender(robot, message))
                .collect(),
            gather_deadline_ns: (robot.parameters.timing.gather_deadline * 1e9) as u64,
            written: Instant::now(),
        };
        book.write();
        book
    }

    /// Takes what the loop has handed over since the last look.
    pub fn look(&mut self) {
        let counts = self.thread.counts();
        let happened = counts.since(&self.counts);
        self.counts = counts;
        while let Some(times) = self.receiver.next() {
            self.take(&times, happened);
        }
        if self.written.elapsed() >= INTERVAL {
            self.write();
        }
    }

    /// Writes the file now.
    pub fn write(&mut self) {
        self.written = Instant::now();
        let text = self.json().to_string();
        if let Some(file) = &self.file {
            // A full disk: the loop does not need this file.
            let _ = file.write(&text);
        }
    }

    fn take(&mut self, times: &CycleTimes, happened: Option<&'static str>) {
        if let Some(before) = self.before.filter(|_| times.after_late) {
            let late = self.judge(&before, happened);
            *self.causes.entry(late.cause.clone()).or_default() += 1;
            self.late += 1;
            self.recent.push_back(late);
            if self.recent.len() > RECENT {
                self.recent.pop_front();
            }
        }
        self.skipped += times.skipped;
        self.cycles += 1;
        let durations = durations(times);
        for (histogram, ns) in self.phases.iter_mut().zip(durations) {
            histogram.saturating_record(ns);
        }
        self.whole.saturating_record(durations.iter().sum());
        self.before = Some(*times);
    }

    /// What made that cycle late: the phase that took the most time beyond its usual one, and who is to blame.
    fn judge(&self, times: &CycleTimes, happened: Option<&'static str>) -> Late {
        let durations = durations(times);
        let beyond = |phase: &usize| {
            let usual = self.phases[*phase].value_at_quantile(0.5);
            durations[*phase].saturating_sub(usual)
        };
        let phase = (0..PHASES).max_by_key(beyond).unwrap_or(0);
        let cause = if self.cycles < FIRST {
            "the first cycles: caches and pages are cold".to_owned()
        } else {
            self.cause(phase, times, happened)
        };
        Late {
            cycle: times.cycle,
            phase: name(phase),
            phase_ns: durations[phase],
            cause,
        }
    }

    fn cause(&self, phase: usize, times: &CycleTimes, happened: Option<&'static str>) -> String {
        // What happened within the same look of the main thread is the likely cause, not a proven one.
        let system = |otherwise: &str| match happened {
            Some(happened) => format!("system, seen at that time: {happened}"),
            None => format!("system, by exclusion: {otherwise}"),
        };
        let who = |message: u16| self.senders.get(usize::from(message)).map(String::as_str);
        match phase {
            0 => system("woken late by interrupts, idle states or firmware"),
            // Longer than the loop waits for anybody: the thread itself stood still.
            1 if times.gather_ns > self.gather_deadline_ns + self.gather_deadline_ns / 4 => {
                system("the loop stood still while it waited for the bus")
            }
            1 => match (who(times.missing_message), who(times.last_message)) {
                (Some(missing), _) => format!("bus: no answer of {missing}"),
                (None, Some(last)) => format!("bus: {last} answered last"),
                (None, None) => "bus: nobody answered".to_owned(),
            },
            _ => match happened {
                Some(_) => system(""),
                None => format!("stage {}", name(phase)),
            },
        }
    }

    /// All of it.
    #[must_use]
    pub fn json(&self) -> Value {
        let phases = self
            .phases
            .iter()
            .enumerate()
            .map(|(phase, times)| histogram(name(phase), times));
        let phases = phases.chain([histogram("cycle", &self.whole)]);
        let recent = self.recent.iter().map(|late| {
            json!({ "cycle": late.cycle, "phase": late.phase, "phase_us": us(late.phase_ns), "cause": late.cause })
        });
        json!({
            "cycles": self.cycles,
            "late_cycles": self.late,
            "skipped_cycles": self.skipped,
            "phases": phases.collect::<Vec<_>>(),
            "late_by_cause": self.causes,
            "last_late_cycles": recent.collect::<Vec<_>>(),
        })
    }
}

fn durations(times: &CycleTimes) -> [u64; PHASES] {
    let mut all = [0; PHASES];
    all[0] = times.wake_ns;
    all[1] = times.gather_ns;
    all[BEFORE..BEFORE + STAGES.len()].copy_from_slice(&times.stages_ns);
    all[PHASES - 1] = times.send_ns;
    all
}

fn name(phase: usize) -> &'static str {
    match phase {
        0 => "wake-up",
        1 => "gather",
        _ => STAGES.get(phase - BEFORE).copied().unwrap_or("send"),
    }
}

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

/// Quantiles, and counts by powers of two: `[upper bound in us, count]`.
fn histogram(name: &str, times: &Histogram<u64>) -> Value {
    let quantile = |q: f64| us(times.value_at_quantile(q));
    let buckets = times.iter_log(1_000, 2.0).map(|step| {
        json!([
            us(step.value_iterated_to() + 1),
            step.count_since_last_iteration()
        ])
    });
    json!({
        "name": name,
        "p50_us": quantile(0.5),
        "p99_us": quantile(0.99),
        "p999_us": quantile(0.999),
        "max_us": us(times.max()),
        "histogram": buckets.collect::<Vec<_>>(),
    })
}

/// The joint or sensor that sends a message, with its bus.
fn sender(robot: &Robot, message: usize) -> String {
    let parameters = &robot.parameters;
    let source = robot.receive.slots(message).map(slots::source).next();
    let name = match source {
        Some(slots::Source::Joint(joint)) => parameters
            .joints
            .get(joint)
            .map(|joint| format!("joint {}", joint.name)),
        Some(slots::Source::Ft(sensor)) => {
            let sensor = parameters.ft_sensors.get(sensor);
            sensor.map(|sensor| format!("F/T sensor {}", sensor.sensor.name))
        }
        Some(slots::Source::Imu(_)) => Some("the IMU".to_owned()),
        None => None,
    };
    let message = robot.receive.message(message);
    let bus = message.and_then(|message| parameters.buses.get(usize::from(message.bus)));
    let bus = bus.map_or("", |bus| bus.name.as_str());
    format!("{} on bus {bus}", name.as_deref().unwrap_or("a frame"))
}

/// No message: for cycles on a bus that did not say.
impl CycleTimes {
    /// Sets the messages of a gather.
    pub(crate) fn messages(&mut self, last: Option<usize>, missing: Option<usize>) {
        let number = |message: Option<usize>| message.map_or(NONE, |message| message as u16);
        (self.last_message, self.missing_message) = (number(last), number(missing));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle_times::{TimesSender, channel};

    fn usual(cycle: u64) -> CycleTimes {
        CycleTimes {
            cycle,
            wake_ns: 15_000,
            gather_ns: 400_000,
            stages_ns: [5_000; STAGES.len()],
            send_ns: 9_000,
            last_message: 1,
            missing_message: NONE,
            ..CycleTimes::default()
        }
    }

    fn book() -> (TimesSender, Book) {
        let robot = robot_config::load("config/leg/robot.toml", &test_support::read_project_file)
            .expect("the leg");
        let (mut sender, receiver) = channel();
        let book = Book::new(&robot, receiver, LoopThread::default(), None);
        (1..=1000).for_each(|cycle| sender.send(usual(cycle)));
        (sender, book)
    }

    /// The causes after one cycle of these times that ended too late.
    fn causes(times: CycleTimes, happened: Option<&'static str>) -> Vec<String> {
        let (_sender, mut book) = book();
        book.look();
        book.take(&times, happened);
        let next = CycleTimes {
            after_late: true,
            ..usual(1002)
        };
        book.take(&next, happened);
        assert_eq!(book.late, 1);
        book.causes.into_keys().collect()
    }

    #[test]
    fn a_late_cycle_is_blamed_on_the_phase_that_took_longer_than_usual() {
        let mut slow = usual(1001);
        slow.stages_ns[1] = 700_000;
        assert_eq!(causes(slow, None), ["stage estimate"]);
        let late = CycleTimes {
            wake_ns: 900_000,
            ..usual(1001)
        };
        assert_eq!(
            causes(late, None),
            ["system, by exclusion: woken late by interrupts, idle states or firmware"]
        );
        let stolen = "the host of this virtual machine took the CPU away";
        assert_eq!(
            causes(late, Some(stolen)),
            [format!("system, seen at that time: {stolen}")]
        );
        assert_eq!(
            causes(slow, Some("page faults")),
            ["system, seen at that time: page faults"]
        );
    }

    #[test]
    fn a_late_answer_names_the_joint_and_its_bus() {
        let waited = CycleTimes {
            gather_ns: 750_000,
            missing_message: 0,
            ..usual(1001)
        };
        let [cause] = causes(waited, None).try_into().expect("one cause");
        assert!(
            cause.starts_with("bus: no answer of joint ") && cause.contains(" on bus a"),
            "{cause}"
        );
        let last = CycleTimes {
            gather_ns: 740_000,
            ..usual(1001)
        };
        let [cause] = causes(last, None).try_into().expect("one cause");
        assert!(cause.ends_with("answered last"), "{cause}");
        let stood = CycleTimes {
            gather_ns: 5_000_000,
            ..usual(1001)
        };
        let [cause] = causes(stood, None).try_into().expect("one cause");
        assert!(cause.starts_with("system, "), "{cause}");
    }

    #[test]
    fn every_cycle_is_in_every_histogram() {
        let (_sender, mut book) = book();
        book.look();
        let page = book.json();
        assert_eq!(page["cycles"], 1000);
        for phase in page["phases"].as_array().expect("phases") {
            let buckets = phase["histogram"].as_array().expect("a histogram");
            let count: u64 = buckets.iter().filter_map(|bucket| bucket[1].as_u64()).sum();
            assert_eq!(count, 1000, "{phase}");
        }
        let gather = &page["phases"][1];
        assert!(
            (gather["p50_us"].as_f64().expect("a number") - 400.0).abs() < 1.0,
            "{gather}"
        );
    }
}
