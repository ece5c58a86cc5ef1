//! What a simulated CANopen drive does as one of CiA 402 (IEC 61800-7-201): its objects, their units, its modes.
//!
//! It follows its target's object, whatever stands there: a drive that is enabled with a target of zero goes to zero.

use super::canopen::CanopenDrive;
use super::motor::Motor;
use super::objects::{Access, Key, Objects};
use super::pdo::{ENTRIES, PDOS, RECEIVED, SENT};
use crate::drive_states::DriveError;
use robot_config::CanopenSheet;
use std::f64::consts::TAU;

/// Modes of operation: none, cyclic synchronous position, cyclic synchronous torque.
const NO_MODE: i32 = 0;
const POSITION_MODE: i32 = 8;
const TORQUE_MODE: i32 = 10;
/// Bits of the status word: remote; set-points are followed, in the cyclic modes.
const REMOTE: u32 = 1 << 9;
const FOLLOWS: u32 = 1 << 12;
/// Bits of the status word that are the state's, and the one of the voltage.
const STATE_BITS: u32 = 0x7F;

/// The objects of a drive as it leaves the factory, with the mapping that CiA 402 predefines.
pub(super) fn objects(node: u8, sheet: &CanopenSheet, motor: &Motor<'_>) -> Objects {
    let mut objects = Objects::default();
    communication(&mut objects, node, sheet);
    for number in 0..PDOS {
        let offset = 0x100 * u32::from(number) + u32::from(node);
        let (received, sent): (&[u32], &[u32]) = match number {
            0 => (&[0x6040_0010], &[0x6041_0010]),
            1 => (&[0x6040_0010, 0x6060_0008], &[0x6041_0010, 0x6061_0008]),
            2 => (&[0x6040_0010, 0x607A_0020], &[0x6041_0010, 0x6064_0020]),
            _ => (&[0x6040_0010, 0x6071_0010], &[0x6041_0010, 0x606C_0020]),
        };
        predefined(&mut objects, RECEIVED + number, 0x200 + offset, received);
        predefined(&mut objects, SENT + number, 0x180 + offset, sent);
    }
    device(&mut objects, sheet, motor);
    objects
}

fn communication(objects: &mut Objects, node: u8, sheet: &CanopenSheet) {
    use Access::{Read, ReadOrSent, Write};
    objects.add(0x1000, 0, &0x0002_0192_u32.to_le_bytes(), Read);
    objects.add(0x1001, 0, &[0], ReadOrSent);
    objects.add(0x1003, 0, &[0], Write);
    objects.add(0x1003, 1, &[0; 4], Read);
    objects.add(0x1008, 0, b"simulated drive of torqued", Read);
    objects.add(0x1016, 0, &[1], Read);
    objects.add(0x1016, 1, &[0; 4], Write);
    objects.add(0x1017, 0, &[0; 2], Write);
    objects.add(0x1018, 0, &[4], Read);
    let identity = [sheet.vendor, sheet.product, Some(1), Some(u32::from(node))];
    for (sub, number) in (1..).zip(identity) {
        objects.add(0x1018, sub, &number.unwrap_or(0).to_le_bytes(), Read);
    }
    objects.add(0x1029, 0, &[1], Read);
    objects.add(0x1029, 1, &[0], Write);
}

fn predefined(objects: &mut Objects, parameters: u16, id: u32, entries: &[u32]) {
    use Access::{Read, Write};
    objects.add(parameters, 0, &[2], Read);
    objects.add(parameters, 1, &id.to_le_bytes(), Write);
    objects.add(parameters, 2, &[255], Write);
    let mapping = parameters + 0x200;
    objects.add(mapping, 0, &[entries.len() as u8], Write);
    for sub in 1..=ENTRIES {
        let entry = entries.get(usize::from(sub) - 1).copied().unwrap_or(0);
        objects.add(mapping, sub, &entry.to_le_bytes(), Write);
    }
}

