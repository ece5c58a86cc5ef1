//! Time that frames occupy a bus in the worst case.

use can_codec::{EXTENDED_ID, Frame, Table};
use robot_config::{Carrier, Robot};

/// Bits a second of a bus.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bitrate {
    /// Classic frames, and the arbitration of CAN FD frames.
    pub(crate) nominal: f64,
    /// The data of CAN FD frames.
    pub(crate) data: f64,
}

/// A frame on the wire.
#[derive(Clone, Copy, Debug)]
struct Shape {
    extended: bool,
    fd: bool,
    len: u8,
}

impl Shape {
    /// Time on the bus with as many stuff bits as there can be and the gap that follows, s.
    fn worst_case_s(self, rate: Bitrate) -> f64 {
        let data = 8 * u32::from(self.len);
        if !self.fd {
            // Start to CRC may be stuffed; delimiters, acknowledgement, end and gap may not.
            let stuffed = if self.extended { 54 } else { 34 } + data;
            return f64::from(stuffed + (stuffed - 1) / 4 + 13) / rate.nominal;
        }
        // ISO 11898-1:2015. Start to BRS, and from the CRC delimiter on, at the nominal rate.
        let arbitration = if self.extended { 36 } else { 17 };
        let nominal = arbitration + (arbitration - 1) / 4 + 13;
        // ESI, length and data are stuffed; the CRC and its stuff count have fixed stuff bits.
        let (crc, fixed) = if self.len <= 16 { (17, 6) } else { (21, 7) };
        let fast = 5 + data + (5 + data) / 4 + 4 + crc + fixed;
        f64::from(nominal) / rate.nominal + f64::from(fast) / rate.data
    }
}

/// Frames of a bus in one cycle.
pub(crate) struct BusLoad {
    pub(crate) received: usize,
    pub(crate) sent: usize,
    /// None for a bus without a bit rate.
    pub(crate) time: Option<WireTime>,
}

/// Time that the frames of a cycle take on a CAN bus.
pub(crate) struct WireTime {
    /// From SYNC to the last answer, s.
    pub(crate) answers_s: f64,
    /// Commands, s.
    pub(crate) commands_s: f64,
    /// Share of the period, 1.
    pub(crate) load: f64,
}

/// The load of every bus, in config order.
pub(crate) fn bus_loads(robot: &Robot, rate: Bitrate) -> Vec<BusLoad> {
    let messages = |table: &Table, bus: usize| -> Vec<Shape> {
        (0..table.message_count())
            .filter_map(|index| table.message(index))
            .filter(|message| usize::from(message.bus) == bus)
            .map(|message| Shape {
                extended: message.id & EXTENDED_ID != 0,
                fd: message.fd,
                len: message.len,
            })
            .collect()
    };
    let sync_shape = |frame: &Frame| Shape {
        extended: frame.id & EXTENDED_ID != 0,
        fd: frame.fd,
        len: frame.len,
    };
    let total = |shapes: &[Shape]| shapes.iter().map(|s| s.worst_case_s(rate)).sum::<f64>();
    let of_bus = |(bus, sync): (usize, &Frame)| {
        let received = messages(&robot.receive, bus);
        let sent = messages(&robot.send, bus);
        let answers_s = sync_shape(sync).worst_case_s(rate) + total(&received);
        let commands_s = total(&sent);
        let carrier = robot.parameters.buses.get(bus).map(|bus| &bus.carrier);
        let on_wire = matches!(carrier, Some(Carrier::SocketCan(_)));
        BusLoad {
            received: received.len(),
            sent: sent.len(),
            time: on_wire.then(|| WireTime {
                answers_s,
                commands_s,
                load: (answers_s + commands_s) / robot.parameters.timing.sample_period,
            }),
        }
    };
    robot.sync.iter().enumerate().map(of_bus).collect()
}

#[cfg(test)]
mod tests {
    use super::{Bitrate, Shape};

    const RATE: Bitrate = Bitrate {
        nominal: 1e6,
        data: 5e6,
    };

    #[test]
    fn classic_frames_take_the_published_worst_case() {
        // Davis et al., Controller Area Network schedulability analysis (2007): 55 + 10 n bits for
        // standard and 80 + 10 n for extended identifiers.
        for len in 0..=8u8 {
            let bits = |extended| {
                let shape = Shape {
                    extended,
                    fd: false,
                    len,
                };
                (shape.worst_case_s(RATE) * 1e6).round() as u32
            };
            assert_eq!(bits(false), 55 + 10 * u32::from(len));
            assert_eq!(bits(true), 80 + 10 * u32::from(len));
        }
    }

    #[test]
    fn longer_frames_take_longer_and_fast_data_shortens_them() {
        let fd = |len| Shape {
            extended: false,
            fd: true,
            len,
        };
        let slow = Bitrate { data: 1e6, ..RATE };
        assert!(fd(64).worst_case_s(RATE) > fd(32).worst_case_s(RATE));
        assert!(fd(64).worst_case_s(slow) > 3.0 * fd(64).worst_case_s(RATE));
    }
}
