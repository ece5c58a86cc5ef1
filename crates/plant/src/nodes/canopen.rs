//! A simulated CANopen drive: network management, heartbeats, emergencies (CiA 301). Written from the standard, apart
//! from the master in `crates/drives`, which shares no line with it.
//!
//! It wakes up pre-operational. Process data are exchanged only in operation. What the drive itself does is in
//! `cia402.rs`.

use super::motor::Motor;
use super::objects::{Key, Objects, abort};
use super::pdo::{self, PDOS, Payload, RECEIVED, SENT};
use super::sdo::{SdoServer, Served};
use super::wire::Wire;
use can_codec::Frame;
use robot_config::CanopenSheet;

/// Errors in emergencies: none any more; process data that are too short; a master that is not heard.
const NONE: u16 = 0x0000;
const SHORT_PDO: u16 = 0x8210;
const LOST_MASTER: u16 = 0x8130;
/// Bits of the error register: something; communication.
const GENERIC: u32 = 0x01;
const COMMUNICATION: u32 = 0x10;

/// State of its communication.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Its boot-up has not left yet.
    Initialising,
    PreOperational,
    Operational,
    Stopped,
}

impl State {
    fn byte(self) -> u8 {
        match self {
            Self::Initialising => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }
}

/// A CANopen drive.
#[derive(Debug, Clone)]
pub(super) struct CanopenDrive {
    pub(super) node: u8,
    pub(super) sheet: CanopenSheet,
    pub(super) state: State,
    pub(super) objects: Objects,
    sdo: SdoServer,
    /// When its own heartbeat was sent last, ns.
    beat: u64,
    /// When the master that it watches was heard last, ns; none: not yet, or it has been lost.
    heard: Option<u64>,
    /// Error of which an emergency has been sent.
    reported: u16,
    syncs: u64,
    /// What came by PDOs that act at the next SYNC.
    at_sync: [Option<Payload>; PDOS as usize],
    /// What was sent last by PDOs that are sent when they change.
    sent: [Option<Payload>; PDOS as usize],
    /// Its supply is on.
    powered: bool,
}

impl CanopenDrive {
    /// A drive that has just got its power.
    pub(super) fn new(node: u8, sheet: &CanopenSheet, motor: &mut Motor<'_>) -> Self {
        let mut drive = Self {
            node,
            sheet: sheet.clone(),
            state: State::Initialising,
            objects: super::cia402::objects(node, sheet, motor),
            sdo: SdoServer::default(),
            beat: 0,
            heard: None,
            reported: NONE,
            syncs: 0,
            at_sync: [None; PDOS as usize],
            sent: [None; PDOS as usize],
            powered: true,
        };
        drive.wake_drive(motor);
        drive
    }

    /// Switches its supply on or off.
    pub(super) fn set_power(&mut self, on: bool, motor: &mut Motor<'_>) {
        if on == self.powered {
            return;
        }
        self.powered = on;
        if let Some(states) = motor.states() {
            states.set_power(on);
            states.control(0);
        }
        if on {
            self.reset(motor);
        }
    }

    /// It starts anew altogether.
    fn reset(&mut self, motor: &mut Motor<'_>) {
        self.objects.restore();
        self.restart();
        self.wake_drive(motor);
    }

    /// Its communication starts anew.
    fn restart(&mut self) {
        self.state = State::Initialising;
        self.sdo = SdoServer::default();
        (self.heard, self.reported) = (None, NONE);
        self.at_sync = [None; PDOS as usize];
        self.sent = [None; PDOS as usize];
    }

    /// What is due by time: boot-up, heartbeat, emergencies, process data that have changed.
    pub(super) fn poll(&mut self, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        if !self.powered {
            return;
        }
        if self.state == State::Initialising {
            self.beat(wire);
            self.state = State::PreOperational;
        }
        self.run_drive(motor);
        let interval = ms(self.objects.unsigned(0x1017, 0));
        if interval > 0 && wire.now >= self.beat + interval {
            self.beat(wire);
        }
        self.watch_master(wire, motor);
        self.report_error(wire, motor);
        if self.state == State::Operational {
            self.send_changes(wire);
        }
    }

    fn beat(&mut self, wire: &mut Wire<'_>) {
        self.beat = wire.now;
        let byte = self.state.byte();
        wire.send(0x700 + u32::from(self.node), &[byte]);
    }

    /// 1016: the master counts as lost once it has been heard and then not for longer than that.
    fn watch_master(&mut self, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        let limit = ms(self.objects.unsigned(0x1016, 1) & 0xFFFF);
        let silent = |heard: &u64| wire.now > heard + limit;
        if limit == 0 || !self.heard.as_ref().is_some_and(silent) {
            return;
        }
        self.heard = None;
        self.emergency(LOST_MASTER, COMMUNICATION, wire);
        self.lose_connection(motor);
        // 1029:01: 0, the value after power-on, takes a node out of operation.
        if self.objects.unsigned(0x1029, 1) == 0 && self.state == State::Operational {
            self.state = State::PreOperational;
        }
    }

    fn report_error(&mut self, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        let error = self.drive_error(motor);
        if error == self.reported {
            return;
        }
        self.reported = error;
        let register = if error == NONE { 0 } else { GENERIC };
        self.emergency(error, register, wire);
    }

    /// Sends an emergency, and notes it in 1001 and 1003.
    fn emergency(&mut self, error: u16, register: u32, wire: &mut Wire<'_>) {
        self.objects.set(0x1001, 0, i64::from(register));
        if error != NONE {
            self.objects.set(0x1003, 0, 1);
            self.objects.set(0x1003, 1, i64::from(error));
        }
        let [low, high] = error.to_le_bytes();
        let data = [low, high, register as u8, 0, 0, 0, 0, 0];
        wire.send(0x080 + u32::from(self.node), &data);
    }

