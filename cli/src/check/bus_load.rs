//! Time that frames occupy a bus in the worst case.

use can_codec::{EXTENDED_ID, Table};
use drives::family::translation;
use problem::Problem;
use robot_config::{BusParameters, Carrier, Robot, slots};

/// Period in which what changes slowly is reported, s.
const SLOW_S: f64 = 0.1;
/// Rates of loops that are named where a bus is too full, Hz.
const RATES: [f64; 9] = [
    1000.0, 800.0, 500.0, 400.0, 250.0, 200.0, 125.0, 100.0, 50.0,
];

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

/// A kind of frame, and how often it is sent in a cycle.
type Sent = (Shape, f64);

fn shape(id: u32, fd: bool, len: u8) -> Shape {
    let extended = id & EXTENDED_ID != 0;
    Shape { extended, fd, len }
}

/// Frames of a table on a bus; those of actuators are no frames of the bus.
fn messages(table: &Table, bus: usize, period: f64) -> Vec<Sent> {
    let of_bus = (0..table.message_count()).filter_map(|index| {
        let message = table.message(index)?;
        let ours = usize::from(message.bus) == bus && !translation::is_own(message.id);
        // What changes slowly is reported ten times a second.
        let slow = table.slots(index).all(slots::is_reported);
        let per_cycle = if slow {
            (period / SLOW_S).min(1.0)
        } else {
            1.0
        };
        ours.then(|| (shape(message.id, message.fd, message.len), per_cycle))
    });
    of_bus.collect()
}

/// SYNC of a bus, and heartbeats of the loop and of CANopen drives: sent and received.
fn supervision(robot: &Robot, bus: usize, period: f64) -> (Vec<Sent>, Vec<Sent>) {
    let own = robot
        .sync
        .iter()
        .filter(|frame| usize::from(frame.bus) == bus && !translation::is_own(frame.id));
    let mut sent: Vec<Sent> = own.map(|f| (shape(f.id, f.fd, f.len), 1.0)).collect();
    let drives = (robot.nodes.plans.iter()).filter(|plan| usize::from(plan.bus) == bus);
    let drives = drives.count();
    // Three in the time after which the loop counts as lost; each drive's two in it.
    let of_loop = period / robot.nodes.heartbeat.max(period);
    if drives > 0 {
        sent.push((shape(0, false, 1), 3.0 * of_loop));
    }
    let received = vec![(shape(0, false, 1), 2.0 * of_loop); drives];
    (sent, received)
}

/// The load of every bus, in config order.
pub(crate) fn bus_loads(robot: &Robot, rate: Bitrate) -> Vec<BusLoad> {
    let period = robot.parameters.timing.sample_period;
    let total = |all: &[Sent]| {
        let times = all.iter().map(|(shape, n)| n * shape.worst_case_s(rate));
        times.sum::<f64>()
    };
    let of_bus = |bus: usize| {
        let mut received = messages(&robot.receive, bus, period);
        let mut sent = messages(&robot.send, bus, period);
        let actuators = robot.nodes.actuators.iter();
        for actuator in actuators.filter(|actuator| usize::from(actuator.at.bus) == bus) {
            for one in actuator.exchanged(period) {
                let frame = &one.frame;
                let kind = (shape(frame.id, frame.fd, frame.len), one.per_cycle);
                if one.received {
                    &mut received
                } else {
                    &mut sent
                }
                .push(kind);
            }
        }
        let (begin, heartbeats) = supervision(robot, bus, period);
        let answers_s = total(&begin) + total(&received) + total(&heartbeats);
        let commands_s = total(&sent);
        let carrier = robot.parameters.buses.get(bus).map(|bus| &bus.carrier);
        let on_wire = matches!(carrier, Some(Carrier::SocketCan(_)));
        let count = |all: &[Sent]| all.iter().map(|(_, n)| n).sum::<f64>().round() as usize;
        BusLoad {
            received: count(&received),
            sent: count(&sent),
            time: on_wire.then(|| WireTime {
                answers_s,
                commands_s,
                load: (answers_s + commands_s) / period,
            }),
        }
    };
    (0..robot.parameters.buses.len()).map(of_bus).collect()
}

/// Buses that cannot carry their frames, with the rate of the loop at which they could.
pub(crate) fn refusals(robot: &Robot, loads: &[BusLoad], config: &str) -> Vec<Problem> {
    let period = robot.parameters.timing.sample_period;
    let of_bus = |(bus, load): (&BusParameters, &BusLoad)| {
        let time = load.time.as_ref().filter(|time| time.load > 1.0)?;
        let takes = time.answers_s + time.commands_s;
        let what = format!(
            "bus {}: its frames take {:.0} us at worst, {:.0} % of a cycle of {:.0} us",
            bus.name,
            takes * 1e6,
            time.load * 100.0,
            period * 1e6
        );
        let fits = RATES.into_iter().find(|rate| takes * rate <= 1.0);
        let allowed = match fits {
            Some(rate) => format!("loop.rate_hz = {rate}, a higher bit rate, or more buses"),
            None => "a higher bit rate, or more buses".to_owned(),
        };
        Some(Problem::new(what, allowed).at(config, 0))
    };
    let buses = robot.parameters.buses.iter().zip(loads);
    buses.filter_map(of_bus).collect()
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
