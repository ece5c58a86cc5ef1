//! Manual pages and shell completions of a program, made from what it says of itself.

use std::ffi::OsStr;
use std::io;
use std::path::Path;
use std::process::ExitCode;

use clap::Command;
use clap_complete::{Shell, generate_to};

/// The argument that asks a program for its pages: for packages, so no help names it.
const ARGUMENT: &str = "--write-pages";

/// Writes the program's manual pages into FOLDER/man and its completions into FOLDER/completions, where its
/// arguments are `--write-pages FOLDER` and nothing else: its exit code then.
pub fn pages(command: impl FnOnce() -> Command) -> Option<ExitCode> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [asked, folder] = arguments.as_slice() else {
        return None;
    };
    if asked != OsStr::new(ARGUMENT) {
        return None;
    }
    Some(match write(command(), Path::new(folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{ARGUMENT} {}: {error}", Path::new(folder).display());
            ExitCode::FAILURE
        }
    })
}

fn write(mut command: Command, folder: &Path) -> io::Result<()> {
    let [man, completions] = ["man", "completions"].map(|name| folder.join(name));
    std::fs::create_dir_all(&man)?;
    std::fs::create_dir_all(&completions)?;
    let name = command.get_name().to_owned();
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        generate_to(shell, &mut command, &name, &completions)?;
    }
    clap_mangen::generate_to(command, man)
}

#[cfg(test)]
mod tests {
    use super::write;
    use clap::{Arg, Command};

    #[test]
    fn each_command_has_a_page_and_each_shell_its_completion() {
        let folder = std::env::temp_dir().join(format!("torqued-pages-{}", std::process::id()));
        let command = Command::new("example").about("Does nothing");
        let command = command.subcommand(Command::new("part").arg(Arg::new("json").long("json")));
        write(command, &folder).unwrap();
        let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
        assert!(read("man/example.1").contains("Does nothing"));
        assert!(read("man/example-part.1").contains("json"));
        for file in ["example.bash", "_example", "example.fish"] {
            assert!(
                read(&format!("completions/{file}")).contains("json"),
                "{file}"
            );
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
