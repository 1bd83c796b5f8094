// Decoder with the interface of @msgpack/msgpack, which is not installed where tests run.
export function decode(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let at = 0;
  const number = (read, size) => ((at += size), view[read](at - size));
  const binary = (size) => bytes.subarray(at, (at += size));
  const text = (size) => new TextDecoder().decode(binary(size));
  const list = (size) => Array.from({ length: size }, value);
  const map = (size) => Object.fromEntries(Array.from({ length: size }, () => [value(), value()]));
  const kinds = {
    0xc0: () => null, 0xc2: () => false, 0xc3: () => true,
    0xc4: () => binary(number("getUint8", 1)), 0xc5: () => binary(number("getUint16", 2)),
    0xca: () => number("getFloat32", 4), 0xcb: () => number("getFloat64", 8),
    0xcc: () => number("getUint8", 1), 0xcd: () => number("getUint16", 2),
    0xce: () => number("getUint32", 4), 0xcf: () => number("getBigUint64", 8),
    0xd0: () => number("getInt8", 1), 0xd1: () => number("getInt16", 2),
    0xd2: () => number("getInt32", 4), 0xd3: () => number("getBigInt64", 8),
    0xd9: () => text(number("getUint8", 1)), 0xda: () => text(number("getUint16", 2)),
    0xdc: () => list(number("getUint16", 2)), 0xde: () => map(number("getUint16", 2)),
  };
  function value() {
    const kind = number("getUint8", 1);
    if (kind < 0x80) return kind;
    if (kind < 0x90) return map(kind & 0x0f);
    if (kind < 0xa0) return list(kind & 0x0f);
    if (kind < 0xc0) return text(kind & 0x1f);
    return kind < 0xe0 ? kinds[kind]() : kind - 0x100;
  }
  return value();
}
