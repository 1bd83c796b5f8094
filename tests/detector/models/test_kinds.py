"""Kinds of networks, on graphs of random weights in the shapes of real exports."""

from pathlib import Path

import numpy as np
import pytest

from people4d.errors import ModelError
from people4d.messages import F32, U8
from services.detector.config import ModelSettings
from services.detector.models.base import PersonModel
from services.detector.models.registry import check_model, load_boxes, load_model
from services.detector.models.rtmo import Rtmo
from services.detector.models.rtmpose import DEVIATION, MEAN, RtmPose, crop, keypoints_of
from tests.detector.array_session import ArraySession
from tests.detector.models.graphs import write_network

RNG = np.random.default_rng(5)
IMAGE: U8 = RNG.integers(0, 255, (480, 640, 3), np.uint8)
SIZE = 640


def columns(classes: int, extras: int, boxes: int = 8400) -> F32:
    """1x(4+classes+extras)xN: boxes of 40 to 80 pixels, scores of 0 to 1."""
    output = RNG.random((1, 4 + classes + extras, boxes), np.float32)
    output[0, :4] = output[0, :4] * 40 + [[300], [300], [40], [40]]
    return output


def rows(extras: int, boxes: int = 300) -> F32:
    """1xNx(6+extras): boxes of 50 to 150 pixels, scores of 0 to 1, of the class person."""
    output = RNG.random((1, boxes, 6 + extras), np.float32)
    output[0, :, 0:2] = output[0, :, 0:2] * 500
    output[0, :, 2:4] = output[0, :, 0:2] + 50 + 100 * output[0, :, 2:4]
    output[0, :, 5] = 0
    return output


def prototypes() -> F32:
    return RNG.standard_normal((1, 32, 160, 160), np.float32)


def simcc(keypoints: int) -> dict[str, F32]:
    """Outputs of RTMPose at 256x192: two bins a pixel."""
    x, y = RNG.random((1, keypoints, 384), np.float32), RNG.random((1, keypoints, 512), np.float32)
    return {"simcc_x": x, "simcc_y": y}


def load(folder: Path, outputs: dict[str, F32], size: tuple[int, int]) -> PersonModel:
    path = write_network(folder / "n.onnx", outputs, size, weight=0.02)
    return load_boxes(ModelSettings(model=str(path), scores="network"))


@pytest.mark.parametrize(
    ("kind", "outputs", "size"),
    [
        pytest.param("yolov8-pose", {"output0": columns(1, 51)}, (SIZE, SIZE), id="YOLO11-pose"),
        pytest.param("yolov8-pose", {"output0": rows(51)}, (SIZE, SIZE), id="YOLO26-pose"),
        pytest.param(
            "yolov8-seg",
            {"output0": columns(80, 32, 1680), "output1": prototypes()},
            (SIZE, SIZE),
            id="YOLO11-seg",
        ),
        pytest.param(
            "yolov8-seg",
            {"output0": columns(1, 32, 1680), "output1": prototypes()},
            (SIZE, SIZE),
            id="YOLO-seg of one class",
        ),
        pytest.param(
            "yolov8-seg",
            {"output0": rows(32), "output1": prototypes()},
            (SIZE, SIZE),
            id="YOLO26-seg",
        ),
        pytest.param("yolo-boxes", {"output0": rows(0)}, (SIZE, SIZE), id="YOLOv10"),
        pytest.param("yolo-boxes", {"output0": columns(80, 0, 1680)}, (SIZE, SIZE), id="YOLO11"),
        pytest.param(
            "rtmo",
            {"dets": rows(0)[..., :5], "keypoints": RNG.random((1, 300, 17, 3), np.float32)},
            (SIZE, SIZE),
            id="RTMO",
        ),
        pytest.param("rtmpose", simcc(17), (256, 192), id="RTMPose"),
        pytest.param("rtmpose", simcc(133), (256, 192), id="RTMPose of the whole body"),
    ],
)
def test_kind_is_found_and_people_have_its_outputs(
    kind: str, outputs: dict[str, F32], size: tuple[int, int], tmp_path: Path
) -> None:
    model = load(tmp_path, outputs, size)
    assert model.name == f"{kind}:n"
    people = model.detect(IMAGE)
    if kind != "rtmpose":  # the shipped model finds no person in noise
        assert people
    for person in people:
        assert (person.keypoints is not None) == (kind in ("yolov8-pose", "rtmo"))
        assert person.mask is None or kind == "yolov8-seg"
    assert kind != "yolov8-seg" or any(person.mask is not None for person in people)