fn device(objects: &mut Objects, sheet: &CanopenSheet, motor: &Motor<'_>) {
    use Access::{Read, ReadOrSent, Write, WriteOrReceived};
    objects.add(0x6007, 0, &1_i16.to_le_bytes(), Write);
    objects.add(0x603F, 0, &[0; 2], ReadOrSent);
    objects.add(0x6040, 0, &[0; 2], WriteOrReceived);
    objects.add(0x6041, 0, &[0; 2], ReadOrSent);
    objects.add(0x6060, 0, &[0], WriteOrReceived);
    objects.add(0x6061, 0, &[0], ReadOrSent);
    objects.add(0x6064, 0, &[0; 4], ReadOrSent);
    objects.add(0x606C, 0, &[0; 4], ReadOrSent);
    objects.add(0x6065, 0, &u32::MAX.to_le_bytes(), Write);
    objects.add(0x6071, 0, &[0; 2], WriteOrReceived);
    let current = motor.current_limit();
    let of_rated = |rated: f64| ((1000.0 * current / rated).round() as u16).to_le_bytes();
    objects.add(0x6072, 0, &of_rated(sheet.current_per_torque), Write);
    objects.add(0x6073, 0, &of_rated(sheet.rated_current), Write);
    objects.add(0x6075, 0, &milli(sheet.rated_current), Read);
    let at_motor = sheet.rated_torque / motor.sheet().gear_ratio;
    objects.add(0x6076, 0, &milli(at_motor), Read);
    objects.add(0x6077, 0, &[0; 2], ReadOrSent);
    objects.add(0x6078, 0, &[0; 2], ReadOrSent);
    objects.add(0x6079, 0, &[0; 4], ReadOrSent);
    objects.add(0x607A, 0, &[0; 4], WriteOrReceived);
    objects.add(0x607D, 0, &[2], Read);
    objects.add(0x607D, 1, &[0; 4], Write);
    objects.add(0x607D, 2, &[0; 4], Write);
    objects.add(0x60C2, 0, &[2], Read);
    objects.add(0x60C2, 1, &[1], Write);
    objects.add(0x60C2, 2, &[(-3_i8).cast_unsigned()], Write);
    let modes = 1_u32 << (own_mode(motor) - 1);
    objects.add(0x6502, 0, &modes.to_le_bytes(), Read);
    if let Some((index, sub)) = sheet.other_angle {
        objects.add(index, sub, &[0; 4], ReadOrSent);
    }
    if let Some(((index, sub), bits, _)) = sheet.temperature {
        objects.add(index, sub, &[0; 4][..usize::from(bits) / 8], ReadOrSent);
    }
    for &((index, sub), len) in &sheet.objects {
        if !objects.has((index, sub)) {
            objects.add(index, sub, &vec![0; len], Write);
        }
    }
}

/// Thousandths of a unit.
fn milli(x: f64) -> [u8; 4] {
    ((1000.0 * x).round() as u32).to_le_bytes()
}

/// The mode for which its motor has a controller.
fn own_mode(motor: &Motor<'_>) -> i32 {
    if motor.takes_position() {
        POSITION_MODE
    } else {
        TORQUE_MODE
    }
}

/// Errors as 603F and emergencies number them.
fn code(error: u32) -> u16 {
    let is = |kind: DriveError| kind as u32 == error;
    match error {
        0 => 0,
        _ if is(DriveError::OverCurrent) => 0x2310,
        _ if is(DriveError::OverTemperature) => 0x4310,
        _ if is(DriveError::Encoder) => 0x7305,
        _ if is(DriveError::Following) => 0x8611,
        _ if is(DriveError::SetPointTimeOut) => 0x8250,
        _ => 0xFF00,
    }
}

impl CanopenDrive {
    /// The drive after power-on: no mode, a target of zero, off.
    pub(super) fn wake_drive(&mut self, motor: &mut Motor<'_>) {
        self.written((0x6072, 0), motor);
        let joint = motor.mounted.joint;
        if let Some(faults) = motor.robot.drive_faults(joint) {
            // It follows its object, not where it stands.
            faults.keeps_target = true;
        }
        self.written((0x6040, 0), motor);
        if motor.takes_position() {
            self.written((0x607A, 0), motor);
        } else {
            self.written((0x6071, 0), motor);
        }
        self.run_drive(motor);
    }

    /// A value is in the range of its object.
    pub(super) fn allows(&self, key: Key, bytes: &[u8]) -> bool {
        match (key, bytes) {
            ((0x6060, 0), &[mode]) => {
                let mode = i32::from(mode.cast_signed());
                let modes = self.objects.unsigned(0x6502, 0);
                mode == NO_MODE || (1..=32).contains(&mode) && modes >> (mode - 1) & 1 == 1
            }
            // It can only be emptied.
            ((0x1003, 0), &[count]) => count == 0,
            _ => true,
        }
    }

