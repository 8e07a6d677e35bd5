"""A person's way to the runs: `dmfc ui`, then a browser. Needs chromium and its driver."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dmfc.tracking.project import project_sweep

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 600


@pytest.fixture
def browser():
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.add_argument("--window-size=1600,1000")
    driver = shutil.which("chromedriver")
    assert options.binary_location, "chromium is missing: apt-get install chromium"
    assert driver, "chromedriver is missing: apt-get install chromium-driver"
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield opened
    opened.quit()


@pytest.fixture
def pages(finished):
    """Runs `dmfc ui` as a user does; gives what it printed: the address and the sweep's page."""
    project_sweep(finished.ledger, finished.id)
    code = "from dmfc.cli.main import main; main()"
    server = subprocess.Popen(
        [sys.executable, "-c", code, "ui", "--port", "0", "--store", finished.ledger.store],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
    )
    watchdog = threading.Timer(PATIENCE, server.kill)
    watchdog.start()
    printed = []
    assert server.stdout is not None
    for line in server.stdout:
        printed.append(line)
        if line.startswith("Ctrl-C"):
            break
    watchdog.cancel()
    yield re.findall(r"http://127\.0\.0\.1:\d+\S*", "".join(printed))
    server.send_signal(signal.SIGINT)
    assert server.wait(PATIENCE) == 0


@pytest.mark.full
def test_a_browser_sees_the_sweeps_runs(pages, browser, finished):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    _, run_page = pages

    def sees(*texts: str) -> None:
        def there(driver) -> bool:
            shown = driver.find_element(By.TAG_NAME, "body").text
            return all(text in shown for text in texts)

        WebDriverWait(browser, PATIENCE).until(there, f"{texts} on {browser.current_url}")

    sweep_id = finished.description.id
    browser.get(run_page)
    sees(sweep_id, "all.overall", "preset")
    browser.get(run_page[: run_page.index("/runs/")] + "/runs")
    sees(sweep_id, "6 matching runs")
    browser.find_element(By.CSS_SELECTOR, "[col-id*='Run Name'] button").click()  # unfolds cells
    sees(sweep_id, "pretrained-seed0", "all-seed0", "planner-seed0", "random-seed0")
    folder = os.environ.get("DMFC_SCREENSHOTS")
    if folder:
        browser.save_screenshot(str(Path(folder) / "mlflow_runs.png"))


@pytest.mark.full
def test_a_browser_shows_the_page_of_a_sweep(browser, finished):
    from selenium.webdriver.common.by import By

    from dmfc.report.page import draw_figures, write_page

    figures = draw_figures(finished.ledger, finished.description, finished.table)
    path = write_page(finished.ledger, finished.description, finished.table, figures)
    browser.get(path.as_uri())
    assert browser.title == "A tiny sweep (smoke)"
    rows = browser.find_elements(By.CSS_SELECTOR, "#rates tbody tr")
    assert len(rows) == len(finished.table.rows)
    for image in browser.find_elements(By.TAG_NAME, "img"):
        assert int(image.get_property("naturalWidth")) > 300
    assert "not finite" in browser.find_element(By.ID, "failures").text
    folder = os.environ.get("DMFC_SCREENSHOTS")
    if folder:
        browser.set_window_size(1300, 2400)
        browser.save_screenshot(str(Path(folder) / "page.png"))
