//! The robots that daemons run now.

use std::time::Duration;

use iceoryx2::prelude::{CallbackProgression, PortFactory, Service};

use crate::channel::{self, RecordMessage, Transport};
use crate::error::Error;
use crate::location::Location;

impl Location {
    /// The robots that daemons run.
    ///
    /// # Errors
    /// [`Error::RunDirectory`] if the directory cannot be read.
    pub fn robots(&self) -> Result<Vec<String>, Error> {
        // Services of daemons that were killed go away with the dead node.
        let node = channel::create_node(self)?;
        let mut robots = Vec::new();
        Transport::list(node.config(), |service| {
            let robot = service
                .static_details
                .name()
                .as_str()
                .strip_prefix("torqued/");
            if let Some(robot) = robot.and_then(|name| name.strip_suffix("/state")) {
                robots.push(robot.to_owned());
            }
            CallbackProgression::Continue
        })
        .map_err(|e| Error::RunDirectory {
            path: self.path().to_owned(),
            reason: format!("cannot be read ({e:?})"),
        })?;
        // A client can keep a service open whose daemon has ended.
        robots.retain(
            |robot| match channel::open::<RecordMessage>(&node, robot, Duration::ZERO) {
                Ok(service) => service.dynamic_config().number_of_publishers() > 0,
                Err(e) => matches!(e, Error::OtherLayout { .. }),
            },
        );
        robots.sort();
        Ok(robots)
    }

    /// The only robot that runs.
    ///
    /// # Errors
    /// [`Error::WhichRobot`] if there is not exactly one.
    pub fn only_robot(&self) -> Result<String, Error> {
        let mut running = self.robots()?;
        match (running.pop(), running.is_empty()) {
            (Some(robot), true) => Ok(robot),
            (last, _) => {
                running.extend(last);
                Err(Error::WhichRobot {
                    running,
                    run_dir: self.path().to_owned(),
                })
            }
        }
    }
}
