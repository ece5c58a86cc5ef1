//! Abort codes of SDO (CiA 301, 7.2.4.3.17) in words.

/// The object does not exist.
pub const NO_OBJECT: u32 = 0x0602_0000;
/// The object can only be read.
pub const READ_ONLY: u32 = 0x0601_0002;
/// The sub-index does not exist.
pub const NO_SUB_INDEX: u32 = 0x0609_0011;

const CODES: &[(u32, &str)] = &[
    (0x0503_0000, "the toggle bit did not alternate"),
    (0x0504_0000, "the transfer timed out in the node"),
    (0x0504_0001, "the node does not know this kind of transfer"),
    (0x0504_0002, "the block size is invalid"),
    (0x0504_0003, "the sequence number is invalid"),
    (0x0504_0004, "the checksum is wrong"),
    (0x0504_0005, "the node is out of memory"),
    (0x0601_0000, "the object cannot be accessed so"),
    (0x0601_0001, "the object can only be written"),
    (READ_ONLY, "the object can only be read"),
    (NO_OBJECT, "the object does not exist"),
    (0x0604_0041, "the object cannot be mapped to a PDO"),
    (
        0x0604_0042,
        "the mapped objects are longer than the PDO may be",
    ),
    (0x0604_0043, "the parameters do not fit together"),
    (0x0604_0047, "the node's parameters do not fit together"),
    (0x0606_0000, "the hardware failed"),
    (0x0607_0010, "the length does not fit the object"),
    (0x0607_0012, "the value is too long for the object"),
    (0x0607_0013, "the value is too short for the object"),
    (NO_SUB_INDEX, "the sub-index does not exist"),
    (0x0609_0030, "the value is outside the allowed range"),
    (0x0609_0031, "the value is too high"),
    (0x0609_0032, "the value is too low"),
    (0x0609_0036, "the greatest value is less than the least"),
    (0x060A_0023, "the node has no room for the connection"),
    (0x0800_0000, "general error"),
    (0x0800_0020, "the value cannot be stored"),
    (
        0x0800_0021,
        "the value cannot be stored: it is under local control",
    ),
    (
        0x0800_0022,
        "the value cannot be stored in the node's present state",
    ),
    (0x0800_0023, "the node has no object dictionary"),
    (0x0800_0024, "there are no data"),
];

/// The meaning of an abort code.
#[must_use]
pub fn text(code: u32) -> &'static str {
    let found = CODES.iter().find(|(known, _)| *known == code);
    found.map_or("a code of the maker's own", |(_, text)| text)
}

/// The node lacks the object.
#[must_use]
pub fn is_missing(code: u32) -> bool {
    matches!(code, NO_OBJECT | NO_SUB_INDEX)
}
