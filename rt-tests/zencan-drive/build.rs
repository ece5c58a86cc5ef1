//! The object dictionary as code.

fn main() {
    println!("cargo::rerun-if-changed=drive.toml");
    if let Err(error) = zencan_build::build_node_from_device_config("DRIVE", "drive.toml") {
        panic!("drive.toml: {error}");
    }
}