    /// PDOs of type 254 or 255 are sent when their content changes.
    fn send_changes(&mut self, wire: &mut Wire<'_>) {
        for number in 0..PDOS {
            let parameters = SENT + number;
            let by_event = self.objects.unsigned(parameters, 2) >= 254;
            let Some(id) = pdo::id(&self.objects, parameters).filter(|_| by_event) else {
                continue;
            };
            let payload = pdo::pack(&self.objects, parameters);
            let last = &mut self.sent[usize::from(number)];
            if *last != Some(payload) {
                *last = Some(payload);
                wire.send(id, payload.bytes());
            }
        }
    }

    /// SYNC: set-points that waited for it act, and samples are sent.
    pub(super) fn sync(&mut self, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        if !self.powered || self.state != State::Operational {
            return;
        }
        self.run_drive(motor);
        self.syncs = self.syncs.wrapping_add(1);
        for number in 0..PDOS {
            if let Some(payload) = self.at_sync[usize::from(number)].take() {
                self.take_pdo(RECEIVED + number, &payload, wire, motor);
            }
        }
        for number in 0..PDOS {
            let parameters = SENT + number;
            let every = self.objects.unsigned(parameters, 2);
            let due = (1..=240).contains(&every) && self.syncs.is_multiple_of(u64::from(every));
            if let Some(id) = pdo::id(&self.objects, parameters).filter(|_| due) {
                wire.send(id, pdo::pack(&self.objects, parameters).bytes());
            }
        }
    }

    /// Takes a frame of its bus; true if it is one that it listens for.
    pub(super) fn hear(
        &mut self,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        let node = u32::from(self.node);
        match frame.id {
            _ if !self.powered => false,
            0x000 => self.command(frame.payload(), motor),
            0x701..=0x77F => {
                let watched = self.objects.unsigned(0x1016, 1) >> 16;
                let its = watched == frame.id - 0x700;
                if its {
                    self.heard = Some(wire.now);
                }
                its
            }
            id if id == 0x600 + node => {
                self.serve(frame, wire, motor);
                true
            }
            id => self.receive_pdo(id, frame, wire, motor),
        }
    }

    /// Network management.
    fn command(&mut self, data: &[u8], motor: &mut Motor<'_>) -> bool {
        let &[command, node] = data else {
            return false;
        };
        if node != 0 && node != self.node {
            return false;
        }
        let was = self.state;
        match command {
            0x01 => self.state = State::Operational,
            0x02 => self.state = State::Stopped,
            0x80 => self.state = State::PreOperational,
            0x81 => self.reset(motor),
            0x82 => {
                self.objects.restore_communication();
                self.restart();
            }
            _ => return false,
        }
        if was == State::Operational && self.state != was {
            self.lose_connection(motor);
        }
        true
    }

    fn serve(&mut self, frame: &Frame, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        let Ok(request) = <[u8; 8]>::try_from(frame.payload()) else {
            return;
        };
        if matches!(self.state, State::Stopped | State::Initialising) {
            return;
        }
        let mut sdo = core::mem::take(&mut self.sdo);
        let mut access = Outside { drive: self, motor };
        let answer = sdo.answer(request, &mut access);
        self.sdo = sdo;
        if let Some(answer) = answer {
            wire.send(0x580 + u32::from(self.node), &answer);
        }
    }

    fn receive_pdo(
        &mut self,
        id: u32,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        if self.state != State::Operational {
            return false;
        }
        let all = RECEIVED..RECEIVED + PDOS;
        let mut its = all.filter(|parameters| pdo::id(&self.objects, *parameters) == Some(id));
        let Some(parameters) = its.next() else {
            return false;
        };
        let payload = Payload::of(frame.payload());
        if self.objects.unsigned(parameters, 2) <= 240 {
            self.at_sync[usize::from(parameters - RECEIVED)] = Some(payload);
        } else {
            self.take_pdo(parameters, &payload, wire, motor);
        }
        true
    }

    fn take_pdo(
        &mut self,
        parameters: u16,
        payload: &Payload,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) {
        let mut keys = [(0, 0); pdo::ENTRIES as usize];
        match pdo::unpack(&mut self.objects, parameters, payload, &mut keys) {
            Ok(count) => {
                for key in keys.iter().take(count) {
                    self.written(*key, motor);
                }
            }
            Err(()) => self.emergency(SHORT_PDO, COMMUNICATION, wire),
        }
    }
}

/// The drive's objects for a client.
struct Outside<'a, 'm> {
    drive: &'a mut CanopenDrive,
    motor: &'a mut Motor<'m>,
}

impl Served for Outside<'_, '_> {
    fn read(&mut self, key: Key) -> Result<Vec<u8>, u32> {
        self.drive.run_drive(self.motor);
        let objects = &self.drive.objects;
        let bytes = objects.bytes(key).ok_or_else(|| objects.absent(key))?;
        Ok(bytes.to_vec())
    }

    fn length(&self, key: Key) -> Option<usize> {
        self.drive.objects.bytes(key).map(<[u8]>::len)
    }

    fn write(&mut self, key: Key, bytes: &[u8]) -> Result<(), u32> {
        let drive = &mut *self.drive;
        drive.objects.accepts(key, bytes.len())?;
        pdo::check(&drive.objects, key, bytes)?;
        if !drive.allows(key, bytes) {
            return Err(abort::RANGE);
        }
        drive.objects.receive(key, bytes);
        drive.written(key, self.motor);
        Ok(())
    }
}

/// ms in ns.
fn ms(value: u32) -> u64 {
    1_000_000 * u64::from(value)
}
