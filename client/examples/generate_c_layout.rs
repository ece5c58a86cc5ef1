//! Prints the C mirror of the records.

fn main() {
    print!("{}", torqued_client::c_layout());
}
