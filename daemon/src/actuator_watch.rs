//! Watch over actuators while the loop runs: errors in words, and what is missing where one has not
//! sent all that the loop needs. A thread that only looks at what the loop's bus has noted.

use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use drives::family::translation::{Actuator, Report, Reports, named};
use robot_config::Robot;

use crate::failure::Failure;

/// Time between two looks.
const LOOK: Duration = Duration::from_millis(50);
/// Time after which the values that an actuator has not sent are named.
const PATIENCE: Duration = Duration::from_secs(2);

/// The watch; ends when it is dropped.
pub struct ActuatorWatch {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl ActuatorWatch {
    /// Begins; none without reports.
    ///
    /// # Errors
    /// Its thread cannot be made.
    pub fn start(robot: &Robot, reports: Option<Reports>) -> Result<Option<Self>, Failure> {
        let Some(reports) = reports else {
            return Ok(None);
        };
        let mut watched: Vec<_> = (robot.nodes.actuators.iter().cloned())
            .map(Watched::new)
            .collect();
        let (stop, stopped) = mpsc::channel::<()>();
        let thread = thread::Builder::new()
            .name("actuators".to_owned())
            .spawn(move || {
                let begin = Instant::now();
                while stopped.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                    let late = begin.elapsed() > PATIENCE;
                    for (index, actuator) in watched.iter_mut().enumerate() {
                        for line in actuator.look(&reports.get(index), late) {
                            tracing::info!("{line}");
                        }
                    }
                }
            })
            .map_err(Failure::environment)?;
        Ok(Some(Self {
            stop: Some(stop),
            thread: Some(thread),
        }))
    }
}

impl Drop for ActuatorWatch {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            // A panic there has been shown, and is no reason to end otherwise.
            let _ = thread.join();
        }
    }
}

/// An actuator, and what has been said of it.
struct Watched {
    actuator: Actuator,
    error: u32,
    missed: bool,
}

impl Watched {
    fn new(actuator: Actuator) -> Self {
        Self {
            actuator,
            error: 0,
            missed: false,
        }
    }

    /// What is to be said of a report; `late`: it should be complete.
    fn look(&mut self, report: &Report, late: bool) -> Vec<String> {
        let Some(family) = named(self.actuator.family) else {
            return Vec::new();
        };
        let who = format!("{} (node {})", self.actuator.name, self.actuator.at.node);
        let mut lines = Vec::new();
        if report.error != self.error {
            self.error = report.error;
            lines.push(match report.error {
                0 => format!("{who}: no error any more"),
                error => format!("{who}: error {error:#x}, {}", family.error_text(error)),
            });
        }
        let heard = report.heard;
        let current = heard.current || !family.tells_apart();
        let complete = heard.position && heard.state && current;
        if late && !complete && !self.missed {
            self.missed = true;
            lines.push(format!("{who}: {}", family.cure(heard)));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use drives::family::{Address, Heard};

    #[test]
    fn errors_and_what_is_missing_are_said_once() {
        let model = named("odrive").expect("a family").models()[0];
        let mut watched = Watched::new(Actuator {
            family: "odrive",
            model,
            at: Address {
                bus: 0,
                node: 3,
                master: 0,
            },
            name: "knee".to_owned(),
            kp: 1.0,
            kd: 1.0,
            gear_ratio: 1.0,
            torque_per_current: 1.0,
        });
        let mut report = Report::default();
        assert!(watched.look(&report, false).is_empty());
        let silent = watched.look(&report, true);
        assert!(
            silent[0].starts_with("knee (node 3): no heartbeat"),
            "{silent:?}"
        );
        assert!(watched.look(&report, true).is_empty());
        report.error = 0x100_0001;
        let error = watched.look(&report, true);
        assert_eq!(error, ["knee (node 3): error 0x1000001, it is starting"]);
        assert!(watched.look(&report, true).is_empty());
        report.error = 0;
        assert_eq!(
            watched.look(&report, true),
            ["knee (node 3): no error any more"]
        );
        let heard = Heard {
            position: true,
            current: false,
            state: true,
        };
        let mut fresh = Watched::new(watched.actuator);
        let current = fresh.look(&Report { heard, ..report }, true);
        assert!(current[0].contains("iq_msg_rate_ms"), "{current:?}");
    }
}
