"""Areas of one site: one tracker each that exchange people, and one stream of all areas."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import numpy as np
import numpy.typing as npt

from benchmarks.lib.fusion.run import ARRIVAL_NS, TimedTracks
from benchmarks.lib.fusion.scene import FusionScene
from benchmarks.lib.fusion.scores import matched
from common.metrics.matching import Matching
from common.runtime.node import LoopCallbacks, Node
from people4d.codec import encode
from people4d.messages import AreaPeople, Message, Tracks
from people4d.topics import ForeignTopic
from services.site.build import build as build_site
from services.site.config import SiteConfig
from services.tracker.areas.config import SiteAreaConfig
from services.tracker.build import build
from services.tracker.config import TrackerConfig

BOOL = npt.NDArray[np.bool_]
LINK_NS = 5_000_000  # [ns] delay from process to process
SITE = "site"


@dataclass(frozen=True)
class AreaRun:
    """Output of the nodes of a site."""

    merged: Sequence[TimedTracks]
    counters: Mapping[str, Mapping[str, int]]  # counters by node
    bytes_sent: int  # size of all messages of areas to their neighbours


def track_areas(scene: FusionScene, areas: Mapping[str, Sequence[str]], exchange: bool) -> AreaRun:
    """Return the people of a site with one tracker for each area.

    Args:
        scene: The scene.
        areas: Cameras of each area.
        exchange: True if each area is a neighbour of all others.
    """
    nodes: dict[str, Node] = {}
    for number, name in enumerate(areas, 1):
        others = tuple(other for other in areas if other != name) if exchange else ()
        area = SiteAreaConfig(number=number, neighbours=others)
        nodes[name] = build(TrackerConfig(require_transform=True, area=area))
    nodes[SITE] = build_site(SiteConfig(areas=tuple(areas)))
    for name, node in nodes.items():
        node.attach(LoopCallbacks(robot=name))
    area_of = {camera: area for area, cameras in areas.items() for camera in cameras}
    order, numbers = list[tuple[int, int, str, Message]](), count()
    for time_ns, message in scene.messages:
        camera = getattr(message, "camera", "")
        for name in [area_of[camera]] if camera else areas:
            heappush(order, (time_ns + ARRIVAL_NS, next(numbers), name, message))
    merged, sent = list[TimedTracks](), 0
    while order:
        now_ns, _, name, message = heappop(order)
        for one, node in nodes.items():
            outputs = list(node.handle(message, now_ns)) if one == name else []
            wake_ns = node.wake_ns()
            if wake_ns is not None and wake_ns <= now_ns:
                outputs += node.tick(now_ns)
            for output in outputs:
                if one == SITE and isinstance(output, Tracks):
                    merged.append(TimedTracks(output.stamp_ns, output.tracks))
                elif isinstance(output, Tracks | AreaPeople):
                    payload = encode(output)
                    sent += len(payload) * isinstance(output, AreaPeople)
                    for reader, topic in _readers(nodes, one, output):
                        decoded = topic.decode(payload)
                        heappush(order, (now_ns + LINK_NS, next(numbers), reader, decoded))
    counters = {name: node.status().counters for name, node in nodes.items()}
    return AreaRun(merged, counters, sent)


def _readers(
    nodes: Mapping[str, Node], sender: str, output: Message
) -> list[tuple[str, ForeignTopic]]:
    """Return the readers of a message of an area, with their topics."""
    key = "people" if isinstance(output, Tracks) else "area_people"
    return [
        (name, topic)
        for name, node in nodes.items()
        for topic in node.foreign_inputs
        if topic.key.split("/")[-2:] == [sender, key]
    ]


@dataclass(frozen=True)
class AreaHandOvers:
    """Walks of people from one area to another."""

    walks: int
    same: int  # number of walks with the same identity


def area_hand_overs(
    scene: FusionScene, areas: Mapping[str, Sequence[str]], merged: Sequence[TimedTracks]
) -> tuple[AreaHandOvers, Matching]:
    """Count walks: a person is in one area alone, then in another alone for two seconds.

    The identity of the last match in the first area is compared with the most frequent identity
    from 0.8 to 2 s after the arrival in the other.
    """
    matching = matched(scene, merged)
    frames = matching.sequence.frames
    tracked = np.full((len(frames), scene.people_m.shape[1]), -1)
    for k, matches in enumerate(matching.frame_matches):
        persons = [int(matching.persons[int(p)]) for p in matches.persons[matches.rows]]
        tracked[k, persons] = matches.tracks[matches.columns]
    in_area = np.zeros((len(frames), len(areas), scene.people_m.shape[1]), np.bool_)
    for k, frame in enumerate(frames):
        views = scene.views(np.asarray(frame.truth.positions_m))
        for a, cameras in enumerate(areas.values()):
            in_area[k, a] = np.any([views[camera] for camera in cameras], axis=0)
    everyone = range(scene.people_m.shape[1])
    walks = [_walks(in_area[:, :, person], tracked[:, person]) for person in everyone]
    total = AreaHandOvers(sum(w.walks for w in walks), sum(w.same for w in walks))
    return total, matching


def _walks(in_area: BOOL, tracked: npt.NDArray[np.int_]) -> AreaHandOvers:
    """Count the walks of one person; in_area is TxA, tracked T, ten samples a second."""
    walks = same = 0
    last_area, last_id = -1, -1
    for k in range(len(in_area)):
        alone = np.flatnonzero(in_area[k])
        if len(alone) != 1:
            continue
        area = int(alone[0])
        is_new = last_area not in (-1, area)
        # A walk ends with at least two seconds in the new area alone.
        stays = k + 20 <= len(in_area) and bool((in_area[k : k + 20].sum(axis=1) == 1).all())
        stays = stays and bool(in_area[k : k + 20, area].all())
        if is_new and not stays:
            continue
        if is_new and last_id >= 0:
            after = tracked[k + 8 : k + 20]
            after = after[after >= 0]
            walks += 1
            same += bool(len(after) and np.bincount(after).argmax() == last_id)
        last_area = area
        last_id = int(tracked[k]) if tracked[k] >= 0 else last_id
    return AreaHandOvers(walks, same)
