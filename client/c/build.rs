//! Gives the shared library its name for the dynamic linker.

fn main() {
    // Its number changes when programs have to be compiled anew.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libtorqued.so.0");
}
