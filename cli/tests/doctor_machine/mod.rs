//! A machine of files, as `/proc`, `/sys` and `/etc` of a robot's PC with four CPUs and two CAN adapters have them.

use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::PathBuf;
use std::process::{Command, Output};
use test_support::{TemporaryDirectory, project_path};

pub(crate) struct Machine {
    directory: TemporaryDirectory,
}

impl Machine {
    /// One on which nothing is wrong.
    pub(crate) fn good() -> Self {
        let machine = Self {
            directory: TemporaryDirectory::new(),
        };
        machine.kernel();
        machine.processor();
        machine.service();
        machine.can();
        machine.configuration();
        machine
    }

    fn path(&self, file: &str) -> PathBuf {
        self.directory.path().join(file)
    }

    pub(crate) fn write(&self, file: &str, text: &str) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    pub(crate) fn read(&self, file: &str) -> String {
        fs::read_to_string(self.path(file)).unwrap()
    }

    pub(crate) fn change(&self, file: &str, from: &str, to: &str) {
        let text = self.read(file);
        assert!(text.contains(from), "{file} lacks {from:?}");
        self.write(file, &text.replacen(from, to, 1));
    }

    pub(crate) fn remove(&self, file: &str) {
        fs::remove_file(self.path(file)).unwrap();
    }

    pub(crate) fn remove_folder(&self, folder: &str) {
        fs::remove_dir_all(self.path(folder)).unwrap();
    }

    pub(crate) fn mode(&self, file: &str, mode: u32) {
        fs::set_permissions(self.path(file), PermissionsExt::from_mode(mode)).unwrap();
    }

    /// Changes the configuration that the command line names; the leg's.
    pub(crate) fn change_config(&self, from: &str, to: &str) {
        self.change("config/leg/robot.toml", from, to);
    }

