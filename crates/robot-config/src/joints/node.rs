//! A joint's drive as a node of its bus, whose messages no DBC file describes.

use super::Reader;
use crate::drives::{CanopenDrive, Drive};
use crate::reader::{Allowed, Section};
use crate::wiring::Wiring;
use core::f64::consts::TAU;
use drives_of_makers::cia402::{self, Mode, Side, signals};
use robot_state::JointKind;

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
        drive: &Drive,
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<Option<Messages>> {
        const ALLOWED: &str = "1 to 126, the drive's node id";
        let section = self.section;
        let node = section.optional_integer("node", 1..127);
        let Some(canopen) = &drive.canopen else {
            if node.is_some() {
                let what = "its drive is no node: DBC files describe its frames";
                section.problem(
                    "node",
                    what,
                    "no such key, or profile = \"cia402\" of the drive",
                );
            }
            return Some(None);
        };
        wiring.expect_nodes(bus);
        let Some(node) = node else {
            let what = "the key is missing, and its drive has profile = \"cia402\"";
            section.problem("node", what, ALLOWED);
            return None;
        };
        let made = cia402::Drive {
            kind: &canopen.kind,
            name,
            bus: bus as u8,
            node: node as u8,
            period: self.timing.sample_period,
            position_count: self.position_count(canopen, drive)?,
        };
        if let Some(dictionary) = &canopen.dictionary
            && let Err(problems) = made.check(dictionary)
        {
            let place = &canopen.eds_place;
            problems
                .0
                .into_iter()
                .for_each(|p| section.note(p.of(place)));
            return None;
        }
        if let Err(problem) = wiring.add_node(&made) {
            section.problem("node", problem.reason, problem.allowed);
            return None;
        }
        Some(Some(self.made(&made, canopen, drive)))
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

    fn made(&self, node: &cia402::Drive<'_>, canopen: &CanopenDrive, drive: &Drive) -> Messages {
        let set_point = match (canopen.kind.mode, canopen.kind.side) {
            (Mode::Torque, _) => self.written("current", JointKind::Revolute),
            (Mode::Position, Side::Link) => self.written("link_angle", self.section.kind),
            (Mode::Position, Side::Motor) => {
                let (sign, offset) = self.written("motor_angle", JointKind::Revolute);
                (sign, offset / drive.gear_ratio)
            }
        };
        let keys = [
            signals::MOTOR_ANGLE,
            signals::LINK_ANGLE,
            signals::CURRENT,
            signals::VELOCITY,
            signals::STATUS,
            signals::CONTROL,
            signals::SET_POINT,
        ];
        let made = keys.into_iter().filter_map(|key| {
            let (sign, offset) = match key {
                signals::SET_POINT => set_point,
                signals::VELOCITY => (self.written("motor_angle", JointKind::Revolute).0, 0.0),
                _ => (1.0, 0.0),
            };
            Some(Made {
                key,
                path: node.path(key)?,
                sign,
                offset,
            })
        });
        Messages(made.collect())
    }

    /// Direction and offset that a signal's table has; what is wrong with it shows where it is read.
    fn written(&self, key: &'static str, kind: JointKind) -> (f64, f64) {
        let Some(section) = self
            .section
            .optional_section(key)
            .map(|s: Section<'_, '_>| s.of_kind(kind))
        else {
            return (1.0, 0.0);
        };
        let sign = section.sign_or("direction", 1.0);
        let offset = section.number_or("offset_deg", 0.0, Allowed::Finite);
        (sign, section.kind.si(offset))
    }
}
