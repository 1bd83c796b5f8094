"""Intruders: each attempt fails, and no other client receives a message of it."""

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
from tests.security.guarded import PREFIX, ROBOT, WAIT_S, Guarded, Listener, guarded, settle

pytestmark = pytest.mark.network

TRACKS = f"{PREFIX}/people"
FRAMES = f"{PREFIX}/raw/front/rgbd"
REFUSED_S = 0.5  # wait for a connection that must not open; a valid one takes 20 ms


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded(tmp_path_factory.mktemp("keys")) as network:
        yield network


@pytest.fixture(scope="module")
def passwords(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded(tmp_path_factory.mktemp("passwords"), passwords=True) as network:
        yield network


def refused(config: zenoh.Config) -> None:
    with pytest.raises(People4dError, match="no Zenoh session"):
        ZenohBus(config, ROBOT, REFUSED_S)


def tls(config: zenoh.Config, **changes: Any) -> zenoh.Config:
    known = json.loads(config.get_json("transport/link/tls"))
    config.insert_json5("transport/link/tls", json.dumps(known | changes))
    return config


def as_planner(network: Guarded) -> zenoh.Config:
    return read_config(None, "client", network.environment(), "planner")


def test_right_credentials_are_accepted(network: Guarded, passwords: Guarded) -> None:
    # The changes below are the only reason for the refusal.
    for guard in (network, passwords):
        ZenohBus(as_planner(guard), ROBOT, WAIT_S).close()


def test_client_without_a_certificate_is_refused(network: Guarded) -> None:
    # With mTLS, a client without a certificate does not even connect.
    nothing = {"enable_mtls": False, "connect_certificate": None, "connect_private_key": None}
    refused(tls(as_planner(network), **nothing))


def test_certificate_of_another_authority_is_refused(network: Guarded, tmp_path: Path) -> None:
    keys.write_certificates(tmp_path, {"forged": ["tracker"]}, [], days=1)
    forged = tmp_path / "forged"
    refused(
        tls(
            as_planner(network),
            connect_certificate=str(forged / "tracker.pem"),
            connect_private_key=str(forged / "tracker.key"),
        )
    )


def test_expired_certificate_is_refused(network: Guarded) -> None:
    authority = keys._read_authority(network.keys.parent)
    assert authority is not None
    old = keys._signed("tracker", authority, [], days=0)
    file, key = network.keys / "old.pem", network.keys / "old.key"
    file.write_bytes(keys._pem(old.certificate))
    key.write_bytes(keys._private(old.key))
    refused(tls(as_planner(network), connect_certificate=str(file), connect_private_key=str(key)))


def test_client_without_encryption_is_refused(network: Guarded) -> None:
    open_text = {"PEOPLE4D_CONNECT": f"tcp/127.0.0.1:{network.port}"}
    refused(read_config(None, "client", open_text))


@pytest.mark.parametrize("protocol", ["udp", "ws", "unixsock-stream"])
def test_unencrypted_link_is_an_error_with_certificates(network: Guarded, protocol: str) -> None:
    environment = network.environment() | {"PEOPLE4D_CONNECT": f"tcp/a:1,{protocol}/b:2"}
    with pytest.raises(ConfigError, match=f"{protocol} is not encrypted, but PEOPLE4D_KEYS"):
        read_config(None, "client", environment, "planner")


def test_access_rules_in_the_file_replace_ours(network: Guarded, tmp_path: Path) -> None:
    own = '{mode: "router", access_control: {enabled: true, default_permission: "allow"}}'
    (tmp_path / "router.json5").write_text(own)
    config = read_config(tmp_path, "router", network.environment(), "router")
    assert json.loads(config.get_json("access_control"))["default_permission"] == "allow"
    assert json.loads(config.get_json("transport/link/tls"))["enable_mtls"]


@pytest.mark.parametrize("role", ["router", "planner"])
def test_client_connects_only_to_the_router(network: Guarded, role: str) -> None:
    """The planner's certificate must not make it a router that the others trust."""
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
    [("planner", "wrong"), ("unknown", "wrong"), ("tracker", None), (None, None)],
)
def test_wrong_password_is_refused(
    passwords: Guarded, user: str | None, password: str | None
) -> None:
    config = as_planner(passwords)
    if user == "tracker":  # the planner's own password does not make it the tracker
        password = (passwords.keys / "planner.password").read_text().strip()
    config.insert_json5("transport/auth/usrpwd/user", json.dumps(user))
    config.insert_json5("transport/auth/usrpwd/password", json.dumps(password))
    refused(config)


