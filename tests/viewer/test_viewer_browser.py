"""The viewer in a browser: Debian's Chromium, without a screen, WebGL in software.

They are left out where no Chromium is; with KINSEEK_BROWSER=1 that is a failure. KINSEEK_SCREENSHOTS=folder keeps pictures.
"""

from __future__ import annotations

import os
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import viewer
from kinseek.viewer import Viewer

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
TOLERANCES = os.environ.get("KINSEEK_BROWSER") == "1"
PICTURES = os.environ.get("KINSEEK_SCREENSHOTS")

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)

SMALL = {"width": 800, "height": 560}
"""Every pixel is drawn by the processor."""

QUIET = """
new MutationObserver(() => {
  for (const note of document.querySelectorAll(".mantine-Notification-root"))
    if (note.innerText.includes("Software WebGL")) note.style.display = "none";
}).observe(document, { childList: true, subtree: true });
"""
"""Hides the note of viser's, over the scene, that there is no graphics card: some Chromium tell it and some do not."""

PATIENCE = 60.0
"""[s] A busy machine without a graphics card draws a few frames a second."""

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None and not TOLERANCES, reason="no Chromium here"),
    # Chromium and the server end in any order; what was still on its way then is no fault.
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if not TOLERANCES:
        pytest.importorskip("viser")
        pytest.importorskip("playwright")
    from playwright.sync_api import sync_playwright

    assert CHROMIUM is not None, "KINSEEK_BROWSER=1, and there is no Chromium"
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def shown(browser: Any) -> Iterator[Viewer]:
    with viewer.show(kinseek.load("ur5e"), port=0, block=False, open_browser=False) as running:
        yield running


class Visit:
    """A browser's page, and the server's page behind it."""

    def __init__(
        self, browser: Any, shown: Viewer, size: dict[str, int] | None = None, context: Any = None
    ) -> None:
        self.faults: list[str] = []
        self.requested: list[str] = []
        before = set(shown.pages)
        self.context = context or browser.new_context(viewport=size or SMALL)
        self.tab = self.context.new_page()
        self.tab.set_default_timeout(1e3 * PATIENCE)
        self.tab.on("console", lambda said: self.faults.append(said.text) if said.type == "error" else None)
        self.tab.on("pageerror", lambda error: self.faults.append(str(error)))
        self.tab.on("request", lambda request: self.requested.append(request.url))
        self.tab.add_init_script(QUIET)
        self.tab.goto(shown.url)
        self.until(lambda: set(shown.pages) - before)
        (number,) = set(shown.pages) - before
        self.page: Any = shown.pages[number]
        self.until(lambda: self.status == "good")

    def until(self, there: Callable[[], object]) -> None:
        """Wait, and let the browser work meanwhile."""
        end = time.monotonic() + PATIENCE
        while not there():
            assert time.monotonic() < end, "waited in vain"
            self.tab.wait_for_timeout(50)

    @property
    def status(self) -> str | None:
        """What kind of news the browser shows."""
        found = self.tab.locator("[data-status]")
        return found.first.get_attribute("data-status") if found.count() else None

    @property
    def words(self) -> str:
        """All that the browser shows as text."""
        return str(self.tab.inner_text("body"))

    def look(self, name: str = "") -> np.ndarray[Any, np.dtype[Any]]:
        """A picture of the page, (height, width, 3)."""
        import io

        from PIL import Image

        self.tab.wait_for_timeout(600)
        taken = self.tab.screenshot()
        if PICTURES and name:
            Path(PICTURES).mkdir(parents=True, exist_ok=True)
            (Path(PICTURES) / f"{name}.png").write_bytes(taken)
        return np.asarray(Image.open(io.BytesIO(taken)).convert("RGB")).astype(int)

    def leave(self) -> None:
        """Close the page; it must have had no faults, and asked nobody else for anything."""
        self.context.close()
        assert not self.faults
        assert all(
            url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "blob:", "data:"))
            for url in self.requested
        )


@pytest.fixture(scope="module")
def opened(browser: Any, shown: Viewer) -> Iterator[Visit]:
    visit = Visit(browser, shown)
    yield visit
    visit.leave()


@pytest.fixture
def visit(opened: Visit) -> Iterator[Visit]:
    """One page for most tests, each of which begins as a new page does."""
    begin = opened.page._session.begin
    opened.page.change(
        **{name: getattr(begin, name) for name in begin.__dataclass_fields__ if name != "camera"}
    )
    opened.until(lambda: opened.page.idle and opened.page.result.reached and opened.status == "good")
    yield opened
    assert not opened.faults


