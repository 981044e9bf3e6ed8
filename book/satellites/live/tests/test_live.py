"""The live page in a real browser, and the command as a process."""

import signal

import pytest
from processes import ended, started, wait_until

from workbench.pages.browser import CHROMIUM

pytest.importorskip("mink", reason="the extra 'slave' is missing")
pytest.importorskip("tornado", reason="the extra 'live' is missing")

from livepage import NOBODY, RIG, Bench, Live, Tab, shows

from satellites.live.command import chosen

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing")
WIDE_PAGE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SMALL = """[...document.querySelectorAll('button, input[type=range]')].filter(one => one.offsetParent
    && one.getBoundingClientRect().height < 18).map(one => one.id)"""


# Of each camera: its name on the page, its size in CSS px, and whether it lies on the picture.
NAMES = """[...document.querySelectorAll('#cameras > div')].map(place => {
  const [picture, name] = [...place.children].map(one => one.getBoundingClientRect());
  const {fontSize} = getComputedStyle(place.children[1]);
  const inside = name.left >= picture.left && name.right <= picture.right && name.bottom <= picture.bottom;
  return [place.children[1].textContent, parseFloat(fontSize), inside];
})"""


def assert_names_can_be_read(browser):
    names = browser.evaluate(NAMES)
    assert [name for name, _, _ in names] == list(RIG.names)
    for _, px, inside in names:
        assert px >= 11
        assert inside


@needs_browser
def test_clutch_is_clicked_and_a_slider_moved(live, browser):
    browser.click("#clutch")
    shows(
        browser, "last.clutch && document.getElementById('coupled').textContent === 'clutch closed'"
    )
    assert live.loop.newest.clutch
    # a slider by its keys: right is a step
    browser.evaluate("document.getElementById('set-delay_ms').focus()")
    for _ in range(3):
        browser.press("ArrowRight")
    shows(browser, "last.values.delay_ms === 30")
    assert "30 ms" in browser.evaluate(
        "document.getElementById('sliders').innerText + "
        "document.querySelectorAll('output')[2].value"
    )
    browser.click("#clutch")
    shows(browser, "!last.clutch")
    assert browser.errors == []


# How many pixels of a canvas have a colour, and how many are neither black nor empty.
PIXELS = """(id => {
    const canvas = document.getElementById(id);
    const all = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let coloured = 0, drawn = 0;
    for (let k = 0; k < all.length; k += 4) {
        const [r, g, b, a] = all.slice(k, k + 4);
        if (a && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured++;
        if (a && Math.max(r, g, b) > 20) drawn++;
    }
    return [coloured, drawn];
})"""


@needs_browser
def test_the_page_shows_the_images_the_spaces_the_pose_and_the_times(live, browser):
    shows(browser, "last.way.whole > 0")
    for camera in range(3):
        coloured, drawn = browser.evaluate(f"{PIXELS}('camera-{camera}')")
        assert coloured > 100  # window, markers and axes are drawn in colour
        assert drawn > 20_000  # the image
    assert browser.evaluate(f"{PIXELS}('world')")[0] > 100  # the rod, the cameras
    assert browser.evaluate(f"{PIXELS}('arm')")[0] > 100
    number = "Number(document.getElementById('pose-{}').textContent)"
    pose = live.loop.newest.tracked.measurement.pose
    for name, value in (("z_mm", pose.T_world_handle.translation[2]), ("sigma_mm", pose.sigma_mm)):
        assert browser.evaluate(number.format(name)) == pytest.approx(value, abs=0.1)
    assert browser.evaluate("document.getElementById('status').textContent") == "measured"
    times = browser.evaluate("[...document.querySelectorAll('#stages b')].map(b => b.textContent)")
    assert len(times) == 5
    assert all(time.endswith(" ms") for time in times)
    assert browser.evaluate("document.getElementById('whole').textContent").endswith(" ms")


@needs_browser
@pytest.mark.heavy
def test_after_kill_9_the_page_says_that_the_connection_is_lost(browser, tmp_path):
    process = started("live --simulation --no-browser --out .", cwd=tmp_path)
    browser.open(process.stdout.readline().strip())
    shows(browser, "last")
    process.kill()
    shows(browser, "document.getElementById('banner').textContent.includes('connection is lost')")
    shows(browser, "document.getElementById('banner').textContent.includes('The arm holds')")
    process.communicate()


@needs_browser
@pytest.mark.parametrize("width", [pytest.param(1280, marks=pytest.mark.heavy), 400])
def test_all_goes_by_keyboard_and_nothing_is_wider_than_the_window(live, browser, width, tmp_path):
    browser.resize(width)
    assert browser.evaluate(WIDE_PAGE) == 0
    assert browser.evaluate(SMALL) == []
    assert_names_can_be_read(browser)
    browser.press("c")
    shows(browser, "last.clutch")
    browser.press("c")
    shows(browser, "!last.clutch")
    browser.press("b", up=False)  # the pedal
    shows(browser, "last.clutch")
    browser.let_go("b")
    shows(browser, "!last.clutch")
    browser.press("r")
    shows(browser, "last.recording")
    number = live.loop.newest.frames.number
    live.seen(lambda now: now.frames.number > number + 3)
    browser.press("r")
    shows(browser, "last.said.startsWith('recorded')")
    # another key for the pedal
    browser.evaluate("document.getElementById('pedal').focus()")
    browser.press("Enter")
    shows(browser, "document.getElementById('pedal').textContent === 'press it'")
    browser.press("x")
    browser.press("x", up=False)
    shows(browser, "last.clutch")
    browser.let_go("x")
    shows(browser, "!last.clutch")
    seen = set()
    for _ in range(30):  # Tab reaches what can be set
        browser.press("Tab")
        seen.add(browser.evaluate("document.activeElement.id"))
    assert {
        "clutch",
        "record",
        "pedal",
        "set-scale",
        "set-delay_ms",
        "camera-0",
        "world",
        "arm",
    } <= seen
    assert browser.errors == []


