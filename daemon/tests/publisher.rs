//! The loop outlives its publisher thread. In a process of its own: the thread is found by name.

use std::fs;
use std::time::{Duration, Instant};

use problem::Problem;
use robot_state::{CycleRecord, Description, Event, Name, SharedRecord};
use test_support::{TemporaryDirectory, read_project_file};
use torqued::bus::BusCounters;
use torqued::loop_monitor::LoopMonitor;
use torqued::real_time::WakeReport;
use torqued::request_server::RequestServer;
use torqued::shared_memory;
use torqued_client::Location;

/// The number of this process's thread of that name.
fn thread(name: &str) -> Option<i32> {
    let tasks = fs::read_dir("/proc/self/task").expect("tasks").flatten();
    let mut numbers = tasks.filter(|task| {
        fs::read_to_string(task.path().join("comm")).is_ok_and(|text| text.trim() == name)
    });
    numbers.next()?.file_name().to_str()?.parse().ok()
}

#[test]
fn a_bus_error_of_the_publisher_thread_does_not_end_the_loop_but_is_a_fault() {
    let directory = TemporaryDirectory::new();
    let location = Location::at(directory.path()).expect("a run directory");
    let leg = robot_config::load("config/leg/robot.toml", &read_project_file).expect("the leg");
    let server = RequestServer::new(&leg, Err(Problem::new("none", ""))).expect("a server");
    let description = Description {
        robot: Name::new("leg"),
        joint_count: 6,
        ..Description::default()
    };
    let mut ends = shared_memory::start_at(
        &location,
        &description,
        server,
        supervisor::Commanders::new(0.04),
    )
    .expect("started");
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
