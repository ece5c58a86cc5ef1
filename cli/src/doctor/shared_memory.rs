//! Shared memory: room for the daemon and its clients, and what dead processes have left.

use super::finding::{Findings, Fix};
use super::machine::{Machine, field};
use std::fs;
use std::os::unix::fs::MetadataExt;

const FOLDER: &str = "/dev/shm";
/// Room for a daemon and its clients, bytes: the leg's with one client took 31 MB.
const ROOM: u64 = 40 << 20;
/// Begin of the names of our objects.
const PREFIX: &str = "torqued_";
/// End of the name of the one that the transport keeps for each run directory, also while nobody runs.
const KEPT: &str = ".global_mgmt";

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    if !root.exists(FOLDER) {
        findings.error(
            "shm",
            format!("{FOLDER} does not exist"),
            "daemon and clients meet in shared memory",
            format!("mount -t tmpfs -o size=256M tmpfs {FOLDER}"),
        );
        return;
    }
    room(machine, findings);
    leftovers(machine, findings);
}

fn room(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let mounts = root.text("/proc/mounts");
    let mount = mounts
        .lines()
        .rfind(|line| line.split_whitespace().nth(1) == Some(FOLDER));
    let Some(options) = mount.and_then(|line| line.split_whitespace().nth(3)) else {
        findings.not_seen(format!("the size of {FOLDER}: it is no mount of its own"));
        return;
    };
    let size = options
        .split(',')
        .find_map(|option| bytes(option.strip_prefix("size=")?));
    // A tmpfs without a size takes half of the memory.
    let meminfo = root.text("/proc/meminfo");
    let total = field(&meminfo, "MemTotal").and_then(|value| bytes(&value.replace(" kB", "k")));
    let Some(size) = size.or(total.map(|total| total / 2)) else {
        return;
    };
    let used: u64 = objects(machine).iter().map(|(_, bytes)| bytes).sum();
    let free = size.saturating_sub(used);
    if free < ROOM {
        findings.error(
            "shm-size",
            format!("{FOLDER} has {} MB free of {} MB", free >> 20, size >> 20),
            "the daemon does not start, or a client cannot connect",
            format!("mount -o remount,size=256M {FOLDER}; for a container --shm-size=256m"),
        );
    }
}

/// A size as mount options have it.
fn bytes(text: &str) -> Option<u64> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match text[digits.len()..].chars().next() {
        None => 1,
        Some('k' | 'K') => 1 << 10,
        Some('m' | 'M') => 1 << 20,
        Some('g' | 'G') => 1 << 30,
        Some(_) => return None,
    };
    digits.parse::<u64>().ok()?.checked_mul(factor)
}

/// Names of files with the memory that they take, bytes.
fn objects(machine: &Machine) -> Vec<(String, u64)> {
    let names = machine.root.names(FOLDER);
    let sized = names.into_iter().map(|name| {
        let data = fs::symlink_metadata(machine.root.path(&format!("{FOLDER}/{name}")));
        let bytes = data.map_or(0, |data| 512 * data.blocks());
        (name, bytes)
    });
    sized.collect()
}

fn leftovers(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let mut ours = objects(machine);
    ours.retain(|(name, _)| name.starts_with(PREFIX) && !name.ends_with(KEPT));
    if ours.is_empty() {
        return;
    }
    for pid in root
        .names("/proc")
        .iter()
        .filter(|name| name.bytes().all(|byte| byte.is_ascii_digit()))
    {
        let maps = root.text(&format!("/proc/{pid}/maps"));
        let maps_it = |name: &str| maps.contains(&format!("{FOLDER}/{name}"));
        // A process of ours whose maps cannot be read may have any of them.
        let is_hidden = maps.is_empty()
            && root
                .text(&format!("/proc/{pid}/comm"))
                .starts_with("torque");
        if is_hidden {
            return;
        }
        // What a living process has is of one run directory: all with that beginning are in use.
        let used: Vec<String> = ours
            .iter()
            .filter(|(name, _)| maps_it(name))
            .map(|(name, _)| directory(name))
            .collect();
        ours.retain(|(name, _)| !used.contains(&directory(name)));
    }
    if ours.is_empty() {
        return;
    }
    let bytes: u64 = ours.iter().map(|(_, bytes)| bytes).sum();
    let paths: Vec<String> = ours
        .into_iter()
        .map(|(name, _)| format!("{FOLDER}/{name}"))
        .collect();
    findings.warning(
        "shm-leftovers",
        format!(
            "{} objects in {FOLDER} ({} kB) belong to no process",
            paths.len(),
            bytes >> 10
        ),
        "processes that were killed left them: memory that nobody gets",
        format!("rm {}", paths.join(" ")),
    );
    findings.fixed_by(Fix::Remove(paths));
}

/// The part of an object's name that all of a run directory have.
fn directory(name: &str) -> String {
    name.splitn(4, '_').take(3).collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::{bytes, directory};

    #[test]
    fn sizes_are_those_of_mount_options() {
        assert_eq!(bytes("65536k"), Some(64 << 20));
        assert_eq!(bytes("1g"), Some(1 << 30));
        assert_eq!(bytes("512"), Some(512));
        assert_eq!(bytes("50%"), None);
    }

    #[test]
    fn objects_of_one_run_directory_begin_alike() {
        assert_eq!(
            directory("torqued_0123abcd_ff00_x_y"),
            "torqued_0123abcd_ff00"
        );
    }
}