def orange(picture: np.ndarray[Any, Any]) -> int:
    """Pixels of the colour of links."""
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    return int(((red > 130) & (green > 0.5 * red) & (green < 0.93 * red) & (blue < 0.55 * red)).sum())


def test_the_arm_appears(visit: Visit) -> None:
    visit.page.view.see(ghosts=False, meshes=True)
    with_arm = visit.look("arm")
    visit.page.view._arm_drawn.node.visible = False
    without = visit.look()
    assert orange(with_arm) > 60
    assert orange(without) < 0.2 * orange(with_arm)
    assert (np.abs(with_arm - without).sum(axis=2) > 60).sum() > 300
    assert "kinseek: ur5e" in visit.words
    assert "shoulder_lift_joint" in visit.words


def test_a_goal_is_moved_and_the_answer_follows(visit: Visit) -> None:
    before = visit.page.result
    target = before.options.target.copy()
    target[2, 3] += 0.05
    visit.page.change(target=target)
    visit.until(lambda: visit.page.result is not before and visit.page.idle)
    assert visit.page.result.reached
    assert np.allclose(visit.page.arm.fk(visit.page.result.q), target, atol=1e-5)
    shown = words_of_joints(visit)
    visit.until(lambda: shown != words_of_joints(visit) or shown == expected(visit))
    visit.until(lambda: words_of_joints(visit) == expected(visit))


def words_of_joints(visit: Visit) -> list[str]:
    """Joint values as the browser shows them."""
    return [
        text for text in visit.tab.locator("[data-joints]").inner_text().split("\n") if text.endswith("°")
    ]


def expected(visit: Visit) -> list[str]:
    return [f"{value:.1f}°" for value in np.degrees(visit.page.result.q)]


def test_the_gizmo_is_dragged_with_the_mouse(visit: Visit) -> None:
    visit.page.change(ghosts=False)
    before = visit.page.options.target.copy()
    x, y = on_screen(visit, before[:3, 3])
    moved = False
    # The square handles lie beside the middle; which is in front depends on the view.
    for dx, dy in [(0, 0), (12, -12), (-12, -12), (12, 12), (-12, 12), (0, -25), (25, 0), (-25, 0), (0, 25)]:
        visit.tab.mouse.move(x + dx, y + dy)
        visit.tab.wait_for_timeout(150)
        visit.tab.mouse.down()
        for step in range(1, 5):
            visit.tab.mouse.move(x + dx + 6 * step, y + dy - 4 * step)
            visit.tab.wait_for_timeout(80)
        visit.tab.mouse.up()
        visit.tab.wait_for_timeout(150)
        moved = bool(np.abs(visit.page.options.target - before).max() > 1e-3)
        if moved:
            break
    assert moved, "no handle was met"
    visit.until(lambda: visit.page.idle)
    assert np.allclose(visit.page.result.options.target, visit.page.options.target)


def on_screen(visit: Visit, point: Any) -> tuple[float, float]:
    """Where in the window a point is, as the browser's own camera has it."""
    from scipy.spatial.transform import Rotation

    camera = visit.page._client.camera
    seen = Rotation.from_quat(camera.wxyz[[1, 2, 3, 0]]).inv().apply(np.asarray(point) - camera.position)
    width, height = camera.image_width, camera.image_height
    canvas = visit.tab.locator("canvas").first.bounding_box()
    scale = canvas["height"] / 2 / np.tan(camera.fov / 2)
    assert width
    assert height
    return canvas["x"] + canvas["width"] / 2 + scale * seen[0] / seen[2], canvas["y"] + canvas[
        "height"
    ] / 2 + scale * seen[1] / seen[2]


def test_out_of_reach_is_shown_and_proved(visit: Visit) -> None:
    target = visit.page.options.target.copy()
    target[:3, 3] *= 2.5
    visit.page.change(target=target, boxes=True)
    visit.until(lambda: visit.status == "bad")
    visit.until(lambda: visit.page.idle)
    assert visit.page.proof.unreachable
    visit.until(lambda: "Proved: every pose has a weighted error of at least" in visit.words)
    bound = visit.page.proof.certificate.lower_bound
    visit.until(lambda: f"{bound:.4g}" in visit.words)
    assert "boxes are left" in visit.page.panel.seen.content
    visit.look("unreachable")
    visit.page.change(target=visit.page.arm.fk(visit.page.result.q))
    visit.until(lambda: visit.status == "good")


