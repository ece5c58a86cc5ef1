//! The processor: clock rates, sleep, siblings, and what the firmware does behind the kernel's back.

use super::finding::Findings;
use super::machine::{Machine, cpus, list};
use std::fs::File;
use std::os::unix::fs::FileExt;

const CPU: &str = "/sys/devices/system/cpu";
/// An idle state that takes longer to leave shows in the wake-ups of a 1 kHz loop, us.
const WAKE_US: f64 = 10.0;
/// `MSR_SMI_COUNT` of Intel's processors (Software Developer's Manual, volume 4).
const SMI_COUNT: u64 = 0x34;
/// System management interrupts that are borne, per second of uptime: one a minute.
const SMI_RATE: f64 = 1.0 / 60.0;

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    governor(machine, findings);
    idle_states(machine, findings);
    siblings(machine, findings);
    throttled(machine, findings);
    firmware(machine, findings);
    let info = machine.root.text("/proc/cpuinfo");
    let is_virtual = info.lines().any(|line| {
        line.starts_with("flags") && line.split_whitespace().any(|flag| flag == "hypervisor")
    });
    if is_virtual {
        findings.warning(
            "virtual-machine",
            "this is a virtual machine",
            "its host takes the CPUs away for milliseconds, which nothing here can prevent",
            "run robots on a machine of their own",
        );
    }
}

/// The CPUs whose folders there are.
fn folders(machine: &Machine) -> Vec<usize> {
    let names = machine.root.names(CPU);
    let numbers = names
        .iter()
        .filter_map(|name| name.strip_prefix("cpu")?.parse().ok());
    numbers.collect()
}

fn governor(machine: &Machine, findings: &mut Findings) {
    let governor = |cpu: &usize| format!("{CPU}/cpu{cpu}/cpufreq/scaling_governor");
    let slow = folders(machine).into_iter().filter(|cpu| {
        let name = machine.root.text(&governor(cpu));
        !name.is_empty() && name != "performance"
    });
    let slow: Vec<usize> = slow.collect();
    if slow.is_empty() {
        return;
    }
    let what = format!(
        "CPUs {} change their clock rate with the load",
        list(&slow.iter().copied().collect())
    );
    let why = "a loop that sleeps most of the time runs at the lowest rate: cycles take two to four times longer";
    let texts = slow
        .iter()
        .map(|cpu| (governor(cpu), "performance".to_owned()));
    findings.writable("governor", what, why, texts.collect());
}

fn idle_states(machine: &Machine, findings: &mut Findings) {
    let cpu = machine.loop_cpu().unwrap_or(0);
    let at = format!("{CPU}/cpu{cpu}/cpuidle");
    let deepest = machine.root.names(&at).into_iter().filter_map(|state| {
        let number = |file: &str| machine.root.number(&format!("{at}/{state}/{file}"));
        (number("disable") != Some(1.0)).then_some(number("latency")?)
    });
    let deepest = deepest.fold(0.0, f64::max);
    if deepest <= WAKE_US {
        return;
    }
    // The daemon holds the file open and so keeps all CPUs awake, where it may.
    const FILE: &str = "/dev/cpu_dma_latency";
    if machine.account().may_write(&machine.root, FILE) {
        return;
    }
    findings.warning(
        "idle-states",
        format!("CPU {cpu} has idle states that take {deepest:.0} us to leave, and the daemon may not open {FILE}"),
        "each cycle begins that much late",
        "udev rule: KERNEL==\"cpu_dma_latency\", GROUP=\"torqued\", MODE=\"0660\" (the package brings it); or \
         cpupower idle-set -D 10",
    );
}

fn siblings(machine: &Machine, findings: &mut Findings) {
    let Some(cpu) = machine.loop_cpu() else {
        return;
    };
    let text = machine
        .root
        .text(&format!("{CPU}/cpu{cpu}/topology/thread_siblings_list"));
    let mut others = cpus(&text);
    others.remove(&cpu);
    let online = cpus(&machine.root.text(&format!("{CPU}/online")));
    others.retain(|other| online.contains(other));
    if let Some(other) = others.first() {
        findings.warning(
            "smt",
            format!("CPU {cpu} of the loop shares its core with CPU {other}"),
            "what runs there takes up to half of the core's units and caches",
            format!("echo 0 > {CPU}/cpu{other}/online, or SMT off in the BIOS"),
        );
    }
}

fn throttled(machine: &Machine, findings: &mut Findings) {
    let count = |cpu: usize| {
        machine.root.number(&format!(
            "{CPU}/cpu{cpu}/thermal_throttle/core_throttle_count"
        ))
    };
    let hot = folders(machine)
        .into_iter()
        .filter(|&cpu| count(cpu).is_some_and(|count| count > 0.0));
    let hot: Vec<usize> = hot.collect();
    if !hot.is_empty() {
        findings.warning(
            "thermal-throttling",
            format!("CPUs {} were throttled for heat since boot", list(&hot.into_iter().collect())),
            "a hot processor runs at a fraction of its rate: cycles are late just when the robot works hard",
            "clean or improve the cooling; sensors shows temperatures",
        );
    }
}

/// System management interrupts: they stop all CPUs, and no kernel sees them.
fn firmware(machine: &Machine, findings: &mut Findings) {
    let info = machine.root.text("/proc/cpuinfo");
    if !info.contains("GenuineIntel") {
        return;
    }
    let mut count = [0_u8; 8];
    let read = File::open(machine.root.path("/dev/cpu/0/msr"))
        .and_then(|file| file.read_exact_at(&mut count, SMI_COUNT));
    if read.is_err() {
        findings.not_seen("system management interrupts: as root, after `modprobe msr`");
        return;
    }
    let uptime = machine.root.text("/proc/uptime");
    let uptime = uptime
        .split_whitespace()
        .next()
        .and_then(|seconds| seconds.parse::<f64>().ok());
    // The counter has 32 bits.
    let count = u64::from_le_bytes(count) & 0xffff_ffff;
    let Some(uptime) = uptime.filter(|&seconds| count as f64 > SMI_RATE * seconds && count > 1)
    else {
        return;
    };
    findings.warning(
        "smi",
        format!("{count} system management interrupts in {uptime:.0} s"),
        "the firmware stops all CPUs for 0.1 ms and more, and no kernel can prevent it",
        "in the BIOS: USB legacy support, power management and temperature control by the firmware off",
    );
}
