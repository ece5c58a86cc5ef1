//! Signals of the buses and their uses.

mod sent;

use crate::general::{self, Bus};
use crate::reader::{At, Diagnostics, Section};
use crate::units::Quantity;
use crate::{Mount, MountedDrive, NodeSheet, Nodes, Read, paths, slots, unreadable};
use can_codec::{
    BusDbc, Dbc, Frame, MAX_FRAMES, Signal, SignalMap, Table, TableError, TableProblem,
};
use drives_of_makers::canopen::SYNC_ID;
use drives_of_makers::canopen::bring_up::Plan;
use drives_of_makers::cia402;
use drives_of_makers::family::translation::{self, Actuator};
use problem::{Problem, listed};
use std::collections::BTreeMap;

/// Direction of a signal, seen from the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    Receive,
    Send,
}

/// A use of a signal: `slot = sign * signal in SI + offset`.
pub(crate) struct Use {
    pub(crate) way: Way,
    pub(crate) bus: usize,
    pub(crate) slot: usize,
    pub(crate) quantity: Quantity,
    pub(crate) sign: f64,
    pub(crate) offset: f64,
}

/// Resolution and range of a signal, in SI units of its slot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reach {
    /// One count; 0 for floats.
    pub(crate) resolution: f64,
    /// Range after which the signal starts again; infinite for floats.
    pub(crate) wrap: f64,
    /// Least and greatest value.
    pub(crate) ends: [f64; 2],
}

/// The DBC files of every bus, and the signals that are used.
pub(crate) struct Wiring<'n, 't> {
    diagnostics: &'n Diagnostics<'t>,
    buses: &'n [Bus],
    /// The files of each bus; nothing where a file has a problem.
    dbcs: Vec<Option<Vec<Dbc>>>,
    receive: Vec<(u8, SignalMap)>,
    send: Vec<(u8, SignalMap)>,
    /// The key that uses each signal of a bus, and the place of that key.
    used: BTreeMap<(usize, String), (String, usize)>,
    nodes: Nodes,
    /// Buses with a drive that is a node.
    of_nodes: Vec<bool>,
    /// How each received quantity counts.
    mounts: BTreeMap<usize, Mount>,
}

impl<'n, 't> Wiring<'n, 't> {
    pub(crate) fn read(
        diagnostics: &'n Diagnostics<'t>,
        root: &Section<'_, '_>,
        buses: &'n [Bus],
        read: Read<'_>,
    ) -> Self {
        let read_bus = |bus: &Bus| {
            let dbcs = bus.parameters.dbc_paths.iter().zip(&bus.dbc_places);
            dbcs.map(|(path, &place)| {
                let text = read(path).map_err(|error| {
                    let Problem {
                        file,
                        reason,
                        allowed,
                        ..
                    } = unreadable(path, &error);
                    let reason = format!("{}: {file} {reason}", root.path("bus.dbc"));
                    diagnostics.at(place, reason, allowed);
                });
                Dbc::parse(&text.ok()?, &paths::shown(path))
                    .map_err(|error| error.0.into_iter().for_each(|p| diagnostics.note(p)))
                    .ok()
            })
            .collect()
        };
        let mut dbcs: Vec<Option<Vec<Dbc>>> = buses.iter().map(read_bus).collect();
        for (bus, of_bus) in buses.iter().zip(&mut dbcs) {
            if let Some(of_bus) = of_bus {
                sent::set_constants(diagnostics, bus, of_bus);
            }
        }
        Self {
            diagnostics,
            buses,
            dbcs,
            receive: Vec::new(),
            send: Vec::new(),
            used: BTreeMap::new(),
            nodes: Nodes::default(),
            of_nodes: vec![false; buses.len()],
            mounts: BTreeMap::new(),
        }
    }

    /// Adds a CANopen drive: its messages, and its set-up.
    pub(crate) fn add_node(&mut self, drive: &cia402::Drive<'_>) -> Result<(), Problem> {
        let (plan, messages) = (drive.plan()?, drive.messages()?);
        let same = |other: &&Plan| (other.bus, other.node) == (plan.bus, plan.node);
        if let Some(other) = self.nodes.plans.iter().find(same) {
            let what = format!("node {} is that of {} on this bus", plan.node, other.name);
            return Err(Problem::new(what, "each node of a bus once"));
        }
        if let Some(Some(dbcs)) = self.dbcs.get_mut(usize::from(drive.bus)) {
            dbcs.push(messages);
        }
        let limit = f64::from(drive.kind.heartbeat_ms) * 1e-3;
        self.nodes.heartbeat = if self.nodes.plans.is_empty() {
            limit
        } else {
            self.nodes.heartbeat.min(limit)
        };
        self.nodes.plans.push(plan);
        Ok(())
    }

