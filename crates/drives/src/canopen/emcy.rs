//! Emergencies, and error codes of drives (CiA 301 and 402, object 603F), in words.

use super::{EMCY_ID, node_of};
use can_codec::Frame;

/// An emergency that a node has sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// The node.
    pub node: u8,
    /// Error code; 0: an error is over.
    pub code: u16,
    /// Error register (object 1001).
    pub register: u8,
    /// The maker's own bytes.
    pub own: [u8; 5],
}

impl Emergency {
    /// The emergency that a frame carries; none if it carries none.
    #[must_use]
    pub fn of(frame: &Frame) -> Option<Self> {
        let node = node_of(frame, EMCY_ID)?;
        let &[low, high, register, a, b, c, d, e] = frame.payload() else {
            return None;
        };
        Some(Self {
            node,
            code: u16::from_le_bytes([low, high]),
            register,
            own: [a, b, c, d, e],
        })
    }
}

/// Codes of their own, then classes by the high byte, then by the high half of it.
const CODES: &[(u16, u16, &str)] = &[
    (0xFFFF, 0x0000, "no error, or an error is over"),
    (0xFFFF, 0x2310, "continuous over-current"),
    (
        0xFFFF,
        0x2320,
        "short circuit or earth leakage at the output",
    ),
    (0xFFFF, 0x2330, "earth leakage"),
    (0xFFFF, 0x2340, "short circuit of phases"),
    (0xFFFF, 0x2350, "I²t: too much current for too long"),
    (0xFFFF, 0x3210, "DC link: over-voltage"),
    (0xFFFF, 0x3220, "DC link: under-voltage"),
    (0xFFFF, 0x3331, "field circuit interrupted"),
    (0xFFFF, 0x4210, "drive too hot"),
    (0xFFFF, 0x4220, "drive too cold"),
    (0xFFFF, 0x4310, "motor or heat sink too hot"),
    (0xFFFF, 0x5441, "limit switch or enable input"),
    (0xFFFF, 0x6320, "a parameter does not fit"),
    (0xFFFF, 0x7121, "motor blocked"),
    (0xFFFF, 0x7300, "sensor of the motor"),
    (0xFFFF, 0x7305, "incremental encoder 1"),
    (0xFFFF, 0x7306, "incremental encoder 2"),
    (0xFFFF, 0x7380, "position sensor"),
    (0xFFFF, 0x7500, "communication inside the drive"),
    (0xFFFF, 0x8110, "CAN overrun: frames were lost"),
    (0xFFFF, 0x8120, "CAN error passive"),
    (
        0xFFFF,
        0x8130,
        "heartbeat or life guarding: the master fell silent",
    ),
    (0xFFFF, 0x8140, "recovered from bus-off"),
    (
        0xFFFF,
        0x8150,
        "COB-ID collision: two nodes send one identifier",
    ),
    (0xFFFF, 0x8180, "no connection to the network"),
    (0xFFFF, 0x8210, "a PDO was shorter than its mapping"),
    (0xFFFF, 0x8220, "a PDO was longer than its mapping"),
    (0xFFFF, 0x8240, "SYNC has an unexpected length"),
    (0xFFFF, 0x8250, "a PDO did not arrive in its time"),
    (0xFFFF, 0x8480, "velocity out of control"),
    (0xFFFF, 0x8500, "position control"),
    (0xFFFF, 0x8580, "position out of its range"),
    (
        0xFFFF,
        0x8611,
        "following error: the drive is too far from its set-point",
    ),
    (0xFFFF, 0x8612, "position limit reached"),
    (0xFF00, 0x2100, "current at the input"),
    (0xFF00, 0x2200, "current inside the drive"),
    (0xFF00, 0x2300, "current at the output"),
    (0xFF00, 0x3100, "mains voltage"),
    (0xFF00, 0x3200, "voltage inside the drive"),
    (0xFF00, 0x3300, "voltage at the output"),
    (0xFF00, 0x4100, "ambient temperature"),
    (0xFF00, 0x4200, "temperature of the drive"),
    (0xFF00, 0x4300, "temperature of motor or heat sink"),
    (0xFF00, 0x5100, "supply of the drive's electronics"),
    (0xFF00, 0x5500, "memory of the drive"),
    (0xFF00, 0x6100, "the drive's own software"),
    (0xFF00, 0x6200, "the user's software in the drive"),
    (0xFF00, 0x6300, "parameters"),
    (0xFF00, 0x7100, "power stage, brake or motor"),
    (0xFF00, 0x7200, "measuring circuit"),
    (0xFF00, 0x7300, "sensor"),
    (0xFF00, 0x7500, "communication inside the drive"),
    (0xFF00, 0x8100, "communication"),
    (0xFF00, 0x8200, "protocol"),
    (0xFF00, 0x8300, "torque control"),
    (0xFF00, 0x8400, "velocity control"),
    (0xFF00, 0x8500, "position control"),
    (0xFF00, 0x8600, "positioning"),
    (0xFF00, 0x9000, "external error"),
    (0xF000, 0x1000, "general error"),
    (0xF000, 0x2000, "current"),
    (0xF000, 0x3000, "voltage"),
    (0xF000, 0x4000, "temperature"),
    (0xF000, 0x5000, "hardware of the drive"),
    (0xF000, 0x6000, "software of the drive"),
    (0xF000, 0x7000, "additional module: brake, sensor, fan"),
    (0xF000, 0x8000, "monitoring"),
    (0xF000, 0x9000, "external error"),
    (0xF000, 0xF000, "additional function"),
];

/// The meaning of an error code of an emergency or of object 603F.
#[must_use]
pub fn text(code: u16) -> &'static str {
    if code >= 0xFF00 {
        return "a code of the maker's own: see the drive's manual";
    }
    let found = CODES.iter().find(|(mask, value, _)| code & mask == *value);
    found.map_or("a code that CiA 402 does not have", |(_, _, text)| text)
}
