//! The loop outlives its publisher thread. In a process of its own: the thread is found by name.

use std::fs;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use problem::Problem;
use robot_config::Robot;
use robot_state::{CycleRecord, Description, Event, Name, SharedRecord};
use test_support::{TemporaryDirectory, read_project_file};
use torqued::bus::BusCounters;
use torqued::loop_monitor::LoopMonitor;
use torqued::real_time::WakeReport;
use torqued::request_server::RequestServer;
use torqued::shared_memory::{self, LoopEnds};
use torqued_client::Location;

/// The number of this process's thread of that name.
fn thread(name: &str) -> Option<i32> {
    let tasks = fs::read_dir("/proc/self/task").expect("tasks").flatten();
    let mut numbers = tasks.filter(|task| {
        fs::read_to_string(task.path().join("comm")).is_ok_and(|text| text.trim() == name)
    });
    numbers.next()?.file_name().to_str()?.parse().ok()
}

/// The publisher thread of a leg, started in a run directory of its own.
fn start(directory: &TemporaryDirectory, leg: &Robot) -> LoopEnds {
    let location = Location::at(directory.path()).expect("a run directory");
    let server = RequestServer::new(leg, Err(Problem::new("none", ""))).expect("a server");
    let description = Description {
        robot: Name::new("leg"),
        joint_count: 6,
        ..Description::default()
    };
    let commanders = supervisor::Commanders::new(0.04);
    shared_memory::start_at(&location, &description, server, commanders).expect("started")
}

fn leg() -> Robot {
    robot_config::load("config/leg/robot.toml", &read_project_file).expect("the leg")
}

/// A publisher thread is found by its name, so one at a time.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
fn a_backlog_of_records_does_not_delay_the_heartbeat() {
    const SENT: u64 = 20_000;
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let directory = TemporaryDirectory::new();
    let mut ends = start(&directory, &leg());
    let before = ends.records.heartbeat();
    for _ in 0..SENT {
        while !ends.records.send(&SharedRecord::default()) {
            std::thread::yield_now();
        }
    }
    let rounds = ends.records.heartbeat() - before;
    // All but what is left in the ring has been published by now.
    assert!(rounds >= (SENT - 256) / 8, "{rounds} rounds");
}

#[test]
fn a_bus_error_of_the_publisher_thread_does_not_end_the_loop_but_is_a_fault() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let directory = TemporaryDirectory::new();
    let leg = leg();
    let mut ends = start(&directory, &leg);
    let mut monitor = LoopMonitor::new(&leg, BusCounters::default());
    let mut cycle = || {
        ends.records.send(&SharedRecord::default());
        std::thread::sleep(Duration::from_millis(1));
        let (wake, heartbeat) = (WakeReport::default(), ends.records.heartbeat());
        let last = CycleRecord::default();
        let mut faults = monitor.faults(&wake, BusCounters::default(), heartbeat, &last);
        faults.next()
    };
    assert!((0..100).all(|_| cycle().is_none()));

    let number = thread("publisher").expect("a publisher thread");
    // SAFETY: takes numbers only.
    let sent = unsafe { libc::syscall(libc::SYS_tgkill, libc::getpid(), number, libc::SIGBUS) };
    assert_eq!(sent, 0);
    let found = (0..5000).find_map(|_| cycle());
    assert_eq!(found, Some(Event::PublisherGone));

    let ending = Instant::now();
    drop(ends);
    assert!(
        ending.elapsed() < Duration::from_secs(1),
        "nobody waits for it"
    );
}
