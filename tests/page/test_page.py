"""The page of `quietlight tradeoff` as a person uses it, in headless Chromium without a network.

Needs `target/debug/quietlight`, which `cargo test` builds, and a Chromium on the path; screenshots go to `target/page`.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "target" / "page"
SCENES = ["cornell-box", "ajar-door"]
DENOISERS = ["none", "bilateral", "kpcn-fast", "kpcn-balanced"]


@pytest.fixture(scope="session")
def address() -> str:
    """A small measurement of two scenes."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    arguments = ["--integrators", "path,bdpt", "--denoisers", ",".join(DENOISERS), "--samples", "1,4", "--seeds", "2"]
    scenes = [str(ROOT / "scenes" / name) for name in SCENES]
    command = [
        str(ROOT / "target/debug/quietlight"),
        "tradeoff",
        *scenes,
        "-o",
        str(FOLDER),
        "--width",
        "48",
        *arguments,
    ]
    subprocess.run(command, check=True)
    return (FOLDER / "tradeoff.html").as_uri()


@pytest.fixture(scope="session")
def browser():
    program = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
    assert program, "no Chromium is on the path: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, address):
    """Opens the page in a window of its own; at the end it must have said nothing and asked nobody."""
    opened, said, asked = [], [], []

    def open_page(width: int = 1280, height: int = 900, colours: str = "light") -> Page:
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=colours, offline=True)
        opened.append(context)
        page = context.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        return page

    yield open_page
    for context in opened:
        context.close()
    assert said == []
    assert {url for url in asked if not url.startswith("data:")} <= {address}


def traces(page: Page, scene: str) -> int:
    return page.locator(f"#{scene} [data-plot=trade] .scatterlayer .trace").count()


def test_every_scene_begins_with_what_to_choose_and_a_chart(open_page):
    page = open_page()
    for scene in SCENES:
        section = page.locator(f"#{scene}")
        expect(section.locator(".headline")).to_have_text(re.compile("[Tt]ake (path|bdpt)"))
        expect(section.locator(".auto")).to_have_text(re.compile("^“auto” takes "))
        # The front, and two integrators as rendered and by the usual denoiser.
        assert traces(page, scene) == 5
        assert section.locator("[data-plot=trade] .scatterlayer .points path").count() == 8
        chart = section.locator("[data-plot=trade]")
        kinds = chart.evaluate("plot => [plot._fullLayout.xaxis.type, plot._fullLayout.yaxis.type]")
        assert kinds == ["log", "log"]
        distance = chart.bounding_box()["y"] - section.bounding_box()["y"]
        assert distance < 400, "the chart stands near the top"
    page.screenshot(path=FOLDER / "first.png")


def test_what_is_drawn_can_be_chosen_and_a_point_tells_its_numbers(open_page):
    page = open_page()
    section = page.locator(f"#{SCENES[0]}")
    section.locator("[data-chips=denoiser] button", has_text="bilateral").click()
    assert traces(page, SCENES[0]) == 7
    section.locator("[data-chips=integrator] button", has_text="bdpt").click()
    assert traces(page, SCENES[0]) == 4
    section.locator("[data-plot=trade] .scatterlayer .points path").first.scroll_into_view_if_needed()
    box = section.locator("[data-plot=trade] .scatterlayer .points path").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    hover = section.locator("[data-plot=trade] .hoverlayer .hovertext")
    expect(hover).to_contain_text("relative L2")
    expect(hover).to_contain_text("samples")
    section.locator("[data-split]").select_option("bdpt")
    assert section.locator("[data-plot=split] .scatterlayer .trace").count() == 2 * len(DENOISERS)


def test_the_slider_uncovers_the_left_picture(open_page):
    page = open_page()
    section = page.locator(f"#{SCENES[0]}")
    sizes = section.locator(".stage img").evaluate_all(
        "all => all.map(image => [image.naturalWidth, image.width > 200])"
    )
    assert sizes == [[48, True], [48, True]]
    stage = section.locator(".stage")
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    cut = "image => getComputedStyle(image).clipPath"
    left = section.locator("[data-image=left]")
    shown = []
    for part in (0.25, 0.75):
        page.mouse.click(box["x"] + part * box["width"], box["y"] + box["height"] / 2)
        hidden = float(re.match(r"inset\(0px ([\d.]+)%", left.evaluate(cut)).group(1))
        # A thumb as wide as itself keeps the ends from being reached: a few percent.
        assert abs(100 - hidden - 100 * part) < 5
        shown.append(stage.screenshot())
    assert shown[0] != shown[1]
    # By the keyboard, too.
    before = left.evaluate(cut)
    stage.locator("input").focus()
    page.keyboard.press("ArrowLeft")
    assert left.evaluate(cut) != before
    picture = left.get_attribute("src")
    section.locator("[data-show=map]").click()
    assert left.get_attribute("src") != picture
    section.locator("[data-side=left]").select_option("reference")
    expect(section.locator("[data-caption=left]")).to_have_text("reference")
    stage.screenshot(path=FOLDER / "errors.png")


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_text_stands_out_in_light_and_dark(open_page, colours):
    page = open_page(colours=colours)
    luminance = """element => {
        const linear = (value) => (value /= 255) <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
        const of = (colour) => { const [r, g, b] = colour.match(/[\\d.]+/g).map(Number);
            return 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b); };
        const style = getComputedStyle(element);
        return [of(style.color || style.fill), of(getComputedStyle(document.body).backgroundColor)];
    }"""
    for place in ["body", ".note", ".auto", ".best", "summary", "nav a"]:
        text, paper = page.locator(place).first.evaluate(luminance)
        # The contrast that the Web Content Accessibility Guidelines 2.2 ask for, 1.4.3.
        contrast = (max(text, paper) + 0.05) / (min(text, paper) + 0.05)
        assert contrast >= 4.5, f"{place}: {contrast:.2f}"
        assert (paper < 0.1) == (colours == "dark")
    tick = page.locator(".xtick text").first.evaluate("text => getComputedStyle(text).fill")
    assert tick == page.evaluate("getComputedStyle(document.body).color")
    page.screenshot(path=FOLDER / f"{colours}.png", full_page=True)


@pytest.mark.parametrize("width", [360, 768])
def test_a_narrow_screen_shows_all_without_scrolling_sideways(open_page, width):
    page = open_page(width=width)
    page.locator("details").first.locator("summary").click()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    plot = page.locator("[data-plot=trade] .main-svg").first.bounding_box()
    assert 0 <= plot["x"] and plot["x"] + plot["width"] <= width
    page.screenshot(path=FOLDER / f"narrow-{width}.png", full_page=True)


def test_it_prints_on_white_with_all_tables(open_page):
    page = open_page(colours="dark")
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    page.wait_for_function(
        "getComputedStyle(document.querySelector('.xtick text')).fill === getComputedStyle(document.body).color"
    )
    page.emulate_media(media="screen")
    paper = page.pdf(path=FOLDER / "printed.pdf", format="A4", print_background=True)
    assert paper.startswith(b"%PDF") and len(re.findall(rb"/Type\s*/Page\b", paper)) >= len(SCENES)
    assert page.locator("details[open]").count() == len(SCENES)