def test_input_of_rtmo_has_blue_first_and_people_are_in_pixels_of_the_image() -> None:
    # 480x640 in 640x640: nothing is scaled, 80 rows of bar above. The second box shares 90 of 110
    # columns with the first: overlap 0.82, the same person.
    boxes = np.array([[[150, 200, 250, 400, 0.9], [160, 200, 260, 400, 0.8]]], np.float32)
    keypoints = np.tile(np.array([200, 300, 0.5], np.float32), (1, 2, 17, 1))
    session = ArraySession({"dets": boxes, "keypoints": keypoints}, (1, 3, SIZE, SIZE))
    red = np.zeros((480, 640, 3), np.uint8)
    red[..., 0] = 255
    (person,) = Rtmo(session, ModelSettings(scores="network")).detect(red)
    assert person.score == pytest.approx(0.9)
    np.testing.assert_allclose(person.box_xyxy_px, [150, 120, 250, 320])
    assert person.keypoints is not None
    np.testing.assert_allclose(person.keypoints, np.tile([200, 220, 0.5], (17, 1)))
    assert (session.image[0, :, 320, 320] == (0, 0, 255)).all()
    assert (session.image[0, :, 0, 0] == 114).all()


def test_crop_of_rtmpose_is_a_quarter_larger_than_the_box() -> None:
    # A box of 153.6x204.8 about (200.5, 200.5), times 1.25, is 192x256: one pixel of the input is
    # one pixel of the image, and the first centre is (104.5, 72.5). A box of 192x102.4, times 1.25,
    # is 240x128: its width determines the scale, 1.25, and the crop, 240x320.
    image, corner, scale = crop(IMAGE, np.array([123.7, 98.1, 277.3, 302.9]), (256, 192))
    assert scale == pytest.approx(1.0)
    np.testing.assert_allclose(corner, [104.5, 72.5], atol=1e-4)
    expected = (IMAGE[72:328, 104:296] - MEAN) / DEVIATION
    np.testing.assert_allclose(image[0].transpose(1, 2, 0), expected, atol=0.02)
    _, corner, scale = crop(IMAGE, np.array([104, 148.8, 296, 251.2]), (256, 192))
    assert scale == pytest.approx(1.25)
    np.testing.assert_allclose(corner, [80, 40], atol=1e-4)


def test_keypoint_of_rtmpose_is_at_its_best_bins() -> None:
    # Bins 40 of x and 100 of y are 20 and 50 pixels of the crop, twice that in the image.
    x, y = np.zeros((17, 384), np.float32), np.zeros((17, 512), np.float32)
    x[:, 40], y[:, 100] = 0.8, 0.6
    x[3, 40], y[3, 100] = 1.5, 1.1  # scores of this network may exceed 1
    keypoints = keypoints_of(x, y, np.array([104.0, 72.0]), 2.0)
    np.testing.assert_allclose(keypoints[0], [144, 172, 0.7])
    assert keypoints[3, 2] == 1.0


def test_boxes_of_another_model_get_the_keypoints_of_rtmpose(tmp_path: Path) -> None:
    # 480x640 in 640x640. RTMPose's best bins are in the middle of the crop, so of the box.
    row = np.array([[[150, 200, 250, 400, 0.9, 0]]], np.float32)
    boxes = write_network(tmp_path / "boxes.onnx", {"output0": np.repeat(row, 300, axis=1)})
    outputs = {"x": np.zeros((1, 17, 384), np.float32), "y": np.zeros((1, 17, 512), np.float32)}
    outputs["x"][..., 192], outputs["y"][..., 256] = 0.8, 0.8
    pose = write_network(tmp_path / "pose.onnx", outputs, (256, 192), batch="batch")
    settings = ModelSettings(model=str(pose), boxes=str(boxes), scores="network")
    (person,) = load_model(settings).detect(IMAGE)
    assert person.score == pytest.approx(0.9)
    np.testing.assert_allclose(person.box_xyxy_px, [150, 120, 250, 320])
    assert person.keypoints is not None
    np.testing.assert_allclose(person.keypoints, np.tile([200, 220, 0.8], (17, 1)), rtol=1e-5)


def test_absent_model_of_boxes_is_reported_before_the_start(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.onnx does not exist"):
        check_model(ModelSettings(boxes=str(tmp_path / "none.onnx")))


def test_outputs_in_another_order_are_no_rtmpose() -> None:
    with pytest.raises(ModelError, match="expected outputs 1x17x384 and 1x17x512, got"):
        RtmPose(ArraySession(dict(reversed(simcc(17).items())), (1, 3, 256, 192)), ModelSettings())
