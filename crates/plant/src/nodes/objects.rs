//! The object dictionary of a simulated CANopen node (CiA 301, 7.4).

use std::collections::BTreeMap;

/// Index and sub-index.
pub(super) type Key = (u16, u8);

/// Reasons of an abort (CiA 301, table 22).
pub(super) mod abort {
    pub(crate) const TOGGLE: u32 = 0x0503_0000;
    pub(crate) const COMMAND: u32 = 0x0504_0001;
    pub(crate) const ACCESS: u32 = 0x0601_0000;
    pub(crate) const READ_ONLY: u32 = 0x0601_0002;
    pub(crate) const NO_OBJECT: u32 = 0x0602_0000;
    pub(crate) const NOT_MAPPABLE: u32 = 0x0604_0041;
    pub(crate) const TOO_LONG_FOR_PDO: u32 = 0x0604_0042;
    pub(crate) const LENGTH: u32 = 0x0607_0010;
    pub(crate) const NO_SUB_INDEX: u32 = 0x0609_0011;
    pub(crate) const RANGE: u32 = 0x0609_0030;
}

/// What may be done with an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// It is read.
    Read,
    /// It is read, or sent by a PDO.
    ReadOrSent,
    /// It is read and written.
    Write,
    /// It is read, written, or received by a PDO.
    WriteOrReceived,
}

impl Access {
    fn is_writable(self) -> bool {
        matches!(self, Self::Write | Self::WriteOrReceived)
    }
}

#[derive(Debug, Clone)]
struct Entry {
    /// Little endian.
    bytes: Vec<u8>,
    access: Access,
}

/// All objects of a node, and what they are at power-on.
#[derive(Debug, Clone, Default)]
pub(super) struct Objects {
    entries: BTreeMap<Key, Entry>,
    at_power_on: BTreeMap<Key, Entry>,
}

impl Objects {
    /// Adds an object.
    pub(super) fn add(&mut self, index: u16, sub: u8, bytes: &[u8], access: Access) {
        let bytes = bytes.to_vec();
        let entry = Entry { bytes, access };
        self.at_power_on.insert((index, sub), entry.clone());
        self.entries.insert((index, sub), entry);
    }

    /// There is such an object.
    pub(super) fn has(&self, key: Key) -> bool {
        self.entries.contains_key(&key)
    }

    /// Its bytes; none: there is no such object.
    pub(super) fn bytes(&self, key: Key) -> Option<&[u8]> {
        self.entries.get(&key).map(|entry| entry.bytes.as_slice())
    }

    /// Its value, unsigned; 0: there is no such object.
    pub(super) fn unsigned(&self, index: u16, sub: u8) -> u32 {
        let bytes = self.bytes((index, sub)).unwrap_or_default();
        let mut all = [0; 4];
        let len = bytes.len().min(4);
        all[..len].copy_from_slice(&bytes[..len]);
        u32::from_le_bytes(all)
    }

    /// Its value, signed.
    pub(super) fn signed(&self, index: u16, sub: u8) -> i32 {
        let bits = self.bytes((index, sub)).map_or(32, |b| 8 * b.len().min(4));
        let unused = 32 - bits.max(8) as u32;
        (self.unsigned(index, sub) << unused).cast_signed() >> unused
    }

    /// Sets a value from inside, in the object's length.
    pub(super) fn set(&mut self, index: u16, sub: u8, value: i64) {
        if let Some(entry) = self.entries.get_mut(&(index, sub)) {
            let all = value.to_le_bytes();
            let len = entry.bytes.len().min(8);
            entry.bytes[..len].copy_from_slice(&all[..len]);
        }
    }

    /// Sets an object to what came by a PDO.
    pub(super) fn receive(&mut self, key: Key, bytes: &[u8]) {
        if let Some(entry) = self.entries.get_mut(&key)
            && entry.bytes.len() == bytes.len()
        {
            entry.bytes.copy_from_slice(bytes);
        }
    }

    /// A write from outside is allowed as far as the object itself goes.
    pub(super) fn accepts(&self, key: Key, len: usize) -> Result<(), u32> {
        let entry = self.entries.get(&key).ok_or_else(|| self.absent(key))?;
        if !entry.access.is_writable() {
            return Err(abort::READ_ONLY);
        }
        if entry.bytes.len() == len {
            Ok(())
        } else {
            Err(abort::LENGTH)
        }
    }

    /// The reason of an abort where there is no such object.
    pub(super) fn absent(&self, (index, _): Key) -> u32 {
        let others = self.entries.range((index, 0)..=(index, u8::MAX)).next();
        others.map_or(abort::NO_OBJECT, |_| abort::NO_SUB_INDEX)
    }

    /// The object can be in a PDO that the node sends or receives, with that many bits.
    pub(super) fn can_be_mapped(&self, key: Key, bits: u8, sent: bool) -> Result<(), u32> {
        let entry = self.entries.get(&key).ok_or_else(|| self.absent(key))?;
        let fits = match entry.access {
            Access::ReadOrSent => sent,
            Access::WriteOrReceived => true,
            Access::Read | Access::Write => false,
        };
        if fits && 8 * entry.bytes.len() == usize::from(bits) {
            Ok(())
        } else {
            Err(abort::NOT_MAPPABLE)
        }
    }

    /// Everything is as at power-on.
    pub(super) fn restore(&mut self) {
        self.entries.clone_from(&self.at_power_on);
    }

    /// The objects of the communication are as at power-on.
    pub(super) fn restore_communication(&mut self) {
        for (key, entry) in self.at_power_on.range(..(0x2000, 0)) {
            self.entries.insert(*key, entry.clone());
        }
    }
}
