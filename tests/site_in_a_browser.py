"""`python -m tests.site_in_a_browser SITE` opens every page of the built documentation in chromium, wide and narrow.

Nothing may be fetched from elsewhere, written on the console as an error, or reach beyond a page's right edge. Exit status 1 where
something does.
"""

from __future__ import annotations

import html
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from tests.report.browser import chromium

WIDTHS = (1280, 390)
TOGETHER = 8  # pages at a time
HARNESS = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><body>%s<pre id="found"></pre><script>
addEventListener("load", () => {
  const found = [...document.querySelectorAll("iframe")].map(frame => {
    const inside = frame.contentDocument.documentElement;
    const views = %s.map(width => {
      frame.style.width = `${width}px`;
      return {width, scroll: inside.scrollWidth, client: inside.clientWidth};
    });
    const requests = frame.contentWindow.performance.getEntriesByType("resource").map(each => each.name);
    return {page: frame.getAttribute("src"), views, requests};
  });
  document.getElementById("found").textContent = JSON.stringify(found);
});
</script></body>"""


class Quiet(SimpleHTTPRequestHandler):
    """The site's files, and nothing on the terminal."""

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a server of the folder on this machine."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()


def opened(pages: Sequence[str], site: Path, address: str) -> tuple[list[dict[str, Any]], list[str]]:
    """What each page asked for and how wide it is, and the console's lines."""
    frames = "".join(f'<iframe src="{page}" style="width:{WIDTHS[0]}px;height:900px;border:0"></iframe>' for page in pages)
    look = site / "look.html"
    look.write_text(HARNESS % (frames, json.dumps(WIDTHS)), encoding="utf-8")
    with tempfile.TemporaryDirectory() as profile:
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={profile}"]
        command = [chromium(), *options, "--window-size=1400,1000", "--dump-dom", f"{address}{look.name}"]
        finished = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    look.unlink()
    found = finished.stdout.rpartition('<pre id="found">')[2].partition("</pre>")[0]
    return json.loads(html.unescape(found)), [line for line in finished.stderr.splitlines() if ":CONSOLE" in line]


def faults(site: Path) -> list[str]:
    """Each fault in a line."""
    pages = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    looked: list[dict[str, Any]] = []
    console: list[str] = []
    with served(site) as address:
        for first in range(0, len(pages), TOGETHER):
            seen, said = opened(pages[first : first + TOGETHER], site, address)
            looked, console = looked + seen, console + said
    found = [f"console: {line}" for line in console]
    for each in looked:
        page = each["page"]
        found += [f"{page} asks for {name}" for name in each["requests"] if not name.startswith((address, "data:", "blob:"))]
        wide = [view for view in each["views"] if view["scroll"] > view["client"]]
        found += [f"{page} is {view['scroll']} px wide in a window of {view['width']} px" for view in wide]
    print(f"{len(looked)} pages, {len(found)} faults")
    return found


if __name__ == "__main__":
    wrong = faults(Path(sys.argv[1]))
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(1 if wrong else 0)
