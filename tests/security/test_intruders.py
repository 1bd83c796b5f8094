"""Intruders: each of their ways in is shut, and those who may be there hear nothing of them."""

import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from deploy import keys
from people4d.codec import encode
from people4d.errors import ConfigError, People4dError
from people4d.messages import CameraInfo, Tracks
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.network import Watcher
from tests.security.guarded import PREFIX, ROBOT, WAIT_S, Ear, Guarded, guarded, settle

PEOPLE = f"{PREFIX}/people"
FRAMES = f"{PREFIX}/raw/front/rgbd"
SHUT_S = 0.5  # for a way in that must not open; one that does takes 20 ms


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded(tmp_path_factory.mktemp("keys")) as network:
        yield network


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded(tmp_path_factory.mktemp("words"), passwords=True) as network:
        yield network


def refused(config: zenoh.Config) -> None:
    with pytest.raises(People4dError, match="no Zenoh session"):
        ZenohBus(config, ROBOT, SHUT_S)


def tls(config: zenoh.Config, **changes: Any) -> zenoh.Config:
    known = json.loads(config.get_json("transport/link/tls"))
    config.insert_json5("transport/link/tls", json.dumps(known | changes))
    return config


def as_planner(network: Guarded) -> zenoh.Config:
    return read_config(None, "client", network.environment(), "planner")


def test_with_the_right_keys_the_door_is_open(network: Guarded, words: Guarded) -> None:
    # What the tests below change is the only reason why they are refused.
    for guard in (network, words):
        ZenohBus(as_planner(guard), ROBOT, WAIT_S).close()


def test_without_a_certificate(network: Guarded) -> None:
    # With mTLS on, a client without one does not even try.
    nothing = {"enable_mtls": False, "connect_certificate": None, "connect_private_key": None}
    refused(tls(as_planner(network), **nothing))


def test_with_a_certificate_of_another_authority(network: Guarded, tmp_path: Path) -> None:
    keys.write_certificates(tmp_path, {"forged": ["tracker"]}, [], days=1)
    forged = tmp_path / "forged"
    refused(
        tls(
            as_planner(network),
            connect_certificate=str(forged / "tracker.pem"),
            connect_private_key=str(forged / "tracker.key"),
        )
    )


def test_with_a_certificate_that_ended(network: Guarded) -> None:
    authority = keys._read_authority(network.keys.parent)
    assert authority is not None
    old = keys._signed("tracker", authority, [], days=0)
    file, key = network.keys / "old.pem", network.keys / "old.key"
    file.write_bytes(keys._pem(old.certificate))
    key.write_bytes(keys._private(old.key))
    refused(tls(as_planner(network), connect_certificate=str(file), connect_private_key=str(key)))


def test_without_encryption(network: Guarded) -> None:
    open_text = {"PEOPLE4D_CONNECT": f"tcp/127.0.0.1:{network.port}"}
    refused(read_config(None, "client", open_text))


@pytest.mark.parametrize("protocol", ["udp", "ws", "unixsock-stream"])
def test_with_certificates_no_link_is_open(network: Guarded, protocol: str) -> None:
    environment = network.environment() | {"PEOPLE4D_CONNECT": f"tcp/a:1,{protocol}/b:2"}
    with pytest.raises(ConfigError, match=f"{protocol} is not encrypted, but PEOPLE4D_KEYS"):
        read_config(None, "client", environment, "planner")


def test_rules_of_ones_own_win(network: Guarded, tmp_path: Path) -> None:
    own = '{mode: "router", access_control: {enabled: true, default_permission: "allow"}}'
    (tmp_path / "router.json5").write_text(own)
    config = read_config(tmp_path, "router", network.environment(), "router")
    assert json.loads(config.get_json("access_control"))["default_permission"] == "allow"
    assert json.loads(config.get_json("transport/link/tls"))["enable_mtls"]


