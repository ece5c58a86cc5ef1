//! Process data: what fits into which message, and the writes that make a node send and hear it.

use super::Object;
use super::eds::ObjectDictionary;
use problem::Problem;

/// Direction of process data, seen from the node, as CANopen names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// The node sends it (TPDO).
    Transmit,
    /// The node receives it (RPDO).
    Receive,
}

impl Direction {
    /// Index of the first communication parameter.
    fn communication(self) -> u16 {
        match self {
            Self::Transmit => 0x1800,
            Self::Receive => 0x1400,
        }
    }

    /// Index of the first mapping parameter.
    fn mapping(self) -> u16 {
        match self {
            Self::Transmit => 0x1A00,
            Self::Receive => 0x1600,
        }
    }

    /// COB-ID of the predefined connection set without node, of the first of four.
    fn first_id(self) -> u32 {
        match self {
            Self::Transmit => 0x180,
            Self::Receive => 0x200,
        }
    }
}

/// One object in a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mapped {
    /// The object.
    pub object: Object,
    /// Its length, bits.
    pub bits: u8,
}

impl Mapped {
    /// The mapping parameter's entry.
    #[must_use]
    pub fn entry(self) -> u32 {
        u32::from(self.object.index) << 16 | u32::from(self.object.sub) << 8 | u32::from(self.bits)
    }
}

/// PDOs of the predefined connection set, in each direction.
pub const PDOS: u8 = 4;
const MAX_BITS: usize = 64;
/// The bit of a COB-ID that says that the PDO is not used.
const NOT_USED: u32 = 1 << 31;

/// One message of process data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Direction, seen from the node.
    pub direction: Direction,
    /// Number, 0 to 3.
    pub number: u8,
    /// 1: at each SYNC; 255: at once.
    pub transmission: u8,
    /// Its objects in order.
    pub mapped: Vec<Mapped>,
}

impl Pdo {
    /// COB-ID for a node.
    #[must_use]
    pub fn id(&self, node: u8) -> u32 {
        self.direction.first_id() + 0x100 * u32::from(self.number) + u32::from(node)
    }

    /// Length, bytes.
    #[must_use]
    pub fn len(&self) -> u8 {
        let bits: usize = self.mapped.iter().map(|m| usize::from(m.bits)).sum();
        bits.div_ceil(8) as u8
    }

    /// It carries nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.mapped.is_empty()
    }

    /// Object and first bit of each of its objects.
    pub fn places(&self) -> impl Iterator<Item = (Mapped, usize)> + '_ {
        self.mapped.iter().scan(0, |bit, &mapped| {
            let first = *bit;
            *bit += usize::from(mapped.bits);
            Some((mapped, first))
        })
    }

    /// The communication parameter.
    #[must_use]
    pub fn communication(&self) -> u16 {
        self.direction.communication() + u16::from(self.number)
    }

    /// Writes that make a node use it, in the order that nodes insist on: off, number of entries
    /// zero, entries, their number, kind of transmission, on.
    #[must_use]
    pub fn writes(&self, node: u8) -> Vec<PdoWrite> {
        let number = u16::from(self.number);
        let communication = self.direction.communication() + number;
        let mapping = self.direction.mapping() + number;
        // Bits 29 and 30: an identifier of 11 bits, and remote requests.
        let id_bits = NOT_USED | 1 << 29 | 0x1FFF_FFFF;
        let write = |index, sub, value: Vec<u8>, mask| PdoWrite {
            object: Object::new(index, sub),
            value,
            mask,
        };
        let id = self.id(node);
        let off = (id | NOT_USED).to_le_bytes().to_vec();
        let mut writes = vec![
            write(communication, 1, off, NOT_USED),
            write(mapping, 0, vec![0], 0xFF),
        ];
        for (mapped, sub) in self.mapped.iter().zip(1..) {
            let entry = mapped.entry().to_le_bytes().to_vec();
            writes.push(write(mapping, sub, entry, u32::MAX));
        }
        let count = self.mapped.len() as u8;
        writes.push(write(mapping, 0, vec![count], 0xFF));
        writes.push(write(communication, 2, vec![self.transmission], 0xFF));
        writes.push(write(communication, 1, id.to_le_bytes().to_vec(), id_bits));
        writes
    }
}

/// The write that switches a PDO off, whose COB-ID is read first.
#[must_use]
pub fn switched_off(id: u32) -> u32 {
    id | NOT_USED
}

/// The COB-ID is that of a PDO that is in use.
#[must_use]
pub fn is_used(id: u32) -> bool {
    id & NOT_USED == 0
}

/// One write of a mapping, and the bits of it that must read back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PdoWrite {
    /// The object.
    pub object: Object,
    /// Its value, little endian.
    pub value: Vec<u8>,
    /// Bits of the value that must read back.
    pub mask: u32,
}

/// Plans PDOs of one direction: each group of objects in the first message with room for all of it,
/// in the order given.
///
/// # Errors
/// More than fits into the four messages of the predefined connection set.
pub fn plan(
    direction: Direction,
    transmission: u8,
    groups: &[&[Mapped]],
) -> Result<Vec<Pdo>, Problem> {
    let mut pdos = Vec::<Pdo>::new();
    for group in groups {
        let bits = |mapped: &[Mapped]| mapped.iter().map(|m| usize::from(m.bits)).sum::<usize>();
        let own = bits(group);
        let count = pdos.len();
        let room = pdos
            .iter_mut()
            .find(|pdo| bits(&pdo.mapped) + own <= MAX_BITS);
        match room {
            Some(pdo) => pdo.mapped.extend_from_slice(group),
            None if own <= MAX_BITS && count < usize::from(PDOS) => pdos.push(Pdo {
                direction,
                number: count as u8,
                transmission,
                mapped: group.to_vec(),
            }),
            None => {
                let what = format!("{} bits of process data find no room", own);
                return Err(Problem::new(what, "at most four PDOs of 8 bytes"));
            }
        }
    }
    Ok(pdos)
}

/// Notes objects that a node, by its object dictionary, lacks or cannot exchange so.
#[must_use]
pub fn check(pdos: &[Pdo], dictionary: &ObjectDictionary) -> Vec<Problem> {
    let mut problems = Vec::new();
    for pdo in pdos {
        let parameter = Object::new(pdo.communication(), 1);
        if dictionary.entry(parameter).is_none() {
            let what = format!("no PDO parameter {parameter}");
            let allowed = "a drive with as many PDOs, or fewer signals";
            problems.push(Problem::new(what, allowed).at(&dictionary.file, 0));
        }
        for mapped in &pdo.mapped {
            let Some(entry) = dictionary.entry(mapped.object) else {
                let what = format!("no object {}", mapped.object);
                let allowed = "an object of this drive";
                problems.push(Problem::new(what, allowed).at(&dictionary.file, 0));
                continue;
            };
            let writable = entry.writable || pdo.direction == Direction::Transmit;
            if !(entry.mappable && writable) {
                let what = format!(
                    "{} ({}) cannot be mapped to this PDO",
                    mapped.object, entry.name
                );
                let allowed =
                    "an object with PDOMapping=1, and to be sent also AccessType rw or wo";
                problems.push(Problem::new(what, allowed).at(&dictionary.file, entry.line));
            }
            if let Some(bits) = entry.bits.filter(|&bits| bits != mapped.bits) {
                let what = format!("{} ({}) has {bits} bits", mapped.object, entry.name);
                let allowed = format!("{} bits", mapped.bits);
                problems.push(Problem::new(what, allowed).at(&dictionary.file, entry.line));
            }
        }
    }
    problems
}
