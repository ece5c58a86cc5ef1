"""The page of `torquectl view`, in headless Chromium."""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from processes import BINARIES, ROOT, Process, daemon

# Where PyPI's playwright and axe-playwright-python and Debian's chromium are installed.
Axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe
sync_api = pytest.importorskip("playwright.sync_api")
expect, sync_playwright = sync_api.expect, sync_api.sync_playwright

LEG = ROOT / "config" / "leg" / "robot.toml"
# Lets the page draw the robot without a graphics card.
OPTIONS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@pytest.fixture(scope="module")
def browser():
    chromium = shutil.which("chromium")
    assert chromium, "Debian's chromium"
    with sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=chromium, args=OPTIONS)


@pytest.fixture
def page(browser):
    """A page that records what it asks for, and every error."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
    page = context.new_page()
    page.asked, page.errors = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.on("console", lambda m: page.errors.append(m.text) if m.type == "error" else None)
    yield page
    context.close()
    assert page.errors == []


@pytest.fixture
def run_dir(tmp_path, monkeypatch):
    monkeypatch.setenv("TORQUED_RUN_DIR", str(tmp_path))
    return tmp_path


def view(*arguments):
    process = Process(BINARIES / "torquectl", "view", *arguments)
    process.address = process.wait_for(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}/")[0]
    return process


def state(page):
    return page.locator("#state")


def nothing_left_this_machine(page):
    assert page.asked
    elsewhere = [url for url in page.asked if not re.match(r"(http://127\.0\.0\.1:\d+/|data:|blob:)", url)]
    assert elsewhere == []


def has_no_defect(page):
    # Canvases of the charts are pictures beside their values in text.
    results = Axe().run(page)
    assert results.violations_count == 0, results.generate_report()


def test_the_page_shows_the_robot_survives_its_daemon_and_asks_nothing_elsewhere(page, run_dir):
    with daemon(LEG, "--simulate") as robot, view("--config", LEG) as shown:
        page.goto(shown.address)
        expect(state(page)).to_have_text("holding", timeout=20_000)
        expect(page.locator(".card")).to_have_count(6)
        expect(page.locator("#stop")).to_be_hidden()
        page.wait_for_function("page.store.end > 3000")
        # Every record, and a value in each chart.
        assert page.evaluate("page.store.lost") == 0
        for value in page.locator(".card .value").all_inner_texts():
            assert re.match(r"-?[\d.]+ ± [\d.]+ N·m", value), value
        has_no_defect(page)
        page.keyboard.press("Tab")
        page.locator(".card").first.click()
        expect(page.locator("#title")).to_have_text("hip_yaw")
        expect(page.locator(".card")).to_have_count(6)
        has_no_defect(page)
        page.keyboard.press("Escape")
        expect(page.locator("#title")).to_have_text("All joints")
        page.keyboard.press("Space")
        end = page.evaluate("page.end")
        time.sleep(0.5)
        assert page.evaluate("page.end") == end and page.evaluate("page.store.newest") > end
        page.keyboard.press(",")
        assert page.evaluate("page.end") < end
        page.keyboard.press("End")
        with page.expect_download() as saved:
            page.locator("#csv").click()
        lines = Path(saved.value.path()).read_text().splitlines()
        assert lines[0].startswith("t,hip_yaw.tau,hip_yaw.tau_d,") and len(lines) > 1000
        with page.expect_download() as saved:
            page.locator("#png").click()
        assert Path(saved.value.path()).read_bytes().startswith(b"\x89PNG")
        page.locator("#theme").click()
        has_no_defect(page)
        robot.kill()
        expect(state(page)).to_have_text("no daemon", timeout=10_000)
        expect(page.locator("#next")).to_contain_text("start it again")
        with daemon(LEG, "--simulate"):
            expect(state(page)).to_have_text("holding", timeout=30_000)
        nothing_left_this_machine(page)


def test_other_addresses_and_wishes_are_refused(page, run_dir):
    with daemon(LEG, "--simulate"), view() as shown:
        base = shown.address.rsplit("/", 2)[0]
        assert page.request.get(base + "/").status == 404
        assert page.request.get(base + "/" + 32 * "0" + "/").status == 404
        assert page.request.get(base + "/" + 32 * "0" + "/stream").status == 404
        assert page.request.get(shown.address + "../../Cargo.toml").status == 404
        refused = page.request.post(shown.address + "ask", data='{"do":"disable"}')
        assert refused.status == 403 and "--control" in refused.text()


def test_with_control_the_page_moves_stops_and_acknowledges(page, run_dir):
    with daemon(LEG, "--simulate"), view("--config", LEG, "--control") as shown:
        page.goto(shown.address)
        expect(state(page)).to_have_text("holding", timeout=20_000)
        answer = page.locator("#answer")
        page.fill("#targets", "knee=400")
        page.locator("#move button").click()
        expect(answer).to_contain_text("beyond its limits; allowed: ", timeout=10_000)
        page.fill("#targets", "elbow=4")
        page.locator("#move button").click()
        expect(answer).to_contain_text('the robot has no joint "elbow"')
        page.fill("#targets", "knee=30")
        page.fill("#speed", "20")
        page.locator("#move button").click()
        expect(state(page)).to_have_text("active", timeout=10_000)
        expect(answer).to_contain_text("the robot holds", timeout=30_000)
        # Stopped on its way, by the key.
        page.fill("#targets", "knee=90")
        page.fill("#speed", "5")
        page.locator("#move button").click()
        expect(state(page)).to_have_text("active", timeout=10_000)
        page.locator("#title").click()
        page.keyboard.press("s")
        expect(state(page)).to_have_text("holding", timeout=10_000)
        page.locator("[data-do=disable]").click()
        expect(state(page)).to_have_text("ready", timeout=10_000)
        page.locator("[data-do=enable]").click()
        expect(state(page)).to_have_text("holding", timeout=10_000)
        has_no_defect(page)


def test_a_recorded_run_is_played(page, tmp_path):
    run = tmp_path / "run.mcap"
    demo = [BINARIES / "torqued", "demo", "--robot", "leg", "--fast", "--seconds", "4", "--record", run, "--json"]
    subprocess.run(demo, cwd=ROOT, check=True, capture_output=True)
    with view(run) as shown:
        page.goto(shown.address)
        expect(page.locator("#robot")).to_have_text("leg: run.mcap", timeout=20_000)
        page.wait_for_function("page.store && page.store.end > 3000")
        expect(page.locator("#drawing canvas")).to_be_visible()
        page.keyboard.press("Home")
        begin = page.evaluate("page.end")
        page.keyboard.press("Space")
        page.wait_for_function(f"page.end > {begin} + 0.5")
        page.keyboard.press("Space")
        has_no_defect(page)
        nothing_left_this_machine(page)
        shown.send(signal.SIGINT)
        assert shown.wait() == 0


def test_a_file_that_is_no_run_is_refused(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_text("no run")
    process = Process(BINARIES / "torquectl", "view", other)
    assert process.wait() == 2
    assert "other.mcap" in process.output()
