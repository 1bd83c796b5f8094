"""Image sizes in the headers of files, read before a decoder allocates memory."""

import re
import struct

from people4d.errors import DecodeError
from people4d.messages.base import MAX_PIXELS

MAX_FILE_BYTES = 64 * 2**20
# Deflate packs at most 1032 to 1, and JPEG takes at least 1 bit per block of 8x8 pixels; a decoder
# would allocate memory for larger, false sizes
MAX_PIXELS_PER_BYTE = 1100
# Maximum number of segments of a JPEG before its size; a colour profile of 16 MB takes 256
MAX_SEGMENTS = 1024
MAX_SCANS = 64  # maximum number of scans of a JPEG, each as slow as the image itself; 10 are usual
MAX_CHUNKS = 65536  # maximum number of chunks of a PNG
MAX_PACKED = 4  # maximum number of packed texts and profiles of a PNG, which unpack to 8 MB each

JPEG, PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
TIFF = (b"II*\0", b"MM\0*")
TIFF_WIDTH, TIFF_HEIGHT, TIFF_TILE_WIDTH = 256, 257, 322  # tags
TIFF_SHORT = 3  # type of a tag of 16 bits; others have 32
PACKED = (b"zTXt", b"iTXt", b"iCCP")
PNM = re.compile(rb"P[56](?:\s|#[^\n]{0,200}\n){1,8}(\d{1,6})\s(?:\s|#[^\n]{0,200}\n)?(\d{1,6})\s")

_CHUNK = struct.Struct(">I4s")


def image_size(data: bytes, name: str = "image") -> tuple[int, int]:
    """Return width and height of an untrusted JPEG, PNG, TIFF, BMP, PGM or PPM, or DecodeError."""
    try:
        width, height = _size(data)
    except ValueError as error:
        raise DecodeError(f"{name}: {error}") from error
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise DecodeError(f"{name}: expected 1 to {MAX_PIXELS} pixels, got {width}x{height}")
    if width * height > MAX_PIXELS_PER_BYTE * len(data):
        raise DecodeError(f"{name}: {width}x{height} pixels cannot be in {len(data)} bytes")
    return width, height


def _size(data: bytes) -> tuple[int, int]:
    if len(data) > MAX_FILE_BYTES:
        raise ValueError(f"expected at most {MAX_FILE_BYTES} bytes, got {len(data)}")
    for begin, read in READERS.items():
        if data.startswith(begin):
            return read(data)
    raise ValueError("expected JPEG, PNG, TIFF, BMP, PGM or PPM, got another file or a corrupt one")


def _jpeg(data: bytes) -> tuple[int, int]:
    if data.count(b"\xff\xda") > MAX_SCANS:
        raise ValueError(f"expected a JPEG of at most {MAX_SCANS} scans, got more")
    position = 2
    for _ in range(MAX_SEGMENTS):
        if position + 9 > len(data) or data[position] != 0xFF:
            break
        marker = data[position + 1]
        # SOF0 to SOF15 hold the size; C4, C8 and CC among them are tables.
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        if marker == 0xFF:  # padding before a marker
            position += 1
            continue
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    raise ValueError("expected a JPEG, got a corrupt one")


def _png(data: bytes) -> tuple[int, int]:
    if len(data) < 33 or data[12:16] != b"IHDR":
        raise ValueError("expected a PNG, got a corrupt one")
    position, packed = 8, 0
    for _ in range(MAX_CHUNKS):
        if position + 12 > len(data):
            break
        length, kind = _CHUNK.unpack_from(data, position)
        if length > len(data) - position - 12:  # OpenCV would allocate this length
            raise ValueError("expected a complete PNG, got a truncated one")
        packed += kind in PACKED
        if kind == b"acTL":
            raise ValueError("expected a still PNG, got an animated one")
        position += 12 + length
    if packed > MAX_PACKED or position + 12 <= len(data):
        raise ValueError("expected a PNG of a camera, got one of many texts or pieces")
    width, height = struct.unpack_from(">II", data, 16)
    return width, height


def _tiff(data: bytes) -> tuple[int, int]:
    """Read the first directory of a TIFF."""
    order = "<" if data.startswith(b"II") else ">"
    try:
        (start,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, start)
        entries = [
            struct.unpack_from(f"{order}HH4x4s", data, start + 2 + 12 * k) for k in range(count)
        ]
    except struct.error:
        raise ValueError("expected a TIFF, got a truncated one") from None
    sizes = {
        tag: struct.unpack_from(f"{order}{'H' if kind == TIFF_SHORT else 'I'}", value)[0]
        for tag, kind, value in entries
    }
    if TIFF_TILE_WIDTH in sizes:  # a decoder would allocate a tile of any size
        raise ValueError("expected a TIFF in strips, got one in tiles")
    return sizes.get(TIFF_WIDTH, 0), sizes.get(TIFF_HEIGHT, 0)


def _bmp(data: bytes) -> tuple[int, int]:
    if len(data) < 26:
        raise ValueError("expected a BMP, got a truncated one")
    if data[14] == 12:
        width, height = struct.unpack_from("<HH", data, 18)
    else:
        width, height = struct.unpack_from("<ii", data, 18)
    return width, abs(height)  # < 0: from the top down


def _pnm(data: bytes) -> tuple[int, int]:
    found = PNM.match(data[:4096])
    if not found:
        raise ValueError("expected a PGM or PPM, got a corrupt one")
    return int(found[1]), int(found[2])


READERS = {
    JPEG: _jpeg,
    PNG: _png,
    **dict.fromkeys(TIFF, _tiff),
    b"BM": _bmp,
    b"P5": _pnm,
    b"P6": _pnm,
}
