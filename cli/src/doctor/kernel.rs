//! The kernel: how soon it wakes a real-time thread, and by which clock.

use super::finding::Findings;
use super::machine::{Machine, cpus, field};

const CLOCK: &str = "/sys/devices/system/clocksource/clocksource0";
/// Clock sources that take a microsecond and more to read, or drift.
const SLOW_CLOCKS: [&str; 6] = [
    "hpet",
    "acpi_pm",
    "jiffies",
    "refined-jiffies",
    "pit",
    "tsc-early",
];
/// Share of each period that the kernel leaves to real-time threads by default.
const RT_SHARE: f64 = 0.95;
/// Memory that should be free when the daemon locks its own, bytes: it holds 5 s of records of a humanoid.
const FREE_MEMORY: f64 = 256e6;
/// `PF_KTHREAD` of the kernel's `sched.h`.
const KERNEL_THREAD: u64 = 0x0020_0000;

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    preemption(machine, findings);
    throttling(machine, findings);
    clock(machine, findings);
    isolation(machine, findings);
    memory(machine, findings);
    other_real_time_threads(machine, findings);
}

fn preemption(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let version = root.text("/proc/version");
    let is_real_time = root.text("/sys/kernel/realtime") == "1" || version.contains("PREEMPT_RT");
    if version.is_empty() {
        findings.not_seen("the kernel: /proc/version cannot be read");
    } else if !is_real_time {
        findings.warning(
            "preemption",
            "the kernel is not a real-time kernel (PREEMPT_RT)",
            "interrupts and system calls of other programs delay the loop by up to several milliseconds",
            "apt install linux-image-rt-amd64 (Debian), pro enable realtime-kernel (Ubuntu), then reboot",
        );
    }
    let words = root.text("/proc/cmdline");
    let mode = words
        .split_whitespace()
        .find_map(|word| word.strip_prefix("preempt="));
    if let Some(mode @ ("none" | "voluntary")) = mode {
        findings.warning(
            "preempt-mode",
            format!("the kernel was booted with preempt={mode}"),
            "system calls of other programs are not interrupted for the loop",
            "in /etc/default/grub take preempt= out of GRUB_CMDLINE_LINUX, update-grub, reboot",
        );
    }
}

fn throttling(machine: &Machine, findings: &mut Findings) {
    let number = |name: &str| machine.root.number(&format!("/proc/sys/kernel/{name}"));
    let (Some(runtime), Some(period)) =
        (number("sched_rt_runtime_us"), number("sched_rt_period_us"))
    else {
        findings.not_seen("throttling of real-time threads: /proc/sys/kernel/sched_rt_runtime_us");
        return;
    };
    // -1: real-time threads are never stopped.
    if runtime < 0.0 || runtime >= RT_SHARE * period {
        return;
    }
    findings.writable(
        "rt-throttling",
        format!("real-time threads may run {runtime:.0} us of every {period:.0} us"),
        "a loop that takes more is stopped for the rest of the period",
        vec![(
            "/proc/sys/kernel/sched_rt_runtime_us".into(),
            format!("{:.0}", RT_SHARE * period),
        )],
    );
}

fn clock(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let current = root.text(&format!("{CLOCK}/current_clocksource"));
    if SLOW_CLOCKS.contains(&current.as_str()) {
        let what = format!("the clock source is {current}");
        let why = "each reading of the clock costs microseconds, and the loop reads it several times a cycle";
        let available = root.text(&format!("{CLOCK}/available_clocksource"));
        if available.split_whitespace().any(|name| name == "tsc") {
            let texts = vec![(format!("{CLOCK}/current_clocksource"), "tsc".to_owned())];
            findings.writable("clock-source", what, why, texts);
        } else {
            let mend = "dmesg | grep -i tsc says why the kernel does not trust tsc; often a BIOS update mends it";
            findings.warning("clock-source", what, why, mend);
        }
    }
    let offsets = root.text("/proc/self/timens_offsets");
    let shifted = |line: &str| line.split_whitespace().skip(1).any(|number| number != "0");
    if offsets
        .lines()
        .any(|line| line.starts_with("monotonic") && shifted(line))
    {
        findings.error(
            "time-namespace",
            "this shell has a time namespace of its own",
            "clients and daemon must share one CLOCK_MONOTONIC: references look late or from the future",
            "start clients without unshare --time; for a container, without a time namespace",
        );
    }
}

