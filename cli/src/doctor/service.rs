//! The installed service: its unit, its user, its robots, and what that user may do.

use super::finding::Findings;
use super::kernel::Thread;
use super::machine::{Machine, Root, field};
use std::collections::BTreeSet;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;

const UNIT: &str = "torqued@.service";
/// Where systemd looks for units, the strongest first.
const UNIT_FOLDERS: [&str; 3] = [
    "/etc/systemd/system",
    "/usr/lib/systemd/system",
    "/lib/systemd/system",
];
const RUN_DIRECTORY: &str = "/run/torqued";
const STATE_DIRECTORY: &str = "/var/lib/torqued";
/// Mode bits that let others than the owner write.
const OTHERS_WRITE: u32 = 0o022;

/// The unit as systemd reads it, with its drop-ins, and the robots that it starts at boot.
pub(super) struct Service {
    unit: String,
    pub(super) robots: Vec<String>,
}

impl Service {
    /// None where no unit is installed.
    pub(super) fn find(root: &Root) -> Option<Self> {
        let folder = UNIT_FOLDERS
            .iter()
            .find(|folder| root.exists(&format!("{folder}/{UNIT}")))?;
        let mut unit = root.text(&format!("{folder}/{UNIT}"));
        let drop_ins = format!("/etc/systemd/system/{UNIT}.d");
        for name in root
            .names(&drop_ins)
            .iter()
            .filter(|name| name.ends_with(".conf"))
        {
            unit.push('\n');
            unit.push_str(&root.text(&format!("{drop_ins}/{name}")));
        }
        Some(Self {
            unit,
            robots: enabled(root),
        })
    }

    /// A key's last value.
    fn value(&self, key: &str) -> Option<&str> {
        let lines = self.unit.lines().rev();
        let mut values = lines.filter_map(|line| line.trim().strip_prefix(key)?.strip_prefix('='));
        values.next().map(str::trim)
    }

    /// All values of a key that systemd merges; an empty one takes back those before it.
    fn merged(&self, key: &str) -> String {
        let lines = self.unit.lines();
        let values = lines.filter_map(|line| line.trim().strip_prefix(key)?.strip_prefix('='));
        values.fold(String::new(), |all, value| match value.trim() {
            "" => String::new(),
            value => format!("{all} {value}"),
        })
    }

    /// The only robot's configuration.
    pub(super) fn only_configuration(&self) -> Option<String> {
        let [robot] = self.robots.as_slice() else {
            return None;
        };
        Some(configuration(robot))
    }
}

fn configuration(robot: &str) -> String {
    format!("/etc/torqued/{robot}/robot.toml")
}

fn enabled(root: &Root) -> Vec<String> {
    const SYSTEM: &str = "/etc/systemd/system";
    let wants = root
        .names(SYSTEM)
        .into_iter()
        .filter(|name| name.ends_with(".wants"));
    let units = wants.flat_map(|folder| root.names(&format!("{SYSTEM}/{folder}")));
    let robots = units.filter_map(|unit| {
        let robot = unit.strip_prefix("torqued@")?.strip_suffix(".service")?;
        Some(robot.to_owned())
    });
    robots.collect()
}

/// Who the daemon runs as, and so what it may open.
pub(super) struct Account {
    name: String,
    user: u32,
    groups: BTreeSet<u32>,
}

impl Account {
    /// The user of that name; none where there is no such user.
    fn named(root: &Root, name: &str) -> Option<Self> {
        let users = root.text("/etc/passwd");
        let user = users
            .lines()
            .map(|line| line.split(':').collect::<Vec<_>>());
        let user = user
            .into_iter()
            .find(|fields| fields[0] == name && fields.len() > 3)?;
        let mut groups = BTreeSet::from([user[3].parse().ok()?]);
        for line in root.text("/etc/group").lines() {
            let fields: Vec<&str> = line.split(':').collect();
            let is_member = fields
                .get(3)
                .is_some_and(|members| members.split(',').any(|member| member == name));
            groups.extend(
                fields
                    .get(2)
                    .filter(|_| is_member)
                    .and_then(|number| number.parse::<u32>().ok()),
            );
        }
        Some(Self {
            name: name.to_owned(),
            user: user[2].parse().ok()?,
            groups,
        })
    }

