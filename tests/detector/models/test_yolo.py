from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from people4d.errors import ModelError
from people4d.messages import F32, U8
from services.detector.config import ModelSettings
from services.detector.models.base import DetectedPerson
from services.detector.models.yolo import YoloPose
from services.detector.models.yolo_seg import YoloSeg
from tests.detector.array_session import ArraySession

DOG = 16  # of COCO's 80 classes; person is 0


def image(height: int, width: int) -> U8:
    return np.zeros((height, width, 3), np.uint8)


def pose_output(*people: tuple[float, float, float, float, float]) -> F32:
    """1x56xN of (x, y, width, height, score); keypoint k lies k pixels right of the centre."""
    columns = np.zeros((1, 56, len(people)), np.float32)
    for column, (x, y, width, height, score) in enumerate(people):
        columns[0, :5, column] = x, y, width, height, score
        for k in range(17):
            columns[0, 5 + 3 * k : 8 + 3 * k, column] = x + k, y, 0.5
    return columns


@dataclass(frozen=True)
class Box:
    """One column of a segmentation model."""

    xywh: tuple[float, float, float, float]
    person: float  # score
    dog: float = 0.0  # score


def seg_outputs(*boxes: Box) -> dict[str, F32]:
    """1x116xN, each box with the first prototype as its mask, and prototypes for 64x64."""
    columns = np.zeros((1, 116, len(boxes)), np.float32)
    for index, box in enumerate(boxes):
        columns[0, :4, index] = box.xywh
        columns[0, 4, index] = box.person
        columns[0, 4 + DOG, index] = box.dog
        columns[0, 84, index] = 1.0
    return {"output0": columns, "output1": left_half(16, 16)[None]}


def segment(height: int, width: int, *boxes: Box) -> list[DetectedPerson]:
    """People in an image of the given size, seen by a network of 64x64."""
    model = YoloSeg(
        ArraySession(seg_outputs(*boxes), (1, 3, 64, 64)), ModelSettings(scores="network")
    )
    return model.detect(image(height, width))


