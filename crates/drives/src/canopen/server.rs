//! A node as a drive has it, for simulated robots: it wakes up pre-operational, serves its objects
//! by SDO, insists on the order of a mapping, and notices a master that falls silent.

use super::{EMCY_ID, with_data};
use super::{HEARTBEAT_ID, NMT_ID, NodeState, Object, SDO_ANSWER_ID, SDO_REQUEST_ID, node_of};
use can_codec::Frame;
use std::collections::BTreeMap;

const NO_OBJECT: u32 = super::abort::NO_OBJECT;
const CANNOT: u32 = 0x0601_0000;
const READ_ONLY: u32 = super::abort::READ_ONLY;
const NOT_MAPPABLE: u32 = 0x0604_0041;
const WRONG_LENGTH: u32 = 0x0607_0010;
const WRONG_TOGGLE: u32 = 0x0503_0000;
const UNKNOWN: u32 = 0x0504_0001;

/// An object of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Value {
    /// Little endian.
    pub bytes: Vec<u8>,
    /// It can be written.
    pub writable: bool,
    /// It can be mapped to a PDO.
    pub mappable: bool,
}

#[derive(Clone, Debug)]
enum Transfer {
    Upload {
        rest: Vec<u8>,
        toggle: bool,
    },
    Download {
        object: Object,
        got: Vec<u8>,
        toggle: bool,
    },
}

/// A node.
#[derive(Clone, Debug)]
pub struct Server {
    bus: u8,
    node: u8,
    state: NodeState,
    objects: BTreeMap<Object, Value>,
    at_power_on: BTreeMap<Object, Value>,
    transfer: Option<Transfer>,
    /// Time of its last heartbeat, ns.
    sent: Option<u64>,
    /// Time of the master's last heartbeat, ns.
    heard: Option<u64>,
    lost: bool,
    /// A write to the first is taken over by the second, as a mode by its display.
    mirrored: Vec<(Object, Object)>,
}

impl Server {
    /// A node with these objects, just switched on: its boot-up is the first thing that it sends.
    #[must_use]
    pub fn new(bus: u8, node: u8, objects: BTreeMap<Object, Value>) -> Self {
        Self {
            bus,
            node,
            state: NodeState::BootUp,
            at_power_on: objects.clone(),
            objects,
            transfer: None,
            sent: None,
            heard: None,
            lost: false,
            mirrored: Vec::new(),
        }
    }

    /// What is written to one object shows in another, as a mode in its display.
    pub fn mirror(&mut self, written: Object, shown: Object) {
        self.mirrored.push((written, shown));
    }

    /// No object shows what is written to another.
    pub fn mirror_nothing(&mut self) {
        self.mirrored.clear();
    }

    /// State of its communication.
    #[must_use]
    pub fn state(&self) -> NodeState {
        self.state
    }

    /// The master has fallen silent for longer than object 1016 allows, since it was last heard.
    #[must_use]
    pub fn has_lost_master(&self) -> bool {
        self.lost
    }

    /// An object, as a number.
    #[must_use]
    pub fn number(&self, object: Object) -> Option<u32> {
        let bytes = &self.objects.get(&object)?.bytes;
        let bytes = bytes.iter().take(4).enumerate();
        Some(bytes.fold(0, |sum, (i, byte)| sum | u32::from(*byte) << (8 * i)))
    }

    /// Sets an object from inside.
    pub fn set(&mut self, object: Object, bytes: &[u8]) {
        if let Some(value) = self.objects.get_mut(&object) {
            value.bytes = bytes.to_vec();
        }
    }

    /// The object is a constant from now on, whatever resets the node.
    pub fn fix(&mut self, object: Object, bytes: &[u8]) {
        for objects in [&mut self.objects, &mut self.at_power_on] {
            if let Some(value) = objects.get_mut(&object) {
                value.writable = false;
                value.bytes = bytes.to_vec();
            }
        }
    }

    /// Power off and on.
    pub fn power_cycle(&mut self) {
        self.objects.clone_from(&self.at_power_on);
        self.restart();
    }

    fn restart(&mut self) {
        self.state = NodeState::BootUp;
        self.transfer = None;
        self.heard = None;
        self.lost = false;
    }

