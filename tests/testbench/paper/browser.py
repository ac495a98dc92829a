"""Pages as a browser has them: headless Chromium loads one, gives its text back, and takes a picture of it."""

import html.parser
import shutil
import subprocess

import pytest

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
needed = pytest.mark.skipif(not BROWSER, reason="no browser")


class Text(html.parser.HTMLParser):
    """Rows of all tables, and captions."""

    def __init__(self):
        super().__init__()
        self.rows, self.cell, self.captions, self.pictures = [], None, [], 0
        self.inside = ""

    def handle_starttag(self, tag, attrs):
        self.inside = tag
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")
        if tag == "figcaption":
            self.captions.append("")
        if tag == "img":
            self.pictures += 1

    def handle_data(self, data):
        if self.inside in ("td", "th") and self.rows:
            self.rows[-1][-1] += data
        if self.inside == "figcaption":
            self.captions[-1] += data

    def handle_endtag(self, tag):
        self.inside = ""


def parsed(source):
    """`Text` of a page's source."""
    text = Text()
    text.feed(source)
    return text


def seen(path, folder):
    """(`Text` of the page as the browser has it, path of a screenshot)."""
    common = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/profile"]
    picture = folder / "page.png"
    command = [*common, "--dump-dom", f"--screenshot={picture}", "--window-size=1300,6000", path.as_uri()]
    return parsed(subprocess.run(command, capture_output=True, text=True, timeout=120).stdout), picture
