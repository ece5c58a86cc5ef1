"""The page of `torquectl view`, in headless Chromium."""

import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect, sync_playwright
from processes import BINARIES, LEG, ROOT, Process, daemon, example

pytestmark = pytest.mark.real_time

# A machine that runs other tests beside this one is slow.
PATIENCE_MS = 60_000
expect.set_options(timeout=PATIENCE_MS)
# Lets the page draw the robot without a graphics card.
OPTIONS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@pytest.fixture(scope="module")
def browser():
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    assert chromium, "no chromium: rt-tests/install.sh --browser"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=OPTIONS)
        yield browser
        browser.close()


@pytest.fixture
def page(browser):
    """A page that records what it asks for, and every error."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.asked, page.errors = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    # A refused wish is an answer that the browser reports.
    wrong = lambda m: m.type == "error" and "409 (Conflict)" not in m.text
    page.on("console", lambda m: page.errors.append(m.text) if wrong(m) else None)
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


def until(page, expression):
    """Waits for an expression; the page's own policy forbids Playwright's way, which evaluates text in it."""
    end = time.monotonic() + 1e-3 * PATIENCE_MS
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        time.sleep(0.1)


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
        expect(state(page)).to_have_text("holding")
        expect(page.locator(".card")).to_have_count(6)
        expect(page.locator("#stop")).to_be_hidden()
        until(page, "page.store.end > 3000")
        # The page has got each record that torquectl has read, and has a value in each chart.
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
        expect(page.locator(".card").first).to_be_focused()
        page.locator("#title").click()
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
        expect(state(page)).to_have_text("no daemon")
        expect(page.locator("#next")).to_contain_text("start it again")
        with daemon(LEG, "--simulate"):
            expect(state(page)).to_have_text("holding")
        nothing_left_this_machine(page)


def test_other_addresses_and_wishes_are_refused(page, run_dir):
    with daemon(LEG, "--simulate"), view() as shown:
        robot = page.request.get(shown.address)
        assert robot.status == 200 and "default-src 'none'" in robot.headers["content-security-policy"]
        base = shown.address.rsplit("/", 2)[0]
        assert page.request.get(base + "/").status == 404
        assert page.request.get(base + "/" + 32 * "0" + "/").status == 404
        assert page.request.get(base + "/" + 32 * "0" + "/stream").status == 404
        assert page.request.get(shown.address + "../../Cargo.toml").status == 404
        refused = page.request.post(shown.address + "ask", data='{"do":"disable"}')
        assert refused.status == 403 and "--control" in refused.text()
        for header, value in [
            ("Host", "robot.example"),
            ("Origin", "http://robot.example"),
            ("Origin", "null"),
            ("Sec-Fetch-Site", "cross-site"),
        ]:
            for path in ["", "stream", "main.js"]:
                refused = page.request.get(shown.address + path, headers={header: value})
                assert refused.status == 403, (header, path)
            refused = page.request.post(shown.address + "ask", data='{"do":"stop"}', headers={header: value})
            assert refused.status == 403 and "--control" not in refused.text()


def test_the_robot_is_not_commanded_through_a_network():
    process = Process(BINARIES / "torquectl", "view", "--control", "--listen", "0.0.0.0:0")
    assert process.wait() == 2
    assert "ssh -L" in process.output()


def begin_motion(page, awaited):
    """Clicks on Move until the answer is the awaited one: where other programs keep torquectl from running for 0.2 s,
    the daemon lets go of the command, and the robot holds."""
    answer = page.locator("#answer")
    for _ in range(10):
        page.locator("#move button").click()
        begun = time.monotonic()
        while (text := answer.inner_text()) == "moving …" and not (awaited == text and time.monotonic() - begun > 1):
            time.sleep(0.1)
        if awaited in text:
            return
        assert "the command was lost" in text, text
    raise AssertionError(text)


def see_motion(page):
    """Begins a motion until the page shows it: the command may be lost after it has begun, too."""
    for attempt in range(5):
        begin_motion(page, "moving …")
        try:
            expect(state(page)).to_have_text("active", timeout=3_000)
            return
        except AssertionError:
            if attempt == 4:
                raise


def test_with_control_the_page_moves_stops_and_acknowledges(page, run_dir):
    with daemon(LEG, "--simulate"), view("--config", LEG, "--control") as shown:
        page.goto(shown.address)
        expect(state(page)).to_have_text("holding")
        answer = page.locator("#answer")
        page.fill("#targets", "knee=400")
        page.locator("#move button").click()
        expect(answer).to_contain_text("beyond its limits; allowed: ")
        page.fill("#targets", "elbow=4")
        page.locator("#move button").click()
        expect(answer).to_contain_text('the robot has no joint "elbow"')
        page.fill("#targets", "knee=30")
        page.fill("#speed", "20")
        begin_motion(page, "the robot holds")
        assert abs(page.evaluate("page.store.joint(3, 'q')[page.store.place(page.store.newest)]") * 180 / 3.14159 - 30) < 1
        # Stopped on its way, by the key.
        page.fill("#targets", "knee=90")
        page.fill("#speed", "5")
        see_motion(page)
        page.locator("#title").click()
        page.keyboard.press("s")
        expect(state(page)).to_have_text("holding")
        page.locator("[data-do=disable]").click()
        expect(state(page)).to_have_text("ready")
        page.locator("[data-do=enable]").click()
        expect(state(page)).to_have_text("holding")
        has_no_defect(page)


def test_a_fault_is_shown_with_its_cause_and_next_step_until_it_is_acknowledged(page, run_dir):
    with Process(example("stand_in_daemon"), "stand_in") as robot:
        robot.wait_for("publishing")
        with view("--control") as shown:
            page.goto(shown.address)
            expect(state(page)).to_have_text("holding")
            expect(page.locator("#fault")).to_be_hidden()
            # Enabled a second time, this one latches fault 404.
            page.locator("[data-do=enable]").click()
            expect(state(page)).to_have_text("fault")
            expect(page.locator("#fault-name")).to_contain_text("404")
            expect(page.locator("#fault-cause")).to_contain_text("Next: ")
            has_no_defect(page)
            page.locator("#acknowledge").click()
            expect(page.locator("#fault")).to_be_hidden(timeout=10_000)


def test_a_recorded_run_is_played(page, tmp_path):
    run = tmp_path / "run.mcap"
    demo = [BINARIES / "torqued", "demo", "--robot", "leg", "--fast", "--seconds", "4", "--record", run, "--json"]
    subprocess.run(demo, cwd=ROOT, check=True, capture_output=True)
    with view(run) as shown:
        page.goto(shown.address)
        expect(page.locator("#robot")).to_have_text("leg: run.mcap")
        until(page, "page.store && page.store.end > 3000")
        expect(page.locator("#drawing canvas")).to_be_visible()
        page.keyboard.press("Home")
        begin = page.evaluate("page.end")
        page.keyboard.press("Space")
        until(page, f"page.end > {begin} + 0.5")
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