def test_a_motion_is_played(browser: Any) -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.1, -1.0, 1.2, -0.4, 0.5, 0.0]) + np.linspace(0.0, 1.0, 40)[:, None]
    motion = arm.follow(arm.fk(q), start=q[0]).timed(acceleration=4.0)
    with viewer.show(arm, trajectory=motion, port=0, block=False, open_browser=False) as running:
        visit = Visit(browser, running)
        visit.page.show_time(0.0)
        visit.until(lambda: f"0.000 of {motion.duration:.3f} s" in visit.words)
        np.testing.assert_array_equal(visit.page.options.q, motion.q(0.0))
        before = visit.look("motion begin")
        visit.tab.get_by_role("button", name="play").first.click()
        visit.until(lambda: f"{motion.duration:.3f} of {motion.duration:.3f} s" in visit.words)
        np.testing.assert_array_equal(visit.page.options.q, motion.q(motion.duration))
        assert (np.abs(visit.look("motion end") - before) > 40).any(axis=2).mean() > 0.01
        # The slider, one step back from the end.
        visit.tab.get_by_role("slider").first.press("ArrowLeft")
        visit.until(lambda: f"{motion.duration:.3f} of" not in visit.words)
        assert np.abs(visit.page.options.q - motion.q(motion.duration)).max() < 0.1
        visit.leave()


def test_the_goal_drives_a_tracker(browser: Any) -> None:
    with viewer.show(kinseek.load("ur5e"), port=0, block=False, open_browser=False) as running:
        visit = Visit(browser, running)
        visit.tab.get_by_text("Servo", exact=True).first.click()
        visit.tab.locator("label:has-text('The goal drives the arm')").first.click()
        visit.until(lambda: visit.tab.locator("[data-shares='6']").count())
        target = visit.page.options.target @ kinseek.pose([0.1, 0.0, 0.1])
        visit.page.change(target=target)
        visit.until(lambda: "Lagging" in visit.words)
        visit.look("servo")
        visit.until(lambda: "Tracking" in visit.words)
        visit.until(lambda: np.allclose(visit.page.arm.fk(visit.page.options.q), target, atol=1e-6))
        # A slower arm, from the slider.
        visit.tab.get_by_role("slider").first.press("Home")
        visit.until(lambda: visit.page.panel.limits["acceleration"] == 1.0)
        visit.page.change(target=visit.page._session.begin.target)
        visit.until(lambda: "acceleration of" in visit.words)
        visit.tab.locator("label:has-text('The goal drives the arm')").first.click()
        visit.until(lambda: visit.status == "good" and visit.page.idle)
        visit.until(lambda: "FK evaluations" in visit.words)
        visit.tab.locator("label:has-text('The goal drives the arm')").first.click()
        visit.until(lambda: visit.tab.locator("[data-shares]").count())
        visit.leave()
        page = visit.page
    end = time.monotonic() + PATIENCE
    while page._player._thread.is_alive():
        assert time.monotonic() < end, "the tracker goes on after its page"
        time.sleep(0.05)


def red(picture: np.ndarray[Any, Any]) -> int:
    """Pixels of the colour of what is hit, over white or grey."""
    red, green, blue = picture[:, :500, 0], picture[:, :500, 1], picture[:, :500, 2]
    return int(((red > 1.5 * green) & (red > 1.5 * blue) & (red > 120)).sum())


def test_a_scene_is_edited_and_a_motion_is_planned(browser: Any) -> None:
    pytest.importorskip("coal")
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    scene.add_box("wall", (0.5, 0.1, 0.5), kinseek.pose([0.55, 0.0, 0.25]))
    right, left = kinseek.pose([[0.45, -0.3, 0.35], [0.45, 0.3, 0.35]], rpy=[np.pi, 0.0, 0.0])
    with viewer.show(arm, scene=scene, port=0, block=False, open_browser=False) as running:
        visit = Visit(browser, running)
        visit.page.change(target=right, ghosts=False)
        visit.until(lambda: visit.page.idle and visit.page.result.reached)
        free = visit.look("scene")
        visit.tab.get_by_role("tab", name="Scene").click()
        visit.tab.get_by_text("Plan a motion").click()
        visit.until(lambda: visit.page.planning and visit.page.idle)
        visit.page.change(target=left)
        visit.until(lambda: "proved free" in visit.words and visit.page.idle)
        planned = visit.page.trajectory
        assert scene.free(planned.q(np.linspace(0.0, planned.duration, 500))).all()
        visit.look("planned")
        visit.tab.get_by_role("button", name="play").first.click()
        visit.until(lambda: f"{planned.duration:.3f} of {planned.duration:.3f} s" in visit.words)
        # A click on the wall selects it; then it is moved onto the goal.
        x, y = on_screen(visit, [0.55, -0.05, 0.1])
        visit.tab.mouse.click(x, y)
        visit.until(lambda: visit.page._selected == "wall")
        visit.page.place_body(left)
        visit.until(lambda: visit.status == "bad" and "Hit:" in visit.words)
        assert red(visit.look("hit")) > red(free) + 500
        visit.until(lambda: "No motion. Proved blocked" in visit.words)
        visit.tab.get_by_role("button", name="remove").click()
        visit.until(lambda: visit.status == "good" and "scene.remove('wall')" in visit.words)
        visit.tab.get_by_role("button", name="add a box").click()
        visit.until(lambda: "scene.add_box('box 1'" in visit.words)
        visit.look("added")
        visit.leave()


