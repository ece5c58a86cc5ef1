//! Kinds of buses.

use crate::files::{LEG, leg_with, refused};
use robot_config::{Carrier, UdpGroup};
use std::net::Ipv4Addr;

const CAN: [&str; 2] = ["interface = \"vcan0\"", "interface = \"vcan1\""];

/// The leg with both buses on multicast groups, with these keys.
fn on_groups(first: &str, second: &str) -> crate::files::Files {
    let kind = "kind = \"udp_multicast\"\n";
    leg_with(CAN[0], &format!("{kind}{first}")).with(LEG, CAN[1], &format!("{kind}{second}"))
}

#[test]
fn multicast_groups_have_python_cans_defaults() {
    let files = on_groups(
        "",
        "group = \"239.1.2.3\"\nport = 5000\ninterface = \"eth0\"\nhop_limit = 1",
    );
    let robot = files.load(LEG).expect("accepted");
    let carriers = robot.parameters.buses.iter().map(|bus| &bus.carrier);
    let carriers: Vec<_> = carriers.cloned().collect();
    let first = UdpGroup {
        group: Ipv4Addr::new(239, 74, 163, 2),
        port: 43113,
        interface: None,
        hop_limit: 0,
    };
    let second = UdpGroup {
        group: Ipv4Addr::new(239, 1, 2, 3),
        port: 5000,
        interface: Some("eth0".to_owned()),
        hop_limit: 1,
    };
    assert_eq!(carriers, [first, second].map(Carrier::UdpMulticast));
    let names: Vec<_> = carriers.iter().map(ToString::to_string).collect();
    assert_eq!(names, ["239.74.163.2:43113", "239.1.2.3:5000"]);
}

#[test]
fn what_no_group_can_have_is_refused() {
    for (keys, parts) in [
        (
            "group = \"10.0.0.1\"",
            ["bus.group (b)", "IPv4 multicast address"],
        ),
        ("group = \"224.0.0.5\"", ["bus.group (b)", "224.0.1.0 to"]),
        (
            "group = \"ff15::1\"",
            ["bus.group (b)", "IPv4 multicast address"],
        ),
        ("port = 0", ["bus.port (b)", "1 to 65535"]),
        ("hop_limit = 256", ["bus.hop_limit (b)", "0 to 255"]),
        (
            "interface = \"a/b\"",
            ["bus.interface (b)", "no name of an interface"],
        ),
    ] {
        refused(&on_groups("port = 5000", keys), LEG, keys, &parts);
    }
}

#[test]
fn one_group_and_port_for_each_bus_and_one_kind_for_all() {
    let same = on_groups("port = 5000", "port = 5000 # b");
    let parts = ["bus.port (b)", "a second bus is on 239.74.163.2:5000"];
    refused(&same, LEG, "port = 5000 # b", &parts);
    let mixed = leg_with(CAN[1], "kind = \"udp_multicast\"");
    let parts = ["bus.kind (b)", "of two kinds"];
    refused(&mixed, LEG, "kind = \"udp_multicast\"", &parts);
    let port = leg_with(CAN[0], "interface = \"vcan0\"\nport = 5000");
    refused(&port, LEG, "port = 5000", &["bus.port (a): unknown key"]);
}