    /// Adds an actuator: its messages, as the loop sees them.
    pub(crate) fn add_actuator(&mut self, actuator: Actuator) -> Result<(), Problem> {
        let at = (actuator.at.bus, actuator.at.node);
        let same = |other: &&Actuator| (other.at.bus, other.at.node) == at;
        if let Some(other) = self.nodes.actuators.iter().find(same) {
            let what = format!("node {} is that of {} on this bus", at.1, other.name);
            return Err(Problem::new(what, "each actuator of a bus once"));
        }
        let others = (self.nodes.actuators.iter()).filter(|other| other.at.bus == at.0);
        for other in others {
            if let Some(why) = translation::conflict(actuator.family, other.family) {
                let what = format!("{} is on this bus as well: {why}", other.name);
                return Err(Problem::new(
                    what,
                    "drives of these two makers on buses of their own",
                ));
            }
        }
        let needs_fd = translation::named(actuator.family).is_some_and(|family| family.needs_fd());
        let bus = self.buses.get(usize::from(at.0));
        if let Some(bus) = bus.filter(|bus| needs_fd && !bus.parameters.fd) {
            let what = format!(
                "its frames are those of CAN FD, bus {} has none",
                bus.parameters.name
            );
            return Err(Problem::new(what, "a bus with fd = true"));
        }
        if let Some(Some(dbcs)) = self.dbcs.get_mut(usize::from(at.0)) {
            dbcs.push(actuator.messages());
        }
        self.nodes.actuators.push(actuator);
        Ok(())
    }

    /// Notes what a node of that joint is; how it is mounted is known when all signals are read.
    pub(crate) fn note_sheet(&mut self, joint: usize, at: (u8, u8), sheet: NodeSheet) {
        let [motor, link, current] = [Mount::default(); 3];
        self.nodes.mounted.push(MountedDrive {
            joint,
            bus: at.0,
            node: at.1,
            sheet,
            motor,
            link,
            current,
        });
    }

    /// The drives that were added as nodes.
    pub(crate) fn take_nodes(&mut self) -> Nodes {
        let mut nodes = core::mem::take(&mut self.nodes);
        for drive in &mut nodes.mounted {
            let mount = |slot| self.mounts.get(&slot).copied().unwrap_or_default();
            drive.motor = mount(slots::motor_angle(drive.joint));
            drive.link = mount(slots::link_angle(drive.joint));
            drive.current = mount(slots::current(drive.joint));
        }
        nodes
    }

    /// The bus that the section names.
    pub(crate) fn bus(&self, section: &Section<'_, '_>) -> Option<usize> {
        let names = self.buses.iter().map(|bus| bus.parameters.name.as_str());
        let allowed = names.collect::<Vec<_>>().join(", ");
        let name = section.text("bus", &allowed)?.value;
        let bus = self
            .buses
            .iter()
            .position(|bus| bus.parameters.name == name);
        if bus.is_none() {
            section.problem("bus", format!("there is no [[bus]] {name:?}"), allowed);
        }
        bus
    }

    /// Maps a signal, given as `MESSAGE.signal`, to its slot; nothing if there is a problem with it.
    pub(crate) fn connect(&mut self, key: &str, path: &At<&str>, how: &Use) -> Option<Reach> {
        let diagnostics = self.diagnostics;
        let reject = |problem: Problem| diagnostics.note_at(path.place, problem.of(key));
        let Some((message, name)) = path.value.split_once('.') else {
            let what = format!("{:?} is not allowed", path.value);
            reject(Problem::new(what, "MESSAGE.signal"));
            return None;
        };
        let dbcs = self.dbcs.get(how.bus)?.as_ref()?;
        let signal = find(dbcs, message, name).map_err(reject).ok()?;
        let factor = how.quantity.si_per(&signal.unit);
        let factor = factor
            .map_err(|problem| reject(problem.of(format!("signal {}", path.value))))
            .ok()?;
        let place = (key.to_owned(), path.place);
        let used_by = self.used.insert((how.bus, path.value.to_owned()), place);
        if let Some((other, _)) = used_by {
            let what = format!("signal {} is used by {other} already", path.value);
            reject(Problem::new(what, "one use of each signal"));
            return None;
        }
        if !how.offset.is_finite() {
            return None;
        }
        let resolution = (signal.scale * factor).abs();
        let counts = signal.coding.is_integer();
        if let Some(problem) = how.quantity.too_coarse(signal, resolution) {
            reject(problem);
            return None;
        }
        let signal_ends = [signal.min, signal.max];
        let wraps = counts && how.quantity.is_position();
        let map = SignalMap {
            slot: how.slot,
            message: message.to_owned(),
            signal: name.to_owned(),
            scale: how.sign * factor,
            offset: how.offset,
            // Commands are limited, never wrapped.
            wraps: wraps && how.way == Way::Receive,
        };
        let reach = Reach {
            resolution: if counts { resolution } else { 0.0 },
            wrap: if wraps {
                (signal.max - signal.min) * factor + resolution
            } else {
                f64::INFINITY
            },
            ends: ends(&signal_ends, how, factor),
        };
        let mount = Mount {
            direction: how.sign,
            offset: how.offset,
        };
        let maps = match how.way {
            Way::Receive => {
                self.mounts.insert(how.slot, mount);
                &mut self.receive
            }
            Way::Send => &mut self.send,
        };
        maps.push((how.bus as u8, map));
        Some(reach)
    }

