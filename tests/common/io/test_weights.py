import hashlib
from pathlib import Path

import msgspec
import pytest

from common.io import weights
from common.io.weights import ModelFile
from people4d.errors import ConfigError, ModelError

ABC = hashlib.sha256(b"abc").hexdigest()


def model(**fields: str) -> ModelFile:
    known = {"name": "m", "kind": "movenet", "file": "m.onnx", "licence": "MIT", "input": "bytes"}
    return msgspec.convert(known | {"get": "Run make-it."} | fields, ModelFile)


def manifest(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "models.toml"
    path.write_text(text)
    return path


def test_manifest_of_the_project() -> None:
    models = weights.load_manifest()
    assert next(iter(models)) == "movenet-multipose"
    assert {"yolov8n-pose", "yolov8n-seg", "yolov8s-pose", "yolov8s-seg"} < set(models)
    assert models["osnet-x0.25-msmt17"].kind == "osnet"
    for name, entry in models.items():
        assert entry.name == name
        assert entry.licence
        assert entry.get


def test_embedded_model_is_the_one_of_the_manifest() -> None:
    entry = weights.load_manifest()["movenet-multipose"]
    path = weights.find(entry, [weights.REPOSITORY / "models"])
    assert entry.sha256
    weights.verify(path, entry.sha256)
    assert path.stat().st_size <= 10_000_000


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[m", "is not TOML"),
        ("[m]\nkind = 'movenet'", r"\[m\]: Object missing required field `file`"),
        ("m = 3", r"\[m\]"),
        ("[m]\nkind='k'\nfile='f'\nlicence=''\ninput=''\nget=''\nsize=3", "unknown field `size`"),
        ("[m]\nkind='k'\nfile='../f'\nlicence=''\ninput=''\nget=''", "plain file name, got '../f'"),
        ("[m]\nkind='k'\nfile='/etc/f'\nlicence=''\ninput=''\nget=''", "plain file name"),
        ("[m]\nkind='k'\nfile='..'\nlicence=''\ninput=''\nget=''", "plain file name"),
        ("[m]\nkind='k'\nfile='a/f'\nlicence=''\ninput=''\nget=''", "plain file name"),
        # Names of models must not send control sequences to the terminal.
        ('[m]\nkind="k"\nfile="f"\nlicence=""\ninput=""\nget="\\u001b[2J"', "can be printed"),
        ("a = " + "[" * 5000, "is not TOML: lists or tables are nested too deeply"),
        (
            "[m]\nkind='k'\nfile='f'\nlicence=''\ninput=''\nget=''\nsha256='ab'",
            "expected 64 hexadecimal digits, got 'ab'",
        ),
    ],
)
def test_wrong_manifest(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        weights.load_manifest(manifest(tmp_path, text))


def test_absent_manifest(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        weights.load_manifest(tmp_path / "models.toml")


def test_unknown_name_suggests_a_near_one() -> None:
    with pytest.raises(ModelError, match=r"'yolo8n-pose' is unknown\. Did you mean yolov8n-p"):
        weights.choose("yolo8n-pose", weights.load_manifest())
    with pytest.raises(ModelError, match=r"Choose m\. Or give the path of an \.onnx file"):
        weights.choose("zzz", {"m": model()})


def test_folders_in_order(tmp_path: Path) -> None:
    environment = {"PEOPLE4D_MODELS": str(tmp_path)}
    searched = weights.folders("/data/models", environment)
    assert searched[:3] == (Path("/data/models"), tmp_path, weights.REPOSITORY / "models")
    assert searched[3].is_absolute()
    assert weights.folders("", {"PEOPLE4D_MODELS": ""}) == searched[2:]


def test_first_folder_that_has_the_file_wins(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
    (two / "m.onnx").write_bytes(b"abc")
    assert weights.find(model(), [one, two, tmp_path / "absent"]) == two / "m.onnx"
    (one / "m.onnx").write_bytes(b"abc")
    assert weights.find(model(), [one, two]) == one / "m.onnx"


def test_absent_file_is_reported_with_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(ModelError) as caught:
        weights.find(model(), [tmp_path])
    assert caught.value.problem == f"model m: m.onnx was not found in {tmp_path}"
    assert caught.value.hint == "Run make-it."


def test_checksum(tmp_path: Path) -> None:
    path = tmp_path / "m.onnx"
    path.write_bytes(b"abc")
    # FIPS 180-2, example B.1: the message "abc".
    assert weights.checksum(path).startswith("ba7816bf 8f01cfea".replace(" ", ""))
    weights.verify(path, ABC)
    weights.verify(path, "")
    path.write_bytes(b"abx")
    with pytest.raises(ModelError, match=f"expected sha256 {ABC}, got [0-9a-f]{{64}}.*remove it"):
        weights.verify(path, ABC)
    with pytest.raises(ModelError, match="cannot be read"):
        weights.verify(tmp_path, ABC)


def test_written_manifest_is_read_as_the_users_own_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PEOPLE4D_MODELS", str(tmp_path))
    own = model(name="mine", get='From "C:\\models"\nof \u00fcber.')
    weights.write_manifest(tmp_path / "models.toml", {"mine": own, "m": model()})
    known = weights.known_models()
    assert known["mine"] == own
    assert list(known)[:1] == ["movenet-multipose"]
    assert list(known)[-2:] == ["mine", "m"]