def test_a_search_is_switched_and_shown_pass_by_pass(visit: Visit) -> None:
    visit.tab.get_by_text("Search", exact=True).first.click()
    visit.page.change(search="DivideAndConquer")
    visit.until(lambda: visit.page.result.trace is not None and visit.page.idle)
    visit.until(lambda: visit.tab.get_by_text("B, nodes a joint").is_visible())
    visit.tab.get_by_label("Pass by pass").or_(
        visit.tab.locator("label:has-text('Pass by pass')")
    ).first.click()
    visit.until(lambda: visit.tab.locator("[data-pass]").count() > 0)
    last = len(visit.page.trace) - 1
    visit.until(lambda: visit.tab.locator("[data-pass]").first.get_attribute("data-pass") == str(last))
    visit.page.choose_pass(1)
    visit.until(lambda: visit.tab.locator("[data-pass]").first.get_attribute("data-pass") == "1")
    visit.look("pass")
    visit.tab.get_by_role("button", name="step").click()
    visit.until(lambda: visit.tab.locator("[data-pass]").first.get_attribute("data-pass") == "2")
    visit.tab.get_by_role("button", name="play").click()
    visit.until(lambda: visit.tab.locator("[data-pass]").first.get_attribute("data-pass") == "0")
    visit.until(lambda: visit.tab.locator("[data-pass]").first.get_attribute("data-pass") == str(last))
    visit.page.change(search="Atlas")
    visit.until(lambda: visit.status == "good")


def test_a_goal_typed_in_millimetres_is_refused(visit: Visit) -> None:
    before = visit.page.result.q
    visit.tab.get_by_text("Goal", exact=True).first.click()
    box = visit.tab.locator("input[inputmode='decimal'], input[type='number']").first
    box.fill("650")
    box.press("Enter")
    visit.until(lambda: visit.status == "refused")
    assert "lengths are in metres" in visit.words
    assert np.array_equal(visit.page.result.q, before)


def test_branches_are_stepped_through(visit: Visit) -> None:
    visit.until(lambda: visit.page.idle)
    seen = {tuple(np.round(visit.page.result.q, 3))}
    for _ in range(len(visit.page.branches) - 1):
        before = visit.page.result
        visit.tab.get_by_role("button", name="next").click()
        visit.until(partial(answered_after, visit, before))
        visit.until(lambda: visit.page.idle)
        assert visit.page.result.reached
        seen.add(tuple(np.round(visit.page.result.q, 3)))
    assert len(seen) == len(visit.page.branches)


def answered_after(visit: Visit, before: Any) -> bool:
    return visit.page.result is not before


def test_two_people_have_a_goal_each(browser: Any, shown: Viewer, visit: Visit) -> None:
    other = Visit(browser, shown)
    mine, theirs = visit.page.options.target.copy(), other.page.options.target.copy()
    theirs[:3, 3] *= 2.5
    other.page.change(target=theirs)
    other.until(lambda: other.status in ("open", "bad"))
    assert visit.status == "good"
    assert np.array_equal(visit.page.options.target, mine)
    assert len(shown.pages) == 2
    other.leave()
    visit.until(lambda: len(shown.pages) == 1)


def test_closing_and_coming_back_loses_nothing(browser: Any, shown: Viewer) -> None:
    context = browser.new_context(viewport=SMALL)
    first = Visit(browser, shown, context=context)
    target = first.page.options.target.copy()
    target[0, 3] += 0.02
    first.page.change(target=target, free=["rz"], samples=True)
    first.until(lambda: first.page.idle)
    kept = "() => Object.values(localStorage).some(each => each.includes('\"samples\": true'))"
    first.until(lambda: first.tab.evaluate(kept))
    first.tab.close()
    again = Visit(browser, shown, context=context)
    assert np.allclose(again.page.options.target, target)
    assert again.page.options.free == ("rz",)
    assert again.page.options.samples
    again.leave()
    assert not first.faults


