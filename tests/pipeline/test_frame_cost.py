"""A frame costs no more in any node than its budget."""

import json
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest

from people4d.messages import Message
from services.predictor.config import PredictorConfig
from tests import ROOT, builders
from tests.pipeline.frame_cost import BUDGETS, COUNTED, WARM, Costs, cost, excess, measure

FILE = "services/predictor/node.py"
LINE = "        people, state = self._plausible(tracks.tracks)\n"
LOOP = "        for _ in range(100):\n            sorted(tracks.camera)\n"


@pytest.mark.slow
def test_frame_costs_no_more_than_its_budget_in_any_node() -> None:
    # After an intended increase, python -m tests.pipeline.frame_cost writes the budgets; explain
    # it.
    assert list(excess(measure(), json.loads(BUDGETS.read_text()))) == []


def cost_of_predictor(code: str) -> dict[str, Costs]:
    scope: dict[str, Any] = {"__name__": "predictor"}
    exec(compile(code, ROOT / FILE, "exec"), scope)
    node = scope["PredictorNode"](PredictorConfig())
    steps = [
        [builders.tracks(builders.track(), stamp_ns=number * 10**9)]
        for number in range(WARM + 2 * COUNTED)
    ]
    return {"predictor": cost(steps, partial(node.handle, now_ns=0))}


def test_loop_in_a_copy_of_a_node_is_over_the_budget_and_its_file_named() -> None:
    code = (ROOT / FILE).read_text("utf-8")
    before = cost_of_predictor(code)
    assert list(excess(cost_of_predictor(code), before)) == []
    # Two lines a round, and the final one of the loop.
    lines, *_ = excess(cost_of_predictor(code.replace(LINE, LINE + LOOP)), before)
    assert lines.startswith("predictor: ")
    assert lines.endswith(f": {FILE} +201")


def test_opencv_calls_and_allocations_are_counted() -> None:
    image = np.zeros((100, 100), np.uint8)

    def handle(_: Message) -> None:
        for _round in range(3):
            cv2.resize(image, (200, 200))

    costs = cost([[builders.camera_info()]] * (WARM + 2 * COUNTED), handle)
    assert sum(costs["array_calls"].values()) == 3
    assert 40 <= sum(costs["kilobytes"].values()) < 42  # an image; each is freed before the next