    /// Maps three signals, for the axes x y z, to their slots.
    pub(crate) fn connect_axes(
        &mut self,
        section: &Section<'_, '_>,
        key: &'static str,
        how: impl Fn(usize) -> Use,
    ) -> [Option<Reach>; 3] {
        const ALLOWED: &str = "three signals MESSAGE.signal, for x, y and z";
        let path = section.path(key);
        let axes = section.text_array::<3>(key, ALLOWED).into_iter().flatten();
        let mut reaches = [None; 3];
        for ((axis, signal), reach) in axes.enumerate().zip(&mut reaches) {
            let path = format!("{path}[{axis}]");
            *reach = self.connect(&path, &signal, &how(axis));
        }
        reaches
    }

    /// A drive of the bus is a node, or was meant to be one.
    pub(crate) fn expect_nodes(&mut self, bus: usize) {
        if let Some(of_nodes) = self.of_nodes.get_mut(bus) {
            *of_nodes = true;
        }
    }

    /// Notes keys that only a bus of nodes may lack.
    fn need_keys(&self) {
        let buses = self.buses.iter().zip(&self.of_nodes);
        for (bus, _) in buses.filter(|(_, of_nodes)| !**of_nodes) {
            let absent = [
                ("dbc", !bus.has_dbc, general::DBC),
                ("sync", !bus.has_sync, general::SYNC),
            ];
            for (key, _, allowed) in absent.into_iter().filter(|(_, absent, _)| *absent) {
                let what = format!("bus.{key} ({}): the key is missing", bus.parameters.name);
                self.diagnostics.at(bus.place, what, allowed);
            }
        }
    }

    /// The tables of both ways and each bus's SYNC frame.
    pub(crate) fn compile(&self) -> Option<(Table, Table, Vec<Frame>)> {
        self.need_keys();
        let mut dbcs = Vec::new();
        let mut sync = Vec::new();
        for (i, (bus, of_bus)) in self.buses.iter().zip(&self.dbcs).enumerate() {
            let of_bus = of_bus.as_ref()?;
            dbcs.extend(of_bus.iter().map(|dbc| BusDbc {
                bus: i as u8,
                // What no bus carries is as long as it needs to be.
                fd: bus.parameters.fd || dbc.messages.iter().all(|m| translation::is_own(m.id)),
                dbc,
            }));
            let found = of_bus.iter().find_map(|dbc| dbc.message(&bus.sync));
            match found {
                Some(message) => {
                    let nobody = |_: &Signal| false;
                    sent::check(
                        self.diagnostics,
                        message,
                        bus.sync_place,
                        "bus.sync",
                        nobody,
                    );
                    sync.push(message.at_start(i as u8));
                }
                None if !bus.has_sync => {
                    let canopen = self.nodes.plans.iter().any(|p| usize::from(p.bus) == i);
                    if canopen {
                        sync.push(Frame::zeroed(i as u8, SYNC_ID, 0, false));
                    }
                }
                None => {
                    let what = format!(
                        "bus.sync ({}): no DBC file of the bus has a message {}",
                        bus.parameters.name, bus.sync
                    );
                    self.diagnostics
                        .at(bus.sync_place, what, message_names(of_bus));
                }
            }
            if self
                .nodes
                .actuators
                .iter()
                .any(|a| usize::from(a.at.bus) == i)
            {
                sync.push(translation::ask(i as u8));
            }
        }
        let compile = |maps: &[(u8, SignalMap)]| {
            let table = Table::compile(&dbcs, maps);
            table.map_err(|error| self.note_all(error, maps)).ok()
        };
        let (receive, send) = (compile(&self.receive), compile(&self.send));
        let (receive, send) = (receive?, send?);
        self.separate(&send);
        self.all_is_meant(&send);
        for (table, way) in [(&receive, "received"), (&send, "sent")] {
            // SYNC frames take room too.
            let count = table.message_count() + sync.len();
            if count > MAX_FRAMES {
                let what = format!("bus: {count} frames are {way} in a cycle");
                self.diagnostics
                    .at(0, what, format!("at most {MAX_FRAMES}"));
            }
        }
        Some((receive, send, sync))
    }

