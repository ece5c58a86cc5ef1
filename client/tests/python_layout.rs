//! The Python mirror in the repository is the one that the records' layout gives.

#[test]
fn python_layout_is_up_to_date() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/python/torqued/layout.py");
    let text = std::fs::read_to_string(path).expect("client/python/torqued/layout.py");
    assert!(
        text == torqued_client::python_layout(),
        "layout.py differs from the records; generate it again:\n\
         cargo run -p torqued-client --example generate_python_layout > client/python/torqued/layout.py"
    );
}
