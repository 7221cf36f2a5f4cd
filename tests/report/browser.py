"""Pages as a real browser lays them out: Debian's chromium, without a display, once for all pages and widths."""

from __future__ import annotations

import html
import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

HARNESS = """<!doctype html><meta charset="utf-8"><body>%s<pre id="found"></pre><script>
const frames = [...document.querySelectorAll("iframe")];
Promise.all(frames.map(frame => new Promise(done => {
  const measured = () => done({
    page: frame.dataset.page, width: frame.clientWidth,
    scroll: frame.contentDocument.documentElement.scrollWidth, client: frame.contentDocument.documentElement.clientWidth,
    height: frame.contentDocument.documentElement.scrollHeight,
    verdict: frame.contentDocument.querySelector(".verdict").getBoundingClientRect().bottom,
    wide: [...frame.contentDocument.querySelectorAll("main *:not(svg *)")]
      .filter(each => each.getBoundingClientRect().right > frame.clientWidth + 0.5).map(each => each.tagName),
    requests: frame.contentWindow.performance.getEntriesByType("resource").map(each => each.name),
  });
  const there = frame.contentDocument?.readyState === "complete" && frame.contentDocument.querySelector(".verdict");
  there ? measured() : frame.onload = measured;
}))).then(all => { document.getElementById("found").textContent = JSON.stringify(all); });
</script></body>"""


@dataclass(frozen=True)
class Layout:
    """How a page lies in a window: how wide it is, and what it asked for. Lengths in CSS pixels.

    Args:
        width: of the window.
        scroll_width, client_width: of the page, and of what can be seen of it.
        verdict_bottom: how far down the verdict ends.
        wide: elements that reach beyond the right edge.
        requests: what it fetched.
    """

    width: int
    scroll_width: int
    client_width: int
    verdict_bottom: float
    wide: list[str]
    requests: list[str]


def chromium() -> str:
    """The browser. Raises FileNotFoundError where there is none: install Debian's package chromium."""
    for name in NAMES:
        found = shutil.which(name)
        if found:
            return found
    raise FileNotFoundError(f"expected a browser, one of {', '.join(NAMES)}; apt-get install chromium")


def opened(pages: Mapping[str, str], widths: tuple[int, ...], folder: Path) -> tuple[dict[tuple[str, int], Layout], str]:
    """Layouts of pages by name and width, and what the browser wrote on its console."""
    frames = "".join(
        f'<iframe data-page="{name}" srcdoc="{html.escape(text)}" style="width:{width}px;height:900px;border:0"></iframe>'
        for name, text in pages.items()
        for width in widths
    )
    (folder / "harness.html").write_text(HARNESS % frames, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={folder / 'profile'}"]
    command = [chromium(), *options, "--window-size=1400,1000", "--dump-dom", (folder / "harness.html").as_uri()]
    finished = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    found = finished.stdout.rpartition('<pre id="found">')[2].partition("</pre>")[0]
    layouts = {
        (each["page"], each["width"]): Layout(
            each["width"], each["scroll"], each["client"], each["verdict"], each["wide"], each["requests"]
        )
        for each in json.loads(html.unescape(found))
    }
    console = [line for line in finished.stderr.splitlines() if "CONSOLE" in line]
    return layouts, "\n".join(console)
