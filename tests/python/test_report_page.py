"""The report in a browser: the slider moves, and the figures are those of the journal."""

import os
from collections.abc import Iterator

import pytest

import lasergym
from headless_browser import HeadlessBrowser, browser_path
from lasergym.machine import JobReport, write_report
from synthetic_job import write_job

pytestmark = pytest.mark.skipif(
    browser_path() is None or os.name != "posix",
    reason="needs Chromium: apt-get install chromium, or LASERGYM_CHROMIUM=its path",
)

TARGET = lasergym.targets.star()
PULSES = 12


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> JobReport:
    folder = tmp_path_factory.mktemp("job")
    write_job(folder, TARGET, pulses=PULSES)
    return write_report(folder)


@pytest.fixture(scope="module")
def page(report: JobReport) -> Iterator[HeadlessBrowser]:
    url = (report.folder / "report.html").as_uri()
    with HeadlessBrowser(url, width_px=1200, height_px=900) as browser:
        yield browser


@pytest.fixture(autouse=True)
def _without_problems(page: HeadlessBrowser) -> Iterator[None]:
    yield
    page.evaluate("1")  # Events that have come meanwhile are read with the answer.
    assert page.problems == []


def text(page: HeadlessBrowser, name: str) -> str:
    shown = page.evaluate(f"document.getElementById('{name}').textContent")
    assert isinstance(shown, str)
    return shown


def figures(page: HeadlessBrowser) -> tuple[str, str, str, str]:
    pulse, reward, machined, off_target = (
        text(page, name) for name in ("pulse", "reward", "machined", "off_target")
    )
    return pulse, reward, machined, off_target


def expected(report: JobReport, pulses: int) -> tuple[str, str, str, str]:
    """What the page must say after ``pulses``, judged by the process itself."""
    score = lasergym.score(TARGET, report.trajectory(pulses)[:, :2])
    return (
        str(pulses),
        f"{score.reward:.4f}",
        f"{score.machined_fraction:.2%}",
        f"{score.off_target_fraction:.2%}",
    )


def set_slider(page: HeadlessBrowser, pulse: int) -> None:
    page.evaluate(
        f"slider.value = {pulse}; slider.dispatchEvent(new Event('input', {{bubbles: true}}))"
    )


def test_it_opens_at_the_last_pulse(page: HeadlessBrowser, report: JobReport) -> None:
    page.evaluate("location.hash = ''")
    page.wait_for(f"document.body.dataset.pulse === '{PULSES}'")
    assert figures(page) == expected(report, PULSES)


def test_the_slider_shows_every_pulse(page: HeadlessBrowser, report: JobReport) -> None:
    assert page.evaluate("slider.max") == str(PULSES)
    for pulse in range(PULSES + 1):
        set_slider(page, pulse)
        assert figures(page) == expected(report, pulse)
        circles = page.evaluate("document.querySelectorAll('#after .circle').length")
        assert circles == pulse
        dots = page.evaluate("document.querySelectorAll('#trajectory circle').length")
        assert dots == pulse


def test_keys_move_the_slider(page: HeadlessBrowser, report: JobReport) -> None:
    set_slider(page, 5)
    page.evaluate("slider.focus()")
    page.press("ArrowLeft")
    page.wait_for("document.body.dataset.pulse === '4'")
    assert figures(page) == expected(report, 4)
    page.press("Home")
    page.wait_for("document.body.dataset.pulse === '0'")
    assert figures(page) == expected(report, 0)


def test_buttons_step_and_play(page: HeadlessBrowser, report: JobReport) -> None:
    set_slider(page, 7)
    page.click("#forth")
    assert figures(page) == expected(report, 8)
    page.click("#back")
    assert figures(page) == expected(report, 7)
    set_slider(page, PULSES - 2)
    page.click("#play")
    page.wait_for(f"document.body.dataset.pulse === '{PULSES}'")
    assert figures(page) == expected(report, PULSES)


def test_the_address_names_the_pulse(page: HeadlessBrowser, report: JobReport) -> None:
    page.evaluate("location.hash = '#pulse=3'")
    page.wait_for("document.body.dataset.pulse === '3'")
    assert figures(page) == expected(report, 3)
    page.click("#forth")
    assert page.evaluate("location.hash") == "#pulse=4"


def test_circles_lie_on_the_marks_of_the_frame(page: HeadlessBrowser, report: JobReport) -> None:
    set_slider(page, 1)
    x, y, width, height = page.evaluate(
        """(() => {
            const frame = document.querySelector('#after svg');
            const mark = document.querySelector('#after .mark');
            const onto = frame.getScreenCTM().inverse().multiply(mark.getScreenCTM());
            const at = (x, y) => new DOMPoint(x, y).matrixTransform(onto);
            const center = at(mark.cx.baseVal.value, mark.cy.baseVal.value);
            return [center.x, center.y, frame.viewBox.baseVal.width, frame.viewBox.baseVal.height];
        })()"""
    )
    mark = report.marks[0]
    # 2 frame px a µm from (60, 20) on, and the view has moved by (0.1, −0.2) µm.
    assert (x, y) == pytest.approx(
        (60 + 2 * (mark.x_px + 0.1), 20 + 2 * (mark.y_px - 0.2)), abs=0.01
    )
    assert (width, height) == (320, 240)


def test_frames_are_shown(page: HeadlessBrowser) -> None:
    set_slider(page, 2)
    for place in ("before", "after"):
        page.wait_for(
            f"createImageBitmap(document.querySelector('#{place} image')) instanceof Promise"
        )
        url = page.evaluate(f"document.querySelector('#{place} image').getAttribute('href')")
        assert url.startswith("data:image/jpeg;base64,")
    set_slider(page, 0)
    assert text(page, "before") == "no frame"


def test_faults_and_phases_are_listed(page: HeadlessBrowser) -> None:
    assert text(page, "faults") == "camera: timeout, no <frame>"
    assert page.evaluate("document.querySelectorAll('#phases .bar div').length") == 7
    assert "stage moves" in text(page, "phases")


@pytest.mark.parametrize("width_px", [320, 400, 800, 1600])
def test_it_fits_the_window(report: JobReport, width_px: int) -> None:
    url = (report.folder / "report.html").as_uri() + "#pulse=7"
    with HeadlessBrowser(url, width_px=width_px, height_px=800, dark=width_px == 400) as narrow:
        narrow.screenshot(report.folder / f"report_{width_px}.png")
        assert narrow.evaluate("document.documentElement.scrollWidth") <= width_px
        assert narrow.problems == []
