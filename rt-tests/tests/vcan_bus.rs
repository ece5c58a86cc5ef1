//! The bus suite on a real kernel's CAN, and cases that only a kernel has: other programs on the same
//! interface, error frames, interfaces that are missing or go down. Needs vcan0 and vcan1.
#![cfg(feature = "vcan")]

mod bus;

use bus::{ONE, Rig, STRANGER, TWO, answers, assert_same, conforms, frame, frames, receive, table};
use can_codec::{Frame, Frames, Gather, MAX_FRAMES};
use socketcan::{
    CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanRemoteFrame,
    EmbeddedFrame, ExtendedId, Frame as _, Socket, StandardId,
};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use torqued::bus::{Bus, Line, OpenError, SocketCan};

const INTERFACES: [&str; 2] = ["vcan0", "vcan1"];

/// Every socket of an interface receives every frame: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn line(interface: &str) -> Line<'_> {
    Line {
        place: "robot.toml:1: bus.interface",
        interface,
        fd: true,
    }
}

fn open() -> SocketCan {
    SocketCan::open(&INTERFACES.map(line)).unwrap()
}

/// The `socketcan` crate's socket: an independent user of the kernel's interface.
fn outsider(interface: &str) -> CanFdSocket {
    let socket = CanFdSocket::open(interface).unwrap();
    socket.set_read_timeout(Duration::from_secs(5)).unwrap();
    socket
}

fn ip(arguments: &str) {
    let status = Command::new("ip")
        .args(arguments.split_whitespace())
        .status()
        .unwrap();
    assert!(status.success(), "ip {arguments}");
}

struct Two {
    bus: SocketCan,
    other: SocketCan,
}

impl Rig for Two {
    fn bus(&mut self) -> &mut dyn Bus {
        &mut self.bus
    }
    fn send_from_peer(&mut self, frames: &Frames) {
        assert_eq!(self.other.send(frames), frames.len());
    }
    fn received_by_peer(&mut self) -> (Vec<Frame>, u64) {
        let mut received = Vec::new();
        let mut never = Gather::new(1);
        let mut rx = Frames::new(MAX_FRAMES);
        loop {
            rx.clear();
            self.other.receive(&mut rx, &mut never, &table(), 0);
            if rx.is_empty() {
                return (received, self.other.counters().dropped);
            }
            received.extend_from_slice(rx.as_slice());
        }
    }
}

#[test]
fn socketcan_conforms() {
    let _alone = alone();
    conforms(|| Two {
        other: open(),
        bus: open(),
    });
}

#[test]
fn another_implementation_reads_sent_frames() {
    let _alone = alone();
    let (one, two) = (outsider("vcan0"), outsider("vcan1"));
    let mut bus = open();
    let list = [
        frame(0, ONE, 8, false, 0x0102_0304_0506_0708),
        frame(0, TWO, 48, true, 5),
        frame(1, STRANGER, 0, false, 0),
    ];
    assert_eq!(bus.send(&frames(&list)), 3);

    let CanAnyFrame::Normal(seen) = one.read_frame().unwrap() else {
        panic!("not a classic frame");
    };
    assert_eq!((seen.raw_id(), seen.is_extended()), (0x101, false));
    assert_eq!(seen.data(), [8, 7, 6, 5, 4, 3, 2, 1]);
    let CanAnyFrame::Fd(seen) = one.read_frame().unwrap() else {
        panic!("not an FD frame");
    };
    assert_eq!((seen.raw_id(), seen.is_extended()), (0x102, true));
    assert!(seen.is_brs());
    assert_eq!(seen.data(), list[1].payload());
    let CanAnyFrame::Normal(seen) = two.read_frame().unwrap() else {
        panic!("not a classic frame");
    };
    assert_eq!((seen.raw_id(), seen.data().len()), (STRANGER, 0));
    // No socket receives its own frames.
    assert!(receive(&mut bus).is_empty());
}

#[test]
fn frames_of_another_implementation_are_read() {
    let _alone = alone();
    let mut bus = open();
    let (one, two) = (outsider("vcan0"), outsider("vcan1"));
    let classic = CanDataFrame::new(StandardId::new(0x101).unwrap(), &[1, 2, 3]).unwrap();
    let fd = CanFdFrame::new(ExtendedId::new(0x102).unwrap(), &[9; 24]).unwrap();
    let remote = CanRemoteFrame::new_remote(StandardId::new(0x101).unwrap(), 8).unwrap();
    one.write_frame(&classic).unwrap();
    two.write_frame(&fd).unwrap();
    one.write_frame(&remote).unwrap();

    let rx = receive(&mut bus);
    let [a, b, c] = rx.as_slice() else {
        panic!("{rx:?}");
    };
    assert_eq!(
        (a.bus, a.fd, a.id, a.payload()),
        (0, false, ONE, &[1, 2, 3][..])
    );
    assert_eq!(
        (b.bus, b.fd, b.id, b.payload()),
        (1, true, TWO, &[9; 24][..])
    );
    // A remote frame asks for the message and is not it.
    assert_eq!(table().classify(c), None);
}

#[test]
fn error_frames_are_seen_and_complete_nothing() {
    let _alone = alone();
    let mut bus = open();
    let error = CanErrorFrame::new_error(0x101, &[0, 4, 0, 0, 0, 0, 0, 0]).unwrap();
    outsider("vcan1").write_frame(&error).unwrap();
    let rx = receive(&mut bus);
    let [seen] = rx.as_slice() else {
        panic!("{rx:?}");
    };
    assert!(seen.error);
    assert_eq!((seen.bus, seen.id, seen.data[1]), (1, 0x101, 4));
    assert_eq!(table().classify(seen), None);
    let counters = bus.counters();
    assert_eq!((counters.error_frames, counters.received), (1, 0));
}

