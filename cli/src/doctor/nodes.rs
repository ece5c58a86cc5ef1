//! Drives that the configuration names, and whether they answer.

use super::finding::Findings;
use crate::can::{Where, answering};
use robot_config::Robot;
use torqued::failure::Failure;

/// Asks on every bus who is there; nothing that is asked can move anything.
///
/// # Errors
/// A bus that cannot be used: a daemon has it, or it does not exist.
pub(super) fn check(robot: &Robot, config: &str, findings: &mut Findings) -> Result<(), Failure> {
    let answering = answering(&Where::config(config))?;
    let plans = robot
        .nodes
        .plans
        .iter()
        .map(|plan| (&plan.name, plan.bus, plan.node));
    let actuators = robot
        .nodes
        .actuators
        .iter()
        .map(|one| (&one.name, one.at.bus, one.at.node));
    for (joint, bus, node) in plans.chain(actuators) {
        if answering.contains(&(bus, node)) {
            continue;
        }
        let bus = robot
            .parameters
            .buses
            .get(usize::from(bus))
            .map_or("", |bus| bus.name.as_str());
        findings.error(
            "node",
            format!("joint {joint}: node {node} on bus {bus} does not answer"),
            "the robot is not enabled",
            format!("its supply, its cable and its node number; torquectl can scan {config}"),
        );
    }
    Ok(())
}