    /// Notes signals of sent messages for which nobody says what is sent, at the message's first key,
    /// and constants of signals that a key sets.
    fn all_is_meant(&self, send: &Table) {
        for entry in (0..send.message_count()).filter_map(|index| send.message(index)) {
            let of_message =
                |map: &&(u8, SignalMap)| map.0 == entry.bus && map.1.message == entry.name;
            let maps: Vec<_> = self.send.iter().filter(of_message).collect();
            let (bus, dbcs) = (usize::from(entry.bus), &self.dbcs[usize::from(entry.bus)]);
            let message = dbcs
                .iter()
                .flatten()
                .find_map(|dbc| dbc.message(&entry.name));
            let key = maps.iter().find_map(|(_, map)| {
                let path = format!("{}.{}", map.message, map.signal);
                self.used.get(&(bus, path))
            });
            if let (Some(message), Some((key, place))) = (message, key) {
                let is_mapped = |s: &Signal| maps.iter().any(|(_, map)| map.signal == s.name);
                sent::check(self.diagnostics, message, *place, key, is_mapped);
            }
        }
        for (i, bus) in self.buses.iter().enumerate() {
            for constant in &bus.constants {
                let path = (i, constant.signal.clone());
                if let Some((key, _)) = self.used.get(&path) {
                    let what = format!("bus.constants: {} is set by {key}", constant.signal);
                    let allowed = "signals of sent messages that no key of a joint names";
                    self.diagnostics.at(constant.place, what, allowed);
                }
            }
        }
    }

    /// Notes control words that share a message with set-points. Set-points leave only when their
    /// drives are enabled, and the control words that enable them must leave before.
    fn separate(&self, send: &Table) {
        let is_control = |slot| matches!(slots::sent(slot), slots::Sent::Control(_));
        for index in 0..send.message_count() {
            let of_controls = send.slots(index).filter(|&slot| is_control(slot)).count();
            if of_controls == 0 || of_controls == send.slots(index).count() {
                continue;
            }
            for (bus, map) in self.send.iter().filter(|(_, map)| is_control(map.slot)) {
                let path = format!("{}.{}", map.message, map.signal);
                let entry = send.message(index);
                let its = entry.is_some_and(|e| e.bus == *bus && e.name == map.message);
                if let Some((key, place)) = self.used.get(&(usize::from(*bus), path))
                    && its
                {
                    let what = format!(
                        "message {} carries set-points too, which leave only for enabled drives",
                        map.message
                    );
                    let problem = Problem::new(what, "a message of its own for control words");
                    self.diagnostics.note_at(*place, problem.of(key));
                }
            }
        }
    }

    /// Notes problems of signals at the keys that name them.
    fn note_all(&self, error: TableError, maps: &[(u8, SignalMap)]) {
        for TableProblem { map, problem } in error.0 {
            let map = map.and_then(|map| maps.get(map));
            let used = map.and_then(|(bus, map)| {
                let path = format!("{}.{}", map.message, map.signal);
                self.used.get(&(usize::from(*bus), path))
            });
            match used {
                Some((key, place)) => self.diagnostics.note_at(*place, problem.of(key)),
                None => self.diagnostics.note(problem),
            }
        }
    }
}

/// Least and greatest value of a slot, from those of its signal.
fn ends(signal: &[f64; 2], how: &Use, factor: f64) -> [f64; 2] {
    let [a, b] = signal.map(|end| how.sign * factor * end + how.offset);
    [a.min(b), a.max(b)]
}

pub(crate) fn find<'d>(dbcs: &'d [Dbc], message: &str, name: &str) -> Result<&'d Signal, Problem> {
    let Some(found) = dbcs.iter().find_map(|dbc| dbc.message(message)) else {
        let files = dbcs.iter().map(|dbc| dbc.file.as_str()).collect::<Vec<_>>();
        let what = format!("{} has no message {message}", files.join(", "));
        return Err(Problem::new(what, message_names(dbcs)));
    };
    found.signal(name).ok_or_else(|| {
        let file = dbcs.iter().find(|dbc| dbc.message(message).is_some());
        let file = file.map_or("", |dbc| dbc.file.as_str());
        let names = found.signals.iter().map(|signal| signal.name.as_str());
        Problem::new(
            format!(
                "message {message} of {file}:{} has no signal {name}",
                found.line
            ),
            listed(names),
        )
    })
}

fn message_names(dbcs: &[Dbc]) -> String {
    let messages = dbcs.iter().flat_map(|dbc| &dbc.messages);
    listed(messages.map(|message| message.name.as_str()))
}
