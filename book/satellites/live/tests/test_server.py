"""The live page's server, without a browser: who gets in, who is in charge, and what is sent when."""

import http.client
import re
import socket
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, nullcontext
from threading import Event
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import websocket
from livepage import HANDLE, RIG, TOKEN, Bench, Live, Tab
from processes import wait_until

from satellites.live import command, server
from satellites.live.loop import Loop
from satellites.live.server import FILES, MOST_MM, PAGE, move_hand
from satellites.live.sources import HOME, SimulatedHand


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    with Live(Bench().source, tmp_path_factory.mktemp("live")) as live:
        yield live


@pytest.fixture
def tab(live):
    """A page that has seen a frame."""
    tab = Tab(live.address)
    tab.until(lambda said: "number" in said)
    yield tab
    tab.close()


def asked(live, path, **headers):
    """Status and text of what the server answers."""
    host = live.address.split("/")[2]
    with closing(http.client.HTTPConnection(host, timeout=60)) as connection:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode(), dict(answer.getheaders())


def test_the_page_and_its_files_are_there_and_nothing_else(live):
    for name, (file, kind) in FILES.items():
        status, text, headers = asked(live, f"/{TOKEN}/{name}")
        assert (status, text) == (200, (PAGE / file).read_text(encoding="utf-8"))
        assert headers["Content-Type"].startswith(kind)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "Server" not in headers
    for other in ("server.py", "../loop.py", "page/live.js", "..%2f..%2f__init__.py", "index.html"):
        assert asked(live, f"/{TOKEN}/{other}")[0] == 404
    assert asked(live, f"/{TOKEN}")[0] == 302


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/live.js", {}),
        (f"/{TOKEN[:-1]}/", {}),
        (f"/{TOKEN}x/", {}),
        (f"//{TOKEN}/", {}),
        ("/socket", {}),
        (f"/{TOKEN}/", {"Origin": "http://elsewhere.example"}),
        (f"/{TOKEN}/", {"Host": "elsewhere.example:80"}),
    ],
)
def test_nothing_is_there_without_the_token_for_another_page_or_by_another_name(
    live, path, headers
):
    assert asked(live, path, **headers)[0] == 403


def test_it_listens_at_one_address_only(live):
    """All of 127.0.0.0/8 is this computer; who listens everywhere would answer here, too."""
    port = int(live.address.split(":")[2].split("/")[0])
    socket.create_connection(("127.0.0.1", port), timeout=60).close()
    with pytest.raises(OSError, match=r"."):
        socket.create_connection(("127.0.0.2", port), timeout=60)


def test_a_connection_needs_the_token_and_its_own_origin(live):
    host = live.address.split("/")[2]
    for origin in ("http://elsewhere.example", "null", "http://127.0.0.1:1"):
        with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
            Tab(live.address, origin)
    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        Tab(f"http://{host}/guess/")
    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        websocket.create_connection(f"ws://{host}/{TOKEN}/socket", suppress_origin=True)


def test_the_page_loads_nothing_from_elsewhere():
    for file, _ in FILES.values():
        text = (PAGE / file).read_text(encoding="utf-8")
        assert re.findall(r"//[^\s,]", text) == [], file


def test_two_frames_are_under_way_at_most_and_what_is_sent_is_the_present(live):
    tab = Tab(live.address)
    assert set(tab.hear()["scene"]) == {"cameras", "handle", "shapes", "sliders"}
    first, last = tab.hear(), tab.hear()
    assert last["number"] > first["number"]
    # one that was never sent: nothing comes of it; nor of the second time
    for drawn in ((first["number"] - 1, first["number"], first["number"]), None):
        # the reader stops; rounds go by, and none of them waits for it
        live.seen(lambda now, last=last: now.number > last["number"] + 8)
        before = live.loop.newest.number
        for number in drawn or (last["number"],):
            tab.say(drawn=number)
        last = tab.hear()
        assert last["number"] >= before  # none in between had been sent
    assert last["way"]["whole"] > 0
    stages = [last["way"][name] for name in ("wait", "track", "arm", "draw", "page")]
    assert sum(stages) <= last["way"]["whole"] * 1.001
    tab.close()
    live.seen(lambda now: not now.clutch)


