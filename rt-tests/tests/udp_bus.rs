//! The bus suite on multicast groups of the loopback interface, and cases that only datagrams have:
//! others on the group, what is no frame, frames that come back, losses. Nothing leaves the machine.

mod bus;

use bus::{ONE, Rig, STRANGER, answers, assert_same, conforms, frame, frames, receive, table};
use can_codec::{DATAGRAM_BYTES, Frame, Frames, Gather, MAX_FRAMES, to_datagram};
use robot_config::UdpGroup;
use std::net::{Ipv4Addr, UdpSocket};
use std::thread;
use std::time::Duration;
use torqued::bus::{Bus, Member, OpenError, UdpMulticast};

const GROUP: Ipv4Addr = Ipv4Addr::new(239, 74, 163, 2);

/// Two buses of the loopback interface that no other test has.
fn two_groups() -> [UdpGroup; 2] {
    // Held until both are known, so that they differ.
    let taken = [(); 2].map(|()| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
    taken.map(|socket| UdpGroup {
        group: GROUP,
        port: socket.local_addr().unwrap().port(),
        interface: Some("lo".to_owned()),
        hop_limit: 0,
    })
}

fn open(groups: &[UdpGroup]) -> UdpMulticast {
    let member = |group| Member {
        place: "robot.toml:1: bus.interface",
        group,
    };
    let members: Vec<_> = groups.iter().map(member).collect();
    UdpMulticast::open(&members).unwrap()
}

/// A program that sends what it likes.
fn outsider() -> UdpSocket {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let as_socket = socket2::SockRef::from(&socket);
    (as_socket.set_multicast_if_v4(&Ipv4Addr::LOCALHOST)).unwrap();
    as_socket.set_multicast_ttl_v4(0).unwrap();
    socket
}

struct Two {
    bus: UdpMulticast,
    other: UdpMulticast,
    marker: UdpMulticast,
}

impl Two {
    fn new() -> Self {
        let groups = two_groups();
        let [bus, other, marker] = [(); 3].map(|()| open(&groups));
        await_stamps();
        Self { bus, other, marker }
    }
}

impl Rig for Two {
    fn bus(&mut self) -> &mut dyn Bus {
        &mut self.bus
    }

    fn send_from_peer(&mut self, frames: &Frames) {
        assert_eq!(self.other.send(frames), frames.len());
    }

    fn received_by_peer(&mut self) -> (Vec<Frame>, u64) {
        let mut received = drain(&mut self.other);
        // The kernel reports its count of losses with the next datagrams that it delivers.
        let mark = [0, 1].map(|bus| frame(bus, STRANGER, 1, false, 0x6d));
        self.marker.send(&frames(&mark));
        let marked = drain(&mut self.other);
        assert_same(&marked, &mark);
        received.retain(|frame| frame.id != STRANGER || frame.len != 1 || frame.data[0] != 0x6d);
        (received, self.other.counters().dropped)
    }
}

/// Waits until the kernel stamps arriving datagrams: it begins some time after the first socket has asked
/// for it, and gives those before then the time at which they are read.
fn await_stamps() {
    let groups = two_groups();
    let (mut bus, mut other) = (open(&groups), open(&groups));
    let waits = Duration::from_millis(2);
    for _ in 0..1000 {
        other.send(&frames(&[frame(0, ONE, 8, false, 0)]));
        thread::sleep(waits);
        let read_ns = bus.now_ns();
        let stamp_ns = drain(&mut bus).first().map_or(read_ns, |f| f.stamp_ns);
        if stamp_ns + waits.as_nanos() as u64 / 2 < read_ns {
            return;
        }
    }
    panic!("the kernel does not stamp datagrams");
}

/// Everything that is waiting.
fn drain(bus: &mut UdpMulticast) -> Vec<Frame> {
    let mut received = Vec::new();
    let mut never = Gather::new(1);
    let mut rx = Frames::new(MAX_FRAMES);
    loop {
        rx.clear();
        bus.receive(&mut rx, &mut never, &table(), 0);
        if rx.is_empty() {
            return received;
        }
        received.extend_from_slice(rx.as_slice());
    }
}

#[test]
fn udp_multicast_conforms() {
    conforms(Two::new);
}

#[test]
fn own_frames_are_passed_over_and_those_of_the_same_machine_are_not() {
    let groups = two_groups();
    let (mut bus, mut other) = (open(&groups), open(&groups));
    await_stamps();
    bus.send(&frames(&answers()));
    other.send(&frames(&answers()[..1]));
    assert_same(receive(&mut bus).as_slice(), &answers()[..1]);
    let counters = bus.counters();
    assert_eq!((counters.received, counters.refused_datagrams), (1, 0));
    assert_same(receive(&mut other).as_slice(), &answers());
}

#[test]
fn what_is_no_frame_is_counted_and_the_rest_goes_on() {
    let groups = two_groups();
    let mut bus = open(&groups);
    let outsider = outsider();
    let send = |bytes: &[u8]| outsider.send_to(bytes, (GROUP, groups[1].port)).unwrap();
    let good = frame(1, ONE, 8, false, 9);
    let mut datagram = [0; DATAGRAM_BYTES];
    let length = to_datagram(&good, &mut datagram).unwrap();
    let good_bytes = &datagram[..length];
    let mut remote = good_bytes.to_vec();
    let key = b"is_remote_frame";
    let at = remote.windows(key.len()).position(|w| w == key).unwrap() + key.len();
    remote[at] = 0xc3;
    send(&[]);
    send(b"not a map");
    send(&[0xff; 1400]);
    send(&good_bytes[..length - 1]);
    send(&[good_bytes, &[0]].concat());
    send(&[good_bytes, &[0; 1000]].concat());
    send(&remote);
    send(good_bytes);
    assert_same(receive(&mut bus).as_slice(), &[good]);
    let counters = bus.counters();
    assert_eq!((counters.received, counters.refused_datagrams), (1, 7));
    assert_eq!((counters.error_frames, counters.dropped), (0, 0));
}

#[test]
fn a_flood_of_what_is_no_frame_does_not_hold_a_cycle_up() {
    let groups = two_groups();
    let mut bus = open(&groups);
    let outsider = outsider();
    for _ in 0..2_000 {
        outsider.send_to(b"noise", (GROUP, groups[0].port)).unwrap();
    }
    let mut rx = Frames::new(MAX_FRAMES);
    bus.receive(&mut rx, &mut Gather::new(0), &table(), 0);
    let refused = bus.counters().refused_datagrams;
    assert!((64..=1_100).contains(&refused), "{refused}");
}

#[test]
fn losses_in_the_kernel_are_counted() {
    let groups = two_groups();
    let (mut bus, mut other) = (open(&groups), open(&groups));
    let list = frames(&vec![frame(0, STRANGER, 64, true, 1); 500]);
    // More than the receive buffer holds, whatever its limit here.
    let mut sent: u64 = (0..30).map(|_| other.send(&list) as u64).sum();
    let mut received = drain(&mut bus).len() as u64;
    // The kernel reports its count with the next datagram it delivers.
    sent += other.send(&frames(&[frame(0, ONE, 8, false, 1)])) as u64;
    received += drain(&mut bus).len() as u64;
    let counters = bus.counters();
    assert!(counters.dropped > 0);
    assert_eq!(
        (counters.received, received + counters.dropped),
        (received, sent)
    );
}

#[test]
fn backlog_is_worked_off_without_loss_in_the_order_of_arrival() {
    let groups = two_groups();
    let (mut bus, mut other) = (open(&groups), open(&groups));
    await_stamps();
    let list: Vec<_> = (0..300_u64)
        .map(|i| frame((i % 3 / 2) as u8, ONE, 8, false, i))
        .collect();
    other.send(&frames(&list));
    let mut rx = Frames::new(64);
    let mut seen = Vec::new();
    while seen.len() < list.len() {
        rx.clear();
        bus.receive(&mut rx, &mut Gather::new(0), &table(), 0);
        seen.extend_from_slice(rx.as_slice());
    }
    assert_same(&seen, &list);
    assert_eq!(bus.counters().dropped, 0);
}

#[test]
fn refusals_name_the_interface_and_those_that_exist() {
    let [mut group, _] = two_groups();
    group.interface = Some("nothing0".to_owned());
    let member = Member {
        place: "robot.toml:7: bus.interface (a)",
        group: &group,
    };
    match UdpMulticast::open(&[member]) {
        Err(error @ OpenError::Interfaces(_)) => {
            let text = error.to_string();
            assert!(text.starts_with("robot.toml:7: bus.interface (a): nothing0 does not exist"));
            assert!(text.contains("allowed: ") && text.contains("lo"), "{text}");
        }
        other => panic!("{:?}", other.map(|_| "opened")),
    }
}