    /// Exit code and JSON.
    pub(crate) fn doctor(&self, arguments: &[&str]) -> (i32, Value) {
        let output = self.torquectl(arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        let page = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{message}"));
        (output.status.code().unwrap(), page)
    }

    pub(crate) fn torquectl(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
        command
            .args(["doctor", "--json", "--root"])
            .arg(self.directory.path());
        command
            .arg(self.path("config/leg/robot.toml"))
            .args(arguments);
        command.output().unwrap()
    }

    fn kernel(&self) {
        self.write(
            "proc/version",
            "Linux version 6.12.48+deb13-rt-amd64 #1 SMP PREEMPT_RT Debian",
        );
        self.write(
            "proc/cmdline",
            "root=/dev/sda1 ro quiet isolcpus=3 nohz_full=3 rcu_nocbs=3",
        );
        self.write("sys/kernel/realtime", "1");
        self.write("proc/sys/kernel/sched_rt_runtime_us", "950000");
        self.write("proc/sys/kernel/sched_rt_period_us", "1000000");
        self.write("proc/sys/kernel/numa_balancing", "0");
        self.write(
            "proc/self/timens_offsets",
            "monotonic           0         0\nboottime            0         0",
        );
        let clock = "sys/devices/system/clocksource/clocksource0";
        self.write(&format!("{clock}/current_clocksource"), "tsc");
        self.write(
            &format!("{clock}/available_clocksource"),
            "tsc hpet acpi_pm",
        );
        self.write("proc/meminfo", "MemTotal:       16000000 kB\nMemFree:         300000 kB\nMemAvailable:    6000000 kB\n");
        self.write(
            "proc/mounts",
            "tmpfs /dev/shm tmpfs rw,nosuid,nodev,size=262144k 0 0\n",
        );
        fs::create_dir_all(self.path("dev/shm")).unwrap();
        self.write("proc/uptime", "86400.00 300000.00");
        self.write(
            "proc/self/limits",
            "Limit                     Soft Limit           Hard Limit           Units\n\
            Max locked memory         unlimited            unlimited            bytes\n\
            Max realtime priority     98                   98\n",
        );
        self.write(
            "proc/self/status",
            "Name:\ttorquectl\nUid:\t1000\t1000\t1000\t1000\nGid:\t1000\t1000\t1000\t1000\n\
            Groups:\t27 1000\nCapEff:\t0000000000000000\n",
        );
        self.process(2, "kthreadd", 2, 0x0020_8040, 99, 1);
        self.process(77, "torqued", 78, 0, 80, 1);
    }

    /// A process with one thread beside its first: `policy` 0 normal, 1 FIFO.
    pub(crate) fn process(
        &self,
        pid: u32,
        name: &str,
        thread: u32,
        flags: u32,
        priority: u32,
        policy: u32,
    ) {
        self.write(
            &format!("proc/{pid}/maps"),
            "7f00-7f01 r-xp 0 00:1a 99 /usr/bin/a\n",
        );
        self.write(&format!("proc/{pid}/comm"), name);
        let at = format!("proc/{pid}/task/{thread}");
        self.write(&format!("{at}/comm"), "loop");
        // proc(5): fields 3 to 8, flags, 10 to 39, rt_priority, policy.
        let before = "0 ".repeat(30);
        self.write(
            &format!("{at}/stat"),
            &format!("{thread} (loop) S 1 1 1 0 -1 {flags} {before}{priority} {policy} 0 0"),
        );
        self.write(
            &format!("{at}/status"),
            "Cpus_allowed:\tf\nCpus_allowed_list:\t0-3\n",
        );
    }

    fn processor(&self) {
        let cpu = "sys/devices/system/cpu";
        self.write(
            "proc/cpuinfo",
            "vendor_id\t: GenuineIntel\nmodel name\t: Example\nflags\t\t: fpu vme\n",
        );
        self.interrupts_of_firmware(3);
        for (name, text) in [("online", "0-3"), ("isolated", "3"), ("nohz_full", "3")] {
            self.write(&format!("{cpu}/{name}"), text);
        }
        for number in 0..4 {
            let at = format!("{cpu}/cpu{number}");
            self.write(&format!("{at}/cpufreq/scaling_governor"), "performance");
            self.write(
                &format!("{at}/topology/thread_siblings_list"),
                &number.to_string(),
            );
            self.write(&format!("{at}/thermal_throttle/core_throttle_count"), "0");
            for (state, latency) in [(0, 0), (1, 2), (2, 133)] {
                self.write(
                    &format!("{at}/cpuidle/state{state}/latency"),
                    &latency.to_string(),
                );
                self.write(&format!("{at}/cpuidle/state{state}/disable"), "0");
            }
        }
        self.write("dev/cpu_dma_latency", "");
        self.mode("dev/cpu_dma_latency", 0o666);
        self.write(
            "proc/interrupts",
            "           CPU0       CPU1       CPU2       CPU3\n\
             0:         44          0          0          0  IO-APIC   2-edge      timer\n\
            40:       9000        100          7          5  PCI-MSI 512-edge      nvme0q1\n\
            42:          0    5000000          0         11  PCI-MSI 524288-edge      can0\n\
            LOC:     1000       1000       1000       1000   Local timer interrupts\n",
        );
        for number in [0, 40, 42] {
            self.write(&format!("proc/irq/{number}/smp_affinity_list"), "0-2");
        }
    }

    /// The processor's count of system management interrupts.
    pub(crate) fn interrupts_of_firmware(&self, count: u64) {
        let mut registers = vec![0_u8; 0x34];
        registers.extend(count.to_le_bytes());
        let path = self.path("dev/cpu/0/msr");
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, registers).unwrap();
    }

    fn service(&self) {
        let unit = fs::read_to_string(project_path("systemd/torqued@.service")).unwrap();
        self.write("usr/lib/systemd/system/torqued@.service", &unit);
        let wants = self.path("etc/systemd/system/multi-user.target.wants");
        fs::create_dir_all(&wants).unwrap();
        symlink(
            "/usr/lib/systemd/system/torqued@.service",
            wants.join("torqued@leg.service"),
        )
        .unwrap();
        self.write(
            "etc/torqued/leg/robot.toml",
            "# not read here: the command line names another one\n",
        );
        for folder in ["run/torqued", "var/lib/torqued"] {
            fs::create_dir_all(self.path(folder)).unwrap();
            self.mode(folder, 0o700);
        }
        // The folders' owner is whoever runs the tests; as root, given away so that rights count.
        let own = fs::metadata(self.path("run/torqued")).unwrap().uid();
        let user = if own == 0 { 998 } else { own };
        if own == 0 {
            for file in [
                "run/torqued",
                "var/lib/torqued",
                "etc/torqued/leg/robot.toml",
            ] {
                std::os::unix::fs::chown(self.path(file), Some(user), Some(user)).unwrap();
            }
            // Read by others' right, so that the right can be taken.
            std::os::unix::fs::chown(self.path("etc/torqued/leg/robot.toml"), Some(0), Some(0))
                .unwrap();
        }
        self.write(
            "etc/passwd",
            &format!(
                "root:x:0:0::/root:/bin/sh\ntorqued:x:{user}:{user}::/var/lib/torqued:/bin/false\n"
            ),
        );
        self.write("etc/group", &format!("root:x:0:\ntorqued:x:{user}:\n"));
    }