    /// Whoever runs this program.
    fn own(root: &Root) -> Self {
        let status = root.text("/proc/self/status");
        let numbers = |key: &str| {
            let text = field(&status, key).unwrap_or_default().to_owned();
            text.split_whitespace()
                .filter_map(|number| number.parse().ok())
                .collect::<Vec<u32>>()
        };
        let user = numbers("Uid").get(1).copied().unwrap_or(u32::MAX);
        let mut groups: BTreeSet<u32> = numbers("Groups").into_iter().collect();
        groups.extend(numbers("Gid").get(1));
        Self {
            name: format!("user {user}"),
            user,
            groups,
        }
    }

    pub(super) fn may_write(&self, root: &Root, file: &str) -> bool {
        self.may(root, file, 0o2)
    }

    /// `bits`: of the last digit of a mode.
    fn may(&self, root: &Root, file: &str, bits: u32) -> bool {
        let Ok(data) = fs::metadata(root.path(file)) else {
            return false;
        };
        self.user == 0 || self.mode(&data) & bits == bits
    }

    /// The last digit of the mode, as it is for this user.
    fn mode(&self, data: &Metadata) -> u32 {
        let shift = match () {
            () if data.uid() == self.user => 6,
            () if self.groups.contains(&data.gid()) => 3,
            () => 0,
        };
        data.mode() >> shift & 0o7
    }
}

impl Machine {
    pub(super) fn account(&self) -> Account {
        self.service_account()
            .unwrap_or_else(|| Account::own(&self.root))
    }

    /// The service's user; none where there is no service or no such user.
    fn service_account(&self) -> Option<Account> {
        let user = self.service.as_ref()?.value("User").unwrap_or("root");
        Account::named(&self.root, user)
    }
}

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    match &machine.service {
        None => {
            findings
                .not_seen("the service: no unit torqued@.service is installed (docs/install.md)");
            own_limits(machine, findings);
        }
        Some(service) => {
            unit(machine, service, findings);
            user(machine, service, findings);
        }
    }
    directories(machine, findings);
    running(machine, findings);
}

const PRIORITY_WHY: &str =
    "the loop runs as any other program does, and is late whenever the machine is busy";
const MEMORY_WHY: &str =
    "pages of the daemon can be taken away: each that is missing stops the loop for milliseconds";

fn unit(machine: &Machine, service: &Service, findings: &mut Findings) {
    let required = machine.requires_real_time();
    let capabilities = service.merged("AmbientCapabilities");
    let needed = machine.loop_priority();
    let limit = service
        .value("LimitRTPRIO")
        .and_then(|value| value.parse::<u8>().ok())
        .unwrap_or(0);
    let edit = "systemctl edit torqued@.service";
    if limit < needed && !capabilities.contains("CAP_SYS_NICE") {
        let what = format!(
            "the unit allows real-time priorities up to {limit}, and the loop has {needed}"
        );
        findings.by(
            required,
            "unit-rtprio",
            what,
            PRIORITY_WHY,
            format!("{edit}: [Service] LimitRTPRIO={needed}"),
        );
    }
    let unlocked =
        service.value("LimitMEMLOCK") != Some("infinity") && !capabilities.contains("CAP_IPC_LOCK");
    if unlocked {
        let mend = format!("{edit}: [Service] LimitMEMLOCK=infinity");
        findings.by(
            required,
            "unit-memlock",
            "the unit limits locked memory",
            MEMORY_WHY,
            mend,
        );
    }
    if let Some(quota) = service.value("CPUQuota").filter(|quota| !quota.is_empty()) {
        findings.warning(
            "unit-quota",
            format!("the unit limits the daemon to CPUQuota={quota}"),
            "where the quota is used up, the daemon's ordinary threads stand still: clients get no record",
            format!("{edit}: take CPUQuota out"),
        );
    }
    if service
        .value("WatchdogSec")
        .is_none_or(|value| value == "0")
    {
        findings.warning(
            "unit-watchdog",
            "the unit has no watchdog",
            "a daemon that hangs is not started again",
            format!("{edit}: [Service] WatchdogSec=3"),
        );
    }
}