def test_wide_and_narrow_light_and_dark(visit: Visit) -> None:
    for name, width, height in (("wide", 1280, 800), ("narrow", 420, 860)):
        visit.tab.set_viewport_size({"width": width, "height": height})
        for dark in (False, True):
            visit.page.change(dark=dark)
            visit.until(lambda: visit.page.idle)
            picture = visit.look(f"{name}_{'dark' if dark else 'light'}")
            corner = picture[-40:-10, 10:40].mean()
            assert corner < 100 if dark else corner > 150
            assert orange(picture) > 40
            overflow = "() => document.documentElement.scrollWidth > document.documentElement.clientWidth"
            assert not visit.tab.evaluate(overflow)
    visit.tab.set_viewport_size(SMALL)


def test_a_taken_port_is_said(browser: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with viewer.show(kinseek.load("planar2"), port=port, block=False, open_browser=False) as running:
            said = capsys.readouterr().out
            assert running.port != port
            assert f"Port {port} is taken" in said
            assert running.url in said


def test_nobody_can_make_a_page_public(shown: Viewer) -> None:
    assert shown._server.request_share_url() is None
    assert shown.public_url is None
    assert shown._server._share_tunnel is None


def test_the_page_connects_to_its_own_server_only(browser: Any, shown: Viewer) -> None:
    """Even if foreign JavaScript ran in the page, or an address named another server."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(0.5)
        address = f"127.0.0.1:{other.getsockname()[1]}"
        context = browser.new_context(viewport=SMALL)
        tab = context.new_page()
        result = tab.goto(f"{shown.url}?websocket=ws://{address}/")
        assert result.status == 403
        tab.goto(shown.url)
        blocked = tab.evaluate(
            """async (address) => {
              const blocked = [];
              addEventListener("securitypolicyviolation", (event) => blocked.push(event.blockedURI));
              await fetch(`http://${address}/`).catch(() => 0);
              new WebSocket(`ws://${address}/`);
              while (blocked.length < 2) await new Promise((again) => setTimeout(again, 50));
              return blocked;
            }""",
            address,
        )
        assert [each.split("//")[1].strip("/") for each in blocked] == [address] * 2
        with pytest.raises(TimeoutError):
            other.accept()
        context.close()


def test_a_page_of_another_origin_can_show_it_in_a_frame(browser: Any, shown: Viewer) -> None:
    """As a notebook does."""
    text = f"<!doctype html><iframe src='{shown.url}' width='780' height='540'></iframe>".encode()

    class Notebook(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(text)

        def log_message(self, *args: Any) -> None:
            pass

    before = set(shown.pages)
    context = browser.new_context(viewport=SMALL)
    with ThreadingHTTPServer(("127.0.0.1", 0), Notebook) as notebook:
        threading.Thread(target=notebook.serve_forever).start()
        tab = context.new_page()
        tab.goto(f"http://127.0.0.1:{notebook.server_port}/")
        frame = tab.frame_locator("iframe")
        frame.locator("[data-status='good']").first.wait_for(timeout=1e3 * PATIENCE)
        assert set(shown.pages) - before
        context.close()
        notebook.shutdown()


def test_an_arm_that_is_a_function_has_a_page(browser: Any) -> None:
    others = {each.name for each in threading.enumerate()}

    def fk(q: Any) -> Any:
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, 0, 3], T[:, 2, 3] = 0.5 * np.cos(q[:, 0]) * q[:, 1], 0.5 * np.sin(q[:, 0]) * q[:, 1]
        return T

    arm = kinseek.Arm.from_fk(fk, [0.0, 0.5], [3.0, 1.0], names=["turn", "reach"])
    with viewer.show(arm, port=0, block=False, open_browser=False) as running:
        visit = Visit(browser, running)
        visit.tab.get_by_text("See", exact=True).click()
        visit.until(lambda: "the positions of its links are unknown" in visit.words)
        target = visit.page.options.target.copy()
        target[2, 3] += 3.0
        visit.page.change(target=target)
        visit.until(lambda: visit.status == "open")
        visit.until(lambda: "Nothing can be proved" in visit.words)
        visit.leave()
    end = time.monotonic() + PATIENCE
    while any(
        each.name.startswith("kinseek page") and each.name not in others for each in threading.enumerate()
    ):
        assert time.monotonic() < end, "threads of a page go on after it"
        time.sleep(0.05)