def test_folder_without_the_keys_of_a_role_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"neither tracker.pem with ca.pem nor tracker.password"):
        read_config(None, "peer", {"PEOPLE4D_KEYS": str(tmp_path)}, "tracker")


def test_planner_cannot_publish_tracks_or_frames(network: Guarded) -> None:
    operator, planner = network.session("operator"), network.session("planner")
    tracker, camera = network.session("tracker"), network.session("camera")
    tracks, frames = Listener(operator, TRACKS), Listener(operator, FRAMES)
    settle(operator)
    for key in (TRACKS, FRAMES):
        planner.put(key, b"false")
        planner.delete(key)
        planner.put(key, b"false", priority=zenoh.Priority.REAL_TIME)
    settle(planner)
    tracker.put(TRACKS, b"true")
    camera.put(FRAMES, b"true")
    tracks.wait(b"true")
    frames.wait(b"true")
    assert tracks.received == frames.received == [b"true"]


@pytest.mark.parametrize(
    "key", [FRAMES, f"{PREFIX}/raw/*/rgbd", f"{PREFIX}/raw/**", f"{PREFIX}/**", "**", "*/**/rgbd"]
)
def test_planner_never_receives_an_image(network: Guarded, key: str) -> None:
    planner, camera = network.session("planner"), network.session("camera")
    detector = network.session("detector")
    spy, health = Listener(planner, key), Listener(planner, f"{PREFIX}/health/*/*")
    permitted = Listener(detector, FRAMES)
    _answers = camera.declare_queryable(FRAMES, lambda query: query.reply(FRAMES, b"frame"))
    for session in (planner, detector, camera):
        settle(session)
    for image in ("rgbd", "compressed", "crops"):
        camera.put(f"{PREFIX}/raw/front/{image}", b"image")
    permitted.wait(b"image")
    answers = [answer for answer in planner.get(key, timeout=REFUSED_S) if answer.ok]
    camera.put(f"{PREFIX}/health/camera/camera-1", b"the end")
    health.wait(b"the end")
    assert b"image" not in spy.received
    assert answers == []


def test_planner_cannot_reply_for_the_camera(network: Guarded) -> None:
    """Late joiners query the calibration; only the camera may reply."""
    false = f"{PREFIX}/camera/false/info"
    planner, detector = network.session("planner"), network.session("detector")
    _false = planner.declare_queryable(
        f"{PREFIX}/camera/**", lambda query: query.reply(false, b"false")
    )
    settle(planner)
    assert [a for a in detector.get(f"{PREFIX}/camera/*/info", timeout=REFUSED_S) if a.ok] == []
    network.bus("camera").publish(EXAMPLES["CameraInfo"])
    Watcher(network.bus("detector"), CameraInfo).wait(CameraInfo)  # the camera's own reply passes


def test_planner_cannot_announce_a_detector(network: Guarded) -> None:
    planner, tracker = network.session("planner"), network.session("tracker")
    _token = planner.liveliness().declare_token(f"{PREFIX}/alive/detector/detector-1")
    settle(planner)
    assert list(tracker.liveliness().get(f"{PREFIX}/alive/**")) == []
    detector = network.session("detector")
    _true = detector.liveliness().declare_token(f"{PREFIX}/alive/detector/detector-1")
    settle(detector)
    found = [str(a.ok.key_expr) for a in tracker.liveliness().get(f"{PREFIX}/alive/**") if a.ok]
    assert found == [f"{PREFIX}/alive/detector/detector-1"]


def test_state_of_the_router_cannot_be_read(network: Guarded) -> None:
    for role in ("planner", "operator"):
        session = network.session(role)
        answers = session.get("@/**", timeout=REFUSED_S)
        routers = {str(a.ok.key_expr).split("/")[1] for a in answers if a.ok}
        assert routers <= {str(session.info.zid())}  # its own state is readable


