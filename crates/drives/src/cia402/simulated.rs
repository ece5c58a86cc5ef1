//! Objects of a drive of CiA 402 as it comes: what a simulated one is made of.

use super::{Kind, Object};
use crate::canopen::server::{Server, Value};
use std::collections::BTreeMap;

/// Maker of simulated drives: none has this number.
pub const VENDOR: u32 = 0x0000_0000;

/// A drive of that kind as it comes: pre-operational, with the mapping that CiA 402 predefines.
#[must_use]
pub fn drive(bus: u8, node: u8, kind: &Kind) -> Server {
    let mut objects = BTreeMap::new();
    let mut add = |index, sub, bytes: &[u8], writable, mappable| {
        let bytes = bytes.to_vec();
        let value = Value {
            bytes,
            writable,
            mappable,
        };
        objects.insert(Object::new(index, sub), value);
    };
    add(0x1000, 0, &0x0002_0192u32.to_le_bytes(), false, false);
    add(0x1001, 0, &[0], false, true);
    add(0x1008, 0, b"simulated drive", false, false);
    add(0x1016, 0, &[1], false, false);
    add(0x1016, 1, &[0; 4], true, false);
    add(0x1017, 0, &[0; 2], true, false);
    let identity = [
        kind.vendor.unwrap_or(VENDOR),
        kind.product.unwrap_or(402),
        1,
        u32::from(node),
    ];
    for (sub, number) in (1..).zip(identity) {
        add(0x1018, sub, &number.to_le_bytes(), false, false);
    }
    for number in 0..4u16 {
        let id = |base: u32| base + 0x100 * u32::from(number) + u32::from(node);
        for (communication, mapping, id) in [
            (0x1400, 0x1600, id(0x200)),
            (0x1800, 0x1A00, id(0x180) | 1 << 30),
        ] {
            add(communication + number, 1, &id.to_le_bytes(), true, false);
            add(communication + number, 2, &[255], true, false);
            add(mapping + number, 0, &[0], true, false);
            for sub in 1..=8 {
                add(mapping + number, sub, &[0; 4], true, false);
            }
        }
    }
    add(0x6007, 0, &1i16.to_le_bytes(), true, false);
    add(0x603F, 0, &[0; 2], false, true);
    add(0x6040, 0, &[0; 2], true, true);
    add(0x6041, 0, &0x0240u16.to_le_bytes(), false, true);
    add(0x6060, 0, &[1], true, true);
    add(0x6061, 0, &[1], false, true);
    add(0x6064, 0, &[0; 4], false, true);
    add(0x606C, 0, &[0; 4], false, true);
    add(0x6071, 0, &[0; 2], true, true);
    let rated = (kind.rated_current * 1000.0).round() as u32;
    add(0x6075, 0, &rated.to_le_bytes(), true, false);
    add(0x6077, 0, &[0; 2], false, true);
    add(0x6078, 0, &[0; 2], false, true);
    add(0x6079, 0, &48_000u32.to_le_bytes(), false, true);
    add(0x607A, 0, &[0; 4], true, true);
    add(0x60C2, 1, &[1], true, false);
    add(0x60C2, 2, &[(-3i8) as u8], true, false);
    add(0x6502, 0, &0x3ADu32.to_le_bytes(), false, false);
    if let Some(object) = kind.other_angle {
        add(object.index, object.sub, &[0; 4], false, true);
    }
    if let Some((mapped, _)) = kind.reported.temperature {
        let bytes = vec![0; usize::from(mapped.bits) / 8];
        add(mapped.object.index, mapped.object.sub, &bytes, false, true);
    }
    for (object, value) in &kind.sdo {
        objects.entry(*object).or_insert(Value {
            bytes: vec![0; value.len()],
            writable: true,
            mappable: false,
        });
    }
    let mut server = Server::new(bus, node, objects);
    server.mirror(super::MODE, super::MODE_DISPLAY);
    server
}
