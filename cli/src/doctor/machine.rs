//! The machine that is looked at: its files under a root, the robot that is to run on it.

use robot_config::{RealTime, Robot};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::service::Service;

/// SCHED_FIFO priority of a loop whose configuration is not known: the key's default.
const PRIORITY: u8 = 80;

/// What every check is given.
pub(super) struct Machine {
    pub(super) root: Root,
    /// The robot that is to run, where a configuration is given or a service names one.
    pub(super) robot: Option<Robot>,
    /// The installed service.
    pub(super) service: Option<Service>,
}

impl Machine {
    /// The CPU that the loop is bound to.
    pub(super) fn loop_cpu(&self) -> Option<usize> {
        self.robot.as_ref()?.parameters.timing.cpu
    }

    pub(super) fn loop_priority(&self) -> u8 {
        let robot = self.robot.as_ref();
        robot.map_or(PRIORITY, |robot| robot.parameters.timing.priority)
    }

    /// The loop does not start without real-time rights.
    pub(super) fn requires_real_time(&self) -> bool {
        let robot = self.robot.as_ref();
        robot.is_some_and(|robot| robot.parameters.timing.real_time == RealTime::Require)
    }

    /// CPUs for all that is not the loop: none of them is isolated.
    pub(super) fn housekeeping_cpus(&self) -> BTreeSet<usize> {
        let cpu = |name: &str| cpus(&self.root.text(&format!("/sys/devices/system/cpu/{name}")));
        let mut others = cpu("online");
        for isolated in cpu("isolated") {
            others.remove(&isolated);
        }
        if let Some(own) = self.loop_cpu() {
            others.remove(&own);
        }
        others
    }

    /// Programs that run, with their process numbers.
    pub(super) fn programs(&self) -> Vec<(String, u32)> {
        let numbers = self.root.names("/proc");
        let numbers = numbers.iter().filter_map(|name| name.parse::<u32>().ok());
        let named = numbers.filter_map(|pid| {
            let name = self.root.text(&format!("/proc/{pid}/comm"));
            (!name.is_empty()).then_some((name, pid))
        });
        named.collect()
    }
}

/// The root of the file system that is looked at: `/`, or a folder that stands for it.
pub(super) struct Root(PathBuf);

impl Root {
    pub(super) fn new(path: PathBuf) -> Self {
        Self(path)
    }

    /// The machine itself is looked at.
    pub(super) fn is_real(&self) -> bool {
        self.0 == Path::new("/")
    }

    /// Where a file of the machine lies.
    pub(super) fn path(&self, absolute: &str) -> PathBuf {
        self.0.join(absolute.trim_start_matches('/'))
    }

    /// The file's text without white space around it; empty where it cannot be read.
    pub(super) fn text(&self, absolute: &str) -> String {
        let bytes = fs::read(self.path(absolute)).unwrap_or_default();
        String::from_utf8_lossy(&bytes).trim().to_owned()
    }

    pub(super) fn number(&self, absolute: &str) -> Option<f64> {
        self.text(absolute).parse().ok()
    }

    /// Names of a folder's entries, sorted; none where it cannot be read.
    pub(super) fn names(&self, absolute: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(absolute))
            .into_iter()
            .flatten()
            .flatten();
        let mut names: Vec<_> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    pub(super) fn exists(&self, absolute: &str) -> bool {
        fs::symlink_metadata(self.path(absolute)).is_ok()
    }
}

/// CPUs of a list as the kernel writes it, e.g. `0-3,5`.
pub(super) fn cpus(list: &str) -> BTreeSet<usize> {
    let ranges = list.split(',').filter_map(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
    });
    ranges.flatten().collect()
}

/// CPUs as the kernel reads them.
pub(super) fn list(cpus: &BTreeSet<usize>) -> String {
    let texts: Vec<String> = cpus.iter().map(ToString::to_string).collect();
    texts.join(",")
}

/// The value of a line `KEY: VALUE` or `KEY VALUE`, e.g. of `/proc/meminfo`.
pub(super) fn field<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let mut lines = text.lines();
    lines.find_map(|line| Some(line.strip_prefix(key)?.trim_start_matches(':').trim()))
}

#[cfg(test)]
mod tests {
    use super::{cpus, field, list};

    #[test]
    fn lists_of_cpus_are_the_kernels() {
        let set = cpus("0-3,5,8-9");
        assert_eq!(list(&set), "0,1,2,3,5,8,9");
        assert!(cpus("").is_empty());
        assert!(cpus("(null)").is_empty());
    }

    #[test]
    fn fields_are_found_by_their_key() {
        let text = "MemTotal:   16 kB\nMax realtime priority     98     99\n";
        assert_eq!(field(text, "MemTotal"), Some("16 kB"));
        assert_eq!(field(text, "Max realtime priority"), Some("98     99"));
        assert_eq!(field(text, "MemFree"), None);
    }
}
