"""The C and C++ client as users have it: installed, compiled against, and commanding a simulated leg."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from processes import BINARIES, ROOT, daemon, derived_config

pytestmark = pytest.mark.real_time

FOLDER = ROOT / "client" / "c"
SECONDS = 5
STRICT = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror"]


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("installed")
    subprocess.run([FOLDER / "install.sh", prefix, BINARIES / "deps" / "libtorqued_c.so"], check=True)
    return prefix


def flags(prefix):
    environment = os.environ | {"PKG_CONFIG_PATH": str(prefix / "lib" / "pkgconfig")}
    command = ["pkg-config", "--cflags", "--libs", "torqued"]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [*found.stdout.split(), f"-Wl,-rpath,{prefix}/lib"]


def test_a_controller_of_thirty_lines_moves_the_simulated_leg_at_1_khz(prefix, tmp_path, monkeypatch):
    source = FOLDER / "examples" / "02_send_references.cpp"
    body = source.read_text().split("int main")[1].splitlines()
    assert len(body) <= 35
    program = prefix / "send_references"
    subprocess.run(["g++", *STRICT, source, *flags(prefix), "-o", program], check=True)
    monkeypatch.setenv("TORQUED_RUN_DIR", str(tmp_path))
    # A machine whose processors are busy otherwise keeps a program waiting for longer than 40 ms.
    config = derived_config(tmp_path, {"reference_timeout_ms = 40.0": "reference_timeout_ms = 900.0"})
    with daemon(config, "--simulate"):
        moved = subprocess.run([program, "leg", str(SECONDS)], capture_output=True, text=True, timeout=60)
    assert moved.returncode == 0, moved.stderr
    sent, lost = map(int, re.fullmatch(r"(\d+) references sent, (\d+) records lost\n", moved.stdout).groups())
    # One reference for each of the daemon's records, a thousand a second.
    assert sent + lost >= 0.95 * 1000 * SECONDS and lost <= 0.1 * sent


@pytest.mark.skipif(not shutil.which("cmake"), reason="cmake is not installed")
def test_cmake_finds_the_library(prefix, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(controller CXX)\n"
        "find_package(torqued 0.1 REQUIRED)\n"
        f"add_executable(controller {FOLDER}/examples/02_send_references.cpp)\n"
        "target_compile_features(controller PRIVATE cxx_std_17)\n"
        "target_link_libraries(controller torqued::torqued)\n"
    )
    build = tmp_path / "build"
    subprocess.run(["cmake", "-S", tmp_path, "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}"], check=True)
    subprocess.run(["cmake", "--build", build], check=True)
    needed = subprocess.run(["readelf", "-d", build / "controller"], capture_output=True, text=True, check=True)
    assert "libtorqued.so.0" in needed.stdout
    refused = subprocess.run([build / "controller", "nobody"], capture_output=True, text=True)
    assert refused.returncode == 1 and 'no torqued runs robot "nobody"' in refused.stderr