    /// Sends what is due: boot-up, heartbeat, the emergency of a silent master.
    pub fn poll(&mut self, now: u64, out: &mut Vec<Frame>) {
        let id = HEARTBEAT_ID + u32::from(self.node);
        if self.state == NodeState::BootUp {
            self.state = NodeState::PreOperational;
            self.sent = Some(now);
            out.push(with_data(self.bus, id, &[0]));
        }
        let ms = |object| u64::from(self.number(object).unwrap_or(0) & 0xFFFF);
        let own = 1_000_000 * ms(Object::new(0x1017, 0));
        let due = self.sent.is_none_or(|sent| now >= sent + own);
        let masters = 1_000_000 * ms(Object::new(0x1016, 1));
        let silent = self.heard.is_some_and(|heard| now > heard + masters);
        if own > 0 && due {
            self.sent = Some(now);
            let byte = match self.state {
                NodeState::Operational => 0x05,
                NodeState::Stopped => 0x04,
                _ => 0x7F,
            };
            out.push(with_data(self.bus, id, &[byte]));
        }
        if masters > 0 && silent && !self.lost {
            self.lost = true;
            let data = [0x30, 0x81, 0x11, 0, 0, 0, 0, 0];
            out.push(with_data(self.bus, EMCY_ID + u32::from(self.node), &data));
        }
    }

    /// Takes a frame of the bus.
    pub fn receive(&mut self, frame: &Frame, now: u64, out: &mut Vec<Frame>) {
        if frame.bus != self.bus || frame.error {
            return;
        }
        if let (NMT_ID, [command, node]) = (frame.id, frame.payload()) {
            if *node == 0 || *node == self.node {
                self.command(*command);
            }
            return;
        }
        if let Some(master) = node_of(frame, HEARTBEAT_ID) {
            let watched = self.number(Object::new(0x1016, 1)).unwrap_or(0) >> 16;
            if watched == u32::from(master) {
                self.heard = Some(now);
                self.lost = false;
            }
            return;
        }
        if node_of(frame, SDO_REQUEST_ID) != Some(self.node) || self.state == NodeState::Stopped {
            return;
        }
        if let Ok(data) = <[u8; 8]>::try_from(frame.payload())
            && let Some(answer) = self.answer(&data)
        {
            out.push(with_data(
                self.bus,
                SDO_ANSWER_ID + u32::from(self.node),
                &answer,
            ));
        }
    }

    fn command(&mut self, command: u8) {
        match command {
            0x01 => self.state = NodeState::Operational,
            0x02 => self.state = NodeState::Stopped,
            0x80 => self.state = NodeState::PreOperational,
            0x81 => self.power_cycle(),
            0x82 => {
                // The communication's objects are as at power-on.
                for (object, value) in &self.at_power_on {
                    if object.index < 0x2000 {
                        self.objects.insert(*object, value.clone());
                    }
                }
                self.restart();
            }
            _ => {}
        }
    }

    fn answer(&mut self, data: &[u8; 8]) -> Option<[u8; 8]> {
        let object = Object::new(u16::from_le_bytes([data[1], data[2]]), data[3]);
        let abort = |code: u32| {
            let [a, b, c, d] = code.to_le_bytes();
            Some([0x80, data[1], data[2], data[3], a, b, c, d])
        };
        let done = Some([0x60, data[1], data[2], data[3], 0, 0, 0, 0]);
        match data[0] >> 5 {
            // Initiate download.
            1 if data[0] & 2 != 0 => {
                let unused = usize::from(data[0] >> 2 & 3);
                match self.write(object, &data[4..8 - unused]) {
                    Ok(()) => done,
                    Err(code) => abort(code),
                }
            }
            1 => {
                let (got, toggle) = (Vec::new(), false);
                self.transfer = Some(Transfer::Download {
                    object,
                    got,
                    toggle,
                });
                done
            }
            // Initiate upload.
            2 => match self.objects.get(&object).map(|value| value.bytes.clone()) {
                None => abort(NO_OBJECT),
                Some(bytes) if (1..=4).contains(&bytes.len()) => {
                    let mut answer = [
                        0x43 | (4 - bytes.len() as u8) << 2,
                        data[1],
                        data[2],
                        data[3],
                        0,
                        0,
                        0,
                        0,
                    ];
                    answer[4..4 + bytes.len()].copy_from_slice(&bytes);
                    Some(answer)
                }
                Some(rest) => {
                    let [a, b, c, d] = (rest.len() as u32).to_le_bytes();
                    self.transfer = Some(Transfer::Upload {
                        rest,
                        toggle: false,
                    });
                    Some([0x41, data[1], data[2], data[3], a, b, c, d])
                }
            },
            0 | 3 => match self.segment(data) {
                Ok(answer) => Some(answer),
                Err(code) => abort(code),
            },
            4 => {
                self.transfer = None;
                None
            }
            _ => abort(UNKNOWN),
        }
    }