def test_a_second_tab_is_told_so_and_may_take_over(live, tab):
    tab.say(clutch=True)
    tab.until(lambda said: said.get("clutch"))
    second = Tab(live.address)
    assert "another tab" in second.hear()["busy"]
    second.say(clutch=False, set=["scale", 3])  # is not in charge
    tab.until(lambda said: "number" in said)
    assert tab.until(lambda said: "number" in said)["clutch"]
    second.say(take=True)
    assert "taken over" in tab.until(lambda said: "busy" in said)["busy"]
    now = second.until(lambda said: "number" in said and not said["clutch"])
    assert now["values"]["scale"] == 1.0
    assert any("taken over" in words for words in now["notes"])
    tab.close()
    assert second.until(lambda said: "number" in said)
    second.close()


def test_a_page_that_is_gone_opens_the_clutch(live, tab):
    tab.say(clutch=True)
    tab.until(lambda said: said.get("clutch"))
    tab.close()
    assert not live.seen(lambda now: not now.clutch).moment.state.held
    live.seen(lambda now: any("page is gone" in words for words in now.notes))


NONSENSE = [
    "no JSON",
    "[]",
    "1" * 3000,
    "[" * 4000,
    '{"quit": true}',
    '{"set": ["scale", 99]}',
    '{"set": ["scale", "2"]}',
    '{"set": ["colour", 1]}',
    '{"set": 3}',
    '{"set": ["scale"]}',
    '{"set": ["scale", NaN]}',
    f'{{"set": ["scale", 1{"0" * 400}]}}',
    '{"tracker": "other"}',
    '{"hand": {"mm": [1, 2, 3]}}',
]


@pytest.mark.parametrize("text", NONSENSE)
def test_nonsense_is_refused_and_changes_nothing(live, tab, text):
    before = live.loop.newest.values
    tab.send(text)
    assert tab.until(lambda said: "refused" in said)["refused"].startswith("not understood")
    assert tab.until(lambda said: "number" in said)["values"] == before


def until_broken(tab):
    with pytest.raises((websocket.WebSocketException, OSError, ValueError)):
        tab.until(lambda said: False)


def test_too_long_a_word_ends_the_connection_and_not_the_loop(live, tab):
    tab.send("x" * 10_000)
    until_broken(tab)
    number = live.loop.newest.number
    live.seen(lambda now: now.number > number)


# --- the words of a page, without a page


class AtHome(SimulatedHand):
    """A hand that has come home."""

    def __init__(self):
        super().__init__()
        self.go_home()
        self.settled()

    def settled(self):
        for _ in range(25):
            now = self.pose(self.time_s + 0.2)
        return now


def told(hand, **how):
    """Where a hand goes that is told so."""
    loop = SimpleNamespace(source=SimpleNamespace(hand=hand, rig=RIG))
    move_hand(loop, how)
    return hand.settled()


@pytest.mark.parametrize("camera", range(3))
def test_the_hand_goes_as_the_camera_of_the_picture_sees_it(camera):
    """10 mm to the right, 5 mm down, and turned about the sight; and so far at most."""
    now = told(AtHome(), camera=camera, mm=[10, 5, 0], rad=[0, 0, 0.1])
    T = RIG.cameras[camera].T_cam_world
    way = T.apply(now.translation) - T.apply(HOME.translation)
    np.testing.assert_allclose(way, [10, 5, 0], atol=1e-3)
    turn = T.rotation * (now.rotation * HOME.rotation.inv()) * T.rotation.inv()
    np.testing.assert_allclose(turn.as_rotvec(), [0, 0, 0.1], atol=1e-4)
    far = told(AtHome(), camera=camera, mm=[-900, 0, 0])
    way = T.apply(far.translation) - T.apply(HOME.translation)
    np.testing.assert_allclose(way, [-MOST_MM, 0, 0], atol=1e-3)