    /// An object was written from outside.
    pub(super) fn written(&mut self, key: Key, motor: &mut Motor<'_>) {
        match key {
            (0x6040, 0) if !motor.is_deaf() => {
                let word = self.objects.unsigned(0x6040, 0);
                if let Some(states) = motor.states() {
                    states.control(word);
                }
            }
            (0x607A, 0) if motor.takes_position() => {
                let counts = f64::from(self.target());
                motor.follow_counts(counts, self.sheet.position_at_link);
            }
            (0x6072 | 0x6073, 0) => {
                let share = |index| f64::from(self.objects.unsigned(index, 0)) / 1000.0;
                let [of_torque, of_current] = [
                    share(0x6072) * self.sheet.current_per_torque,
                    share(0x6073) * self.sheet.rated_current,
                ];
                motor.limit_current(of_torque.min(of_current));
            }
            (0x6071, 0) if !motor.takes_position() => {
                let share = f64::from(self.objects.signed(0x6071, 0)) / 1000.0;
                motor.follow_current(share * self.sheet.current_per_torque);
            }
            _ => {}
        }
    }

    /// 607A, within 607D if that limits anything.
    fn target(&self) -> i32 {
        let [asked, least, most] = [(0x607A, 0), (0x607D, 1), (0x607D, 2)]
            .map(|(index, sub)| self.objects.signed(index, sub));
        if least < most {
            asked.clamp(least, most)
        } else {
            asked
        }
    }

    /// 6065: the drive faults where its position is too far from its target.
    fn watch_following(&self, motor: &mut Motor<'_>) {
        let error = i64::from(self.target()) - i64::from(self.objects.signed(0x6064, 0));
        let far = error.unsigned_abs() > u64::from(self.objects.unsigned(0x6065, 0));
        if motor.takes_position()
            && far
            && let Some(states) = motor.states()
            && states.is_enabled()
        {
            states.fail(DriveError::Following);
        }
    }

    /// The drive's own loop: mode, states, and what its sensors read in the units of its objects.
    pub(super) fn run_drive(&mut self, motor: &mut Motor<'_>) {
        let mode = self.objects.signed(0x6060, 0);
        self.objects.set(0x6061, 0, i64::from(mode));
        let mut status = REMOTE;
        if let Some(states) = motor.states() {
            // Without a mode there is nothing that it could follow.
            states.set_refuses(mode == NO_MODE);
            status |= states.status() & STATE_BITS;
            if states.is_enabled() {
                status |= FOLLOWS;
            }
        }
        let error = self.drive_error(motor);
        let (reading, sheet) = (motor.reading(), &self.sheet);
        let (motor_counts, link_counts) = (motor.motor_counts(), motor.link_counts());
        let (own, other) = if sheet.position_at_link {
            (link_counts, motor_counts)
        } else {
            (motor_counts, link_counts)
        };
        let per_mille = |x: f64, rated: f64| (1000.0 * x / rated).round().clamp(-32768.0, 32767.0);
        let rpm = motor.velocity() * 60.0 / TAU;
        let torque = motor.mounted.motor.direction * reading.report.torque;
        let objects = &mut self.objects;
        let mut set = |index, x: f64| objects.set(index, 0, x.round() as i64);
        set(0x603F, f64::from(error));
        set(0x6041, f64::from(status));
        set(0x6064, own);
        set(0x606C, rpm / sheet.velocity_rpm_per_count.unwrap_or(1.0));
        set(0x6077, per_mille(torque, sheet.rated_torque));
        set(0x6078, per_mille(motor.current(), sheet.rated_current));
        set(0x6079, 1000.0 * reading.report.voltage);
        if let Some((index, sub)) = sheet.other_angle {
            objects.set(index, sub, other.round() as i64);
        }
        if let Some(((index, sub), _, count)) = sheet.temperature {
            let counts = reading.report.temperature / count;
            objects.set(index, sub, counts.round() as i64);
        }
        self.watch_following(motor);
    }

    /// Its error, as 603F numbers it.
    pub(super) fn drive_error(&self, motor: &mut Motor<'_>) -> u16 {
        motor.states().map_or(0, |states| code(states.error()))
    }

    /// 6007: the connection is lost while it is enabled.
    pub(super) fn lose_connection(&mut self, motor: &mut Motor<'_>) {
        let option = self.objects.signed(0x6007, 0);
        let Some(states) = motor.states() else {
            return;
        };
        match option {
            _ if !states.is_enabled() => {}
            1 => states.fail(DriveError::SetPointTimeOut),
            2 => states.control(0x00),
            3 => states.control(0x02),
            _ => {}
        }
    }
}