    /// A drop-in of the unit.
    pub(crate) fn drop_in(&self, lines: &str) {
        self.write(
            "etc/systemd/system/torqued@.service.d/override.conf",
            &format!("[Service]\n{lines}\n"),
        );
    }

    fn can(&self) {
        for name in ["can0", "can1"] {
            let at = format!("sys/class/net/{name}");
            self.write(&format!("{at}/type"), "280\n");
            self.write(
                &format!("sys/devices/pci0000:00/{name}/irq"),
                if name == "can0" { "42" } else { "0" },
            );
            self.driver(name, "kvaser_pciefd");
            symlink(
                self.path(&format!("sys/devices/pci0000:00/{name}")),
                self.path(&format!("{at}/device")),
            )
            .unwrap();
        }
        let links = [
            link("can0"),
            link("can1"),
            json!({ "ifname": "lo", "link_type": "loopback" }),
        ];
        self.write("ip-link.json", &json!(links).to_string());
    }

    pub(crate) fn driver(&self, interface: &str, driver: &str) {
        let place = self.path(&format!("sys/devices/pci0000:00/{interface}/driver"));
        let _ = fs::remove_file(&place);
        symlink(format!("../../../bus/pci/drivers/{driver}"), place).unwrap();
    }

    /// Puts the adapter on USB, with its power management.
    pub(crate) fn usb(&self, interface: &str, control: &str) {
        let device = format!("sys/devices/pci0000:00/usb1/1-1/{interface}");
        self.write(&format!("{device}/power/control"), control);
        let link = self.path(&format!("sys/class/net/{interface}/device"));
        fs::remove_file(&link).unwrap();
        symlink(self.path(&device), link).unwrap();
    }

    /// Changes what `ip` shows of can0.
    pub(crate) fn link(&self, change: impl Fn(&mut Value)) {
        let mut links: Value = serde_json::from_str(&self.read("ip-link.json")).unwrap();
        change(&mut links[0]);
        self.write("ip-link.json", &links.to_string());
    }

    /// The leg, on CPU 3 and real CAN.
    fn configuration(&self) {
        for file in [
            "config/leg/robot.toml",
            "robot-models/leg/robot.urdf",
            "robot-models/leg/drives.dbc",
        ] {
            self.write(file, &fs::read_to_string(project_path(file)).unwrap());
        }
        self.change_config("priority = 80", "priority = 80\ncpu = 3");
        self.change_config("vcan0", "can0");
        self.change_config("vcan1", "can1");
    }
}

/// As iproute2 6.1 prints a controller that works (`ip/iplink_can.c`).
fn link(name: &str) -> Value {
    json!({
        "ifname": name,
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "mtu": 16,
        "txqlen": 128,
        "link_type": "can",
        "linkinfo": {
            "info_kind": "can",
            "info_data": {
                "state": "ERROR-ACTIVE",
                "berr_counter": { "tx": 0, "rx": 0 },
                "restart_ms": 100,
                "bittiming": { "bitrate": 1_000_000, "sample_point": "0.750", "sjw": 1 },
                "clock": 80_000_000,
            },
            "info_xstats": { "restarts": 0, "bus_error": 0, "arbitration_lost": 0, "error_warning": 0, "error_passive": 0, "bus_off": 0 },
        },
        "stats64": { "rx": { "packets": 9, "errors": 0, "dropped": 0, "over_errors": 0 } },
    })
}
