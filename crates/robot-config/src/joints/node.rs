//! A joint's drive as a node of its bus, whose messages no DBC file describes.

use super::Reader;
use crate::drives::{ActuatorKind, CanopenDrive, Drive, Node};
use crate::reader::{Allowed, Section};
use crate::sampling::Sampled;
use crate::wiring::Wiring;
use crate::{ActuatorSheet, CanopenSheet, NodeSheet};
use core::f64::consts::TAU;
use drives_of_makers::canopen::Object;
use drives_of_makers::cia402::{self, Asked, Kind, Mode, Side, signals};
use drives_of_makers::family::Address;
use drives_of_makers::family::translation::{self, Actuator};
use robot_state::JointKind;
use supervisor::Limits;

/// The signals of a node.
pub(super) struct Messages(Vec<Made>);

/// A signal that a profile describes.
#[derive(Clone)]
pub(super) struct Made {
    key: &'static str,
    /// `MESSAGE.signal`.
    pub(super) path: String,
    /// Direction, unless the joint's table has another.
    pub(super) sign: f64,
    /// Value of its count zero in the slot's unit, unless the joint's table has another.
    pub(super) offset: f64,
}

impl Messages {
    pub(super) fn signal(&self, key: &str) -> Option<&Made> {
        self.0.iter().find(|made| made.key == key)
    }
}

