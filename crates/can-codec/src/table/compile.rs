//! From DBC files and the signals in use to a table, with every problem that is found on the way.

use super::{
    BusDbc, BusIndex, Compiled, Entry, Layout, SignalMap, Table, TableError, TableProblem,
};
use crate::dbc::{Message, show_id};
use crate::frame::EXTENDED_ID;
use problem::{Problem, listed};

/// The messages of all buses, and the problems found so far.
pub(super) struct Compiler<'a> {
    pub(super) messages: Vec<(BusDbc<'a>, &'a Message)>,
    pub(super) problems: Vec<TableProblem>,
}

impl<'a> Compiler<'a> {
    pub(super) fn collect(&mut self, dbcs: &[BusDbc<'a>]) {
        for &on_bus in dbcs {
            for message in &on_bus.dbc.messages {
                if message.fd && !on_bus.fd {
                    self.problem_of_message(
                        on_bus,
                        message,
                        format!("message {} is a CAN FD frame on a classic bus", message.name),
                        "messages of at most 8 bytes without a CAN FD format, or fd = true for the bus",
                    );
                }
                let other = self.messages.iter().find(|(other_bus, other)| {
                    other_bus.bus == on_bus.bus && other.id == message.id
                });
                if let Some((other_bus, other)) = other {
                    let reason = format!(
                        "message {} has CAN id {} like message {} of {}:{} on the same bus",
                        message.name,
                        show_id(message.id),
                        other.name,
                        other_bus.dbc.file,
                        other.line
                    );
                    self.problem_of_message(
                        on_bus,
                        message,
                        reason,
                        "one message for each id of a bus",
                    );
                }
                self.messages.push((on_bus, message));
            }
        }
        if self.messages.len() >= usize::from(u16::MAX) {
            let reason = format!("the DBC files hold {} messages", self.messages.len());
            self.problems.push(TableProblem {
                map: None,
                problem: Problem::new(reason, "at most 65534"),
            });
        }
    }

    fn problem_of_message(
        &mut self,
        on_bus: BusDbc<'_>,
        message: &Message,
        reason: String,
        allowed: &str,
    ) {
        let problem = Problem::new(reason, allowed).at(&on_bus.dbc.file, message.line);
        self.problems.push(TableProblem { map: None, problem });
    }

    /// Each map's message, as an index into `messages`, with its compiled signal.
    pub(super) fn resolve(&mut self, maps: &[(u8, SignalMap)]) -> Vec<(usize, Compiled)> {
        let mut resolved = Vec::with_capacity(maps.len());
        for (i, (bus, map)) in maps.iter().enumerate() {
            let problem = match self.resolve_one(*bus, map) {
                Err(problem) => Some(problem),
                Ok(signal) => {
                    resolved.push(signal);
                    mapped_before(&maps[..i], *bus, map)
                }
            };
            let map = Some(i);
            let problem = problem.map(|problem| TableProblem { map, problem });
            self.problems.extend(problem);
        }
        resolved
    }

    fn resolve_one(&self, bus: u8, map: &SignalMap) -> Result<(usize, Compiled), Problem> {
        let on_this_bus = || self.messages.iter().filter(|(on_bus, _)| on_bus.bus == bus);
        let path = format!("{}.{}", map.message, map.signal);
        let found = self
            .messages
            .iter()
            .position(|(on_bus, message)| on_bus.bus == bus && message.name == map.message);
        let Some(index) = found else {
            return Err(Problem::new(
                format!("no DBC file of the bus has a message {}", map.message),
                listed(on_this_bus().map(|(_, message)| message.name.as_str())),
            ));
        };
        let message = self.messages[index].1;
        let Some(signal) = message.signal(&map.signal) else {
            return Err(Problem::new(
                format!("message {} has no signal {}", map.message, map.signal),
                listed(message.signals.iter().map(|signal| signal.name.as_str())),
            ));
        };
        if signal.multiplexed {
            return Err(Problem::new(
                format!("signal {path} is multiplexed"),
                "signals that are in every frame of their message",
            ));
        }
        let scale = signal.scale * map.scale;
        let offset = signal.offset * map.scale + map.offset;
        if !(scale.is_normal() && offset.is_finite()) {
            return Err(Problem::new(
                format!("signal {path} would be scaled by {scale} and shifted by {offset}"),
                "finite numbers, a scale other than 0",
            ));
        }
        if map.wraps && !signal.coding.is_integer() {
            return Err(Problem::new(
                format!("signal {path} is a float and cannot wrap"),
                "integer signals",
            ));
        }
        let ends = [signal.min, signal.max].map(|value| (value - signal.offset) / signal.scale);
        let ends = if signal.coding.is_integer() {
            ends.map(f64::round_ties_even)
        } else {
            ends
        };
        let compiled = Compiled {
            slot: map.slot,
            packing: signal.packing,
            scale,
            offset,
            raw_min: ends[0].min(ends[1]),
            raw_max: ends[0].max(ends[1]),
            wraps: map.wraps,
        };
        Ok((index, compiled))
    }

    pub(super) fn finish(self, mut resolved: Vec<(usize, Compiled)>) -> Result<Table, TableError> {
        if !self.problems.is_empty() {
            return Err(TableError(self.problems));
        }
        resolved.sort_by_key(|&(message, signal)| (message, signal.slot));
        let carries = |message: usize| resolved.iter().any(|&(owner, _)| owner == message);
        let (mut order, known): (Vec<_>, Vec<_>) =
            (0..self.messages.len()).partition(|&message| carries(message));
        let mapped = order.len();
        order.extend(known);

        let mut table = Table {
            entries: Vec::with_capacity(order.len()),
            layouts: Vec::with_capacity(order.len()),
            mapped,
            signals: Vec::with_capacity(resolved.len()),
            buses: Vec::new(),
            slots: resolved
                .iter()
                .map(|(_, signal)| signal.slot + 1)
                .max()
                .unwrap_or(0),
        };
        for message in order {
            let (on_bus, described) = self.messages[message];
            let start = table.signals.len();
            let own = resolved.iter().filter(|&&(owner, _)| owner == message);
            table.signals.extend(own.map(|&(_, signal)| signal));
            table.index(on_bus.bus, described.id);
            table.layouts.push(Layout {
                len: described.len,
                signals: start as u32..table.signals.len() as u32,
            });
            table.entries.push(Entry {
                bus: on_bus.bus,
                id: described.id,
                len: described.len,
                fd: described.fd,
                name: described.name.clone(),
                start: described.at_start(on_bus.bus),
            });
        }
        Ok(table)
    }
}

impl Table {
    /// Makes the next entry findable.
    fn index(&mut self, bus: u8, id: u32) {
        let bus = usize::from(bus);
        if self.buses.len() <= bus {
            self.buses.resize_with(bus + 1, BusIndex::default);
        }
        let index = self.entries.len() as u16;
        let BusIndex { standard, extended } = &mut self.buses[bus];
        if id & EXTENDED_ID == 0 {
            standard.insert(id as u16, index);
        } else {
            let id = id & !EXTENDED_ID;
            let at = extended.partition_point(|&(other, _)| other < id);
            extended.insert(at, (id, index));
        }
    }
}

fn mapped_before(before: &[(u8, SignalMap)], bus: u8, map: &SignalMap) -> Option<Problem> {
    let twice = before.iter().any(|(other_bus, other)| {
        *other_bus == bus && other.message == map.message && other.signal == map.signal
    });
    if twice {
        return Some(Problem::new(
            format!("signal {}.{} is used twice", map.message, map.signal),
            "one use of each signal",
        ));
    }
    before
        .iter()
        .find(|(_, other)| other.slot == map.slot)
        .map(|(_, other)| {
            Problem::new(
                format!(
                    "signals {}.{} and {}.{} fill one slot",
                    other.message, other.signal, map.message, map.signal
                ),
                "one signal for each slot",
            )
        })
}
