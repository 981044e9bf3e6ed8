"""The live page in a real browser, and the command as a process."""

import signal

import pytest
from livepage import NOBODY, RIG, Bench, Live, Tab, shows
from processes import started, wait_until

from satellites.live.command import chosen
from workbench.cli import main

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


def test_clutch_is_clicked_and_a_slider_moved(live, browser):
    browser.click("#clutch")
    shows(browser, "last.clutch && $('coupled').textContent === 'clutch closed'")
    assert live.loop.newest.clutch
    # a slider by its keys: right is a step
    browser.evaluate("$('set-delay_ms').focus()")
    for _ in range(3):
        browser.press("ArrowRight")
    shows(browser, "last.values.delay_ms === 30")
    assert "30 ms" in browser.evaluate(
        "[...document.querySelectorAll('output')].map(one => one.value)"
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


def test_the_page_shows_the_images_the_spaces_the_pose_and_the_times(live, browser):
    shows(browser, "last.way.whole > 0")
    for canvas in ("camera-0", "camera-1", "camera-2", "world", "arm"):
        coloured, drawn = browser.evaluate(f"{PIXELS}('{canvas}')")
        assert coloured > 100  # window, markers and axes; the rod, the cameras
        assert drawn > 20_000 or "camera" not in canvas  # the image
    pose = live.loop.newest.tracked.measurement.pose
    for name, value in (("z_mm", pose.T_world_handle.translation[2]), ("sigma_mm", pose.sigma_mm)):
        shown = browser.evaluate(f"Number($('pose-{name}').textContent)")
        assert shown == pytest.approx(value, abs=0.1)
    assert browser.evaluate("$('status').textContent") == "measured"
    times = browser.evaluate(
        "[...document.querySelectorAll('#stages b, #whole')].map(b => b.textContent)"
    )
    assert len(times) == 6
    assert all(time.endswith(" ms") for time in times)


@pytest.mark.heavy
def test_after_kill_9_the_page_says_that_the_connection_is_lost(browser, tmp_path):
    process = started("live --simulation --no-browser --out .", cwd=tmp_path)
    browser.open(process.stdout.readline().strip())
    shows(browser, "last")
    process.kill()
    shows(browser, "$('banner').textContent.includes('connection is lost')")
    shows(browser, "$('banner').textContent.includes('The arm holds')")
    process.communicate()


@pytest.mark.parametrize("width", [pytest.param(1280, marks=pytest.mark.heavy), 400])
def test_all_goes_by_keyboard_and_nothing_is_wider_than_the_window(live, browser, width):
    browser.resize(width)
    assert browser.evaluate(WIDE_PAGE) == 0
    assert browser.evaluate(SMALL) == []
    names = browser.evaluate(NAMES)
    assert [name for name, _, _ in names] == list(RIG.names)
    assert all(px >= 11 and inside for _, px, inside in names)
    for key, clutch in (("c", "last.clutch"), ("c", "!last.clutch")):
        browser.press(key)
        shows(browser, clutch)
    pedal(browser, "b")
    browser.press("r")
    shows(browser, "last.recording")
    number = live.loop.newest.frames.number
    live.seen(lambda now: now.frames.number > number + 3)
    browser.press("r")
    shows(browser, "last.said.startsWith('recorded')")
    # another key for the pedal
    browser.evaluate("$('pedal').focus()")
    browser.press("Enter")
    shows(browser, "$('pedal').textContent === 'press it'")
    browser.press("x")
    pedal(browser, "x")
    seen = set()
    for _ in range(30):  # Tab reaches what can be set
        browser.press("Tab")
        seen.add(browser.evaluate("document.activeElement.id"))
    wanted = "clutch record pedal set-scale set-delay_ms camera-0 world arm"
    assert set(wanted.split()) <= seen
    assert browser.errors == []


def pedal(browser, key):
    """The clutch is closed as long as the key is pressed."""
    browser.press(key, up=False)
    shows(browser, "last.clutch")
    browser.let_go(key)
    shows(browser, "!last.clutch")


def test_the_arm_holds_on_a_lost_pose_and_says_so(live, bench, browser):
    browser.click("#clutch")
    shows(browser, "last.clutch && !last.held")
    bench.images = NOBODY
    shows(browser, "last.held")
    shows(browser, "$('banner').textContent.includes('The arm holds (pose')")
    held = live.seen(lambda now: now.moment.state.held)
    target = held.moment.state.target.translation
    bench.images = Bench().images
    shows(browser, "last.status === 'measured' && last.held")  # until the clutch is opened
    assert (live.loop.newest.moment.state.target.translation == target).all()
    browser.click("#clutch")
    shows(browser, "!last.held && $('banner').hidden")


def test_a_camera_that_fails_is_said_and_the_arm_holds(live, bench, browser):
    browser.click("#clutch")
    shows(browser, "last.clutch && !last.held")
    bench.broken = "delivers no image after 8 instants"
    shows(browser, "$('banner').textContent.includes('ccd2: delivers no image')")
    shows(browser, "last.held")
    bench.broken = ""
    shows(browser, "last.troubles.length === 0")


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


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("live --simulation --out nowhere", "nowhere: no such folder"),
        ("live --camera a", "--camera: expected NAME=INDEX"),
        ("live --camera ccd1=0", "need --rig and --handle"),
        ("live --recording nowhere", "nowhere: no such folder"),
        ("live", "one of the arguments"),
    ],
)
def test_wrong_arguments_get_one_line(line, message, capsys):
    try:
        code = main(line.split())
    except SystemExit as stop:
        code = stop.code
    (said,) = capsys.readouterr().err.splitlines()
    assert code == 2
    assert message in said