fn user(machine: &Machine, service: &Service, findings: &mut Findings) {
    let name = service.value("User").unwrap_or("root");
    let Some(account) = machine.service_account() else {
        findings.error(
            "user",
            format!("the unit's user {name} does not exist"),
            "the service does not start",
            "systemd-sysusers",
        );
        return;
    };
    for robot in &service.robots {
        let file = configuration(robot);
        if !machine.root.exists(&file) {
            findings.error(
                "configuration",
                format!("torqued@{robot} is enabled, and {file} does not exist"),
                "the service does not start",
                format!("install the configuration there, or systemctl disable torqued@{robot}"),
            );
        } else if !account.may(&machine.root, &file, 0o4) {
            findings.error(
                "configuration-access",
                format!("{} may not read {file}", account.name),
                "the service does not start",
                format!("chmod -R go+rX /etc/torqued/{robot}"),
            );
        }
    }
    let data = fs::metadata(machine.root.path(STATE_DIRECTORY));
    if data.is_ok_and(|data| account.user != 0 && account.mode(&data) & 0o3 != 0o3) {
        findings.error(
            "state-directory",
            format!("{} may not write into {STATE_DIRECTORY}", account.name),
            "tares and the latched fault are not kept across restarts",
            format!("chown -R {name}: {STATE_DIRECTORY}"),
        );
    }
}

/// Of a daemon that is started by hand.
fn own_limits(machine: &Machine, findings: &mut Findings) {
    let root = &machine.root;
    let limits = root.text("/proc/self/limits");
    let soft = |key: &str| {
        field(&limits, key)
            .and_then(|value| value.split_whitespace().next())
            .map(str::to_owned)
    };
    let status = root.text("/proc/self/status");
    let capabilities = field(&status, "CapEff")
        .and_then(|hex| u64::from_str_radix(hex, 16).ok())
        .unwrap_or(0);
    // CAP_SYS_NICE, CAP_IPC_LOCK.
    let (may_schedule, may_lock) = (capabilities >> 23 & 1 == 1, capabilities >> 14 & 1 == 1);
    let required = machine.requires_real_time();
    let needed = machine.loop_priority();
    let file = "/etc/security/limits.d/torqued.conf";
    if let Some(limit) = soft("Max realtime priority").and_then(|text| text.parse::<u8>().ok())
        && limit < needed
        && !may_schedule
    {
        let what = format!(
            "this user may use real-time priorities up to {limit}, and the loop has {needed}"
        );
        let mend = format!("in {file}: `USER - rtprio {needed}`, then log in again");
        findings.by(required, "rtprio", what, PRIORITY_WHY, mend);
    }
    if let Some(limit) = soft("Max locked memory").filter(|limit| limit != "unlimited" && !may_lock)
    {
        let what = format!("this user may lock {limit} bytes of memory");
        let mend = format!("in {file}: `USER - memlock unlimited`, then log in again");
        findings.by(required, "memlock", what, MEMORY_WHY, mend);
    }
}

fn directories(machine: &Machine, findings: &mut Findings) {
    let Ok(data) = fs::metadata(machine.root.path(RUN_DIRECTORY)) else {
        return;
    };
    if data.mode() & OTHERS_WRITE != 0 {
        findings.error(
            "run-directory",
            format!(
                "others may write into {RUN_DIRECTORY} (mode {:03o})",
                data.mode() & 0o777
            ),
            "daemon and clients refuse to meet there",
            format!("chmod go-w {RUN_DIRECTORY}"),
        );
    }
    if let Some(account) = machine
        .service_account()
        .filter(|account| data.uid() != account.user)
    {
        findings.error(
            "run-directory-owner",
            format!(
                "{RUN_DIRECTORY} belongs to user {}, and the daemon is {}",
                data.uid(),
                account.name
            ),
            "daemon and clients refuse to meet there",
            format!("chown -R {}: {RUN_DIRECTORY}", account.name),
        );
    }
}

/// A daemon that runs without what it asked for.
fn running(machine: &Machine, findings: &mut Findings) {
    for (_, pid) in machine
        .programs()
        .into_iter()
        .filter(|(name, _)| name == "torqued")
    {
        for tid in machine.root.names(&format!("/proc/{pid}/task")) {
            let at = format!("/proc/{pid}/task/{tid}");
            let is_loop = machine.root.text(&format!("{at}/comm")) == "loop";
            if is_loop && Thread::read(machine, &at).is_some_and(|thread| !thread.is_real_time) {
                findings.warning(
                    "loop-scheduler",
                    format!(
                        "the loop of torqued (process {pid}) runs without real-time scheduling"
                    ),
                    PRIORITY_WHY,
                    "journalctl -u 'torqued@*' names what was denied; the findings above name why",
                );
            }
        }
    }
}
