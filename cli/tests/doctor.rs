//! `torquectl doctor` on machines of files: a good one, and the same with one defect each.

use crate::doctor_machine;

use doctor_machine::Machine;

/// A change of the good machine, and the name of the finding that it must lead to.
type Seeded = (&'static str, fn(&Machine));

const KERNEL: &[Seeded] = &[
    ("preemption", |m| {
        m.write("sys/kernel/realtime", "0");
        m.change("proc/version", "PREEMPT_RT", "PREEMPT_DYNAMIC");
    }),
    ("preempt-mode", |m| {
        m.change("proc/cmdline", "quiet", "preempt=voluntary")
    }),
    ("rt-throttling", |m| {
        m.write("proc/sys/kernel/sched_rt_runtime_us", "500000")
    }),
    ("clock-source", |m| {
        m.write(
            "sys/devices/system/clocksource/clocksource0/current_clocksource",
            "hpet",
        )
    }),
    ("time-namespace", |m| {
        m.write(
            "proc/self/timens_offsets",
            "monotonic           7         0\nboottime            0         0",
        )
    }),
    ("cpu-online", |m| {
        m.write("sys/devices/system/cpu/online", "0-2")
    }),
    ("isolated-cpu", |m| {
        m.write("sys/devices/system/cpu/isolated", "")
    }),
    ("nohz-full", |m| {
        m.write("sys/devices/system/cpu/nohz_full", "(null)")
    }),
    ("loop-cpu", |m| m.change_config("cpu = 3", "")),
    ("memory", |m| {
        m.change(
            "proc/meminfo",
            "MemAvailable:    6000000",
            "MemAvailable:     100000",
        )
    }),
    ("numa-balancing", |m| {
        m.write("proc/sys/kernel/numa_balancing", "1")
    }),
    ("rival", |m| m.process(900, "jackd", 900, 0, 85, 1)),
];

const PROCESSOR: &[Seeded] = &[
    ("governor", |m| {
        m.write(
            "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor",
            "powersave",
        )
    }),
    ("idle-states", |m| m.mode("dev/cpu_dma_latency", 0o600)),
    ("smt", |m| {
        m.write(
            "sys/devices/system/cpu/cpu3/topology/thread_siblings_list",
            "1,3",
        )
    }),
    ("thermal-throttling", |m| {
        m.write(
            "sys/devices/system/cpu/cpu1/thermal_throttle/core_throttle_count",
            "17",
        )
    }),
    ("smi", |m| m.interrupts_of_firmware(9_000)),
    ("virtual-machine", |m| {
        m.change("proc/cpuinfo", "fpu vme", "fpu vme hypervisor")
    }),
    ("interrupt", |m| {
        m.write("proc/irq/40/smp_affinity_list", "0-3")
    }),
    ("can-interrupt", |m| {
        m.write("proc/irq/42/smp_affinity_list", "0-3")
    }),
];

const SERVICE: &[Seeded] = &[
    ("unit-rtprio", |m| {
        m.drop_in("LimitRTPRIO=10\nAmbientCapabilities=\nAmbientCapabilities=CAP_IPC_LOCK")
    }),
    ("unit-memlock", |m| {
        m.drop_in("LimitMEMLOCK=64K\nAmbientCapabilities=\nAmbientCapabilities=CAP_SYS_NICE")
    }),
    ("unit-quota", |m| m.drop_in("CPUQuota=20%")),
    ("unit-watchdog", |m| m.drop_in("WatchdogSec=0")),
    ("user", |m| m.change("etc/passwd", "torqued:", "somebody:")),
    ("configuration", |m| m.remove("etc/torqued/leg/robot.toml")),
    ("configuration-access", |m| {
        m.mode("etc/torqued/leg/robot.toml", 0o600)
    }),
    ("state-directory", |m| m.mode("var/lib/torqued", 0o000)),
    ("run-directory", |m| m.mode("run/torqued", 0o777)),
    ("run-directory-owner", |m| {
        m.change("etc/passwd", "torqued:x:", "torqued:x:1");
        m.mode("var/lib/torqued", 0o777);
    }),
    ("loop-scheduler", |m| m.process(77, "torqued", 78, 0, 0, 0)),
    ("rtprio", |m| {
        m.remove("usr/lib/systemd/system/torqued@.service");
        m.change(
            "proc/self/limits",
            "Max realtime priority     98 ",
            "Max realtime priority     0 ",
        );
    }),
    ("memlock", |m| {
        m.remove("usr/lib/systemd/system/torqued@.service");
        m.change(
            "proc/self/limits",
            "Max locked memory         unlimited",
            "Max locked memory         8388608 ",
        );
    }),
];

const SHARED_MEMORY: &[Seeded] = &[
    ("shm", |m| m.remove_folder("dev/shm")),
    ("shm-size", |m| {
        m.change("proc/mounts", "size=262144k", "size=4096k")
    }),
    ("shm-leftovers", |m| {
        m.write("dev/shm/torqued_0123abcd_00ff_node", "left")
    }),
];

const CAN: &[Seeded] = &[
    ("can-missing", |m| m.remove_folder("sys/class/net/can1")),
    ("can-down", |m| {
        m.link(|can0| can0["flags"] = serde_json::json!(["NOARP", "ECHO"]))
    }),
    ("can-bus-off", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["state"] = "BUS-OFF".into())
    }),
    ("can-state", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["state"] = "ERROR-PASSIVE".into())
    }),
    ("can-errors", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["berr_counter"]["tx"] = 88.into())
    }),
    ("can-history", |m| {
        m.link(|can0| can0["linkinfo"]["info_xstats"]["bus_off"] = 2.into())
    }),
    ("can-mode", |m| {
        m.link(|can0| {
            can0["linkinfo"]["info_data"]["ctrlmode"] = serde_json::json!(["LISTEN-ONLY"])
        })
    }),
    ("can-restart", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["restart_ms"] = 0.into())
    }),
    ("can-bit-rate", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["bittiming"] = serde_json::json!({}))
    }),
    ("can-sample-point", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["bittiming"]["sample_point"] = "0.500".into())
    }),
    ("can-load", |m| {
        m.link(|can0| can0["linkinfo"]["info_data"]["bittiming"]["bitrate"] = 125_000.into())
    }),
    ("can-deadline", |m| {
        m.change_config("gather_deadline_us = 750.0", "gather_deadline_us = 300.0")
    }),
    ("can-fd", |m| m.change_config("fd = false", "fd = true")),
    ("can-overrun", |m| {
        m.link(|can0| can0["stats64"]["rx"]["over_errors"] = 31.into())
    }),
    ("can-queue", |m| m.link(|can0| can0["txqlen"] = 4.into())),
    ("can-adapter", |m| m.driver("can0", "slcan")),
    ("can-power", |m| m.usb("can0", "auto")),
];

