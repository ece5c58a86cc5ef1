//! The headers in the repository are those that the code gives.

use std::process::Command;

#[test]
fn the_records_are_those_of_shared_memory() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/include/torqued/records.h");
    let text = std::fs::read_to_string(path).expect("records.h");
    assert!(
        text == torqued_client::c_layout(),
        "records.h differs from the records; generate it again:\n\
         cargo run -p torqued-client --example generate_c_layout > client/c/include/torqued/records.h"
    );
}

#[test]
fn the_functions_are_those_of_the_library() {
    let folder = env!("CARGO_MANIFEST_DIR");
    let config = cbindgen::Config::from_file(format!("{folder}/cbindgen.toml")).expect("a config");
    let mut made = Vec::new();
    let bindings = cbindgen::generate_with_config(folder, config).expect("a header");
    bindings.write(&mut made);
    let path = format!("{folder}/include/torqued/torqued.h");
    let text = std::fs::read(path).expect("torqued.h");
    assert!(
        text == made,
        "torqued.h differs from the functions; generate it again:\n\
         cargo run -p torqued-c --example generate_header > client/c/include/torqued/torqued.h"
    );
}

#[test]
fn the_library_exports_what_the_header_declares_and_has_its_name() {
    let folder = env!("CARGO_MANIFEST_DIR");
    let mut library = std::env::current_exe().expect("own path");
    library.set_file_name("libtorqued_c.so");
    let output = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).arg(&library).output();
        String::from_utf8(output.expect("binutils").stdout).expect("text")
    };
    let exported = output("nm", &["-D", "--defined-only"]);
    let mut exported: Vec<_> = exported
        .lines()
        .filter_map(|l| l.split(' ').nth(2))
        .collect();
    exported.retain(|name| name.starts_with("torqued_"));
    exported.sort_unstable();
    let header = std::fs::read_to_string(format!("{folder}/include/torqued/torqued.h")).unwrap();
    let code = header
        .lines()
        .filter(|line| !line.trim_start().starts_with('*'));
    let words = code.flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_'));
    let mut declared: Vec<_> = words.filter(|word| word.starts_with("torqued_")).collect();
    declared.sort_unstable();
    declared.dedup();
    assert_eq!(exported, declared);
    assert!(output("objdump", &["-p"]).contains("SONAME               libtorqued.so.0\n"));
}
