import cv2
import numpy as np
import pytest

from people4d.errors import ModelError
from people4d.messages import F32, F64
from services.detector.config import ModelSettings
from services.detector.models.base import DetectedPerson
from services.detector.models.movenet import MoveNet, find_centres, similarities
from services.detector.models.movenet_heads import (
    FEATURES,
    LOCAL,
    MAPS,
    DenseHeads,
    HeadReader,
    Heads,
    sigmoid,
)
from tests.detector.array_session import ArraySession

OFF = -20.0  # logit of nothing there
ON = 4.0  # logit of a confident value: sigmoid 0.982


def empty_heads(height: int = 64, width: int = 80) -> dict[str, F32]:
    """Heads of an input of four times the size, with no person in it."""
    heads = {
        name: np.zeros((1, n, height, width), np.float32) for name, n in (MAPS | LOCAL).items()
    }
    heads["center"][:] = OFF
    heads["kpt_heatmap"][:] = OFF
    return heads


def plant(
    heads: dict[str, F32], box: tuple[int, int, int, int], keypoints: F64, logit: float = ON
) -> None:
    """Write a person into the heads.

    Args:
        heads: From `empty_heads`.
        box: xyxy in pixels of the input.
        keypoints: 17x2 x, y in pixels of the input, inside the box.
        logit: Of the centre.
    """
    left, top, right, bottom = (side / 4 for side in box)
    x, y = (left + right) / 2, (top + bottom) / 2
    row, column = int(y), int(x)
    heads["center"][0, 0, row, column] = logit
    heads["box_scale"][0, :, row, column] = bottom - top, right - left
    heads["box_offset"][0, :, row, column] = y - row, x - column
    for k, (u, v) in enumerate(keypoints / 4):
        heads["kpt_regress"][0, 2 * k : 2 * k + 2, row, column] = v - row, u - column
        heads["kpt_heatmap"][0, k, int(v), int(u)] = ON
        heads["kpt_offset"][0, 2 * k : 2 * k + 2, int(v), int(u)] = v - int(v), u - int(u)


def body(x: float, y: float) -> F64:
    """17 different positions from (x, y) on, 60 wide and 160 high."""
    k = np.arange(17)
    return np.stack([x + 3.7 * k, y + 10 * ((7 * k) % 17)], axis=1)


def detect(heads: dict[str, F32], settings: ModelSettings | None = None) -> list[DetectedPerson]:
    """People in a 640x480 image: the input of 320x256 shows it halved, below a bar of 8 rows."""
    session = ArraySession(heads, (1, None, None, 3), "uint8")
    model = MoveNet(session, settings or ModelSettings(scores="network"))
    return model.detect(np.zeros((480, 640, 3), np.uint8))


def test_planted_person_comes_back_at_the_pixel() -> None:
    heads = empty_heads()
    keypoints = body(101.3, 50.6)
    plant(heads, (90, 40, 170, 230), keypoints)
    (person,) = detect(heads)
    # From the input to the image: less the bar of 8 rows, times 2.
    np.testing.assert_allclose(person.box_xyxy_px, [180, 64, 340, 444], atol=1e-3)
    assert person.keypoints is not None
    np.testing.assert_allclose(person.keypoints[:, :2], (keypoints - [0, 8]) * 2, atol=1e-3)
    # A keypoint's heat is 0.982; at most half a cell off the guess costs exp(-0.5/19.2) = 0.974.
    assert (person.keypoints[:, 2] > 0.982 * 0.94).all()
    # Centre times mean of the keypoints: at most 0.982 * 0.982 = 0.964.
    assert 0.9 < person.score <= 0.9645


def test_two_centres_on_one_body_are_one_person() -> None:
    # Boxes 80x190 inside 220x240: IoU 15200 / 52800 = 0.29, yet the same keypoints.
    heads = empty_heads()
    plant(heads, (40, 10, 260, 250), body(100, 50), logit=2.0)
    plant(heads, (90, 40, 170, 230), body(100, 50))
    (person,) = detect(heads)
    np.testing.assert_allclose(person.box_xyxy_px, [180, 64, 340, 444], atol=1e-3)


def test_boxes_that_overlap_much_are_one_person() -> None:
    # Boxes 80 wide, 16 apart: overlap 64 of 96, IoU 0.667. Keypoints 20 apart: similarity 0.43.
    heads = empty_heads()
    plant(heads, (90, 40, 170, 230), body(100, 50))
    plant(heads, (106, 40, 186, 230), body(120, 50), logit=2.0)
    assert len(detect(heads)) == 1
    assert len(detect(heads, ModelSettings(scores="network", iou_max=0.7))) == 2


def test_crossing_people_are_two_with_their_own_keypoints() -> None:
    # Boxes 80 wide, 48 apart: overlap 32 of 128, IoU 0.25. Each box holds keypoints of the other.
    heads = empty_heads()
    plant(heads, (90, 40, 170, 230), body(100, 50))
    plant(heads, (138, 40, 218, 230), body(148, 50), logit=2.0)
    people = detect(heads)
    assert len(people) == 2
    for person, x in zip(people, (100, 148), strict=True):
        assert person.keypoints is not None
        np.testing.assert_allclose(person.keypoints[:, :2], (body(x, 50) - [0, 8]) * 2, atol=1e-3)


