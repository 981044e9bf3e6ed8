"""The live page's server, without a browser: who gets in, who is in charge, and what is sent when."""

import http.client
import json
import re
import socket
from contextlib import closing

import pytest

pytest.importorskip("mink", reason="the extra 'slave' is missing")
pytest.importorskip("tornado", reason="the extra 'live' is missing")

import websocket
from livepage import TOKEN, Bench, Live, Tab

from trinolab.live.server import FILES, PAGE


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    with Live(Bench().source, tmp_path_factory.mktemp("live")) as live:
        yield live


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
    "path", ["/", "/live.js", f"/{TOKEN[:-1]}/", f"/{TOKEN}x/", f"//{TOKEN}/", "/socket"]
)
def test_without_the_token_nothing_is_there(live, path):
    assert asked(live, path)[0] == 403


def test_another_page_or_another_name_of_this_computer_does_not_get_in(live):
    assert asked(live, f"/{TOKEN}/", Origin="http://elsewhere.example")[0] == 403
    assert asked(live, f"/{TOKEN}/", Host="elsewhere.example:80")[0] == 403
    host = live.address.split("/")[2]
    assert asked(live, f"/{TOKEN}/", Origin=f"http://{host}")[0] == 200


def test_it_listens_at_one_address_only(live):
    """All of 127.0.0.0/8 is this computer; who listens everywhere would answer here, too."""
    port = int(live.address.split(":")[2].split("/")[0])
    socket.create_connection(("127.0.0.1", port), timeout=60).close()
    with pytest.raises(OSError, match=r"."):
        socket.create_connection(("127.0.0.2", port), timeout=60)


@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "http://127.0.0.1:1"])
def test_a_foreign_origin_gets_no_connection(live, origin):
    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        Tab(live.address, origin)


def test_a_connection_needs_the_token_and_an_origin(live):
    host = live.address.split("/")[2]
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
    assert set(tab.hear()["scene"]) == {"cameras", "handle", "sliders"}
    first, second = tab.hear(), tab.hear()
    assert second["number"] > first["number"]
    # the reader stops; rounds go by, and none of them waits for it
    live.seen(lambda now: now.number > second["number"] + 8)
    before = live.loop.newest.number
    tab.say(drawn=first["number"] - 1)  # was never sent: nothing comes of it
    tab.say(drawn=first["number"])
    tab.say(drawn=first["number"])  # once more: nor of this
    third = tab.hear()
    assert third["number"] >= before  # none in between had been sent
    assert third["way"]["whole"] > 0
    stages = [third["way"][name] for name in ("wait", "track", "arm", "draw", "page")]
    assert sum(stages) <= third["way"]["whole"] * 1.001
    live.seen(lambda now: now.number > third["number"] + 8)
    before = live.loop.newest.number
    tab.say(drawn=third["number"])
    assert tab.hear()["number"] >= before
    tab.close()
    live.seen(lambda now: not now.clutch)


def test_a_second_tab_is_told_so_and_may_take_over(live):
    first = Tab(live.address)
    first.until(lambda said: "scene" in said)
    first.say(clutch=True)
    first.until(lambda said: said.get("clutch"))
    second = Tab(live.address)
    assert "another tab" in second.hear()["busy"]
    second.say(clutch=False, set=["scale", 3])  # is not in charge
    first.until(lambda said: "number" in said)
    assert first.until(lambda said: "number" in said)["clutch"]
    second.say(take=True)
    assert "taken over" in first.until(lambda said: "busy" in said)["busy"]
    now = second.until(lambda said: "number" in said and not said["clutch"])
    assert now["values"]["scale"] == 1.0
    assert any("taken over" in words for words in now["notes"])
    first.close()
    assert second.until(lambda said: "number" in said)
    second.close()


def test_a_page_that_is_gone_opens_the_clutch(live):
    tab = Tab(live.address)
    tab.say(clutch=True)
    tab.until(lambda said: said.get("clutch"))
    tab.close()
    now = live.seen(lambda now: not now.clutch)
    live.seen(lambda now: any("page is gone" in words for words in now.notes))
    assert not now.moment.state.held


NONSENSE = [
    "no JSON",
    "[]",
    "1" * 3000,
    json.dumps({"quit": True}),
    json.dumps({"set": ["scale", 99]}),
    json.dumps({"set": ["scale", "2"]}),
    json.dumps({"set": ["colour", 1]}),
    json.dumps({"set": 3}),
    json.dumps({"set": ["scale"]}),
    '{"set": ["scale", NaN]}',
    json.dumps({"tracker": "other"}),
    json.dumps({"hand": {"mm": [1, 2, 3]}}),
    "[" * 4000,
]


@pytest.mark.parametrize("text", NONSENSE)
def test_nonsense_is_refused_and_changes_nothing(live, text):
    tab = Tab(live.address)
    tab.until(lambda said: "number" in said)
    before = live.loop.newest.values
    tab.send(text)
    assert tab.until(lambda said: "refused" in said)["refused"].startswith("not understood")
    assert tab.until(lambda said: "number" in said)["values"] == before
    tab.close()


def test_too_long_a_word_ends_the_connection_and_not_the_loop(live):
    tab = Tab(live.address)
    tab.until(lambda said: "number" in said)
    tab.send("x" * 10_000)
    with pytest.raises((websocket.WebSocketException, OSError, ValueError)):
        tab.until(lambda said: False)
    tab.close()
    number = live.loop.newest.number
    live.seen(lambda now: now.number > number)
