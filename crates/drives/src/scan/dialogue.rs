//! Reading what a node of CANopen says of itself, object by object.

use super::Found;
use crate::canopen::sdo::{Progress, Request, SdoError, Transfer};
use crate::canopen::{Object, emcy};
use crate::cia402;
use can_codec::Frame;

/// Longest wait for an answer, ns.
const ANSWER_NS: u64 = 300_000_000;

/// How a value is shown.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    Hex,
    Signed,
    Unsigned,
    Text,
}

/// Objects that are read, the first whether the node is there.
const OBJECTS: [(Object, &str, Shape); 18] = [
    (Object::new(0x1000, 0), "device_type", Shape::Hex),
    (Object::new(0x1018, 1), "vendor", Shape::Hex),
    (Object::new(0x1018, 2), "product", Shape::Hex),
    (Object::new(0x1018, 3), "revision", Shape::Hex),
    (Object::new(0x1018, 4), "serial", Shape::Hex),
    (Object::new(0x1008, 0), "name", Shape::Text),
    (Object::new(0x100A, 0), "firmware", Shape::Text),
    (Object::new(0x1001, 0), "error_register", Shape::Hex),
    (Object::new(0x1016, 1), "heartbeat_expected", Shape::Hex),
    (Object::new(0x6041, 0), "status_word", Shape::Hex),
    (Object::new(0x603F, 0), "error_code", Shape::Hex),
    (Object::new(0x6061, 0), "mode", Shape::Signed),
    (Object::new(0x6064, 0), "position_count", Shape::Signed),
    (Object::new(0x6075, 0), "rated_current_mA", Shape::Unsigned),
    (Object::new(0x6076, 0), "rated_torque_mNm", Shape::Unsigned),
    (
        Object::new(0x6072, 0),
        "max_torque_per_mille",
        Shape::Unsigned,
    ),
    (
        Object::new(0x6073, 0),
        "max_current_per_mille",
        Shape::Unsigned,
    ),
    (Object::new(0x6079, 0), "voltage_mV", Shape::Unsigned),
];

/// A dialogue with one node.
pub(super) struct Dialogue {
    found: Found,
    at: usize,
    transfer: Transfer,
    until: u64,
    /// The object was asked for once more.
    again: bool,
    is_there: bool,
    over: bool,
}

impl Dialogue {
    pub(super) fn begin(bus: u8, node: u8, now: u64, out: &mut Vec<Frame>) -> Self {
        let (transfer, first) = Transfer::start(bus, node, Request::Read(OBJECTS[0].0));
        out.push(first);
        Self {
            found: Found {
                bus,
                node,
                family: "canopen",
                ..Found::default()
            },
            at: 0,
            transfer,
            until: now + ANSWER_NS,
            again: false,
            is_there: false,
            over: false,
        }
    }

    pub(super) fn is_over(&self) -> bool {
        self.over
    }

    /// What it has found; none: nobody answered.
    pub(super) fn found(mut self) -> Option<Found> {
        // The error code is that of the last error, whether it is over or not.
        let faults = ["fault", "fault reaction active"];
        if (self.found.state).is_some_and(|state| !faults.contains(&state)) {
            self.found.error = None;
        }
        self.is_there.then_some(self.found)
    }

    pub(super) fn poll(&mut self, now: u64, out: &mut Vec<Frame>) {
        if self.over || now < self.until {
            return;
        }
        out.extend(self.is_there.then(|| self.transfer.give_up()));
        if self.again || !self.is_there {
            self.next(now, out);
        } else {
            self.again = true;
            self.ask(now, out);
        }
    }

    pub(super) fn receive(&mut self, frame: &Frame, now: u64, out: &mut Vec<Frame>) {
        if self.over {
            return;
        }
        match self.transfer.receive(frame) {
            Progress::NotMine => {}
            Progress::Send(next) => {
                self.until = now + ANSWER_NS;
                out.push(next);
            }
            Progress::Done(result, told) => {
                out.extend(told);
                self.is_there |= matches!(result, Ok(_) | Err(SdoError::Abort(_)));
                if let Ok(value) = result {
                    self.note(&value);
                }
                self.next(now, out);
            }
        }
    }

    fn ask(&mut self, now: u64, out: &mut Vec<Frame>) {
        let Some((object, ..)) = OBJECTS.get(self.at) else {
            self.over = true;
            return;
        };
        let (bus, node) = (self.found.bus, self.found.node);
        let (transfer, first) = Transfer::start(bus, node, Request::Read(*object));
        (self.transfer, self.until) = (transfer, now + ANSWER_NS);
        out.push(first);
    }

    fn next(&mut self, now: u64, out: &mut Vec<Frame>) {
        // Who does not answer the first question is not there.
        if !self.is_there {
            self.over = true;
            return;
        }
        (self.at, self.again) = (self.at + 1, false);
        self.ask(now, out);
    }

    fn note(&mut self, value: &[u8]) {
        let (object, name, shape) = OBJECTS[self.at];
        let bytes = value.iter().take(4).rev();
        let number = bytes.fold(0u32, |number, byte| number << 8 | u32::from(*byte));
        let unused = 32 - 8 * value.len().clamp(1, 4) as u32;
        let signed = (number << unused) as i32 >> unused;
        let text = match shape {
            Shape::Hex => format!("{number:#x}"),
            Shape::Signed => signed.to_string(),
            Shape::Unsigned => number.to_string(),
            Shape::Text => {
                let text = String::from_utf8_lossy(value);
                text.trim_matches(['\0', ' ']).escape_debug().to_string()
            }
        };
        match object.index {
            0x1000 if number & 0xFFFF == 402 => self.found.family = "cia402",
            0x6041 => {
                let state = cia402::state_text(number as u16);
                self.found.state = Some(state);
                let on = [
                    "operation enabled",
                    "quick stop active",
                    "fault reaction active",
                ];
                self.found.is_on = Some(on.contains(&state));
            }
            0x603F if number != 0 => {
                let code = number as u16;
                self.found.error = Some(format!("{code:04X}: {}", emcy::text(code)));
            }
            _ => {}
        }
        self.found.facts.push((name, text));
    }
}