def test_centre_is_the_highest_cell_around() -> None:
    # 5x5 cells around: (2, 2) outshines (2, 4), two cells off, but not (2, 5), three cells off.
    logits = np.full((6, 9), -9.0, np.float32)
    logits[2, [2, 4, 5]] = 2.0, 1.0, 1.5
    rows, columns, scores = find_centres(sigmoid(logits), 0.1)
    assert (rows.tolist(), columns.tolist()) == ([2, 2], [2, 5])
    np.testing.assert_allclose(scores, [0.8808, 0.8176], atol=1e-4)


def test_similarity_of_keypoints() -> None:
    # COCO: exp(-d^2 / (2 area (2 sigma)^2)); nose sigma 0.026, area 100 x 100, 5.2 pixels apart:
    # 27.04 / (2 * 10000 * 0.002704) = 0.5; exp(-0.5) = 0.6065. Only the nose is confident in both.
    keypoints = np.zeros((2, 17, 3))
    keypoints[:, 0, 2] = 0.9
    keypoints[1, 0, 0] = 5.2
    keypoints[0, 5, 2] = 0.9
    boxes = np.array([[0.0, 0.0, 100.0, 100.0], [0.0, 0.0, 100.0, 200.0]])
    expected = [[1, 0.6065], [0.6065, 1]]
    np.testing.assert_allclose(similarities(boxes, keypoints), expected, atol=1e-4)
    keypoints[:, :, 2] = 0
    assert not similarities(boxes, keypoints).any()


def test_weak_people_and_many_people_are_dropped() -> None:
    heads = empty_heads()
    plant(heads, (20, 40, 110, 230), body(30, 50), logit=0.0)  # sigmoid 0.5
    plant(heads, (180, 40, 270, 230), body(190, 50), logit=-3.0)  # sigmoid 0.047 < 0.05
    (person,) = detect(heads)
    assert 0.45 < person.score < 0.5
    assert len(detect(heads, ModelSettings(scores="network", score_min=0.02))) == 2
    assert len(detect(heads, ModelSettings(scores="network", score_min=0.02, max_people=1))) == 1
    assert not detect(heads, ModelSettings(scores="network", score_min=0.6))


def test_no_people_and_flat_heads() -> None:
    assert detect(empty_heads()) == []
    heads = empty_heads()
    heads["center"][:] = 0.0  # every cell a peak, every box empty
    assert detect(heads) == []


def local_heads(cells: int = 8) -> tuple[Heads, Heads]:
    """Return random heads of a grid, computed at the read cells and at all cells."""
    random = np.random.default_rng(5)

    def draw(*shape: int) -> F32:
        return random.normal(size=shape).astype(np.float32)

    count, hidden = len(LOCAL), 7
    outputs = {
        "center_map": draw(1, 1, cells, cells),
        "kpt_map": draw(1, 17, cells, cells),
        "features": draw(1, FEATURES, cells, cells),
        "local.depthwise": draw(count, 9, FEATURES),
        "local.pointwise": draw(count, FEATURES, hidden),
        "local.pointwise_bias": draw(count, hidden),
        "local.output": draw(sum(LOCAL.values()), hidden),
        "local.output_bias": draw(sum(LOCAL.values())),
    }
    dense = {"center": outputs["center_map"], "kpt_heatmap": outputs["kpt_map"]}
    row = 0
    for k, (name, channels) in enumerate(LOCAL.items()):
        kernels = outputs["local.depthwise"][k].T.reshape(FEATURES, 3, 3)
        pairs = zip(outputs["features"][0], kernels, strict=True)
        # Correlation with zeros beyond the image, as networks do it
        filtered = np.stack(
            [
                cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_CONSTANT)
                for image, kernel in pairs
            ]
        )
        mixed = np.einsum("fij,fg->gij", filtered, outputs["local.pointwise"][k])
        mixed = np.maximum(mixed + outputs["local.pointwise_bias"][k][:, None, None], 0)
        rows = slice(row, row + channels)
        values = np.einsum("kg,gij->kij", outputs["local.output"][rows], mixed)
        dense[name] = (values + outputs["local.output_bias"][rows][:, None, None])[None]
        row += channels
    return HeadReader(outputs, cells, cells, "m").heads(outputs), DenseHeads(dense)


def test_heads_at_cells_equal_dense_heads() -> None:
    local, dense = local_heads()
    rows, columns = np.array([0, 3, 7, 7]), np.array([0, 5, 7, 2])  # corners and inner cells
    for name in LOCAL:
        (found,), (expected,) = (heads.read((name,), rows, columns) for heads in (local, dense))
        assert found.shape == (4, LOCAL[name])
        np.testing.assert_allclose(found, expected, atol=1e-3)


def test_no_cell_has_no_values() -> None:
    local, _ = local_heads()
    nowhere = np.zeros(0, np.intp)
    assert [x.shape for x in local.read(tuple(LOCAL), nowhere, nowhere)] == [
        (0, n) for n in LOCAL.values()
    ]


def test_bytes_or_floats_by_the_network() -> None:
    for dtype in ("uint8", "float32"):
        session = ArraySession(empty_heads(), (1, None, None, 3), dtype)
        MoveNet(session, ModelSettings(scores="network")).detect(
            np.full((480, 640, 3), 200, np.uint8)
        )
        assert session.image.shape == (1, 256, 320, 3)
        assert session.image.dtype == np.dtype(dtype)
        assert (session.image[0, 8:248] == 200).all()
        assert not session.image[0, :8].any()


def test_other_outputs_are_refused() -> None:
    heads = empty_heads()
    del heads["kpt_offset"]
    with pytest.raises(ModelError, match="expected an output kpt_offset"):
        detect(heads)
    with pytest.raises(ModelError, match="expected center of 1x1x64x80, got 1x1x64x64"):
        detect(empty_heads(64, 64))
