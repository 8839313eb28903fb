"""One browser for all tests of this folder that need one."""

import pytest

QUIET = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)


@pytest.fixture(scope="session")
def browser(chromium):
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=QUIET)
        yield browser
        browser.close()


@pytest.fixture
def listen():
    """Open a tab that goes nowhere but to files, and note what it tries and what it says."""

    def listening(context):
        tab, complaints = context.new_page(), []

        def gate(route):
            if route.request.url.startswith(("file:", "data:", "blob:", "about:")):
                route.continue_()
            else:
                complaints.append(f"asked the network for {route.request.url}")
                route.abort()

        tab.route("**/*", gate)
        tab.on("websocket", lambda socket: complaints.append(f"opened a socket to {socket.url}"))
        tab.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(f"script error: {error}"))
        tab.on("requestfailed", lambda request: complaints.append(f"could not load {request.url}"))
        return tab, complaints

    return listening
