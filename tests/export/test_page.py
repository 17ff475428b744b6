"""The page in Chromium, opened as a file: it shows arms, follows the target, and says what is out of reach."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from page_parts import build_script

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip
MOST_BYTES = 3_000_000
FRAME = 1000 / 60
"""[ms]"""
READY = "window.kinseekPage?.state"
REST = "!kinseekPage.asked && !kinseekPage.glide && !kinseekPage.proof"

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture(scope="module")
def file() -> Path:
    """The page, built from what is there."""
    if shutil.which("npm") is None:
        pytest.skip("no npm here")
    script = build_script()
    script["parts"]()
    page: Path = script["page"]()
    return page


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium here")
    with api.sync_playwright() as play:
        started = play.chromium.launch(executable_path=chromium, args=FLAGS)
        yield started
        started.close()


@pytest.fixture
def page(file: Path, browser: Any) -> Iterator[Any]:
    """The page as it comes up, which may ask for nothing else, and may have nothing to complain of."""
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    said: list[str] = []
    opened.on("console", lambda one: said.append(one.text) if "GL Driver Message" not in one.text else None)
    opened.on("pageerror", lambda error: said.append(str(error)))
    asked: list[str] = []
    opened.on("request", lambda one: asked.append(one.url))
    opened.goto(file.as_uri())
    opened.wait_for_function(READY)
    yield opened
    assert said == []
    assert [url for url in asked if not url.startswith("data:")] == [file.as_uri()]
    opened.close()


def sentence(page: Any) -> str:
    page.wait_for_function(REST)
    text: str = page.inner_text("#sentence")
    return text


def test_it_is_one_small_file_with_its_licences(file: Path) -> None:
    assert file.stat().st_size < MOST_BYTES
    text = file.read_text(encoding="utf-8")
    for words in (
        "Permission is hereby granted, free of charge",
        "three.js authors",
        "Apache License 2.0",
        "BSD-3-Clause",
    ):
        assert words in text


def test_every_arm_appears_and_is_reached(page: Any) -> None:
    names = page.eval_on_selector_all("#arm option", "all => all.map((one) => one.value)")
    assert len(names) >= 5
    for name in names:
        page.select_option("#arm", name)
        assert sentence(page).startswith("Reached"), name
        drawn = page.evaluate("kinseekPage.arm.dof")
        assert page.locator("#joints li").count() == drawn


def test_a_drag_moves_the_target_and_the_answer(page: Any) -> None:
    before = page.evaluate("[kinseekPage.target, Array.from(kinseekPage.q)]")
    x, y = page.evaluate("kinseekPage.onScreen()")
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 9):
        page.mouse.move(x + 6 * step, y - 3 * step)
    page.mouse.up()
    assert sentence(page).startswith("Reached")
    after = page.evaluate("[kinseekPage.target, Array.from(kinseekPage.q)]")
    assert after[0] != before[0]
    assert after[1] != before[1]
    away = page.evaluate(
        "(() => { const tip = kinseekPage.arm.fk(kinseekPage.q), to = kinseekPage.target;"
        " return Math.hypot(tip[3] - to[3], tip[7] - to[7], tip[11] - to[11]); })()"
    )
    assert away < 1e-6


def test_out_of_reach_is_said_and_proved(page: Any) -> None:
    page.fill("#target-x", "2400")
    text = sentence(page)
    assert text.startswith("Out of reach, proved"), text
    assert "nearest pose found is" in text
    assert page.get_attribute("#status", "data-state") == "missed"
    assert page.locator("#answers button").count() == 0
    page.click("#home")
    assert sentence(page).startswith("Reached")
    page.fill("#target-x", "")  # No number: nothing is asked.
    assert sentence(page).startswith("Reached")


def test_an_answer_is_chosen_by_its_button_and_by_the_keyboard(page: Any) -> None:
    sentence(page)
    buttons = page.locator("#answers button")
    count = buttons.count()
    assert count == 8
    chosen = page.evaluate("kinseekPage.state.chosen")
    other = (chosen + 3) % count
    buttons.nth(other).focus()
    page.keyboard.press("Enter")
    page.wait_for_function(f"{REST} && kinseekPage.state.chosen === {other}")
    assert buttons.nth(other).get_attribute("aria-pressed") == "true"
    assert page.evaluate(
        "kinseekPage.q.every((x, i) => x === kinseekPage.state.others[kinseekPage.state.chosen][i])"
    )


def test_a_move_of_the_target_costs_less_than_a_frame(page: Any) -> None:
    """Each along a way of 100 goals, after as many to warm up; drawing, without a graphics card here, is left out."""
    costs = page.evaluate(
        """kinseekPage.kernels.names.map((name) => {
            kinseekPage.take(name);
            const home = kinseekPage.target, costs = [];
            for (let k = 0; k < 200; k++) {
                const pose = home.slice();
                pose[3] += 0.05 * Math.sin(k / 16);
                pose[11] += 0.05 * Math.sin(k / 23);
                kinseekPage.aimAt(pose);
                kinseekPage.solve();
                costs.push(kinseekPage.spent);
            }
            return costs.slice(100).sort((a, b) => a - b)[50];
        })"""
    )
    print("median cost of a move [ms]:", costs)
    assert max(costs) < FRAME / 2


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 800)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_telephone_and_a_desk_by_day_and_by_night(
    file: Path, browser: Any, width: int, height: int, scheme: str, tmp_path: Path
) -> None:
    opened = browser.new_page(
        viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=width < 500
    )
    opened.goto(file.as_uri())
    opened.wait_for_function(READY)
    assert sentence(opened).startswith("Reached")
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    background = opened.evaluate("getComputedStyle(document.body).backgroundColor")
    bright = sum(int(each) for each in background[4:-1].split(",")[:3]) > 380
    assert bright == (scheme == "light")
    if width < 500:
        small = opened.eval_on_selector_all(
            "button, select, input",
            "all => all.map((one) => one.getBoundingClientRect().height).filter((h) => h < 44)",
        )
        assert small == []
    opened.screenshot(path=tmp_path / f"page-{width}-{scheme}.png")
    opened.close()