@pytest.mark.parametrize("role", ["router", "planner"])
def test_a_client_speaks_only_to_the_router(network: Guarded, role: str) -> None:
    """The planner's certificate must not make it a router whom the others trust."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    environment = network.environment() | {"PEOPLE4D_LISTEN": endpoint}
    second = ZenohBus(read_config(None, "router", environment, role), ROBOT)
    try:
        environment["PEOPLE4D_CONNECT"] = endpoint
        client = read_config(None, "client", environment, "tracker")
        if role == "router":
            ZenohBus(client, ROBOT, WAIT_S).close()
        else:
            refused(client)
    finally:
        second.close()


@pytest.mark.parametrize(
    ("user", "password"),
    [("planner", "wrong"), ("nobody", "wrong"), ("tracker", None), (None, None)],
)
def test_with_wrong_passwords(words: Guarded, user: str | None, password: str | None) -> None:
    config = as_planner(words)
    if user == "tracker":  # the planner's own password does not make it the tracker
        password = (words.keys / "planner.password").read_text().strip()
    config.insert_json5("transport/auth/usrpwd/user", json.dumps(user))
    config.insert_json5("transport/auth/usrpwd/password", json.dumps(password))
    refused(config)


def test_a_folder_without_the_keys_of_a_role_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"neither tracker.pem with ca.pem nor tracker.password"):
        read_config(None, "peer", {"PEOPLE4D_KEYS": str(tmp_path)}, "tracker")


def test_the_planner_cannot_publish_people_or_frames(network: Guarded) -> None:
    operator, planner = network.session("operator"), network.session("planner")
    tracker, camera = network.session("tracker"), network.session("camera")
    people, frames = Ear(operator, PEOPLE), Ear(operator, FRAMES)
    settle(operator)
    for key in (PEOPLE, FRAMES):
        planner.put(key, b"false")
        planner.delete(key)
        planner.put(key, b"false", priority=zenoh.Priority.REAL_TIME)
    settle(planner)
    tracker.put(PEOPLE, b"true")
    camera.put(FRAMES, b"true")
    people.wait(b"true")
    frames.wait(b"true")
    assert people.heard == frames.heard == [b"true"]


@pytest.mark.parametrize(
    "key", [FRAMES, f"{PREFIX}/raw/*/rgbd", f"{PREFIX}/raw/**", f"{PREFIX}/**", "**", "*/**/rgbd"]
)
def test_the_planner_never_sees_an_image(network: Guarded, key: str) -> None:
    planner, camera = network.session("planner"), network.session("camera")
    detector = network.session("detector")
    spy, health = Ear(planner, key), Ear(planner, f"{PREFIX}/health/*/*")
    rightful = Ear(detector, FRAMES)
    _answers = camera.declare_queryable(FRAMES, lambda query: query.reply(FRAMES, b"frame"))
    for session in (planner, detector, camera):
        settle(session)
    for picture in ("rgbd", "compressed", "crops"):
        camera.put(f"{PREFIX}/raw/front/{picture}", b"picture")
    rightful.wait(b"picture")
    answers = [answer for answer in planner.get(key, timeout=SHUT_S) if answer.ok]
    camera.put(f"{PREFIX}/health/camera/camera-1", b"the end")
    health.wait(b"the end")
    assert b"picture" not in spy.heard
    assert answers == []


def test_the_planner_cannot_answer_for_the_camera(network: Guarded) -> None:
    """Late joiners ask for the calibration; nobody but the camera may answer."""
    false = f"{PREFIX}/camera/false/info"
    planner, detector = network.session("planner"), network.session("detector")
    _false = planner.declare_queryable(
        f"{PREFIX}/camera/**", lambda query: query.reply(false, b"false")
    )
    settle(planner)
    assert [a for a in detector.get(f"{PREFIX}/camera/*/info", timeout=SHUT_S) if a.ok] == []
    network.bus("camera").publish(EXAMPLES["CameraInfo"])
    Watcher(network.bus("detector"), CameraInfo).wait(CameraInfo)  # the rightful answer passes


def test_the_planner_cannot_pass_as_a_living_detector(network: Guarded) -> None:
    planner, tracker = network.session("planner"), network.session("tracker")
    _token = planner.liveliness().declare_token(f"{PREFIX}/alive/detector/detector-1")
    settle(planner)
    assert list(tracker.liveliness().get(f"{PREFIX}/alive/**")) == []
    detector = network.session("detector")
    _true = detector.liveliness().declare_token(f"{PREFIX}/alive/detector/detector-1")
    settle(detector)
    found = [str(a.ok.key_expr) for a in tracker.liveliness().get(f"{PREFIX}/alive/**") if a.ok]
    assert found == [f"{PREFIX}/alive/detector/detector-1"]


def test_nobody_looks_into_the_router(network: Guarded) -> None:
    for role in ("planner", "operator"):
        session = network.session(role)
        answers = session.get("@/**", timeout=SHUT_S)
        told = {str(a.ok.key_expr).split("/")[1] for a in answers if a.ok}
        assert told <= {str(session.info.zid())}  # of itself it knows all


def test_frames_do_not_leave_the_host(tmp_path: Path) -> None:
    """Where loopback is not counted as the host's own, even the detector's certificate is none."""
    with guarded(tmp_path, here="no-such-interface") as network:
        camera, detector = network.session("camera"), network.session("detector")
        frames, info = Ear(detector, FRAMES), Ear(detector, f"{PREFIX}/camera/*/info")
        settle(detector)
        camera.put(FRAMES, b"frame")
        settle(camera)
        camera.put(f"{PREFIX}/camera/front/info", b"info")
        info.wait(b"info")
        assert frames.heard == []


def test_a_replayed_connection_says_nothing(network: Guarded) -> None:
    """What an eavesdropper recorded of the tracker's connection is worth nothing later."""
    with Tap(network.port) as tap:
        environment = network.environment() | {"PEOPLE4D_CONNECT": f"tls/127.0.0.1:{tap.port}"}
        tracker = ZenohBus(read_config(None, "client", environment, "tracker"), ROBOT, WAIT_S)
        operator = network.session("operator")
        people = Ear(operator, PEOPLE)
        settle(operator)
        tracker.publish(EXAMPLES["Tracks"])
        people.wait(encode(EXAMPLES["Tracks"]))
        tracker.close()
        recorded = bytes(tap.recorded)
    assert encode(EXAMPLES["Tracks"]) not in recorded, "people could be read on the way"
    again = socket.create_connection(("127.0.0.1", network.port))
    with again, contextlib.suppress(ConnectionError):  # the router may hang up at once
        again.sendall(recorded)
        again.shutdown(socket.SHUT_WR)
        while again.recv(65536):
            pass
    network.session("tracker").put(PEOPLE, b"the end")
    people.wait(b"the end")
    assert people.heard == [encode(EXAMPLES["Tracks"]), b"the end"]


