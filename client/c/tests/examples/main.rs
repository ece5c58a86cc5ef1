//! The examples, compiled by every compiler that is there without a warning, against a stand-in daemon.

mod compiled;
mod daemon;

use compiled::{Installed, compilers};
use daemon::StandIn;

#[test]
fn every_example_compiles_without_a_warning_and_runs() {
    let installed = Installed::new();
    let daemon = StandIn::start();
    for compiler in compilers() {
        let run = |example: &str, arguments: &[&str]| {
            let program = installed.compile(compiler, example, &[]);
            daemon.run(&program, arguments)
        };
        let printed = run("01_print_torques.c", &["leg", "0.5"]);
        assert!(
            printed.starts_with("cycle ") && printed.contains("joint_2"),
            "{printed}"
        );
        assert!(
            printed.contains("encoder     2.50 +-  0.50 N m"),
            "{printed}"
        );
        let printed = run("02_send_references.cpp", &["leg", "0.5"]);
        assert!(printed.contains(" references sent, "), "{printed}");
        let printed = run("03_tare.c", &["leg", "in_the_air"]);
        assert!(
            printed.contains("ankle") && printed.contains("2.00     3.00 N"),
            "{printed}"
        );
        let printed = run("04_follow_trajectory.cpp", &["leg"]);
        assert_eq!(printed, "arrived\n");
        let printed = run("05_plan_slowly.cpp", &["leg"]);
        assert!(printed.ends_with(" plans, the lease kept\n"), "{printed}");
        let printed = run("06_round_trip.cpp", &["leg", "0.5"]);
        assert!(printed.contains("\"p99_ms\": "), "{printed}");
    }
}

#[test]
fn every_function_keeps_its_word_under_the_address_sanitizer() {
    let installed = Installed::new();
    let daemon = StandIn::start();
    // gcc alone: Debian's clang comes without the sanitizer's library.
    let flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    let program = installed.compile(compilers()[0], "every_function.cpp", &flags);
    assert_eq!(daemon.run(&program, &["leg"]), "all as promised\n");
}
