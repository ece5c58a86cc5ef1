//! The library as users have it, installed, and programs compiled against it.

use std::path::{Path, PathBuf};
use std::process::Command;

use test_support::TemporaryDirectory;

/// C and C++ compilers of one make.
pub(crate) type Compiler = (&'static str, &'static str);

/// gcc, and clang where there is one.
pub(crate) fn compilers() -> Vec<Compiler> {
    let mut compilers = vec![("gcc", "g++"), ("clang", "clang++")];
    compilers.retain(|(c, _)| *c == "gcc" || Command::new(c).arg("--version").output().is_ok());
    compilers
}

/// The library, installed into a folder of its own.
pub(crate) struct Installed {
    directory: TemporaryDirectory,
}

impl Installed {
    pub(crate) fn new() -> Self {
        let directory = TemporaryDirectory::new();
        let mut library = std::env::current_exe().expect("own path");
        library.set_file_name("libtorqued_c.so");
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("install.sh");
        expect(Command::new(script).arg(directory.path()).arg(library));
        Self { directory }
    }

    /// Compiles a source, found by pkg-config; the program's path.
    pub(crate) fn compile(&self, compiler: Compiler, source: &str, flags: &[&str]) -> PathBuf {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let examples = ["examples", "tests/examples"].map(|part| folder.join(part).join(source));
        let path = examples.into_iter().find(|path| path.exists());
        let is_c = source.ends_with(".c");
        let (name, standard) = if is_c {
            (compiler.0, "-std=c11")
        } else {
            (compiler.1, "-std=c++17")
        };
        let prefix = self.directory.path();
        let found = expect(
            Command::new("pkg-config")
                .args(["--cflags", "--libs", "torqued"])
                .env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig")),
        );
        let program = prefix.join(format!("{source}.{name}"));
        expect(
            Command::new(name)
                .args([
                    standard,
                    "-O1",
                    "-g",
                    "-Wall",
                    "-Wextra",
                    "-Wpedantic",
                    "-Werror",
                ])
                .args(flags)
                .arg(path.expect("a source"))
                .args(found.split_whitespace())
                .arg(format!("-Wl,-rpath,{}", prefix.join("lib").display()))
                .args(["-lm", "-o"])
                .arg(&program),
        );
        program
    }
}

/// Runs a command that must succeed; what it prints.
pub(crate) fn expect(command: &mut Command) -> String {
    let output = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, error) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{command:?}\n{out}{error}");
    out
}