def left_half(height: int, width: int) -> F32:
    """32 prototypes; the first is +1 in the left half and -2 in the right half."""
    prototypes = np.zeros((32, height, width), np.float32)
    prototypes[0, :, : width // 2] = 1
    prototypes[0, :, width // 2 :] = -2
    return prototypes


def test_pose_comes_back_in_image_pixels() -> None:
    # 640x480 in 640x640: nothing is scaled, 80 rows of bar above. The box centred at (200, 300),
    # 100 wide and 200 high, spans x 150 to 250, y 200 to 400 of the input: 120 to 320 of the image.
    session = ArraySession({"output0": pose_output((200, 300, 100, 200, 0.9))}, (1, 3, 640, 640))
    (person,) = YoloPose(session, ModelSettings(scores="network")).detect(image(480, 640))
    assert person.score == pytest.approx(0.9)
    np.testing.assert_allclose(person.box_xyxy_px, [150, 120, 250, 320])
    assert person.keypoints is not None
    np.testing.assert_allclose(person.keypoints[3], [203, 220, 0.5])
    assert person.mask is None


def selected(*people: tuple[float, float, float, float, float, float], extras: int) -> F32:
    """1x300x(6 + extras) of (left, top, right, bottom, score, class), as with NMS inside."""
    rows = np.zeros((1, 300, 6 + extras), np.float32)
    for index, person in enumerate(people):
        rows[0, index, :6] = person
        rows[0, index, 6::3] = person[0] + np.arange(len(rows[0, index, 6::3]))
    return rows


def test_pose_of_a_network_with_nms_inside_is_read() -> None:
    # The person of the previous test, by the corners of the box; the second row has class 16.
    rows = selected((150, 200, 250, 400, 0.9, 0), (300, 200, 400, 400, 0.8, DOG), extras=51)
    session = ArraySession({"output0": rows}, (1, 3, 640, 640))
    (person,) = YoloPose(session, ModelSettings(scores="network")).detect(image(480, 640))
    assert person.score == pytest.approx(0.9)
    np.testing.assert_allclose(person.box_xyxy_px, [150, 120, 250, 320])
    assert person.keypoints is not None
    assert person.keypoints[3, 0] == 153


def test_masks_of_a_network_with_nms_inside_are_read() -> None:
    rows = selected((10, 12, 30, 52, 0.9, 0), (40, 12, 60, 52, 0.8, DOG), extras=32)
    rows[0, 0, 6:] = 0.0
    rows[0, 0, 6] = 1.0  # the first prototype
    outputs = {"output0": rows, "output1": left_half(16, 16)[None]}
    model = YoloSeg(ArraySession(outputs, (1, 3, 64, 64)), ModelSettings(scores="network"))
    (person,) = model.detect(image(64, 64))
    np.testing.assert_allclose(person.box_xyxy_px, [10, 12, 30, 52])
    assert person.mask is not None
    assert person.mask.window.sum() > 0


def test_overlapping_boxes_of_one_person_are_one() -> None:
    # Boxes 100 wide, shifted by 20: overlap 80, union 120, IoU 0.667 > 0.6: one person.
    # Shifted by 50 from the first: overlap 50, union 150, IoU 0.333: another one.
    output = pose_output(
        (220, 300, 100, 200, 0.8), (200, 300, 100, 200, 0.9), (250, 300, 100, 200, 0.7)
    )
    model = YoloPose(
        ArraySession({"output0": output}, (1, 3, 640, 640)), ModelSettings(scores="network")
    )
    assert [round(p.score, 2) for p in model.detect(image(480, 640))] == [0.9, 0.7]


def test_settings_limit_score_overlap_and_number() -> None:
    output = pose_output(
        (220, 300, 100, 200, 0.8), (200, 300, 100, 200, 0.9), (450, 300, 100, 200, 0.3)
    )
    session = ArraySession({"output0": output}, (1, 3, 640, 640))

    def scores(settings: ModelSettings) -> list[float]:
        people = YoloPose(session, settings).detect(image(480, 640))
        return [round(person.score, 2) for person in people]

    assert scores(ModelSettings(scores="network")) == [0.9, 0.3]
    assert scores(ModelSettings(scores="network", iou_max=0.7)) == [0.9, 0.8, 0.3]
    assert scores(ModelSettings(scores="network", score_min=0.5)) == [0.9]
    assert scores(ModelSettings(scores="network", iou_max=0.7, max_people=2)) == [0.9, 0.8]


def test_two_people_and_a_dog() -> None:
    people = segment(
        64,
        64,
        Box((20, 32, 20, 40), person=0.9),
        Box((24, 32, 20, 40), person=0.6, dog=0.1),  # 16 of 24 columns shared: IoU 0.667, the same
        Box((4, 32, 20, 40), person=0.7),  # 4 of 36 columns: another person
        Box((50, 50, 20, 20), person=0.4, dog=0.8),  # more of a dog than of a person
    )
    assert [round(person.score, 2) for person in people] == [0.9, 0.7]
    assert all(person.keypoints is None for person in people)


def test_boxes_round_one_mask_are_one_person() -> None:
    # A body with half-hidden legs gives a long and a short box. Columns 4 to 28 of both are mask;
    # rows 8 to 56 and 8 to 32: IoU 24 / 48 = 0.5 < 0.6, but the smaller mask is entirely shared.
    # Rows 48 to 64 of the third box (cut at the image) share 8 of 16 rows: another person.
    people = segment(
        64,
        64,
        Box((16, 32, 24, 48), person=0.9),
        Box((16, 20, 24, 24), person=0.8),
        Box((16, 57, 24, 18), person=0.7),
    )
    assert [round(person.score, 2) for person in people] == [0.9, 0.7]


@pytest.mark.parametrize(("times", "end"), [(1, 31), (2, 63), (3, 94)])
def test_mask_ends_where_its_logit_is_zero(times: int, end: int) -> None:
    # Input 64x64, prototypes 16x16. The logit is +1 at the centre of column 7 (7.5), -2 at the
    # centre of column 8, and so 0 at 7.5 + 1/3. This is 31.33 in the input, and 31.33, 62.67 or 94
    # in an image 1, 2 or 3 times as large. A pixel is in the mask if its centre is: the last
    # centres are 30.5, 62.5 and 93.5.
    # The box spans 12 to 52 and 8 to 56 of the input.
    (person,) = segment(64 * times, 64 * times, Box((32, 32, 40, 48), person=0.9))
    mask = person.mask
    assert mask is not None
    assert (mask.x_px, mask.y_px) == (12 * times, 8 * times)
    assert mask.window.shape == (48 * times, 40 * times)
    assert mask.window[:, : end - 12 * times].all()
    assert not mask.window[:, end - 12 * times :].any()


def test_mask_in_a_letterbox() -> None:
    # Image 128x64 in 64x64: halved to 64x32, bar of 16 above. The box 12 to 52, 20 to 44 of the
    # input is 24 to 104, 8 to 56 of the image; the mask ends at 62.67, so with column 62.
    (person,) = segment(64, 128, Box((32, 32, 40, 24), person=0.9))
    np.testing.assert_allclose(person.box_xyxy_px, [24, 8, 104, 56])
    assert person.mask is not None
    assert person.mask.window.sum(axis=1).tolist() == [63 - 24] * 48


def test_mask_stays_in_the_image() -> None:
    # The box spans -8 to 24 and 40 to 80 in an image of 64x64; its mask 0 to 24 and 40 to 64.
    (person,) = segment(64, 64, Box((8, 60, 32, 40), person=0.9))
    np.testing.assert_allclose(person.box_xyxy_px, [-8, 40, 24, 80])
    assert person.mask is not None
    assert (person.mask.x_px, person.mask.y_px, person.mask.window.shape) == (0, 40, (24, 24))


def test_box_beside_the_image_has_no_mask() -> None:
    (person,) = segment(64, 64, Box((-20, 32, 10, 10), person=0.9))
    assert person.mask is None


def test_no_people() -> None:
    assert segment(64, 64, Box((32, 32, 9, 9), person=0.1)) == []
    model = YoloPose(
        ArraySession({"output0": pose_output()}, (1, 3, 64, 64)), ModelSettings(scores="network")
    )
    assert model.detect(image(64, 64)) == []


def test_network_of_any_size_uses_the_camera_image_or_the_size_set() -> None:
    session = ArraySession({"output0": pose_output((200, 300, 100, 200, 0.9))}, (1, 3, None, None))
    model = YoloPose(session, ModelSettings(scores="network"))
    (person,) = model.detect(image(480, 640))  # without bars: y 200 to 400 is the image's own
    assert session.image.shape == (1, 3, 480, 640)
    np.testing.assert_allclose(person.box_xyxy_px, [150, 200, 250, 400])
    YoloPose(session, ModelSettings(input_height=320, input_width=416)).detect(image(480, 640))
    assert session.image.shape == (1, 3, 320, 416)


@pytest.mark.parametrize(("dtype", "white"), [("float32", 1.0), ("float16", 1.0), ("uint8", 255)])
def test_input_is_planar_rgb_in_the_type_of_the_network(dtype: str, white: float) -> None:
    output = pose_output((200, 300, 100, 200, 0.9)).astype(
        "float16" if dtype == "float16" else "f4"
    )
    session = ArraySession({"output0": output}, (1, 3, 64, 64), dtype)
    red = image(64, 64)
    red[..., 0] = 255
    (person,) = YoloPose(session, ModelSettings(scores="network")).detect(red)
    assert session.image.dtype == np.dtype(dtype)
    assert (session.image[0, 0] == white).all()
    assert not session.image[0, 1:].any()
    assert person.box_xyxy_px.dtype == np.float32
    assert person.keypoints is not None
    assert person.keypoints.dtype == np.float32


@pytest.mark.parametrize(
    "outputs",
    [
        {},
        {"output0": np.zeros((1, 300, 6), np.float32)},  # exported with NMS inside
        {"output0": np.zeros((1, 84, 8400), np.float32)},  # plain boxes
        {"output0": np.zeros((56, 8400), np.float32)},
    ],
)
def test_other_outputs_are_refused(outputs: dict[str, F32]) -> None:
    session = ArraySession(outputs, (1, 3, 64, 64))
    with pytest.raises(ModelError, match="expected"):
        YoloPose(session, ModelSettings(scores="network"))
    with pytest.raises(ModelError, match="expected outputs"):
        YoloSeg(session, ModelSettings(scores="network"))


@pytest.mark.parametrize(
    ("shape", "settings", "message"),
    [
        (
            (1, 3, 640, 640),
            {"input_height": 320, "input_width": 320},
            "made for 640x640, got 320x320",
        ),
        ((1, 1, 640, 640), {}, "expected 1x3xHxW or 1xHxWx3, got 1x1x640x640"),
        ((4, 3, 640, 640), {}, "expected 1x3xHxW"),
        ((1, 512), {}, "expected 1x3xHxW"),
        ((1, 3, 100, 100), {}, "multiples of 32, got 100x100"),
    ],
)
def test_other_inputs_are_refused(
    shape: tuple[int, ...], settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        YoloPose(ArraySession({"o": pose_output()}, shape), ModelSettings(**settings))


@pytest.mark.parametrize(
    "fields",
    [
        {"input_height": 100, "input_width": 320},
        {"input_height": 320},
        {"score_min": 1.5},
        {"iou_max": -0.1},
        {"threads": 0},
        {"max_people": 0},
    ],
)
def test_settings_are_checked(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        ModelSettings(**fields)
