"""The exported page as a person uses it, in a browser. Needs chromium and its driver."""

from __future__ import annotations

import dataclasses
import io
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmfc.view.data import Motion
from dmfc.view.page import make_page

SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
HEADLESS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1200,850")


@pytest.fixture
def browser():
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for argument in (*HEADLESS, *SOFTWARE_GL):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = shutil.which("chromedriver")
    assert options.binary_location, "chromium is missing: apt-get install chromium"
    assert driver, "chromedriver is missing: apt-get install chromium-driver"
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield opened
    opened.quit()


class Page:
    """What a person sees of the page, and does to it."""

    def __init__(self, browser, path: Path) -> None:
        self.browser = browser
        browser.get(path.as_uri())
        self.wait(lambda: self.drawn("frames") > 0)

    def find(self, name: str):
        return self.browser.find_element("id", name)

    def drawn(self, what: str) -> int:
        return int(self.find("canvas").get_attribute(f"data-{what}") or 0)

    def count(self) -> int:
        return int(self.find("count").text.split()[0])

    def wait(self, there) -> None:
        from selenium.webdriver.support.ui import WebDriverWait

        WebDriverWait(self.browser, 60).until(lambda _: there())

    def press(self, key: str) -> None:
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.browser).send_keys(key).perform()

    def pixels(self, name: str = "") -> np.ndarray:
        """[h, w, 3] of the scene; kept as a file where screenshots are wanted."""
        image = self.find("canvas").screenshot_as_png
        folder = os.environ.get("DMFC_SCREENSHOTS")
        if folder and name:
            self.browser.save_screenshot(str(Path(folder) / f"view_{name}.png"))
        return np.asarray(Image.open(io.BytesIO(image)).convert("RGB")).astype(int)

    def errors(self) -> list[str]:
        return [entry["message"] for entry in self.browser.get_log("browser")]


def skin(pixels: np.ndarray) -> int:
    """Pixels of the colour of the hand."""
    red, green, blue = pixels.transpose(2, 0, 1)
    return int(((red > 110) & (red - blue > 30) & (red > green) & (green > blue)).sum())


@pytest.mark.full
def test_grasps_are_filtered_and_picked(browser, view, tmp_path):
    from selenium.webdriver.common.keys import Keys

    path = tmp_path / "page.html"
    path.write_text(make_page(view))
    page = Page(browser, path)
    assert page.find("title").text == view.title
    assert page.count() == len(view.grasps.confidence) == 40
    hand = sum(len(mesh.vertices) for mesh in view.hand)
    assert page.drawn("hand-vertices") == hand
    with_hand = page.pixels("field")
    assert skin(with_hand) > 5000

    page.press(Keys.ESCAPE)
    page.wait(lambda: page.drawn("hand-vertices") == 0)
    field = page.pixels()
    assert skin(field) < 0.1 * skin(with_hand)

    slider = page.find("threshold")
    slider.click()  # the middle: 0.5
    half = page.count()
    assert abs(half - 20) <= 1
    slider.send_keys(Keys.END)
    assert page.count() == 1
    # The only glyph left is the best grasp's: a click on its palm shows its hand.
    at = browser.execute_script("const s = onScreen(); return [s[3], s[4]]")
    canvas = page.find("canvas")
    click(browser, canvas, at)
    page.wait(lambda: page.drawn("hand-vertices") == hand)
    assert page.find("about").text.startswith("rank 1 of 40, confidence 0.900")

    slider.send_keys(Keys.HOME)
    page.find("best").find_elements("tag name", "button")[4].click()
    assert page.find("about").text.startswith("rank 5 of 40")
    page.press(Keys.ARROW_RIGHT)
    assert page.find("about").text.startswith("rank 6 of 40")
    palm = view.grasps.T_world_link[5, 0, :3, 3]
    assert ", ".join(f"{value:.3f}" for value in palm) in page.find("about").text
    assert page.errors() == []


@pytest.mark.full
def test_a_trial_is_played_and_scrubbed(browser, view, tmp_path):
    from selenium.webdriver.common.keys import Keys

    frames = 6
    T = np.repeat(view.grasps.T_world_link[:1], frames, axis=0)
    T[:, :, 2, 3] += np.linspace(0, 0.1, frames)[:, None]
    motion = Motion(
        "trial 0:0", "held", 0.1 * np.arange(1, frames + 1), ["raise"] * 2 + ["lift"] * 4, T,
        np.zeros((frames, 0, 4, 4)),
    )  # fmt: skip
    path = tmp_path / "page.html"
    path.write_text(make_page(dataclasses.replace(view, motion=motion)))
    page = Page(browser, path)
    parts = page.find("phases").find_elements("tag name", "span")
    assert [part.text for part in parts] == ["raise", "lift"]
    assert page.find("clock").text == "0.1 s of 0.6 s"
    start = page.pixels()
    page.find("play").click()
    page.wait(lambda: page.find("clock").text == "0.6 s of 0.6 s: held")
    end = page.pixels("trial")
    assert np.abs(start - end).max(2).mean() > 1
    page.find("time").send_keys(Keys.HOME)
    assert page.find("clock").text == "0.1 s of 0.6 s"
    # Between two looks poses are interpolated.
    height = browser.execute_script("seek(0.35); return between(motion.links, L * POSE)[11]")
    assert height == pytest.approx((T[2, 0, 2, 3] + T[3, 0, 2, 3]) / 2, abs=1e-5)
    assert page.errors() == []


@pytest.mark.full
def test_mouse_and_fingers_move_the_view(browser, view, tmp_path):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

    path = tmp_path / "page.html"
    path.write_text(make_page(view))
    page = Page(browser, path)
    canvas = page.find("canvas")

    def camera() -> dict:
        return browser.execute_script("return structuredClone(camera)")

    def touch(kind: str, *places: tuple[int, int]) -> None:
        touches = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    home = camera()
    ActionChains(browser).drag_and_drop_by_offset(canvas, 100, 0).perform()
    turned = camera()
    assert turned["azimuth"] == pytest.approx(home["azimuth"] - 0.8, abs=0.02)
    assert {**turned, "azimuth": home["azimuth"]} == home
    ActionChains(browser).scroll_from_origin(ScrollOrigin.from_element(canvas), 0, 200).perform()
    assert camera()["distance"] > 1.1 * home["distance"]
    page.find("home").click()
    assert camera() == home

    touch("touchStart", (600, 300), (700, 300))
    touch("touchMove", (550, 300), (750, 300))
    touch("touchEnd")
    assert camera()["distance"] == pytest.approx(home["distance"] / 2, rel=0.05)
    assert camera()["azimuth"] == home["azimuth"]
    assert page.drawn("hand-vertices") > 0
    assert page.errors() == []


def click(browser, canvas, at) -> None:
    """At a place of the canvas, pixels from its upper left corner."""
    from selenium.webdriver.common.action_chains import ActionChains

    size = canvas.size
    x, y = at[0] - size["width"] / 2, at[1] - size["height"] / 2
    ActionChains(browser).move_to_element_with_offset(canvas, round(x), round(y)).click().perform()