fn isolation(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let of = |name: &str| cpus(&root.text(&format!("/sys/devices/system/cpu/{name}")));
    let (online, isolated) = (of("online"), of("isolated"));
    let Some(cpu) = machine.loop_cpu() else {
        if let Some(first) = isolated.first() {
            findings.warning(
                "loop-cpu",
                "there are isolated CPUs, and the configuration names none of them in loop.cpu",
                "the loop shares a CPU with all other programs",
                format!("cpu = {first} in [loop] of the robot's configuration"),
            );
        }
        return;
    };
    if !online.is_empty() && !online.contains(&cpu) {
        findings.error(
            "cpu-online",
            format!("loop.cpu is {cpu}, which is not online"),
            "the loop cannot be bound to it",
            format!("echo 1 > /sys/devices/system/cpu/cpu{cpu}/online, or another loop.cpu"),
        );
        return;
    }
    let boot = "to GRUB_CMDLINE_LINUX in /etc/default/grub, update-grub, reboot";
    if !isolated.contains(&cpu) {
        findings.warning(
            "isolated-cpu",
            format!("CPU {cpu} of the loop is not isolated"),
            "other programs run on it, and leave its caches cold",
            format!("isolcpus={cpu} {boot}"),
        );
    }
    if !of("nohz_full").contains(&cpu) {
        findings.warning(
            "nohz-full",
            format!("CPU {cpu} of the loop has the kernel's periodic tick"),
            "the tick and the kernel's own work on that CPU delay the loop",
            format!("nohz_full={cpu} rcu_nocbs={cpu} {boot}"),
        );
    }
}

fn memory(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    if root.number("/proc/sys/kernel/numa_balancing") == Some(1.0) {
        findings.writable(
            "numa-balancing",
            "the kernel moves memory between nodes by itself",
            "it takes pages away to see who uses them: page faults in the loop",
            vec![("/proc/sys/kernel/numa_balancing".into(), "0".into())],
        );
    }
    let text = root.text("/proc/meminfo");
    let available = field(&text, "MemAvailable").and_then(|value| value.strip_suffix(" kB"));
    let available = available.and_then(|value| value.parse::<f64>().ok());
    if let Some(bytes) = available.map(|kilobytes| 1024.0 * kilobytes)
        && bytes < FREE_MEMORY
    {
        findings.error(
            "memory",
            format!("{:.0} MB of memory are available", 1e-6 * bytes),
            "the daemon locks its memory and does not start without; clients are ended by the kernel",
            "ps aux --sort=-rss | head shows who has it",
        );
    }
}

/// Threads of other programs that the loop does not interrupt.
fn other_real_time_threads(machine: &Machine, findings: &mut Findings) {
    let own = machine.loop_priority();
    for (program, pid) in machine.programs() {
        if program.starts_with("torque") {
            continue;
        }
        for tid in machine.root.names(&format!("/proc/{pid}/task")) {
            let at = format!("/proc/{pid}/task/{tid}");
            let Some(thread) = Thread::read(machine, &at) else {
                continue;
            };
            let shares = machine
                .loop_cpu()
                .is_none_or(|cpu| thread.cpus.contains(&cpu));
            if thread.is_real_time
                && !thread.is_kernels
                && thread.priority >= u64::from(own)
                && shares
            {
                findings.warning(
                    "rival",
                    format!(
                        "{program} (process {pid}) has a real-time thread of priority {}",
                        thread.priority
                    ),
                    "the loop waits while that thread runs on its CPU",
                    format!(
                        "chrt -f -p {} {tid}, or a loop.priority above it",
                        u64::from(own).saturating_sub(1)
                    ),
                );
                break;
            }
        }
    }
}

/// What the kernel says of a thread.
pub(super) struct Thread {
    pub(super) is_real_time: bool,
    pub(super) priority: u64,
    is_kernels: bool,
    cpus: std::collections::BTreeSet<usize>,
}

impl Thread {
    /// The thread whose files lie in that folder of /proc.
    pub(super) fn read(machine: &Machine, at: &str) -> Option<Self> {
        let stat = machine.root.text(&format!("{at}/stat"));
        // The name may contain spaces; proc(5) counts fields from 1, and the one behind the name is the third.
        let (_, after_name) = stat.rsplit_once(')')?;
        let fields: Vec<&str> = after_name.split_whitespace().collect();
        let field_of = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
        let status = machine.root.text(&format!("{at}/status"));
        // 1: SCHED_FIFO, 2: SCHED_RR.
        let is_real_time = matches!(field_of(41)?, 1 | 2);
        Some(Self {
            is_real_time,
            priority: field_of(40)?,
            is_kernels: field_of(9)? & KERNEL_THREAD != 0,
            cpus: cpus(field(&status, "Cpus_allowed_list").unwrap_or_default()),
        })
    }
}
