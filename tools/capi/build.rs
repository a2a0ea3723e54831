//! Writes the header, and gives the shared library its name.

use std::path::PathBuf;

fn main() {
    let folder = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo sets it"));
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("Cargo sets it"));
    println!("cargo::rerun-if-changed=src");
    println!("cargo::rerun-if-changed=cbindgen.toml");
    let header = cbindgen::generate(&folder).expect("the interface can be written as C");
    // Beside the libraries, from where tools/capi/install takes it.
    header.write_to_file(out.join("tsuya.h"));
    if let Some(profile) = out.ancestors().nth(3) {
        header.write_to_file(profile.join("tsuya.h"));
    }
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libtsuya.so.0");
    }
}