def test_the_hand_goes_by_itself_or_home_and_is_drawn_as_it_is_told():
    hand = AtHome()
    away = told(hand, alone=True)
    assert hand.by_itself
    assert np.linalg.norm(away.translation - HOME.translation) > 1
    told(hand, drawn=True)
    assert hand.drawn
    told(hand, drawn="yes")  # not true in JSON
    assert not hand.drawn
    home = told(hand, home=True)
    assert not hand.by_itself
    np.testing.assert_allclose(home.as_matrix(), HOME.as_matrix(), atol=1e-3)


@pytest.mark.parametrize(
    "how",
    [
        {"camera": float("inf")},
        {"camera": 10**400},
        {"mm": [10**400, 0, 0]},
        {"camera": None},
        "left",
        {"mm": [1, 2]},
        {"rad": [0, 0, float("inf")]},
        {"mm": [[0, 0, 0]]},
    ],
)
def test_the_hand_goes_nowhere_by_other_than_three_numbers_of_a_camera(how):
    loop = SimpleNamespace(source=SimpleNamespace(hand=AtHome(), rig=RIG))
    with pytest.raises(server.NONSENSE):
        move_hand(loop, how)


@pytest.mark.parametrize("line", ["GET http://elsewhere.example/", "OPTIONS *", "GET nothing"])
def test_what_is_asked_of_another_server_is_answered_with_the_policy(live, line):
    host, port = live.address.split("/")[2].split(":")
    with closing(socket.create_connection((host, int(port)), timeout=60)) as connection:
        connection.sendall(f"{line} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: connection.recv(4096), b"")).decode()
    head = answer.partition("\r\n\r\n")[0]
    assert head.splitlines()[0].split()[1] in ("403", "404", "405")
    for name, value in server.HEADERS.items():
        assert f"{name}: {value}" in head
    assert "Server:" not in head


def test_an_error_that_nobody_expects_is_logged_without_the_token(tab, monkeypatch, caplog):
    def fails(words, desk):
        raise AssertionError(f"{TOKEN} and all that")

    monkeypatch.setattr(server, "obey", fails)
    tab.send("{}")
    until_broken(tab)
    wait_until(lambda: "AssertionError: TOKEN and all that" in caplog.text)
    assert "Uncaught exception GET /TOKEN/socket" in caplog.text
    assert TOKEN not in caplog.text


class Gone(nullcontext):
    """A bench whose images cannot be had, once an event has happened."""

    rig, handle, hand = RIG, HANDLE, None

    def __init__(self, begin):
        super().__init__()
        self._begin = begin

    def next(self, wait_s):
        self._begin.wait(60)
        raise ValueError("the bench is gone")


@pytest.fixture
def run_live(tmp_path):
    """The command in a thread, since that of the tests may have a loop of the browser's; what it sets
    for the process is put back.
    """
    threads, switch_s = cv2.getNumThreads(), sys.getswitchinterval()
    with ThreadPoolExecutor(1) as pool:
        yield lambda *given, **more: pool.submit(command.live, *given, **more).result(600)
    cv2.setNumThreads(threads)
    sys.setswitchinterval(switch_s)


def test_a_loop_that_fails_ends_the_command_with_its_words(run_live, tmp_path):
    opened = Event()
    addresses = []

    def on_open(address):
        addresses.append(address)
        opened.set()

    with pytest.raises(ValueError, match=r"^the bench is gone$"):
        run_live(Gone(opened), tmp_path, on_open=on_open)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{22}/", addresses[0])
    assert list(tmp_path.iterdir()) == []


def test_a_loop_that_has_failed_before_the_page_is_open_ends_the_command_too(
    run_live, tmp_path, monkeypatch
):
    at_once, ended = Event(), Event()
    at_once.set()
    run, bind_sockets = Loop.run_loop, server.bind_sockets

    def run_and_say(loop):
        run(loop)
        ended.set()

    def bind_late(*address):
        ended.wait(60)
        return bind_sockets(*address)

    monkeypatch.setattr(Loop, "run_loop", run_and_say)
    monkeypatch.setattr(server, "bind_sockets", bind_late)
    with pytest.raises(ValueError, match=r"^the bench is gone$"):
        run_live(Gone(at_once), tmp_path, on_open=lambda address: None)