    fn segment(&mut self, data: &[u8; 8]) -> Result<[u8; 8], u32> {
        let asked = data[0] & 0x10 != 0;
        match self.transfer.take() {
            Some(Transfer::Upload { rest, toggle }) if data[0] >> 5 == 3 && toggle == asked => {
                let part = rest.len().min(7);
                let last = part == rest.len();
                let mut answer = [0; 8];
                answer[0] = u8::from(toggle) << 4 | (7 - part as u8) << 1 | u8::from(last);
                answer[1..=part].copy_from_slice(&rest[..part]);
                if !last {
                    let rest = rest[part..].to_vec();
                    self.transfer = Some(Transfer::Upload {
                        rest,
                        toggle: !toggle,
                    });
                }
                Ok(answer)
            }
            Some(Transfer::Download {
                object,
                mut got,
                toggle,
            }) if data[0] >> 5 == 0 && toggle == asked => {
                got.extend_from_slice(&data[1..8 - usize::from(data[0] >> 1 & 7)]);
                let toggled = u8::from(toggle) << 4;
                if data[0] & 1 != 0 {
                    self.write(object, &got)?;
                } else {
                    let toggle = !toggle;
                    self.transfer = Some(Transfer::Download {
                        object,
                        got,
                        toggle,
                    });
                }
                Ok([0x20 | toggled, 0, 0, 0, 0, 0, 0, 0])
            }
            _ => Err(WRONG_TOGGLE),
        }
    }

    /// A write from outside, with what nodes insist on.
    fn write(&mut self, object: Object, bytes: &[u8]) -> Result<(), u32> {
        let value = self.objects.get(&object).ok_or(NO_OBJECT)?;
        if !value.writable {
            return Err(READ_ONLY);
        }
        // Text may be of any length.
        if (1..=4).contains(&value.bytes.len()) && value.bytes.len() != bytes.len() {
            return Err(WRONG_LENGTH);
        }
        if matches!(object.index, 0x1600..=0x17FF | 0x1A00..=0x1BFF) {
            self.check_mapping(object, bytes)?;
        }
        if let Some(value) = self.objects.get_mut(&object) {
            value.bytes = bytes.to_vec();
        }
        let shown = self.mirrored.iter().find(|(written, _)| *written == object);
        if let Some((_, shown)) = shown.copied() {
            self.set(shown, bytes);
        }
        Ok(())
    }

    /// A mapping changes only while its PDO is off and has no entries, and names what can be mapped.
    fn check_mapping(&self, object: Object, bytes: &[u8]) -> Result<(), u32> {
        let id = self
            .number(Object::new(object.index - 0x200, 1))
            .ok_or(NO_OBJECT)?;
        if id & 1 << 31 == 0 {
            return Err(CANNOT);
        }
        if object.sub == 0 {
            return Ok(());
        }
        if self.number(Object::new(object.index, 0)) != Some(0) {
            return Err(CANNOT);
        }
        let &[bits, sub, low, high] = bytes else {
            return Err(WRONG_LENGTH);
        };
        let mapped = Object::new(u16::from_le_bytes([low, high]), sub);
        let value = self.objects.get(&mapped).ok_or(NO_OBJECT)?;
        if value.mappable && 8 * value.bytes.len() == usize::from(bits) {
            Ok(())
        } else {
            Err(NOT_MAPPABLE)
        }
    }
}
