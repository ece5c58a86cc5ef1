//! Drives that are nodes of their buses: electronics of their own between bus and motor.
//!
//! Each file is written from the standard or from its maker's description, apart from the masters in `crates/drives`:
//! what both have wrong in the same way would not show.

mod actuator;
mod canopen;
mod cia402;
mod cubemars;
mod damiao;
mod mit;
mod moteus;
mod motor;
mod myactuator;
mod objects;
mod odrive;
mod pdo;
mod robstride;
mod sdo;
mod wire;

use crate::parameters::SimParameters;
use crate::robot::SimRobot;
use crate::transport::Transport;
use actuator::Actuator;
use can_codec::{Frame, Frames};
use canopen::CanopenDrive;
use motor::Motor;
use problem::{Problem, listed};
use robot_config::{MountedDrive, NodeSheet, Robot, slots};
use wire::Wire;

/// The robot around its nodes, and a moment.
pub(crate) struct Around<'a> {
    pub(crate) robot: &'a mut SimRobot,
    pub(crate) transport: &'a mut Transport,
    /// ns.
    pub(crate) now: u64,
    pub(crate) out: &'a mut Frames,
}

#[derive(Debug, Clone)]
enum End {
    Canopen(Box<CanopenDrive>),
    Actuator(Actuator),
}

#[derive(Debug, Clone)]
struct Node {
    mounted: MountedDrive,
    end: End,
}

/// A drive's supply is off for a while, s of the simulation.
#[derive(Debug, Clone)]
struct PowerLoss {
    joint: usize,
    begin: f64,
    end: f64,
}

/// All nodes of a robot.
#[derive(Debug, Clone)]
pub(crate) struct Nodes {
    nodes: Vec<Node>,
    power_losses: Vec<PowerLoss>,
}

impl Nodes {
    /// The robot's nodes, just switched on.
    ///
    /// # Errors
    /// Losses of supply of what is no node.
    pub(crate) fn new(
        robot: &Robot,
        sim: &SimParameters,
        simulated: &mut SimRobot,
        transport: &mut Transport,
    ) -> Result<Self, Problem> {
        let made = |mounted: &MountedDrive| {
            let mut motor = Motor {
                robot: &mut *simulated,
                mounted,
                transport: &mut *transport,
            };
            let end = match &mounted.sheet {
                NodeSheet::Canopen(sheet) => {
                    let drive = CanopenDrive::new(mounted.node, sheet, &mut motor);
                    End::Canopen(Box::new(drive))
                }
                NodeSheet::Actuator(sheet) => {
                    End::Actuator(Actuator::new(mounted.node, sheet, &mut motor)?)
                }
            };
            let mounted = mounted.clone();
            Ok(Node { mounted, end })
        };
        let nodes = robot.nodes.mounted.iter().map(made);
        let nodes = nodes.collect::<Result<_, Problem>>()?;
        let power_losses = power_losses(robot, sim)?;
        Ok(Self {
            nodes,
            power_losses,
        })
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The value of a receive slot comes from a node.
    pub(crate) fn has_slot(&self, slot: usize) -> bool {
        let slots::Source::Joint(joint) = slots::source(slot) else {
            return false;
        };
        self.nodes.iter().any(|node| node.mounted.joint == joint)
    }

    /// One of the drives makes torque.
    pub(crate) fn are_on(&self, robot: &mut SimRobot) -> bool {
        self.nodes.iter().any(|node| {
            let states = robot.drive_states(node.mounted.joint);
            states.is_some_and(|states| states.is_enabled())
        })
    }

    /// Some send their samples by clocks of their own.
    pub(crate) fn send_by_themselves(&self) -> bool {
        let mut ends = self.nodes.iter().map(|node| &node.end);
        ends.any(|end| matches!(end, End::Actuator(actuator) if actuator.sends_by_itself()))
    }

    /// On that bus are actuators that answer when they are asked.
    pub(crate) fn answer_only(&self, bus: u8) -> bool {
        let mut nodes = self.nodes.iter().filter(|node| node.mounted.bus == bus);
        nodes
            .any(|node| matches!(&node.end, End::Actuator(actuator) if !actuator.sends_by_itself()))
    }

    /// What they do by their own clocks.
    pub(crate) fn poll(&mut self, around: &mut Around<'_>) {
        let time = around.robot.time();
        for node in &mut self.nodes {
            let joint = node.mounted.joint;
            let is_off =
                |loss: &PowerLoss| loss.joint == joint && (loss.begin..loss.end).contains(&time);
            let powered = !self.power_losses.iter().any(is_off);
            node.with(around, |end, wire, motor| match end {
                End::Canopen(drive) => {
                    drive.set_power(powered, motor);
                    drive.poll(wire, motor);
                }
                End::Actuator(actuator) => {
                    actuator.set_power(powered, motor);
                    actuator.poll(wire, motor);
                }
            });
        }
    }

    /// A SYNC on a bus.
    pub(crate) fn sync(&mut self, bus: u8, around: &mut Around<'_>) {
        for node in self.nodes.iter_mut().filter(|node| node.mounted.bus == bus) {
            node.with(around, |end, wire, motor| match end {
                End::Canopen(drive) => drive.sync(wire, motor),
                End::Actuator(_) => {}
            });
        }
    }

    /// Hands a frame to the nodes of its bus; true if one of them listens for it.
    pub(crate) fn hear(&mut self, frame: &Frame, around: &mut Around<'_>) -> bool {
        let mut heard = false;
        for node in &mut self.nodes {
            if node.mounted.bus == frame.bus {
                heard |= node.with(around, |end, wire, motor| match end {
                    End::Canopen(drive) => drive.hear(frame, wire, motor),
                    End::Actuator(actuator) => actuator.hear(frame, wire, motor),
                });
            }
        }
        heard
    }
}

impl Node {
    fn with<T>(
        &mut self,
        around: &mut Around<'_>,
        act: impl FnOnce(&mut End, &mut Wire<'_>, &mut Motor<'_>) -> T,
    ) -> T {
        let mut wire = Wire {
            bus: self.mounted.bus,
            now: around.now,
            out: &mut *around.out,
        };
        let mut motor = Motor {
            robot: &mut *around.robot,
            mounted: &self.mounted,
            transport: &mut *around.transport,
        };
        act(&mut self.end, &mut wire, &mut motor)
    }
}

fn power_losses(robot: &Robot, sim: &SimParameters) -> Result<Vec<PowerLoss>, Problem> {
    let joints = &robot.parameters.joints;
    let is_node = |joint: usize| robot.nodes.mounted.iter().any(|node| node.joint == joint);
    let nodes = || (0..joints.len()).filter(|joint| is_node(*joint));
    let found = |name: &str| nodes().find(|joint| joints[*joint].name == name);
    sim.power_losses
        .iter()
        .map(|loss| {
            let joint = found(&loss.joint).ok_or_else(|| {
                let what = format!(
                    "power_loss.joint: {:?} has no drive that is a node",
                    loss.joint
                );
                Problem::new(
                    what,
                    listed(nodes().map(|joint| joints[joint].name.as_str())),
                )
            })?;
            let (begin, end) = (loss.start, loss.start + loss.duration);
            Ok(PowerLoss { joint, begin, end })
        })
        .collect()
}