def test_frames_do_not_leave_the_host(tmp_path: Path) -> None:
    """Loopback is not a local interface here, so the detector's certificate does not help."""
    with guarded(tmp_path, local="no-such-interface") as network:
        camera, detector = network.session("camera"), network.session("detector")
        frames, info = Listener(detector, FRAMES), Listener(detector, f"{PREFIX}/camera/*/info")
        settle(detector)
        camera.put(FRAMES, b"frame")
        settle(camera)
        camera.put(f"{PREFIX}/camera/front/info", b"info")
        info.wait(b"info")
        assert frames.received == []


def test_replayed_connection_publishes_nothing(network: Guarded) -> None:
    """A recording of the tracker's connection is useless later."""
    with Tap(network.port) as tap:
        environment = network.environment() | {"PEOPLE4D_CONNECT": f"tls/127.0.0.1:{tap.port}"}
        tracker = ZenohBus(read_config(None, "client", environment, "tracker"), ROBOT, WAIT_S)
        operator = network.session("operator")
        tracks = Listener(operator, TRACKS)
        settle(operator)
        tracker.publish(EXAMPLES["Tracks"])
        tracks.wait(encode(EXAMPLES["Tracks"]))
        tracker.close()
        recorded = bytes(tap.recorded)
    assert encode(EXAMPLES["Tracks"]) not in recorded, "tracks could be read in transit"
    again = socket.create_connection(("127.0.0.1", network.port))
    with again, contextlib.suppress(ConnectionError):  # the router may hang up at once
        again.sendall(recorded)
        again.shutdown(socket.SHUT_WR)
        while again.recv(65536):
            pass
    network.session("tracker").put(TRACKS, b"the end")
    tracks.wait(b"the end")
    assert tracks.received == [encode(EXAMPLES["Tracks"]), b"the end"]


def test_malformed_bytes_do_not_disturb_connected_sessions(network: Guarded) -> None:
    connected, tracker = Watcher(network.bus("planner"), Tracks), network.bus("tracker")
    for noise in (b"", b"\x00" * 100_000, bytes(range(256)) * 40, b"\x16\x03\x01\xff\xff" * 1000):
        with socket.create_connection(("127.0.0.1", network.port)) as intruder:
            intruder.sendall(noise)
    settle(network.session("planner"))
    tracker.publish(EXAMPLES["Tracks"])
    assert connected.wait(Tracks).sequence == EXAMPLES["Tracks"].sequence


def test_peer_accepts_only_roles_that_may_read_it(network: Guarded) -> None:
    """Camera and detector connect without the router, which others cannot exploit."""
    listen = {"PEOPLE4D_LISTEN": f"tls/127.0.0.1:{free_port()}"}
    config = read_config(None, "peer", network.environment() | listen, "camera")
    camera = ZenohBus(config, ROBOT, WAIT_S)
    try:
        around = network.environment() | {"PEOPLE4D_CONNECT": listen["PEOPLE4D_LISTEN"]}
        with (
            zenoh.open(read_config(None, "client", around, "planner")) as planner,
            zenoh.open(read_config(None, "client", around, "detector")) as detector,
        ):
            spy, permitted = Listener(planner, FRAMES), Listener(detector, FRAMES)
            info = Listener(planner, f"{PREFIX}/camera/*/info")
            settle(planner)
            settle(detector)
            camera.publish(EXAMPLES["RgbdFrame"])
            permitted.wait(encode(EXAMPLES["RgbdFrame"]))
            camera.publish(EXAMPLES["CameraInfo"])
            info.wait(encode(EXAMPLES["CameraInfo"]))
            assert spy.received == []
    finally:
        camera.close()


class Tap:
    """Forwards a connection to a port and records the bytes of its client."""

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

    def _pass(self, come: socket.socket, go: socket.socket, record: bytearray) -> None:
        with contextlib.suppress(OSError):  # one side has left
            while data := come.recv(65536):
                record += data
                go.sendall(data)
            go.shutdown(socket.SHUT_WR)

    def __enter__(self) -> "Tap":
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(WAIT_S)
        self._listener.close()
