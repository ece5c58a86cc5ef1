//! A robot of the project whose drives are CANopen nodes instead of what its DBC files describe.

use std::f64::consts::TAU;
use std::fmt::Write as _;

/// Keys of `[drive.NAME.canopen]`, with or without a link-side encoder, and for robots that have velocities.
const AT_LINK: &str = "position = \"link\"\nother_angle = \"2240:00\"\n";
const AT_MOTOR: &str = "position = \"motor\"\n";
const VELOCITY: &str = "velocity_rpm_per_count = 1.0\n";
/// Torque limit of a joint over the rated torque of its drive, as config/canopen-joint has it.
const LIMIT_OF_RATED: f64 = 1.48;

/// The configuration `text`, a `robot.toml`, with each drive as a node of CiA 402 that has the link's angle in 6064,
/// or the motor's where there is no link-side encoder: the counts and units of its DBC files, but that the current has
/// thousandths of the rated one. `per_bus` joints share a bus of their own, `nodes1` and so on; sensors stay on the robot's buses and DBC files.
#[must_use]
pub fn with_canopen_nodes(text: &str, per_bus: usize) -> String {
    let (mut out, mut joints, mut table) = (String::new(), 0, String::new());
    let velocity = if text.contains("\nvelocity = ") {
        VELOCITY
    } else {
        ""
    };
    for section in sections(text) {
        let head = section.lines().next().unwrap_or_default();
        let drive = head.strip_prefix("[drive.").unwrap_or_default();
        if head.starts_with("[[joint]]") {
            out += &joint_as_node(section, joints / per_bus + 1, joints % per_bus + 1);
            joints += 1;
        } else if drive.contains(".state]") {
            let head = head.replace(".state]", ".canopen]");
            let _ = writeln!(out, "{head}\n{table}{velocity}");
        } else if !drive.is_empty() && !drive.contains('.') {
            let at_link = section.contains("\nlink_counts_per_");
            let place = if at_link { AT_LINK } else { AT_MOTOR };
            let rated = limit_current(text, section) / LIMIT_OF_RATED;
            table = format!("{place}rated_current_A = {rated:.1}\n");
            out += &section.replace("\ncommand = ", "\nprofile = \"cia402\"\ncommand = ");
        } else {
            out += section;
        }
    }
    for bus in 1..=joints.div_ceil(per_bus) {
        let _ = writeln!(
            out,
            "\n[[bus]]\nname = \"nodes{bus}\"\ninterface = \"nodes{bus}\""
        );
    }
    out
}

/// Current of the first torque limit that a joint with this drive has, A.
fn limit_current(text: &str, drive: &str) -> f64 {
    let name = drive.split(['.', ']']).nth(1).unwrap_or_default();
    let mut joints = sections(text).into_iter();
    let used = format!("\ndrive = \"{name}\"");
    let joint = joints.find(|s| s.starts_with("[[joint]]") && s.contains(&used));
    let limit = number(joint.unwrap_or_default(), "torque_limit_Nm");
    let limit = limit.or_else(|| number(joint.unwrap_or_default(), "torque_limit_N"));
    let per_turn = number(drive, "lead_mm_per_turn").map(|lead| 1e-3 * lead / TAU);
    let lever = number(drive, "gear_ratio").map(|ratio| 1.0 / ratio);
    let lever = lever.or(per_turn).unwrap_or(f64::NAN);
    let constant = number(drive, "torque_constant_Nm_per_A").unwrap_or(f64::NAN);
    limit.unwrap_or(f64::NAN) * lever / constant
}

/// The number of a key.
fn number(section: &str, key: &str) -> Option<f64> {
    let lines = section.lines().filter_map(|line| line.split_once(" = "));
    let mut found = lines.filter(|(own, _)| *own == key);
    let value = found.next()?.1;
    value.split([' ', '#']).next()?.parse().ok()
}

/// The table of a joint without the signals that a profile has.
fn joint_as_node(section: &str, bus: usize, node: usize) -> String {
    let mut out = String::new();
    for line in section.lines() {
        let key = line.split(" =").next().unwrap_or_default();
        match key {
            "bus" => {
                let _ = writeln!(out, "bus = \"nodes{bus}\"\nnode = {node}");
            }
            "status" | "set_point" | "control" => {}
            _ => {
                let without = match (line.find("signal = \""), line.find("\", direction")) {
                    (Some(from), Some(to)) => [&line[..from], &line[to + 3..]].concat(),
                    _ => line.to_owned(),
                };
                let _ = writeln!(out, "{without}");
            }
        }
    }
    out
}

/// The text, cut before each line that begins a table.
fn sections(text: &str) -> Vec<&str> {
    let heads = text.match_indices("\n[").map(|(at, _)| at + 1);
    let mut ends: Vec<usize> = heads.collect();
    ends.push(text.len());
    let mut from = 0;
    let cut = ends.into_iter().map(|end| {
        let section = &text[from..end];
        from = end;
        section
    });
    cut.collect()
}