@needs_browser
def test_the_arm_holds_on_a_lost_pose_and_says_so(live, bench, browser):
    browser.click("#clutch")
    shows(browser, "last.clutch && !last.held")
    bench.images = NOBODY
    shows(browser, "last.held")
    shows(browser, "document.getElementById('banner').textContent.includes('The arm holds (pose')")
    held = live.seen(lambda now: now.moment.state.held)
    target = held.moment.state.target.translation
    bench.images = Bench().images
    shows(browser, "last.status === 'measured' && last.held")  # until the clutch is opened
    assert (live.loop.newest.moment.state.target.translation == target).all()
    browser.click("#clutch")
    shows(browser, "!last.held && document.getElementById('banner').hidden")


@needs_browser
@pytest.mark.parametrize("how", ["pulled out", pytest.param("frozen", marks=pytest.mark.heavy)])
def test_a_camera_that_fails_is_said_and_the_arm_holds(live, bench, browser, how):
    browser.click("#clutch")
    shows(browser, "last.clutch && !last.held")
    if how == "frozen":
        bench.paused = True
        words = "ccd2: no new image"
    else:
        bench.broken = "delivers no image after 8 instants"
        words = "ccd2: delivers no image"
    shows(browser, "document.getElementById('banner').textContent.includes('" + words + "')")
    shows(browser, "last.held")
    bench.paused, bench.broken = False, ""
    shows(browser, "last.troubles.length === 0")


@needs_browser
@pytest.mark.heavy
def test_a_second_tab_takes_over_and_the_first_says_so(live, browser):
    other = Tab(live.address)
    assert "another tab" in other.hear()["busy"]
    other.say(take=True)
    other.until(lambda said: "number" in said)
    shows(browser, "!document.getElementById('busy').hidden")
    assert browser.evaluate("document.getElementById('clutch').disabled")
    browser.click("#take")
    shows(browser, "last && document.getElementById('busy').hidden")
    other.close()
    browser.click("#clutch")
    shows(browser, "last.clutch")


@needs_browser
def test_a_page_that_stands_still_loses_the_clutch_and_comes_back_to_the_present(browser, tmp_path):
    with Live(Bench().source, tmp_path, silence_s=1.0) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        browser.evaluate("send({clutch: true})")
        before = live.seen(lambda now: now.clutch or any("clutch" in w for w in now.notes)).number
        browser.evaluate("{const end = Date.now() + 3000; while (Date.now() < end);}")
        stood = live.loop.newest.number
        assert stood > before + 5
        shows(browser, f"last.number >= {stood}")
        shows(browser, "last.notes.some(one => one.includes('did not answer'))")
        assert not live.loop.newest.clutch


@needs_browser
def test_the_mouse_moves_the_simulated_hand_and_the_pose_is_seen_to_move(browser, tmp_path):
    with Live(chosen(seed=1), tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        browser.click("#home")
        shows(browser, "Math.abs(last.pose.x_mm) < 1 && Math.abs(last.pose.y_mm) < 1")
        browser.drag("#camera-0", 80, 0)
        shows(browser, "last.status === 'measured' && last.pose.x_mm > 10")
        assert abs(live.loop.newest.tracked.measurement.pose.T_world_handle.translation[1]) < 5
        assert browser.errors == []


def test_ctrl_c_ends_the_command_and_keeps_the_recording(tmp_path):
    process = started("live --simulation --no-browser --out .", cwd=tmp_path)
    address = process.stdout.readline().strip()
    tab = Tab(address)
    tab.until(lambda said: "number" in said)
    tab.say(record=True)
    tab.until(lambda said: said.get("recording") and said["number"] > 5)
    wait_until(lambda: list(tmp_path.glob("*.partial/images/ccd3/*.png")), process)
    process.send_signal(signal.SIGINT)
    assert "the arm holds" in tab.until(lambda said: "bye" in said)["bye"]
    tab.close()
    out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    (folder,) = tmp_path.iterdir()
    assert "instants" in out.splitlines()[-1]
    assert str(folder.name) in out
    assert not folder.name.endswith(".partial")


@pytest.mark.heavy
def test_a_port_that_is_taken_is_said(tmp_path):
    with Live(Bench().source, tmp_path) as live:
        port = live.address.split(":")[2].split("/")[0]
        process = started(f"live --simulation --no-browser --port {port}", cwd=tmp_path)
        code, lines = ended(process)
    assert code == 2
    assert len(lines) == 1
    assert f"port {port}: cannot be opened" in lines[0]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("live --simulation --out nowhere", "nowhere: no such folder"),
        ("live --camera a", "--camera: expected NAME=INDEX"),
        ("live --camera ccd1=0", "need --rig and --handle"),
        ("live", "one of the arguments"),
    ],
)
def test_wrong_arguments_get_one_line(line, message, capsys):
    from workbench.cli import main

    try:
        code = main(line.split())
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