#[test]
fn nothing_is_found_on_a_good_machine() {
    let machine = Machine::good();
    let (code, page) = machine.doctor(&[]);
    assert_eq!(
        (code, page["findings"].as_array().unwrap().len()),
        (0, 0),
        "{page:#}"
    );
    assert_eq!(page["not_seen"].as_array().unwrap().len(), 0, "{page:#}");
}

/// Every defect leads to its own finding and to no other.
fn each_is_found(seeded: &[Seeded]) {
    for (name, seed) in seeded {
        let machine = Machine::good();
        seed(&machine);
        let (code, page) = machine.doctor(&[]);
        let found = page["findings"].as_array().unwrap();
        let mut ids: Vec<_> = found
            .iter()
            .map(|finding| finding["id"].as_str().unwrap())
            .collect();
        // One for each bus or CPU that has it.
        ids.dedup();
        assert_eq!((code, ids.as_slice()), (1, [*name].as_slice()), "{page:#}");
        for part in ["what", "why", "mend"] {
            assert!(
                found[0][part].as_str().is_some_and(|text| text.len() > 8),
                "{page:#}"
            );
        }
    }
}

#[test]
fn defects_of_the_kernel_are_found() {
    each_is_found(KERNEL);
}

#[test]
fn defects_of_the_processor_are_found() {
    each_is_found(PROCESSOR);
}

#[test]
fn defects_of_the_service_are_found() {
    each_is_found(SERVICE);
}

#[test]
fn defects_of_shared_memory_are_found() {
    each_is_found(SHARED_MEMORY);
}

#[test]
fn defects_of_can_are_found() {
    each_is_found(CAN);
}

#[test]
fn what_is_safe_is_fixed_and_looked_at_again() {
    let machine = Machine::good();
    machine.write(
        "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor",
        "powersave",
    );
    machine.write("proc/irq/40/smp_affinity_list", "0-3");
    machine.write("dev/shm/torqued_0123abcd_00ff_node", "left");
    machine.write("proc/sys/kernel/numa_balancing", "1");
    let (code, page) = machine.doctor(&["--fix"]);
    assert_eq!(
        (code, page["findings"].as_array().unwrap().len()),
        (0, 0),
        "{page:#}"
    );
    assert_eq!(page["fixed"].as_array().unwrap().len(), 4, "{page:#}");
    assert_eq!(
        machine.read("sys/devices/system/cpu/cpu2/cpufreq/scaling_governor"),
        "performance"
    );
    assert_eq!(machine.read("proc/irq/40/smp_affinity_list"), "0,1,2");
}

#[test]
fn what_a_reboot_does_not_undo_is_not_fixed() {
    let machine = Machine::good();
    machine.mode("run/torqued", 0o777);
    let (code, page) = machine.doctor(&["--fix"]);
    assert_eq!(
        (code, page["fixed"].as_array().unwrap().len()),
        (1, 0),
        "{page:#}"
    );
}

#[test]
fn shared_memory_of_a_living_process_is_no_leftover() {
    let machine = Machine::good();
    machine.write("dev/shm/torqued_0123abcd_00ff_node", "in use");
    machine.write("dev/shm/torqued_0123abcd_00ff_other", "of the same");
    machine.write("proc/4711/comm", "my_controller");
    machine.write(
        "proc/4711/maps",
        "7f00-7f01 rw-s 0 00:1a 99 /dev/shm/torqued_0123abcd_00ff_node\n",
    );
    assert_eq!(machine.doctor(&[]).0, 0);
}

#[test]
fn what_the_transport_keeps_for_the_next_start_is_no_leftover() {
    let machine = Machine::good();
    machine.write(
        "dev/shm/torqued_0123abcd_00ff_node.0_10_0.global_mgmt",
        "kept",
    );
    assert_eq!(machine.doctor(&[]).0, 0);
}

#[test]
fn a_configuration_that_is_wrong_is_bad_input() {
    let machine = Machine::good();
    machine.change_config("rate_hz = 1000.0", "rate_hz = -1.0");
    let output = machine.torquectl(&[]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.contains("rate_hz") && message.contains("allowed"),
        "{message}"
    );
}