impl Reader<'_, '_, '_> {
    /// Adds the joint's drive to its bus if it is a node: its messages, or none where DBC files
    /// describe them; nothing if there is a problem with it.
    pub(super) fn add_node(
        &self,
        name: &str,
        bus: usize,
        (drive, limits): (&Drive, Option<&Limits>),
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<Option<Messages>> {
        let section = self.section;
        let (range, allowed) = match &drive.node {
            None => {
                if section.has("node") {
                    let what = "its drive is no node: DBC files describe its frames";
                    section.problem("node", what, "no such key, or a profile of the drive");
                }
                return Some(None);
            }
            Some(Node::Canopen(_)) => (1..127, "1 to 126, the drive's node id".to_owned()),
            Some(Node::Actuator(kind)) => {
                let nodes = translation::named(kind.family)?.nodes();
                let (first, last) = (u64::from(*nodes.start()), u64::from(*nodes.end()));
                let allowed = format!("{first} to {last}, the actuator's id");
                (first..last + 1, allowed)
            }
        };
        wiring.expect_nodes(bus);
        let node = section.optional_integer("node", range);
        if !section.has("node") {
            let what = "the key is missing, and its drive has a profile";
            section.problem("node", what, allowed);
        }
        let (bus, node) = (bus as u8, node? as u8);
        match &drive.node {
            Some(Node::Canopen(canopen)) => {
                let at = (bus, node);
                self.add_canopen(name, at, canopen, (drive, limits), wiring)
            }
            Some(Node::Actuator(kind)) => self.add_actuator(name, bus, node, kind, drive, wiring),
            None => None,
        }
        .map(Some)
    }

    fn add_canopen(
        &self,
        name: &str,
        (bus, node): (u8, u8),
        canopen: &CanopenDrive,
        (drive, limits): (&Drive, Option<&Limits>),
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<Messages> {
        let section = self.section;
        let made = cia402::Drive {
            kind: &canopen.kind,
            name,
            bus,
            node,
            period: self.timing.sample_period,
            position_count: self.position_count(canopen, drive)?,
            asked: limits.map(|limits| self.asked(limits, canopen, drive)),
        };
        if let Some(dictionary) = &canopen.dictionary
            && let Err(problems) = made.check(dictionary)
        {
            let place = &canopen.eds_place;
            let problems = problems.0.into_iter();
            problems.for_each(|p| section.note(p.of(place)));
            return None;
        }
        if let Err(problem) = wiring.add_node(&made) {
            section.problem("node", problem.reason, problem.allowed);
            return None;
        }
        let sheet = NodeSheet::Canopen(sheet(&canopen.kind));
        wiring.note_sheet(self.index, (bus, node), sheet);
        // A drive that counts its position at the motor counts its current the same way round.
        let current = match canopen.kind.side {
            Side::Motor => self.written("motor_angle", JointKind::Revolute).0,
            Side::Link => 1.0,
        };
        let set_point = match (canopen.kind.mode, canopen.kind.side) {
            (Mode::Torque, _) => self.written_or("current", JointKind::Revolute, current),
            (Mode::Position, Side::Link) => self.written("link_angle", self.section.kind),
            (Mode::Position, Side::Motor) => self.set_point_at_motor(drive),
        };
        Some(self.made(|key| made.path(key), set_point, current))
    }

    fn add_actuator(
        &self,
        name: &str,
        bus: u8,
        node: u8,
        kind: &ActuatorKind,
        drive: &Drive,
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<Messages> {
        let section = self.section;
        let reply = section.optional_integer("reply_id", 0..2048);
        let usual = translation::named(kind.family)?.usual_reply(node);
        let actuator = Actuator {
            family: kind.family,
            model: kind.model,
            at: Address {
                bus,
                node,
                master: reply.map_or(usual, |id| id as u16),
            },
            name: name.to_owned(),
            kp: kind.kp,
            kd: kind.kd,
            gear_ratio: drive.gear_ratio,
            torque_per_current: drive.torque_per_current,
        };
        // An actuator has one direction for all of its signals.
        let (direction, _) = self.written("motor_angle", JointKind::Revolute);
        let set_point = self.set_point_at_motor(drive);
        let messages = self.made(|key| actuator.path(key), set_point, direction);
        let model = kind.model;
        let sheet = NodeSheet::Actuator(ActuatorSheet {
            family: kind.family,
            reply: actuator.at.master,
            ranges: [model.position, model.velocity, model.torque],
            gains: [kind.kp, kind.kd],
            period: match drive.sampling.sampled {
                Sampled::AtSync => self.timing.sample_period,
                Sampled::WhenSent { period } => period,
            },
        });
        if let Err(problem) = wiring.add_actuator(actuator) {
            section.problem("node", problem.reason, problem.allowed);
            return None;
        }
        wiring.note_sheet(self.index, (bus, node), sheet);
        Some(messages)
    }

    /// Direction and offset of a set-point of the motor's side, in the joint's angle.
    fn set_point_at_motor(&self, drive: &Drive) -> (f64, f64) {
        let (sign, offset) = self.written("motor_angle", JointKind::Revolute);
        (sign, offset / drive.gear_ratio)
    }

    /// What the joint's limits ask of its drive, in the counts of 6064.
    fn asked(&self, limits: &Limits, canopen: &CanopenDrive, drive: &Drive) -> Asked {
        let at_link = canopen.kind.side == Side::Link;
        // Of the joint's unit for one count.
        let count = if at_link {
            match self.section.kind {
                JointKind::Revolute => drive.link_counts.map(|counts| TAU / counts),
                JointKind::Prismatic => drive.link_counts.map(|counts| 1e-3 / counts),
            }
        } else {
            (drive.motor_counts_per_turn).map(|counts| TAU / counts / drive.gear_ratio)
        };
        let count = count.unwrap_or(f64::NAN);
        let (sign, offset) = if at_link {
            self.written("link_angle", self.section.kind)
        } else {
            self.set_point_at_motor(drive)
        };
        let counts = |position: f64| sign * (position - offset) / count;
        let ends = [limits.position_min, limits.position_max].map(counts);
        let bounded = ends.iter().all(|end| end.is_finite());
        Asked {
            torque: limits.torque,
            current: limits.torque / drive.torque_per_current.abs(),
            positions: bounded.then(|| [ends[0].min(ends[1]), ends[0].max(ends[1])]),
            lead: limits.lead / count,
        }
    }

    /// Unit of a set-point in 607A, and what one count is in it.
    fn position_count(&self, canopen: &CanopenDrive, drive: &Drive) -> Option<(&'static str, f64)> {
        if canopen.kind.side == Side::Link || canopen.kind.mode == Mode::Torque {
            return Some(("count", 1.0));
        }
        let Some(counts) = drive.motor_counts_per_turn else {
            let what = "its drive counts positions at the motor (drive.canopen.position)";
            let allowed = "motor_counts_per_turn in [drive.NAME]";
            self.section.problem("drive", what, allowed);
            return None;
        };
        let unit = match self.section.kind {
            JointKind::Revolute => "rad",
            JointKind::Prismatic => "m",
        };
        Some((unit, TAU / counts / drive.gear_ratio))
    }

    /// The signals of a profile; `set_point`: direction and offset of the command, `current`: direction of the current
    /// unless the joint's table has another.
    fn made(
        &self,
        path: impl Fn(&str) -> Option<String>,
        set_point: (f64, f64),
        current: f64,
    ) -> Messages {
        let keys = [
            signals::MOTOR_ANGLE,
            signals::LINK_ANGLE,
            signals::CURRENT,
            signals::VELOCITY,
            signals::STATUS,
            signals::CONTROL,
            signals::SET_POINT,
            signals::TEMPERATURE,
            signals::VOLTAGE,
            signals::TORQUE,
            signals::ERROR,
        ];
        let made = keys.into_iter().filter_map(|key| {
            let (sign, offset) = match key {
                signals::SET_POINT => set_point,
                signals::CURRENT => (current, 0.0),
                signals::VELOCITY | signals::TORQUE => {
                    (self.written("motor_angle", JointKind::Revolute).0, 0.0)
                }
                _ => (1.0, 0.0),
            };
            Some(Made {
                key,
                path: path(key)?,
                sign,
                offset,
            })
        });
        Messages(made.collect())
    }

    /// Direction and offset that a signal's table has; what is wrong with it shows where it is read.
    fn written(&self, key: &'static str, kind: JointKind) -> (f64, f64) {
        self.written_or(key, kind, 1.0)
    }

    /// The same, with the direction that holds where none is written.
    fn written_or(&self, key: &'static str, kind: JointKind, direction: f64) -> (f64, f64) {
        let Some(section) = self
            .section
            .optional_section(key)
            .map(|s: Section<'_, '_>| s.of_kind(kind))
        else {
            return (direction, 0.0);
        };
        let sign = section.sign_or("direction", direction);
        let offset = section.number_or("offset_deg", 0.0, Allowed::Finite);
        (sign, section.kind.si(offset))
    }
}

/// The data sheet of a kind of CANopen drive.
fn sheet(kind: &Kind) -> CanopenSheet {
    let place = |object: Object| (object.index, object.sub);
    let temperature = kind.reported.temperature;
    CanopenSheet {
        position_at_link: kind.side == Side::Link,
        other_angle: kind.other_angle.map(place),
        velocity_rpm_per_count: kind.velocity_unit,
        rated_current: kind.rated_current,
        current_per_torque: kind.current_per_torque,
        rated_torque: kind.rated_torque,
        temperature: temperature.map(|(mapped, count)| (place(mapped.object), mapped.bits, count)),
        vendor: kind.vendor,
        product: kind.product,
        objects: (kind.sdo.iter())
            .map(|(object, value)| (place(*object), value.len()))
            .collect(),
    }
}
