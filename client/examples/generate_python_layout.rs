//! Prints the Python mirror of the records, `client/python/torqued/layout.py`.

fn main() {
    print!("{}", torqued_client::python_layout());
}
