//! CAN interfaces, as `ip -details -statistics -json link show` and sysfs show them.

use super::machine::Root;
use serde_json::Value;
use std::process::Command;

/// `ARPHRD_CAN` of the kernel.
const CAN: &str = "280";
/// What `ip` would print, in a folder that stands for the root.
const STAND_IN: &str = "/ip-link.json";

/// Names of the CAN interfaces.
pub(super) fn can_interfaces(root: &Root) -> Vec<String> {
    let mut names = root.names("/sys/class/net");
    names.retain(|name| root.text(&format!("/sys/class/net/{name}/type")) == CAN);
    names
}

/// A CAN interface.
pub(super) struct Link(Value);

impl Link {
    /// All of the machine.
    ///
    /// # Errors
    /// `ip` cannot be run, or prints something else.
    pub(super) fn all(root: &Root) -> Result<Vec<Self>, String> {
        let text = if root.is_real() {
            let mut ip = Command::new("ip");
            let output = ip
                .args(["-details", "-statistics", "-json", "link", "show"])
                .output();
            let output = output
                .map_err(|error| format!("`ip` cannot be run ({error}): apt install iproute2"))?;
            String::from_utf8_lossy(&output.stdout).into_owned()
        } else {
            root.text(STAND_IN)
        };
        let all: Vec<Value> = serde_json::from_str(&text)
            .map_err(|error| format!("`ip -json link show` prints no JSON ({error})"))?;
        Ok(all
            .into_iter()
            .map(Self)
            .filter(|link| link.0["link_type"] == "can")
            .collect())
    }

    pub(super) fn name(&self) -> &str {
        self.0["ifname"].as_str().unwrap_or_default()
    }

    pub(super) fn is_up(&self) -> bool {
        let flags = self.0["flags"].as_array();
        flags.is_some_and(|flags| flags.iter().any(|flag| flag == "UP"))
    }

    /// A simulated bus: it has no bit rate and no errors.
    pub(super) fn is_virtual(&self) -> bool {
        matches!(
            self.0["linkinfo"]["info_kind"].as_str(),
            Some("vcan" | "vxcan")
        )
    }

    pub(super) fn queue(&self) -> u64 {
        self.0["txqlen"].as_u64().unwrap_or(0)
    }

    pub(super) fn mtu(&self) -> u64 {
        self.0["mtu"].as_u64().unwrap_or(0)
    }

    fn data(&self) -> &Value {
        &self.0["linkinfo"]["info_data"]
    }

    pub(super) fn state(&self) -> &str {
        self.data()["state"].as_str().unwrap_or_default()
    }

    pub(super) fn has_mode(&self, mode: &str) -> bool {
        let modes = self.data()["ctrlmode"].as_array();
        modes.is_some_and(|modes| modes.iter().any(|one| one == mode))
    }

    /// Bit rate, Hz, of `bittiming` or `data_bittiming`.
    pub(super) fn bit_rate(&self, timing: &str) -> Option<f64> {
        let fixed = &self.data()[format!("{timing}_bitrate")];
        self.data()[timing]["bitrate"]
            .as_f64()
            .or(fixed.as_f64())
            .filter(|&rate| rate > 0.0)
    }

    /// Where in a bit it is sampled, 1.
    pub(super) fn sample_point(&self) -> Option<f64> {
        // A text in releases of iproute2 up to today's, a number in older ones.
        let value = &self.data()["bittiming"]["sample_point"];
        value.as_f64().or_else(|| value.as_str()?.parse().ok())
    }

    /// None where the driver cannot restart by itself.
    pub(super) fn restart_ms(&self) -> Option<u64> {
        self.data()["restart_ms"].as_u64()
    }

    /// Error counters of the controller: sending, receiving.
    pub(super) fn error_counters(&self) -> [u64; 2] {
        ["tx", "rx"].map(|side| self.data()["berr_counter"][side].as_u64().unwrap_or(0))
    }

    /// How often something happened since the interface is up, by the name that `ip` has for it.
    pub(super) fn happened(&self, name: &str) -> u64 {
        let info = &self.0["linkinfo"]["info_xstats"][name];
        info.as_u64().unwrap_or(0)
    }

    /// Received frames that found no room.
    pub(super) fn lost(&self) -> u64 {
        let count = |name: &str| self.0["stats64"]["rx"][name].as_u64().unwrap_or(0);
        count("dropped") + count("over_errors")
    }
}
