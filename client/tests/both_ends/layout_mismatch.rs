//! A daemon with other records: another program's service under our name.

use std::time::Duration;

use crate::common::RunDir;
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use torqued_client::{Client, DaemonPorts, Error};

/// As large as ours, with another layout.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
#[type_name("torqued::Description#00000000deadbeef")]
struct OtherDescription([u64; size_of::<torqued_client::robot_state::Description>() / 8]);

#[test]
fn another_layout_is_refused_with_both_names() {
    let dir = RunDir::new();
    let mut config = Config::default();
    let root = dir.location.path().to_str().expect("text");
    config
        .global
        .set_root_path(&Path::new(root.as_bytes()).expect("path"));
    config.global.prefix =
        FileName::new(dir.location.shared_memory_prefix().as_bytes()).expect("name");
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .expect("node");
    let _service = node
        .service_builder(&"torqued/leg/description".try_into().expect("name"))
        .publish_subscribe::<OtherDescription>()
        .history_size(1)
        .create()
        .expect("service");

    let error = Client::connect_at(&dir.location, "leg", Duration::from_secs(1)).err();
    check(&error.expect("the client is refused"));
    let error = DaemonPorts::create(&dir.location, &crate::common::description("leg", 6)).err();
    check(&error.expect("the daemon is refused"));
}

fn check(error: &Error) {
    assert!(matches!(error, Error::OtherLayout { .. }), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("torqued::Description#00000000deadbeef"),
        "{text}"
    );
    assert_eq!(text.matches("torqued::Description#").count(), 2, "{text}");
    assert!(text.contains("same version"), "{text}");
}
