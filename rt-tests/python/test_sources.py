"""Every Rust file is part of something that is compiled: a file that no `mod` names is no test."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
LISTED = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.rs"]
FILES = [ROOT / name for name in subprocess.check_output(LISTED, cwd=ROOT, text=True).split()]
ROOTS = {"main.rs", "lib.rs", "build.rs"}
# Cargo compiles the files of these folders, each by itself.
FOLDERS = {"tests", "benches", "examples", "bin", "fuzz_targets"}


def is_named(file):
    """Whether a file that may contain it declares this module."""
    folder, module = (file.parent.parent, file.parent.name) if file.name == "mod.rs" else (file.parent, file.stem)
    parents = [folder / name for name in ("mod.rs", "main.rs", "lib.rs")] + [folder.with_suffix(".rs")]
    # Of a folder that several tests share.
    parents += (folder if file.name == "mod.rs" else folder.parent).glob("*.rs")
    declared = re.compile(rf'\bmod {module}\b|\bpath = "[^"]*{file.name}"')
    return any(declared.search(parent.read_text()) for parent in parents if parent.exists())


def is_root(file):
    return file.name in ROOTS or file.parent.name in FOLDERS and is_found_by_cargo(file)


def is_found_by_cargo(file):
    """Not where a package turns that off for its tests, and names its programs."""
    if file.parent.name != "tests":
        return True
    package = (file.parent.parent / "Cargo.toml").read_text()
    return "autotests = false" not in package or f'name = "{file.stem}"' in package


def test_every_file_is_compiled():
    assert [str(file.relative_to(ROOT)) for file in FILES if not is_root(file) and not is_named(file)] == []


def test_a_file_without_a_mod_is_found():
    assert not is_named(ROOT / "crates" / "control" / "src" / "no_such_module.rs")
    assert is_named(ROOT / "crates" / "control" / "tests" / "margins" / "design.rs")
    tests = ROOT / "crates" / "cycle" / "tests"
    assert is_root(tests / "real_time.rs")
    assert not is_root(tests / "no_such_test.rs") and not is_named(tests / "no_such_test.rs")
    assert is_named(tests / "modes.rs")