#[test]
fn interfaces_of_no_bus_are_not_read() {
    let _alone = alone();
    let mut bus = SocketCan::open(&[line("vcan1")]).unwrap();
    let data = CanDataFrame::new(StandardId::new(0x101).unwrap(), &[0; 8]).unwrap();
    outsider("vcan0").write_frame(&data).unwrap();
    outsider("vcan1").write_frame(&data).unwrap();
    assert_same(receive(&mut bus).as_slice(), &[frame(0, ONE, 8, false, 0)]);
    assert_eq!(bus.counters().received, 1);
}

#[test]
fn losses_in_the_kernel_are_counted() {
    let _alone = alone();
    let (mut bus, mut other) = (open(), open());
    let list = frames(&vec![frame(0, STRANGER, 64, true, 1); 500]);
    let mut sent = 0;
    // More than the receive buffer holds, whatever its limit here.
    for _ in 0..30 {
        sent += other.send(&list) as u64;
    }
    let mut rx = Frames::new(sent as usize);
    let mut never = Gather::new(1);
    loop {
        let before = rx.len();
        bus.receive(&mut rx, &mut never, &table(), 0);
        if rx.len() == before {
            break;
        }
    }
    // The kernel reports its count with the next frame it delivers.
    other.send(&frames(&[frame(0, ONE, 8, false, 1)]));
    rx.clear();
    bus.receive(&mut rx, &mut never, &table(), 0);
    let counters = bus.counters();
    assert!(counters.dropped > 0);
    assert_eq!(counters.received + counters.dropped, sent + 1);
}

#[test]
fn backlog_is_worked_off_without_loss() {
    let _alone = alone();
    let (mut bus, mut other) = (open(), open());
    let list: Vec<_> = (0..500).map(|i| frame(1, ONE, 8, false, i)).collect();
    other.send(&frames(&list));
    let mut nothing = Gather::new(0);
    let mut rx = Frames::new(64);
    let mut seen = Vec::new();
    while seen.len() < list.len() {
        rx.clear();
        bus.receive(&mut rx, &mut nothing, &table(), 0);
        seen.extend_from_slice(rx.as_slice());
    }
    assert_same(&seen, &list);
    assert_eq!(bus.counters().dropped, 0);
}

#[test]
fn bus_that_goes_down_fails_alone_and_comes_back() {
    let _alone = alone();
    let mut bus = open();
    let list = frames(&[answers()[0], answers()[2]]);
    assert_eq!(bus.send(&list), 2);
    ip("link set vcan0 down");
    let accepted = bus.send(&list);
    let failure = bus.send_failure();
    ip("link set vcan0 up");
    assert_eq!(accepted, 1);
    let failure = failure.unwrap();
    assert_eq!((failure.bus, failure.errno), (0, 100), "ENETDOWN of bus 0");
    assert_eq!(bus.send(&list), 2);
    let counters = bus.counters();
    assert_eq!((counters.sent, counters.send_failed), (5, 1));
    // Receiving has survived it as well.
    let mut other = open();
    other.send(&frames(&answers()));
    assert_same(receive(&mut bus).as_slice(), &answers());
}

#[test]
fn full_transmit_queue_is_counted_and_never_waited_for() {
    let _alone = alone();
    // A queue of two frames that drains one small frame a second.
    ip("link add dev vcan9 type vcan");
    ip("link set vcan9 mtu 72 up");
    let shaped = Command::new("tc")
        .args("qdisc add dev vcan9 root tbf rate 128bit burst 16 limit 40".split(' '))
        .status();
    let mut bus = SocketCan::open(&[line("vcan9")]).unwrap();
    let list = frames(&[frame(0, ONE, 8, false, 1); 50]);
    let accepted = bus.send(&list);
    let counters = bus.counters();
    ip("link del dev vcan9");
    assert!(shaped.is_ok_and(|status| status.success()), "tc");
    assert!(accepted < 50);
    assert_eq!(counters.sent + counters.send_failed, 50);
    assert_eq!(bus.send_failure().unwrap().errno, 105, "ENOBUFS");
}

#[test]
fn refusals_name_the_interface_and_those_that_exist() {
    let _alone = alone();
    let message = |lines: &[Line<'_>]| match SocketCan::open(lines) {
        Err(error @ OpenError::Interfaces(_)) => error.to_string(),
        other => panic!("{:?}", other.map(|_| "opened")),
    };
    let text = message(&[line("can7")]);
    assert!(
        text.contains("robot.toml:1: bus.interface: can7 does not exist"),
        "{text}"
    );
    assert!(text.contains("vcan0, vcan1"), "{text}");
    let text = message(&[line("lo")]);
    assert!(text.contains("lo is not a CAN interface"), "{text}");

    ip("link add dev vcan8 type vcan");
    ip("link set vcan8 mtu 16");
    let classic = Line {
        fd: false,
        ..line("vcan8")
    };
    let (down, no_fd) = (message(&[classic]), message(&[line("vcan8")]));
    ip("link set vcan8 up");
    let opened = SocketCan::open(&[classic]).is_ok();
    ip("link del dev vcan8");
    assert!(down.contains("vcan8 is down"), "{down}");
    assert!(no_fd.contains("only classic CAN (MTU 16)"), "{no_fd}");
    assert!(opened);
}
