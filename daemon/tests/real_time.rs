//! The loop's thread: schedule, report, and the measures as this system grants them.

use proptest::prelude::*;
use torqued::real_time::{Deadline, Denial, Measure, Pace, Report, Schedule, Settings, enter};

fn denied(name: &str, essential: bool) -> Measure {
    Measure {
        name: name.to_owned(),
        essential,
        outcome: Err(Denial {
            why: "EPERM".to_owned(),
            mend: "LimitRTPRIO=80".to_owned(),
        }),
    }
}

#[test]
fn require_refuses_with_the_missing_measure_and_its_remedy() {
    let report = Report {
        measures: vec![denied("scheduler", true), denied("CPUs kept awake", false)],
    };
    let message = report.clone().judge(true).unwrap_err().to_string();
    assert!(message.contains("scheduler: denied: EPERM; to mend: LimitRTPRIO=80"));
    assert!(!message.contains("kept awake"), "{message}");
    assert_eq!(report.clone().judge(false), Ok(report));
}

#[test]
fn require_accepts_missing_advisable_measures() {
    let report = Report {
        measures: vec![denied("CPUs kept awake", false)],
    };
    assert_eq!(report.clone().judge(true), Ok(report));
}

#[test]
fn every_measure_is_reported_whatever_the_system_grants() {
    let settings = Settings {
        require: false,
        priority: 10,
        cpu: Some(0),
    };
    // In a thread of its own: the scheduler's policy is the thread's.
    let real_time = std::thread::spawn(move || enter(&settings))
        .join()
        .unwrap()
        .unwrap();
    let names: Vec<_> = real_time.report.measures.iter().map(|m| &m.name).collect();
    let wanted = [
        "CPU 0 only",
        "memory locked",
        "CPUs kept awake",
        "scheduler SCHED_FIFO 10",
    ];
    assert_eq!(names, wanted);
    for measure in real_time.report.denied() {
        let denial = measure.outcome.as_ref().unwrap_err();
        assert!(!denial.why.is_empty() && !denial.mend.is_empty());
    }
}

#[test]
fn deadline_keeps_to_its_grid() {
    let mut deadline = Deadline::new(200_000);
    let mut last = deadline.wait();
    for _ in 0..20 {
        let wake = deadline.wait();
        assert!(wake.woke_ns >= wake.scheduled_ns);
        assert_eq!(
            wake.scheduled_ns - last.scheduled_ns,
            200_000 * (1 + wake.skipped)
        );
        last = wake;
    }
}

proptest! {
    #[test]
    fn schedule_never_bursts_and_never_leaves_the_grid(
        period in 1_u64..2_000_000,
        work in prop::collection::vec(0_u64..10_000_000, 1..50),
    ) {
        let first = 1_000_000;
        let mut schedule = Schedule::new(first, period);
        let (mut now, mut taken, mut skipped_total) = (0, 0, 0);
        for busy in work {
            let (start, late, skipped) = schedule.take(now);
            // On the grid, and every start is either taken or counted as skipped.
            prop_assert_eq!(start, first + (taken + skipped_total + skipped) * period);
            // A late start is less than a period late: no cycle is caught up.
            prop_assert!(now < start + period);
            prop_assert_eq!(late, now > start || skipped > 0);
            taken += 1;
            skipped_total += skipped;
            now = now.max(start) + busy;
        }
    }
}