def test_malformed_bytes_at_the_door_do_not_disturb_those_inside(network: Guarded) -> None:
    inside, tracker = Watcher(network.bus("planner"), Tracks), network.bus("tracker")
    for noise in (b"", b"\x00" * 100_000, bytes(range(256)) * 40, b"\x16\x03\x01\xff\xff" * 1000):
        with socket.create_connection(("127.0.0.1", network.port)) as stranger:
            stranger.sendall(noise)
    settle(network.session("planner"))
    tracker.publish(EXAMPLES["Tracks"])
    assert inside.wait(Tracks).sequence == EXAMPLES["Tracks"].sequence


def test_peers_let_in_only_those_they_may_speak_to(network: Guarded) -> None:
    """Camera and detector talk without the router, which is no way around it for others."""
    listen = {"PEOPLE4D_LISTEN": f"tls/127.0.0.1:{free_port()}"}
    config = read_config(None, "peer", network.environment() | listen, "camera")
    camera = ZenohBus(config, ROBOT, WAIT_S)
    try:
        around = network.environment() | {"PEOPLE4D_CONNECT": listen["PEOPLE4D_LISTEN"]}
        with (
            zenoh.open(read_config(None, "client", around, "planner")) as planner,
            zenoh.open(read_config(None, "client", around, "detector")) as detector,
        ):
            spy, rightful = Ear(planner, FRAMES), Ear(detector, FRAMES)
            info = Ear(planner, f"{PREFIX}/camera/*/info")
            settle(planner)
            settle(detector)
            camera.publish(EXAMPLES["RgbdFrame"])
            rightful.wait(encode(EXAMPLES["RgbdFrame"]))
            camera.publish(EXAMPLES["CameraInfo"])
            info.wait(encode(EXAMPLES["CameraInfo"]))
            assert spy.heard == []
    finally:
        camera.close()


class Tap:
    """Passes a connection on to a port and keeps what its client says.

    Args:
        target: The port.
    """

    def __init__(self, target: int) -> None:
        self.recorded = bytearray()
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        client, _ = self._listener.accept()
        with client, socket.create_connection(("127.0.0.1", self._target)) as server:
            back = threading.Thread(target=self._pass, args=(server, client, bytearray()))
            back.start()
            self._pass(client, server, self.recorded)
            back.join()

    def _pass(self, come: socket.socket, go: socket.socket, keep: bytearray) -> None:
        with contextlib.suppress(OSError):  # one side has left
            while data := come.recv(65536):
                keep += data
                go.sendall(data)
            go.shutdown(socket.SHUT_WR)

    def __enter__(self) -> "Tap":
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(WAIT_S)
        self._listener.close()
